"""Where results are kept: with the photo what stood when it was taken, in the .blend what would go with Blender."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon.images import image_file, pixels_of
from blender_addon.outputs import output_path
from blender_addon.panels.estimate import MPS_PT_estimate
from blender_addon.panels.step import Kind
from blender_addon.settings.record import notes_of
from blender_addon.settings.scene import STEPS
from mpsnet_core import InputError, published_rig, read_camera, read_normals, read_rig, write_image, write_rig
from mpsnet_core.io.image_reading import read_data


def test_the_photo_keeps_the_rig_and_camera_it_was_taken_with(photographed, scene, tmp_path):
    bpy.ops.mps.estimate(output=str(tmp_path / "before.png"))
    bpy.ops.mps.bake(size=32, output=str(tmp_path / "before_texture.png"))
    rig = scene.mps.rig
    rig.lights[0].object.location = (3, 1, 2)
    rig.camera.location.x += 0.5
    bpy.ops.mps.estimate(output=str(tmp_path / "after.png"))
    bpy.ops.mps.bake(size=32, output=str(tmp_path / "after_texture.png"))
    for name in ("{}.png", "{}_texture.png"):
        after, before = (read_data(tmp_path / name.format(when))[0] for when in ("after", "before"))
        assert np.array_equal(after, before)
    rig = read_rig(tmp_path / "photo.rig.json")
    assert rig.is_ground_truth and rig.slants == pytest.approx([30, 30, 30], abs=1e-3)
    assert not list(tmp_path.glob("*after*.camera.json"))
    # A new photo is taken with the rig as it stands now.
    bpy.ops.mps.render_photo(output=str(tmp_path / "photo.exr"))
    assert abs(read_rig(tmp_path / "photo.rig.json").slants[0] - 30) > 5


def test_results_of_an_unsaved_file_are_packed_and_outlive_it(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    bpy.ops.mps.render_photo(width=32, height=32, samples=1)
    first = pixels_of(scene.mps.photo.image)
    bpy.ops.mps.add_rig(slant=50.0)
    bpy.ops.mps.render_photo()
    assert not np.allclose(pixels_of(scene.mps.photo.image), first), "the image still shows the first photo"
    bpy.ops.mps.estimate()
    bpy.ops.mps.bake(size=32)
    before = pixels_of(scene.mps.bake.image)
    names = [Path(image.filepath) for image in (scene.mps.photo.image, scene.mps.bake.image)]
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    for name in names:
        Path(bpy.path.abspath(str(name))).unlink()
    scene.mps.rig.lights[0].object.location = (3, 1, 2)
    scene.mps.rig.camera.location.x += 0.5
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    scene = bpy.context.scene
    assert np.array_equal(pixels_of(scene.mps.bake.image), before)
    # The rig was moved, but the photo knows the lights and the camera that it was taken with.
    bpy.ops.mps.bake(output=str(tmp_path / "again_texture.png"))
    assert np.array_equal(pixels_of(scene.mps.bake.image), before)
    bpy.ops.mps.estimate(output=str(tmp_path / "again.png"))
    bpy.ops.mps.bake()
    assert read_normals(tmp_path / "again.png").mask.any()
    assert np.array_equal(pixels_of(scene.mps.bake.image), before)


def test_a_folder_takes_what_is_written_by_a_name_of_its_own(tmp_path):
    for folder in ("there", "v1.1", "scan.png"):
        (tmp_path / folder).mkdir()
    for given in ("there", "there/", "new/", "v1.1", "v1.2/", "scan.png"):
        path = output_path(f"{tmp_path}/{given}", "Scene normals", "PNG")
        assert path == tmp_path / given / "Scene_normals.png" and path.parent.is_dir()
    assert output_path(f"{tmp_path}/new_file", "Scene", "EXR") == tmp_path / "new_file.exr"


def test_tokens_of_a_path_are_shot_version_and_frame_of_the_file(scene, tmp_path):
    given = f"{tmp_path}/<SHOT>/<SHOT>_<VERSION>.<FRAME>.png"
    with pytest.raises(InputError, match="nothing stands for <SHOT>"):
        output_path(given, "n", "PNG")
    scene.frame_set(7)
    for name, shot, version in (("statue_v003", "statue", "v003"), ("sh010.comp-v12", "sh010.comp", "v12")):
        (tmp_path / shot).mkdir()
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / f"{name}.blend"))
        assert output_path(given, "n", "PNG") == tmp_path / shot / f"{shot}_{version}.0007.png"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "statue.blend"))
    with pytest.raises(InputError, match="nothing stands for <VERSION>"):
        output_path(given, "n", "PNG")


def test_a_result_is_not_written_over_what_another_step_made(photographed, scene, tmp_path):
    """But a step may make its own anew in its place."""
    bpy.ops.mps.estimate(output=str(tmp_path / "n.exr"))
    photo, normals = str(tmp_path / "photo.exr"), str(tmp_path / "n.exr")
    kept = [Path(file).read_bytes() for file in (photo, normals)]
    for verb, file, what in (
        ("render_truth", photo, "photo"),
        ("render_photo", normals, "normals"),
        ("bake", photo, "photo"),
        ("integrate", photo, "photo"),
    ):
        with pytest.raises(RuntimeError, match=f'would overwrite {file}, the {what} "MPS .*"; choose another output'):
            getattr(bpy.ops.mps, verb)(output=file)
    assert [Path(file).read_bytes() for file in (photo, normals)] == kept
    assert bpy.ops.mps.render_photo(output=photo) == bpy.ops.mps.estimate(output=normals) == {"FINISHED"}


def test_an_ending_that_is_not_of_the_chosen_format_wins_and_is_reported(photographed, scene, tmp_path):
    bpy.ops.mps.estimate(output=str(tmp_path / "n.exr"))
    assert "ending" not in "".join(notes_of(scene, "estimate")), "no format was chosen"
    bpy.ops.mps.estimate(file_format="TIFF", output=str(tmp_path / "n.exr"))
    bpy.ops.mps.bake(preset="UNREAL", size=32, output=str(tmp_path / "t.exr"))
    bpy.ops.mps.integrate(file_format="PNG", mesh=False, output=str(tmp_path / "h.tif"))
    told = {verb: notes_of(scene, verb) for verb in ("estimate", "bake", "integrate")}
    assert "n.exr is written as its ending says, not as TIFF" in told["estimate"]
    assert "t.exr is written as its ending says, not as PNG" in told["bake"]
    assert "h.tif is written as its ending says, not as PNG" in told["integrate"]
    kinds = {name: (tmp_path / name).read_bytes()[:3] for name in ("n.exr", "t.exr", "h.tif")}
    assert kinds == {"n.exr": b"v/1", "t.exr": b"v/1", "h.tif": b"II*"}
    bpy.ops.mps.integrate(output=str(tmp_path / "h.png"))
    assert "integrate" not in scene.mps.records or "ending" not in scene.mps.records["integrate"].notes


@pytest.mark.parametrize("is_float", [False, True])
def test_a_painted_and_packed_image_is_read_though_it_never_had_a_file(scene, is_float):
    image = bpy.data.images.new("Painted", 4, 2, float_buffer=is_float)
    image.pixels.foreach_set(np.tile(np.float32([0, 0.5, 1, 1]), 8))
    image.update()
    image.pack()
    read, _ = read_data(image_file(image, "normal map", "choose another"))
    np.testing.assert_allclose(read[..., :3], np.broadcast_to([0, 0.5, 1], (2, 4, 3)), atol=0.003)


def test_packed_images_whose_files_were_called_the_same_are_two(scene, tmp_path):
    files = []
    for value in (0.0, 1.0):
        path = tmp_path / str(value) / "same.png"
        path.parent.mkdir()
        write_image(path, np.full((2, 2, 3), value, np.float32), bits=8)
        image = bpy.data.images.load(str(path))
        image.pack()
        path.unlink()
        files.append(image_file(image, "photo", "choose another"))
    assert [read_data(file)[0].max() for file in files] == [0, 1]
    assert {file.name for file in files} == {"same.png"}, "results are called by it"


def test_an_image_whose_file_was_moved_says_which(scene, tmp_path):
    write_image(tmp_path / "a.png", np.ones((2, 2, 3), np.float32), bits=8)
    image = bpy.data.images.load(str(tmp_path / "a.png"))
    (tmp_path / "a.png").rename(tmp_path / "b.png")
    with pytest.raises(InputError, match=r"has no file on disk \(.*a\.png is missing\)"):
        image_file(image, "photo", "choose another")


def test_an_opened_photo_takes_the_rig_and_camera_beside_it(photographed, scene, tmp_path):
    taken = [read_rig(tmp_path / "photo.rig.json").slants, read_camera(tmp_path / "photo.camera.json").width]
    bpy.ops.mps.add_rig(slant=50.0)
    write_rig(tmp_path / "photo.rig.json", published_rig(40.0))
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "photo.exr"))
    image = scene.mps.photo.image
    assert json.loads(image["mpsnet_rig"])["lights"][0]["slant"] == pytest.approx(40) != pytest.approx(taken[0][0])
    assert json.loads(image["mpsnet_camera"])["width"] == taken[1]
    # To the photo's own stem: nothing beside the photo is touched, and the camera goes with the normals.
    beside = {path: path.read_bytes() for path in tmp_path.glob("photo*")}
    bpy.ops.mps.estimate(output=str(tmp_path / "photo.png"))
    assert {path: path.read_bytes() for path in tmp_path.glob("photo*") if path.suffix != ".png"} == beside
    assert scene.mps.estimate.image["mpsnet_camera"] == image["mpsnet_camera"]
    # What is no longer beside the photo is forgotten, and a normal map of the same name forgets with it.
    for name in ("photo.rig.json", "photo.camera.json"):
        (tmp_path / name).unlink()
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "photo.exr"))
    assert not {"mpsnet_rig", "mpsnet_camera"} & set(scene.mps.photo.image.keys())
    bpy.ops.mps.estimate()
    assert "mpsnet_camera" not in scene.mps.estimate.image


def test_a_rendered_photo_has_its_own_rig_and_an_opened_one_that_of_the_rig_file(photographed, scene, tmp_path):
    def normals(**settings):
        bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.png"), **settings)
        return (tmp_path / "normals.png").read_bytes()

    own = normals()
    write_rig(tmp_path / "measured.json", published_rig(45.0))
    measured = normals(rig_file=str(tmp_path / "measured.json"))
    assert measured != own, "what the call names counts"
    assert "measured.json" not in "".join(notes_of(scene, "estimate"))
    # What is left in the panel from then is of other photos.
    assert normals() == own
    assert any(note.startswith("measured.json not used") for note in notes_of(scene, "estimate"))
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.DONE
    (tmp_path / "measured.json").unlink()
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.DONE
    write_rig(tmp_path / "measured.json", published_rig(45.0))
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "photo.exr"))
    assert normals() == measured


def test_paths_beside_the_blend_file_are_understood(photographed, scene, tmp_path):
    """Blender's file browser gives them, and paints those red that a setting does not say to understand."""
    steps = [step for step in scene.mps.bl_rna.properties if step.type == "POINTER" and step.identifier != "rna_type"]
    groups = [*(step.fixed_type for step in steps), *(getattr(scene.mps, step).bl_rna for step in STEPS)]
    settings = [setting for group in groups for setting in group.properties]
    paths = [setting for setting in settings if setting.subtype in {"FILE_PATH", "FILE_NAME", "DIR_PATH"}]
    assert len(paths) > 10
    assert [path.identifier for path in paths if not path.is_path_supports_blend_relative] == []
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.mps.estimate(rig_file="//photo.rig.json", output="//normals.exr")
    assert (tmp_path / "normals.exr").is_file()


def test_beside_a_file_that_was_never_saved_is_nowhere(estimated, scene, tmp_path, monkeypatch):
    """Blender would take the folder that it was started in."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sub").mkdir()
    before = sorted(tmp_path.iterdir())
    for verb, output in {
        "render_photo": "//x.exr",
        "render_truth": "//x.exr",
        "estimate": "//x.png",
        "bake": "//sub/",
        "integrate": "//sub",
        "make_material": "//x",
        "render_samples": "//x",
        "try_it": "//x",
    }.items():
        sentence = f"^Error: {output} is beside this file, which was never saved; save it, or give a path in full$"
        with pytest.raises(RuntimeError, match=sentence):
            getattr(bpy.ops.mps, verb)(output=output)
    assert sorted(tmp_path.iterdir()) == before and not list((tmp_path / "sub").iterdir())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "sub" / "mine.blend"))
    bpy.ops.mps.estimate(model="LAMBERTIAN", output="//x.png")
    assert (tmp_path / "sub" / "x.png").is_file()
