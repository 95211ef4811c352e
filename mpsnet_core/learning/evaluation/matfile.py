"""Read a numeric array from a MATLAB 5 file, the format of DiLiGenT's true normals."""

import struct
import zlib
from collections.abc import Iterator

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.errors import FormatError
from mpsnet_core.io.files import existing_file
from mpsnet_core.io.npz import unpacked_limit
from mpsnet_core.io.opening import DAMAGED, AnyPath

# "MAT-File Format", MathWorks, tables 1-1 and 1-3.
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_MATRIX, _COMPRESSED, _FIRST_NUMERIC_CLASS = 14, 15, 6
MAX_BYTES = 1 << 30


def read_mat_array(path: AnyPath, name: str) -> F64:
    """The real, dense numeric array called `name`, as float64.

    Raises FileError if the file is missing, FormatError if it is damaged or has no such array.
    """
    path = existing_file(path, "MATLAB file")
    if path.stat().st_size > MAX_BYTES:
        raise FormatError(f"MATLAB file {path} is larger than 1 GiB; it is not DiLiGenT's")
    limit = unpacked_limit(path, MAX_BYTES)
    data = path.read_bytes()
    if data[124:128] != b"\x00\x01IM":
        raise FormatError(f"{path} is not a little-endian MATLAB 5 file; save it with -v7")
    try:
        for kind, body in _elements(data[128:]):
            if kind == _COMPRESSED:
                unpacker = zlib.decompressobj()
                unpacked = unpacker.decompress(body, limit)
                if unpacker.unconsumed_tail:
                    raise FormatError(f"{path} unpacks to more than {limit >> 20} MiB; it is not DiLiGenT's")
                kind, body = next(_elements(unpacked))
            if kind == _MATRIX:
                found = _matrix(body, name)
                if found is not None:
                    return found
    except FormatError:
        raise
    except (*DAMAGED, StopIteration) as error:
        raise FormatError(f"{path} is damaged ({error or 'it ends early'}); copy it again") from None
    raise FormatError(f"{path} holds no numeric array called {name!r}")


def _elements(data: bytes) -> Iterator[tuple[int, bytes]]:
    offset = 0
    while offset + 8 <= len(data):
        kind, size = struct.unpack_from("<II", data, offset)
        if kind >> 16:  # small element: size and up to four bytes of data are in the tag
            kind, size, start, end = kind & 0xFFFF, kind >> 16, offset + 4, offset + 8
        else:
            start = offset + 8
            end = start + size + (0 if kind == _COMPRESSED else -size % 8)
        if start + size > len(data):
            raise ValueError("it ends early")
        yield kind, data[start : start + size]
        offset = end


def _matrix(body: bytes, name: str) -> F64 | None:
    parts = _elements(body)
    (_, flags), (_, shape), (_, title) = next(parts), next(parts), next(parts)
    if title.decode("latin-1") != name or flags[0] < _FIRST_NUMERIC_CLASS:
        return None
    kind, values = next(parts)
    array = np.frombuffer(values, "<" + _TYPES[kind]).astype(np.float64)
    return array.reshape(np.frombuffer(shape, "<i4"), order="F")
