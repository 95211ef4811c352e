"""The picture of how lamps, camera and object stand, for the panel; examples/rig_picture.py draws it."""

from pathlib import Path

import bpy.utils.previews

_FILE = Path(__file__).with_name("rig.webp")
_loaded: list[bpy.utils.previews.ImagePreviewCollection] = []


def rig_icon() -> int:
    """The picture's number for ``template_icon``."""
    icon: int = _loaded[0][_FILE.name].icon_id
    return icon


def register() -> None:
    _loaded.append(bpy.utils.previews.new())
    _loaded[0].load(_FILE.name, str(_FILE), "IMAGE")


def unregister() -> None:
    bpy.utils.previews.remove(_loaded.pop())
