"""OpenImageIO's readers, opened for four formats alone and without their words on stderr."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import OpenImageIO as oiio

from mpsnet_core.errors import FileError, FormatError
from mpsnet_core.io.files import existing_file

_Kind = TypeVar("_Kind")

# First bytes of the formats that are read, and OpenImageIO's names of these formats.
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_SIGNATURES = (PNG_SIGNATURE, b"\xff\xd8\xff", b"II*\0", b"MM\0*", b"II+\0", b"MM\0+", b"v/1\x01")
_FORMATS = ("png", "jpeg", "tiff", "openexr")


def open_image(path: Path) -> Any:
    """OpenImageIO's reader of an image, for colours not premultiplied where the format leaves that open.

    Raises FileError where it is missing, FormatError where it is no image.
    """
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = image_input(path, config)
    if source is None:
        existing_file(path, "image")
        reason = complaint(oiio) or "it is a file of another kind"
        raise FormatError(f"{path} cannot be read as an image ({reason}); is it PNG, JPEG, TIFF or EXR, and whole?")
    return source


def image_input(path: str | os.PathLike[str], *config: Any) -> Any:
    """OpenImageIO's reader of a PNG, JPEG, TIFF or EXR file, whatever its suffix; None where it is none of them.

    Files of OpenImageIO's other formats are not opened. :func:`complaint` may return the reason.

    Raises FileError where the file's name is not valid UTF-8.
    """
    try:
        with Path(path).open("rb") as file:
            known = file.read(8).startswith(_SIGNATURES)
        if not known:
            return None
        with libraries_silent():
            source = oiio.ImageInput.open(os.fspath(path), *config)
    except (OSError, UnicodeEncodeError):
        return None
    except TypeError:  # OpenImageIO's
        raise FileError(f"{path} cannot be opened: its name is not valid UTF-8; rename it") from None
    if source is not None and source.format_name() not in _FORMATS:
        source.close()
        return None
    return source


@contextmanager
def libraries_silent() -> Iterator[None]:
    """Keep libpng and OpenEXR from printing to stderr what OpenImageIO returns as well.

    stderr belongs to the whole process, so only one thread at a time may redirect it.
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


def complaint(source: Any) -> str:
    """The pending error message of OpenImageIO, or of its reader or writer, as one line; clears it."""
    try:
        return " ".join(source.geterror().split())
    except UnicodeDecodeError:  # it quotes the file
        return "a text in it is not UTF-8"


def image_attribute(spec: Any, name: str, kind: type[_Kind]) -> _Kind | None:
    """An attribute of a file, None where it has none of this kind."""
    value = spec.getattribute(name)
    return value if isinstance(value, kind) else None
