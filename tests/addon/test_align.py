"""A real photo finds its camera by the mesh: a photo that Cycles took, opened without what is known of its camera."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from blender_addon.panels.bake import MPS_PT_bake
from blender_addon.panels.estimate import MPS_PT_estimate
from blender_addon.panels.photo_inputs import camera_of
from blender_addon.panels.step import Kind
from blender_addon.scene.camera import scene_camera
from blender_addon.settings.record import notes_of
from mpsnet_core import read_camera, read_image, write_image

from .rendering import STATUE


@pytest.fixture
def mine(opened, shot):
    """A camera of the user's own, five degrees from the true one."""
    data = bpy.data.cameras.new("Mine")
    data.lens = 64
    mine = bpy.data.objects.new("Mine", data)
    opened.collection.objects.link(mine)
    true = Matrix(read_camera(shot / "true.json").world_from_camera.tolist())
    mine.matrix_world = Matrix.Rotation(0.08, 4, "Z") @ true
    return mine


def off(scene, shot):
    """Degrees between the photo's camera and the true one."""
    photo = scene.mps.photo.image
    true, found = read_camera(shot / "true.json"), scene_camera(photo.mps.camera, scene, tuple(photo.size))
    cosine = (np.trace(found.rotation.T @ true.rotation) - 1) / 2
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@pytest.mark.accuracy
def test_without_a_start_the_camera_is_found_and_the_bake_goes_through_it(opened, shot, tmp_path):
    bpy.ops.mps.estimate(output=str(tmp_path / "normals.exr"))
    with pytest.raises(RuntimeError, match="Press Align Photo"):
        bpy.ops.mps.bake(size=64, output=str(tmp_path / "texture.exr"))
    assert MPS_PT_bake.state(bpy.context).kind is Kind.TO_DO

    bpy.ops.mps.align_photo()
    photo = opened.mps.photo.image
    assert off(opened, shot) < 0.5
    assert not photo.mps.poor and "shared" in photo.mps.fit
    camera = photo.mps.camera
    assert camera.data.background_images[0].image == photo and camera.name == "photo"
    assert (opened.render.resolution_x, opened.render.resolution_y) == STATUE
    assert MPS_PT_bake.state(bpy.context).kind is Kind.READY
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.DONE  # it was made before the camera was known, and stays
    assert camera_of(opened).startswith("aligned, ")
    bpy.ops.mps.bake(size=64, output=str(tmp_path / "texture.exr"), level=False)
    found = read_image(tmp_path / "texture.exr").pixels

    # The same normals baked through the true camera.
    true = read_camera(shot / "true.json")
    camera.matrix_world = Matrix(true.world_from_camera.tolist())
    camera.data.lens = 60
    bpy.ops.mps.bake(output=str(tmp_path / "true.exr"))
    assert np.abs(found - read_image(tmp_path / "true.exr").pixels).mean() < 0.01


def test_points_place_it_and_one_that_contradicts_is_reported(opened, shot):
    true, obj = read_camera(shot / "true.json"), bpy.data.objects["Suzanne"]
    bpy.context.view_layer.update()
    vertices = [obj.matrix_world @ vertex.co for vertex in obj.data.vertices][::70]
    wrong = 2
    for number, vertex in enumerate(vertices):
        x, y, w = true.projection_rows() @ [*vertex, 1]
        pair = opened.mps.photo.image.mps.pairs.add()
        pair.pixel, pair.point = (x / w + 40 * (number == wrong), y / w), vertex
    bpy.ops.mps.align_photo(lens=60)
    assert off(opened, shot) < 0.5
    photo = opened.mps.photo.image.mps
    assert photo.camera.data.lens == pytest.approx(60, rel=1e-4)
    residuals = [pair.residual for pair in photo.pairs]
    assert len(residuals) > 6 and residuals[wrong] > 30 > 3 > sorted(residuals)[-2]
    assert f"pair {wrong + 1} contradicts the others" in "".join(notes_of(opened, "align_photo"))
    bpy.ops.mps.remove_align_point(index=wrong)
    assert [pair.residual for pair in photo.pairs] == residuals[:wrong] + residuals[wrong + 1 :]


class TestLensOf:
    """A photo that lost its left and top, placed by pairs; the lens is that of a camera object."""

    CROPPED = (90, 40)

    @pytest.fixture
    def cropped(self, opened, shot, tmp_path):
        true, obj, (left, top) = read_camera(shot / "true.json"), bpy.data.objects["Suzanne"], self.CROPPED
        write_image(tmp_path / "cropped.exr", read_image(shot / "photo.exr").pixels[top:, left:])
        bpy.ops.mps.open_photo(filepath=str(tmp_path / "cropped.exr"))
        bpy.context.view_layer.update()
        for vertex in list(obj.data.vertices)[::70]:
            x, y, w = true.projection_rows() @ [*(obj.matrix_world @ vertex.co), 1]
            pair = opened.mps.photo.image.mps.pairs.add()
            pair.pixel, pair.point = (x / w - left, y / w - top), obj.matrix_world @ vertex.co
        lens = bpy.data.objects.new("Lens", bpy.data.cameras.new("Lens"))
        opened.collection.objects.link(lens)
        longer = STATUE[0] - left
        lens.data.lens, lens.location = 60 * STATUE[0] / longer, (7, 8, 9)
        # The middle of what is left is right of and below that of the whole photo.
        lens.data.shift_x, lens.data.shift_y = left / 2 / longer, -top / 2 / longer
        return opened

    def test_its_focal_length_and_shift_stay(self, cropped, shot):
        lens = bpy.data.objects["Lens"].data
        cropped.mps.align.lens_of = bpy.data.objects["Lens"]
        cropped.mps.estimate.lens = 60  # is not asked
        bpy.ops.mps.align_photo()
        found = cropped.mps.photo.image.mps.camera.data
        assert off(cropped, shot) < 0.3
        for name in ("lens", "shift_x", "shift_y"):
            assert getattr(found, name) == pytest.approx(getattr(lens, name), rel=1e-4)
        # What is given goes first.
        bpy.ops.mps.align_photo(lens=lens.lens)
        assert found.shift_x == 0 and off(cropped, shot) > 1
        cropped.mps.align.lens_of = None
        bpy.ops.mps.align_photo(lens_of="Lens")
        assert off(cropped, shot) < 0.3

    def test_one_that_is_gone_or_no_perspective_camera_and_two_lenses_are_refused(self, cropped):
        lens = bpy.data.objects["Lens"]
        for given, sentence in (
            ({"lens_of": "Lens", "lens": 50}, "the lens is given twice, as that of Lens and as 50 mm"),
            ({"lens_of": "Suzanne"}, 'that of "Suzanne", which is no camera'),
            ({"lens_of": "Nobody"}, 'there is no object "Nobody"'),
        ):
            with pytest.raises(RuntimeError, match=sentence):
                bpy.ops.mps.align_photo(**given)
        lens.data.type = "ORTHO"
        with pytest.raises(RuntimeError, match="the lens is an orthographic camera"):
            bpy.ops.mps.align_photo(lens_of="Lens")
        cropped.mps.align.lens_of = lens
        cropped.collection.objects.unlink(lens)
        with pytest.raises(RuntimeError, match='the camera of the lens "Lens" was deleted'):
            bpy.ops.mps.align_photo()


def test_a_camera_about_there_is_refined_and_stays_the_users_own(opened, mine, shot):
    with pytest.raises(RuntimeError, match="there is no camera to start from"):
        bpy.ops.mps.align_photo(start="CAMERA")
    with pytest.raises(RuntimeError, match='"VIEWPORT" needs a 3D viewport'):
        bpy.ops.mps.align_photo(start="VIEWPORT")
    before = mine.matrix_world.copy()
    opened.mps.photo.image.mps.camera = mine
    bpy.ops.mps.align_photo(start="CAMERA")
    found = opened.mps.photo.image.mps.camera
    assert off(opened, shot) < 0.5
    assert found != mine and np.allclose(mine.matrix_world, before, atol=1e-5)
    # Its own it moves.
    bpy.ops.mps.align_photo()
    assert opened.mps.photo.image.mps.camera == found and len(bpy.data.cameras) == 2


def test_a_mesh_of_something_else_fits_poorly_and_the_bake_reports_it_too(opened, mine, tmp_path):
    bpy.data.objects["Suzanne"].scale.z = 2.2
    opened.camera = mine
    bpy.ops.mps.align_photo(start="CAMERA", lens=60)
    photo = opened.mps.photo.image.mps
    assert photo.poor and "poor fit" in "".join(notes_of(opened, "align_photo"))
    bpy.ops.mps.estimate(output=str(tmp_path / "normals.exr"))
    bpy.ops.mps.bake(size=32, output=str(tmp_path / "texture.exr"))
    assert "the mesh fits the photo poorly" in "".join(notes_of(opened, "bake"))
    photo.camera = mine  # what the user chooses, nothing has measured
    assert not photo.poor
    assert MPS_PT_bake.state(bpy.context).kind is Kind.OUT_OF_DATE


def test_a_rendered_photo_is_not_aligned(photographed):
    with pytest.raises(RuntimeError, match="A rendered photo has its camera"):
        bpy.ops.mps.align_photo()
