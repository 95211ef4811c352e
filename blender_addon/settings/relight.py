"""What the relighting keeps of how things stood before."""

import bpy
from bpy.props import PointerProperty, StringProperty


class MPS_PG_relight(bpy.types.PropertyGroup):
    """The white lamp that swings around the result, while it is there."""

    pivot: PointerProperty(type=bpy.types.Object)
    lamp: PointerProperty(type=bpy.types.Object)
    shading: StringProperty()  # of the viewport before, as JSON
