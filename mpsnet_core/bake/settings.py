"""Settings of a bake."""

from dataclasses import dataclass

from mpsnet_core.arrays.rasterize import TextureSize
from mpsnet_core.bake.fill import check_filling
from mpsnet_core.bake.padding import PADDINGS, Padding
from mpsnet_core.defaults import MARGIN, MAX_STRENGTH, TEXTURE_SIZE
from mpsnet_core.errors import SettingsError, check_choice
from mpsnet_core.scene.texture import Space, check_texture

# Sample points per texel, along each side.
SAMPLES = (1, 2, 4)


@dataclass(frozen=True)
class BakeSettings:
    """How a texture is baked.

    Parameters
    ----------
    size : int or (int, int)
        Side of the texture in texels, 1 to 16384, or its width and height.
    space : {"tangent", "object"}
        "tangent" is MikkTSpace, "object" the mesh's own axes.
    margin : int
        Texels by which the UV islands are dilated if the padding is "nearest".
    padding : {"nearest", "push-pull", "none"}
        What the texture holds beyond the islands: see :mod:`mpsnet_core.bake.padding`.
    samples : {1, 2, 4}
        A texel is the mean of those of its samples x samples points that lie on the surface.
    feather : float
        Distance, as a fraction (0 to 1) of the mesh's size, over which each view fades towards its borders into the
        other views or the mesh's own normals: see :mod:`mpsnet_core.bake.feather`.
    strength : float
        Factor, 0 to 2, on the slopes relative to the mesh's own normals; 0 removes all detail.
    fill : bool
        Whether to fill unseen texels smoothly from the relief around them, see :mod:`mpsnet_core.bake.fill`. Not
        available in object space.

    Raises
    ------
    SettingsError
        If one of them is out of range.
    """

    size: TextureSize = TEXTURE_SIZE
    space: Space = "tangent"
    margin: int = MARGIN
    padding: Padding = "nearest"
    samples: int = 1
    feather: float = 0.0
    strength: float = 1.0
    fill: bool = False

    def __post_init__(self) -> None:
        check_texture(self.size, self.space, self.margin)
        check_choice("padding", self.padding, PADDINGS)
        if self.samples not in SAMPLES:
            raise SettingsError(f"{self.samples} x {self.samples} samples a texel cannot be baked; choose 1, 2 or 4")
        if not 0 <= self.feather <= 1:
            raise SettingsError(f"a feather of {self.feather:g} times the mesh's size cannot be baked; choose 0 to 1")
        if not 0 <= self.strength <= MAX_STRENGTH:
            raise SettingsError(f"a strength of {self.strength:g} cannot be baked; choose 0 to {MAX_STRENGTH:g}")
        if self.fill:
            check_filling(self.space)
