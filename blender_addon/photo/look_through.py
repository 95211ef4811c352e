"""The viewport through the photo's camera, in the photo's frame."""

from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..images import picture_size
from ..operators.reporting import ReportingOperator
from .camera import chosen_camera, is_real

WATCH_SECONDS = 0.5

# Stored with a scene: its previous resolution and pixel aspect, and the photo's, which it has now.
_BEFORE = "mpsnet_frame_before"
_FRAME = ("resolution_x", "resolution_y", "pixel_aspect_x", "pixel_aspect_y")


class MPS_OT_look_through(ReportingOperator, bpy.types.Operator):
    """See the scene in this viewport as the camera sees it that took the photo, in the photo's frame.

    The scene's resolution is the photo's meanwhile. Press again, or turn the view, to leave it"""

    bl_label = "Look Through"

    @classmethod
    def lacks(cls, context: Any) -> str:
        if context.region_data is None:
            return "Press this in a 3D viewport"
        if _photos_camera(context.scene) is not None:
            return ""
        if is_real(context.scene.mps.photo.image):
            return "Where was the photo taken from? Press Align Photo, or choose the camera"
        return "Add a rig first"

    def act(self, context: Any) -> None:
        space, camera = context.space_data, _photos_camera(context.scene)
        in_camera = context.region_data.view_perspective == "CAMERA"
        if in_camera and space.camera == camera:
            bpy.ops.view3d.view_camera()  # back to the view before
            space.use_local_camera = False
            watch()
            return
        # A local camera of this viewport leaves the scene's camera unchanged.
        space.use_local_camera, space.camera = True, camera
        if not in_camera:
            bpy.ops.view3d.view_camera()
        _use_photo_resolution(context.scene)
        _watch_on()


def _photos_camera(scene: Any) -> Any:
    """The camera object of the photo, or of the rig that renders photos; None if there is none."""
    image = scene.mps.photo.image
    camera = chosen_camera(scene, image) if is_real(image) else scene.mps.rig.camera
    return camera if camera is not None and scene.objects.get(camera.name) == camera else None


def _frame(scene: Any) -> list[float]:
    return [float(getattr(scene.render, name)) for name in _FRAME]


def _use_photo_resolution(scene: Any) -> None:
    """Set the scene's resolution to the photo's, and store the previous one with the scene."""
    photo, before = scene.mps.photo, _stored_frames(scene)[: len(_FRAME)] or _frame(scene)
    size = picture_size(photo.image) if is_real(photo.image) else (photo.width, photo.height)
    for name, value in zip(_FRAME, (*size, 1, 1), strict=True):
        setattr(scene.render, name, value)
    scene[_BEFORE] = [*before, *_frame(scene)]


def _restore_resolution(scene: Any) -> None:
    """Restore the scene's resolution, unless the user has changed it meanwhile."""
    numbers = _stored_frames(scene)
    del scene[_BEFORE]
    if numbers[len(_FRAME) :] == _frame(scene):
        for name, value in zip(_FRAME, numbers, strict=False):
            setattr(scene.render, name, int(value) if name.startswith("resolution") else value)


def _stored_frames(scene: Any) -> list[float]:
    """The values stored with a scene; [] if they are invalid, as in a hostile file."""
    try:
        numbers = [float(one) for one in scene.get(_BEFORE, ())]
    except (TypeError, ValueError):
        return []
    whole = all(-1e6 < one < 1e6 for one in numbers)
    return numbers if whole and len(numbers) == 2 * len(_FRAME) else []


def _shows_photos_camera(window: Any) -> bool:
    """Whether a viewport of a window shows its scene through the photo's camera."""
    scene, camera = window.scene, _photos_camera(window.scene)
    spaces = [area.spaces.active for area in window.screen.areas if area.type == "VIEW_3D"]
    return camera is not None and any(
        space.region_3d.view_perspective == "CAMERA"
        and (space.camera if space.use_local_camera else scene.camera) == camera
        for space in spaces
    )


def watch() -> float | None:
    """Restore the resolution of scenes that no viewport shows through the photo's camera any more.

    A timer: it returns the time until the next call, or None, which ends it, if no such scene is left.
    """
    windows = bpy.context.window_manager.windows
    for scene in _framed():
        if not any(window.scene == scene and _shows_photos_camera(window) for window in windows):
            _restore_resolution(scene)
    return WATCH_SECONDS if _framed() else None


def _framed() -> list[Any]:
    return [scene for scene in bpy.data.scenes if _BEFORE in scene and not scene.library]


@persistent
def _watch_on(*_: Any) -> None:
    """Start the timer. Also called for an opened file that was saved while its camera was looked through."""
    if not bpy.app.background and not bpy.app.timers.is_registered(watch):
        bpy.app.timers.register(watch, first_interval=WATCH_SECONDS, persistent=True)


HANDLERS = {"load_post": _watch_on}
TIMERS = (watch,)
