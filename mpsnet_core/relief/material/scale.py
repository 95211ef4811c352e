"""Parsing of a photo's scale: lengths (120mm, 12 cm, 0.12m, 4in), and positions in pixels."""

import math
import re
from dataclasses import dataclass

from mpsnet_core.errors import SettingsError

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
            raise SettingsError(
                f"--ruler {self.text}: its places are not within the photo, which is {width} x {height}"
            )


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
