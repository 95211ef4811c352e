"""Checks of the sizes of images that belong together."""

from collections.abc import Sequence

from mpsnet_core.errors import GeometryError

SAME_SIZE = "they must be the same size"
SAME_CAMERA = "take both with the same camera, held the same way"


def size(shape: Sequence[int]) -> str:
    """Width and height of an array of `shape` (H, W, ...), as text for messages."""
    return f"{shape[1]} x {shape[0]}"


def check_same_size(name: str, shape: Sequence[int], other: str, expected: Sequence[int], fix: str = SAME_SIZE) -> None:
    """Raise GeometryError if two arrays differ in shape. The message calls them `name` and `other`.

    >>> check_same_size("the mask", (2, 3, 3), "the photo", (2, 3))
    Traceback (most recent call last):
    mpsnet_core.errors.GeometryError: the mask is (2, 3, 3) but the photo is (2, 3); they must be the same size
    """
    shape, expected = tuple(shape), tuple(expected)
    if shape != expected:
        by_shape = len(shape) < 2 or shape[:2] == expected[:2]
        found, wanted = map(str if by_shape else size, (shape, expected))
        raise GeometryError(f"{name} is {found} but {other} is {wanted}; {fix}")
