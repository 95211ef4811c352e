"""The viewport as the photo's camera sees it."""

from typing import Any

import bpy

from ..operators import ReportingOperator
from .camera import chosen_camera, is_real


class MPS_OT_look_through(ReportingOperator, bpy.types.Operator):
    """See the scene in this viewport as the camera sees it that took the photo. Press again to leave it"""

    bl_idname = "mps.look_through"
    bl_label = "Look Through"
    bl_options = {"REGISTER"}

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
            return
        # This viewport's own, so that the scene's camera stays what it is.
        space.use_local_camera, space.camera = True, camera
        if not in_camera:
            bpy.ops.view3d.view_camera()


def _photos_camera(scene: Any) -> Any:
    """The camera object of the photo, or of the rig that photos are rendered with; None where there is none."""
    image = scene.mps.photo.image
    camera = chosen_camera(scene, image) if is_real(image) else scene.mps.rig.camera
    return camera if camera is not None and scene.objects.get(camera.name) == camera else None


register, unregister = bpy.utils.register_classes_factory((MPS_OT_look_through,))
