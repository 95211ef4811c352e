"""The error map: the angles between normals and Blender's own, on a sphere whose normals err by a known angle."""

import bpy
import numpy as np
import pytest

from blender_addon.settings.record import notes_of
from mpsnet_core.scene.normal_map import NormalMap, write_normals

from .test_photo import sphere_normals


def test_the_figures_are_the_angles_that_the_normals_err_by(estimated, scene, tmp_path):
    assert not bpy.ops.mps.error_map.poll()  # there is no truth yet
    bpy.ops.mps.render_truth(output=str(tmp_path / "truth.exr"))
    exact, _ = sphere_normals(scene, 96, 96)
    inside, above = exact[..., 2] > 0.3, np.arange(96)[:, None] < 40
    angles = [np.radians(degrees) for degrees in (4, 25)]
    turned = [exact @ np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]]) for a in angles]
    # About the axis y: by the whole angle where the normal has no part along it.
    expected = [np.degrees(np.arccos(np.clip((one * exact).sum(-1), -1, 1))) for one in turned]
    write_normals(tmp_path / "normals.png", NormalMap(np.where(above[..., None], turned[1], turned[0]), inside))
    errors = np.where(above, expected[1], expected[0])[inside]

    bpy.ops.mps.error_map()
    (note,) = notes_of(scene, "error_map")
    mean, median = (float(word.strip("°,")) for word in note.split() if "°" in word)
    assert (mean, median) == pytest.approx((errors.mean(), np.median(errors)), abs=0.3)
    assert abs(mean - median) > 2
    picture = scene.mps.estimate.error_image
    assert picture.size[1] == 96 < picture.size[0]  # with its scale


def test_true_normals_of_another_view_are_refused(estimated, scene, tmp_path):
    scene.mps.rig.target.rotation_euler.z += 0.3
    bpy.context.view_layer.update()
    bpy.ops.mps.render_truth(output=str(tmp_path / "truth.exr"))
    with pytest.raises(RuntimeError, match="of another view than the photo; render them again"):
        bpy.ops.mps.error_map()
    (tmp_path / "truth.exr").unlink()
    with pytest.raises(RuntimeError, match="are gone; render them again"):
        bpy.ops.mps.error_map()
