"""Padding: texels beyond the UV islands, which filtering and mipmaps sample near the islands' borders."""

from typing import Literal

from mpsnet_core.arrays.push_pull import push_pull
from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.unit_vectors import normalised

Padding = Literal["nearest", "push-pull", "none"]
PADDINGS: tuple[Padding, ...] = ("nearest", "push-pull", "none")


def padded(vectors: F32, covered: Bools, padding: Padding, margin: int) -> F32:
    """Unit vectors (H, W, 3) with the texels outside the covered ones filled. Covered texels are unchanged.

    It may fill and return the given array itself: a copy of a large texture takes much memory.

    padding: "nearest" dilates the islands by `margin` texels, each with the vector of its nearest covered texel;
    "push-pull" fills the whole texture smoothly; "none" leaves it unchanged.
    """
    if padding == "nearest":
        return extend_to_nearest(vectors, covered, margin, in_place=True)
    return _filled(vectors, covered) if padding == "push-pull" else vectors


def _filled(vectors: F32, covered: Bools) -> F32:
    if covered.all():
        return vectors
    whole = push_pull(vectors, covered)
    for rows in bands(len(whole)):
        missing = ~covered[rows]
        whole[rows][missing] = normalised(whole[rows][missing])
    return whole
