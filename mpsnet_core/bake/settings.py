"""Baking: how a texture is baked, told once for all who bake one."""

from dataclasses import dataclass

from mpsnet_core.bake.padding import PADDINGS, Padding
from mpsnet_core.bake.texture import SPACES, Space
from mpsnet_core.defaults import MARGIN, MAX_STRENGTH, MAX_TEXTURE_SIZE, TEXTURE_SIZE
from mpsnet_core.errors import InputError, check_choice

# Points a texel, along each side.
SAMPLES = (1, 2, 4)


@dataclass(frozen=True)
class Baking:
    """How a texture is baked.

    size: its side in texels. space: "tangent" is MikkTSpace, "object" the mesh's own axes. margin: texels that the
    islands' borders are grown by at most, where the padding is "nearest"; :mod:`mpsnet_core.bake.padding` has the
    others. samples: 1, 2 or 4; a texel is the mean of samples x samples points in it, those that lie on the surface.
    feather: a share of the mesh's size; over this distance each view fades out towards its borders
    (:mod:`mpsnet_core.bake.feather`), into the others or into the mesh's own normals. strength: what the slopes
    against the mesh's own normals are multiplied by; 0 leaves nothing of the views.

    Raises InputError where one of them is out of range.
    """

    size: int = TEXTURE_SIZE
    space: Space = "tangent"
    margin: int = MARGIN
    padding: Padding = "nearest"
    samples: int = 1
    feather: float = 0.0
    strength: float = 1.0

    def __post_init__(self) -> None:
        check_texture(self.size, self.space, self.margin)
        check_choice("padding", self.padding, PADDINGS)
        if self.samples not in SAMPLES:
            raise InputError(f"{self.samples} x {self.samples} samples a texel cannot be baked; choose 1, 2 or 4")
        if not 0 <= self.feather <= 1:
            raise InputError(f"a feather of {self.feather:g} times the mesh's size cannot be baked; choose 0 to 1")
        check_strength(self.strength)


def check_texture(size: int, space: str, margin: int) -> None:
    """Raises InputError where no texture has that size, space or margin."""
    if not 1 <= size <= MAX_TEXTURE_SIZE:
        raise InputError(f"a texture of {size} texels cannot be baked; choose a size from 1 to {MAX_TEXTURE_SIZE}")
    if not 0 <= margin <= MAX_TEXTURE_SIZE:
        raise InputError(f"islands cannot be grown by a margin of {margin} texels; choose 0 to {MAX_TEXTURE_SIZE}")
    check_choice("space", space, SPACES)


def check_strength(strength: float) -> None:
    """Raises InputError where no detail of that strength can be baked."""
    if not 0 <= strength <= MAX_STRENGTH:
        raise InputError(f"a strength of {strength:g} cannot be baked; choose 0 to {MAX_STRENGTH:g}")
