"""Files of point pairs: pixels of a photo and the corresponding points on a mesh."""

import json
import os

import numpy as np

from mpsnet_core.errors import FormatError
from mpsnet_core.estimate.alignment.pose import Floats
from mpsnet_core.io.files import check_small, existing_file

MAX_PAIRS = 1000
FARTHEST = 1e9
_EXAMPLE = '{"pairs": [{"pixel": [x, y], "point": [X, Y, Z]}, ...]}'


def read_pairs(path: str | os.PathLike[str]) -> tuple[Floats, Floats]:
    """Read a JSON file ``{"pairs": [{"pixel": [x, y], "point": [X, Y, Z]}, ...]}``.

    Returns
    -------
    pixels
        (N, 2) from the photo's top left corner, x to the right and y down.
    points
        (N, 3) in the mesh file's own axes.

    Raises
    ------
    FileError
        If there is no such file.
    FormatError
        If it is not such a file.
    """
    path = existing_file(path, "file of pairs")
    check_small(path, "no file of pairs")
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError):
        raise FormatError(f"{path} is not valid JSON; write it as {_EXAMPLE}") from None
    pairs = data.get("pairs") if isinstance(data, dict) else None
    if not isinstance(pairs, list) or not 1 <= len(pairs) <= MAX_PAIRS:
        raise FormatError(f"{path} holds no list of 1 to {MAX_PAIRS} pairs; write it as {_EXAMPLE}")
    found = []
    for number, pair in enumerate(pairs, 1):
        if not isinstance(pair, dict) or set(pair) != {"pixel", "point"}:
            raise FormatError(f'{path}: pair {number} is not made of "pixel" and "point"; write it as {_EXAMPLE}')
        found.append([*_numbers(path, number, pair, "pixel", 2), *_numbers(path, number, pair, "point", 3)])
    values = np.array(found)
    return values[:, :2], values[:, 2:]


def _numbers(path: os.PathLike[str], number: int, pair: dict[str, object], key: str, count: int) -> list[float]:
    values = pair[key]
    right = isinstance(values, list) and len(values) == count
    if not right or not all(type(value) in (int, float) and abs(value) <= FARTHEST for value in values):  # type: ignore[attr-defined]
        raise FormatError(f'{path}: the "{key}" of pair {number} is not {count} numbers up to {FARTHEST:g}; correct it')
    return [float(value) for value in values]  # type: ignore[attr-defined]
