"""What images state on how they were made."""

import hashlib
import json
import os
import re
from functools import lru_cache
from pathlib import Path
from typing import Any

from mpsnet_core import __version__
from mpsnet_core.io.marks import BY, SOFTWARE
from mpsnet_core.io.opening import AnyPath, existing_file
from mpsnet_core.operation import running, settings


def metadata(*, with_inputs: bool) -> str:
    """What an image states on how it was made, as JSON: software, command, settings and the hashes of all inputs.

    Settings are those that are not at their defaults, and the model. There are no folders, times and hosts in it, so
    that the same run writes the same bytes. "" outside of an operation. with_inputs: whether what the operation has
    read so far belongs to this image: to one of a sequence, it does not.
    """
    task = running.get()
    if task is None:
        return ""
    chosen = {}
    for setting in settings(type(task.operation)):
        value, told = getattr(task.operation, setting.name), setting.option
        plain = bool(told.choices) or (told.provenance == "value" and not told.path)
        if (setting.name == "model" and value is not None) or (plain and value != setting.default):
            chosen[setting.name] = _without_folders(value)
    given = [Path(file) for file in task.read if file not in task.written and Path(file).is_file()]
    made_of = {"inputs": sorted(f"{file.name} {content_fingerprint(file)}" for file in given)} if with_inputs else {}
    software = f"{SOFTWARE} {__version__}"
    return json.dumps({"software": software, "command": task.operation.command, "settings": chosen, **made_of})


def _without_folders(value: Any) -> Any:
    """A setting without the folders of its paths, which tell who made an image and where."""
    if isinstance(value, tuple | list):
        return [*map(_without_folders, value)]
    return re.split(r"[/\\]", os.fspath(value))[-1] if isinstance(value, str | os.PathLike) else value


def is_provenance_line(description: str) -> bool:
    """Whether a description is one of :func:`provenance_line`, as frames of a sequence have."""
    return re.search(rf"{BY}\S+, [0-9a-f]{{32}}$", description) is not None


def content_fingerprint(file: AnyPath) -> str:
    """Hash of a file's content. Raises FileError if it is missing."""
    path = existing_file(file, "file")
    facts = path.stat()
    return _digest(path, facts.st_size, facts.st_mtime_ns, facts.st_ctime_ns)


@lru_cache(maxsize=1 << 16)
def _digest(file: Path, *facts: int) -> str:
    """The hash, computed once: smoothing asks for each photo several times. facts: what changes with the file."""
    with file.open("rb") as opened:
        return hashlib.file_digest(opened, "blake2b").hexdigest()[:32]
