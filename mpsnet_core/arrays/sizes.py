"""Checks of the sizes of images that belong together, and of arrays of a few numbers."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.types import F64
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


def finite_array(value: ArrayLike, shape: tuple[int, ...], what: str, most: float) -> F64:
    """A copy of `value` as an array of `shape`. Raises GeometryError if it is none, or a number exceeds `most`."""
    try:
        given = np.array(value)
        array = given.astype(np.float64) if given.dtype.kind in "iuf" else np.empty(0)
    except (TypeError, ValueError, OverflowError):
        array = np.empty(0)
    if array.shape != shape or not np.isfinite(array).all():
        raise GeometryError(f"{what} must be {' by '.join(map(str, shape))} finite numbers")
    if (np.abs(array) > most).any():
        raise GeometryError(f"{what} holds a number beyond {most:g}; correct it")
    return array
