"""Connected components: what hangs together, of anything that has numbers and neighbours."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def connected(count: int, a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    """(count,) the least number in each one's connected component, given the edges a - b."""
    label = np.arange(count)
    while True:
        least = np.minimum(label[a], label[b])
        if (label[a] == least).all() and (label[b] == least).all():
            return label
        np.minimum.at(label, a, least)
        np.minimum.at(label, b, least)
        label = label[label]


def spots(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int64], int]:
    """(H, W) the number of the spot (0 and up) that each True pixel of `mask` belongs to, -1 elsewhere; and how many.

    Pixels hang together by their sides and corners.
    """
    number = np.full(mask.shape, -1, np.int64)
    number[mask] = np.arange(mask.sum())
    pairs: list[Any] = []
    for here, there in (
        (number[:, :-1], number[:, 1:]),
        (number[:-1], number[1:]),
        (number[:-1, :-1], number[1:, 1:]),
        (number[:-1, 1:], number[1:, :-1]),
    ):
        both = (here >= 0) & (there >= 0)
        pairs.append(np.stack([here[both], there[both]]))
    a, b = np.concatenate(pairs, axis=1)
    names, label = np.unique(connected(int(mask.sum()), a, b), return_inverse=True)
    number[mask] = label.reshape(-1)
    return number, len(names)
