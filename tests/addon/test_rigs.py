"""Several rigs in one scene: each keeps its own, and they are baked together."""

import re
from pathlib import Path

import bpy
import numpy as np
import pytest
from documentation import PROJECT
from mathutils import Matrix

from blender_addon.panels.estimate import MPS_PT_estimate
from blender_addon.panels.photo import MPS_PT_photo
from blender_addon.panels.step import Kind
from blender_addon.rig.rig import light_rig
from blender_addon.settings.record import error_of, notes_of
from blender_addon.settings.scene import STEPS
from mpsnet_core.io.image_reading import read_image


def standing(scene):
    """What the chosen rig holds: settings, objects and results."""
    mps = scene.mps
    return (
        mps.rig.slant,
        mps.photo.width,
        mps.estimate.model,
        mps.rig.camera,
        [light.object for light in mps.rig.lights],
        mps.photo.image,
        mps.estimate.image,
    )


@pytest.fixture
def two_rigs(request, estimated, scene, tmp_path):
    """The sphere seen from the front by one rig and from the back by another, both estimated; the second is chosen.

    The parameter, if there is one, is how the sphere moves between them."""
    estimated.matrix_world = getattr(request, "param", Matrix()) @ estimated.matrix_world
    bpy.context.view_layer.update()
    bpy.ops.mps.new_rig()
    for obj in bpy.data.objects:
        obj.select_set(obj == estimated)
    bpy.ops.mps.add_rig(slant=40, view="BACK")
    bpy.ops.mps.render_photo(width=64, height=64, output=str(tmp_path / "back.exr"))
    bpy.ops.mps.estimate(model="LAMBERTIAN_GREY_WORLD", output=str(tmp_path / "back.png"))
    return scene


def test_each_rig_keeps_what_is_its_own(estimated, scene, two_rigs, tmp_path):
    second = standing(scene)
    assert second[:3] == (40, 64, "LAMBERTIAN_GREY_WORLD")
    bpy.ops.mps.choose_rig(index=0)
    first = standing(scene)
    assert first[:3] == (30, 96, "LAMBERTIAN")
    assert not set(first[4]) & set(second[4]) and first[3] != second[3]
    assert first[5] != second[5] and first[6] != second[6]
    # The photo of each is compared with its own lights.
    assert MPS_PT_photo.state(bpy.context).kind is Kind.DONE
    np.testing.assert_allclose(light_rig(scene).slants, 30, atol=1e-3)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "two.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "two.blend"))
    scene = bpy.context.scene
    bpy.ops.mps.choose_rig(index=1)
    assert standing(scene)[:3] == second[:3]
    np.testing.assert_allclose(light_rig(scene).slants, 40, atol=1e-3)


def test_a_file_of_an_earlier_version_keeps_each_rig_s_own(two_rigs, scene, tmp_path):
    """Up to 0.2.0, the chosen rig's settings and results stood beside the list, whose entry was then out of date."""
    second = standing(scene)
    error = {"name": "estimate", "error": "of the second"}
    stored = scene.bl_system_properties_get() if bpy.app.version >= (5, 0) else scene
    mps = stored["mps"]
    rigs = [one.to_dict() for one in mps["rigs"]]
    mps.update({step: rigs[1].pop(step) for step in STEPS})
    rigs[1]["rig"] = {"slant": 77.0}
    mps["rigs"], mps["records"] = rigs, [error, {"name": "bake", "error": "of the scene"}]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "old.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "old.blend"))
    scene = bpy.context.scene
    assert standing(scene)[:3] == second[:3] and scene.mps.rig.camera.type == "CAMERA"
    np.testing.assert_allclose(light_rig(scene).slants, 40, atol=1e-3)
    assert (error_of(scene, "estimate"), error_of(scene, "bake")) == ("of the second", "of the scene")
    bpy.ops.mps.choose_rig(index=0)
    assert standing(scene)[:3] == (30, 96, "LAMBERTIAN") and error_of(scene, "bake") == "of the scene"
    np.testing.assert_allclose(light_rig(scene).slants, 30, atol=1e-3)


def test_a_file_with_one_rig_of_an_earlier_version(estimated, scene, tmp_path):
    first = standing(scene)
    stored = scene.bl_system_properties_get() if bpy.app.version >= (5, 0) else scene
    (only,) = (one.to_dict() for one in stored["mps"]["rigs"])
    stored["mps"].update({step: only[step] for step in STEPS})
    stored["mps"].pop("rigs")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "old.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "old.blend"))
    assert standing(bpy.context.scene)[:3] == first[:3] and len(bpy.context.scene.mps.rigs) == 1
    assert MPS_PT_photo.state(bpy.context).kind is Kind.DONE


def test_a_new_rig_has_the_settings_and_nothing_else(estimated, scene):
    scene.mps.rig.strength = 3
    scene.mps.estimate.output = scene.mps.estimate.rig_file = "//mine.png"
    bpy.ops.mps.new_rig()
    assert scene.mps.rig.strength == 3
    assert standing(scene)[3:] == (None, [], None, None)
    assert scene.mps.estimate.output == scene.mps.estimate.rig_file == ""
    assert [one.name for one in scene.mps.rigs] == ["Rig 1", "Rig 2"]


def test_results_of_several_rigs_do_not_write_over_each_other(two_rigs, scene, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "two.blend"))
    for number in (0, 1):
        bpy.ops.mps.choose_rig(index=number)
        bpy.ops.mps.estimate(output="")
    assert {"two_Scene_Rig_1_normals.png", "two_Scene_Rig_2_normals.png"} <= {path.name for path in tmp_path.iterdir()}


def test_an_error_stays_with_its_rig(estimated, scene):
    with pytest.raises(RuntimeError):
        bpy.ops.mps.estimate(model="FILE", model_file="nowhere.onnx")
    assert error_of(scene, "estimate")
    bpy.ops.mps.new_rig()
    assert not error_of(scene, "estimate")
    bpy.ops.mps.choose_rig(index=0)
    assert "nowhere.onnx" in error_of(scene, "estimate")


def test_dropping_takes_one_rig_away_and_keeps_the_other(two_rigs, estimated, scene):
    bpy.ops.mps.choose_rig(index=0)
    kept = {light.object for light in scene.mps.rigs[1].rig.lights}
    bpy.ops.mps.drop_rig()
    assert len(scene.mps.rigs) == 1
    assert {light.object for light in scene.mps.rig.lights} == kept
    assert {obj.type for obj in bpy.data.objects} == {"MESH", "LIGHT", "CAMERA", "EMPTY"}
    assert len(bpy.data.lights) == 3
    with pytest.raises(RuntimeError, match="only one rig"):
        bpy.ops.mps.drop_rig()
    bpy.ops.mps.remove_rig()
    with pytest.raises(RuntimeError, match="There is no rig"):
        bpy.ops.mps.drop_rig()


def test_rigs_without_normals_are_named_when_all_rigs_are_baked(two_rigs, scene, tmp_path):
    scene.mps.rigs[0].estimate.image = None
    bpy.ops.mps.bake(size=16, all_rigs=True, output=str(tmp_path / "texture.png"))
    assert 'Rigs without normals are left out: "Rig 1"' in notes_of(scene, "bake")
    bpy.ops.mps.new_rig()
    bpy.ops.mps.choose_rig(index=1)
    bpy.ops.mps.bake()
    assert 'Rigs without normals are left out: "Rig 1", "Rig 3"' in notes_of(scene, "bake")


@pytest.mark.parametrize("two_rigs", [Matrix(), Matrix.Translation((5, 0.3, -2))], indirect=True)
def test_all_rigs_are_baked_together(two_rigs, estimated, scene, tmp_path, capfd):
    def seen(**settings):
        bpy.ops.mps.bake(size=64, output=str(tmp_path / "texture.exr"), **settings)
        return int(re.search("([0-9]+)% of the surface seen", capfd.readouterr().out)[1])

    back, both = seen(all_rigs=False), seen(all_rigs=True)
    assert 30 < back <= 50 and both > 1.8 * back


def test_all_rigs_are_photographed_and_estimated_each_with_its_own_settings(two_rigs, scene, tmp_path):
    bpy.ops.mps.choose_rig(index=0)
    photos = [read_image(tmp_path / name).pixels for name in ("photo.exr", "back.exr")]
    for name in ("photo.exr", "back.exr", "normals.png", "back.png"):
        (tmp_path / name).unlink()
    bpy.ops.mps.render_photo(all_rigs=True)
    bpy.ops.mps.estimate(all_rigs=True)
    assert scene.mps.chosen_rig == 0
    rigs = list(scene.mps.every_rig)
    assert [(one.rig.slant, one.photo.width, one.estimate.model) for one in rigs] == [
        (pytest.approx(30), 96, "LAMBERTIAN"),
        (pytest.approx(40), 64, "LAMBERTIAN_GREY_WORLD"),
    ]
    for one, photo in zip(rigs, photos, strict=True):
        np.testing.assert_allclose(read_image(Path(one.photo.image.filepath)).pixels, photo, atol=1e-5)
    assert [one.estimate.image.mps.photo for one in rigs] == [one.photo.image for one in rigs]
    for number in range(2):
        bpy.ops.mps.choose_rig(index=number)
        assert [step.state(bpy.context).kind for step in (MPS_PT_photo, MPS_PT_estimate)] == [Kind.DONE] * 2


def test_what_is_given_holds_for_all_rigs_and_a_folder_takes_the_files_of_all(two_rigs, scene, tmp_path):
    size = {"width": 16, "height": 24, "samples": 1}
    with pytest.raises(RuntimeError, match=r"all rigs would write .*same\.exr; give a folder"):
        bpy.ops.mps.render_photo(all_rigs=True, output=str(tmp_path / "same.exr"), **size)
    bpy.ops.mps.render_photo(all_rigs=True, output=f"{tmp_path}/shots/", **size)
    assert [tuple(one.photo.image.size) for one in scene.mps.every_rig] == [(16, 24)] * 2
    names = {"Scene_Rig_1_photo.exr", "Scene_Rig_2_photo.exr"}
    assert {file.name for file in (tmp_path / "shots").glob("*.exr")} == names


def test_rigs_that_would_write_into_one_file_are_refused(two_rigs, scene, tmp_path):
    for one, folder in zip(scene.mps.every_rig, (tmp_path, f"{tmp_path}/../{tmp_path.name}"), strict=True):
        one.estimate.output = f"{folder}/same.png"
    with pytest.raises(RuntimeError, match=r"Rig 2: another rig's result is .*same\.png, too"):
        bpy.ops.mps.estimate(all_rigs=True)


def test_a_rig_that_fails_is_named_and_what_was_done_before_stays(two_rigs, scene):
    lost = scene.mps.rig.lights[0].object
    bpy.data.objects.remove(lost)
    with pytest.raises(RuntimeError, match="Rig 2: the rig's red light was deleted"):
        bpy.ops.mps.render_photo(all_rigs=True, width=16)
    assert [one.photo.image.size[0] for one in scene.mps.every_rig] == [16, 64]
    assert scene.mps.chosen_rig == 1 and error_of(scene, "render_photo").startswith("Rig 2: ")
    bpy.ops.mps.choose_rig(index=0)
    assert not error_of(scene, "render_photo")


def test_a_script_goes_through_a_ring_of_rigs_as_the_documentation_has_it(sphere, scene, tmp_path, capfd):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "ring.blend"))
    scene = bpy.context.scene
    scene.mps.estimate.model = "LAMBERTIAN"
    page = (PROJECT / "docs/how_to/headless.md").read_text(encoding="utf-8")
    (lines,) = re.findall(r"(bpy\.ops\.mps\.add_rig_ring.*?)```", page, re.DOTALL)
    exec(lines, {"bpy": bpy})
    assert len({one.estimate.image for one in scene.mps.every_rig} - {None}) == 2
    assert int(re.search("([0-9]+)% of the surface seen", capfd.readouterr().out)[1]) > 60


def test_another_camera_takes_the_photo_and_stays_when_the_rig_goes(sphere, scene, tmp_path):
    data = bpy.data.cameras.new("Mine")
    data.type, data.ortho_scale = "ORTHO", 4
    mine = bpy.data.objects.new("Mine", data)
    mine.location, mine.rotation_euler = (0, -6, 0), (np.pi / 2, 0, 0)
    scene.collection.objects.link(mine)
    bpy.ops.mps.add_rig()
    own = scene.mps.rig.camera
    scene.mps.rig.camera = mine
    bpy.ops.mps.render_photo(width=64, height=64, samples=4, output=str(tmp_path / "photo.exr"))
    covered = read_image(tmp_path / "photo.exr").pixels.max(axis=-1) > 0.001
    assert covered.any(axis=0).sum() == pytest.approx(64 * 2 / 4, abs=2)  # a sphere of 2 in a view of 4
    bpy.ops.mps.remove_rig()
    assert mine.name in bpy.data.objects and own not in set(bpy.data.objects)


def test_a_ring_of_rigs_looks_at_the_object_from_all_around(sphere, scene):
    sphere.location = (1, 2, 3)
    bpy.ops.mps.add_rig_ring(count=4, elevation=30)
    assert len(scene.mps.rigs) == 4
    # Where each camera stands, as seen from the object: at the front, right, back and left, 30 degrees up.
    low, high = np.sqrt(3) / 2, 0.5
    expected = [(0, -low, high), (low, 0, high), (0, low, high), (-low, 0, high)]
    for number, direction in enumerate(expected):
        bpy.ops.mps.choose_rig(index=number)
        place = np.array(scene.mps.rig.camera.matrix_world)
        away = place[:3, 3] - (1, 2, 3)
        np.testing.assert_allclose(away / np.linalg.norm(away), direction, atol=1e-5)
        np.testing.assert_allclose(place[:3, 2], direction, atol=1e-5)  # it looks at the object
        assert place[2, 0] == pytest.approx(0, abs=1e-5)  # and stands upright
        np.testing.assert_allclose(light_rig(scene).slants, 30, atol=1e-3)
    bpy.ops.mps.add_rig_ring(count=2)
    assert len(scene.mps.rigs) == 6
