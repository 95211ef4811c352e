"""Errors of Blender's operators and of the system, as one line."""

from mpsnet_core.errors import in_one_line


def operator_report(error: RuntimeError) -> str:
    """What an operator that was called from here reported, as one line."""
    return " ".join(str(error).split()).removeprefix("Error: ")


def system_report(error: OSError) -> str:
    """What the system reported of a file, and how to mend it."""
    where = f"{error.filename}: " if error.filename else "a file could not be read or written: "
    return in_one_line(f"{where}{error.strerror or error}; make room on the disk or check the permissions")
