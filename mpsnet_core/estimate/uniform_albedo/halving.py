"""A photo and its normals at half the resolution, and normals mended by what was found there.

Noise hides that all of a surface has one albedo. The mean of four pixels has half of their noise.
"""

import numpy as np

from mpsnet_core.arrays.block_means import means_inside
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.arrays.upsample import upsampled
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.uniform_albedo.fit import Floats
from mpsnet_core.scene.normal_map import NormalMap

# Rows at a time: even, so that a pair of them is in one band.
ROWS = 256
# How much of the confidence that is won at half the resolution counts at full: finer relief may be wrong still.
SURE = 0.8


def halved(capture: Capture, estimate: NormalMap) -> tuple[Capture, NormalMap]:
    """Both at half the resolution, each pixel the mean of those of the mask; clipped where one of them is."""
    shape = tuple(-(-side // 2) for side in capture.mask.shape)
    image = np.zeros((*shape, 3), capture.image.dtype)
    normals = np.zeros((*shape, 4), estimate.vectors.dtype)
    mask, clipped = np.zeros(shape, bool), np.zeros((*shape, 3), bool)
    camera, depth = capture.camera, None if capture.depth is None else np.zeros(shape, np.float32)
    for rows in bands(len(capture.mask), ROWS):
        half, inside = slice(rows.start // 2, -(-rows.stop // 2)), capture.mask[rows]
        image[half], mask[half] = means_inside(capture.image[rows].astype(np.float32, copy=False), inside, 1)
        found = np.concatenate([estimate.vectors[rows], estimate.confidence[rows][..., None]], axis=-1)
        normals[half] = means_inside(found.astype(np.float32, copy=False), inside, 1)[0]
        clipped[half] = means_inside(capture.saturated_in(rows).astype(np.float32), inside, 1)[0] > 0
        if depth is not None and capture.depth is not None:
            known = np.where(inside, capture.depth[rows], np.float32(0))[..., None]
            depth[half] = means_inside(known, inside, 1)[0][..., 0]
    if camera is not None:
        camera = camera.cropped(0, 0, camera.width, camera.height, 2)
    small = Capture(image, mask, capture.rig, camera, depth=depth, clipped=clipped)
    return small, NormalMap(normals[..., :3], mask, normals[..., 3], in_place=True)


def mend(estimate: NormalMap, half: NormalMap, turn: Floats, trust: Floats) -> None:
    """Add what changed at half the resolution, in place: `turn` (h, w, 3) of the normals and `trust` (h, w) of the
    confidence, bilinear between the pixels of the mask of `half`."""
    if not (turn.any() or trust.any()):
        return
    change = np.concatenate([turn, trust[..., None], half.mask[..., None]], axis=-1, dtype=np.float32)
    height, width = estimate.mask.shape
    for rows in bands(height, ROWS):
        full = upsampled(change, (2 * len(change), 2 * change.shape[1]), rows)[:, :width]
        full = full[..., :4] / np.maximum(full[..., 4:], np.float32(1e-3))
        mask, vectors, confidence = estimate.mask[rows], estimate.vectors[rows], estimate.confidence[rows]
        vectors[mask] = normalised(vectors + full[..., :3])[mask]
        confidence[mask] = np.clip(confidence + SURE * full[..., 3], 0, 1)[mask]
