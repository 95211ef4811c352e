"""List files of base maps: which normal map belongs to which object and material."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mpsnet_core.defaults import Convention
from mpsnet_core.errors import FormatError
from mpsnet_core.io.files import read_json, write_json
from mpsnet_core.io.opening import AnyPath

FORMAT, VERSION = "mpsnet-present-maps", 1


@dataclass(frozen=True)
class ListedMap:
    """A base map with its object and material."""

    file: Path
    """The map."""
    object: str | None = None
    """Name of the object; None for all."""
    material: str | None = None
    """Name of the material; None for all."""
    convention: Convention | None = None
    """Which way its green channel points; None if the list does not say."""


def read_map_list(path: AnyPath) -> list[ListedMap]:
    """Read a list. Relative file names are relative to the list's folder.

    {"format": "mpsnet-present-maps", "version": 1, "maps": [{"file": "oak.png", "object": "Oak", "material": "Bark",
    "convention": "directx"}]}, where all but the file is optional. Raises FormatError if it is malformed.
    """
    maps: Any = read_json(path, FORMAT, VERSION, ("maps",)).get("maps")
    found = []
    for entry in maps if isinstance(maps, list) else [maps]:
        known = isinstance(entry, dict) and _KNOWN >= entry.keys() >= {"file"}
        if not known or not all(isinstance(value, str) for value in entry.values()):
            raise FormatError(
                f'{path}: each of its "maps" has texts: "file", and maybe "object", "material" and "convention"'
            )
        found.append(ListedMap(**{**entry, "file": Path(path).parent / entry["file"]}))
    return found


def write_map_list(path: AnyPath, maps: Iterable[ListedMap]) -> None:
    """Write a list that :func:`read_map_list` reads."""
    listed = [{what: str(value) for what, value in vars(one).items() if value is not None} for one in maps]
    write_json(path, {"format": FORMAT, "version": VERSION, "maps": listed})


_KNOWN = set(ListedMap.__dataclass_fields__)
