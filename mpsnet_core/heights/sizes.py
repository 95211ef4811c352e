"""Whether what goes with a normal map is of its size."""

from collections.abc import Sequence

from mpsnet_core.errors import InputError
from mpsnet_core.normals import NormalMap


def check_size(what: str, shape: Sequence[int], normals: NormalMap) -> None:
    """Raises InputError where `what`, an array of `shape` (H, W, ...), is of another size than the normals."""
    height, width = normals.mask.shape
    if tuple(shape[:2]) != (height, width):
        sizes = f"{shape[1]} x {shape[0]} but the normal map is {width} x {height}"
        raise InputError(f"the {what} is {sizes}; they must be the same size")
