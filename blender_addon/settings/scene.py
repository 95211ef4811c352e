"""Where the settings live: in the scene, and what runs at the moment in the window manager."""

import bpy
from bpy.props import BoolProperty, FloatProperty, PointerProperty, StringProperty

from .bake import MPS_PG_bake
from .calibrate import MPS_PG_calibrate
from .displace import MPS_PG_displace
from .estimate import MPS_PG_estimate
from .heights import MPS_PG_heights
from .photo import MPS_PG_photo
from .relight import MPS_PG_relight
from .rig import MPS_PG_light, MPS_PG_rig
from .samples import MPS_PG_samples
from .views import MPS_PG_views


class MPS_PG_scene(bpy.types.PropertyGroup):
    """Everything the add-on keeps in a scene: ``scene.mps``."""

    rig: PointerProperty(type=MPS_PG_rig)
    calibrate: PointerProperty(type=MPS_PG_calibrate)
    photo: PointerProperty(type=MPS_PG_photo)
    estimate: PointerProperty(type=MPS_PG_estimate)
    bake: PointerProperty(type=MPS_PG_bake)
    heights: PointerProperty(type=MPS_PG_heights)
    displace: PointerProperty(type=MPS_PG_displace)
    views: PointerProperty(type=MPS_PG_views)
    samples: PointerProperty(type=MPS_PG_samples)
    relight: PointerProperty(type=MPS_PG_relight)


class MPS_PG_job(bpy.types.PropertyGroup):
    """The child process that runs at the moment: ``window_manager.mps``. Neither saved nor undone."""

    running: StringProperty()
    progress: FloatProperty(min=0.0, max=1.0)
    message: StringProperty()
    cancel: BoolProperty()


CLASSES = (
    MPS_PG_light,
    MPS_PG_rig,
    MPS_PG_calibrate,
    MPS_PG_photo,
    MPS_PG_estimate,
    MPS_PG_bake,
    MPS_PG_heights,
    MPS_PG_displace,
    MPS_PG_views,
    MPS_PG_samples,
    MPS_PG_relight,
    MPS_PG_scene,
    MPS_PG_job,
)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.mps = PointerProperty(type=MPS_PG_scene)
    bpy.types.WindowManager.mps = PointerProperty(type=MPS_PG_job)


def unregister() -> None:
    del bpy.types.WindowManager.mps
    del bpy.types.Scene.mps
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
