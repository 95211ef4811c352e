"""Whether this program made a file, which it may then replace."""

import contextlib
import json
import zipfile
import zlib
from contextlib import closing
from pathlib import Path

from mpsnet_core.io.image_input import image_attribute, image_input
from mpsnet_core.io.marks import SOFTWARE, says_made
from mpsnet_core.io.opening import MAX_TEXT_BYTES


def is_ours(file: Path, json_format: str = "") -> bool:
    """Whether this program made a file: an image, a JSON file or a checkpoint that says so. Others do not tell.

    json_format: the "format" of a JSON file; by default any of this program's.
    """
    if file.suffix.lower() == ".json":
        return _json_format(file).startswith(json_format or f"{SOFTWARE}-")
    if file.suffix.lower() == ".checkpoint":
        return _has_format(file)
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
    except (OSError, ValueError, RuntimeError, NotImplementedError, zipfile.BadZipFile, zlib.error):
        return False
