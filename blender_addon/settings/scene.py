"""Storage of settings in the scene and in photos, and of the running job in the window manager."""

from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..child_process.trust import is_ticked, tick
from ..image_records import MADE_BY, remembered
from .align import MPS_PG_align, MPS_PG_image
from .bake import MPS_PG_bake
from .calibrate import MPS_PG_calibrate
from .declared import BoolSetting
from .displace import MPS_PG_displace
from .estimate import MPS_PG_estimate
from .heights import MPS_PG_heights
from .material import MPS_PG_material
from .photo import MPS_PG_photo
from .record import MPS_PG_record
from .relight import MPS_PG_relight
from .rig import MPS_PG_rig
from .samples import MPS_PG_samples
from .superpose import MPS_PG_superpose
from .views import MPS_PG_views

_PHOTOGRAPH, _RENDER = range(2)
_CHOSEN = "mpsnet_way"


def _way(mps: Any) -> int:
    """The chosen way; without a choice, as in files of earlier versions, the one that fits the scene's content."""
    chosen, photo = mps.get(_CHOSEN), mps.photo.image
    if chosen in (_PHOTOGRAPH, _RENDER):
        return int(chosen)
    rendered = remembered(photo, MADE_BY) == "render_photo" if photo is not None else bool(mps.rig.lights)
    return _RENDER if rendered else _PHOTOGRAPH


def _choose_way(mps: Any, way: int) -> None:
    mps[_CHOSEN] = way


class MPS_PG_one_of_rigs(bpy.types.PropertyGroup):
    """One of several rigs. What it holds counts while another one is chosen: that of the chosen rig is in the scene."""

    rig: PointerProperty(name="Rig", description="The rig's settings and objects", type=MPS_PG_rig)
    photo: PointerProperty(name="Photo", description="The photo that was taken with it", type=MPS_PG_photo)
    estimate: PointerProperty(name="Estimate", description="The normals of that photo", type=MPS_PG_estimate)
    records: CollectionProperty(
        name="Records", description="How the last run of each of its operators ended", type=MPS_PG_record
    )


class MPS_PG_scene(bpy.types.PropertyGroup):
    """Everything the add-on stores in a scene: ``scene.mps``."""

    way: EnumProperty(
        name="Photo",
        description="Where the photo comes from, and so which settings the panel shows",
        items=[
            ("PHOTOGRAPH", "Photograph", "You took the photo of a real object under real lights"),
            ("RENDER", "Render", "Blender renders the photo of an object in this scene, under a rig of lights"),
        ],
        get=_way,
        set=_choose_way,
    )
    before: PointerProperty(
        name="Scene Before", description="The scene that was shown before Try It made this one", type=bpy.types.Scene
    )
    rig: PointerProperty(type=MPS_PG_rig)
    calibrate: PointerProperty(type=MPS_PG_calibrate)
    photo: PointerProperty(type=MPS_PG_photo)
    align: PointerProperty(type=MPS_PG_align)
    superpose: PointerProperty(type=MPS_PG_superpose)
    estimate: PointerProperty(type=MPS_PG_estimate)
    bake: PointerProperty(type=MPS_PG_bake)
    heights: PointerProperty(type=MPS_PG_heights)
    displace: PointerProperty(type=MPS_PG_displace)
    views: PointerProperty(type=MPS_PG_views)
    material: PointerProperty(type=MPS_PG_material)
    samples: PointerProperty(type=MPS_PG_samples)
    rigs: CollectionProperty(name="Rigs", description="The scene's rigs, where it has several", type=MPS_PG_one_of_rigs)
    chosen_rig: IntProperty(
        name="Chosen Rig",
        description="Number in the list, from 0, of the rig that the panel shows. Change it with mps.choose_rig",
        min=0,
    )
    records: CollectionProperty(
        name="Records", description="How the last run of each operator ended", type=MPS_PG_record
    )
    relight: PointerProperty(type=MPS_PG_relight)


class MPS_PG_job(bpy.types.PropertyGroup):
    """The child process that runs at the moment: ``window_manager.mps``. Neither saved nor undone."""

    running: StringProperty(name="Running", description="Operator whose work runs. Empty: none")
    chain: StringProperty(name="Chain", description="Operator that runs several, one of which runs now. Empty: none")
    progress: FloatProperty(name="Progress", description="How much is done, as a fraction", min=0.0, max=1.0)
    message: StringProperty(name="Message", description="What is being done")
    left: StringProperty(name="Time Left", description="How long it will still take, in words. Empty: not known yet")
    cancel: BoolProperty(name="Cancel", description="Whether to stop the work")
    run_scripts: BoolSetting(
        "Run Scripts Once",
        "Let the Python of this file, drivers and text blocks, run in the next render. "
        "Only for files whose maker you trust",
        get=is_ticked,
        set=tick,
    )


def register() -> None:
    bpy.types.Image.mps = PointerProperty(type=MPS_PG_image)
    bpy.types.Scene.mps = PointerProperty(type=MPS_PG_scene)
    bpy.types.WindowManager.mps = PointerProperty(type=MPS_PG_job)


def unregister() -> None:
    del bpy.types.WindowManager.mps
    del bpy.types.Scene.mps
    del bpy.types.Image.mps
