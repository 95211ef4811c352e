"""Connected components: what hangs together, of anything that has numbers and neighbours."""

import numpy as np
from numpy.typing import NDArray


def connected(count: int, one: NDArray[np.int64], other: NDArray[np.int64]) -> NDArray[np.int64]:
    """(count,) the least number in each one's connected component, given the pairs (one, other) that hang together.

    Union-find, all pairs at a time.
    """
    root = np.arange(count)
    while True:
        a, b = root[one], root[other]
        apart = a != b
        if not apart.any():
            return root
        one, other = one[apart], other[apart]
        a, b = a[apart], b[apart]
        np.minimum.at(root, np.maximum(a, b), np.minimum(a, b))
        while not np.array_equal(root, root[root]):
            root = root[root]
