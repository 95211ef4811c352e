"""Errors of Blender's operators and of the system, as one line."""

from collections.abc import Iterator
from contextlib import contextmanager

from mpsnet_core.errors import FileError, InputError, in_one_line


def operator_report(error: RuntimeError) -> str:
    """The report of an operator that the add-on called, as one line."""
    return " ".join(str(error).split()).removeprefix("Error: ")


@contextmanager
def operator_errors(failure: str, mend: str, kind: type[InputError] = FileError) -> Iterator[None]:
    """Within the with block, an operator that fails raises an InputError: `failure`, its report in brackets, `mend`."""
    try:
        yield
    except RuntimeError as error:
        raise kind(f"{failure} ({operator_report(error)}); {mend}") from None


def system_report(error: OSError) -> str:
    """The system's error on a file, and how to mend it."""
    where = f"{error.filename}: " if error.filename else "a file could not be read or written: "
    return in_one_line(f"{where}{error.strerror or error}; make room on the disk or check the permissions")
