"""Three photos under one white light each become one photo in the panel."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from synthetic import degrees_between, shaded_sphere

from blender_addon.panels.photo import MPS_PT_superpose
from blender_addon.panels.step import Kind
from mpsnet_core import read_image, read_normals, write_image, write_rig

from .test_steps import stands

SPHERE = shaded_sphere(64)
PAINT = np.array([0.9, 0.5, 0.2])
LIGHTS = ("first", "second", "third")
PLACES = ("second_light", "third_light")


@pytest.fixture
def photos(tmp_path):
    """A painted ball under one white light at a time."""
    for channel, name in enumerate(LIGHTS):
        write_image(tmp_path / f"{name}.exr", SPHERE.image[..., channel, None] * PAINT)
    return {name: str(tmp_path / f"{name}.exr") for name in LIGHTS}


def test_three_white_photos_become_the_photo_that_is_estimated(scene, photos, tmp_path):
    assert stands(MPS_PT_superpose)[0] is Kind.TO_DO
    for name, photo in photos.items():
        setattr(scene.mps.superpose, name, photo)
    assert stands(MPS_PT_superpose) == (Kind.READY, "")
    scene.mps.estimate.white, scene.mps.estimate.encoding = photos["first"], "LINEAR"
    bpy.ops.mps.open_photo(filepath=photos["first"])
    scene.mps.estimate.white = photos["first"]
    bpy.ops.mps.superpose(output=str(tmp_path / "one.exr"))
    assert stands(MPS_PT_superpose) == (Kind.DONE, "")
    image = scene.mps.photo.image
    assert Path(image.filepath) == tmp_path / "one.exr"
    np.testing.assert_allclose(read_image(image.filepath).pixels, SPHERE.image * PAINT.mean(), atol=1e-6)
    # Not the white photo of the photo before: the three together show the colours.
    assert (scene.mps.estimate.white, scene.mps.estimate.encoding) == (str(tmp_path / "one_white.exr"), "AUTO")
    expected = SPHERE.image.sum(axis=-1, keepdims=True) * PAINT
    np.testing.assert_allclose(read_image(tmp_path / "one_white.exr").pixels, expected, atol=1e-6)

    write_rig(tmp_path / "rig.json", SPHERE.rig)
    settings = {"mask": "THRESHOLD", "threshold": 0.02, "rig_file": str(tmp_path / "rig.json")}
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.png"), **settings)
    normals = read_normals(tmp_path / "normals.png")
    lit = (SPHERE.image > 0.02).all(axis=-1) & normals.mask
    assert degrees_between(normals.vectors, SPHERE.normals)[lit].mean() < 0.1

    write_image(photos["second"], np.ones((70, 64, 3)))
    assert stands(MPS_PT_superpose) == (Kind.OUT_OF_DATE, "Changed since: Second Light")


def test_three_photos_that_are_chosen_at_once_fill_the_three_fields(scene, photos, tmp_path):
    files = [{"name": Path(photo).name} for photo in photos.values()]
    for group, setting, names in (("superpose", "first", LIGHTS), ("calibrate", "ball", ("ball", *PLACES))):
        place = getattr(scene.mps, group)
        chosen = {"group": place.path_from_id(), "setting": setting, "filepath": photos["first"]}
        bpy.ops.mps.choose_file(**chosen, directory=str(tmp_path), files=files)
        assert [getattr(place, name) for name in names] == sorted(photos.values())
    bpy.ops.mps.choose_file(**chosen, directory=str(tmp_path), files=files[1:])
    assert scene.mps.calibrate.ball == photos["first"]  # the one under the mouse


def test_three_dropped_photos_are_shots_of_one_pose(scene, photos, tmp_path):
    with pytest.raises(RuntimeError, match="select the mesh object"):
        bpy.ops.mps.scan(directory=str(tmp_path), files=[{"name": f"{name}.exr"} for name in LIGHTS])
    assert read_image(scene.mps.photo.image.filepath).pixels.shape == (64, 64, 3)
    assert scene.mps.superpose.third == photos["third"]
    assert scene.mps.estimate.white.endswith("_white.exr")


def test_what_is_missing_or_does_not_fit_is_reported(scene, photos, tmp_path):
    with pytest.raises(RuntimeError, match="no photo under the second light is named"):
        bpy.ops.mps.superpose(**{**photos, "second": ""})
    write_image(photos["third"], np.ones((8, 8, 3)))
    with pytest.raises(RuntimeError, match="8 x 8"):
        bpy.ops.mps.superpose(**photos, output=str(tmp_path / "one.exr"))
    assert stands(MPS_PT_superpose)[0] is Kind.FAILED
    assert scene.mps.photo.image is None and not (tmp_path / "one.exr").exists()
