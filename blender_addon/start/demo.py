"""The demo: a painted relief of a sun and its low-poly copy with UVs, made without any files."""

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from mathutils import Euler
from numpy.typing import NDArray

from ..appearance.nodes import new_material
from ..rig.rig import remove_rig

NAME = "MPS Demo"
# Rings and sectors of the relief and of its copy.
_FINE, _COARSE = (220, 600), (10, 32)
_RAYS, _BEADS = 16, 40
_BLUE, _GOLD, _RED, _CREAM = (0.1, 0.2, 0.42), (0.75, 0.5, 0.16), (0.62, 0.16, 0.09), (0.8, 0.74, 0.6)
_FRONT, _THICK = 0.9, 0.08  # share of the rings that is the front, and how far the back is behind the rim
_PAINT = "Paint"  # colour of the vertices

_Values = NDArray[np.float64]


def make_demo() -> tuple[Any, Any, Any]:
    """A new scene with a painted relief and its plain low-poly copy, which share a UV layout.

    The copy is at the same position and hidden from renders.
    """
    scene = bpy.data.scenes.new(NAME)
    detailed, low = (_sun(scene, f"Demo {name}", *grid) for name, grid in (("Detailed", _FINE), ("Low Poly", _COARSE)))
    low.hide_render = True
    low.hide_set(True, view_layer=scene.view_layers[0])
    return scene, detailed, low


def remove_demo(scene: Any, made: Sequence[Any]) -> None:
    """Remove a demo: its rig, images, the objects `made` for it, and its scene if nothing else is in it."""
    remove_rig(scene)
    settings = scene.mps
    # Normals refer to their photo, which counts as a user.
    estimate = settings.estimate
    images = settings.bake.image, estimate.image, estimate.albedo_image, settings.photo.image
    pictures = [one for one in images if one is not None]
    meshes = {obj.data for obj in made}
    materials = {material for mesh in meshes for material in mesh.materials if material}
    bpy.data.batch_remove(made)
    if not scene.objects:
        bpy.data.scenes.remove(scene)
    for datablocks in (meshes, materials, *([picture] for picture in dict.fromkeys(pictures))):
        bpy.data.batch_remove([one for one in datablocks if not one.users])


def _sun(scene: Any, name: str, rings: int, sectors: int) -> Any:
    """A disc that faces the front: of few sectors a plain dome, of many with a carved and painted sun on it."""
    # The last tenth of the rings is the rim and the back, which the UVs have around the front.
    along, turn = np.linspace(0, 1, rings + 1)[1:], np.linspace(0, 2 * np.pi, sectors, endpoint=False)
    radius, front = np.minimum(along / _FRONT, (1 - along) / (1 - _FRONT)), np.repeat(along <= _FRONT, sectors)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    x, y = (radius[:, None, None] * circle).reshape(-1, 2).T
    carved, paint = _carved(x, y) if sectors > _COARSE[1] else (0 * x, np.full((len(x), 3), 0.5))
    height = np.where(front, 0.25 * np.sqrt(1.05 - x**2 - y**2) + carved, -_THICK)
    middle = height[:sectors].mean()
    here, first = np.arange(sectors), (np.arange(rings - 1) * sectors)[:, None]
    onwards = np.roll(here, -1)
    quads = np.stack([first + here, first + sectors + here, first + sectors + onwards, first + onwards], axis=-1)
    fan = np.stack([np.full(sectors, rings * sectors), here, onwards], axis=-1)

    mesh = bpy.data.meshes.new(name)
    vertices = np.vstack([np.stack([x, y, height], axis=-1), (0, 0, middle)])
    mesh.from_pydata(vertices, [], [*fan.tolist(), *quads.reshape(-1, 4).tolist()])
    places = np.vstack([(along[:, None, None] * circle).reshape(-1, 2), (0, 0)]) / 2 + 0.5
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", places[corners].astype(np.float32).ravel())
    colours = np.insert(np.vstack([paint, paint[:1]]), 3, 1, axis=-1).astype(np.float32)
    mesh.color_attributes.new(_PAINT, "FLOAT_COLOR", "POINT").data.foreach_set("color", colours.ravel())
    mesh.shade_smooth()
    mesh.materials.append(_matt())
    obj = bpy.data.objects.new(name, mesh)
    obj.rotation_euler = Euler((np.pi / 2, 0, 0))
    scene.collection.objects.link(obj)
    return obj


def _carved(x: _Values, y: _Values) -> tuple[_Values, _Values]:
    """The height of the carving (N,) and the paint (N, 3) at places on a disc of radius 1."""
    radius, turn, aside = np.hypot(x, y), np.arctan2(y, x), abs(x)
    chance = np.random.default_rng(1)

    def bump(right: float, up: float, wide: float, high: float) -> _Values:
        """A smooth bump; to the right and to the left alike."""
        return np.asarray(np.exp(-(((aside - right) / wide) ** 2) - ((y - up) / high) ** 2))

    def band(distance: _Values, width: float) -> _Values:
        return np.asarray(np.exp(-((distance / width) ** 4)))

    face = 1 / (1 + np.exp(np.clip((radius - 0.46) / 0.006, -30, 30)))
    eye = ((aside - 0.17) / 0.095) ** 2 + ((y - 0.09) / 0.055) ** 2
    lips, smile = band(aside, 0.15), y + 0.21 - 1.1 * aside**2
    height = face * (0.05 + 0.14 * np.sqrt(np.maximum(1 - (radius / 0.5) ** 2, 0)))
    height += (
        0.05 * bump(0, 0.07, 0.035, 0.12) + 0.07 * bump(0, -0.045, 0.05, 0.045) + 0.03 * bump(0, -0.33, 0.07, 0.05)
    )
    height += 0.04 * bump(0.05, -0.055, 0.025, 0.03)
    height += 0.04 * bump(0.24, -0.1, 0.09, 0.08)
    height += 0.05 * np.sqrt(np.maximum(1 - eye, 0)) + 0.02 * np.exp(-(((eye - 1.15) / 0.3) ** 2))
    height -= 0.06 * bump(0.17, 0.095, 0.09, 0.06) + 0.025 * bump(0.17, 0.09, 0.02, 0.02)
    height += 0.035 * np.exp(-(((y - 0.2 + 1.2 * (aside - 0.16) ** 2) / 0.022) ** 2)) * band(aside - 0.16, 0.1)
    height += lips * (0.04 * np.exp(-((smile / 0.04) ** 2)) - 0.05 * np.exp(-((smile / 0.012) ** 2)))

    number = np.round(turn / (2 * np.pi) * _RAYS)
    wavy = number % 2
    off = (turn - 2 * np.pi / _RAYS * number) * radius - 0.05 * wavy * np.sin(22 * (radius - 0.5))
    ray = 1 - abs(off) / np.maximum(0.088 * (1 - (radius - 0.5) / (0.34 - 0.04 * wavy)), 1e-6)
    ray = np.where((radius > 0.485) & (radius < 0.84), np.clip(ray, 0, 1), 0)
    bead = ((turn / (2 * np.pi) * _BEADS) % 1 - 0.5) * 2 * np.pi / _BEADS * 0.925
    ring = band(radius - 0.485, 0.014) + band(radius - 0.86, 0.01) + band(radius - 0.995, 0.012)
    ball = np.sqrt(np.maximum(0.06**2 - bead**2 - (radius - 0.925) ** 2, 0))
    height += 0.075 * np.minimum(1.6 * ray, 1) + 0.045 * ring + ball
    height += 0.002 * radius * chance.standard_normal(len(x)) * (radius < 0.98)

    paint = np.full((len(x), 3), _BLUE)
    red = (lips * np.exp(-((smile / 0.045) ** 2)) > 0.4) | ((ray > 0) & (wavy == 1)) | ((radius > 0.87) & (ball <= 0))
    gold = (face > 0.5) | ((ray > 0) & (wavy == 0)) | (ring > 0.3)
    for where, colour in ((gold, _GOLD), (red, _RED), ((eye < 1) | (ball > 0), _CREAM), (eye < 0.12, _BLUE)):
        paint[where] = colour
    return height, paint * (1 + 0.06 * chance.standard_normal((len(x), 1))).clip(0.8, 1.2)


def _matt() -> Any:
    """A matt material in the mesh's own colours."""
    material = new_material(NAME)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shader, paint = nodes["Principled BSDF"], nodes.new("ShaderNodeVertexColor")
    paint.layer_name = _PAINT
    links.new(paint.outputs["Color"], shader.inputs["Base Color"])
    shader.inputs["Roughness"].default_value = 1.0
    shader.inputs["Specular IOR Level"].default_value = 0.0
    return material
