"""OpenImageIO's readers, limited to a few formats and without output on stderr."""

import os
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, TypeVar

import OpenImageIO as oiio

from mpsnet_core.errors import FileError, FormatError, InputError
from mpsnet_core.io.file_kinds import AVIF, HEAD, HEIC, file_head, is_readable, kind_of
from mpsnet_core.io.heif import HeifReader
from mpsnet_core.io.image import MAX_PIXELS
from mpsnet_core.io.opening import AnyPath, existing_file, is_file, note_read

_Kind = TypeVar("_Kind")

# OpenImageIO's names of the formats that are read.
_FORMATS = ("png", "jpeg", "tiff", "openexr", "webp", "bmp", "targa", "hdr")
# Limit of markers and stray bytes before the size of a JPEG.
JPEG_MARKERS = 100_000


def open_image(path: Path) -> Any:
    """The reader of an image, OpenImageIO's or a like one, for unpremultiplied colours if the format leaves that open.

    Raises FileError if it is missing, FormatError if it is not an image, InputError if its reader is not installed.
    """
    kind = kind_of(file_head(path))
    if kind in (HEIC, AVIF):
        return HeifReader(path, kind)
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source, reason = image_input_or_reason(path, config)
    if source is None:
        existing_file(path, "image")
        reason = reason or f"it is {kind or 'a file of another kind'}"
        mend = "save it as PNG, TIFF or EXR" if kind else "check that it is a complete PNG, JPEG, TIFF or EXR file"
        raise FormatError(f"{path} cannot be read as an image ({reason}); {mend}")
    note_read(path)
    return source


def image_input(path: AnyPath) -> Any:
    """OpenImageIO's reader of a file in one of the formats that are read, whatever its suffix; None for other files.

    Raises as :func:`image_input_or_reason`.
    """
    return image_input_or_reason(path)[0]


def image_input_or_reason(path: AnyPath, *config: Any) -> tuple[Any, str]:
    """The reader, as :func:`image_input`, or None and OpenImageIO's reason, "" if it has none.

    Files of OpenImageIO's other formats are not opened, nor are pipes and devices. Its error is cleared, or the next
    file would report it again.

    Raises FileError if the file's name is not valid UTF-8, FormatError if a JPEG claims more than the pixel limit: a
    progressive one is decoded on opening.
    """
    if not is_file(path):
        return None, ""
    try:
        with Path(path).open("rb") as file:
            if not is_readable(path, file.read(HEAD)):
                return None, ""
            _check_jpeg(file, path)
        with silence_libraries():
            source = oiio.ImageInput.open(os.fspath(path), *config)
    except InputError:
        raise
    except (OSError, ValueError):  # a name with a null character, or in no encoding
        return None, ""
    except TypeError:  # OpenImageIO's
        raise FileError(f"{path} cannot be opened: its name is not valid UTF-8; rename it") from None
    if source is None:
        return None, pending_error(oiio)
    if source.format_name() not in _FORMATS:
        source.close()
        return None, ""
    return source, ""


def _check_jpeg(file: IO[bytes], path: AnyPath) -> None:
    """Raise FormatError if the frame header of a JPEG claims more than :data:`MAX_PIXELS`."""
    file.seek(0)
    if file.read(2) != b"\xff\xd8":
        return
    for _ in range(JPEG_MARKERS):
        # libjpeg skips anything before a marker, and repetitions of its first byte.
        byte = file.read(1)
        if byte != b"\xff":
            if byte:
                continue
            return
        while byte == b"\xff":
            byte = file.read(1)
        kind = int.from_bytes(byte, "big")
        if kind in (0, 1, *range(0xD0, 0xDA)):  # no segment follows
            continue
        if kind == 0xDA:  # start of the pixels
            return
        length = int.from_bytes(file.read(2), "big")
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack(">xHH", file.read(5).ljust(5, b"\0"))
            if height * width > MAX_PIXELS:
                most = f"{MAX_PIXELS // 10**6} megapixels"
                raise FormatError(f"{path} claims to be {width} x {height}, more than this program reads ({most})")
            return
        file.seek(max(length - 2, 0), os.SEEK_CUR)
    raise FormatError(f"{path} is damaged: its header does not state its size; export it again")


@contextmanager
def silence_libraries() -> Iterator[None]:
    """Keep libpng and OpenEXR from printing errors to stderr, which OpenImageIO returns, too.

    stderr is shared by the whole process, so only one thread at a time may redirect it.
    """
    with _stderr_lock:
        try:
            stderr = os.dup(2)
        except OSError:  # a windowed program has none
            yield
            return
        with Path(os.devnull).open("wb") as null:
            os.dup2(null.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)


_stderr_lock = threading.RLock()


def pending_error(source: Any, lines: int | None = None) -> str:
    """The pending error message of OpenImageIO, or of its reader or writer, as one line; clears it.

    lines: maximum number of lines, from the first; all by default.
    """
    try:
        return " ".join(" ".join(source.geterror().strip().splitlines()[:lines]).split())
    except UnicodeDecodeError:  # it quotes bytes of the file
        return "a text in it is not UTF-8"


def channel_names(spec: Any, path: AnyPath) -> tuple[str, ...]:
    """The names of a file's channels. Raises FormatError if they are not UTF-8."""
    try:
        names: tuple[str, ...] = spec.channelnames
        "".join(names).encode()  # OpenImageIO 3.1 returns names that it cannot decode
    except UnicodeError:
        raise FormatError(f"{path} names a channel or layer in other letters than UTF-8's; rename it") from None
    return names


def image_attribute(spec: Any, name: str, kind: type[_Kind]) -> _Kind | None:
    """An attribute of a file, None if it is missing, of another type, or a text that is not UTF-8."""
    try:
        value = spec.getattribute(name)
    except UnicodeDecodeError:
        return None
    return value if isinstance(value, kind) else None
