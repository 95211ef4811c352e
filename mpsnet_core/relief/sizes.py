"""The sizes that are taken: of what goes with a normal map, and of textures on UVs."""

from collections.abc import Sequence

from mpsnet_core.arrays.sizes import check_same_size
from mpsnet_core.errors import GeometryError
from mpsnet_core.scene.normal_map import NormalMap

# Of a texture on UVs whose heights are looked for; takes about 11 GB.
MAX_SIZE = 8192


def check_size(what: str, shape: Sequence[int], normals: NormalMap) -> None:
    """Raise GeometryError if `what`, an array of `shape` (H, W, ...), is of another size than the normals."""
    check_same_size(f"the {what}", shape[:2], "the normal map", normals.mask.shape)


def check_square(height: int, width: int) -> None:
    """Raise GeometryError if a texture of that size was not baked onto UVs: those lie in a square."""
    if height != width:
        raise GeometryError(
            f"a texture of {width} x {height} texels does not fit UVs; give a square one, as it was baked"
        )
