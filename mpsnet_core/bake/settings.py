"""Padding: texels beyond the UV islands, which filtering and mipmaps sample near the islands' borders."""

from dataclasses import dataclass
from typing import Literal

from mpsnet_core.arrays.rasterize import TextureSize, extend_to_nearest
from mpsnet_core.arrays.resampling import push_pull
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.bake.fill import check_filling
from mpsnet_core.defaults import MARGIN, MAX_STRENGTH, TEXTURE_SIZE
from mpsnet_core.errors import SettingsError, check_choice
from mpsnet_core.scene.texture import Space, check_texture

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


# ----------------------------------------------------------------------------------------------------------------------
# Settings of a bake.


# Sample points per texel, along each side.
SAMPLES = (1, 2, 4)


@dataclass(frozen=True)
class BakeSettings:
    """How a texture is baked.

    Raises
    ------
    SettingsError
        If one of them is out of range.
    """

    size: TextureSize = TEXTURE_SIZE
    """Side of the texture in texels, 1 to 16384, or its width and height."""
    space: Space = "tangent"
    """What the normals are relative to: "tangent" is MikkTSpace, "object" the mesh's own axes."""
    margin: int = MARGIN
    """Texels by which the UV islands are dilated if the padding is "nearest"."""
    padding: Padding = "nearest"
    """What the texture holds beyond the islands: "nearest", "push-pull" or "none", see
    :mod:`mpsnet_core.bake.settings`."""
    samples: int = 1
    """1, 2 or 4. A texel is the mean of those of its samples x samples points that lie on the surface."""
    feather: float = 0.0
    """Distance, as a fraction (0 to 1) of the mesh's size, over which each view fades towards its borders into the
    other views or the mesh's own normals: see :mod:`mpsnet_core.bake.projection`."""
    strength: float = 1.0
    """Factor, 0 to 2, on the slopes relative to the mesh's own normals; 0 removes all detail."""
    fill: bool = False
    """Whether to fill unseen texels smoothly from the relief around them, see :mod:`mpsnet_core.bake.fill`. Not
    available in object space."""

    def __post_init__(self) -> None:
        check_texture(self.size, self.space, self.margin)
        check_choice("padding", self.padding, PADDINGS)
        if self.samples not in SAMPLES:
            raise SettingsError(f"{self.samples} x {self.samples} samples per texel cannot be baked; choose 1, 2 or 4")
        if not 0 <= self.feather <= 1:
            raise SettingsError(f"a feather of {self.feather:g} times the mesh's size cannot be baked; choose 0 to 1")
        if not 0 <= self.strength <= MAX_STRENGTH:
            raise SettingsError(f"a strength of {self.strength:g} cannot be baked; choose 0 to {MAX_STRENGTH:g}")
        if self.fill:
            check_filling(self.space)
