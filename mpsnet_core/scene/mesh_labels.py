"""Labels: which of a mesh's triangles are of which material, or of which object."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import InputError


@dataclass(frozen=True)
class Labels:
    """A name for each of T triangles.

    names: distinct ones. number: (T,) int32, which of the names each triangle has.

    Raises InputError where a name comes twice or the numbers name none.
    """

    names: tuple[str, ...]
    number: NDArray[np.int32]

    def __post_init__(self) -> None:
        number = np.asarray(self.number)
        if number.ndim != 1 or number.dtype.kind not in "iu":
            raise InputError("labels need one whole number for each triangle; export the mesh again")
        if len(number) and not (number.min() >= 0 and number.max() < len(self.names)):
            raise InputError(
                f"labels are numbered up to {number.max()}, but have {len(self.names)} names; export again"
            )
        if len(set(self.names)) < len(self.names):
            raise InputError("two labels have the same name; export the mesh again")
        object.__setattr__(self, "names", tuple(map(str, self.names)))
        object.__setattr__(self, "number", number.astype(np.int32))

    def __len__(self) -> int:
        return len(self.number)


def labels_of_runs(runs: Iterable[tuple[str, int]]) -> Labels:
    """Labels of a name for so many triangles, then another for so many, and so on; a name may come again."""
    names: dict[str, int] = {}
    numbers, counts = [], []
    for name, count in runs:
        if count:
            numbers.append(names.setdefault(name, len(names)))
            counts.append(count)
    return Labels(tuple(names), np.repeat(np.array(numbers, np.int32), counts))
