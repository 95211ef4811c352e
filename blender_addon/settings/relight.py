"""The state that relighting restores when it ends."""

import bpy
from bpy.props import CollectionProperty, PointerProperty, StringProperty

from .rig import MPS_PG_light


class MPS_PG_relight(bpy.types.PropertyGroup):
    """The white lamp that swings around the result, while it is there."""

    pivot: PointerProperty(name="Pivot", description="Empty that the lamp swings around", type=bpy.types.Object)
    lamp: PointerProperty(name="Lamp", description="The lamp, while it is there", type=bpy.types.Object)
    hidden: CollectionProperty(name="Hidden", description="The rigs' lights that it hid", type=MPS_PG_light)
    view_layer: StringProperty(name="View Layer", description="Where it hid them")
    shading: StringProperty(name="Shading", description="How the viewport was shaded before, as JSON")
