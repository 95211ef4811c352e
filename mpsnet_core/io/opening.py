"""What may be opened: files. A pipe would wait for ever, and a device has no end."""

import os
import pickle
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path

from mpsnet_core.errors import FileError
from mpsnet_core.operation import running

# A path as anybody may give it.
AnyPath = str | os.PathLike[str]

# Rig and camera files are a few hundred bytes. A larger file is something else and is not parsed.
MAX_TEXT_BYTES = 1 << 20
# What libraries raise for damaged files: SyntaxError is Pillow's, RuntimeError zipfile's where they are encrypted.
# fmt: off
DAMAGED = (
    ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError, OSError, RuntimeError,
    SyntaxError, TypeError, ValueError, pickle.UnpicklingError, struct.error, tokenize.TokenError, zipfile.BadZipFile,
    zlib.error,
)
# fmt: on


def is_file(path: AnyPath) -> bool:
    """Whether a path is a file; False for invalid paths."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):  # a name that is too long, or has a null character
        return False


def existing_file(path: AnyPath, what: str) -> Path:
    """`path` as a Path. Raises FileError if it is missing or cannot be opened. what: the file's name in messages."""
    path = Path(path)
    try:
        if not path.exists():
            raise FileError(f"{what} {path} does not exist; check the path")
        if not path.is_file():  # opening a pipe would wait for ever, and a device has no end
            where = " in it" if path.is_dir() else ""
            raise FileError(f"{what} {path} is {kind_of(path)}, not a file; name a file{where}")
        path.open("rb").close()
    except OSError as error:
        raise FileError(f"{what} {path} cannot be opened ({error.strerror}); check the path") from None
    note_read(path)
    return path


def note_read(path: Path) -> None:
    """Note that the running operation reads a file, for the metadata of what it makes."""
    if (task := running.get()) is not None:
        task.read[os.path.abspath(path)] = None  # noqa: PTH100 - as in check_own


def kind_of(path: Path) -> str:
    """What exists at a path that is not a file, in words."""
    return "a folder" if path.is_dir() else "a pipe, a socket or a device"
