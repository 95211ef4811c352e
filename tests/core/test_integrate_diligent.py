"""DiLiGenT's true normals, integrated and derived again, where the data are at hand."""

from pathlib import Path

import numpy as np
import pytest
from synthetic import degrees_between

pytest.importorskip("scipy")

from mpsnet_core import Camera, NormalMap, integrate, read_mask
from mpsnet_core.learning.evaluation.diligent import object_folder, read_truth


def derived(points: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normals (H, W, 3) by differences between the neighbours on either side, or the only one; where there are any."""
    tangents, known = [], mask.copy()
    for axis in (0, 1):
        ahead, there = np.roll(points, -1, axis), mask & np.roll(mask, -1, axis)
        behind, before = np.roll(points, 1, axis), mask & np.roll(mask, 1, axis)
        tangents.append(np.where(there[..., None], ahead, points) - np.where(before[..., None], behind, points))
        known &= there | before
    return np.cross(tangents[0], tangents[1]), known


@pytest.mark.parametrize("lens", [False, True], ids=["orthographic", "perspective"])
@pytest.mark.parametrize("name", ["ball", "cat"])
def test_true_normals_come_back(diligent: Path, name: str, lens: bool) -> None:
    """The data set's camera is known to have a focal length of about 3770 pixels; the difference is small."""
    folder = object_folder(diligent, name)
    assert folder is not None
    normals = NormalMap(read_truth(folder), read_mask(folder / "mask.png"))
    height, width = normals.mask.shape
    camera = Camera("perspective", width, height, [3772.0, 3759.0]) if lens else None
    found = integrate(normals, camera)
    vectors, known = derived(found.points(), normals.mask)
    error = degrees_between(vectors[known], normals.vectors[known])
    assert known.sum() > 0.99 * normals.mask.sum()
    assert error.mean() <= 1.5
