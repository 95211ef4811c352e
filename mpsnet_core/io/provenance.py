"""Provenance: hashes of a result's inputs, which let a resumed run skip results that are up to date."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpsnet_core.io.marks import BY, made
from mpsnet_core.io.metadata import content_fingerprint
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.operation import Operation, Provenance, settings


def provenance_line(what: str, *facts: str) -> str:
    """The description of an image: what it is, and a hash of the facts that it was computed from."""
    return f"{made(what)}, {digest(*facts)}"


def digest(*facts: str) -> str:
    """A hash of facts, as 32 hexadecimal digits."""
    return hashlib.sha256("\n".join(facts).encode(errors="surrogateescape")).hexdigest()[:32]


def is_up_to_date(picture: Path, line: str) -> bool:
    """Whether an image exists with this description and is not truncated."""
    from mpsnet_core.io.image_reading import image_description
    from mpsnet_core.io.image_writing import is_complete_image

    return image_description(picture) == line and is_complete_image(picture)


def is_result(picture: Path, what: str) -> bool:
    """Whether an image's description says that this program made it, from any facts."""
    from mpsnet_core.io.image_reading import image_description

    return image_description(picture).startswith(f"{what}{BY}")


def fingerprint(given: AnyPath) -> str:
    """Fingerprint of files: their names and hashes of their contents. Sizes and times do not tell two photos apart.

    given: a file, a folder or a pattern (frame_####.png), also after "background:". Anything else is returned as text.
    """
    from mpsnet_core.io.frames import is_folder_or_pattern, matching_files

    text = str(given)
    place = text.removeprefix("background:")
    if Path(place).is_file():
        files = [Path(place)]
    elif is_folder_or_pattern(place):
        files = matching_files(place)
    else:
        return text
    return text.removesuffix(place) + "; ".join(f"{file.name} {content_fingerprint(file)}" for file in files)


_FACT: dict[Provenance, Callable[[Any], str]] = {"value": repr, "content": content_fingerprint, "files": fingerprint}


def operation_facts(operation: Operation, *parts: type[Operation], **more: str) -> str:
    """Fingerprint of all options that affect an operation's result, and of `more` facts.

    parts: base classes of the operation whose options are included; all options by default.

    Raises FileError if a given file is missing.
    """
    facts = dict(more)
    for setting in (setting for part in parts or (type(operation),) for setting in settings(part)):
        if setting.option.provenance != "none":
            value, fact = getattr(operation, setting.name), _FACT[setting.option.provenance]
            values = value if setting.several and value is not None else (value,)
            facts[setting.name] = repr([one if one is None else fact(one) for one in values])
    return "\n".join(f"{name}: {fact}" for name, fact in sorted(facts.items()))
