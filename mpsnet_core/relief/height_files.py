"""Height map files: float heights in the camera's unit, or 16 bits from black to white with a separate scale.

``height.png`` comes with ``height.png.json``, the meaning of its values, and ``height.png.mask.png``, the mask.
The image has one channel, which displacement expects, and no alpha: EXR premultiplies colours by alpha, which would
pull the surface down to 0 along its outline. Instead, the heights are extrapolated beyond the outline.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mpsnet_core.arrays.resampling import push_pull
from mpsnet_core.arrays.types import Bools
from mpsnet_core.errors import FileError, FormatError, SettingsError
from mpsnet_core.io import files as disk
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image_reading import image_description, read_channel, read_mask
from mpsnet_core.io.image_writing import write_image
from mpsnet_core.io.marks import made
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.relief.height_map import HeightMap, pixels_per_unit
from mpsnet_core.relief.height_names import height_names
from mpsnet_core.scene.camera import Camera, camera_data, camera_from_data

HEIGHT_FORMAT = "mpsnet-height"
HEIGHT_VERSION = 1
HEIGHT_KEYS = ("unit", "lowest", "highest", "black", "white", "pixels_per_unit", "displace", "mask", "camera")
# Half floats and bytes are too coarse: in a surface of 256 steps, each step is visible.
HEIGHT_BITS = (16, 32)
# Limit of heights in files, within the range of float32.
MAX_VALUE = 1e38


@dataclass(frozen=True)
class HeightScale:
    """The scale of a height file: ``height = black + value * (white - black)``.

    Examples
    --------
    >>> scale = HeightScale(-2.0, 6.0, 0.0, "mm")
    >>> scale.strength, scale.midlevel
    (8.0, 0.25)
    >>> print(scale)
    black is -2 mm, white 6 mm
    """

    black: float
    """Height of the value 0. In float files it is 0: the value is the height."""
    white: float
    """Height of the value 1. In float files it is 1."""
    zero: float
    """Height that is not displaced."""
    unit: str
    """Name of the unit, such as "mm"."""

    @property
    def strength(self) -> float:
        """The strength of Blender's Displace modifier for true heights."""
        return self.white - self.black

    @property
    def midlevel(self) -> float:
        """The modifier's midlevel: the texture value that is not displaced."""
        return (self.zero - self.black) / self.strength

    @property
    def displace_words(self) -> str:
        """The modifier's settings as text."""
        return f"Blender's Displace: strength {self.strength:.6g}, midlevel {self.midlevel:.6g}"

    def facts(self, lowest: float, highest: float, seam_step: float | None = None) -> "HeightFacts":
        """The facts of heights that are written at this scale."""
        return HeightFacts(lowest, highest, self.black, self.white, self.strength, self.midlevel, seam_step)

    def __str__(self) -> str:
        if (self.black, self.white) == (0, 1):
            return f"its values are the heights, in {self.unit}"
        return f"black is {self.black:.6g} {self.unit}, white {self.white:.6g} {self.unit}"


@dataclass(frozen=True)
class HeightFacts:
    """Facts of written heights, all in the unit of the heights except `midlevel`."""

    lowest: float
    """The lowest height."""
    highest: float
    """The highest height."""
    black: float
    """Height of the value 0, see :class:`HeightScale`."""
    white: float
    """Height of the value 1, see :class:`HeightScale`."""
    strength: float
    """Displacement from the value 0 to the value 1, see :class:`HeightScale`."""
    midlevel: float
    """Value that is not displaced, see :class:`HeightScale`."""
    seam_step: float | None = None
    """The step between the two sides of a seam; None if the heights are not on UVs."""


def height_files(path: AnyPath, bits: int | None) -> list[Path]:
    """The files that :func:`write_height` writes for `path`: the heights, their scale, their mask.

    Raises FileError if they cannot be written there, or would overwrite a scale or mask that this program did not make.
    """
    path, scale, mask = height_names(disk.writable_path(path))
    bits = disk.checked_bits(path, bits)
    if bits not in HEIGHT_BITS or (path.suffix.lower() == ".exr" and bits == 16):
        raise FileError(f"cannot write {path}: heights in {bits} bits show steps; take 16 bits in PNG or TIFF, or 32")
    for sidecar in (scale, mask):
        disk.check_own(sidecar, derived=True, json_format=HEIGHT_FORMAT)
    return [path, scale, mask]


@takes_files
def write_height(
    path: AnyPath,
    heights: HeightMap,
    *,
    bits: int | None = None,
    unit: str = "unit",
    on_uvs: bool = False,
    ends: tuple[float, float] | None = None,
) -> HeightScale:
    """Write heights, with their scale as ``NAME.json`` and their mask as ``NAME.mask.png`` in the same folder.

    Heights are extrapolated smoothly beyond the mask. Either all files are written, or none. The image's description
    holds the scale, too.

    Parameters
    ----------
    path : str or PathLike
        EXR for float heights; PNG or TIFF for 16 bits.
    heights : HeightMap
        The heights.
    bits : {16, 32}, optional
        Bits of the values; by default those of the format. 32 writes float heights into TIFF.
    unit : str
        Name of the heights' unit.
    on_uvs : bool
        Whether the heights are a texture on UVs, and so have no camera.
    ends : (float, float), optional
        Heights of black and white in 16 bits; by default the lowest and the highest in the mask.

    Returns
    -------
    HeightScale
        The meaning of the values.

    Raises
    ------
    FileError
        If a file cannot be written, or would overwrite another one.
    """
    path, scale_file, mask_file = height_files(path, bits)
    bits = disk.checked_bits(path, bits)
    inside = heights.values[heights.mask]
    span = float(inside.min()), float(inside.max())
    scale = _scale(heights, (0.0, 1.0) if bits == 32 else _checked_ends(ends) or span, unit)
    data = _scale_data(scale, heights, *span)
    data["mask"] = None if heights.mask.all() else mask_file.name
    data["camera"] = None if on_uvs else camera_data(heights.camera)
    values = push_pull(heights.values, heights.mask)
    if bits != 32:
        values = ((values - np.float32(scale.black)) / np.float32(scale.strength)).astype(np.float32)
    with disk.write_transaction():
        disk.write_json(scale_file, data)  # before the mask, which the scale identifies as its own
        if data["mask"] is not None:
            write_image(mask_file, heights.mask, bits=8, description=made("mask"))
        else:
            disk.remove_file(mask_file)  # the mask of earlier heights
        write_image(path, values, bits=bits, description=json.dumps(data))
    return scale


def _checked_ends(ends: tuple[float, float] | None) -> tuple[float, float] | None:
    if ends is not None and not (np.isfinite(ends).all() and ends[0] <= ends[1]):
        raise SettingsError(f"the heights of black and white are {ends[0]:g} and {ends[1]:g}; give the lower one first")
    return ends


def _scale(heights: HeightMap, ends: tuple[float, float], unit: str) -> HeightScale:
    """ends: the heights of black and of white."""
    black, white = ends
    zero = 0.0
    # Heights that are known up to a constant may have 0 as zero. Those of a perspective camera are far below 0.
    if heights.camera.projection == "perspective":
        zero = float(heights.values[heights.mask].mean(dtype=np.float64))
    return HeightScale(black, white if white > black else black + 1, zero, unit)


def _scale_data(scale: HeightScale, heights: HeightMap, lowest: float, highest: float) -> dict[str, Any]:
    """The scale as JSON data. lowest, highest: of the heights in the mask."""
    focal = pixels_per_unit(heights.camera)
    return {
        "format": HEIGHT_FORMAT,
        "version": HEIGHT_VERSION,
        "unit": scale.unit,
        "lowest": lowest,
        "highest": highest,
        "black": scale.black,
        "white": scale.white,
        # For a perspective camera, at the mean height.
        "pixels_per_unit": focal if heights.camera.projection == "orthographic" else focal / -scale.zero,
        "displace": {"strength": scale.strength, "midlevel": scale.midlevel},
    }


def read_height(path: AnyPath) -> HeightMap:
    """Read heights that :func:`write_height` wrote, with their scale, mask and camera.

    Parameters
    ----------
    path : str or PathLike
        The file of heights.

    Returns
    -------
    HeightMap
        Heights of 16 bits are exact to half a step, ``(white - black) / 131070``. Heights on UVs have an orthographic
        camera whose pixels are as large as their texels.

    Raises
    ------
    FileError
        If a file is missing or cannot be read.
    FormatError
        If a file is damaged, or scale and image do not belong together.
    GeometryError
        If the sizes of heights, mask and camera differ.
    """
    path = disk.existing_file(path, "height map")
    _, scale_file, _ = height_names(path)
    data = disk.read_json(scale_file, HEIGHT_FORMAT, HEIGHT_VERSION, HEIGHT_KEYS)
    values = read_channel(path)
    with disk.prefix_errors(f"height map {path} with {scale_file.name}"):
        black, white = _number(data, "black"), _number(data, "white")
        described = _kept_data(path)
        if described is not None and (described.get("black"), described.get("white")) != (black, white):
            raise FormatError("its black and white are not those that the picture itself keeps; write both again")
        camera = _camera(data, values.shape)
        mask = _read_mask_beside(scale_file, data.get("mask"), values.shape)
        return HeightMap((black + values.astype(np.float64) * (white - black)).astype(np.float32), mask, camera)


def _camera(data: dict[str, Any], shape: tuple[int, ...]) -> Camera:
    if "camera" in data and data["camera"] is None:
        return Camera("orthographic", shape[1], shape[0], np.full(2, _number(data, "pixels_per_unit")))
    if not isinstance(data.get("camera"), dict):
        raise FormatError('it lacks "camera"; add it')
    return camera_from_data(data["camera"])


def _kept_data(path: Path) -> dict[str, Any] | None:
    """The scale in the image's description, None if another program removed it."""
    text = image_description(path)
    try:
        data = json.loads(text) if len(text) < disk.MAX_TEXT_BYTES else None
    except (ValueError, RecursionError):
        return None
    return data if isinstance(data, dict) else None


def _read_mask_beside(file: Path, name: Any, shape: tuple[int, ...]) -> Bools:
    if name is None:
        return np.ones(shape, bool)
    # The name is untrusted and must not lead to another folder.
    if not isinstance(name, str) or not name or Path(name).name != name:
        raise FormatError('its "mask" must be the name of a file beside it')
    return read_mask(file.with_name(name))


def _number(data: dict[str, Any], key: str) -> float:
    value = data.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < MAX_VALUE:
        raise FormatError(f'its "{key}" must be a finite number')
    return float(value)
