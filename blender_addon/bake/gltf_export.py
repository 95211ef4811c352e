"""Blender's export as glTF, which takes the image behind a normal map as it is, whatever the nodes do to it.

glTF has tangent-space maps with green up alone. So a texture in DirectX convention is turned for the exported file, and
one in object space is left out. The exporter finds :class:`GltfExtension` in the package of an enabled add-on.
"""

import copy
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import FileError, Note
from mpsnet_core.io.files import temporary_folder

from ..appearance.nodes import GREEN_NODE, NORMAL_NODE, OBJECT_NORMAL_NODE
from ..appearance.shader_graph import End, nodes_behind
from ..openimageio import load_openimageio

_SUFFIXES = {"image/jpeg": ".jpg", "image/webp": ".webp", "image/png": ".png"}


def export_notes(space: str, convention: str, *, mixed: bool = False) -> list[Note]:
    """A sentence if exporters would misread a texture of this space and convention; otherwise nothing.

    mixed: whether it has UDIM tiles on an object of several materials.
    """
    if mixed:
        words = (
            "UDIM tiles on several materials: Blender's glTF export shows one material's alone; give the object one "
            "material, or bake without tiles"
        )
        return [Note(words, level="look")]
    if space == "OBJECT":
        words = "Object space: a glTF export leaves it out, and other exporters misread it; bake Tangent for them"
        return [Note(words)]
    if convention == "DIRECTX":
        words = (
            "DirectX: the material turns its green for Blender, and a glTF export is turned while this add-on is "
            "enabled; other exporters misread it, bake OpenGL for them"
        )
        return [Note(words)]
    return []


class GltfExtension:
    """What the exporter asks about each image; one object for each export."""

    is_critical = True  # from Blender 5.2 on: an image that cannot be turned ends the export

    def __init__(self) -> None:
        self._changed: list[Any] = []  # two materials may get one image from the exporter's cache

    def gather_image_hook(self, image: Any, exported: Any, sockets: Sequence[Any], settings: dict[str, Any]) -> None:
        """Replace an image that is about to be written, if glTF would show it wrongly."""
        groups = tuple(group for group in sockets[0].group_path if hasattr(group, "node_tree"))
        nodes = nodes_behind(End(sockets[0].socket, groups))
        # Blender 5.2 exports a copy of the tree, whose nodes have other names.
        names = {name for node in nodes for name in (node.name, node.label)}
        spaces = {node.space for node in nodes if {node.name, node.label} & {NORMAL_NODE, OBJECT_NORMAL_NODE}}
        if image in self._changed or not (GREEN_NODE in names or spaces - {"TANGENT"}):
            return
        self._changed.append(image)
        if spaces - {"TANGENT"}:
            settings["log"].warning(f"{image.name}: glTF has no maps in object space, this one is left out")
        _replace(image, exported.original, _flat if spaces - {"TANGENT"} else _turned)

    def gather_texture_hook(self, texture: Any, sockets: Sequence[Any], settings: dict[str, Any]) -> None:
        """Leave out a second version of an image that was replaced."""
        if texture.source in self._changed and texture.extensions:
            texture.extensions.pop("EXT_texture_webp", None)


def _replace(image: Any, original: Any, change: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
    """Change the pixels of an image of the exporter: in the file itself, or in one beside it.

    original: Blender's image if its own file would be referred to; a changed copy is then in the file itself.
    """
    if image.buffer_view is not None:
        image.buffer_view = type(image.buffer_view)(_changed(image.buffer_view.data, image.mime_type, change))
    elif isinstance(image.uri, str):
        from io_scene_gltf2.io.exp.binary_data import BinaryData  # type: ignore[import-not-found]

        data = Path(bpy.path.abspath(original.filepath, library=original.library)).read_bytes()
        image.buffer_view, image.uri = BinaryData(_changed(data, image.mime_type, change)), None
    else:
        image.uri = copy.copy(image.uri)
        image.uri._data = _changed(image.uri.data, image.mime_type, change)


def _changed(data: bytes, kind: str, change: Callable[[NDArray[Any]], NDArray[Any]]) -> bytes:
    """An encoded image with its pixels changed, as a file of that MIME type."""
    load_openimageio()
    import OpenImageIO as oiio

    with temporary_folder() as folder:
        source, file = folder / "source", folder / f"image{_SUFFIXES[kind]}"
        source.write_bytes(data)
        given = oiio.ImageBuf(str(source))
        depth = oiio.UINT8 if given.spec().format == oiio.UINT8 else oiio.UINT16
        pixels = given.get_pixels(depth)
        if pixels is None:
            raise FileError(f"the image cannot be turned for glTF: {given.geterror()}")
        pixels = np.ascontiguousarray(change(pixels))
        made = oiio.ImageBuf(pixels)
        if not made.write(str(file)):
            raise FileError(f"the image cannot be turned for glTF: {made.geterror()}")
        return file.read_bytes()


def _turned(pixels: NDArray[Any]) -> NDArray[Any]:
    """Levels (H, W, C) with green the other way round; level 128, or 32768, stays."""
    top = np.iinfo(pixels.dtype).max
    green = np.minimum(top + 1 - pixels[..., 1].astype(np.int64), top).astype(pixels.dtype)
    return np.concatenate([pixels[..., :1], green[..., None], pixels[..., 2:]], axis=-1)


def _flat(pixels: NDArray[Any]) -> NDArray[Any]:
    """The levels of a map without relief, of the same kind."""
    top = np.iinfo(pixels.dtype).max
    return np.array([[[top // 2 + 1, top // 2 + 1, top]]], pixels.dtype)
