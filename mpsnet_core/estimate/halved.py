"""Photos and their normals at half the resolution, rounded up: each pixel is the mean of those inside the mask."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.resampling import means_inside
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import Bools
from mpsnet_core.capture.capture import Capture
from mpsnet_core.scene.normal_map import NormalMap

T = TypeVar("T", bound=np.generic)


def halved_capture(capture: Capture) -> Capture:
    """The photo at half the resolution. A pixel is clipped if one of those inside the mask is."""
    mask, camera, depth = capture.mask, capture.camera, capture.depth
    white, white_clipped = capture.white, capture.white_clipped
    return Capture(
        _halved(capture.image, mask),
        _halved_mask(mask),
        capture.rig,
        None if camera is None else camera.halved(),
        depth=None if depth is None else _halved(depth[..., None], mask)[..., 0],
        clipped=_halved(capture.saturated, mask),
        white=None if white is None else _halved(white, mask),
        white_clipped=None if white_clipped is None else _halved(white_clipped, mask),
        white_light=capture.white_light,
    )


def halved_normals(normals: NormalMap) -> NormalMap:
    """Normals and their confidence at half the resolution."""
    vectors, confidence = (_halved(one, normals.mask) for one in (normals.vectors, normals.confidence[..., None]))
    return NormalMap(vectors, _halved_mask(normals.mask), confidence[..., 0], in_place=True)


def _halved_mask(mask: Bools) -> Bools:
    return _halved(mask[..., None], mask)[..., 0]


def _halved(values: NDArray[T], mask: Bools) -> NDArray[T]:
    """Means (h, w, C) of values (H, W, C) over a mask (H, W); of Booleans, whether any is True."""
    height, width = mask.shape
    small = np.zeros((-(-height // 2), -(-width // 2), values.shape[2]), values.dtype)
    for rows in bands(height):  # each of an even number of rows
        inside = mask[rows]
        known = np.where(inside[..., None], values[rows], 0).astype(np.float32, copy=False)
        small[rows.start // 2 : -(-rows.stop // 2)] = means_inside(known, inside, 1)[0]
    return small
