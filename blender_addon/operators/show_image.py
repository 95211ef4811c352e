"""Images in an Image Editor: in one that is open, beside the viewport, or in a window of its own."""

from contextlib import suppress
from typing import Any

import bpy

from mpsnet_core.errors import InputError

from ..scene.objects import by_session_uid
from ..settings.declared import IntSetting
from .reporting import ReportingOperator


def image_editor(context: Any) -> Any:
    """An Image Editor: the one in which a button was pressed, another in the window, or one split off the viewport.

    Raises InputError if there is none and no room for one.
    """
    areas = [area for area in (context.area, *context.window.screen.areas) if area is not None]
    if found := next((area for area in areas if area.type == "IMAGE_EDITOR"), None):
        return found
    views = [area for area in areas if area.type == "VIEW_3D"]
    if not views:
        raise InputError("there is no 3D viewport in this window, nor an Image Editor; open one")
    before = {area.as_pointer() for area in areas}
    region = next(region for region in views[0].regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=context.window, area=views[0], region=region), suppress(RuntimeError):
        bpy.ops.screen.area_split(direction="VERTICAL", factor=0.4)
    made = next((area for area in context.window.screen.areas if area.as_pointer() not in before), None)
    if made is None:
        raise InputError("the viewport has no room for the photo beside it; make it wider, or open an Image Editor")
    made.type = "IMAGE_EDITOR"
    space = made.spaces.active
    space.show_region_ui = space.show_region_toolbar = False
    return made


def show_image(context: Any, image: bpy.types.Image, mode: str = "VIEW") -> None:
    """Show an image in an Image Editor, which opens in a window of its own where the viewport has no room for it."""
    if context.window is None or bpy.app.background:
        return
    window = context.window
    try:
        area = image_editor(context)
    except InputError:
        bpy.ops.wm.window_new()
        window = context.window_manager.windows[-1]
        area = window.screen.areas[0]
        area.type = "IMAGE_EDITOR"
    space = area.spaces.active
    space.image, space.ui_mode = image, mode
    space.uv_editor.show_uv = False  # a photo has no UVs
    region = next((region for region in area.regions if region.type == "WINDOW"), None)
    with bpy.context.temp_override(window=window, area=area, region=region), suppress(RuntimeError):
        bpy.ops.image.view_all(fit_view=True)


class MPS_OT_show_image(ReportingOperator, bpy.types.Operator):
    """Show this picture in an Image Editor: in an open one, else beside the viewport"""

    bl_label = "Show in Image Editor"
    bl_options = {"INTERNAL"}

    image: IntSetting("Image", "Session UID of the image")

    def act(self, context: Any) -> None:
        image = by_session_uid(bpy.data.images, self.image)
        if image is None:
            raise InputError("this image is gone; make it again")
        show_image(context, image)
