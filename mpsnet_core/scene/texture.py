"""Texture: normals baked onto a mesh's UVs."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.rasterize import TextureSize, width_and_height
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.defaults import MAX_TEXTURE_SIZE, Convention
from mpsnet_core.errors import SettingsError, check_choice
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.shown import Shown
from mpsnet_core.scene.normal_encoding import encode, write_vectors

Space = Literal["tangent", "object"]
SPACES: tuple[Space, ...] = ("tangent", "object")


@dataclass(frozen=True, eq=False, repr=False)
class Texture(Shown):
    """Baked normals for every texel."""

    array_name: ClassVar[str] = "vectors"

    vectors: F32
    """(H, W, 3) float32. Unit vectors in `space`, row 0 at v = 1; +z where there is no surface."""
    seen: Bools
    """(H, W) bool. Texels that at least one view sees."""
    covered: Bools
    """(H, W) bool. Texels with surface under them."""
    space: Space
    """What the normals are relative to: "tangent" is MikkTSpace, "object" the mesh's own axes."""
    views: NDArray[np.uint16] | None = None
    """(H, W) uint16. Number of views that see each texel."""
    spread: F32 | None = None
    """(H, W) float32. Spread of the views' normals in degrees: the angle whose cosine is the weighted mean cosine
    between each and their mean; 0 where fewer than two views see the texel."""
    colours: F32 | None = None
    """(H, W, 4) float32. If the views have colours: linear RGB, and 1 where some view has a colour, else 0."""
    filled: Bools | None = None
    """(H, W) bool. Unseen texels that were filled from the seen ones around them; None without filling."""

    def facts(self) -> str:
        return f"{self.space} space, {self.seen_fraction:.1%} of its surface seen"

    def picture(self, step: int = 1) -> F32:
        return encode(self.vectors[::step, ::step])

    def rows(self, rows: slice) -> "Texture":
        """A view of some of its rows, which shares memory with it."""
        found = vars(self).items()
        arrays: dict[str, Any] = {name: one[rows] for name, one in found if isinstance(one, np.ndarray)}
        return replace(self, **arrays)

    @property
    def seen_fraction(self) -> float:
        """The fraction of the surface's texels that some view saw."""
        return int(self.seen.sum()) / max(int(self.covered.sum()), 1)

    @property
    def filled_fraction(self) -> float | None:
        """The fraction of the surface's texels that were filled, None without filling."""
        return None if self.filled is None else float(self.filled.sum() / max(self.covered.sum(), 1))


@takes_files
def write_texture(
    path: AnyPath,
    texture: Texture,
    *,
    convention: Convention = "opengl",
    bits: int | None = None,
    description: str | None = None,
) -> None:
    """Write the texture as colours, Non-Color: see :func:`mpsnet_core.scene.normal_encoding.write_vectors`.

    Parameters
    ----------
    path : str or PathLike
        PNG or TIFF (16 bits by default) or EXR (float).
    texture : Texture
        The normals.
    convention : {"opengl", "directx"}
        Whether green points up or down.
    bits : int, optional
        Bits per channel; by default those of the format.
    description : str, optional
        A line of text stored in the file, see :func:`mpsnet_core.io.image_writing.write_bands`.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    write_vectors(path, texture.vectors, convention=convention, bits=bits, description=description)


def check_texture(size: TextureSize, space: str, margin: int) -> None:
    """Raise SettingsError if the size, space or margin of a texture is invalid."""
    for side in width_and_height(size):
        if not 1 <= side <= MAX_TEXTURE_SIZE:
            raise SettingsError(f"a texture has no side of {side} texels; choose a size from 1 to {MAX_TEXTURE_SIZE}")
    if not 0 <= margin <= MAX_TEXTURE_SIZE:
        raise SettingsError(f"islands cannot be grown by a margin of {margin} texels; choose 0 to {MAX_TEXTURE_SIZE}")
    check_choice("space", space, SPACES)
