"""Names of texture files: a pattern whose tokens stand for the UDIM tile, the material and the object."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from mpsnet_core.errors import SettingsError
from mpsnet_core.io.opening import AnyPath

# The tokens, and the attribute of a texture set that replaces them.
TOKENS = {"<UDIM>": "tile", "<MATERIAL>": "material", "<OBJECT>": "object"}
# Bytes at which a name is cut: file systems allow 255 for the whole file name.
LONGEST_NAME = 80
# Device names of Windows, which are reserved with any suffix.
RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)", re.IGNORECASE)


class NamesTexture(Protocol):
    """A part with its own texture, such as a texture set. An attribute is None if textures are not split by it."""

    @property
    def tile(self) -> int | None: ...
    @property
    def material(self) -> str | None: ...
    @property
    def object(self) -> str | None: ...


def albedo_file(texture: Path) -> Path:
    """The albedo file that belongs to a normal texture: NAME_albedo. <UDIM> stays last, as programs expect."""
    name = re.sub(r"((?<=.)[._-]?<UDIM>)?$", r"_albedo\1", texture.stem, count=1)
    return texture.with_name(f"{name}{texture.suffix}")


def split_by(pattern: AnyPath) -> set[str]:
    """What the pattern's tokens split textures by: "tile", "material", "object".

    Raises SettingsError for an unknown token, or one in a folder's name.
    """
    path = Path(pattern)
    known = f"{', '.join(list(TOKENS)[:-1])} or {list(TOKENS)[-1]}"
    found = re.findall("<[^<>]*>", path.name)
    for token in found:
        if token not in TOKENS:
            raise SettingsError(f"{pattern}: {token} stands for nothing; use {known}, in capital letters")
    for token in re.findall("<[^<>]*>", str(path.parent)):
        if token.upper() in TOKENS:
            raise SettingsError(f"{pattern}: {token} is in a folder's name; put it into the file's name")
    return {TOKENS[token] for token in found}


def texture_files(pattern: AnyPath, texture_sets: Sequence[NamesTexture]) -> list[Path]:
    """Each texture set's file: the pattern with its tile number and the file-safe names of its material and object.

    Names that would clash on some file system are numbered.

    Raises SettingsError if the pattern has a token that the textures are not split by, or two would share a file.
    """
    files = map_files(pattern, texture_sets)
    folded = [file.name.casefold() for file in files]
    for file, name in zip(files, folded, strict=True):
        if folded.count(name) > 1:
            raise SettingsError(
                f"several textures would be called {file}; put {', '.join(TOKENS)} into the name as needed, with "
                "a separator between"
            )
    return files


def check_one_texture(file: AnyPath) -> None:
    """Raise SettingsError if the file's name contains a token, and so stands for several textures."""
    called = {"tile": "a tile's number", "material": "a material's name", "object": "an object's name"}
    name = "" if Path(file).is_file() else Path(file).name
    for token, what in TOKENS.items():
        if token in name:
            raise SettingsError(f"{file} stands for several textures; name one, with {called[what]} for {token}")


def tile_patterns(pattern: AnyPath, texture_sets: Sequence[NamesTexture]) -> list[Path]:
    """The files of :func:`texture_files` with <UDIM> left in place, as programs name all tiles of a texture.

    Raises SettingsError if the pattern has an unknown token, or one in a folder's name.
    """
    return _named(pattern, texture_sets, ["<UDIM>"] * len(texture_sets))


def map_files(pattern: AnyPath, texture_sets: Sequence[NamesTexture]) -> list[Path]:
    """The files of :func:`texture_files` for maps that are read. Several texture sets may share one.

    Raises SettingsError if the pattern has a token that the textures are not split by.
    """
    return _named(pattern, texture_sets, [str(texture_set.tile) for texture_set in texture_sets])


def _named(pattern: AnyPath, texture_sets: Sequence[NamesTexture], tiles: Sequence[str]) -> list[Path]:
    path = Path(pattern)
    if not path.name:
        raise SettingsError(f"{path} is not a file name; give one")
    parted = split_by(pattern)
    names = {
        what: _file_names([getattr(texture_set, what) for texture_set in texture_sets])
        for what in ("material", "object")
    }
    files = []
    for texture_set, tile in zip(texture_sets, tiles, strict=True):
        name = path.name
        for token, what in TOKENS.items():
            value = getattr(texture_set, what)
            if what in parted and value is None:
                raise SettingsError(f"{pattern} has {token}, but the textures are not split that way; leave it out")
            name = name.replace(token, tile if what == "tile" else names[what].get(value, ""))
        files.append(path.with_name(name))
    return files


def _file_names(names: Sequence[str | None]) -> dict[str | None, str]:
    """A unique name for each that is valid in file names on every system."""
    cleaned: dict[str | None, str] = {}
    taken: set[str] = set()
    for name in names:
        if name is None or name in cleaned:
            continue
        clean = re.sub(r"[^\w.-]+", "_", name).encode()[:LONGEST_NAME].decode(errors="ignore").strip("._-") or "unnamed"
        if RESERVED.fullmatch(clean.partition(".")[0]):
            clean += "_"
        numbered, number = clean, 1
        while numbered.casefold() in taken:
            number += 1
            numbered = f"{clean}_{number}"
        taken.add(numbered.casefold())
        cleaned[name] = numbered
    return cleaned
