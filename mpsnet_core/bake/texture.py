"""Texture: baked normals on a mesh's UVs, ready for artists."""

import os
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.io.images import write_bands
from mpsnet_core.scene.normal_map import Convention, encode

Space = Literal["tangent", "object"]
SPACES: tuple[Space, ...] = ("tangent", "object")


@dataclass(frozen=True)
class Texture:
    """Normals for every texel.

    vectors: (S, S, 3) float32 unit vectors in `space`, row 0 at v = 1; flat (+z) where there is no surface.
    seen: (S, S) bool, texels that at least one view saw. covered: (S, S) bool, texels on the surface.
    space: "tangent" (MikkTSpace) or "object".
    views: (S, S) uint16, how many views saw each texel. spread: (S, S) float32, degrees that their normals lie apart:
    the angle whose cosine is the weighted mean cosine between them and their mean; 0 where fewer than two saw it.
    colours: (S, S, 4) float32, where the views have colours: linear, and 1 where some view tells them, else 0.
    """

    vectors: NDArray[np.float32]
    seen: NDArray[np.bool_]
    covered: NDArray[np.bool_]
    space: Space
    views: NDArray[np.uint16] | None = None
    spread: NDArray[np.float32] | None = None
    colours: NDArray[np.float32] | None = None

    @property
    def seen_fraction(self) -> float:
        """The share of the surface's texels that some view saw."""
        return float(self.seen.sum() / max(self.covered.sum(), 1))


def write_texture(
    path: str | os.PathLike[str],
    texture: Texture,
    *,
    convention: Convention = "opengl",
    bits: int | None = None,
    description: str | None = None,
) -> None:
    """Write the texture as colours 0.5 + 0.5 n: PNG or TIFF (16 bits unless told) or EXR (float). Non-Color.

    description: a line of text to be kept in the file, see :func:`mpsnet_core.io.images.write_bands`.
    """
    height, width, _ = texture.vectors.shape
    write_bands(
        path,
        (height, width, 3),
        lambda rows: encode(texture.vectors[rows], convention),
        bits=bits,
        description=description,
    )
