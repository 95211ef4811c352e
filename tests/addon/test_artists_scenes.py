"""What artists' own scenes hold: images of theirs, copies of scenes, deleted targets, unlike lights, odd materials."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon.images import image_file, load_photo
from blender_addon.rig.rig import light_rig
from blender_addon.scene.mesh_file import begin_mesh
from blender_addon.settings.record import notes_of
from mpsnet_core import read_mesh, read_rig
from mpsnet_core.io.image_reading import read_channel

from .rendering import matte, pixels, save_png, shader_of
from .test_steps import Kind, MPS_PT_bake, stands

SMALL = {"width": 24, "height": 24, "samples": 1}


def painted(path: Path, value: float) -> "bpy.types.Image":
    """An image that an artist has loaded from a PNG file of one grey."""
    image = bpy.data.images.load(str(save_png(path, np.full((24, 24, 3), value))))
    image.use_fake_user = True
    return image


def brighten(image: "bpy.types.Image") -> None:
    image.pixels.foreach_set(np.ones(24 * 24 * 4, np.float32))
    image.update()


# --- images -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("verb", "name"), [("bake", "Sphere_normal.png"), ("displace", "Sphere_height.png")])
def test_an_artists_image_is_not_written_over(estimated, scene, tmp_path, verb, name):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "project.blend"))
    if verb == "displace":
        bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
        scene.mps.bake.output, scene.mps.displace.file_format = "", "PNG"
    image = painted(tmp_path / name, 0.5)
    before = (tmp_path / name).read_bytes()
    with pytest.raises(RuntimeError, match=f'would overwrite .*{name}, the image "{image.name}"; choose another'):
        getattr(bpy.ops.mps, verb)()
    assert (tmp_path / name).read_bytes() == before and image.name == name


def test_an_artists_image_is_known_by_the_file_that_it_is_of(estimated, scene, tmp_path):
    """Not by how its path is written: through a link to its folder, or relative to the library that it comes from."""
    (tmp_path / "library").mkdir()
    image = painted(tmp_path / "library" / "Sphere_normal.png", 0.5)
    image.filepath = "//Sphere_normal.png"
    bpy.data.libraries.write(str(tmp_path / "library" / "library.blend"), {image})
    bpy.data.images.remove(image)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "project.blend"))
    with bpy.data.libraries.load(str(tmp_path / "library" / "library.blend"), link=True) as (_, wanted):
        wanted.images = ["Sphere_normal.png"]
    estimated["uses"] = wanted.images[0]
    bpy.ops.mps.bake(size=16)
    assert (tmp_path / "Sphere_normal.png").is_file()
    (tmp_path / "link").symlink_to(tmp_path / "library")
    with pytest.raises(RuntimeError, match=r'would overwrite .*, the image "Sphere_normal.png"; choose another'):
        bpy.ops.mps.bake(output=f"{tmp_path}/link/")


def test_an_artists_image_stays_as_it_is_when_its_file_is_opened_as_the_photo(scene, tmp_path):
    for number, change in enumerate((brighten, lambda image: (brighten(image), image.pack()))):
        image = painted(tmp_path / f"{number}.png", 0.5)
        change(image)
        bpy.ops.mps.open_photo(filepath=str(tmp_path / f"{number}.png"))
        assert scene.mps.photo.image != image and image.pixels[0] == 1
    sequence = painted(tmp_path / "frame_0001.png", 0.5)
    sequence.source = "SEQUENCE"
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "frame_0001.png"))
    assert sequence.source == "SEQUENCE" and scene.mps.photo.image.source == "FILE"
    opened = scene.mps.photo.image
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "frame_0001.png"))
    assert scene.mps.photo.image == opened  # once is enough


def test_what_was_painted_on_a_photo_counts_once_it_is_packed_and_is_asked_for_before(scene, tmp_path):
    painted(tmp_path / "photo.png", 0.5)
    photo = load_photo(tmp_path / "photo.png", "photo")
    brighten(photo)
    with pytest.raises(Exception, match='the photo "photo" has changes that are not in its file; save it first'):
        image_file(photo, "photo", "open one")
    photo.pack()
    assert read_channel(image_file(photo, "photo", "open one")).min() == 1
    assert read_channel(tmp_path / "photo.png").max() < 0.6


def test_a_painted_mask_is_of_its_photo_alone(scene, tmp_path):
    for name in ("a.png", "b.png"):
        painted(tmp_path / name, 0.5)
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "a.png"))
    scene.mps.estimate.mask = "NONE"
    bpy.ops.mps.paint_mask()
    assert scene.mps.estimate.mask == "PAINTED" and scene.mps.estimate.painted_mask
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "b.png"))
    assert scene.mps.estimate.mask != "PAINTED" and scene.mps.estimate.painted_mask is None


# --- scenes and what is deleted ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["EMPTY", "LINK_COPY"])  # Scene > New > Copy Settings, Linked Copy
def test_a_rig_in_a_copy_of_the_scene_leaves_the_first_ones_alone(sphere, scene, kind):
    bpy.ops.mps.add_rig()
    before = list(scene.objects)
    bpy.ops.scene.new(type=kind)
    copy = bpy.context.scene
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.mps.add_rig(slant=40)
    assert [obj for obj in scene.objects if obj in before] == before
    assert copy.mps.rig.target not in before and copy.mps.rig.target in set(copy.objects)
    np.testing.assert_allclose(light_rig(copy).slants, 40, atol=1e-3)
    assert sum(obj.type == "LIGHT" for obj in copy.objects) == 3
    np.testing.assert_allclose(light_rig(scene).slants, 30, atol=1e-3)


@pytest.mark.parametrize("verb", ["add_rig", "relight", "show_coverage"])
def test_a_scene_of_another_file_cannot_take_objects(estimated, scene, tmp_path, verb):
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "shot.blend"), link=True) as (_, wanted):
        wanted.scenes = ["Scene"]
    (linked,) = wanted.scenes
    bpy.context.window.scene = linked
    before = set(linked.objects)
    with pytest.raises(RuntimeError, match=r'the scene "Scene" is linked from .*shot\.blend; make it local first'):
        getattr(bpy.ops.mps, verb)()
    assert set(linked.objects) == before == set(bpy.data.objects)


def test_a_deleted_target_or_surface_is_not_taken_for_one(estimated, scene, tmp_path):
    """Settings keep deleted objects alive."""
    bpy.ops.mesh.primitive_cube_add()
    low = scene.mps.bake.target = bpy.context.object
    scene.collection.objects.unlink(low)
    with pytest.raises(RuntimeError, match='the target "Cube" was deleted, or is in another scene; choose one'):
        bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
    estimated.select_set(True)
    bpy.ops.mps.add_rig(light_type="AREA")
    bpy.ops.mps.render_photo(**SMALL, output=str(tmp_path / "near.exr"))
    scene.mps.estimate.surface = low
    with pytest.raises(RuntimeError, match='the surface "Cube" was deleted, or is in another scene; choose one'):
        bpy.ops.mps.estimate(output=str(tmp_path / "near.png"))


def test_another_target_puts_the_bake_out_of_date(estimated, scene, tmp_path):
    scene.mps.bake.target = estimated
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
    assert stands(MPS_PT_bake) == (Kind.DONE, "")
    other = bpy.data.objects.new("Other", estimated.data.copy())
    scene.collection.objects.link(other)
    scene.mps.bake.target = other
    assert stands(MPS_PT_bake) == (Kind.OUT_OF_DATE, "Changed since: Target")
    estimated.name = "Renamed"
    scene.mps.bake.target = estimated
    assert stands(MPS_PT_bake) == (Kind.DONE, "")


# --- the photo is of the scene as it is -------------------------------------------------------------------------------


def test_a_rig_that_is_disabled_in_viewports_is_where_the_photo_has_it(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    scene.mps.rig.collection.hide_viewport = True
    light = scene.mps.rig.lights[0].object
    light.location = (3, 0, 3)
    bpy.ops.mps.render_photo(**SMALL, output=str(tmp_path / "photo.exr"))
    scene.mps.rig.collection.hide_viewport = False
    found = read_rig(tmp_path / "photo.rig.json")
    np.testing.assert_allclose(found.directions, light_rig(scene).directions, atol=1e-5)
    assert found.slants[0] == pytest.approx(45, abs=0.1)


def test_time_is_remapped_in_the_photo_as_in_the_scene(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    for frame, place in ((1, 0.0), (10, 0.9)):
        sphere.location.x = place
        sphere.keyframe_insert("location", frame=frame)
    scene.frame_start, scene.frame_end = 4, 5
    scene.render.frame_map_old, scene.render.frame_map_new = 200, 100  # frame 5 is the tenth of the animation
    scene.frame_set(5)
    assert sphere.matrix_world.translation.x == pytest.approx(0.9)
    bpy.ops.mps.render_photo(**SMALL, output=str(tmp_path / "photo.exr"))
    bpy.ops.mps.render_photo(animation=True, output=str(tmp_path / "frames"))
    for file in ("photo.exr", "frames/frames_0005.exr"):
        seen = np.nonzero(pixels(tmp_path / file)[..., 3].any(axis=0))[0]
        assert seen.min() > 7 and seen.max() == 23


def test_strokes_which_take_no_light_are_not_in_the_photo(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    bpy.ops.mps.render_photo(**SMALL, output=str(tmp_path / "without.exr"))
    bpy.ops.object.grease_pencil_add(type="MONKEY", location=(0, -2, 0))
    bpy.ops.mps.render_photo(output=str(tmp_path / "with.exr"))
    assert np.array_equal(pixels(tmp_path / "with.exr"), pixels(tmp_path / "without.exr"))


@pytest.mark.parametrize("kinds", [("POINT", "SUN", "SPOT"), ("AREA", "POINT", "SUN")])
def test_unlike_lights_are_as_bright_as_the_rig_says(sphere, scene, tmp_path, kinds):
    """Far away, so that each lights the sphere as a sun does."""
    bpy.ops.mps.add_rig(distance=200, light_type="AREA", slant=20)
    for light, kind in zip(scene.mps.rig.lights, kinds, strict=True):
        data = light.object.data
        colour, energy = tuple(data.color), data.energy
        data.type = kind
        data = light.object.data
        data.color, data.energy = colour, 2.0 if kind == "SUN" else energy * (5 if kind == "SPOT" else 3)
        if kind == "SPOT":
            data.spot_blend = 0
    bpy.ops.mps.render_photo(width=32, height=32, samples=64, output=str(tmp_path / "photo.exr"))
    rig = light_rig(scene)
    middle = pixels(tmp_path / "photo.exr")[15:17, 15:17, :3].mean(axis=(0, 1))
    expected = rig.mixing @ rig.directions[:, 2]
    np.testing.assert_allclose(middle / middle.max(), expected / expected.max(), rtol=0.05)


def test_lights_whose_brightness_cannot_be_compared_are_refused(sphere, scene):
    bpy.ops.mps.add_rig(light_type="AREA")
    lights = [light.object for light in scene.mps.rig.lights]
    for light in lights:
        light.data.spread = 1.0
    light_rig(scene)  # alike
    lights[1].data.spread = 2.0
    with pytest.raises(RuntimeError, match=r"lights differ in spread, .*; set these alike"):
        bpy.ops.mps.render_photo(**SMALL)


# --- meshes and materials ---------------------------------------------------------------------------------------------


def test_simplify_leaves_the_baked_mesh_as_the_photo_has_it(scene, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    subdivision = bpy.context.object.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels = subdivision.render_levels = 3
    scene.render.use_simplify, scene.render.simplify_subdivision = True, 0
    begin_mesh(tmp_path / "mesh.npz", bpy.context.object, bpy.context.evaluated_depsgraph_get(), None).whole()
    assert len(read_mesh(tmp_path / "mesh.npz", shape_only=True).vertices) == 386
    assert scene.render.use_simplify


def test_a_sculpted_multiresolution_is_asked_to_leave_sculpt_mode(scene, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.modifiers.new("Multires", "MULTIRES")
    bpy.ops.object.multires_subdivide(modifier="Multires")
    bpy.ops.object.mode_set(mode="SCULPT")
    with pytest.raises(Exception, match="leave Sculpt Mode first"):
        begin_mesh(tmp_path / "m.npz", bpy.context.object, bpy.context.evaluated_depsgraph_get(), None)
    bpy.ops.object.mode_set(mode="OBJECT")


def test_a_collection_instance_as_target_says_what_to_bake_onto(estimated, scene, tmp_path):
    collection = bpy.data.collections.new("Props")
    collection.objects.link(estimated)
    bpy.ops.object.collection_instance_add(collection="Props")
    instance = bpy.context.object
    with pytest.raises(RuntimeError, match=f'"{instance.name}" is an instance of the collection "Props"; choose'):
        bpy.ops.mps.bake(target=instance.name, size=16, output=str(tmp_path / "texture.png"))


@pytest.mark.parametrize(("realized", "lack"), [(False, "no faces"), (True, "no UV map")])
def test_what_modifiers_take_off_a_mesh_is_blamed_on_them(estimated, scene, tmp_path, realized, lack):
    """Instances are no mesh of the object's, and not all nodes keep UVs."""
    group = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    grid, scatter, end = map(
        group.nodes.new, ("GeometryNodeMeshGrid", "GeometryNodeInstanceOnPoints", "NodeGroupOutput")
    )
    group.links.new(grid.outputs["Mesh"], scatter.inputs["Points"])
    group.links.new(grid.outputs["Mesh"], scatter.inputs["Instance"])
    group.links.new((grid if realized else scatter).outputs[0], end.inputs[0])
    estimated.modifiers.new("Scatter", "NODES").node_group = group
    with pytest.raises(RuntimeError, match=f'the modifiers of "Sphere" leave {lack}; .* Realize Instances'):
        bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))


def glowing() -> "bpy.types.Material":
    """A material whose shader takes no normal."""
    material = matte()
    tree = material.node_tree
    output = tree.get_output_node("ALL")
    tree.nodes.remove(shader_of(tree))
    tree.links.new(tree.nodes.new("ShaderNodeEmission").outputs[0], output.inputs[0])
    material.name = "Glow"
    return material


def test_a_slot_whose_shader_takes_no_normal_is_passed_over(estimated, scene, tmp_path):
    estimated.data.materials.append(glowing())
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
    assert any('"Glow" does not show the texture' in note for note in notes_of(scene, "bake"))
    assert "MPS Texture" in estimated.material_slots[0].material.node_tree.nodes


def test_subsurface_scattering_and_what_is_not_called_a_bsdf_take_the_texture(estimated, scene, tmp_path):
    tree = estimated.material_slots[0].material.node_tree
    skin = tree.nodes.new("ShaderNodeSubsurfaceScattering")
    tree.links.new(skin.outputs[0], tree.get_output_node("ALL").inputs[0])
    tree.nodes.remove(shader_of(tree))
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
    assert skin.inputs["Normal"].links[0].from_node.name == "MPS Normal"


def test_a_material_of_a_modifier_gets_a_note(estimated, scene, tmp_path):
    group = bpy.data.node_groups.new("Dress", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    begin, dress, end = map(group.nodes.new, ("NodeGroupInput", "GeometryNodeSetMaterial", "NodeGroupOutput"))
    dress.inputs["Material"].default_value = other = matte()
    other.name = "Other"
    group.links.new(begin.outputs[0], dress.inputs[0])
    group.links.new(dress.outputs[0], end.inputs[0])
    estimated.modifiers.new("Dress", "NODES").node_group = group
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
    note = 'Material "Other" of "Sphere" comes from a modifier and does not show the texture'
    assert note in notes_of(scene, "bake")


@pytest.mark.skipif(bpy.app.version >= (5, 0), reason="every material has nodes")
def test_a_material_without_nodes_keeps_its_look(estimated, scene, tmp_path):
    material = bpy.data.materials.new("Plain")
    material.diffuse_color, material.roughness, material.metallic = (0.9, 0.1, 0.2, 1), 0.7, 0.3
    estimated.material_slots[0].material = material
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
    inputs = material.node_tree.nodes["Principled BSDF"].inputs
    assert inputs["Base Color"].default_value[:] == pytest.approx((0.9, 0.1, 0.2, 1))
    assert (inputs["Roughness"].default_value, inputs["Metallic"].default_value) == pytest.approx((0.7, 0.3))


def test_a_muted_light_in_a_material_does_not_glow(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    sphere.material_slots[0].material = material = glowing()
    with pytest.raises(RuntimeError, match="glows"):
        bpy.ops.mps.render_photo(**SMALL, output=str(tmp_path / "photo.exr"))
    next(node for node in material.node_tree.nodes if node.type == "EMISSION").mute = True
    bpy.ops.mps.render_photo(output=str(tmp_path / "photo.exr"))


def test_a_material_that_the_object_holds_and_not_its_mesh_gets_its_texture(estimated, scene, tmp_path):
    (slot,) = estimated.material_slots
    slot.link = "OBJECT"
    slot.material = matte()
    slot.material.name = "Own"
    bpy.ops.mps.bake(size=16, split="MATERIAL", output=str(tmp_path / "<MATERIAL>.png"))
    assert "Own" not in notes_of(scene, "bake") and "modifier" not in notes_of(scene, "bake")
    assert (tmp_path / "Own.png").is_file() and "MPS Texture" in slot.material.node_tree.nodes


@pytest.mark.parametrize(("method", "levels"), [("MATERIAL", 0), ("MODIFIER", 1)])
def test_displacing_one_of_two_linked_duplicates_leaves_the_other_as_it_is(estimated, scene, tmp_path, method, levels):
    twins = [estimated, estimated.copy(), estimated.copy()]
    for twin in twins[1:]:
        scene.collection.objects.link(twin)
    bpy.ops.mps.bake(target=estimated.name, size=16, output=str(tmp_path / "texture.png"))

    def look(obj: "bpy.types.Object") -> tuple[str, bool, list[str]]:
        (material,) = [slot.material for slot in obj.material_slots]
        output, shader = (material.node_tree.nodes[name] for name in ("Material Output", "Principled BSDF"))
        normal = [link.from_node.name for link in shader.inputs["Normal"].links]
        return "".join(normal), output.inputs["Displacement"].is_linked, [one.name for one in obj.modifiers]

    before = [look(twin) for twin in twins]
    assert before[0] == before[1] == before[2] == ("MPS Normal", False, [])
    settings = {"method": method, "levels": levels, "keep_normals": False}
    bpy.ops.mps.displace(target=twins[0].name, **settings, output=str(tmp_path / "height.png"))
    displaced = look(twins[0])
    assert displaced != before[0] and [look(twin) for twin in twins[1:]] == before[1:]
    other = {"MATERIAL": "MODIFIER", "MODIFIER": "MATERIAL"}[method]
    bpy.ops.mps.displace(target=twins[1].name, **{**settings, "method": other}, output=str(tmp_path / "height.png"))
    assert look(twins[0]) == displaced and look(twins[2]) == before[2]
    bpy.ops.mps.bake(target=twins[0].name, output=str(tmp_path / "texture.png"))
    assert look(twins[0]) == look(twins[2]) == before[2]
