"""MPSNet for Blender: a rig of three coloured lights, the one photo, its normals, and a baked normal texture.

The steps, and the rendering of training data, are the operators ``bpy.ops.mps.*``. Heavy work runs in child processes,
see ``child_process``. The package is the extension ``bl_ext.<repository>.mpsnet`` in Blender, and ``blender_addon``
with pip's bpy.
"""

import atexit
from importlib import import_module

import bpy

from .bake.gltf_export import GltfExtension
from .preferences import PACKAGE

# Blender's glTF exporter finds it by this name.
glTF2ExportUserExtension = GltfExtension

# Modules with classes or handlers, in the order in which they are registered.
_NAMES = (
    *("settings.scene", "preferences", "settings.choices", "presets", "operators.reporting", "operators.core_run"),
    *("rig.rig", "rig.several_rigs", "rig.light_preview", "rig.calibrate"),
    *("photo.photo", "photo.align", "photo.pick_points", "photo.check", "photo.look_through"),
    *("photo.paint_mask", "estimate.estimate", "estimate.error_map"),
    *("bake.bake", "bake.node_group", "heights.displace", "heights.integrate", "bake.many_views", "bake.coverage"),
    *("material", "training.training_data", "bake.relight", "start.try_it"),
    *("panels", "menu", "manual", "commands", "translations"),
)
_MODULES = [import_module(f".{name}", __name__) for name in _NAMES]


def register() -> None:
    """Add the operators, settings, panels and the ``mpsnet`` command to Blender."""
    for module in _MODULES:
        module.register()
    if bpy.app.module:
        # As an extension is. The glTF exporter looks there for what changes its images.
        bpy.context.preferences.addons.new().module = PACKAGE
        # Blender unregisters its extensions when it quits; pip's bpy does not, and then hangs.
        atexit.register(unregister)


def unregister() -> None:
    """Remove everything that :func:`register` added."""
    atexit.unregister(unregister)
    if bpy.app.module and (entry := bpy.context.preferences.addons.get(PACKAGE)):
        bpy.context.preferences.addons.remove(entry)
    for module in reversed(_MODULES):
        module.unregister()
