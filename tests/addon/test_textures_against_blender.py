"""UDIM tiles, several objects and several materials in one bake against Blender's own bake of the same."""

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import OpenImageIO as oiio
from mathutils import Matrix, Vector
from synthetic import degrees_between

from blender_addon.images import pixels_of
from mpsnet_core import BakeSettings, Labels, Mesh, Texture, bake_texture_sets, write_image
from mpsnet_core.scene.texture_sets import TextureSet, texture_sets

from .rendering import activate, array_of, detailed_object, nodes_of, set_up_cycles, simplified, with_materials
from .test_bake_against_blender import SIDES, core_mesh, normal_view, normals_of

SIZE = 256


def textures(meshes: list[Mesh], tmp_path, seen: "bpy.types.Object", **by: bool) -> list[tuple[TextureSet, Texture]]:
    """What is baked of eight renders of an object's normals."""
    views = [normal_view(side, seen, tmp_path / "view.exr", "ORTHO") for side in SIDES]
    return list(bake_texture_sets(meshes, views, texture_sets(meshes, **by), BakeSettings(size=SIZE, margin=0)))


def image_for(material: "bpy.types.Material", path: Path, tiles: list[int]) -> "bpy.types.Image":
    """An empty image, or one of empty tiles, that Blender will bake a material's faces into."""
    for tile in tiles or [0]:
        file = path.with_name(path.name.replace("<UDIM>", str(tile)))
        write_image(file, np.zeros((SIZE, SIZE, 3), np.float32), bits=32)
    image = bpy.data.images.load(str(path).replace("<UDIM>", str(tiles[0] if tiles else 0)))
    image.colorspace_settings.name = "Non-Color"
    if tiles:
        image.source = "TILED"
    node = nodes_of(material).nodes.new("ShaderNodeTexImage")
    node.image = image
    nodes_of(material).nodes.active = node
    return image


def blender_bakes(detailed: "bpy.types.Object", simple: "bpy.types.Object") -> None:
    """Blender's own selected-to-active bake, into the images that the materials hold."""
    for obj in bpy.context.scene.objects:
        obj.hide_render = obj not in (detailed, simple)
    activate(simple, detailed)
    bpy.context.scene.cycles.samples = 1
    bpy.ops.object.bake(type="NORMAL", use_selected_to_active=True, cage_extrusion=0.03, margin=0, use_clear=True)


def judge(texture: Texture, reference: np.ndarray, name: str) -> None:
    both = texture.seen & reference.any(axis=-1)
    assert both.sum() > 0.97 * texture.covered.sum() > 500, name
    error = degrees_between(texture.vectors, reference)[both]
    flat = degrees_between(np.array([0, 0, 1.0]), reference)[both]
    print(f"{name}: mean {error.mean():.3f} degrees, of {flat.mean():.1f} that there were to bake")
    assert error.mean() < 0.5  # 2 was asked for
    assert flat.mean() > 3


def test_udim_tiles_agree_with_blenders_bake(scene, tmp_path):
    set_up_cycles(512)
    detailed = detailed_object()
    simple = simplified(detailed, 2000)
    with_materials(detailed, simple)
    layer = simple.data.uv_layers.active.data
    layer.foreach_set("uv", 2 * array_of(layer, "uv", 2).ravel())
    made = textures([core_mesh(simple, tmp_path / "mesh.npz")], tmp_path, detailed, tiles=True)
    assert [texture_set.tile for texture_set, _ in made] == [1001, 1002, 1011, 1012]
    image = image_for(simple.data.materials[0], tmp_path / "t.<UDIM>.exr", [1001, 1002, 1011, 1012])
    blender_bakes(detailed, simple)
    image.save()
    for texture_set, texture in made:
        found = oiio.ImageBuf(str(tmp_path / f"t.{texture_set.tile}.exr")).get_pixels(oiio.FLOAT)
        judge(texture, normals_of(found), f"tile {texture_set.tile}")


def test_several_objects_agree_with_blenders_bake(scene, tmp_path):
    """Two objects side by side, one of them turned; some views see the one before the other."""
    set_up_cycles(512)
    detailed, simple = [], []
    for number, turn in enumerate((0.0, 1.2)):
        one = detailed_object()
        one.name = f"Detailed {number}"
        low = simplified(one, 2000)
        low.name = f"Simple {number}"
        with_materials(one, low)
        place = Matrix.LocRotScale(
            Vector((0.5 - number, 0.1 * number, 0)), Matrix.Rotation(turn, 3, (1, 2, 3)).to_quaternion(), (0.45,) * 3
        )
        one.matrix_world = low.matrix_world = place
        detailed.append(one)
        simple.append(low)
    bpy.context.view_layer.update()
    both = detailed[0].copy()
    both.data = both.data.copy()
    copy = detailed[1].copy()
    copy.data = copy.data.copy()
    for obj in (both, copy):
        scene.collection.objects.link(obj)
    activate(both, copy)
    bpy.ops.object.join()
    with_materials(both)
    meshes = [core_mesh(low, tmp_path / f"{number}.npz") for number, low in enumerate(simple)]
    made = textures(meshes, tmp_path, both, objects=True)
    assert len(made) == 2
    for one, low, (_, texture) in zip(detailed, simple, made, strict=True):
        image = image_for(low.data.materials[0], tmp_path / f"{low.name}.exr", [])
        blender_bakes(one, low)
        judge(texture, normals_of(pixels_of(image)[::-1]), low.name)


def test_several_materials_agree_with_blenders_bake(scene, tmp_path):
    set_up_cycles(512)
    detailed = detailed_object()
    simple = simplified(detailed, 2000)
    with_materials(detailed, simple)
    simple.data.materials.append(bpy.data.materials.new("Other"))
    middles = array_of(simple.data.polygons, "center", 3)
    number = (middles[:, 2] + 0.2 * np.sin(9 * middles[:, 0]) > 0).astype(np.int32)
    simple.data.polygons.foreach_set("material_index", number)
    mesh = replace(core_mesh(simple, tmp_path / "mesh.npz"), materials=Labels(("First", "Other"), number))
    made = textures([mesh], tmp_path, detailed, materials=True)
    images = [
        image_for(material, tmp_path / f"m{place}.exr", []) for place, material in enumerate(simple.data.materials)
    ]
    blender_bakes(detailed, simple)
    assert sorted(str(texture_set.material) for texture_set, _ in made) == ["First", "Other"]
    for texture_set, texture in made:
        image = images[texture_set.material == "Other"]
        judge(texture, normals_of(pixels_of(image)[::-1]), f"material {texture_set.material}")
    covered = [texture.covered for _, texture in made]
    assert not (covered[0] & covered[1]).any()
