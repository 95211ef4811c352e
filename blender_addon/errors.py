"""Errors of Blender's operators and of the system, as one line."""

from mpsnet_core.errors import in_one_line


def operator_report(error: RuntimeError) -> str:
    """The report of an operator that the add-on called, as one line."""
    return " ".join(str(error).split()).removeprefix("Error: ")


def system_report(error: OSError) -> str:
    """The system's error on a file, and how to mend it."""
    where = f"{error.filename}: " if error.filename else "a file could not be read or written: "
    return in_one_line(f"{where}{error.strerror or error}; make room on the disk or check the permissions")
