"""Names of texture files: a pattern whose tokens stand for the UDIM tile, the material and the object."""

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from mpsnet_core.errors import SettingsError

# The tokens, and what of a texture set they stand for.
TOKENS = {"<UDIM>": "tile", "<MATERIAL>": "material", "<OBJECT>": "object"}
# Names of more bytes are cut: file systems allow 255, and there is more in a file's name.
LONGEST_NAME = 80
# Windows' devices, whatever follows a point.
RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)", re.IGNORECASE)


class NamesTexture(Protocol):
    """What has a texture of its own, as a texture set does: each is None where textures are not parted by it."""

    @property
    def tile(self) -> int | None: ...
    @property
    def material(self) -> str | None: ...
    @property
    def object(self) -> str | None: ...


def albedo_file(texture: Path) -> Path:
    """Where the albedo goes that is baked beside a normal texture: NAME_albedo; <UDIM> stays last, as programs want."""
    name = re.sub(r"((?<=.)[._-]?<UDIM>)?$", r"_albedo\1", texture.stem, count=1)
    return texture.with_name(f"{name}{texture.suffix}")


def split_by(pattern: str | os.PathLike[str]) -> set[str]:
    """What the pattern's tokens part textures by: "tile", "material", "object".

    Raises SettingsError for a token that is none of ours, or that stands in a folder's name.
    """
    path = Path(pattern)
    known = f"{', '.join(list(TOKENS)[:-1])} or {list(TOKENS)[-1]}"
    found = re.findall("<[^<>]*>", path.name)
    for token in found:
        if token not in TOKENS:
            raise SettingsError(f"{pattern}: {token} stands for nothing; use {known}, in capital letters")
    for token in re.findall("<[^<>]*>", str(path.parent)):
        if token.upper() in TOKENS:
            raise SettingsError(f"{pattern}: {token} stands in a folder's name; put it into the file's name")
    return {TOKENS[token] for token in found}


def texture_files(pattern: str | os.PathLike[str], texture_sets: Sequence[NamesTexture]) -> list[Path]:
    """Each texture set's file: the pattern with its tile's number, and its material's and object's names as files have.

    Names that become the same that way, on some system at least, are numbered.

    Raises SettingsError where the pattern has other tokens than the texture sets are parted by, or two get one file.
    """
    files = map_files(pattern, texture_sets)
    folded = [file.name.casefold() for file in files]
    for file, name in zip(files, folded, strict=True):
        if folded.count(name) > 1:
            raise SettingsError(
                f"several textures would be called {file}; put {', '.join(TOKENS)} into the name as needed, apart"
            )
    return files


def check_one_texture(file: str | os.PathLike[str]) -> None:
    """Raises SettingsError where a token in the file's name makes it stand for several textures: one is needed."""
    called = {"tile": "a tile's number", "material": "a material's name", "object": "an object's name"}
    name = "" if Path(file).is_file() else Path(file).name
    for token, what in TOKENS.items():
        if token in name:
            raise SettingsError(
                f"{file} stands for several textures; name one of them, with {called[what]} for {token}"
            )


def tile_patterns(pattern: str | os.PathLike[str], texture_sets: Sequence[NamesTexture]) -> list[Path]:
    """The same with <UDIM> left as it is: the name that programs know all tiles of a texture by, for each texture set.

    Raises SettingsError where the pattern has a token in a folder's name or one that is not known.
    """
    return _named(pattern, texture_sets, ["<UDIM>"] * len(texture_sets))


def map_files(pattern: str | os.PathLike[str], texture_sets: Sequence[NamesTexture]) -> list[Path]:
    """The same for maps that are read, of which several texture sets may share one.

    Raises SettingsError where the pattern has other tokens than the texture sets are parted by.
    """
    return _named(pattern, texture_sets, [str(texture_set.tile) for texture_set in texture_sets])


def _named(pattern: str | os.PathLike[str], texture_sets: Sequence[NamesTexture], tiles: Sequence[str]) -> list[Path]:
    path = Path(pattern)
    if not path.name:
        raise SettingsError(f"{path} names no file; give one")
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
    """Each name as it can stand in a file's name, on every system; no two alike."""
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
