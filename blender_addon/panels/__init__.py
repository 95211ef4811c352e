"""The sidebar's tab "MPS": the steps from top to bottom, and training data."""

import bpy

from . import bake, estimate, heights, photo, rig, samples, start, views

# In the order of the sidebar.
_STEPS = (start, rig, photo, estimate, bake, heights, views, samples)

register, unregister = bpy.utils.register_classes_factory([cls for step in _STEPS for cls in step.CLASSES])
