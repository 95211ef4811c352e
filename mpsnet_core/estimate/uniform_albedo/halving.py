"""Halve the resolution of a photo and its normals, and correct the normals by what was found there.

Noise can hide that a surface has one albedo. The mean of four pixels has half the noise.
"""

import numpy as np

from mpsnet_core.arrays.resampling import means_inside, upsampled
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.uniform_albedo.fit import Floats
from mpsnet_core.scene.normal_map import NormalMap

# Rows at a time; even, because pairs of rows are averaged.
ROWS = 256
# Share of the confidence gained at half the resolution that counts at full: finer relief may still be wrong.
SURE = 0.8


def halve(capture: Capture, estimate: NormalMap) -> tuple[Capture, NormalMap]:
    """Both at half the resolution: each pixel is the mean of those inside the mask, and clipped if one of them is."""
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


def add_upsampled_changes(estimate: NormalMap, half: NormalMap, turn: Floats, trust: Floats) -> None:
    """Add the changes found at half the resolution, in place: `turn` (h, w, 3) to the normals and `trust` (h, w) to
    the confidence, bilinearly from the pixels inside the mask of `half`."""
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
