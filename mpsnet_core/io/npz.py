"""Arrays from untrusted ``.npz`` files."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import FormatError
from mpsnet_core.io.opening import DAMAGED

# A file may unpack to this many times its size plus this many bytes: zeros compress to a thousandth.
_RATIO, _FREE = 64, 64 << 20


def unpacked_limit(path: Path, limit: int) -> int:
    """Limit in bytes of what a file may unpack to: `limit`, or less for a small file (see _RATIO and _FREE)."""
    return min(limit, _FREE + _RATIO * path.stat().st_size)


def read_arrays(path: Path, limit: int) -> dict[str, NDArray[Any]]:
    """All arrays of an ``.npz`` file by name. limit: maximum unpacked size in bytes.

    Raises FormatError, without the file's name, if it is damaged, larger, or has arrays of objects.
    """
    try:
        limit = unpacked_limit(path, limit)
        with zipfile.ZipFile(path) as archive:
            size = sum(entry.file_size for entry in archive.infolist())
        if size <= limit:
            with np.load(path, allow_pickle=False) as data:
                arrays = {name: data[name] for name in data.files}
    except DAMAGED as error:
        raise FormatError(f"it cannot be read ({error}); export it again") from None
    if size > limit:
        raise FormatError(f"it unpacks to {size / (1 << 20):.0f} MiB, more than {limit >> 20}; reduce it first")
    return {name: _plain(name, array) for name, array in arrays.items() if isinstance(array, np.ndarray)}


def _plain(name: str, array: NDArray[Any]) -> NDArray[Any]:
    if array.dtype.kind not in "biufU" or not array.dtype.itemsize:  # empty strings take no space, in any number
        raise FormatError(f'its "{name}" holds neither numbers nor texts; export it again')
    return array
