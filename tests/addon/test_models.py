"""Which models the panel offers, which it holds all the same, and how often a still goes through them."""

import bpy
import numpy as np

from mpsnet_core import angular_error, read_normals


def test_models_that_are_not_offered_keep_their_names_and_their_places_in_files(scene):
    items = scene.mps.estimate.bl_rna.properties["model"].enum_items
    assert {item.identifier: item.value for item in items} == {
        "MULTISCALE": 0,
        "MULTISCALE_QUICK": 2,
        "MULTISCALE_INT8": 2,  # its name in 0.2.0
        "MPSNET": 3,
        "PSFCN": 5,
        "DEMULTIPLEXER": 6,
        "LAMBERTIAN": 7,
        "LAMBERTIAN_GREY_WORLD": 8,
        "FILE": 9,
    }


def test_a_still_is_averaged_unless_set_otherwise(photographed, scene, tmp_path):
    def estimated(**options):
        path = tmp_path / "normals.exr"
        bpy.ops.mps.estimate(output=str(path), file_format="EXR", **options)
        return read_normals(path)

    scene.mps.estimate.encoding = "SRGB"  # not as it is, or the matt sphere is solved exactly whatever the passes
    averaged = estimated(model="MULTISCALE")
    once = estimated(average_passes=False)
    assert angular_error(once.vectors, averaged.vectors)[averaged.mask].mean() > 0.05
    np.testing.assert_array_equal(estimated(model="MULTISCALE_QUICK", average_passes=True).vectors, once.vectors)
    scene.mps.estimate.model = "MULTISCALE_INT8"
    assert scene.mps.estimate.model == "MULTISCALE_QUICK"
