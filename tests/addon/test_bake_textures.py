"""The operator bakes onto several objects, materials and UDIM tiles; each material wears its own texture."""

import re
import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon.bake.texture_sets import refuse_other_projects
from blender_addon.image_records import remember
from blender_addon.images import load_frames, load_image
from mpsnet_core import Camera, InputError, NormalMap, angular_error, write_camera, write_normals

from .rendering import array_of, matte, rendered

PLACES = {"Left": -1.2, "Right": 1.2}


@pytest.fixture
def spheres(scene, tmp_path):
    """Two unit spheres side by side that share a material, both selected, and the normals that a camera sees."""
    material = matte()
    for name, x in PLACES.items():
        bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, location=(x, 0, 0))
        bpy.ops.object.shade_smooth()
        bpy.context.object.name = name
        bpy.context.object.data.materials.append(material)
    row, column = np.mgrid[:100, :200]
    vectors, mask = np.zeros((100, 200, 3)), np.zeros((100, 200), bool)
    for x in PLACES.values():
        across, up = (column + 0.5 - 100) / 40 - x, (50 - row - 0.5) / 40
        inside = across**2 + up**2 < 0.999
        depth = np.sqrt(np.where(inside, 1 - across**2 - up**2, 0))
        vectors[inside], mask = np.stack([across, up, depth], axis=-1)[inside], mask | inside
    write_normals(tmp_path / "normals.exr", NormalMap(vectors, mask))
    # From the front, as Blender calls -y.
    pose = np.array([[1, 0, 0, 0], [0, 0, -1, -5], [0, 1, 0, 0], [0, 0, 0, 1]], float)
    write_camera(tmp_path / "c.json", Camera("orthographic", 200, 100, [40, 40], None, pose))
    scene.mps.estimate.image = load_image(tmp_path / "normals.exr", "Normals", is_data=True)
    remember(scene.mps.estimate.image, "camera", (tmp_path / "c.json").read_text())
    both = [bpy.data.objects[name] for name in PLACES]
    for obj in both:
        obj.select_set(True)
    return both


def worn(obj, slot=0):
    """The image that a material shows, and on which UV map."""
    nodes = obj.material_slots[slot].material.node_tree.nodes
    return nodes["MPS Texture"].image, nodes["MPS UV"].uv_map


def scaled_uvs(obj, scale):
    layer = obj.data.uv_layers.active.uv
    layer.foreach_set("vector", scale * array_of(layer, "vector", 2).ravel())


def shown_normals(scene, tmp_path, obj):
    """What Cycles shows of an object whose material glows with its texture, and the true normals; from the front."""
    material = obj.material_slots[0].material
    nodes, links = material.node_tree.nodes, material.node_tree.links
    glow = nodes.new("ShaderNodeEmission")
    links.new(nodes["MPS Texture"].outputs["Color"], glow.inputs["Color"])
    surface = next(node for node in nodes if node.type == "OUTPUT_MATERIAL").inputs["Surface"]
    before = surface.links[0].from_socket
    links.new(glow.outputs[0], surface)
    data = bpy.data.cameras.new("Front")
    data.type, data.ortho_scale = "ORTHO", 2.0
    camera = bpy.data.objects.new("Front", data)
    camera.location, camera.rotation_euler = (obj.location.x, -5, 0), (np.pi / 2, 0, 0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 0.01
    shown = rendered(tmp_path / "shown.exr", 160, 160, samples=1)[..., :3]
    links.new(before, surface)
    x, z = (np.mgrid[:160, :160][1] + 0.5) / 80 - 1, 1 - (np.mgrid[:160, :160][0] + 0.5) / 80
    inside = x**2 + z**2 < 0.9
    truth = np.stack([x, -np.sqrt(np.maximum(1 - x**2 - z**2, 0)), z], axis=-1)
    return 2 * shown[inside] - 1, truth[inside]


def test_udim_tiles_are_one_image_and_show_without_a_seam(spheres, scene, tmp_path):
    left = spheres[0]
    scaled_uvs(left, 2)
    bpy.ops.mps.bake(target="Left", tiles=True, size=256, space="OBJECT", output=str(tmp_path / "s.exr"))
    image, _ = worn(left)
    assert image.source == "TILED" and image.colorspace_settings.is_data and scene.mps.bake.image == image
    assert [tile.number for tile in image.tiles] == [1001, 1002, 1011, 1012]
    assert all((tmp_path / f"s.{tile.number}.exr").is_file() for tile in image.tiles)
    shown, truth = shown_normals(scene, tmp_path, left)
    error = angular_error(shown / np.linalg.norm(shown, axis=1, keepdims=True), truth)
    print(f"shown by Cycles: mean {error.mean():.2f}, 99 % below {np.percentile(error, 99):.2f} degrees")
    assert error.mean() < 1 and np.percentile(error, 99) < 4

    # Baked again with UVs in one tile: the same image, without the tiles whose files are still there.
    scaled_uvs(left, 0.5)
    bpy.ops.mps.bake(target="Left", tiles=True, size=64, output=str(tmp_path / "s.exr"))
    assert worn(left)[0] == image and [tile.number for tile in image.tiles] == [1001]
    assert tuple(image.size) == (64, 64)


def test_tiles_that_go_with_blender_are_packed(spheres, scene):
    scaled_uvs(spheres[0], 2)
    bpy.ops.mps.bake(target="Left", tiles=True, size=32)
    image, _ = worn(spheres[0])
    assert len(image.packed_files) == 4
    bpy.ops.mps.bake(target="Left", tiles=True, size=16)
    assert worn(spheres[0])[0] == image and tuple(image.size) == (16, 16) and len(image.packed_files) == 4


def test_by_object_each_wears_its_own(spheres, scene, tmp_path):
    spheres[1].data.uv_layers[0].name = "Other"
    bpy.ops.mps.bake(objects="SELECTED", split="OBJECT", size=64, space="OBJECT", output=str(tmp_path / "n.exr"))
    names = [Path(bpy.path.abspath(worn(obj)[0].filepath)).name for obj in spheres]
    assert names == ["n_Left.exr", "n_Right.exr"]
    assert [worn(obj)[1] for obj in spheres] == ["UVMap", "Other"]
    assert spheres[0].material_slots[0].material != spheres[1].material_slots[0].material
    for obj in spheres:
        shown, truth = shown_normals(scene, tmp_path, obj)
        assert angular_error(shown / np.linalg.norm(shown, axis=1, keepdims=True), truth).mean() < 2


@pytest.mark.parametrize("tiles", [False, True])
def test_another_blend_files_texture_is_told_from_ones_own(estimated, scene, tmp_path, monkeypatch, tiles):
    """Two files of one folder, each with a "Sphere"."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "table.blend"), copy=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "chair.blend"))
    bpy.ops.mps.bake(size=16, tiles=tiles)
    texture = Path(bpy.path.abspath(scene.mps.bake.image.filepath))
    refuse_other_projects([texture, tmp_path / "new.png"])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "chair_2.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "table.blend"))
    refuse_other_projects([texture])  # this session has written it
    monkeypatch.setattr("blender_addon.image_records._written", {})
    sentence = f"{texture} is there already, and no image of this file shows it: it may be that of chair.blend"
    with pytest.raises(InputError, match=re.escape(sentence)):
        refuse_other_projects([texture])
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "chair_2.blend"))
    refuse_other_projects([texture])


@pytest.mark.parametrize("split", ["ONE", "OBJECT", "MATERIAL"])
def test_names_that_become_one_in_a_file_do_not_cost_the_first_its_texture(spheres, scene, tmp_path, split):
    """Both share a material, so the second wears the first's texture when it is baked."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mine.blend"))
    left, right = spheres
    left.name, right.name = "Oak 1", "Oak_1"
    right.select_set(False)
    given = {"objects": "SELECTED", "split": split, "size": 16}
    bpy.ops.mps.bake(**given)
    (file,) = (path for path in tmp_path.glob("*.png") if "normal" in path.name)
    before = file.read_bytes()
    left.select_set(False)
    right.select_set(True)
    sentence = f'would overwrite {file}, which is for "Oak 1"; choose another file, or take it off "Oak 1" first'
    with pytest.raises(RuntimeError, match=re.escape(sentence)):
        bpy.ops.mps.bake(**given)
    assert file.read_bytes() == before
    if split == "ONE":  # another name of the same file, as "oak" is of "Oak" on some systems
        (tmp_path / "link.png").hardlink_to(file)
        with pytest.raises(RuntimeError, match='which is for "Oak 1"'):
            bpy.ops.mps.bake(output=str(tmp_path / "link.png"), **given)
    bpy.ops.mps.bake(output=str(tmp_path / "other.png"), **given)
    # Each goes over its own as often as one likes.
    for obj in (left, right):
        bpy.ops.object.select_all(action="DESELECT")
        obj.select_set(True)
        bpy.ops.mps.bake(output="" if obj == left else str(tmp_path / "other.png"), **given)
    assert worn(left)[0] != worn(right)[0]
    # What nothing wears any more is free.
    scene.collection.objects.unlink(left)
    bpy.ops.mps.bake(output="", **given)


def test_what_is_for_a_mesh_may_be_made_again_whichever_duplicates_wear_it_too(spheres, scene, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "mine.blend"))
    bpy.ops.mps.bake(target="Left", size=16)
    bpy.ops.mps.displace(target="Left", levels=0, method="MODIFIER")
    copies = []
    for linked in (False, True):
        bpy.ops.object.select_all(action="DESELECT")
        spheres[0].select_set(True)
        bpy.ops.object.duplicate(linked=linked)
        copies += bpy.context.selected_objects
    bpy.ops.mps.bake(target="Left", size=16)  # takes the heights off, which both copies wear still
    bpy.ops.mps.displace(target="Left", levels=0, method="MODIFIER")
    duplicate, twin = (obj.name for obj in copies)
    bpy.ops.mps.bake(target=twin, size=16, output=str(tmp_path / "Left_normal.png"))
    with pytest.raises(RuntimeError, match='which is for "Left'):
        bpy.ops.mps.bake(target=duplicate, size=16, output=str(tmp_path / "Left_normal.png"))


def test_no_object_loses_its_part_of_a_texture_that_several_share(spheres, scene, tmp_path):
    given = {"objects": "SELECTED", "size": 16, "output": str(tmp_path / "atlas.png")}
    bpy.ops.mps.bake(**given)
    spheres[1].select_set(False)
    with pytest.raises(RuntimeError, match='is for "Right" too; bake onto it as well, choose another file, or take it'):
        bpy.ops.mps.bake(**given)
    spheres[1].data.materials.clear()
    bpy.ops.mps.bake(**given)


def test_what_a_collection_brings_by_instances_keeps_its_texture(spheres, scene, tmp_path):
    bpy.ops.mps.bake(target="Left", size=16, output=str(tmp_path / "t.png"))
    asset, instance = bpy.data.collections.new("Asset"), bpy.data.objects.new("Instance", None)
    asset.objects.link(spheres[0])
    scene.collection.objects.unlink(spheres[0])
    instance.instance_type, instance.instance_collection = "COLLECTION", asset
    scene.collection.objects.link(instance)
    with pytest.raises(RuntimeError, match='is for "Left"; choose'):
        bpy.ops.mps.bake(target="Right", size=16, output=str(tmp_path / "t.png"))


def test_frames_go_beside_the_textures_of_others_but_not_over_them(spheres, scene, tmp_path):
    folder = tmp_path / "textures"
    folder.mkdir()
    bpy.ops.mps.bake(target="Right", size=16, output=f"{folder}/right.png")
    for number in (1, 2):
        shutil.copy(tmp_path / "normals.exr", tmp_path / f"n_{number:04d}.exr")
    frames = load_frames(tmp_path / "n_0001.exr", "Frames")
    remember(frames, "camera", (tmp_path / "c.json").read_text())
    estimate = scene.mps.estimate
    estimate.image, estimate.first_frame, estimate.last_frame = frames, 1, 2
    for _ in range(2):
        bpy.ops.mps.bake(target="Left", size=16, output=str(folder))
    assert {file.name for file in folder.iterdir()} == {"right.png", "textures_0001.png", "textures_0002.png"}
    with pytest.raises(RuntimeError, match=r'textures_0001\.png, which is for "Left"; choose another file'):
        bpy.ops.mps.bake(target="Right", size=16, output=str(folder))


def test_with_one_texture_for_all_they_share_their_material(spheres, tmp_path):
    for number, obj in enumerate(spheres):
        scaled_uvs(obj, 0.5)
        uvs = obj.data.uv_layers.active.uv
        for corner in uvs:
            corner.vector.x += 0.5 * number
    material, count = spheres[0].material_slots[0].material, len(bpy.data.materials)
    bpy.ops.mps.bake(objects="SELECTED", size=64, output=str(tmp_path / "atlas.png"))
    assert {obj.material_slots[0].material for obj in spheres} == {material} and len(bpy.data.materials) == count
    assert worn(spheres[0]) == worn(spheres[1])
    # A third object that is not baked keeps the material as it was, and the two share one copy.
    material.node_tree.nodes.remove(material.node_tree.nodes["MPS Texture"])
    bpy.ops.mesh.primitive_cube_add(location=(0, 5, 0))
    bpy.context.object.data.materials.append(material)
    for obj in bpy.data.objects:
        obj.select_set(obj in spheres)
    bpy.ops.mps.bake(objects="SELECTED", size=32, output=str(tmp_path / "atlas.png"))
    copies = {obj.material_slots[0].material for obj in spheres}
    assert len(copies) == 1 and copies != {material}
    assert "MPS Texture" not in material.node_tree.nodes


def test_by_material_over_objects_and_slots(spheres, tmp_path):
    """Half of the left sphere has another material, and the right one an empty slot beside the one they share."""
    shared, other = spheres[0].material_slots[0].material, matte()
    other.name = "Glaze/2"
    spheres[0].data.materials.append(other)
    for face in spheres[0].data.polygons:
        face.material_index = int(face.center.z > 0)
    spheres[1].data.materials.append(None)
    for face in spheres[1].data.polygons:
        face.material_index = int(face.center.z > 0)
    bpy.ops.mps.bake(objects="SELECTED", split="MATERIAL", size=64, output=str(tmp_path / "<MATERIAL>.png"))
    files = {
        (obj.name, slot): Path(bpy.path.abspath(worn(obj, slot)[0].filepath)).name for obj in spheres for slot in (0, 1)
    }
    assert files == {
        ("Left", 0): "Matte.png",
        ("Left", 1): "Glaze_2.png",
        ("Right", 0): "Matte.png",
        ("Right", 1): "MPS_Right.png",
    }
    assert spheres[0].material_slots[0].material == spheres[1].material_slots[0].material == shared


def test_what_cannot_be_baked_in_one_go_is_refused(spheres, scene, tmp_path):
    output = str(tmp_path / "t.png")
    twin = bpy.data.objects.new("Twin", spheres[0].data)
    scene.collection.objects.link(twin)
    twin.select_set(True)
    with pytest.raises(RuntimeError, match='"Left" and "Twin" share one mesh'):
        bpy.ops.mps.bake(objects="SELECTED", split="OBJECT", output=output)
    bpy.data.objects.remove(twin)
    with pytest.raises(RuntimeError, match="stands for nothing; use <UDIM>"):
        bpy.ops.mps.bake(objects="SELECTED", split="ONE", output=str(tmp_path / "t.<TILE>.png"))
    for obj in spheres:
        obj.select_set(False)
    with pytest.raises(RuntimeError, match="no mesh object is selected to bake onto"):
        bpy.ops.mps.bake(objects="SELECTED", output=output)
    scene.mps.estimate.image.source = "SEQUENCE"
    with pytest.raises(RuntimeError, match="a sequence is baked onto the target alone and into one texture per frame"):
        bpy.ops.mps.bake(objects="ACTIVE", tiles=True, output=str(tmp_path))
