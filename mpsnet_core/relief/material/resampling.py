"""Resampling of the part of a photo that becomes the tile."""

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.arrays.types import F32, F64
from mpsnet_core.relief.material.tiling import Tiling


def sampled(features: F32, tiling: Tiling, size: tuple[int, int], overlap: tuple[int, int]) -> F32:
    """(H + overlap[0], W + overlap[1], C) the centre of the photo, resampled along the tiling's steps.

    features: (H', W', C), of which the first two are gradients along columns and rows; they become gradients along the
        tiling's steps. size: (H, W) pixels of a tile. A tile aligned with the photo's pixels is cropped unchanged.
    """
    steps = np.stack([tiling.right, tiling.down])
    rows, columns = size[0] + overlap[0], size[1] + overlap[1]
    spans = np.array([columns / size[1], rows / size[0]])
    start = (np.array(features.shape[1::-1]) - spans @ steps) / 2
    if np.array_equal(steps, np.diag(size[::-1])):
        left, top = np.round(start).astype(int)
        return features[top : top + rows, left : left + columns].copy()
    places = np.zeros((3, 3))  # maps row vectors of the tile's pixels to the photo's
    places[:2, :2], places[2, :2], places[2, 2] = steps / [[size[1]], [size[0]]], start, 1
    taken = resampled(features, places, (rows, columns))
    along = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    taken[..., :2] = taken[..., :2] @ along.T.astype(np.float32)
    return taken


def resampled(values: F32, places: F64, shape: tuple[int, int], *, repeated: bool = False) -> F32:
    """Resample values (H, W, C) to `shape` under an affine map, low-pass filtered for reductions.

    places: (3, 3) matrix that maps a row vector (column, row, 1) to its position in `values`. repeated: values wrap
        around at their border.
    """
    values_to_places = tuple(np.linalg.inv(places).ravel().tolist())
    whole = oiio.ROI(0, shape[1], 0, shape[0], 0, 1, 0, values.shape[2])
    source = oiio.ImageBuf(np.ascontiguousarray(values))
    beyond = "periodic" if repeated else "clamp"
    found = oiio.ImageBufAlgo.warp(source, values_to_places, "catmull-rom", 0.0, False, beyond, whole)
    return np.asarray(found.get_pixels(oiio.FLOAT), np.float32)
