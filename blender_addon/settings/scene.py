"""Storage of settings in the scene and in photos, and of the running job in the window manager."""

from operator import attrgetter
from typing import Any

import bpy
from bpy.app.handlers import persistent
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
from .bake import MPS_PG_bake, MPS_PG_relight, MPS_PG_views
from .declared import BoolSetting
from .estimate import MPS_PG_estimate, MPS_PG_material
from .heights import MPS_PG_displace, MPS_PG_heights
from .photo import MPS_PG_align, MPS_PG_calibrate, MPS_PG_image, MPS_PG_photo, MPS_PG_superpose
from .record import OF_ONE_RIG, MPS_PG_record
from .rig import MPS_PG_rig
from .samples import MPS_PG_samples

_PHOTOGRAPH, _RENDER = range(2)
_CHOSEN = "mpsnet_way"
# The steps whose settings and results each rig has of its own.
STEPS = ("rig", "photo", "estimate")


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
    """One of the scene's rigs, with its photo and its normals."""

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
    calibrate: PointerProperty(type=MPS_PG_calibrate)
    align: PointerProperty(type=MPS_PG_align)
    superpose: PointerProperty(type=MPS_PG_superpose)
    bake: PointerProperty(type=MPS_PG_bake)
    heights: PointerProperty(type=MPS_PG_heights)
    displace: PointerProperty(type=MPS_PG_displace)
    views: PointerProperty(type=MPS_PG_views)
    material: PointerProperty(type=MPS_PG_material)
    samples: PointerProperty(type=MPS_PG_samples)
    rigs: CollectionProperty(name="Rigs", description="The scene's rigs, one at least", type=MPS_PG_one_of_rigs)
    blank: PointerProperty(type=MPS_PG_one_of_rigs, options={"HIDDEN"})
    chosen_rig: IntProperty(
        name="Chosen Rig", description="Number in the list, from 0, of the rig that the panel shows", min=0
    )
    records: CollectionProperty(
        name="Records", description="How the last run of each operator ended", type=MPS_PG_record
    )
    relight: PointerProperty(type=MPS_PG_relight)

    @property
    def chosen(self) -> Any:
        """The chosen rig; the first one is made here, unless Blender draws, and so forbids it for a moment."""
        if not self.rigs:
            try:
                self.rigs.add()
            except (AttributeError, RuntimeError):
                return self.blank
        return self.rigs[min(self.chosen_rig, len(self.rigs) - 1)]

    @property
    def every_rig(self) -> list[Any]:
        """The groups with ``rig``, ``photo`` and ``estimate`` of all rigs, in the list's order."""
        return list(self.rigs) or [self.chosen]

    rig = property(attrgetter("chosen.rig"), doc="The chosen rig's settings and objects.")
    photo = property(attrgetter("chosen.photo"), doc="The chosen rig's photo.")
    estimate = property(attrgetter("chosen.estimate"), doc="The normals of the chosen rig's photo.")


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


@persistent
def _take_from_earlier_versions(*_: Any) -> None:
    """Move what files of versions up to 0.2.0 hold of the chosen rig, beside the list, into the list.

    Called when a file is opened or linked, before anything else looks at its settings.
    """
    for scene in bpy.data.scenes:
        stored = scene.bl_system_properties_get() if hasattr(scene, "bl_system_properties_get") else scene
        mps: Any = stored.get("mps") if stored else None
        old = [name for name in STEPS if name in mps] if hasattr(mps, "to_dict") else []
        if not old or not all(hasattr(mps[name], "to_dict") for name in old):
            continue
        whole = mps.to_dict()
        rigs = list(whole.get("rigs", ())) or [{}]
        records = whole.get("records", ())
        own = {"records": [one for one in records if one.get("name") in OF_ONE_RIG]}
        chosen = rigs[min(max(int(whole.get("chosen_rig", 0)), 0), len(rigs) - 1)]
        chosen.update({name: whole[name] for name in old}, **own)
        others = {"rigs": rigs, "records": [one for one in records if one.get("name") not in OF_ONE_RIG]}
        for name in (*old, *others):
            mps.pop(name, None)
        for group, lists in ((chosen, own), (mps, others)):
            for name, items in lists.items():
                if items:
                    group[name] = items
                else:
                    group.pop(name, None)


@persistent
def _give_first_rig(scene: Any, *_: Any) -> None:
    scene.mps.chosen  # noqa: B018 - it makes one before the panel is drawn


HANDLERS = {
    "load_post": _take_from_earlier_versions,
    "blend_import_post": _take_from_earlier_versions,
    "depsgraph_update_post": _give_first_rig,
}


def register() -> None:
    bpy.types.Image.mps = PointerProperty(type=MPS_PG_image)
    bpy.types.Scene.mps = PointerProperty(type=MPS_PG_scene)
    bpy.types.WindowManager.mps = PointerProperty(type=MPS_PG_job)


def unregister() -> None:
    del bpy.types.WindowManager.mps
    del bpy.types.Scene.mps
    del bpy.types.Image.mps
