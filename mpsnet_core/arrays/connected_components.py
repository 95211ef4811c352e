"""Connected components of graphs."""

import numpy as np

from mpsnet_core.arrays.types import I64


def connected(count: int, one: I64, other: I64) -> I64:
    """(count,) the smallest node of each node's connected component, given the edges (one, other).

    Union-find, all edges at a time.

    >>> connected(5, np.array([4, 1]), np.array([2, 2])).tolist()
    [0, 1, 1, 3, 1]
    """
    root = np.arange(count)
    while True:
        a, b = root[one], root[other]
        separate = a != b
        if not separate.any():
            return root
        one, other = one[separate], other[separate]
        a, b = a[separate], b[separate]
        np.minimum.at(root, np.maximum(a, b), np.minimum(a, b))
        while not np.array_equal(root, root[root]):
            root = root[root]
