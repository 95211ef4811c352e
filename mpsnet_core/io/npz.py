"""Arrays from untrusted ``.npz`` files."""

import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import FormatError

# Raised by NumPy and zipfile for damaged files; RuntimeError for encrypted ones.
_UNREADABLE = (
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    TypeError,
    ValueError,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


# A file may unpack to so many times its size, and so many bytes beside that: zeros pack to a thousandth.
_RATIO, _FREE = 64, 64 << 20


def most_bytes(path: Path, most: int) -> int:
    """How many bytes a file may unpack to that may be as large as `most`: not many times as many as it has."""
    return min(most, _FREE + _RATIO * path.stat().st_size)


def read_arrays(path: Path, most: int) -> dict[str, NDArray[Any]]:
    """All arrays of an ``.npz`` file by their names. most: limit of the unpacked size in bytes.

    Raises FormatError, without the file's name, where it is damaged, larger, or has arrays of objects.
    """
    try:
        most = most_bytes(path, most)
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size <= most:
            with np.load(path, allow_pickle=False) as data:
                arrays = {name: data[name] for name in data.files}
    except _UNREADABLE as error:
        raise FormatError(f"it cannot be read ({error}); export it again") from None
    if size > most:
        raise FormatError(
            f"it unpacks to {size / (1 << 20):.0f} MiB, more than the limit of {most >> 20}; reduce it first"
        )
    return {name: _plain(name, array) for name, array in arrays.items() if isinstance(array, np.ndarray)}


def _plain(name: str, array: NDArray[Any]) -> NDArray[Any]:
    if array.dtype.kind not in "biufU" or not array.dtype.itemsize:  # texts of no letters take no room, in any number
        raise FormatError(f'its "{name}" holds neither numbers nor texts; export it again')
    return array
