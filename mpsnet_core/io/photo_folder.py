"""Folders of photos, looked up by name without suffix."""

from collections.abc import Collection
from pathlib import Path

from mpsnet_core.errors import FileError
from mpsnet_core.io.files import PHOTO_SUFFIXES, RAW_SUFFIXES
from mpsnet_core.io.opening import AnyPath


class PhotoFolder:
    """A folder of photos or masks, with or without subfolders. Each folder is listed once.

    Raises FileError if it is no folder.
    """

    def __init__(self, path: AnyPath, what: str = "photos") -> None:
        self.path = Path(path)
        if not self.path.is_dir():
            raise FileError(f"{path} is not a folder; name the folder of the {what}")
        self._listed: dict[Path, dict[str, list[Path]]] = {}

    def find(
        self, stems: Collection[str], who: str, within: Path | None = None, *, raw_only: bool = False
    ) -> Path | None:
        """The image in the folder `within` (this one by default) that has one of these names without suffix.

        If a photo exists both as raw and in another format, the raw file is returned. Case matters only if it
        distinguishes images. raw_only: return None unless it is a raw file.

        Raises FileError if several match. who: the photo's name in the message.
        """
        folder = self.path if within is None else within
        if folder not in self._listed:
            self._listed[folder] = _by_stem(folder)
        alike = [file for stem in {stem.lower() for stem in stems} for file in self._listed[folder].get(stem, [])]
        found = sorted([file for file in alike if file.stem in stems] or alike)
        raw = [file for file in found if file.suffix.lower() in RAW_SUFFIXES]
        if len(raw) == 1 or raw_only:
            return raw[0] if len(raw) == 1 else None
        if len(found) > 1:
            names = ", ".join(file.name for file in found)
            raise FileError(f"{who} may be any of {names} in {folder}; keep one of them")
        return found[0] if found else None


def _by_stem(folder: Path) -> dict[str, list[Path]]:
    """The images of a folder by lower-case name without suffix; empty if the folder cannot be listed."""
    found: dict[str, list[Path]] = {}
    try:
        for file in folder.iterdir():
            if file.suffix.lower() in PHOTO_SUFFIXES and file.is_file():
                found.setdefault(file.stem.lower(), []).append(file)
    except (OSError, ValueError):  # missing, or a name that is too long or has a null character
        return {}
    return found
