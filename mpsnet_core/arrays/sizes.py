"""The sizes of pictures that belong together."""

from collections.abc import Sequence

from mpsnet_core.errors import GeometryError

SAME_SIZE = "they must be the same size"
SAME_CAMERA = "take both with the same camera, held alike"


def size(shape: Sequence[int]) -> str:
    """Width and height of an array of `shape` (H, W, ...), as messages have them."""
    return f"{shape[1]} x {shape[0]}"


def check_same_size(
    name: str, shape: Sequence[int], other: str, expected: Sequence[int], remedy: str = SAME_SIZE
) -> None:
    """Raises GeometryError where two arrays differ in shape; `name` and `other` name them in the sentence."""
    if tuple(shape) != tuple(expected):
        raise GeometryError(f"{name} is {size(shape)} but {other} is {size(expected)}; {remedy}")
