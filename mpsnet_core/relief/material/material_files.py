"""Parsing of a photo's scale: lengths (120mm, 12 cm, 0.12m, 4in), and positions in pixels."""

import logging
import math
import re
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mpsnet_core.arrays.types import F32
from mpsnet_core.capture.capture import Capture
from mpsnet_core.capture.masks import ALPHA_OR_NONE
from mpsnet_core.capture.open import open_captures
from mpsnet_core.defaults import BY_PHOTO, Convention
from mpsnet_core.errors import SettingsError
from mpsnet_core.estimate.registry import DEFAULT_MODEL, LAMBERTIAN_GREY_WORLD
from mpsnet_core.io import files as disk
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.io.image_writing import write_image, write_picture
from mpsnet_core.io.marks import made
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.operation import Result
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.relief.curvature import curvature_picture, curvature_range
from mpsnet_core.relief.material.material import Material, check_material, crop_to_filled_part, flat_material
from mpsnet_core.relief.material.tiling import resampled
from mpsnet_core.relief.operations import MakeMaterial
from mpsnet_core.relief.relight import relit
from mpsnet_core.scene.normal_encoding import write_vectors
from mpsnet_core.scene.normal_map import NormalMap

MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
# In millimetres, from a micrometre to a kilometre. Beyond that, the unit is likely wrong.
SHORTEST, LONGEST = 1e-3, 1e6

_LENGTH = re.compile(rf"\s*([0-9]*\.?[0-9]+(?:e[+-]?[0-9]+)?)\s*({'|'.join(MILLIMETRES)})\s*", re.IGNORECASE)


def millimetres(text: str) -> float:
    """The length in millimetres. Raises SettingsError if `text` is not a number above 0 and its unit."""
    found = _LENGTH.fullmatch(text)
    if found is None:
        units = ", ".join(MILLIMETRES)
        raise SettingsError(f"{text!r} is not a length; give a number and its unit ({units}), for instance 120mm")
    length = float(found[1]) * MILLIMETRES[found[2].lower()]
    if not SHORTEST <= length <= LONGEST:
        raise SettingsError(f"{text} is not a length that can be photographed; give 0.001mm to 1000m")
    return length


@dataclass(frozen=True)
class Ruler:
    """A length measured between two points in a photo."""

    text: str
    """The user's input."""
    ends: tuple[float, ...]
    """The two points, (x1, y1, x2, y2) in pixels from the upper left corner."""
    length_mm: float
    """Distance between the two points in millimetres."""

    @property
    def pixels(self) -> float:
        """Distance between the two points in pixels."""
        return math.dist(self.ends[:2], self.ends[2:])

    def check_within(self, height: int, width: int) -> None:
        """Raise SettingsError if a point is not within a photo of that size."""
        x1, y1, x2, y2 = self.ends
        if not (0 <= min(x1, x2) <= max(x1, x2) <= width and 0 <= min(y1, y2) <= max(y1, y2) <= height):
            raise SettingsError(f"--ruler {self.text}: its places are outside the photo, which is {width} x {height}")


def parse_ruler(text: str) -> Ruler:
    """Parse a ruler such as ``x1,y1,x2,y2=50mm``. Raises SettingsError if it is malformed, or its points coincide."""
    places, _, length = text.partition("=")
    ends = _four_numbers(places, f"--ruler {text}", "x1,y1,x2,y2=50mm")
    if math.dist(ends[:2], ends[2:]) < 1:
        raise SettingsError(f"--ruler {text}: its two places are the same; measure between two others")
    return Ruler(text, ends, millimetres(length))


def parse_crop(text: str) -> tuple[int, int, int, int]:
    """Parse left, top, width and height in pixels. Raises SettingsError if `text` is malformed."""
    numbers = _four_numbers(text, f"--crop {text}", "x,y,width,height")
    if not all(number.is_integer() for number in numbers):
        raise SettingsError(f"--crop {text} is not of whole pixels; give whole numbers")
    left, top, width, height = map(int, numbers)
    return left, top, width, height


def _four_numbers(text: str, what: str, form: str) -> tuple[float, ...]:
    words = text.split(",")
    if len(words) != 4 or not all(re.fullmatch(r"\s*-?[0-9]+(\.[0-9]+)?\s*", word) for word in words):
        raise SettingsError(f"{what} is not {form}; give pixels from the photo's upper left corner")
    return tuple(map(float, words))


# ----------------------------------------------------------------------------------------------------------------------
# A material as files: its textures, a JSON file with their scales, and a preview of it repeated.


log = logging.getLogger(__name__)

MATERIAL_FORMAT = "mpsnet-material"
MATERIAL_VERSION = 1
PICTURES = {what: ".png" for what in ("normal", "height", "curvature", "albedo", "preview")} | {"height_mm": ".exr"}
REPEATS = 3
PREVIEW_SIDE = 1536
# Equation 2's mean slope in units of the network's: about 1 on matt materials, 1.6 to 4 on those with a sheen.
GLOSSY = 1.35
# From the upper left at a low angle, which shows the relief and any seam.
PREVIEW_LIGHT = (-0.6, 0.6, 0.6)


@dataclass(frozen=True)
class MaterialMade(Result):
    """The textures of a flat material."""

    files: dict[str, str]
    """The files by content."""
    width_mm: float
    """Width of the tile in millimetres."""
    height_mm: float
    """Height of the tile in millimetres."""
    relief_mm: float
    """Depth of the tile's relief in millimetres."""
    seam: float
    """The step of the normals across the tile's border, divided by that between other neighbours."""


def make_material(options: MakeMaterial, progress: Progress) -> MaterialMade:
    """Make a material from a photo, and write its textures. Raises InputError if that is not possible."""
    check_material(options.size, options.overlap, options.bend)
    crop = parse_crop(options.crop) if options.crop else None
    length, pixels, ruler = _scale(options)
    name = _checked_name(options)
    folder = disk.creatable_folder(options.output, "material")
    inputs = options.inputs(options.image, options.rig, options.camera, options.mesh)
    disk.check_no_overwrite(inputs, material_files(folder, name).values())
    estimate = partial(normals_by_photo, options) if options.model == BY_PHOTO else options.estimator()
    progress(0.0, f"reading {Path(options.image).name}")
    capture, width = _capture(options, ruler, crop)
    how = {name: getattr(options, name) for name in ("size", "overlap", "bend", "grey")}
    normals, step = estimate(capture, part(progress, 0.05, 0.5)), part(progress, 0.5, 0.85)
    material = flat_material(capture, normals, length / (pixels or width), **how, progress=step)
    progress(0.85, f"writing {folder.name}")
    files = write_material(folder, name, material, convention=options.convention)
    progress(1.0, "done")
    rows, columns = material.height.shape
    deep, seam = float(material.height.max()) - float(material.height.min()), material.seam.border[0]
    size = f"{material.width_mm:.4g} x {material.height_mm:.4g} mm"
    return MaterialMade(
        {what: str(file) for what, file in files.items()},
        material.width_mm,
        material.height_mm,
        deep,
        seam,
        text=f"{folder}: {name}, a tile of {size} ({columns} x {rows}), {deep:.3g} mm deep; "
        f"{_repeats(material.tiling.correlation)}; seam {seam:.2f}, where 1 is none",
    )


def normals_by_photo(options: MakeMaterial, capture: Capture, progress: Progress = silent) -> NormalMap:
    """The normals of the model that suits a flat material's photo.

    Equation 2 recovers a matt material in all its colours better than networks trained on whole objects. A sheen, which
    it takes for slopes, makes its normals far steeper than the network's.
    """
    matt = replace(options, model=LAMBERTIAN_GREY_WORLD).estimator()(capture)
    network = replace(options, model=DEFAULT_MODEL).estimator()(capture, progress)
    steep = [float(np.arccos(np.clip(one.vectors[capture.mask][:, 2], -1, 1)).mean()) for one in (matt, network)]
    glossy = steep[0] > GLOSSY * steep[1]
    if glossy:
        log.info("the photo shows a glossy material: its normals are those of %s", DEFAULT_MODEL)
    else:
        log.info("the photo shows a matt material: its normals are those of %s", LAMBERTIAN_GREY_WORLD)
    return network if glossy else matt


def _scale(options: MakeMaterial) -> tuple[float, float | None, Ruler | None]:
    """A length in millimetres, its pixels in the photo, None for the photo's width; and the ruler, if one is given."""
    given = [name for name in ("width", "pixel_size", "ruler") if getattr(options, name) is not None]
    if len(given) != 1:
        count = "several options state" if given else "no option states"
        raise SettingsError(f"{count} the material's size; give one of --width, --pixel-size or --ruler")
    if options.ruler is not None:
        ruler = parse_ruler(options.ruler)
        return ruler.length_mm, ruler.pixels, ruler
    return millimetres(options.width or options.pixel_size or ""), None if options.width else 1.0, None


def _checked_name(options: MakeMaterial) -> str:
    """The prefix of the file names. Raises SettingsError if name or folder is invalid."""
    name = Path(options.image).stem if options.name is None else options.name
    if Path(name).name != name:
        raise SettingsError(f"--name {name} is not a file name; give the folder with -o")
    if Path(options.output).suffix.lower() in disk.IMAGE_SUFFIXES:
        raise SettingsError(f"--output {options.output} looks like an image file; give a folder for all of them")
    return name


def _capture(options: MakeMaterial, ruler: Ruler | None, crop: tuple[int, int, int, int] | None) -> tuple[Capture, int]:
    """The part of the photo to use, and the whole photo's width in pixels."""
    [capture] = open_captures([options.source(options.image, options.rig, ALPHA_OR_NONE)], options.read_options())
    height, width = capture.mask.shape
    with disk.prefix_errors(options.image):
        if ruler:
            ruler.check_within(height, width)
        return crop_to_filled_part(capture, crop), width


def _repeats(correlation: tuple[float | None, float | None]) -> str:
    repeats = [f"{share:.0%} alike {way}" for share, way in zip(correlation, ("across", "down"), strict=True) if share]
    return f"it repeats in the photo, {' and '.join(repeats)}" if repeats else "nothing in the photo repeats"


def material_files(folder: AnyPath, name: str) -> dict[str, Path]:
    """The files that :func:`write_material` writes, by content: the PICTURES, and "material".

    Raises FileError if one of them exists and this program did not make it.
    """
    names = {what: f"{what}{suffix}" for what, suffix in PICTURES.items()} | {"material": "material.json"}
    files = {what: Path(folder) / f"{name}_{ending}" for what, ending in names.items()}
    for file in files.values():
        disk.check_own(file, derived=True, json_format=MATERIAL_FORMAT)
    return files


@takes_files
def write_material(
    folder: AnyPath, name: str, material: Material, *, convention: Convention = "opengl"
) -> dict[str, Path]:
    """Write a material into a folder, which is created if needed. Either all files are written, or none.

    Parameters
    ----------
    folder : str or PathLike
        Folder of the files.
    name : str
        Prefix of the file names.
    material : Material
        The tile.
    convention : {"opengl", "directx"}
        Whether green in the normal map points up or down.

    Returns
    -------
    dict of str to Path
        The files of :func:`material_files`. normal: 16 bits. height: 16 bits from black, the lowest, to
        white, the highest. height_mm: float, millimetres. curvature: grey where flat, lighter where convex, over the
        range that the JSON file states. albedo: sRGB. preview: 3 x 3 tiles under a low light. material: JSON.

    Raises
    ------
    FileError
        If the folder cannot be created or written, or another file would be overwritten.
    """
    files = material_files(disk.ensure_folder(folder, "material"), name)
    mask = np.ones(material.height.shape, bool)
    low, high = float(material.height.min()), float(material.height.max())
    bend = curvature_range(material.curvature, mask)
    description = {**_description(material, low, high, bend), "convention": convention}
    with disk.write_transaction():
        disk.write_json(files["material"], {**description, "files": {what: files[what].name for what in PICTURES}})
        write_vectors(files["normal"], material.normals, convention=convention)
        told = made("material")
        write_image(files["height"], (material.height - low) / max(high - low, 1e-9), description=told)
        write_image(files["height_mm"], material.height, description=told)
        write_image(files["curvature"], curvature_picture(material.curvature, bend), bits=8, description=told)
        write_picture(files["albedo"], linear_to_srgb(material.albedo))
        write_picture(files["preview"], repeated_picture(material))
    return files


def repeated_picture(material: Material) -> F32:
    """(H, W, 3) sRGB values: the tile repeated `REPEATS` times each way, reduced to its size and relit."""
    bright = max(float(np.percentile(material.albedo[::4, ::4], 99)), 1e-6)
    normals = NormalMap(material.normals, np.ones(material.height.shape, bool))
    tile = relit(normals, PREVIEW_LIGHT, albedo=material.albedo * np.float32(0.9 / bright))
    side = PREVIEW_SIDE / REPEATS / max(material.width_mm, material.height_mm)
    width, height = (max(1, round(side * length)) for length in (material.width_mm, material.height_mm))
    rows, columns = material.height.shape
    small = resampled(tile[..., :3], np.diag([columns / width, rows / height, 1.0]), (height, width), repeated=True)
    return np.clip(np.tile(small, (REPEATS, REPEATS, 1)), 0, 1)


def _description(material: Material, low: float, high: float, bend: float) -> dict[str, Any]:
    rows, columns = material.height.shape
    return {
        "format": MATERIAL_FORMAT,
        "version": MATERIAL_VERSION,
        "width_mm": material.width_mm,
        "height_mm": material.height_mm,
        "pixels": [columns, rows],
        "height_of_black_mm": low,
        "height_of_white_mm": high,
        "curvature_of_white_per_mm": bend,
        "photo": {
            "step_right": material.tiling.right.tolist(),
            "step_down": material.tiling.down.tolist(),
            "alike": list(material.tiling.correlation),
            "tilt_degrees": material.tilt,
        },
        "seam": asdict(material.seam),
    }
