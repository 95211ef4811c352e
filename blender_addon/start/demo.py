"""The demo: a scene with a detailed object and its low-poly copy with UVs, generated without any files."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bmesh
import bpy

from ..appearance.nodes import new_material
from ..rig.rig import remove_rig

NAME = "MPS Demo"


@dataclass(frozen=True)
class _Relief:
    """A displacement pattern."""

    pattern: str
    """Blender's type of texture."""
    strength: float
    """From its lowest to its highest point, in metres."""
    settings: dict[str, float]
    """Of the texture."""


_SCALES = _Relief("VORONOI", 0.05, {"noise_scale": 0.16, "weight_1": -1.0, "weight_2": 1.0})
_GRAIN = _Relief("CLOUDS", 0.008, {"noise_scale": 0.05})


def make_demo() -> tuple[Any, Any, Any]:
    """A new scene with a monkey with scales and its smooth low-poly copy, which share Blender's own UV layout.

    The copy is at the same position and hidden from renders.
    """
    scene = bpy.data.scenes.new(NAME)
    detailed = _monkey(scene, "Demo Detailed", 5, [_SCALES, _GRAIN])
    low = _monkey(scene, "Demo Low Poly", 1, [])
    low.hide_render = True
    low.hide_set(True, view_layer=scene.view_layers[0])
    return scene, detailed, low


def remove_demo(scene: Any, made: Sequence[Any]) -> None:
    """Remove a demo: its rig, images, the objects `made` for it, and its scene if nothing else is in it."""
    remove_rig(scene)
    settings = scene.mps
    # Normals refer to their photo, which counts as a user.
    pictures = [one for one in (settings.bake.image, settings.estimate.image, settings.photo.image) if one is not None]
    meshes = {obj.data for obj in made}
    materials = {material for mesh in meshes for material in mesh.materials if material}
    bpy.data.batch_remove(made)
    if not scene.objects:
        bpy.data.scenes.remove(scene)
    for datablocks in (meshes, materials, *([picture] for picture in dict.fromkeys(pictures))):
        bpy.data.batch_remove([one for one in datablocks if not one.users])


def _monkey(scene: Any, name: str, levels: int, reliefs: Sequence[_Relief]) -> Any:
    obj = bpy.data.objects.new(name, _plain_monkey(name))
    scene.collection.objects.link(obj)
    subdivision = obj.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels = levels
    textures = []
    for relief in reliefs:
        textures.append(bpy.data.textures.new(name, relief.pattern))
        for setting, value in relief.settings.items():
            setattr(textures[-1], setting, value)
        modifier = obj.modifiers.new(relief.pattern, "DISPLACE")
        modifier.texture, modifier.strength, modifier.mid_level = textures[-1], relief.strength, 0.5
    _apply_modifiers(scene, obj)
    for texture in textures:
        bpy.data.textures.remove(texture)
    obj.data.shade_smooth()
    obj.data.materials.append(_matt())
    return obj


def _plain_monkey(name: str) -> Any:
    mesh, shape = bpy.data.meshes.new(name), bmesh.new()
    shape.loops.layers.uv.new("UVMap")
    bmesh.ops.create_monkey(shape, calc_uvs=True)
    shape.to_mesh(mesh)
    shape.free()
    return mesh


def _apply_modifiers(scene: Any, obj: Any) -> None:
    layer = scene.view_layers[0]
    layer.update()
    plain, depsgraph = obj.data, layer.depsgraph
    obj.data = bpy.data.meshes.new_from_object(obj.evaluated_get(depsgraph), depsgraph=depsgraph)
    obj.data.name = obj.name
    obj.modifiers.clear()
    bpy.data.meshes.remove(plain)


def _matt() -> Any:
    """A matt grey material."""
    material = new_material(NAME)
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (0.8, 0.8, 0.8, 1)
    shader.inputs["Roughness"].default_value = 1.0
    shader.inputs["Specular IOR Level"].default_value = 0.0
    return material
