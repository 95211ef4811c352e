"""Several rigs in one scene, each with its photo and its estimate."""

import bpy
from bpy.props import CollectionProperty, PointerProperty

from .estimate import MPS_PG_estimate
from .photo import MPS_PG_photo
from .record import MPS_PG_record
from .rig import MPS_PG_rig


class MPS_PG_one_of_rigs(bpy.types.PropertyGroup):
    """One of several rigs. What it holds counts while another one is chosen: that of the chosen rig is in the scene."""

    rig: PointerProperty(name="Rig", description="The rig's settings and objects", type=MPS_PG_rig)
    photo: PointerProperty(name="Photo", description="The photo that was taken with it", type=MPS_PG_photo)
    estimate: PointerProperty(name="Estimate", description="The normals of that photo", type=MPS_PG_estimate)
    records: CollectionProperty(
        name="Records", description="How the last run of each of its operators ended", type=MPS_PG_record
    )
