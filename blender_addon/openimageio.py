"""OpenImageIO within Blender's own process."""

import importlib
import sys
from pathlib import Path

import bpy


def load_openimageio() -> None:
    """Import the OpenImageIO that Blender comes with, before anything here imports the extension's.

    Windows finds a DLL by its name alone: the extension's module would get the DLL that Blender has loaded, of another
    version. A Blender without the module has the extension's all the same.
    """
    if bpy.app.module or "OpenImageIO" in sys.modules:
        return
    places = sys.path[:]
    sys.path.sort(key=lambda place: ".local" in Path(place).parts)  # where Blender puts the wheels of extensions
    try:
        importlib.import_module("OpenImageIO")
    finally:
        sys.path[:] = places
