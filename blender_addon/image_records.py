"""Data of an image's photo: rig, camera and lens, in sidecar files and in the .blend file."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import bpy

from mpsnet_core.io.files import resolved
from mpsnet_core.scene.camera import read_camera
from mpsnet_core.scene.rig import read_rig

Stored = TypeVar("Stored", list[Any], dict[str, Any])

# Stored with each image that the add-on loads, and, with the operator, with each that it makes.
LOADED, MADE_BY = "loaded", "made_by"

_READERS = {"rig": read_rig, "camera": read_camera}


def sidecar(picture: Path, what: str) -> Path:
    """The sidecar file of a photo with its "rig" or "camera": NAME.rig.json, NAME.camera.json.

    They contain the state when the photo was taken, even if objects were moved since.
    """
    return picture.with_name(f"{picture.stem}.{what}.json")


def read_sidecar(picture: Path, what: str) -> str | None:
    """The text of a photo's "rig" or "camera" file, None if there is none. Raises InputError if it is malformed."""
    file = sidecar(picture, what)
    if not file.is_file():
        return None
    _READERS[what](file)  # raises if malformed
    return file.read_text(encoding="utf-8")


def remember(image: bpy.types.Image, what: str, text: str | None) -> None:
    """Store a photo's "rig" or "camera" (the text of such a file) or its "lens" with the image; None removes it."""
    if text is not None:
        image[f"mpsnet_{what}"] = text
    elif f"mpsnet_{what}" in image:
        del image[f"mpsnet_{what}"]


def remembered(image: bpy.types.Image, what: str) -> str | None:
    """The text that :func:`remember` stored, or None."""
    text = image.get(f"mpsnet_{what}")
    return text if isinstance(text, str) else None  # a hostile file may hold anything by that name


def is_own(image: bpy.types.Image) -> bool:
    """Whether the add-on made or loaded an image. All others are the user's, and must not change."""
    return any(remembered(image, what) for what in (LOADED, MADE_BY))


def origin(image: bpy.types.Image) -> Path:
    """The file that an image shows: its own, or the camera raw file that its own was made from."""
    source = remembered(image, "source")
    if source is not None and Path(source).is_absolute():
        return Path(source)
    return Path(bpy.path.abspath(image.filepath, library=image.library))


def images_of(files: Iterable[Path]) -> Iterator[bpy.types.Image]:
    """The images in use that show one of these files, in any spelling of the path."""
    meant = {resolved(file) for file in files}
    return (image for image in bpy.data.images if image.users and resolved(origin(image)) in meant)


def from_json(text: str | None, kind: type[Stored]) -> Stored:
    """The value that was stored as JSON; an empty one if it is missing or of another type, as in a hostile file."""
    try:
        found = json.loads(text or "null")
    except (ValueError, RecursionError):
        found = None
    return found if isinstance(found, kind) else kind()
