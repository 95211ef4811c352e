"""MPSNet for Blender: a rig of three coloured lights, the one photo, its normals, and a baked normal texture.

The steps, and the rendering of training data, are the operators ``bpy.ops.mps.*``. Heavy work runs in child processes,
see ``child_process``. The package is the extension ``bl_ext.<repository>.mpsnet`` in Blender, and ``blender_addon``
with pip's bpy.
"""

import atexit
from importlib import import_module
from typing import Any

import bpy
from bpy.app.handlers import load_factory_preferences_post, persistent

from .bake.gltf_export import GltfExtension
from .preferences import PACKAGE
from .registration import register_module, unregister_module

# Blender's glTF exporter finds it by this name.
glTF2ExportUserExtension = GltfExtension

# Modules with classes or handlers, in the order in which they are registered.
_NAMES = (
    *("settings.rig", "settings.photo", "settings.estimate", "settings.bake", "settings.heights"),
    *("settings.samples", "settings.record", "settings.scene", "settings.unknown", "preferences", "settings.choices"),
    *("presets", "operators.reporting", "operators.core_run", "operators.show_image", "operators.choose_file"),
    *("rig.rig", "rig.several_rigs", "rig.light_preview", "rig.rig_picture"),
    *("photo.photo", "photo.align", "photo.pick_points", "photo.look_through", "photo.find_lights", "photo.paint_mask"),
    *("estimate.estimate", "bake.bake", "bake.node_group", "heights.displace", "heights.integrate"),
    *("bake.many_views", "bake.coverage", "material", "training.training_data", "bake.relight"),
    *("bake.before_after", "bake.unwrap", "start.try_it", "start.scan"),
    *("panels", "menu", "manual", "commands", "translations"),
)
_MODULES = [import_module(f".{name}", __name__) for name in _NAMES]


def register() -> None:
    """Add the operators, settings, panels and the ``mpsnet`` command to Blender."""
    for module in _MODULES:
        register_module(module)
    if bpy.app.module:
        _enter_preferences()
        load_factory_preferences_post.append(_enter_preferences)
        # Blender unregisters its extensions when it quits; pip's bpy does not, and then hangs.
        atexit.register(unregister)


def unregister() -> None:
    """Remove everything that :func:`register` added."""
    atexit.unregister(unregister)
    if bpy.app.module:
        load_factory_preferences_post.remove(_enter_preferences)
        bpy.context.preferences.addons.remove(bpy.context.preferences.addons[PACKAGE])
    for module in reversed(_MODULES):
        unregister_module(module)


@persistent
def _enter_preferences(*_: Any) -> None:
    """Be in pip's bpy among the enabled add-ons, as an extension is: the glTF exporter asks those about images."""
    if PACKAGE not in bpy.context.preferences.addons:
        bpy.context.preferences.addons.new().module = PACKAGE
