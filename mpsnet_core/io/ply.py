"""PLY files: values of their vertices, and polygons with any number of corners."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import FormatError

# By the type names of both versions of the format.
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
MAX_HEAD = 1 << 20
BROKEN = "it cannot be read as PLY ({}); export it again"


# A name, a type, and the type of a list's length, "" for scalars.
_Column = tuple[str, str, str]


@dataclass
class _Element:
    """An element of a file, such as "vertex", with its count and its properties."""

    count: int
    columns: list[_Column] = field(default_factory=list)


@dataclass(frozen=True)
class Values:
    """The values of an element. numbers: by property name, (N,), lists concatenated. lengths: (N,) of each list."""

    numbers: dict[str, NDArray[np.float64]]
    lengths: dict[str, NDArray[np.int64]]

    def columns(self, names: Sequence[str]) -> NDArray[np.float64] | None:
        """(N, K) the properties of these names as columns, None if one is missing."""
        if any(name not in self.numbers or name in self.lengths for name in names):
            return None
        return np.stack([self.numbers[name] for name in names], axis=-1)


NOTHING = Values({}, {})
NO_LENGTHS = np.empty(0, np.int64)


def read_ply(path: Path) -> dict[str, Values]:
    """The values of a file's elements, such as "vertex" and "face". Raises FormatError if it is damaged."""
    data = path.read_bytes()
    head, end, _ = data[:MAX_HEAD].partition(b"end_header")
    line_end = data.find(b"\n", len(head))
    if not (data.startswith(b"ply") and end and line_end >= 0):
        raise FormatError(BROKEN.format("it has no header"))
    try:
        order, elements = _header(head.decode("latin-1"))
        at = line_end + 1
        if not order:
            data, at, order = np.array([float(word) for word in data[at:].split()]).tobytes(), 0, "="
            elements = {name: _of_text(element) for name, element in elements.items()}
        found = {}
        for name, element in elements.items():
            parts = list(_parts(data, at, element, order))
            at += sum(part.nbytes for part in parts)
            found[name] = _values(parts, element)
    except (ValueError, OverflowError, KeyError, IndexError) as error:
        raise FormatError(BROKEN.format(str(error)[:99])) from None
    return found


def _header(text: str) -> tuple[str, dict[str, _Element]]:
    """The byte order, "" for text, and the elements by name."""
    order, elements, last = None, dict[str, _Element](), _Element(0)
    for line in text.splitlines()[1:]:
        match line.split():
            case ["format", kind, _]:
                order = _ORDERS[kind]
            case ["element", name, count]:
                elements[name] = last = _Element(int(count))
            case ["property", "list", length, kind, name]:
                last.columns.append((name, _TYPES[kind], _TYPES[length]))
            case ["property", kind, name]:
                last.columns.append((name, _TYPES[kind], ""))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"the line {line[:50]!r}")
    if order is None:
        raise ValueError("no format")
    return order, elements


def _of_text(element: _Element) -> _Element:
    """The element of a text file, in which every value is a word."""
    return _Element(element.count, [(name, "f8", length and "f8") for name, _, length in element.columns])


def _parts(data: bytes, at: int, element: _Element, order: str) -> Iterator[NDArray[np.void]]:
    """Yield rows of an element, in runs with lists of equal length. Raises ValueError if the file is truncated."""
    columns = tuple(element.columns)
    left, ahead = element.count if columns else 0, 1
    while left > 0:
        kind = _layout(columns, order, _lengths(data, at, columns, order))
        rows = np.frombuffer(data, kind, min(left, ahead, max((len(data) - at) // kind.itemsize, 1)), at)
        count = len(rows)
        for name in kind.names or () if count > 1 else ():
            if name.startswith("length"):
                unlike = rows[name][:, 0] != rows[name][0, 0]
                count = min(count, int(unlike.argmax())) if unlike.any() else count
        ahead = 2 * count
        yield rows[:count]
        at, left = at + count * kind.itemsize, left - count


def _lengths(data: bytes, at: int, columns: tuple[_Column, ...], order: str) -> tuple[int, ...]:
    """Lengths of the lists in the row that starts at `at`; 1 for scalars."""
    lengths = []
    for _, kind, length in columns:
        count = 1
        if length:
            count = int(np.frombuffer(data, order + length, 1, at)[0])
            if not 0 <= count <= len(data):
                raise ValueError(f"a list of {count}")
            at += int(length[1])
        at += count * int(kind[1])
        lengths.append(count)
    return tuple(lengths)


@lru_cache(1024)
def _layout(columns: tuple[_Column, ...], order: str, lengths: tuple[int, ...]) -> np.dtype[np.void]:
    """The dtype of rows with lists of these lengths."""
    fields: list[tuple[str, str, tuple[int]]] = []
    for number, ((_, kind, length), count) in enumerate(zip(columns, lengths, strict=True)):
        fields += [(f"length{number}", order + length, (1,))] if length else []
        fields.append((f"value{number}", order + kind, (count,)))
    return np.dtype(fields)


def _values(parts: list[NDArray[np.void]], element: _Element) -> Values:
    numbers, lengths = {}, {}
    for number, (name, _, length) in enumerate(element.columns if parts else ()):
        numbers[name] = np.concatenate([part[f"value{number}"].reshape(-1) for part in parts]).astype(np.float64)
        if length:
            counts = [part[f"length{number}"].reshape(-1) for part in parts]
            lengths[name] = np.concatenate(counts).astype(np.int64)
    return Values(numbers, lengths)
