"""The photo that Blender renders: what is in it, and that nothing else changes."""

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest

from blender_addon.image_records import origin
from blender_addon.panels.photo import note_of_step
from blender_addon.photo.studio import render_normals
from blender_addon.rig.rig import light_rig
from blender_addon.scene.camera import scene_camera
from blender_addon.settings.record import notes_of
from mpsnet_core import read_image, write_image

from .rendering import matte, pixels, shader_of


def channels(path):
    """{channel name: (H, W)} over all parts of an EXR."""
    found, part = {}, oiio.ImageInput.open(str(path))
    index = 0
    while part.seek_subimage(index, 0):
        spec = part.spec()
        data = part.read_image(index, 0, 0, spec.nchannels, oiio.FLOAT)
        found |= {name: data[..., number] for number, name in enumerate(spec.channelnames)}
        index += 1
    return found


def sphere_normals(scene, width, height):
    """(H, W, 3) camera-space normals and (H, W) mask of a unit sphere at the origin before an orthographic camera."""
    camera = scene_camera(scene.mps.rig.camera, scene, (width, height))
    x = (np.arange(width) + 0.5 - camera.centre[0]) / camera.focal[0]
    y = (camera.centre[1] - np.arange(height) - 0.5) / camera.focal[1]
    x, y = np.meshgrid(x, y)
    return np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], -1), x**2 + y**2 < 0.9


def settings_of(data):
    """Every plain setting of a piece of Blender's data, and of what belongs to it."""
    found = {}
    for setting in data.bl_rna.properties:
        if setting.identifier in {"rna_type", "mps"}:
            continue
        value = getattr(data, setting.identifier)
        if setting.type in {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}:
            plain = isinstance(value, (bool, int, float, str, set))
            found[setting.identifier] = value if plain else repr(tuple(np.ravel(np.array(value, dtype=object))))
    return found


def everything(scene):
    parts = [scene, scene.render, scene.cycles, scene.view_settings, scene.display_settings, scene.eevee]
    parts += [scene.render.image_settings, scene.view_layers[0], scene.view_layers[0].cycles]
    parts += [obj for obj in scene.objects] + [obj.data for obj in scene.objects if obj.data]
    kinds = [name for name in dir(bpy.data) if isinstance(getattr(bpy.data, name), bpy.types.bpy_prop_collection)]
    names = {kind: sorted(getattr(bpy.data, kind).keys()) for kind in kinds if kind not in {"images", "all_ids"}}
    return [settings_of(part) for part in parts], names, bpy.context.scene.name, [o.name for o in scene.objects]


def test_a_matte_sphere_shines_as_the_cosine_of_each_light(photographed, scene, tmp_path):
    photo = pixels(tmp_path / "photo.exr")
    assert photo.shape == (96, 96, 4)
    normals, mask = sphere_normals(scene, 96, 96)
    expected = 0.8 * np.clip(normals @ light_rig(scene).directions.T, 0, None)
    assert np.abs(photo[..., :3] - expected)[mask].mean() < 0.015
    assert (photo[mask][:, 3] == 1).all()
    assert np.allclose(photo[0, 0], 0, atol=1e-4) and photo[0, 0, 3] == 0


@pytest.mark.parametrize("strength", [0.5, 2.0])
def test_sun_and_area_lights_are_as_bright_as_was_asked(sphere, scene, tmp_path, strength):
    for light_type in ("SUN", "AREA"):
        bpy.ops.mps.add_rig(light_type=light_type, slant=20, strength=strength, distance=200, light_size=0.5)
        bpy.ops.mps.render_photo(width=32, height=32, samples=256, output=str(tmp_path / "photo.exr"))
        facing = pixels(tmp_path / "photo.exr")[14:18, 14:18, :3].mean()
        assert facing == pytest.approx(strength * 0.8 * np.cos(np.radians(20)), rel=0.04), light_type


def test_only_the_rig_lights_the_photo(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    bpy.ops.mps.render_photo(width=32, height=32, samples=16, output=str(tmp_path / "alone.exr"))
    scene.world = bpy.data.worlds.new("Bright")
    scene.world.color = (1, 1, 1)
    bpy.ops.object.light_add(type="SUN")
    bpy.context.object.data.energy = 50
    bpy.ops.mps.render_photo(output=str(tmp_path / "among.exr"))
    assert np.allclose(pixels(tmp_path / "alone.exr"), pixels(tmp_path / "among.exr"), atol=1e-5)


def test_what_the_scenes_render_hides_is_not_in_the_photo(sphere, scene, tmp_path):
    """With a cube far beside it that is left in the photo's corner."""
    bpy.ops.mps.add_rig()
    bpy.ops.mesh.primitive_cube_add(size=0.4, location=(-1, 0, 1))
    sphere.hide_render = True
    bpy.ops.mps.render_photo(width=16, height=16, samples=1, output=str(tmp_path / "photo.exr"))
    photo = pixels(tmp_path / "photo.exr")
    assert photo[:5, :5].any() and not photo[6:, 6:].any()


def test_the_bakes_target_is_left_out_where_something_else_is_in_its_place(sphere, scene, tmp_path):
    """A cube around the sphere that hides it, and a floor; the sphere of two halves; a cube that has no other."""
    bpy.ops.mps.add_rig()
    given = {"width": 32, "height": 32, "samples": 1}
    bpy.ops.mesh.primitive_plane_add(size=20, location=(0, 0, -1.1))

    def shot(name, verb="render_photo", **more):
        more |= given if verb == "render_photo" else {}
        getattr(bpy.ops.mps, verb)(**more, output=str(tmp_path / f"{name}.exr"))
        return notes_of(scene, verb)

    assert shot("alone") == []
    alone = pixels(tmp_path / "alone.exr")
    bpy.ops.mesh.primitive_cube_add(size=2.1)
    low = bpy.context.object
    both = '"Sphere" and "Cube" are in one place and both in the photo; choose the one that is baked onto as Target of'
    assert shot("both")[0].startswith(both) and not np.allclose(pixels(tmp_path / "both.exr"), alone, atol=1e-3)

    left_out = '"Cube" is left out of the photo: it is the target of the bake, and "Sphere" is in its place'
    assert shot("truth", "render_truth", target=low.name) == [left_out]
    before = everything(scene)
    assert shot("without") == [left_out]
    np.testing.assert_allclose(pixels(tmp_path / "without.exr"), alone, atol=1e-5)
    assert everything(scene) == before

    # What the photo is of, baked onto itself, with the floor or something small beside it.
    scene.mps.bake.target = sphere
    bpy.data.objects.remove(low)
    bpy.ops.mesh.primitive_cube_add(size=0.2, location=(0.5, 0, 0.2))
    assert shot("itself") == []
    assert pixels(tmp_path / "itself.exr")[16, 16, 3] == 1

    bpy.data.objects.remove(bpy.context.object)
    for side in (-1, 1):  # two parts that make one object
        bpy.ops.mesh.primitive_cube_add(location=(side / 2, 0, 0))
        bpy.context.object.scale = (0.5, 1, 1)
        bpy.context.object.name = f"Half {side}"
    assert shot("parts") == [
        '"Sphere" is left out of the photo: it is the target of the bake, and "Half -1" and 1 more are in its place'
    ]


def test_a_photo_that_would_show_nothing_is_refused_and_the_one_before_it_stays(sphere, scene, tmp_path):
    """The object is hidden from renders, or the camera looks past it; in an animation, in all frames."""
    bpy.ops.mps.add_rig()
    given = {"width": 16, "height": 16, "samples": 1, "output": str(tmp_path / "photo.exr")}
    bpy.ops.mps.render_photo(**given)
    before = (tmp_path / "photo.exr").read_bytes()
    sentence = "the photo is completely transparent; make the object visible in renders"
    sphere.hide_render = True
    with pytest.raises(RuntimeError, match=sentence):
        bpy.ops.mps.render_photo(**given)
    sphere.hide_render = False
    sphere.location.x = 30
    with pytest.raises(RuntimeError, match=sentence):
        bpy.ops.mps.render_photo(**given)
    assert (tmp_path / "photo.exr").read_bytes() == before

    sphere.keyframe_insert("location", frame=2)
    sphere.location.x = 0
    sphere.keyframe_insert("location", frame=1)
    scene.frame_end = 3
    bpy.ops.mps.render_photo(**{**given, "output": str(tmp_path / "shots"), "animation": True})
    assert [file.name for file in (tmp_path / "shots").glob("*.exr")] == ["shots_0001.exr"]
    assert "2 frame(s) show nothing and are left out, the first is 2" in notes_of(scene, "render_photo")
    scene.frame_start = 2
    with pytest.raises(RuntimeError, match=f"no frame shows the object; {sentence}"):
        bpy.ops.mps.render_photo(animation=True, output=str(tmp_path / "shots"))


def test_a_photo_appears_with_its_rig_and_camera_or_not_at_all(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    (tmp_path / "photo.camera.json").mkdir()
    with pytest.raises(RuntimeError, match="it is a folder"):
        bpy.ops.mps.render_photo(width=16, height=16, samples=1, output=str(tmp_path / "photo.exr"))
    assert [file.name for file in tmp_path.iterdir()] == ["photo.camera.json"]


def test_rendering_leaves_no_trace(sphere, scene, tmp_path):
    scene.render.engine = "BLENDER_WORKBENCH"
    scene.render.resolution_x, scene.render.filepath = 123, "//mine.png"
    bpy.ops.mps.add_rig()
    scene.mps.photo.width = scene.mps.photo.height = 16
    before = everything(scene)
    bpy.ops.mps.render_photo(samples=1, output=str(tmp_path / "photo.exr"))
    bpy.ops.mps.render_truth(output=str(tmp_path / "truth.exr"))
    with pytest.raises(RuntimeError):
        bpy.ops.mps.render_photo(output=str(tmp_path / "missing" / "photo.exr"))
    with pytest.raises(RuntimeError):
        bpy.ops.mps.render_photo(output=str(tmp_path / "photo.png"))
    assert everything(scene) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "photo.camera.json",
        "photo.exr",
        "photo.rig.json",
        "truth.camera.json",
        "truth.exr",
    ]


def test_true_normals_are_the_spheres_own(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig(view="LEFT")
    scene.mps.photo.width, scene.mps.photo.height = 64, 48
    render_normals(scene, tmp_path / "truth.exr")
    found = channels(tmp_path / "truth.exr")
    world = np.stack([found[f"ViewLayer.Normal.{axis}"] for axis in "XYZ"], -1)
    normals, mask = sphere_normals(scene, 64, 48)
    ours = world @ scene_camera(scene.mps.rig.camera, scene).rotation
    ours /= np.maximum(np.linalg.norm(ours, axis=-1, keepdims=True), 1e-9)
    assert np.degrees(np.arccos(np.clip((ours * normals).sum(-1), -1, 1)))[mask].mean() < 1
    assert found["ViewLayer.Combined.A"][mask].min() == 1


@pytest.mark.parametrize(("orientation", "where"), [(3, (7, 9)), (6, (0, 7)), (8, (9, 0))])
def test_a_photo_of_a_camera_that_was_turned_is_shown_as_it_is_read(scene, tmp_path, orientation, where):
    """EXIF's own table: the first row is below at 3, right at 6, left at 8; the first column right, above, below."""
    path, values = tmp_path / "turned.tif", np.zeros((8, 10, 3), np.float32)
    values[0, 0] = 1
    spec = oiio.ImageSpec(10, 8, 3, oiio.UINT8)
    spec.attribute("Orientation", orientation)
    buffer = oiio.ImageBuf(spec)
    buffer.set_pixels(oiio.ROI(), values)
    assert buffer.write(str(path))
    bpy.ops.mps.open_photo(filepath=str(path))
    image = scene.mps.photo.image
    width, height = image.size
    assert (width, height) == ((10, 8) if orientation == 3 else (8, 10))
    shown = np.reshape(image.pixels, (height, width, 4))[::-1, :, 0]  # Blender's first row is below
    row, column = np.unravel_index(shown.argmax(), shown.shape)
    assert (row, column) == where
    np.testing.assert_allclose(shown, read_image(path).pixels[..., 0], atol=1e-3)
    assert origin(image) == path


def small_photo(tmp_path):
    bpy.ops.mps.render_photo(width=16, height=16, samples=1, output=str(tmp_path / "photo.exr"))


def glowing():
    material = matte()
    material.name = "Lamp"
    emission(material, "Strength").default_value = 1
    return material


def emission(material, name):
    return shader_of(material.node_tree).inputs[f"Emission {name}"]


def test_a_glowing_material_is_refused(sphere, tmp_path):
    bpy.ops.mps.add_rig()
    sphere.material_slots[0].material = material = glowing()
    refused = pytest.raises(RuntimeError, match=r'material "Lamp" of "Sphere" glows.*set its emission to 0')
    with refused:
        small_photo(tmp_path)
    sphere.hide_viewport = True  # the render shows it nonetheless
    with refused:
        small_photo(tmp_path)
    # Black emission at strength 1 is what materials of Blender 3 have.
    emission(material, "Color").default_value = (0, 0, 0, 1)
    small_photo(tmp_path)
    source = material.node_tree.nodes.new("ShaderNodeRGB")
    material.node_tree.links.new(source.outputs[0], emission(material, "Color"))
    with refused:
        small_photo(tmp_path)


def collection_instance(*objects):
    """An empty that shows a collection which is in the file only for its instances."""
    collection = bpy.data.collections.new("Kept Apart")
    for obj in objects:
        collection.objects.link(obj)
    instance = bpy.data.objects.new("Instance", None)
    instance.instance_type, instance.instance_collection = "COLLECTION", collection
    bpy.context.scene.collection.objects.link(instance)


def test_a_light_within_a_collection_instance_is_refused(sphere, tmp_path):
    bpy.ops.mps.add_rig()
    light = bpy.data.objects.new("Spare", bpy.data.lights.new("Spare", "POINT"))
    collection_instance(light)
    with pytest.raises(RuntimeError, match=r'"Instance" holds the light "Spare".*hide it from renders'):
        small_photo(tmp_path)
    light.hide_render = True
    small_photo(tmp_path)


def test_a_glowing_material_that_geometry_nodes_set_is_refused(sphere, tmp_path):
    bpy.ops.mps.add_rig()
    tree = bpy.data.node_groups.new("Glow", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "GeometryNodeSetMaterial", "NodeGroupOutput")
    start, setting, end = (tree.nodes.new(kind) for kind in kinds)
    setting.inputs["Material"].default_value = glowing()
    tree.links.new(start.outputs[0], setting.inputs["Geometry"])
    tree.links.new(setting.outputs[0], end.inputs[0])
    sphere.modifiers.new("Glow", "NODES").node_group = tree
    with pytest.raises(RuntimeError, match=r'material "Lamp" of "Sphere" glows'):
        small_photo(tmp_path)


def test_an_animation_gives_a_photo_and_normals_of_each_frame(sphere, scene, tmp_path):
    """A ball that grows by a tenth each frame, from frame 3 on."""
    bpy.ops.mps.add_rig(margin=0.5)
    for number in range(3, 6):
        sphere.scale = [1 + (number - 3) / 10] * 3
        sphere.keyframe_insert("scale", frame=number)
    scene.frame_start, scene.frame_end, scene.frame_step = 3, 5, 2
    scene.frame_set(4, subframe=0.25)
    assert note_of_step(scene) == ""
    photo = {"width": 64, "height": 64, "samples": 1}
    with pytest.raises(RuntimeError, match="no folder is named for the frames"):
        bpy.ops.mps.render_photo(animation=True, **photo)  # the file is not saved, and frames cannot be packed
    for name in ("shot.exr", "shot.JPG"):
        with pytest.raises(RuntimeError, match=f"{name} is a picture's name, and frames go into a folder"):
            bpy.ops.mps.render_photo(animation=True, output=str(tmp_path / name), **photo)
    bpy.ops.mps.render_photo(animation=True, output=str(tmp_path / "shots"), **photo)
    files = sorted((tmp_path / "shots").glob("*.exr"))
    assert [file.name for file in files] == [f"shots_{number:04d}.exr" for number in range(3, 6)]
    areas = [(read_image(file).alpha > 0.5).sum() for file in files]
    np.testing.assert_allclose(np.sqrt(np.array(areas) / areas[0]), [1, 1.1, 1.2], rtol=0.02)
    assert note_of_step(scene).startswith("All frames are rendered")
    scene.frame_step = 1
    assert note_of_step(scene) == ""
    assert (scene.frame_current, scene.frame_subframe) == (4, 0.25)
    assert scene.mps.photo.image.source == "SEQUENCE"

    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals"))
    assert (scene.mps.estimate.first_frame, scene.mps.estimate.last_frame) == (3, 5)
    assert len(list((tmp_path / "normals").glob("*.png"))) == 3


def test_files_that_are_gone_are_reported_with_the_photo(sphere, scene, tmp_path):
    """A picture that is on the sphere; not one that nothing in the photo uses, and not one that is packed."""
    bpy.ops.mps.add_rig()
    for name in ("gone.png", "elsewhere.png", "packed.png"):
        write_image(tmp_path / name, np.zeros((4, 4, 3), np.float32))
        image = bpy.data.images.load(str(tmp_path / name))
        image.use_fake_user = True
        if name == "packed.png":
            image.pack()
        if name != "elsewhere.png":
            sphere.active_material.node_tree.nodes.new("ShaderNodeTexImage").image = image
        (tmp_path / name).unlink()
    bpy.ops.mps.render_photo(width=16, height=16, samples=1, output=str(tmp_path / "photo.exr"))
    (told,) = notes_of(scene, "render_photo")
    assert told == "not found, and what they bring may be missing from the render: gone.png"
    write_image(tmp_path / "gone.png", np.zeros((4, 4, 3), np.float32))
    bpy.ops.mps.render_photo(output=str(tmp_path / "photo.exr"))
    assert not notes_of(scene, "render_photo")


def test_the_white_photo_is_what_the_photo_would_be_under_white_lights(sphere, scene, tmp_path):
    """By a matt grey sphere, on which the light of each of the photo's channels is what a white lamp gives to all."""
    bpy.ops.mps.add_rig()
    names = {kind: set(getattr(bpy.data, kind).keys()) for kind in ("objects", "lights")}
    bpy.ops.mps.render_photo(width=48, height=48, samples=64, white=True, output=str(tmp_path / "photo.exr"))
    assert {kind: set(getattr(bpy.data, kind).keys()) for kind in names} == names
    assert scene.mps.estimate.white == str(tmp_path / "photo_white.exr") and scene.mps.estimate.albedo
    photo, white = (pixels(tmp_path / name) for name in ("photo.exr", "photo_white.exr"))
    inside = white[..., 3] > 0.99
    np.testing.assert_allclose(white[inside][:, :3].mean(axis=0), photo[inside][:, :3].sum(axis=1).mean(), rtol=0.02)
    bpy.ops.mps.render_photo(white=False, output=str(tmp_path / "photo.exr"))
    assert not scene.mps.estimate.white
