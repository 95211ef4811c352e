"""The state that relighting restores when it ends."""

import bpy
from bpy.props import CollectionProperty, StringProperty

from .declared import object_pointer
from .rig import MPS_PG_light


class MPS_PG_relight(bpy.types.PropertyGroup):
    """The white lamp that swings around the result, while it is there."""

    pivot: object_pointer("Pivot", "Empty that the lamp swings around")
    lamp: object_pointer("Lamp", "The lamp, while it is there")
    hidden: CollectionProperty(name="Hidden", description="The rigs' lights that it hid", type=MPS_PG_light)
    view_layer: StringProperty(name="View Layer", description="Where it hid them")
    shading: StringProperty(name="Shading", description="How the viewport was shaded before, as JSON")
