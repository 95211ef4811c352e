"""OpenImageIO within Blender's own process."""

import importlib
import sys
from pathlib import Path

import bpy


def load_openimageio() -> None:
    """Import the OpenImageIO that Blender ships with, before anything imports the extension's.

    Windows finds a DLL by its name alone: the extension's module would get the DLL that Blender has loaded, of another
    version. In a Blender without the module, the extension's is imported.
    """
    if bpy.app.module or "OpenImageIO" in sys.modules:
        return
    places = sys.path[:]
    sys.path.sort(key=lambda place: ".local" in Path(place).parts)  # the folder of extensions' wheels
    try:
        importlib.import_module("OpenImageIO")
    finally:
        sys.path[:] = places
