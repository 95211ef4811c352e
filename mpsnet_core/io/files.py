"""Files written atomically, alone or together, and JSON files with a format and a version.

A file that is being written is named ``.NAME.PID-PLACE-RANDOM.unfinished.SUFFIX``. PLACE is a hash of the host name
and, on Linux, the PID namespace: only within it does PID tell whether the writer is still running. The next process
that writes into the folder from the same place removes the leftovers of a killed writer. Processes elsewhere, as on
another host with a shared folder, leave them alone. Temporary folders have such names, too.
"""

import contextlib
import errno
import json
import os
import platform
import re
import secrets
import shutil
import sys
import tempfile
import threading
import time
import unicodedata
import zlib
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from mpsnet_core.errors import FileError, FormatError, InputError, SettingsError
from mpsnet_core.io.marks import is_ours
from mpsnet_core.io.opening import MAX_TEXT_BYTES as MAX_TEXT_BYTES
from mpsnet_core.io.opening import AnyPath, kind_of
from mpsnet_core.io.opening import existing_file as existing_file
from mpsnet_core.io.opening import is_file as is_file
from mpsnet_core.operation import running
from mpsnet_core.progress import uninterrupted

# Suffixes of photos; of camera raw, those that LibRaw reads.
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".exr", ".webp", ".bmp", ".tga", ".hdr")
HEIF_SUFFIXES = (".heic", ".heif", ".avif")
# fmt: off
RAW_SUFFIXES = (
    ".3fr", ".arw", ".cr2", ".cr3", ".crw", ".dcr", ".dng", ".erf", ".fff", ".iiq", ".kdc", ".mef", ".mos", ".mrw",
    ".nef", ".nrw", ".orf", ".pef", ".raf", ".rw2", ".rwl", ".sr2", ".srf", ".srw",
)
# fmt: on
PHOTO_SUFFIXES = (*IMAGE_SUFFIXES, *HEIF_SUFFIXES, *RAW_SUFFIXES)
VIDEO_SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mts", ".mxf", ".webm")

# Environment variable with the command, as a JSON list, of a program that decodes videos if PyAV is not installed.
VIDEO_DECODER = "MPSNET_VIDEO_DECODER"

# Limit of file systems.
MAX_NAME_BYTES = 255

# Waits between attempts while another program has a file open.
DENIED_SECONDS = (0.05, 0.1, 0.2, 0.4, 0.8)

# Bits per channel of each format; the first is the default.
WRITABLE_BITS = {".png": (16, 8), ".tif": (16, 8, 32), ".tiff": (16, 8, 32), ".exr": (32, 16)}


class _Transaction(threading.local):
    """Pending changes of a with block of :func:`write_transaction`; None outside such a block.

    A change is a path and the file that replaces it, or None to remove it.
    """

    changes: list[tuple[Path, Path | None]] | None = None


_transaction = _Transaction()

# The folders into which this process has begun to write.
_written_into: set[Path] = set()


@contextmanager
def prefix_errors(where: object) -> Iterator[None]:
    """Prefix the message of an InputError raised in the with block with `where`: a file, or a place in one."""
    try:
        yield
    except InputError as error:
        raise type(error)(f"{where}: {error}") from None


@contextmanager
def write_transaction() -> Iterator[None]:
    """Files that this thread writes in the with block appear together at its end. If it fails, old files stay.

    Until then they have their unfinished names, even within the block. A nested block is part of the outer one. Only a
    process that is killed during the renames, in less than a millisecond, leaves a mixture of old and new files.

    Raises FileError if a file cannot be renamed.
    """
    if _transaction.changes is not None:
        yield
        return
    changes: list[tuple[Path, Path | None]] = []
    try:
        _transaction.changes = changes
        yield
        _put_in_place(changes)
    finally:
        _transaction.changes = None
        _remove(*(unfinished for _, unfinished in changes if unfinished is not None))


@contextmanager
def atomic_write(path: AnyPath) -> Iterator[Path]:
    """Yield an empty file next to `path` to write to; rename it to `path` on success, remove it on failure.

    It exists from the start, so nobody can put a link in its place. :func:`remove_unfinished` cleans up after a killed
    process. The renamed file is flushed to disk. In a block of :func:`write_transaction` it is renamed at the block's
    end. If `path` is a link, all of this applies to its target.

    Raises FileError if the folder is missing or cannot be written, or the disk is full.
    """
    path = _behind_link(writable_path(path))
    _clear_once(resolved(path.parent))
    unfinished = unfinished_path(path)
    try:
        with _writing(path):
            _create(unfinished)
            yield unfinished
            _flush(unfinished)
        with write_transaction():
            assert _transaction.changes is not None
            _transaction.changes.append((path, unfinished))
        if (task := running.get()) is not None:
            task.written.add(os.path.abspath(path))  # noqa: PTH100 - as in check_own
    except BaseException:
        _remove(unfinished)
        raise


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A folder for temporary files, removed at the block's end; that of a killed process is removed by the next one."""
    place = Path(tempfile.gettempdir())
    _clear_once(place)
    folder = unfinished_path(place / "mpsnet")
    try:
        with _writing(folder):
            folder.mkdir(0o700)
        yield folder
    finally:
        _remove(folder)


def remove_file(path: AnyPath) -> None:
    """Remove a file if it exists; in a block of :func:`write_transaction`, at the block's end.

    Raises FileError if it is not the running operation's to remove.
    """
    check_own(path)
    with write_transaction():
        assert _transaction.changes is not None
        _transaction.changes.append((Path(path), None))


def _put_in_place(changes: Sequence[tuple[Path, Path | None]]) -> None:
    """Rename and remove files. If one fails, undo those before it."""
    backups: list[tuple[Path, Path | None]] = []
    names: list[Path] = []
    try:
        for path, unfinished in changes:
            with _writing(path):
                if len(changes) > 1:
                    names.append(unfinished_path(path))
                    backups.append((path, _second_name(path, names[-1])))
                _put(path, unfinished)
    except BaseException:
        for path, backup in reversed(backups):
            with contextlib.suppress(OSError):
                _put(path, backup)
        raise
    finally:
        _remove(*names)
    for folder in {path.parent for path, _ in changes}:
        with contextlib.suppress(OSError):  # Windows cannot open folders, and permissions may forbid it
            _flush(folder)


def _put(path: Path, unfinished: Path | None) -> None:
    """Rename a file to `path`, or remove `path`. On Windows, a virus scanner may hold a new file open for a while."""
    for seconds in (*DENIED_SECONDS, None):
        try:
            if unfinished is None:
                path.unlink(missing_ok=True)
            else:
                unfinished.replace(path)
            return
        except PermissionError:
            if seconds is None:
                raise
            time.sleep(seconds)


def _second_name(path: Path, name: Path) -> Path | None:
    """Make `name` a link to, or copy of, the file at `path` to restore it from; None if there is no file."""
    if not path.exists():
        return None
    try:
        os.link(path, name)
    except OSError:  # USB sticks and some network drives do not support links
        shutil.copy2(path, name)
    return name


def _flush(path: Path) -> None:
    """Flush a file, or a folder's entries, to disk, to survive a power cut."""
    handle = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)  # Windows flushes only writable handles
    try:
        os.fsync(handle)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # drives without fsync
            raise
    finally:
        os.close(handle)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Turn an OSError in the with block into a FileError that names `path`."""
    try:
        yield
    except OSError as error:
        denied = isinstance(error, PermissionError)
        advice = "close the program that has it open" if denied and path.exists() else "make room"
        raise FileError(f"cannot write {path}: {error.strerror or error}; {advice} or choose another folder") from None


def unfinished_path(path: Path, suffix: str = "") -> Path:
    """A random name next to `path` for its unfinished file, with its suffix, which determines the format."""
    mark = f"{os.getpid()}-{_place()}-{secrets.token_hex(4)}"
    return path.with_name(f".{path.stem}.{mark}.unfinished{suffix or path.suffix}")


@cache
def _place() -> str:
    """Hash of the scope within which PIDs are unique, as eight hexadecimal digits."""
    try:
        namespace = str(Path("/proc/self/ns/pid").readlink())  # containers may share a host's name
    except OSError:
        namespace = ""
    return f"{zlib.crc32(f'{platform.node()} {namespace}'.encode()):08x}"


def writable_path(path: AnyPath) -> Path:
    """`path` as a Path, for checks before long work. Raises FileError if no file can be written there."""
    path = Path(path)
    if not is_utf8(path):
        raise FileError(f"cannot write {path}: its name is not valid UTF-8; choose another name")
    check_own(path)
    file = _behind_link(path)
    if file.exists() and not file.is_file():
        raise FileError(f"cannot write {path}: it is {kind_of(file)}; give a file name")
    if not file.parent.is_dir():
        raise FileError(f"cannot write {path}: the folder {file.parent} does not exist; create it first")
    if len(os.fsencode(unfinished_path(file).name)) > MAX_NAME_BYTES:
        raise FileError(f"cannot write {path}: its name is too long; choose a shorter one")
    if not _can_be_created(file):
        raise FileError(f"cannot write {path}: the folder {file.parent} cannot be written to; choose another folder")
    if file.exists() and not os.access(file, os.W_OK):
        raise FileError(f"cannot write {path}: it is protected against writing; choose another name, or unlock it")
    return path


def check_own(path: AnyPath, *, derived: bool = False, json_format: str = "") -> None:
    """Raise FileError if a file may not be written or removed, because this program derived its name.

    A derived name may neither be a link nor lie behind one, as folders from other people may hold links to any file of
    the user's. If such a file exists, this program must have made it, or its user must want it overwritten. Within a
    running operation, all names are derived that its options do not state.

    derived: whether it is derived even where no operation runs. json_format: the "format" of a JSON file; by default
    any of this program's.
    """
    task, file = running.get(), Path(os.path.abspath(path))  # noqa: PTH100 - links stay as they are
    if str(file) in task.named if task else not derived:
        return
    for place in (file, *file.parents):
        if str(place) in (task.places if task else [str(file.parent)]) or place == Path(tempfile.gettempdir()):
            break
        check_no_link(place)
    may = task and (task.operation.overwrite or str(file) in task.written)
    if file.is_file() and not may and not is_ours(file, json_format):
        raise FileError(
            f"the result would overwrite {path}, which this program did not make; move it, choose another output, or "
            "give --overwrite"
        )


def check_no_link(path: Path) -> None:
    """Raise FileError if a file would be written through a link: one in an untrusted folder may lead to a file of the
    user's."""
    if path.is_symlink():
        raise FileError(f"{path} is a link to {path.readlink()}, through which no file is written; remove it")


def _behind_link(path: Path) -> Path:
    """The target of a link; other paths are returned unchanged."""
    return resolved(path) if path.is_symlink() else path


def file_suffix(kind: str) -> str:
    """The suffix of a file format: ".png" for "png" and ".PNG"."""
    return f".{kind.lstrip('.').lower()}"


def check_ending(output: Path, suffix: str) -> None:
    """Raise SettingsError if the file's suffix is not that of --format."""
    if output.suffix.lower() != suffix:
        raise SettingsError(f"--format {suffix[1:]} is not what {output} ends in; change one, or leave --format out")


def checked_bits(path: Path, bits: int | None = None) -> int:
    """Bits per channel to write `path` with: `bits` if the format supports them, its default if None.

    Raises SettingsError if the format is not supported, or does not support these bits.
    """
    choices = WRITABLE_BITS.get(path.suffix.lower())
    if choices is None:
        kind = f"{path.suffix} is not a supported image format" if path.suffix else "its name has no ending"
        raise SettingsError(f"cannot write {path}: {kind}; use {', '.join(WRITABLE_BITS)}")
    if bits is None:
        return choices[0]
    if bits not in choices:
        allowed = " or ".join(map(str, sorted(choices)))
        reason = f"{path.suffix} files hold {allowed} bits per channel, not {bits}"
        raise SettingsError(f"cannot write {path}: {reason}; change the format or the bits")
    return bits


def stored_levels(path: AnyPath, bits: int | None = None) -> int | None:
    """The highest level of an image file of integers with those bits, 255 or 65535; None if it holds floats.

    Raises as :func:`checked_bits` does.
    """
    bits = checked_bits(Path(path), bits)
    return None if bits == 32 or Path(path).suffix.lower() == ".exr" else (1 << bits) - 1


def writable_image(path: AnyPath, bits: int | None = None) -> Path:
    """`path` as a Path, for checks before long work. Raises as :func:`writable_path` and :func:`checked_bits` do."""
    path = writable_path(path)
    checked_bits(path, bits)
    return path


def check_no_overwrite(taken: Iterable[AnyPath], outputs: Iterable[AnyPath]) -> None:
    """Raise FileError if one of `outputs` is also an input (`taken`) or an earlier output."""
    needed, made = set(map(_as_compared, taken)), set[Path]()
    for output in outputs:
        file = _as_compared(output)
        if file in needed or file in made:
            what = "a file that it needs" if file in needed else "another result"
            raise FileError(f"the result would overwrite {output}, {what}; choose another output")
        made.add(file)


def _as_compared(path: AnyPath) -> Path:
    """A resolved path that is equal for equal files: macOS ignores case and the composition of accents."""
    file = resolved(path)
    return Path(unicodedata.normalize("NFC", str(file)).casefold()) if sys.platform == "darwin" else file


def is_utf8(path: AnyPath) -> bool:
    """Whether a path is valid UTF-8. One from another system may not be."""
    try:
        os.fspath(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def resolved(path: AnyPath) -> Path:
    """A path with its links resolved. One that links to itself, or is invalid (from a JSON file, say), is unchanged:
    opening it reports the error."""
    try:
        return Path(os.path.realpath(path))
    except ValueError:
        return Path(path)


def _can_be_created(file: Path) -> bool:
    """Whether a file can be created in its folder, tested with its unfinished file.

    Permissions do not tell on Windows, nor for folders that are not on a disk. tempfile would try two billion names in
    a read-only folder of Windows.
    """
    probe = unfinished_path(file)
    try:
        _create(probe)
    except OSError:
        return False
    finally:
        _remove(probe)
    return True


def _create(path: Path) -> None:
    """Create an empty file. It must not exist."""
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))


def creatable_folder(path: AnyPath, what: str) -> Path:
    """`path` as a folder for `what` that exists or can be created, for checks before long work. Raises FileError."""
    path = Path(path)
    if not is_utf8(path):
        raise FileError(f"cannot make folder {path}: its name is not valid UTF-8; choose another name")
    if path.exists() and not path.is_dir():
        raise FileError(f"{path} is a file; name a folder for the {what}")
    if not path.parent.is_dir():
        raise FileError(f"cannot make folder {path}: {path.parent} does not exist; create it first")
    folder = path if path.is_dir() else path.parent
    if not _can_be_created(folder / "file"):
        raise FileError(f"cannot put the {what} into {path}: {folder} cannot be written to; choose another folder")
    return path


def ensure_folder(path: AnyPath, what: str) -> Path:
    """`path` as a folder for `what`, created if it is missing. Raises FileError if that fails."""
    path = creatable_folder(path, what)
    if path.is_dir():
        return path
    try:
        path.mkdir(exist_ok=True)
        if (task := running.get()) is not None:
            task.folders.append(os.path.abspath(path))  # noqa: PTH100
    except OSError as error:
        raise FileError(f"cannot make folder {path}: {error.strerror or error}; choose another place") from None
    with contextlib.suppress(OSError):
        _flush(path.parent)
    return path


def remove_unfinished(folder: AnyPath, pid: int) -> None:
    """Remove the unfinished files that the killed process `pid` left in `folder`."""
    for left in Path(folder).glob(f".*.{pid}-{_place()}-*.unfinished*"):
        _remove(left)


def remove_own_unfinished() -> None:
    """Remove the unfinished files of this process, which is about to end itself by force."""
    for folder in list(_written_into):
        remove_unfinished(folder, os.getpid())


def remove_abandoned(folder: AnyPath) -> None:
    """Remove the unfinished files of killed processes from `folder`; those of other hosts or containers stay."""
    for file in Path(folder).glob(".*.unfinished*"):
        found = re.search(rf"\.(\d+)-{_place()}-[0-9a-f]+\.unfinished", file.name)
        if found and not _running(int(found[1])):
            _remove(file)


@uninterrupted
def _remove(*paths: Path) -> None:
    """Remove files, or folders with their content. Missing ones, and those without permission, are ignored."""
    for left in paths:
        if left.is_dir() and not left.is_symlink():
            shutil.rmtree(left, ignore_errors=True)
        else:
            with contextlib.suppress(OSError):
                left.unlink()


def _clear_once(folder: Path) -> None:
    """Remove abandoned files at a process's first file in a folder only: it may contain a hundred thousand files."""
    if folder not in _written_into:
        _written_into.add(folder)
        remove_abandoned(folder)


def _running(pid: int) -> bool:
    if sys.platform == "win32":  # os.kill would end it there
        import ctypes
        from ctypes import wintypes

        kernel = ctypes.WinDLL("kernel32", use_last_error=True)
        kernel.OpenProcess.restype = wintypes.HANDLE
        kernel.WaitForSingleObject.argtypes = (wintypes.HANDLE, wintypes.DWORD)
        kernel.CloseHandle.argtypes = (wintypes.HANDLE,)
        process = kernel.OpenProcess(0x00100000, False, pid)  # SYNCHRONIZE
        if not process:
            return ctypes.get_last_error() != 87  # ERROR_INVALID_PARAMETER: no such process
        running = kernel.WaitForSingleObject(process, 0) != 0
        kernel.CloseHandle(process)
        return running
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def check_small(path: Path, what: str) -> None:
    """Raise FormatError if a file is larger than any of its kind. what: the kind, for the message."""
    if path.stat().st_size > MAX_TEXT_BYTES:
        raise FormatError(f"{path} is larger than 1 MiB and so {what}; check the path")


def read_json(path: AnyPath, format_name: str, version: int, keys: Collection[str]) -> dict[str, Any]:
    """Read a JSON object whose "format" is `format_name` and whose "version" is at most `version`.

    keys: its other keys. Raises FileError if it is missing; FormatError if it is another file, or has an unknown key,
    usually a misspelling.
    """
    path = existing_file(path, f"{format_name.removeprefix('mpsnet-')} file")
    check_small(path, f"not a {format_name} file")
    try:
        data = json.loads(path.read_text(encoding="utf-8-sig"))  # Notepad writes a byte order mark
    except UnicodeDecodeError:
        raise FormatError(f"{path} is not a text file; give a {format_name} file, as JSON") from None
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path} is not valid JSON ({error}); write it again as a {format_name} file") from None
    found = data.get("format") if isinstance(data, dict) else None
    if found != format_name:
        raise FormatError(f'{path} is not a {format_name} file: its "format" is {found!r}, expected {format_name!r}')
    fields: dict[str, Any] = data
    if not isinstance(data.get("version"), int) or not 1 <= data["version"] <= version:
        raise FormatError(
            f"{path} is version {data.get('version')!r} of {format_name}, this program reads up to {version}; update it"
        )
    unknown = sorted(set(data) - {"format", "version", *keys})
    if unknown:
        raise FormatError(f'{path} has "{unknown[0]}", which no {format_name} file has; it may have {", ".join(keys)}')
    return fields


def write_json(path: AnyPath, data: dict[str, Any]) -> None:
    """Write `data` atomically as indented JSON."""
    check_own(path, json_format=str(data.get("format", "")))
    with atomic_write(path) as unfinished:
        unfinished.write_text(json.dumps(data, indent=2) + "\n", encoding="utf-8")
