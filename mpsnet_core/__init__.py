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

__version__ = "0.2.0"

# From 1.31 on, onnxruntime sends telemetry and keeps a number of the machine and a store of events in the person's
# folders, unless this is set before its import. Whatever of ours imports it imports this first; children inherit it.
# (It has no say on Windows; see estimate/onnx_model.py.)
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

# Loaded on first use, so that Blender can import the light nouns without onnxruntime, OpenImageIO or trimesh.
_HOME = {
    "Align": "estimate.alignment.operation",
    "Bake": "bake.operations",
    "BakeViews": "bake.operations",
    "Baking": "bake.settings",
    "BaseMap": "bake.base_detail_removal",
    "CalibrateLights": "capture.calibrate.operations",
    "CalibrateMixing": "capture.calibrate.operations",
    "Camera": "scene.camera",
    "Capture": "capture.capture",
    "Check": "capture.operations",
    "Correction": "capture.correction",
    "Displacement": "relief.displacement.displacement",
    "Estimate": "estimate.operations",
    "FileError": "errors",
    "FindMask": "capture.operations",
    "FormatError": "errors",
    "GeometryError": "errors",
    "HeightMap": "relief.height_map",
    "HeightScale": "relief.height_files",
    "InputError": "errors",
    "Integrate": "relief.operations",
    "Labels": "scene.mesh_labels",
    "Lens": "scene.photogrammetry",
    "LightRig": "scene.rig",
    "LightsFound": "capture.calibrate.lights",
    "MakeMaterial": "relief.operations",
    "Material": "relief.material.material",
    "Mesh": "scene.mesh",
    "MixingFound": "capture.calibrate.mixing",
    "NearLights": "scene.rig",
    "NormalMap": "scene.normal_map",
    "Operation": "operation",
    "PRESETS": "bake.presets",
    "PosedPhoto": "scene.photogrammetry",
    "Preset": "bake.presets",
    "Quantize": "learning.operations",
    "Result": "operation",
    "Sample": "synthesis.sample",
    "SettingsError": "errors",
    "Superpose": "capture.operations",
    "SurfaceMesh": "relief.surface_mesh",
    "Synthesize": "synthesis.operations",
    "Texture": "bake.texture",
    "TextureSet": "bake.texture_sets",
    "Train": "learning.operations",
    "View": "bake.projection",
    "WorldLights": "scene.world_lights",
    "WriteCameras": "scene.operations",
    "albedo_from_white": "estimate.albedo",
    "ambient_occlusion": "relief.occlusion",
    "angular_error": "arrays.unit_vectors",
    "as_channels": "capture.superpose",
    "bake_normals": "bake.bake",
    "bake_texture_sets": "bake.bake",
    "blend_detail": "bake.detail_blending",
    "camera_of_lens": "scene.camera",
    "correct_low_frequencies": "bake.low_frequency_correction",
    "curvature": "relief.curvature",
    "curvature_picture": "relief.curvature",
    "curvature_range": "relief.curvature",
    "depth_of_mesh": "scene.mesh_depth",
    "displacement": "relief.displacement.displacement",
    "estimate_normals": "estimate.estimator",
    "estimate_sequence": "estimate.sequence.run",
    "find_lights": "capture.calibrate.lights",
    "find_mask": "capture.masks",
    "flat_material": "relief.material.material",
    "integrate": "relief.integration.integrate",
    "join_meshes": "scene.joined_mesh",
    "mixing_from_ball": "capture.calibrate.mixing",
    "near_rig": "scene.rig",
    "posed_photos": "scene.view_photos",
    "published_rig": "scene.rig",
    "read_albedo": "estimate.albedo",
    "read_base_map": "bake.detail_blending",
    "read_camera": "scene.camera",
    "read_cameras": "scene.photogrammetry",
    "read_capture": "capture.capture",
    "read_correction": "capture.correction",
    "read_height": "relief.height_files",
    "read_image": "io.image_reading",
    "read_mask": "io.image_reading",
    "read_mesh": "scene.mesh",
    "read_normals": "scene.normal_map",
    "read_rig": "scene.rig",
    "read_sample": "synthesis.sample",
    "relit": "relief.relight",
    "remove_base_detail": "bake.base_detail_removal",
    "superpose": "capture.superpose",
    "surface_mesh": "relief.surface_mesh",
    "undistorted": "scene.photogrammetry",
    "write_albedo": "estimate.albedo",
    "write_camera": "scene.camera",
    "write_height": "relief.height_files",
    "write_image": "io.image_writing",
    "write_material": "relief.material.material_files",
    "write_normals": "scene.normal_map",
    "write_rig": "scene.rig",
    "write_surface_mesh": "relief.surface_mesh",
    "write_texture": "bake.texture",
}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> "Any":
    if name in _HOME:
        return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*globals(), *_HOME]
