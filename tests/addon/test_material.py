"""A flat material in Blender: its nodes, colour spaces, true size, and whether it renders as it should."""

import math
from pathlib import Path

import bpy
import numpy as np
import pytest
from flat_weave import Weave

from blender_addon.photo.studio import _studio
from blender_addon.scene.surfaces import box_of
from blender_addon.settings.record import notes_of
from mpsnet_core import published_rig, read_image, write_image, write_rig
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.io.image_reading import read_channel
from mpsnet_core.scene.normal_encoding import read_vectors

from .rendering import rendered

WEAVE = Weave(shape=(150, 180), period=31.0, amplitude_mm=0.4, pixel_mm=0.3)


@pytest.fixture
def opened(scene, tmp_path):
    """The photo of a weave, 54 mm wide, is open, every other thread of another colour."""
    albedo = np.where((np.indices(WEAVE.shape)[1] // 31 % 2 == 0)[..., None], (0.7, 0.5, 0.3), (0.5, 0.4, 0.3))
    write_image(tmp_path / "weave.exr", WEAVE.capture(albedo).image)
    write_rig(tmp_path / "weave.rig.json", published_rig())
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "weave.exr"))
    return tmp_path


def plane_size(plane):
    return np.ptp([tuple(vertex.co) for vertex in plane.data.vertices], axis=0)[:2]


def test_the_plane_has_the_tiles_size_and_the_pictures_their_colour_spaces(opened, scene):
    bpy.ops.mps.make_material(width=0.054, output=str(opened / "out"))
    plane = scene.mps.material.plane
    height = read_channel(opened / "out" / "weave_height_mm.exr")
    # A tile of the weave is a whole number of its periods, 9.3 mm each, here in metres.
    tiles = plane_size(plane) / 0.0093
    assert np.abs(tiles - np.round(tiles)).max() < 0.05 and tiles.min() > 2
    assert np.allclose(plane_size(plane) / height.shape[::-1], 0.0003, rtol=0.01)
    uvs = np.array([tuple(corner.vector) for corner in plane.data.uv_layers["UVMap"].uv])
    assert uvs.min() == 0 and uvs.max() == 1
    (material,) = plane.data.materials
    nodes = material.node_tree.nodes
    assert nodes["MPS Flat Albedo"].image.colorspace_settings.name == "sRGB"
    for name in ("MPS Flat Normal", "MPS Flat Height"):
        assert nodes[name].image.colorspace_settings.is_data
    assert nodes["MPS Flat Normal"].extension == "REPEAT"
    assert Path(nodes["MPS Flat Height"].image.filepath).name == "weave_height.png"
    displacement = nodes["MPS Flat Displacement"].inputs
    # Value 0 to 1 is what the height's picture spans, and its mean height, 0, stays where it is.
    assert displacement["Scale"].default_value == pytest.approx(np.ptp(height) / 1000, rel=1e-3)
    assert displacement["Midlevel"].default_value == pytest.approx(-height.min() / np.ptp(height), abs=1e-3)
    assert scene.mps.material.image is not None and "mm deep" in scene.mps.material.summary


def shown_by(material):
    return {Path(node.image.filepath).parent.name for node in material.node_tree.nodes if node.type == "TEX_IMAGE"}


def test_another_photo_gets_a_material_and_a_plane_of_its_own(opened, scene):
    bpy.ops.mps.make_material(width=0.054, output=str(opened / "denim"))
    first = scene.mps.material.plane
    (denim,) = first.data.materials
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    cube.data.materials.append(denim)
    bpy.ops.mps.make_material(width=0.054, output=str(opened / "leather"))
    second = scene.mps.material.plane
    assert second != first and shown_by(second.data.materials[0]) == {"leather"}
    assert shown_by(denim) == {"denim"} and list(first.data.materials) == list(cube.data.materials) == [denim]
    # Neither lies in the other.
    assert abs(second.location.x - first.location.x) > (plane_size(first) + plane_size(second))[0] / 2
    # Made again it is the same material, whoever wears it, and no other object is made a plane.
    bpy.data.objects.remove(first)
    bpy.ops.mps.make_material(width=0.054, relief="DISPLACEMENT", output=str(opened / "denim"))
    assert list(scene.mps.material.plane.data.materials) == [denim] and denim.displacement_method == "BOTH"
    assert len(cube.data.vertices) == 8 and len(second.data.materials) == 1


def test_what_the_artist_put_there_stays(opened, scene):
    """In the material's nodes, and in the plane's slot: a material of one's own, or none."""
    bpy.ops.mps.make_material(width=0.054, output=str(opened / "out"))
    plane = scene.mps.material.plane
    (made,) = plane.data.materials
    nodes, links = made.node_tree.nodes, made.node_tree.links
    nodes.new("ShaderNodeTexBrick").name = "Mine"
    surface, mix = made.node_tree.get_output_node("ALL").inputs["Surface"], nodes.new("ShaderNodeMixShader")
    links.new(surface.links[0].from_socket, mix.inputs[1])
    links.new(mix.outputs[0], surface)
    bpy.ops.mps.make_material(width=0.054, output=str(opened / "out"))
    assert "Mine" in made.node_tree.nodes and scene.mps.material.plane == plane
    assert surface.links[0].from_node == mix
    count = len(made.node_tree.nodes)
    own = bpy.data.materials.new("Own")
    if bpy.app.version < (5, 0):
        own.use_nodes = True
    before = len(own.node_tree.nodes)
    for other in (own, None):
        plane.data.materials[0] = other
        bpy.ops.mps.make_material(width=0.054, output=str(opened / "out"))
        assert plane.data.materials[0] == other and scene.mps.material.plane != plane
        assert list(scene.mps.material.plane.data.materials) == [made]
    assert len(own.node_tree.nodes) == before and len(made.node_tree.nodes) == count


def test_the_relief_is_shown_once(opened, scene):
    """Normal map and displacement together would show it twice."""
    for relief, method, normal, displaced in (("NORMAL", "BUMP", 1, 0), ("DISPLACEMENT", "BOTH", 0, 1)):
        bpy.ops.mps.make_material(width=0.054, relief=relief, output=str(opened / "out"))
        (material,) = scene.mps.material.plane.data.materials
        nodes = material.node_tree.nodes
        assert material.displacement_method == method
        assert len(nodes["Principled BSDF"].inputs["Normal"].links) == normal
        assert len(nodes["Material Output"].inputs["Displacement"].links) == displaced
        assert len(scene.mps.material.plane.modifiers) == displaced


def render(scene, path, plane, light):
    """A picture of the plane from above, 96 pixels wide, under a white sun."""
    across, down = plane_size(plane)
    camera = bpy.data.objects.new("Above", bpy.data.cameras.new("Above"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", max(across, down)
    camera.location = (0, 0, 1)
    camera.data.clip_start = 0.01
    lamp = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    lamp.data.energy, lamp.data.angle = math.pi, 0
    lamp.rotation_euler = light
    for thing in (camera, lamp):
        scene.collection.objects.link(thing)
    scene.camera = camera
    scene.world = None
    return rendered(path, 96, round(96 * down / across), samples=16)[..., :3]


@pytest.mark.parametrize("relief", ["NORMAL", "DISPLACEMENT"])
def test_it_renders_as_its_pictures_say(opened, scene, relief):
    """By the matt part of Blender's shader, from one side and from above: relief and colour stand the right way."""
    bpy.ops.mps.make_material(width=0.054, relief=relief, output=str(opened / "out"))
    plane = scene.mps.material.plane
    shader = plane.data.materials[0].node_tree.nodes["Principled BSDF"]
    shader.inputs["Specular IOR Level"].default_value = 0
    slant, tilt = math.radians(35), math.radians(200)
    shown = render(scene, opened / "shown.exr", plane, (0, slant, tilt))
    normals = normalised(read_vectors(opened / "out" / "weave_normal.png")[0])
    albedo = read_image(opened / "out" / "weave_albedo.png").pixels
    light = np.array([math.sin(slant) * math.cos(tilt), math.sin(slant) * math.sin(tilt), math.cos(slant)])
    expected = np.maximum(normals @ light, 0)[..., None] * albedo
    rows, columns = (
        ((np.arange(side) + 0.5) / side * whole).astype(int)
        for side, whole in zip(shown.shape[:2], expected.shape[:2], strict=True)
    )
    expected = expected[np.ix_(rows, columns)]
    inner = (slice(4, -4), slice(4, -4))
    assert np.corrcoef(shown[inner].ravel(), expected[inner].ravel())[0, 1] > 0.93
    assert shown[inner].mean() == pytest.approx(expected[inner].mean(), rel=0.1)
    assert shown[inner].std() == pytest.approx(expected[inner].std(), rel=0.15)


def test_the_width_of_a_rendered_photo_is_known(scene, tmp_path):
    """An orthographic camera says what its picture's width measures."""
    bpy.ops.mesh.primitive_plane_add(size=4)
    bpy.ops.mps.add_rig(view="TOP", projection="ORTHOGRAPHIC")
    bpy.ops.mps.render_photo(width=128, height=128, samples=4, output=str(tmp_path / "photo.exr"))
    seen = scene.mps.rig.camera.data.ortho_scale
    margin = math.ceil(128 * (seen - 4) / 2 / seen) + 1
    sides = {f"crop_{side}": margin for side in ("left", "right", "top", "bottom")}
    bpy.ops.mps.make_material(output=str(tmp_path / "out"), **sides)
    assert any(note.startswith("no width is given") for note in notes_of(scene, "make_material"))
    tile = math.floor((128 - 2 * margin) / 1.2) / 128 * seen
    assert np.allclose(plane_size(scene.mps.material.plane), tile, rtol=1e-3)


def test_what_is_missing_is_reported(opened, scene):
    with pytest.raises(RuntimeError, match="the material's size is not known; enter what the photo's width"):
        bpy.ops.mps.make_material()
    with pytest.raises(RuntimeError, match="the crop leaves nothing of the photo's 180 x 150 pixels"):
        bpy.ops.mps.make_material(width=0.054, crop_left=100, crop_right=100)
    scene.mps.material.crop_left = scene.mps.material.crop_right = 0
    (opened / "file").write_text("")
    with pytest.raises(RuntimeError, match="is a file; name a folder for the material"):
        bpy.ops.mps.make_material(width=0.054, output=str(opened / "file"))
    assert scene.mps.material.plane is None


def test_its_plane_lies_beside_the_photos_object_and_is_in_no_photo(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    bpy.ops.mps.render_photo(width=64, height=64, samples=4, output=str(tmp_path / "photo.exr"))
    write_image(tmp_path / "weave.exr", WEAVE.capture(np.full((*WEAVE.shape, 3), 0.5)).image)
    write_rig(tmp_path / "weave.rig.json", published_rig())
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "weave.exr"))
    bpy.ops.mps.make_material(width=0.054, output=str(tmp_path / "out"))
    bpy.context.view_layer.update()
    plane = scene.mps.material.plane
    assert box_of(plane)[0, 0] > box_of(sphere)[1, 0]
    with _studio(scene) as studio:
        assert sphere.name in studio.objects and plane.name not in studio.objects
