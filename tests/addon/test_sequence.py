"""Frames and videos become image sequences on Blender's timeline."""

import itertools
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon.bake.bake import begin_frames
from blender_addon.scene.mesh_file import begin_mesh
from blender_addon.settings.record import notes_of
from mpsnet_core import InputError, published_rig, read_camera, read_image, read_normals, write_image, write_rig

NUMBERS = range(8, 12)


@pytest.fixture
def shots(scene, tmp_path):
    """Four frames of a matt ball that grows, numbered from 8, and their rig; the folder of the scene's own file."""
    lights = published_rig().directions
    folder = tmp_path / "shots"
    folder.mkdir()
    for number in NUMBERS:
        write_image(folder / f"shot_{number:04d}.exr", ball(10 + number, lights))
    write_rig(tmp_path / "rig.json", published_rig())
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    return folder


def ball(radius: float, lights: np.ndarray) -> np.ndarray:
    """(48, 48, 4) a ball of so many pixels' radius in the middle, with alpha."""
    x, y = np.meshgrid(np.arange(48) - 23.5, 23.5 - np.arange(48))
    inside = x**2 + y**2 < (radius - 1) ** 2
    z = np.sqrt(np.where(inside, radius**2 - x**2 - y**2, 0))
    light = np.maximum(np.stack([x, y, z], axis=-1) / radius @ lights.T, 0) * inside[..., None]
    return np.concatenate([light, inside[..., None]], axis=-1).astype(np.float32)


def shown_at(image, frame: int) -> Path:
    """The file that a texture of the scene's shows at a frame of the timeline."""
    scene = bpy.context.scene
    texture = bpy.data.textures.new("Shown", "IMAGE")
    texture.image = image
    user = texture.image_user
    user.frame_start, user.frame_offset = NUMBERS[0], NUMBERS[0] - 1
    user.frame_duration = scene.mps.estimate.last_frame - scene.mps.estimate.first_frame + 1
    user.frame_current = frame
    return Path(image.filepath_from_user(image_user=user))


def test_a_sequence_of_frames_becomes_one_of_normals(shots, scene, tmp_path):
    bpy.ops.mps.open_photo(filepath=str(shots / "shot_0009.exr"), sequence=True)
    bpy.ops.mps.estimate(model="LAMBERTIAN", rig_file=str(tmp_path / "rig.json"))
    image, estimate = scene.mps.estimate.image, scene.mps.estimate
    assert (image.source, estimate.first_frame, estimate.last_frame) == ("SEQUENCE", 8, 11)
    assert image.colorspace_settings.is_data
    for number in NUMBERS:
        file = shown_at(image, number)
        mask = read_image(shots / f"shot_{number:04d}.exr").alpha > 0.5
        np.testing.assert_array_equal(read_normals(file).mask, mask)


def test_a_broken_frame_is_noted_and_the_others_shown(shots, scene, tmp_path):
    broken = shots / "shot_0009.exr"
    broken.write_bytes(broken.read_bytes()[:500])
    bpy.ops.mps.open_photo(filepath=str(shots / "shot_0008.exr"), sequence=True)
    bpy.ops.mps.estimate(model="LAMBERTIAN", rig_file=str(tmp_path / "rig.json"), output=str(tmp_path / "normals"))
    numbers = [file.name.split("_")[1] for file in sorted((tmp_path / "normals").iterdir())]
    assert numbers == ["0008", "0010", "0011"]
    assert (scene.mps.estimate.first_frame, scene.mps.estimate.last_frame) == (8, 11)
    assert [broken.name in note for note in notes_of(scene, "estimate")].count(True) == 1


@pytest.fixture
def moving(sphere, scene, tmp_path):
    """The sphere in the middle of the shots, lit as if its normals leaned; it turns by a quarter a frame."""
    leaning = published_rig().directions @ np.array([[0.9, 0, -0.44], [0, 1, 0], [0.44, 0, 0.9]])
    (tmp_path / "shots").mkdir()
    for number in NUMBERS:
        write_image(tmp_path / "shots" / f"shot_{number:04d}.exr", ball(20, leaning))
    bpy.ops.mps.add_rig(margin=0.2)
    for number in NUMBERS:
        sphere.rotation_euler.z = np.pi / 2 * (number - NUMBERS[0])
        sphere.keyframe_insert("rotation_euler", frame=number)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "shots" / "shot_0008.exr"), sequence=True)
    scene.mps.photo.image.mps.camera = scene.mps.rig.camera
    bpy.ops.mps.estimate(model="LAMBERTIAN")
    scene.frame_set(NUMBERS[0])
    return sphere


def textures(folder: Path) -> list[np.ndarray]:
    return [read_image(file, encoding="linear").pixels for file in sorted(folder.glob("*.png"))]


def test_a_sequence_of_normals_becomes_a_texture_on_the_timeline(moving, scene, tmp_path):
    bpy.ops.mps.bake(target=moving.name, size=64)
    image = scene.mps.bake.image
    assert image.source == "SEQUENCE"
    node = moving.data.materials[0].node_tree.nodes["MPS Texture"]
    assert node.image == image and node.image_user.use_auto_refresh
    folder = tmp_path / f"{moving.name}_normal"
    for number in NUMBERS:
        node.image_user.frame_current = number
        shown = Path(image.filepath_from_user(image_user=node.image_user))
        assert shown == folder / f"{moving.name}_normal_{number:04d}.png"
    first, *others = textures(folder)
    assert len(others) == 3 and all(np.array_equal(first, other) for other in others)
    # Run again, nothing is made again.
    before = {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}
    bpy.ops.mps.bake()
    assert before == {file.name: file.stat().st_mtime_ns for file in folder.iterdir()}


def test_the_texture_may_follow_the_animation(moving, scene, tmp_path):
    """The sphere turns before a camera that stands still: what is seen wanders over its UVs, a quarter a frame."""
    bpy.ops.mps.bake(target=moving.name, size=64, animated=True)
    assert scene.frame_current == NUMBERS[0]
    folder = tmp_path / f"{moving.name}_normal"
    seen = [np.abs(texture - [0.5, 0.5, 1.0]).max(axis=-1)[24:40] > 0.05 for texture in textures(folder)]
    for before, after in itertools.pairwise(seen):
        assert 0.3 < before.mean() < 0.6
        moved = max((np.roll(before, shift, axis=1) == after).mean() for shift in (16, -16))
        assert moved > 0.9 > 0.7 > (before == after).mean()


@pytest.fixture
def waving(scene, tmp_path):
    """A grid that a modifier bends anew at each frame, before a camera that moves, at frame 3.5."""
    scene.frame_set(3, subframe=0.5)
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=9, y_subdivisions=9)
    grid = bpy.context.object
    grid.modifiers.new("Wave", "WAVE")
    bpy.ops.object.camera_add(location=(0, 0, 5))
    camera = bpy.context.object
    for number in NUMBERS:
        camera.location.x = number
        camera.keyframe_insert("location", frame=number)
    return lambda: begin_frames(tmp_path, NUMBERS, "", scene, grid, camera, (40, 30))


def test_only_the_first_frame_is_read_at_once_and_the_person_sees_none(waving, scene, tmp_path):
    begun, grid = waving(), bpy.data.objects["Grid"]
    assert begun.uv_map == "UVMap" and not (tmp_path / "camera_000009.json").exists()
    longs = 0
    for is_long in begun.slices:
        longs += is_long
        assert (scene.frame_current, scene.frame_subframe) == (3, 0.5)
        grid.name, scene.name = f"renamed {longs}", f"renamed {longs}"
        bpy.context.window.scene = bpy.data.scenes.new("Another")
    assert longs == len(NUMBERS) - 1
    bpy.context.window.scene = scene
    shapes = []
    for number in NUMBERS:
        scene.frame_set(number)
        begin_mesh(tmp_path / "expected.npz", grid, bpy.context.evaluated_depsgraph_get(), "").whole()
        with np.load(tmp_path / f"mesh_{number:06d}.npz") as found, np.load(tmp_path / "expected.npz") as expected:
            for name in set(found.files) - {"materials", "objects"}:  # they have the names of the time
                np.testing.assert_array_equal(found[name], expected[name])
            shapes.append(found["vertices"])
        assert read_camera(tmp_path / f"camera_{number:06d}.json").world_from_camera[0, 3] == pytest.approx(number)
    assert all(np.abs(one - other).max() > 0.01 for one, other in itertools.pairwise(shapes))


@pytest.mark.parametrize("gone", ["target", "camera"])
def test_what_is_deleted_while_frames_are_read_is_reported(waving, tmp_path, gone):
    slices = waving().slices
    next(slices)
    bpy.data.objects.remove(bpy.data.objects["Grid" if gone == "target" else "Camera"])
    with pytest.raises(InputError, match=f"the {gone} was deleted before all frames were read; undo that"):
        list(slices)
