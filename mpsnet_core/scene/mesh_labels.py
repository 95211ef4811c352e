"""Labels: the material or the object of each of a mesh's triangles."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.types import I32
from mpsnet_core.errors import GeometryError


@dataclass(frozen=True, eq=False)
class Labels:
    """A name for each of T triangles.

    Raises
    ------
    GeometryError
        If a name occurs twice or an index is out of range.

    Examples
    --------
    >>> labels = Labels(("glaze", "clay"), np.array([0, 0, 1]))
    >>> [labels.names[number] for number in labels.number]
    ['glaze', 'glaze', 'clay']
    """

    names: tuple[str, ...]
    """Distinct names."""
    number: I32
    """(T,) int32. Each triangle's index into `names`."""

    def __post_init__(self) -> None:
        number = np.asarray(self.number)
        if number.ndim != 1 or number.dtype.kind not in "iu":
            raise GeometryError("labels need one whole number for each triangle; export the mesh again")
        if len(number) and not (number.min() >= 0 and number.max() < len(self.names)):
            raise GeometryError(
                f"labels are numbered up to {number.max()}, but have {len(self.names)} names; export again"
            )
        if len(set(self.names)) < len(self.names):
            raise GeometryError("two labels have the same name; export the mesh again")
        object.__setattr__(self, "names", tuple(map(str, self.names)))
        object.__setattr__(self, "number", number.astype(np.int32))

    def __len__(self) -> int:
        return len(self.number)


def labels_of_runs(runs: Iterable[tuple[str, int]]) -> Labels:
    """Labels from run lengths: names with a number of triangles each. Names may repeat."""
    names: dict[str, int] = {}
    numbers, counts = [], []
    for name, count in runs:
        if count:
            numbers.append(names.setdefault(name, len(names)))
            counts.append(count)
    return Labels(tuple(names), np.repeat(np.array(numbers, np.int32), counts))
