"""What is stored with an image: its photo's rig, camera and lens, and, for a result, the inputs that it was made of.

With the inputs, the panel can show when a result is out of date. Each ingredient has the name that the panel shows
("Photo", "Lights", "Model") and a fingerprint as text. They stay with the image when it is renamed, saved and loaded,
undone, or chosen for another step.
"""

import json
import math
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

import bpy
import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.errors import FileError
from mpsnet_core.io.files import resolved
from mpsnet_core.scene.camera import read_camera
from mpsnet_core.scene.rig import read_rig

Stored = TypeVar("Stored", list[Any], dict[str, Any])

# Stored with each image that the add-on loads, and, with the operator, with each that it makes.
LOADED, MADE_BY = "loaded", "made_by"

_READERS = {"rig": read_rig, "camera": read_camera}
Provenance = dict[str, str]
# Keys of data stored with the image.
_MADE, _MADE_FROM = "made", "made_from"
# Results that later steps need, by the operators that make them.
_NEEDED_LATER = {"render_photo": "photo", "open_photo": "photo", "superpose": "photo", "estimate": "normals"}
_SIZE_SECONDS = 1.0
# Times of look-up and sizes of files, for the panel alone: see `cached_file_sizes`.
_sizes: dict[Path, tuple[float, int]] = {}
# When each file was last written in this session: undo reverts Blender's data, but not the file.
_written: dict[Path, str] = {}
_sizes_cached = ContextVar("lately", default=False)


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


def chosen(
    group: bpy.types.PropertyGroup, *, only: Collection[str] = (), without: Collection[str] = ("output",)
) -> Provenance:
    """The current settings of a step that affect its result: `only` these, otherwise all `without` those."""
    settings = [one.identifier for one in group.bl_rna.properties if one.is_skip_save]  # see settings/declared.py
    names = only or [name for name in settings if name not in without]
    return {group.bl_rna.properties[name].name: str(getattr(group, name)) for name in names}


def stamp(image: bpy.types.Image | None) -> str:
    """A text that is unique to this version of an image: other images, or new results, have another.

    It does not include a file's time and folder: a copied project keeps its results.
    """
    if image is None:
        return ""
    path = origin(image)
    size = image.packed_file.size if image.packed_file else _size(path)
    return f"{path.name} {remembered(image, _MADE) or ''} {size}"


def file_stamp(path: str) -> str:
    """:func:`stamp` of a file in the settings; "" for none."""
    return f"{Path(path).name} {_size(Path(bpy.path.abspath(path)))}" if path else ""


def is_there(path: Path) -> bool:
    """Whether a file or folder exists."""
    return _size(path) >= 0


@contextmanager
def cached_file_sizes() -> Iterator[None]:
    """Within the with block, file sizes are cached for up to a second: panels are drawn often, and a file's folder may
    be on a network."""
    before = _sizes_cached.set(True)
    try:
        yield
    finally:
        _sizes_cached.reset(before)


def _size(path: Path) -> int:
    """Size in bytes; -1 if there is no such file."""
    seen, size = _sizes.get(path, (-math.inf, -1))
    if _sizes_cached.get() and time.monotonic() - seen < _SIZE_SECONDS:
        return size
    try:
        size = path.stat().st_size
    except OSError:
        size = -1
    _sizes[path] = time.monotonic(), size
    return size


def rounded(values: ArrayLike, decimals: int) -> str:
    """Numbers as text, without the rounding errors of an evaluation."""
    return " ".join(f"{value + 0.0:.{decimals}f}" for value in np.round(np.ravel(values), decimals))


def store_provenance(image: bpy.types.Image, verb: str, ingredients: Provenance) -> None:
    """Store with an image the current time, its operator ("estimate" for ``mps.estimate``) and its ingredients."""
    made = datetime.now().isoformat()
    for what, text in {_MADE: made, MADE_BY: verb, _MADE_FROM: json.dumps(ingredients)}.items():
        remember(image, what, text)
    if verb == "open_photo":
        _written.pop(origin(image), None)
    else:
        _written[origin(image)] = made


def written_in_this_session(file: Path) -> bool:
    """Whether a result was written there since Blender was started, even if that was undone."""
    return file in _written


def made_by(image: bpy.types.Image) -> str:
    """The operator that made an image; "" if it is unknown."""
    return remembered(image, MADE_BY) or ""


def refuse_to_overwrite(verb: str, outputs: Iterable[Path]) -> None:
    """Raise InputError if a result of `verb` would overwrite a photo, or its normals, that this file uses.

    A result of the same kind may replace it.
    """
    for image in images_of(outputs):
        what = _NEEDED_LATER.get(made_by(image), "")
        if what not in ("", _NEEDED_LATER.get(verb)):
            path = origin(image)
            raise FileError(f'the result would overwrite {path}, the {what} "{image.name}"; choose another output')


def changed_since(image: bpy.types.Image, ingredients: Provenance) -> list[str]:
    """The names of ingredients that changed since the image was made; "File" if a later, undone run wrote its file.

    An ingredient that is unknown at one of the two times counts as unchanged.
    """
    before, made = from_json(remembered(image, _MADE_FROM), dict), remembered(image, _MADE)
    undone = not image.packed_file and _written.get(origin(image), made) != made
    return ["File"] * undone + [name for name, text in ingredients.items() if before.get(name, text) != text]


def made_when(image: bpy.types.Image) -> str:
    """When an image was made, as text for the panel: "14:32", with the date if it was another day; "" if unknown."""
    try:
        made = datetime.fromisoformat(remembered(image, _MADE) or "")
    except ValueError:
        return ""
    today = made.date() == datetime.now().date()
    return f"{made:%H:%M}" if today else f"{made.day} {made:%b %Y, %H:%M}"
