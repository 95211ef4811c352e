"""Blender's images: how files become images, and which files images come from."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import FileError, FormatError, InputError

from .image_records import LOADED, is_own, origin, read_sidecar, remember, remembered
from .outputs import file_name

_FINE_PREVIEW = 512


def load_image(path: Path, name: str, *, is_data: bool) -> bpy.types.Image:
    """The file as an image of Blender's, which reads its pixels when it shows them.

    Where the add-on has loaded the file before, that image is read anew; people's own images of it stay as they are.

    A file in Blender's temporary folder, which goes when Blender quits, is packed into the .blend file as well.

    is_data: its colours are numbers, not light: no colour space is applied.

    Raises InputError if Blender cannot open it.
    """
    image = _loaded_from(path)
    if image is None or not path.is_file():
        try:
            image = bpy.data.images.load(str(path), check_existing=False)
        except RuntimeError:
            raise FileError(f"cannot open {path}: it does not exist or is not an image; check the path") from None
        remember(image, LOADED, path.name)
    if image.source == "SEQUENCE":
        image.source = "FILE"
    if image.packed_file:
        image.unpack(method="REMOVE")  # else the packed file would be read again
    if is_data:  # set before its pixels are read: 4.5 does not convert them again
        image.colorspace_settings.is_data = True
    image.reload()
    image.name = name
    if image.preview:  # else the panel goes on showing what the file held before
        image.preview.reload()
    _pack_or_make_relative(image, path)
    return image


def load_tiles(pattern: Path, numbers: Sequence[int], name: str, *, is_data: bool) -> bpy.types.Image:
    """UDIM tiles as one image, read anew where it is one already. pattern: their file, with <UDIM> in its name.

    Tiles in a folder that goes when Blender quits are packed, as in :func:`load_image`.

    Raises InputError if Blender cannot read them.
    """
    image = _loaded_from(pattern)
    if image is None:
        first = pattern.with_name(pattern.name.replace("<UDIM>", str(numbers[0])))
        image = load_image(first, name, is_data=is_data)
    if image.packed_file:
        image.unpack(method="REMOVE")
    image.source = "TILED"
    image.filepath = str(pattern)
    image.reload()
    for tile in [tile for tile in image.tiles if tile.number not in numbers]:
        image.tiles.remove(tile)  # Blender takes all files that fit the pattern, those of earlier bakes too
    image.name = name
    if image.preview:
        image.preview.reload()
    _pack_or_make_relative(image, pattern)
    return image


def _loaded_from(path: Path) -> Any:
    """The image that the add-on loaded from a file, None where there is none."""
    own = (image for image in bpy.data.images if not image.library and is_own(image))
    return next((image for image in own if Path(bpy.path.abspath(image.filepath)) == path), None)


def _pack_or_make_relative(image: bpy.types.Image, path: Path) -> None:
    """Pack what would go with Blender, and name what lies beside the .blend file by where it lies from there."""
    if Path(bpy.app.tempdir) in path.parents:
        image.pack()
    elif bpy.data.filepath and Path(bpy.data.filepath).parent in path.parents:
        image.filepath = bpy.path.relpath(str(path))


def load_frames(first: Path, name: str) -> bpy.types.Image:
    """The numbered files that begin with `first` as one image sequence of data.

    Raises InputError if Blender cannot read it.
    """
    image = load_image(first, name, is_data=True)
    image.source = "SEQUENCE"
    return image


def load_photo(path: Path, name: str) -> bpy.types.Image:
    """The photo as an image with the rig and camera from beside the file stored in it.

    Raises InputError if Blender cannot read it, or the file of its rig or camera is malformed.
    """
    known = {what: read_sidecar(path, what) for what in ("rig", "camera")}
    image = load_image(path, name, is_data=False)
    if not image.size[0]:
        bpy.data.images.remove(image)
        raise FormatError(f"cannot read {path}: it is not an image or is damaged; export it again")
    for what, text in known.items():
        remember(image, what, text)
    return image


def picture_size(image: bpy.types.Image) -> tuple[int, int]:
    """Width and height in pixels; those of a sequence's own file where the frame of the moment has none."""
    width, height = image.size
    if not width:
        frame = bpy.data.images.load(bpy.path.abspath(image.filepath), check_existing=False)
        width, height = frame.size
        bpy.data.images.remove(frame)
    return width, height


def pixels_of(image: bpy.types.Image) -> NDArray[np.float32]:
    """(H, W, C) the image's pixels, the lowest row first."""
    width, height = image.size
    pixels = np.empty((height, width, image.channels), np.float32)
    image.pixels.foreach_get(pixels.ravel())
    return pixels


def paint_grey(image: bpy.types.Image, values: NDArray[Any]) -> None:
    """Fill an image of four channels with grey values (H, W), the lowest row first, and opaque."""
    pixels = np.ones((*values.shape, 4), np.float32)
    pixels[..., :3] = values[..., None]
    image.pixels.foreach_set(pixels.ravel())


def fine_preview(image: bpy.types.Image, *, stretched: bool = False) -> None:
    """Draw the image's preview with 512 pixels a side in place of Blender's 128, for a picture of small pictures.

    Previews are shown square: the image is at the top, where Blender would have it in the middle. stretched: from black
    to white, for numbers that are no colours.
    """
    small = image.copy()  # the image itself stays unread: 4096² pixels of an EXR file take half a second
    try:
        side = _FINE_PREVIEW
        width, height = (max(1, round(side * length / max(small.size))) for length in small.size)
        small.scale(width, height)
        pixels = pixels_of(small)
    finally:
        bpy.data.images.remove(small)
    if stretched:
        low, high = float(pixels[..., :3].min()), float(pixels[..., :3].max())
        pixels[..., :3] = (pixels[..., :3] - low) / max(high - low, 1e-12)
    square = np.zeros((side, side, 4), np.float32)
    left = (side - width) // 2
    square[side - height :, left : left + width] = pixels  # the lowest row is the first
    preview = image.preview_ensure()
    preview.image_size = side, side
    preview.image_pixels_float.foreach_set(square.ravel())


def frame_pattern(file: Path) -> Path:
    """The pattern of a sequence's files, from one of them: frame_####.png for frame_0012.png.

    Raises InputError if its name has no number.
    """
    runs = list(re.finditer("[0-9]+", file.stem))
    if not runs:
        raise InputError(f"{file.name} has no number in its name, so it is no frame of a sequence; open it as a photo")
    head, tail = file.stem[: runs[-1].start()], f"{file.stem[runs[-1].end() :]}{file.suffix}"
    called = [part.replace("#", "?") for part in (head, tail)]  # "#" stands for a digit
    like = re.compile(f"{re.escape(head)}([0-9]+){re.escape(tail)}")
    lengths = {len(found[1]) for found in (like.fullmatch(other.name) for other in file.parent.iterdir()) if found}
    return file.with_name(f"{called[0]}{'#' * lengths.pop() if len(lengths) == 1 else '*'}{called[1]}")


def image_file(image: bpy.types.Image | None, what: str, mend: str) -> Path:
    """The file an image comes from, for what is packed one with that. Raises InputError if there is no image, it has
    no file on disk, or was changed since."""
    if image is None:
        raise InputError(f"there is no {what} yet; {mend}")
    refuse_unsaved(image, what)
    path = origin(image)
    if image.packed_file and remembered(image, "source") is None:
        # What was painted and packed never had a name.
        unnamed = f"{file_name(what)}.{'exr' if image.file_format == 'OPEN_EXR' else 'png'}"
        path = _folder_to_unpack(image) / (path.name or unnamed)
        path.write_bytes(image.packed_file.data)
    if not path.is_file():
        missing = f" ({path} is missing)" if image.filepath else ""
        raise FileError(f'the {what} "{image.name}" has no file on disk{missing}; save it, or {mend}')
    return path


def refuse_unsaved(image: bpy.types.Image, what: str) -> None:
    """Raise InputError if an image was painted on, which its file does not show."""
    if image.is_dirty:
        raise InputError(f'the {what} "{image.name}" has changes that are not in its file; save it first')


def tile_files(image: bpy.types.Image, what: str, mend: str) -> Path:
    """The files that a tiled image comes from, as their name with <UDIM> in it.

    Raises InputError if none is on disk, nor packed.
    """
    pattern = Path(bpy.path.abspath(image.filepath, library=image.library))

    def of(tile: int) -> Path:
        return pattern.with_name(pattern.name.replace("<UDIM>", str(tile)))

    packed = {one.tile_number: one.packed_file for one in image.packed_files}
    if packed and not all(of(tile.number).is_file() for tile in image.tiles):
        pattern = _folder_to_unpack(image) / pattern.name
        for number, file in packed.items():
            of(number).write_bytes(file.data)
    files = [of(tile.number) for tile in image.tiles]
    if "<UDIM>" not in pattern.name or not any(file.is_file() for file in files):
        raise FileError(f'the {what} "{image.name}" has no file on disk ({files[0]} is missing); save it, or {mend}')
    return pattern


def _folder_to_unpack(image: bpy.types.Image) -> Path:
    """A folder of the image's own: two that came from elsewhere may have files of one name."""
    folder = Path(bpy.app.tempdir) / f"packed_{image.session_uid}"
    folder.mkdir(exist_ok=True)
    return folder
