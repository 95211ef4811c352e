"""The lens that a photo's EXIF data states."""

import logging
import math
from contextlib import closing
from pathlib import Path
from typing import Any

from mpsnet_core.io.files import RAW_SUFFIXES
from mpsnet_core.io.image_input import image_attribute, image_input
from mpsnet_core.io.opening import AnyPath

log = logging.getLogger(__name__)

# Sides of a frame of 35 mm film, in millimetres.
FRAME = (36.0, 24.0)
# 35 mm equivalent focal lengths that lenses have, in millimetres, and the longer sides of sensors.
MIN_STATED, MAX_STATED = 8.0, 2000.0
MIN_SENSOR, MAX_SENSOR = 3.0, 70.0
# Aspect ratios that differ by at most this factor count as equal: EXIF data may count a few pixels more.
SAME_ASPECT = 1.02
# Millimetres per unit of EXIF's FocalPlaneResolutionUnit: inch, centimetre, millimetre, micrometre.
_UNITS = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}


def stated_focal(path: AnyPath) -> float | None:
    """The 35 mm equivalent focal length along the longer side that a photo states, in millimetres.

    It is that of EXIF's FocalLengthIn35mmFilm, else of FocalLength and the sensor's resolution. None if the photo
    states none; also, with a message, if no lens has it, or the photo was cropped since.

    Raises FileError if the file's name is not valid UTF-8.
    """
    source = image_input(path)
    if source is None:
        return None
    with closing(source):
        spec = source.spec()
    size = max(spec.full_width, spec.full_height), min(spec.full_width, spec.full_height)
    recorded = sorted((_number(spec, "PixelXDimension"), _number(spec, "PixelYDimension")), reverse=True)
    focal = _in_35mm(spec, size, recorded)
    if focal is None:
        return None
    name = Path(path).name
    if not MIN_STATED <= focal <= MAX_STATED:
        log.info("%s states a lens of %.4g mm (EXIF), which no camera has; it is not used", name, focal)
        return None
    # The image that is read of a raw file is its preview.
    is_raw = Path(path).suffix.lower() in RAW_SUFFIXES
    if (
        not is_raw
        and recorded[1]
        and abs(math.log(size[0] / size[1] * recorded[1] / recorded[0])) > math.log(SAME_ASPECT)
    ):
        log.info("%s was cropped from %.0f x %.0f pixels, so its lens (%.0f mm) is not used", name, *recorded, focal)
        return None
    return focal


def _in_35mm(spec: Any, size: tuple[int, int], recorded: list[float]) -> float | None:
    """The focal length that EXIF data of a photo whose sides are `size` state; None if they state none."""
    equivalent = _number(spec, "FocalLengthIn35mmFilm")
    if equivalent:
        # It compares the diagonals.
        return equivalent * math.hypot(*size) / size[0] * FRAME[0] / math.hypot(*FRAME)
    focal, unit = _number(spec, "FocalLength"), _UNITS.get(int(_number(spec, "FocalPlaneResolutionUnit") or 2))
    per_unit = _number(spec, "FocalPlaneXResolution")
    if not focal or not unit or not per_unit:
        return None
    sensor = recorded[0] / per_unit * unit
    return focal / sensor * FRAME[0] if MIN_SENSOR <= sensor <= MAX_SENSOR else None


def _number(spec: Any, name: str) -> float:
    """A positive number of EXIF data; 0, by which EXIF says that it is unknown, if it is missing or none."""
    value = image_attribute(spec, f"Exif:{name}", object)
    return float(value) if isinstance(value, int | float) and 0 < value < math.inf else 0.0
