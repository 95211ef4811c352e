"""Padding: what a texture holds beyond its UV islands, where filtering and mipmaps reach over their borders."""

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.bands import bands
from mpsnet_core.normals import normalised
from mpsnet_core.surface.raster import grown
from mpsnet_core.surface.upsample import upsampled

Padding = Literal["nearest", "push-pull", "none"]
PADDINGS: tuple[Padding, ...] = ("nearest", "push-pull", "none")


def padded(
    vectors: NDArray[np.float32], covered: NDArray[np.bool_], padding: Padding, margin: int
) -> NDArray[np.float32]:
    """Unit vectors (S, S, 3) with texels beyond the covered ones filled; those that are covered stay as they are.

    padding: "nearest" continues the islands by `margin` texels with their nearest texel's vector; "push-pull" fills
    the whole texture, smoothly; "none" leaves it.
    """
    filled: dict[Padding, Callable[[], NDArray[np.float32]]] = {
        "nearest": lambda: grown(vectors, covered, margin),
        "push-pull": lambda: push_pull(vectors, covered),
        "none": lambda: vectors,
    }
    return filled[padding]()


def push_pull(vectors: NDArray[np.float32], covered: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Unit vectors (H, W, 3) whose texels that are not covered are filled from those around them, near and far.

    The pull halves the picture again and again, each texel the mean of the four below it that hold something; the push
    goes back and gives what is missing from the coarser picture, linear between its texels. After Gortler et al., "The
    Lumigraph" (1996), section 4.2, with full weight for a texel that holds anything.
    """
    levels = [(vectors, covered)]
    while not levels[-1][1].all() and levels[-1][1].size > 1:
        levels.append(_halved(*levels[-1]))
    coarse = levels.pop()[0]
    for fine, holds in reversed(levels):
        out = fine.copy()
        for rows in bands(len(fine)):
            missing = ~holds[rows]
            out[rows][missing] = normalised(upsampled(coarse, fine.shape, rows)[missing])
        coarse = out
    return coarse


def _halved(values: NDArray[np.float32], holds: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """A picture of half the height and width, rounded up: unit means of 2 x 2 texels, of those that hold something."""
    height, width = holds.shape
    small = np.zeros((-(-height // 2), -(-width // 2), 3), np.float32)
    held = np.zeros(small.shape[:2], bool)
    for down in (0, 1):
        for right in (0, 1):
            part = holds[down::2, right::2]
            place = (slice(0, part.shape[0]), slice(0, part.shape[1]))
            small[place] += np.where(part[..., None], values[down::2, right::2], 0)
            held[place] |= part
    return np.where(held[..., None], normalised(small), 0).astype(np.float32), held
