"""Downsampling by block means."""

import numpy as np

from mpsnet_core.arrays.types import F32, Bools, Floats


def block_means(pixels: Floats, factor: int) -> F32:
    """(⌈H/factor⌉, ⌈W/factor⌉, C) means of blocks of factor x factor pixels. Non-finite values count as 0."""
    height, width, channels = pixels.shape
    starts = np.arange(0, width, factor)
    counts = np.diff([*starts, width])[:, None]
    small = np.empty((-(-height // factor), len(starts), channels), np.float32)
    for row in range(len(small)):
        rows = np.nan_to_num(pixels[row * factor : (row + 1) * factor], posinf=0, neginf=0)
        small[row] = np.add.reduceat(rows.mean(axis=0, dtype=np.float32), starts, axis=0) / counts
    return small


def means_inside(image: F32, mask: Bools, halvings: int) -> tuple[F32, Bools]:
    """Means (h, w, C) of an image (H, W, C) over a mask (H, W), in blocks of 2**halvings pixels on a side.

    Also returns (h, w) which blocks contain pixels of the mask; the mean of others is 0. The image must be finite
    outside the mask, too.
    """
    if halvings == 0:
        return np.where(mask[..., None], image, np.float32(0)), mask
    total = np.concatenate([image, np.ones((*mask.shape, 1), np.float32)], axis=-1) * mask[..., None]
    for _ in range(halvings):
        total = np.pad(total, [(0, total.shape[0] % 2), (0, total.shape[1] % 2), (0, 0)])
        total = total[0::2] + total[1::2]
        total = total[:, 0::2] + total[:, 1::2]
    return total[..., :-1] / np.maximum(total[..., -1:], 1), total[..., -1] > 0
