"""The state that relighting restores when it ends."""

import bpy
from bpy.props import CollectionProperty, StringProperty

from .bake import MPS_PG_overlay
from .declared import BoolSetting, object_pointer
from .rig import MPS_PG_light


class MPS_PG_relight(bpy.types.PropertyGroup):
    """The white lamp that swings around the result, while it is there."""

    neutral: BoolSetting(
        "Neutral Material",
        "From the next Relight on, show objects in grey whose albedo was not baked, so that colours do not hide their "
        "relief. Their own materials stay as they are",
        default=True,
    )
    overlays: CollectionProperty(
        name="Overlays", description="The copies in neutral materials, while they are shown", type=MPS_PG_overlay
    )
    pivot: object_pointer("Pivot", "Empty that the lamp swings around")
    lamp: object_pointer("Lamp", "The lamp, while it is there")
    hidden: CollectionProperty(name="Hidden", description="The rigs' lights that it hid", type=MPS_PG_light)
    view_layer: StringProperty(name="View Layer", description="Where it hid them")
    shading: StringProperty(name="Shading", description="How the viewport was shaded before, as JSON")
