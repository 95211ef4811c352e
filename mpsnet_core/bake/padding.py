"""Padding: what a texture holds beyond its UV islands, where filtering and mipmaps reach over their borders."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.push_pull import push_pull
from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.unit_vectors import normalised

Padding = Literal["nearest", "push-pull", "none"]
PADDINGS: tuple[Padding, ...] = ("nearest", "push-pull", "none")


def padded(
    vectors: NDArray[np.float32], covered: NDArray[np.bool_], padding: Padding, margin: int
) -> NDArray[np.float32]:
    """Unit vectors (S, S, 3) with texels beyond the covered ones filled; those that are covered stay as they are.

    The array that is given may be the one that is filled and returned: a copy of a large texture takes much memory.

    padding: "nearest" continues the islands by `margin` texels with their nearest texel's vector; "push-pull" fills
    the whole texture, smoothly; "none" leaves it.
    """
    if padding == "nearest":
        return extend_to_nearest(vectors, covered, margin, in_place=True)
    return _filled(vectors, covered) if padding == "push-pull" else vectors


def _filled(vectors: NDArray[np.float32], covered: NDArray[np.bool_]) -> NDArray[np.float32]:
    if covered.all():
        return vectors
    whole = push_pull(vectors, covered)
    for rows in bands(len(whole)):
        missing = ~covered[rows]
        whole[rows][missing] = normalised(whole[rows][missing])
    return whole
