"""Surface normals from one photo under red, green and blue light (multispectral photometric stereo).

Data types are small frozen dataclasses that hold NumPy arrays. Functions take them and return new ones::

    from mpsnet_core import estimate_normals, read_capture, read_rig, write_normals

    capture = read_capture("photo.exr", read_rig("rig.json"))
    write_normals("normals.png", estimate_normals(capture, "lambertian"))

Vectors are in camera space: x right, y up, z towards the camera, right-handed.
"""

import importlib
import os

__version__ = "0.2.0"

# From 1.31 on, onnxruntime sends telemetry and keeps a machine ID and a store of events in the user's folders, unless
# this variable is set before it is imported. All our imports of onnxruntime come after this module; child processes
# inherit the variable. It has no effect on Windows: see estimate/onnx_model.py.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

# Names are imported on first use: Blender can import the light modules without onnxruntime, OpenImageIO or trimesh.
# The type stub lists the module of each name: `from MODULE import NAME as NAME`.
_STUB = __spec__.loader.get_data(f"{__file__}i").decode()  # type: ignore[union-attr]  # works in zips, too
_HOME = {words[3]: words[1] for words in map(str.split, _STUB.splitlines()) if words[:1] == ["from"]}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> object:
    if name in _HOME:
        return getattr(importlib.import_module(_HOME[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
