"""Files that list photos with their cameras, which the add-on writes for ``mpsnet views``."""

import os
from collections.abc import Iterable
from pathlib import Path

from mpsnet_core.errors import FormatError
from mpsnet_core.io.files import existing_file, prefix_errors, read_json, write_json
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.camera import Camera, camera_data, camera_from_data

VIEWS_FORMAT, VIEWS_VERSION = "mpsnet-views", 1


def write_views(path: AnyPath, views: Iterable[tuple[str, AnyPath, Camera]]) -> None:
    """Write (name, path of the photo, camera) of each view atomically."""
    listed = [{"name": name, "photo": os.fspath(photo), "camera": camera_data(camera)} for name, photo, camera in views]
    write_json(path, {"format": VIEWS_FORMAT, "version": VIEWS_VERSION, "views": listed})


def _is_name(name: str) -> bool:
    return name.isprintable() and not set(name) & set("/\\:")


def read_views(path: AnyPath) -> list[tuple[str, Path, Camera]]:
    """Read what :func:`write_views` wrote, sorted by name. Photo paths are relative to the file's folder.

    Raises FileError if the file or a photo is missing, FormatError if the file is malformed.
    """
    file = Path(path)
    views = read_json(file, VIEWS_FORMAT, VIEWS_VERSION, ("views",)).get("views")
    if not isinstance(views, list) or not views:
        raise FormatError(f'{file} needs "views", a list of views; write it again')
    found = []
    for number, view in enumerate(views, 1):
        if not isinstance(view, dict) or not isinstance(view.get("camera"), dict):
            raise FormatError(f'{file}: view {number} needs "name", "photo" and "camera"; write it again')
        name, photo = view.get("name"), view.get("photo")
        if not isinstance(name, str) or not isinstance(photo, str) or not name or not _is_name(name):
            raise FormatError(
                f'{file}: view {number} needs a "name" of printable letters, without slashes or colons, and a path, '
                '"photo"'
            )
        with prefix_errors(f"{file}: view {name}"):
            found.append((name, existing_file(file.parent / photo, "photo"), camera_from_data(view["camera"])))
    return sorted(found, key=lambda view: view[0])
