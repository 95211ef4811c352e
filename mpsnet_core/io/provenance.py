"""Provenance: hashes of a result's inputs, by which a resumed run skips what is up to date."""

import hashlib
import os
from pathlib import Path

from mpsnet_core import __version__
from mpsnet_core.io.files import existing_file
from mpsnet_core.operation import Operation, provenance_values


def provenance_line(what: str, facts: str) -> str:
    """A picture's description: what it is, and a hash of the facts that it was computed from."""
    digest = hashlib.sha256(facts.encode(errors="surrogateescape")).hexdigest()
    return f"{what} by mpsnet {__version__}, {digest[:32]}"


def is_up_to_date(picture: Path, line: str) -> bool:
    """Whether a picture exists with this description and is not cut short."""
    from mpsnet_core.io.images import image_description, is_whole

    return image_description(picture) == line and is_whole(picture)


def identity(given: str | os.PathLike[str] | None) -> str:
    """Text that changes with files: their names, sizes and times.

    given: a file, a folder or a pattern (frame_####.png), also after "background:". Anything else is returned as text.
    """
    if given is None:
        return str(given)
    from mpsnet_core.io.frames import is_several, matching_files

    path = Path(str(given).removeprefix("background:"))
    if path.is_file():
        files = [path]
    elif is_several(path):
        files = matching_files(path)
    else:
        return str(given)
    return "; ".join(map(_stamp, files))


def content(file: str | os.PathLike[str]) -> str:
    """Hash of a file's content. Raises FileError where it is missing."""
    with existing_file(file, "file").open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def _stamp(file: Path) -> str:
    facts = existing_file(file, "file").stat()
    return f"{file.name} {facts.st_size} {facts.st_mtime_ns}"


def operation_facts(operation: Operation, **more: str) -> str:
    """Text that changes with every option that affects an operation's result, and with `more` facts.

    Raises FileError where a given file is missing.
    """
    facts = dict(more)
    for setting, value in provenance_values(operation):
        kind = setting.option.provenance
        if kind == "value" or value is None:
            facts[setting.name] = repr(value)
        else:  # small files that are often rewritten count by content
            facts[setting.name] = content(value) if kind == "content" else identity(value)
    return "\n".join(f"{name}: {fact}" for name, fact in sorted(facts.items()))
