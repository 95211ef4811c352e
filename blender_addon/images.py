"""Blender images: loading files as images, and finding the files of images."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import FileError, FormatError, InputError
from mpsnet_core.io.image import linear_to_srgb

from .image_records import LOADED, is_own, origin, read_sidecar, remember, remembered
from .outputs import file_name

_FINE_PREVIEW = 512


def load_image(path: Path, name: str, *, is_data: bool) -> bpy.types.Image:
    """Load a file as a Blender image, whose pixels Blender reads on display.

    If the add-on has loaded the file before, that image is reloaded. The user's own images of the file are unchanged.

    A file in Blender's temporary folder, which is deleted when Blender quits, is packed into the .blend file as well.

    is_data: non-colour data, without a colour space.

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
    if is_data:  # set before its pixels are read: 4.5 does not convert them again
        image.colorspace_settings.is_data = True
    _read_again(image, name)
    _pack_or_make_relative(image, path)
    return image


def load_tiles(pattern: Path, numbers: Sequence[int], name: str, *, is_data: bool) -> bpy.types.Image:
    """Load UDIM tiles as one image, or reload it. pattern: their file, with <UDIM> in its name.

    Tiles in Blender's temporary folder are packed, as in :func:`load_image`.

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
    _read_again(image, name)
    for tile in [tile for tile in image.tiles if tile.number not in numbers]:
        image.tiles.remove(tile)  # Blender loads all files that match the pattern, even those of earlier bakes
    _pack_or_make_relative(image, pattern)
    return image


def _read_again(image: bpy.types.Image, name: str) -> None:
    """Read an image's file again, and name the image."""
    if image.packed_file:
        image.unpack(method="REMOVE")  # otherwise the packed file would be read again
    image.reload()
    image.name = name
    if image.preview:  # otherwise the panel would show the old content
        image.preview.reload()


def _loaded_from(path: Path) -> Any:
    """The image that the add-on loaded from a file, None if there is none."""
    own = (image for image in bpy.data.images if not image.library and is_own(image))
    return next((image for image in own if Path(bpy.path.abspath(image.filepath)) == path), None)


def _pack_or_make_relative(image: bpy.types.Image, path: Path) -> None:
    """Pack a temporary file, or make the path of a file in the .blend file's folder relative."""
    if Path(bpy.app.tempdir) in path.parents:
        image.pack()
    elif bpy.data.filepath and Path(bpy.data.filepath).parent in path.parents:
        image.filepath = bpy.path.relpath(str(path))


def load_frames(first: Path, name: str) -> bpy.types.Image:
    """Load the numbered files that start with `first` as one image sequence of non-colour data.

    Raises InputError if Blender cannot read it.
    """
    image = load_image(first, name, is_data=True)
    image.source = "SEQUENCE"
    return image


def load_photo(path: Path, name: str, source: Path | None = None) -> bpy.types.Image:
    """Load a photo as an image, and store the rig and camera of its sidecar files in it.

    source: the photo's own file, if `path` only shows it in a form that Blender can read.

    Raises InputError if Blender cannot read it, or the file of its rig or camera is malformed.
    """
    known = {what: read_sidecar(source or path, what) for what in ("rig", "camera")}
    image = load_image(path, name, is_data=False)
    if not image.size[0]:
        bpy.data.images.remove(image)
        raise FormatError(f"cannot read {path}: it is not an image or is damaged; export it again")
    for what, text in {**known, "source": str(source.absolute()) if source else None}.items():
        remember(image, what, text)
    return image


def picture_size(image: bpy.types.Image) -> tuple[int, int]:
    """Width and height in pixels; those of a sequence's first file if the current frame has none."""
    width, height = image.size
    if not width:
        frame = bpy.data.images.load(bpy.path.abspath(image.filepath), check_existing=False)
        width, height = frame.size
        bpy.data.images.remove(frame)
    return width, height


def pixels_of(image: bpy.types.Image) -> NDArray[np.float32]:
    """(H, W, C) the image's pixels, bottom row first."""
    width, height = image.size
    pixels = np.empty((height, width, image.channels), np.float32)
    image.pixels.foreach_get(pixels.ravel())
    return pixels


def paint_grey(image: bpy.types.Image, values: NDArray[Any]) -> None:
    """Fill an image of four channels with opaque grey values (H, W), bottom row first."""
    pixels = np.ones((*values.shape, 4), np.float32)
    pixels[..., :3] = values[..., None]
    image.pixels.foreach_set(pixels.ravel())


def fine_preview(image: bpy.types.Image, *, stretched: bool = False) -> None:
    """Draw the image's preview with 512 pixels on a side instead of Blender's 128, for contact sheets.

    Previews are square: the image is at the top, while Blender would centre it. stretched: scale values from black to
    white, for data that are no colours.
    """
    small = image.copy()  # leaves the image itself unread: 4096² pixels of an EXR file take half a second
    try:
        side = _FINE_PREVIEW
        width, height = (max(1, round(side * length / max(small.size))) for length in small.size)
        small.scale(width, height)
        pixels = pixels_of(small)
        if small.is_float and not small.colorspace_settings.is_data:
            pixels[..., :3] = linear_to_srgb(pixels[..., :3].clip(0, 1))
    finally:
        bpy.data.images.remove(small)
    if stretched:
        low, high = float(pixels[..., :3].min()), float(pixels[..., :3].max())
        pixels[..., :3] = (pixels[..., :3] - low) / max(high - low, 1e-12)
    square = np.zeros((side, side, 4), np.float32)
    left = (side - width) // 2
    square[side - height :, left : left + width] = pixels  # bottom row first
    preview = image.preview_ensure()
    preview.image_size = side, side
    preview.image_pixels_float.foreach_set(square.ravel())


def frame_pattern(file: Path) -> Path:
    """The pattern of a sequence's files from one of them: frame_####.png for frame_0012.png.

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
    """The file of an image; for packed images, a copy on disk.

    Raises InputError if no image is given, if it has no file, or if it has unsaved changes.
    """
    if image is None:
        raise InputError(f"there is no {what} yet; {mend}")
    refuse_unsaved(image, what)
    path = origin(image)
    if image.packed_file and remembered(image, "source") is None:
        # A painted and packed image has no file name.
        unnamed = f"{file_name(what)}.{'exr' if image.file_format == 'OPEN_EXR' else 'png'}"
        path = _folder_to_unpack(image) / (path.name or unnamed)
        path.write_bytes(image.packed_file.data)
    if not path.is_file():
        missing = f" ({path} is missing)" if image.filepath else ""
        raise FileError(f'the {what} "{image.name}" has no file on disk{missing}; save it, or {mend}')
    return path


def refuse_unsaved(image: bpy.types.Image, what: str) -> None:
    """Raise InputError if an image was painted on and not saved."""
    if image.is_dirty:
        raise InputError(f'the {what} "{image.name}" has changes that are not in its file; save it first')


def tile_files(image: bpy.types.Image, what: str, mend: str) -> Path:
    """The files of a tiled image, as their name with <UDIM>.

    Raises InputError if none is on disk, nor packed.
    """
    pattern = origin(image)

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
    """A separate folder for an image: two packed images may have the same file name."""
    folder = Path(bpy.app.tempdir) / f"packed_{image.session_uid}"
    folder.mkdir(exist_ok=True)
    return folder
