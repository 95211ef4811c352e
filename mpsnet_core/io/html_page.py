"""Self-contained HTML pages: one style for all reports, images embedded."""

import base64
from pathlib import Path

from mpsnet_core.arrays.types import F32
from mpsnet_core.errors import SettingsError
from mpsnet_core.io.files import writable_path
from mpsnet_core.io.image_writing import png_bytes
from mpsnet_core.io.opening import AnyPath

HEAD = """<!doctype html><html lang='en'><meta charset='utf-8'><title>{title}</title>
<style>body{{background:#222;color:#eee;font:15px sans-serif;margin:2em}}pre{{font-size:14px;overflow-x:auto}}
h2{{font-size:16px;margin:1.5em 0 .3em}}img{{max-width:100%}}svg{{display:block;margin:1em 0}}</style>
<h1>{title}</h1>
"""


def page_path(path: AnyPath) -> Path:
    """`path` as a Path, for checks before long work. Raises FileError, or SettingsError for another suffix."""
    path = writable_path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise SettingsError(f"cannot write {path}: reports are written as .html; change the suffix")
    return path


def data_url(picture: F32) -> str:
    """Display values (H, W, 3) as a PNG in a data URL."""
    return "data:image/png;base64," + base64.b64encode(png_bytes(picture)).decode("ascii")
