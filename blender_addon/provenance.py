"""What a result was made of: stored with its image, so that the panel can show when it is out of date.

Each ingredient has the name that the panel shows ("Photo", "Lights", "Model") and a text that differs where the
ingredient does. They go with the image wherever it goes: renamed, saved and loaded, undone, chosen for another step.
"""

import json
import math
import time
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import datetime
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.errors import FileError

from .image_records import MADE_BY, from_json, images_of, origin, remember, remembered

Provenance = dict[str, str]

# Stored with the image.
_MADE, _MADE_FROM = "made", "made_from"

# What later steps take from those who make it.
_TAKEN_ON = {"render_photo": "photo", "open_photo": "photo", "superpose": "photo", "estimate": "normals"}

_SIZE_SECONDS = 1.0
# When files were looked at, and their sizes: for the panel alone, see `cached_file_sizes`.
_sizes: dict[Path, tuple[float, int]] = {}
# When each file was last written in this session: undo takes back what Blender knows of it, and not the file.
_written: dict[Path, str] = {}
_lately = ContextVar("lately", default=False)


def chosen(
    settings: type,
    group: bpy.types.PropertyGroup,
    *,
    only: Collection[str] = (),
    without: Collection[str] = ("output",),
) -> Provenance:
    """The settings of a step that shape its result, as they stand: `only` these, else all `without` those."""
    names = only or [name for name in settings.__annotations__ if name not in without]
    return {group.bl_rna.properties[name].name: str(getattr(group, name)) for name in names}


def stamp(image: bpy.types.Image | None) -> str:
    """A text that another image, or the same one made anew or exported again, does not have.

    A file's time and folder are not in it: a project that is copied keeps its results.
    """
    if image is None:
        return ""
    path = origin(image)
    size = image.packed_file.size if image.packed_file else _size(path)
    return f"{path.name} {remembered(image, _MADE) or ''} {size}"


def file_stamp(path: str) -> str:
    """The same for a file that is named in the settings; "" for none."""
    return f"{Path(path).name} {_size(Path(bpy.path.abspath(path)))}" if path else ""


def is_there(path: Path) -> bool:
    """Whether there is a file or a folder of that name."""
    return _size(path) >= 0


@contextmanager
def cached_file_sizes() -> Iterator[None]:
    """Within, files have the sizes that they had up to a second ago: panels are drawn many times a second, and a file's
    folder may be far away."""
    before = _lately.set(True)
    try:
        yield
    finally:
        _lately.reset(before)


def _size(path: Path) -> int:
    """In bytes; -1 where there is no such file."""
    seen, size = _sizes.get(path, (-math.inf, -1))
    if _lately.get() and time.monotonic() - seen < _SIZE_SECONDS:
        return size
    try:
        size = path.stat().st_size
    except OSError:
        size = -1
    _sizes[path] = time.monotonic(), size
    return size


def rounded(values: ArrayLike, decimals: int) -> str:
    """Numbers as a text that does not change with the rounding errors of an evaluation."""
    return " ".join(f"{value + 0.0:.{decimals}f}" for value in np.round(np.ravel(values), decimals))


def store_provenance(image: bpy.types.Image, verb: str, ingredients: Provenance) -> None:
    """Note with an image that it was made now, by which operator ("estimate" for ``mps.estimate``), and of what."""
    made = datetime.now().isoformat()
    for what, text in {_MADE: made, MADE_BY: verb, _MADE_FROM: json.dumps(ingredients)}.items():
        remember(image, what, text)
    if verb == "open_photo":
        _written.pop(origin(image), None)
    else:
        _written[origin(image)] = made


def written_in_this_session(file: Path) -> bool:
    """Whether a result was written there since Blender was started, even where that was undone."""
    return file in _written


def made_by(image: bpy.types.Image) -> str:
    """The operator that made an image; "" where none is known."""
    return remembered(image, MADE_BY) or ""


def refuse_to_overwrite(verb: str, outputs: Iterable[Path]) -> None:
    """Raise InputError if a result of `verb` would be written over a photo or its normals that this file uses.

    Each may be made anew in its place.
    """
    for image in images_of(outputs):
        what = _TAKEN_ON.get(made_by(image), "")
        if what not in ("", _TAKEN_ON.get(verb)):
            path = origin(image)
            raise FileError(f'the result would overwrite {path}, the {what} "{image.name}"; choose another output')


def changed_since(image: bpy.types.Image, ingredients: Provenance) -> list[str]:
    """The names of those ingredients that are not as they were when the image was made; "File" where its file is that
    of a later run, which was undone.

    What is not known of both times counts as unchanged.
    """
    before, made = from_json(remembered(image, _MADE_FROM), dict), remembered(image, _MADE)
    undone = not image.packed_file and _written.get(origin(image), made) != made
    return ["File"] * undone + [name for name, text in ingredients.items() if before.get(name, text) != text]


def made_when(image: bpy.types.Image) -> str:
    """When an image was made, in words for the panel: "14:32", or with its day where that was another; "" unknown."""
    try:
        made = datetime.fromisoformat(remembered(image, _MADE) or "")
    except ValueError:
        return ""
    today = made.date() == datetime.now().date()
    return f"{made:%H:%M}" if today else f"{made.day} {made:%b %Y, %H:%M}"
