"""Checks of the sizes of arrays that go with a normal map, and of textures on UVs."""

from collections.abc import Sequence

from mpsnet_core.arrays.sizes import check_same_size
from mpsnet_core.errors import GeometryError
from mpsnet_core.scene.normal_map import NormalMap

# Largest side of a texture on UVs that is integrated to heights; takes about 11 GB.
MAX_SIZE = 8192


def check_size(what: str, shape: Sequence[int], normals: NormalMap) -> None:
    """Raise GeometryError if an array of `shape` (H, W, ...) and the normals differ in size. what: its name."""
    check_same_size(f"the {what}", shape[:2], "the normal map", normals.mask.shape)


def check_square(height: int, width: int) -> None:
    """Raise GeometryError if a texture on UVs is not square."""
    if height != width:
        raise GeometryError(
            f"heights on UVs need a square texture, not one of {width} x {height} texels; bake it square"
        )
