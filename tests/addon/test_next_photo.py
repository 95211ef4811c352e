"""What belongs to a photo goes with it when another one is chosen, in whatever way."""

import shutil

import bpy
import pytest

from blender_addon.panels.estimate import MPS_PT_estimate
from mpsnet_core import read_image, write_image


@pytest.fixture
def photos(photographed, scene, tmp_path):
    """Two photos, the first of them chosen: one in the same folder, one in another."""
    (tmp_path / "other").mkdir()
    files = [tmp_path / "first.exr", tmp_path / "second.exr", tmp_path / "other" / "third.exr"]
    for file in files:
        shutil.copy(tmp_path / "photo.exr", file)
    scene.mps.photo.image = None
    bpy.ops.mps.open_photo(filepath=str(files[0]))
    images = [scene.mps.photo.image, *(bpy.data.images.load(str(file)) for file in files[1:])]
    write_image(tmp_path / "white.exr", read_image(tmp_path / "photo.exr").pixels.sum(axis=-1, keepdims=True))
    estimate = scene.mps.estimate
    estimate.white = estimate.mask_file = str(tmp_path / "white.exr")
    estimate.dark, estimate.lens, estimate.mask = str(tmp_path / "white.exr"), 50, "FILE"
    scene.mps.photo.truth = "//truth.exr"
    return images


def state(scene):
    estimate = scene.mps.estimate
    return bool(estimate.white), bool(estimate.dark), estimate.lens, estimate.mask, bool(scene.mps.photo.truth)


@pytest.mark.parametrize(("next_photo", "session"), [(1, True), (2, False)])
def test_the_next_photo_starts_without_what_belongs_to_the_last(photos, scene, next_photo, session):
    """Chosen in the field, not by the button. Photos of one folder share the lens and the photo of ambient light."""
    before = state(scene)
    scene.mps.photo.image = photos[next_photo]
    assert state(scene) == (False, session, 50 if session else 0, "AUTO", False)
    scene.mps.photo.image = None
    scene.mps.photo.image = photos[0]
    assert state(scene) == before


def test_a_way_to_find_the_object_is_kept(photos, scene):
    scene.mps.estimate.mask = "THRESHOLD"
    scene.mps.photo.image = photos[1]
    assert scene.mps.estimate.mask == "THRESHOLD"


def test_a_painted_mask_waits_for_its_photo(photos, scene):
    painted = scene.mps.estimate.painted_mask = bpy.data.images.new("Painted", 96, 96)
    scene.mps.estimate.mask = "PAINTED"
    scene.mps.photo.image = photos[1]
    assert scene.mps.estimate.painted_mask is None and scene.mps.estimate.mask == "AUTO"
    scene.mps.photo.image = photos[0]
    assert scene.mps.estimate.painted_mask == painted and scene.mps.estimate.mask == "PAINTED"


def test_of_several_rigs_each_keeps_its_own(photos, scene):
    bpy.ops.mps.new_rig()
    assert scene.mps.estimate.white == ""
    scene.mps.photo.image = photos[1]
    scene.mps.estimate.white = "//another.exr"
    bpy.ops.mps.choose_rig(index=0)
    assert scene.mps.photo.image == photos[0] and scene.mps.estimate.white.endswith("white.exr")
    bpy.ops.mps.choose_rig(index=1)
    assert scene.mps.photo.image == photos[1] and scene.mps.estimate.white == "//another.exr"


def test_the_albedo_is_not_asked_for_without_its_white_photo(photos, scene):
    scene.mps.estimate.albedo = True
    scene.mps.photo.image = photos[1]
    assert not MPS_PT_estimate.lacks(bpy.context)
