"""MPSNet for Blender: a rig of three coloured lights, the one photo, its normals, and a baked normal texture.

The steps, and the rendering of training data, are the operators ``bpy.ops.mps.*``. Heavy work runs in child processes,
see ``child_process``. The package is the extension ``bl_ext.<repository>.mpsnet`` in Blender, and ``blender_addon``
with pip's bpy.
"""

import atexit

import bpy

from . import commands, manual, menu, panels, preferences, presets, settings, translations

# Aliases, because the package's name already stands for the subpackage.
from .bake import bake as bake_step
from .bake import coverage, many_views, node_group, relight
from .bake.gltf_export import GltfExtension
from .estimate import error_map
from .estimate import estimate as estimate_step
from .heights import displace, integrate
from .material import material as material_step
from .operators import core_run, reporting
from .photo import align, check, drop, look_through, paint_mask, pick_points
from .photo import photo as photo_step
from .rig import calibrate, light_preview, several_rigs
from .rig import rig as rig_step
from .settings import choices
from .start import try_it
from .training import training_data

# Blender's glTF exporter finds it by this name.
glTF2ExportUserExtension = GltfExtension

_MODULES = (
    settings,
    preferences,
    choices,
    presets,
    reporting,
    core_run,
    rig_step,
    several_rigs,
    light_preview,
    calibrate,
    photo_step,
    drop,
    align,
    pick_points,
    check,
    look_through,
    paint_mask,
    estimate_step,
    error_map,
    bake_step,
    node_group,
    displace,
    integrate,
    many_views,
    coverage,
    material_step,
    training_data,
    relight,
    try_it,
    panels,
    menu,
    manual,
    commands,
    translations,
)


def register() -> None:
    """Add the operators, settings, panels and the ``mpsnet`` command to Blender."""
    for module in _MODULES:
        module.register()
    if bpy.app.module:
        # As an extension is. The glTF exporter looks there for what changes its images.
        bpy.context.preferences.addons.new().module = preferences.PACKAGE
        # Blender unregisters its extensions when it quits; pip's bpy does not, and then hangs.
        atexit.register(unregister)


def unregister() -> None:
    """Remove everything that :func:`register` added."""
    atexit.unregister(unregister)
    if bpy.app.module and (entry := bpy.context.preferences.addons.get(preferences.PACKAGE)):
        bpy.context.preferences.addons.remove(entry)
    for module in reversed(_MODULES):
        module.unregister()
