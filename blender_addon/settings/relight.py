"""What the relighting keeps of how things stood before."""

import bpy
from bpy.props import PointerProperty, StringProperty


class MPS_PG_relight(bpy.types.PropertyGroup):
    """The white lamp that swings around the result, while it is there."""

    pivot: PointerProperty(name="Pivot", description="Empty that the lamp swings around", type=bpy.types.Object)
    lamp: PointerProperty(name="Lamp", description="The lamp, while it is there", type=bpy.types.Object)
    shading: StringProperty(name="Shading", description="How the viewport was shaded before, as JSON")
