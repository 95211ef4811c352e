"""Claims: which process works on which part of a folder. They are file locks, which the OS releases at its end."""

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mpsnet_core.errors import FileError
from mpsnet_core.io.opening import AnyPath

LOCK_FILE = "job.lock"

if sys.platform == "win32":
    import msvcrt

    def _lock(file: int, number: int) -> None:
        os.lseek(file, number, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)

    def _unlock(file: int, number: int) -> None:
        os.lseek(file, number, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_UNLCK, 1)
else:
    import fcntl

    def _lock(file: int, number: int) -> None:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, number)

    def _unlock(file: int, number: int) -> None:
        fcntl.lockf(file, fcntl.LOCK_UN, 1, number)


# An untrusted folder may contain a link of that name.
NO_LINK = getattr(os, "O_NOFOLLOW", 0)


class Claims:
    """One process's claims in a folder: number n locks byte n of the folder's lock file, which stays empty.

    Locks belong to a process: children do not inherit them, threads share them, and on POSIX, closing one `Claims` of a
    folder releases those of all others in the process.

    Raises FileError if the lock file cannot be created, or the file system does not support locks.
    """

    def __init__(self, folder: AnyPath) -> None:
        self._path = Path(folder) / LOCK_FILE
        try:
            self._file = os.open(self._path, os.O_RDWR | os.O_CREAT | NO_LINK, 0o666)
        except OSError as error:
            raise FileError(f"cannot write {self._path}: {error.strerror}; choose another folder") from None

    @contextmanager
    def claim(self, number: int) -> Iterator[bool]:
        """Yield whether this process holds `number` within the block; False at once if another process holds it."""
        try:
            _lock(self._file, number)
        except OSError as error:
            # Windows and some network drives report "no permission" where POSIX reports "try again".
            if error.errno not in (errno.EAGAIN, errno.EACCES, errno.EDEADLK):
                raise FileError(f"{self._path} cannot be locked ({error.strerror}); choose another drive") from None
            yield False
            return
        try:
            yield True
        finally:
            _unlock(self._file, number)

    def __enter__(self) -> "Claims":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)
