"""The mask is shown before it is used, and what is shown is what is used."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from dng import write_dng

from blender_addon.images import pixels_of
from blender_addon.panels.estimate import MPS_PT_estimate
from blender_addon.panels.step import Kind, State
from mpsnet_core import published_rig, read_image, read_mask, read_normals, write_image, write_rig


@pytest.fixture
def on_grey(photographed, scene, tmp_path):
    """The sphere's photo before a dim grey wall, without alpha; gives the true mask and the wall's own photo."""
    rendered = read_image(tmp_path / "photo.exr")
    assert rendered.alpha is not None
    mask = rendered.alpha > 0.5
    noise = np.random.default_rng(1).normal(0, 0.002, (*mask.shape, 3))
    write_image(tmp_path / "shot.exr", np.where(mask[..., None], rendered.pixels, 0.03) + noise)
    write_image(tmp_path / "wall.exr", np.full((*mask.shape, 3), 0.03, np.float32))
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "shot.exr"))
    return mask


def overlap(found: np.ndarray, mask: np.ndarray) -> float:
    return float((found & mask).sum() / (found | mask).sum())


@pytest.mark.parametrize("choice", ["FIND", "BACKGROUND", "THRESHOLD"])
def test_what_is_shown_is_what_is_estimated(on_grey, scene, tmp_path, choice):
    options = {"mask": choice, "background": str(tmp_path / "wall.exr"), "threshold": 0.1}
    bpy.ops.mps.show_mask(**options)
    shown = scene.mps.estimate.mask_image
    assert shown is not None and tuple(shown.size) == (96, 96)
    folder = Path(bpy.path.abspath(shown.filepath)).parent
    found = read_mask(folder / f"{scene.name}_mask.png")
    assert overlap(found, on_grey) > (0.8 if choice == "THRESHOLD" else 0.95)
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "n.exr"))
    np.testing.assert_array_equal(read_normals(tmp_path / "n.exr").mask, found)


def paint(image, rows, columns, colour):
    """Brush strokes: the picture's pixels, its first row on top, become a colour."""
    pixels = pixels_of(image)
    pixels[::-1][rows, columns] = colour
    image.pixels.foreach_set(pixels.ravel())


@pytest.mark.parametrize("rubber", [(0, 0, 0, 1), (0.8, 0.8, 0.8, 0)], ids=["black", "eraser"])
def test_a_painted_mask_is_used_as_it_is_painted(on_grey, scene, tmp_path, rubber):
    bpy.ops.mps.show_mask(mask="FIND")
    found = read_mask(Path(bpy.path.abspath(scene.mps.estimate.mask_image.filepath)).parent / f"{scene.name}_mask.png")
    bpy.ops.mps.paint_mask()
    picture = scene.mps.estimate.painted_mask
    assert scene.mps.estimate.mask == "PAINTED" and tuple(picture.size) == (96, 96)
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "found.exr"))
    np.testing.assert_array_equal(read_normals(tmp_path / "found.exr").mask, found)
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.DONE

    paint(picture, slice(0, 10), slice(0, 20), (1, 1, 1, 1))
    paint(picture, slice(40, 60), slice(40, 50), rubber)
    assert MPS_PT_estimate.state(bpy.context) == State(Kind.OUT_OF_DATE, "Changed since: Painted Mask")
    expected = found.copy()
    expected[:10, :20], expected[40:60, 40:50] = True, False
    bpy.ops.mps.estimate(output=str(tmp_path / "painted.exr"))
    np.testing.assert_array_equal(read_normals(tmp_path / "painted.exr").mask, expected)
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.DONE
    # It is saved with the file, and the button shows what it comes to, on which one may paint on.
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.DONE
    bpy.ops.mps.paint_mask()
    picture = bpy.context.scene.mps.estimate.painted_mask
    paint(picture, slice(0, 10), slice(0, 20), (0, 0, 0, 1))
    picture.pack()
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.OUT_OF_DATE
    expected[:10, :20] = False
    bpy.ops.mps.estimate(output=str(tmp_path / "on.exr"))
    np.testing.assert_array_equal(read_normals(tmp_path / "on.exr").mask, expected)


def test_unasked_a_photo_without_alpha_has_its_object_found_and_one_with_alpha_keeps_that(on_grey, scene, tmp_path):
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "found.exr"))
    assert overlap(read_normals(tmp_path / "found.exr").mask, on_grey) > 0.95
    bpy.ops.mps.show_mask()
    folder = Path(bpy.path.abspath(scene.mps.estimate.mask_image.filepath)).parent
    np.testing.assert_array_equal(
        read_mask(folder / f"{scene.name}_mask.png"), read_normals(tmp_path / "found.exr").mask
    )
    # A square of the same wall, too, where alpha says so.
    square = np.zeros(on_grey.shape, np.float32)
    square[4:60, 4:60] = 1
    wall = read_image(tmp_path / "shot.exr").pixels
    write_image(tmp_path / "cut.exr", np.concatenate([wall, square[..., None]], axis=2))
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "cut.exr"))
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "cut_out.exr"))
    np.testing.assert_array_equal(read_normals(tmp_path / "cut_out.exr").mask, square > 0)


def test_opening_camera_raw_overwrites_nothing_and_reads_the_raw_file(scene, tmp_path):
    pytest.importorskip("rawpy")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    write_image(tmp_path / "shot.exr", np.full((4, 4, 3), 0.25, np.float32))
    before = (tmp_path / "shot.exr").read_bytes()
    mosaic = np.full((48, 64), 2000, np.uint16)
    mosaic[8:40, 8:56] = 30000
    write_dng(tmp_path / "shot.dng", mosaic)
    write_rig(tmp_path / "shot.rig.json", published_rig())
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "shot.dng"))
    assert (tmp_path / "shot.exr").read_bytes() == before
    assert tuple(scene.mps.photo.image.size) == (64, 48)
    # Estimated from the raw file, with the rig beside it.
    Path(bpy.path.abspath(scene.mps.photo.image.filepath)).unlink()
    bpy.ops.mps.estimate(model="LAMBERTIAN", mask="THRESHOLD", threshold=0.5, output=str(tmp_path / "n.exr"))
    assert 0.4 < read_normals(tmp_path / "n.exr").mask.mean() < 0.6
