"""The sidebar's tab "MPS" with the steps from top to bottom, and "MPS Training", which a preference enables."""

import bpy

from ..registration import classes_in
from . import bake, estimate, heights, lights, material, models, photo, rig, samples, start, traffic_light, views

# In the sidebar's order.
_STEPS = (traffic_light, models, start, rig, photo, lights, estimate, bake, heights, views, material, samples)

CLASSES = [cls for step in _STEPS for cls in classes_in(step)]

register, unregister = bpy.utils.register_classes_factory(CLASSES)
