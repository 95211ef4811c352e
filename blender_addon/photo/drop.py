"""Drag and drop: a photo dropped into a 3D viewport or an image editor becomes the photo."""

from typing import Any

import bpy

from mpsnet_core.io.files import PHOTO_SUFFIXES, VIDEO_SUFFIXES


class MPS_FH_photo(bpy.types.FileHandler):
    bl_idname = "MPS_FH_photo"
    bl_label = "Open as Photo of MPS-Net"
    bl_import_operator = "mps.open_photo"
    bl_file_extensions = ";".join((*PHOTO_SUFFIXES, *VIDEO_SUFFIXES))

    @classmethod
    def poll_drop(cls, context: Any) -> bool:
        return context.area is not None and context.area.type in {"VIEW_3D", "IMAGE_EDITOR"}


register, unregister = bpy.utils.register_classes_factory((MPS_FH_photo,))
