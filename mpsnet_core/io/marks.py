"""What this program writes into its files of what they are: results are never taken for photos, and only what is its
own is replaced unasked."""

import contextlib
import json
import zipfile
from contextlib import closing
from pathlib import Path
from typing import Literal

from mpsnet_core import __version__
from mpsnet_core.io.opening import DAMAGED, MAX_TEXT_BYTES

ENCODINGS: tuple[Literal["srgb", "linear"], ...] = ("srgb", "linear")

# Who made a file, as images and JSON files state it.
SOFTWARE = "mpsnet"
BY = f" by {SOFTWARE} "
_ASSUMED = "linear values, of photos that state no encoding and were read as "


def made(what: str) -> str:
    """The description of an image that is not a photo: what it is, and that this program made it."""
    return f"{what}{BY}{__version__}"


def curve_assumed(encoding: Literal["srgb", "linear"] | None) -> str | None:
    """The description of a photo that was made of others whose files did not state their encoding; None if they did."""
    return encoding and f"{_ASSUMED}{encoding}"


def assumed_curve(description: str) -> Literal["srgb", "linear"] | None:
    """The encoding that was assumed, by an image's description; None if none was."""
    return {curve_assumed(one): one for one in ENCODINGS}.get(description)


def says_made(description: str) -> bool:
    """Whether an image's description says so; that of heights is JSON."""
    return BY in description or f'"{SOFTWARE}-' in description


def is_ours(file: Path, json_format: str = "") -> bool:
    """Whether this program made a file: an image, a JSON file or a checkpoint that says so. Others do not tell.

    json_format: the "format" of a JSON file; by default any of this program's.
    """
    if file.suffix.lower() == ".json":
        return _json_format(file).startswith(json_format or f"{SOFTWARE}-")
    if file.suffix.lower() == ".checkpoint":
        return _has_format(file)
    from mpsnet_core.io.image_input import image_attribute, image_input  # OpenImageIO, which Blender's process lacks

    source = image_input(file)
    if source is None:
        return False
    with closing(source), contextlib.suppress(UnicodeDecodeError):
        spec = source.spec()
        description = image_attribute(spec, "ImageDescription", str) or ""
        made = image_attribute(spec, "Software", str) == SOFTWARE or says_made(description)
        return made or any(one.name.startswith(f"{SOFTWARE}:") for one in spec.extra_attribs)
    return False


def _json_format(file: Path) -> str:
    try:
        data = json.loads(file.read_text(encoding="utf-8")) if file.stat().st_size <= MAX_TEXT_BYTES else None
    except (OSError, ValueError, RecursionError):
        data = None
    return str(data.get("format")) if isinstance(data, dict) else ""


def _has_format(checkpoint: Path) -> bool:
    """Whether PyTorch's archive has the format of our checkpoints in it."""
    try:
        with zipfile.ZipFile(checkpoint) as archive:
            found = next((entry for entry in archive.infolist() if entry.filename.endswith("/data.pkl")), None)
            return found is not None and f"{SOFTWARE}-checkpoint".encode() in archive.open(found).read(MAX_TEXT_BYTES)
    except DAMAGED:
        return False
