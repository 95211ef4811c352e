"""The sidebar's tab "MPS": the steps from top to bottom; and "MPS Training", where the preferences show it."""

import bpy

from . import bake, estimate, heights, material, models, photo, rig, samples, start, truth, views

# In the order of the sidebar.
_STEPS = (start, rig, photo, estimate, truth, bake, heights, views, material, samples)

CLASSES = [*models.CLASSES, *(cls for step in _STEPS for cls in step.CLASSES)]

register, unregister = bpy.utils.register_classes_factory(CLASSES)
