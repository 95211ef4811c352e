"""Surface normals from one photo under red, green and blue light (multispectral photometric stereo).

The nouns are small frozen dataclasses that hold NumPy arrays, the verbs are functions that take nouns and give nouns::

    from mpsnet_core import estimate_normals, read_capture, read_rig, write_normals

    capture = read_capture("photo.exr", read_rig("rig.json"))
    write_normals("normals.png", estimate_normals(capture, "lambertian"))

Camera space everywhere: x right, y up, z towards the camera, right-handed.
"""

import importlib
import os

TYPE_CHECKING = False  # not from typing, which takes longer to load than the rest of this
if TYPE_CHECKING:
    from typing import Any

__version__ = "0.1.0"

# From 1.31 on, onnxruntime sends telemetry and keeps a number of the machine and a store of events in the person's
# folders, unless this is set before its import. Whatever of ours imports it imports this first; children inherit it.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

# Loaded on first use, so that Blender can import the light nouns without onnxruntime, OpenImageIO or trimesh.
_HOME = {
    "Baking": "surface.baking",
    "Camera": "camera",
    "Capture": "capture",
    "Correction": "correction",
    "Displacement": "heights.on_uvs",
    "HeightMap": "heights.height_map",
    "HeightScale": "heights.height_files",
    "InputError": "errors",
    "Labels": "surface.labels",
    "Lens": "photogrammetry",
    "LightRig": "rig",
    "LightsFound": "calibrate.lights",
    "Material": "material.material",
    "Mesh": "surface.mesh",
    "MixingFound": "calibrate.mixing",
    "NearLights": "rig",
    "NormalMap": "normals",
    "PRESETS": "surface.presets",
    "PosedPhoto": "photogrammetry",
    "Present": "surface.shown",
    "Preset": "surface.presets",
    "Sample": "synthesis.sample",
    "Sheet": "surface.sheets",
    "SurfaceMesh": "heights.surface_mesh",
    "Texture": "surface.texture",
    "View": "surface.bake",
    "WorldLights": "world_lights",
    "albedo_from_white": "estimate.albedo",
    "ambient_occlusion": "heights.occlusion",
    "angular_error": "normals",
    "bake_normals": "surface.bake",
    "bake_sheets": "surface.bake",
    "camera_of_lens": "camera",
    "curvature": "heights.curvature",
    "curvature_picture": "heights.curvature",
    "curvature_range": "heights.curvature",
    "depth_of_mesh": "surface.depth",
    "displacement": "heights.on_uvs",
    "estimate_normals": "estimate",
    "estimate_sequence": "sequence.run",
    "find_lights": "calibrate.lights",
    "find_mask": "masks",
    "flat_material": "material.material",
    "integrate": "heights.integrate",
    "joined": "surface.joined",
    "laid_onto": "surface.onto",
    "levelled": "surface.level",
    "mixing_from_ball": "calibrate.mixing",
    "near_rig": "rig",
    "posed_photos": "views",
    "published_rig": "rig",
    "read_albedo": "estimate.albedo",
    "read_camera": "camera",
    "read_cameras": "photogrammetry",
    "read_capture": "capture",
    "read_correction": "correction",
    "read_height": "heights.height_files",
    "read_image": "images",
    "read_mask": "images",
    "read_mesh": "surface.mesh",
    "read_normals": "normals",
    "read_present_map": "surface.onto",
    "read_rig": "rig",
    "read_sample": "synthesis.sample",
    "relit": "heights.relight",
    "superpose": "superpose",
    "as_channels": "superpose",
    "surface_mesh": "heights.surface_mesh",
    "undistorted": "photogrammetry",
    "without_present": "surface.shown",
    "write_albedo": "estimate.albedo",
    "write_camera": "camera",
    "write_height": "heights.height_files",
    "write_image": "images",
    "write_material": "material.material_files",
    "write_normals": "normals",
    "write_rig": "rig",
    "write_surface_mesh": "heights.surface_mesh",
    "write_texture": "surface.texture",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> "Any":
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
