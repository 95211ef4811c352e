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
    assert (scene.mps.estimate.white, scene.mps.estimate.encoding) == ("", "AUTO")

    write_rig(tmp_path / "rig.json", SPHERE.rig)
    settings = {"mask": "THRESHOLD", "threshold": 0.02, "rig_file": str(tmp_path / "rig.json")}
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.png"), **settings)
    normals = read_normals(tmp_path / "normals.png")
    lit = (SPHERE.image > 0.02).all(axis=-1) & normals.mask
    assert degrees_between(normals.vectors, SPHERE.normals)[lit].mean() < 0.1

    write_image(photos["second"], np.ones((70, 64, 3)))
    assert stands(MPS_PT_superpose) == (Kind.OUT_OF_DATE, "Changed since: Second Light")


def test_what_is_missing_or_does_not_fit_is_reported(scene, photos, tmp_path):
    with pytest.raises(RuntimeError, match="no photo under the second light is named"):
        bpy.ops.mps.superpose(**{**photos, "second": ""})
    write_image(photos["third"], np.ones((8, 8, 3)))
    with pytest.raises(RuntimeError, match="8 x 8"):
        bpy.ops.mps.superpose(**photos, output=str(tmp_path / "one.exr"))
    assert stands(MPS_PT_superpose)[0] is Kind.FAILED
    assert scene.mps.photo.image is None and not (tmp_path / "one.exr").exists()
