"""The verb material: a photo of something flat to textures that repeat without a seam."""

import argparse
import re
from pathlib import Path
from typing import Any

from mpsnet_core.capture.operations import files_read
from mpsnet_core.cli.arguments import (
    Help,
    Verbs,
    add_network,
    add_reading,
    add_viewpoint,
    parse_correction,
    parse_estimator,
    parse_viewpoint,
)
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.defaults import BEND, OVERLAP
from mpsnet_core.errors import InputError

# Of cloth and leather, which are matt and lit by all three lights, equation 2 tells more than the networks, which
# have learned from whole objects.
MODEL = "lambertian-grey-world"


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    parser = verbs.add_parser(
        "material",
        parents=[common],
        formatter_class=Help,
        help="photo of cloth, leather or bark to textures that repeat without a seam",
    )
    parser.add_argument("image", help="photo of something flat that fills it, or its --crop")
    parser.add_argument("--rig", required=True, help="rig file (.json, or .lp with three lights)")
    scale = parser.add_argument_group("scale", "how large it is, one of")
    scale.add_argument("--width", metavar="LENGTH", help="what the photo's whole width measures: 120mm, 12cm, 4.5in")
    scale.add_argument("--pixel-size", metavar="LENGTH", help="what a pixel measures: 0.05mm")
    scale.add_argument(
        "--ruler", metavar="X1,Y1,X2,Y2=LENGTH", help="what two places measure, in pixels: 120,80,1620,95=50mm"
    )
    parser.add_argument("--crop", metavar="X,Y,W,H", help="the part of the photo to use, from its upper left corner")
    parser.add_argument(
        "--size", type=int, help="side of the square pictures in pixels; those of the photo unless given"
    )
    parser.add_argument(
        "--overlap", type=float, default=OVERLAP, help="share of the tile that its borders are joined over"
    )
    parser.add_argument(
        "--bend",
        type=int,
        default=BEND,
        help="half waves across the photo up to which bends and uneven brightness are taken out; 0 for the tilt alone",
    )
    parser.add_argument("--grey", action="store_true", help="an albedo without colour")
    parser.add_argument("--convention", default="opengl", help="of the normals: opengl (green up) or directx")
    parser.add_argument("--name", help="what the files' names begin with; the photo's unless given")
    add_network(parser, MODEL)
    add_viewpoint(parser)
    add_reading(parser)
    parser.add_argument("-o", "--output", required=True, metavar="FOLDER", help="folder for the pictures")
    parser.set_defaults(verb=_material, mask=None)


def _material(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.capture.capture import capture_from, note_doubts
    from mpsnet_core.io.files import IMAGE_SUFFIXES, makeable_folder
    from mpsnet_core.io.frames import check_apart
    from mpsnet_core.io.images import read_image
    from mpsnet_core.progress import part
    from mpsnet_core.relief.material.material import check_material, filled_part, flat_material
    from mpsnet_core.relief.material.material_files import material_files, write_material
    from mpsnet_core.scene.normal_map import check_convention
    from mpsnet_core.scene.rig import read_rig

    check_convention(options.convention)
    check_material(options.size, options.overlap, options.bend)
    crop = _crop(options.crop) if options.crop else None
    length, pixels = _parse_scale(options)
    photo = Path(options.image)
    name = photo.stem if options.name is None else options.name
    if Path(name).name != name:
        raise InputError(f"--name {name} is not a file's name; give the folder with -o")
    if Path(options.output).suffix.lower() in IMAGE_SUFFIXES:
        raise InputError(f"--output {options.output} ends like a picture; give the folder for all of them")
    folder = makeable_folder(options.output, "material")
    check_apart([photo, options.rig, *files_read(options)], material_files(folder, name).values())
    rig, correction, (camera, depth) = read_rig(options.rig), parse_correction(options), parse_viewpoint(options)
    estimator = parse_estimator(options, MODEL)
    reporter.progress(0.0, f"reading {photo.name}")
    image = read_image(photo, encoding=options.encoding, layer=options.layer)
    try:
        capture = capture_from(
            image,
            rig,
            mask="none" if image.alpha is None else "alpha",
            camera=camera,
            depth=depth,
            correction=correction,
        )
        if options.ruler:
            _check_ruler(options.ruler, *capture.mask.shape)
        pixel_mm = length / (pixels or capture.mask.shape[1])
        capture = filled_part(capture, crop)
    except InputError as error:
        raise InputError(f"{photo}: {error}") from None
    note_doubts(capture)
    normals = estimator(capture, part(reporter.progress, 0.05, 0.5))
    material = flat_material(
        capture,
        normals,
        pixel_mm,
        size=options.size,
        overlap=options.overlap,
        bend=options.bend,
        grey=options.grey,
        progress=part(reporter.progress, 0.5, 0.85),
    )
    reporter.progress(0.85, f"writing {folder.name}")
    files = write_material(folder, name, material, convention=options.convention)
    reporter.progress(1.0, "done")
    rows, columns = material.height.shape
    low, high = float(material.height.min()), float(material.height.max())
    size = f"{material.width_mm:.4g} x {material.height_mm:.4g} mm"
    return {
        "files": {what: str(file) for what, file in files.items()},
        "width_mm": material.width_mm,
        "height_mm": material.height_mm,
        "relief_mm": high - low,
        "seam": material.seam.border[0],
        "text": f"{folder}: {name}, a tile of {size} ({columns} x {rows}), {high - low:.3g} mm deep; "
        f"{_repeats(material.tiling.alike)}; seam {material.seam.border[0]:.2f}, where 1 is none",
    }


def _repeats(alike: tuple[float | None, float | None]) -> str:
    told = [f"{share:.0%} alike {way}" for share, way in zip(alike, ("across", "down"), strict=True) if share]
    return f"it repeats in the photo, {' and '.join(told)}" if told else "nothing in the photo repeats"


def _parse_scale(options: argparse.Namespace) -> tuple[float, float | None]:
    """A length in millimetres, and how many of the photo's pixels it is; None for its width, not known yet."""
    from mpsnet_core.cli.units import millimetres

    given = [name for name in ("width", "pixel_size", "ruler") if getattr(options, name) is not None]
    if len(given) != 1:
        said = "several options tell how large it is" if given else "nothing tells how large it is"
        raise InputError(f"{said}; give one of --width, --pixel-size or --ruler")
    if given == ["ruler"]:
        x1, y1, x2, y2 = _ruler(options.ruler)
        pixels = ((x2 - x1) ** 2 + (y2 - y1) ** 2) ** 0.5
        if pixels < 1:
            raise InputError(f"--ruler {options.ruler}: its two places are the same; measure between two others")
        return millimetres(options.ruler.partition("=")[2]), pixels
    return millimetres(getattr(options, given[0])), (None if given == ["width"] else 1.0)


def _ruler(text: str) -> list[float]:
    """x1, y1, x2 and y2 in pixels."""
    return _numbers(text.partition("=")[0], 4, f"--ruler {text}", "x1,y1,x2,y2=50mm")


def _check_ruler(text: str, height: int, width: int) -> None:
    x1, y1, x2, y2 = _ruler(text)
    if not (0 <= min(x1, x2) <= max(x1, x2) <= width and 0 <= min(y1, y2) <= max(y1, y2) <= height):
        raise InputError(f"--ruler {text}: its places are not within the photo, which is {width} x {height}")


def _crop(text: str) -> tuple[int, int, int, int]:
    numbers = _numbers(text, 4, f"--crop {text}", "x,y,width,height")
    if not all(number.is_integer() for number in numbers):
        raise InputError(f"--crop {text} is not of whole pixels; give whole numbers")
    left, top, width, height = map(int, numbers)
    return left, top, width, height


def _numbers(text: str, count: int, what: str, form: str) -> list[float]:
    words = text.split(",")
    if len(words) != count or not all(re.fullmatch(r"\s*-?[0-9]+(\.[0-9]+)?\s*", word) for word in words):
        raise InputError(f"{what} is not {form}; give pixels from the photo's upper left corner")
    return [float(word) for word in words]
