"""Lengths as people write them: 120mm, 12 cm, 0.12m, 4in."""

import re

from mpsnet_core.errors import InputError

MILLIMETRES = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
# A thousandth of a millimetre to a kilometre: beyond that a unit has been mistaken.
SHORTEST, LONGEST = 1e-3, 1e6

_LENGTH = re.compile(rf"\s*([0-9]*\.?[0-9]+(?:e[+-]?[0-9]+)?)\s*({'|'.join(MILLIMETRES)})\s*", re.IGNORECASE)


def millimetres(text: str) -> float:
    """The length in millimetres. Raises InputError where `text` is not a number above 0 and its unit."""
    found = _LENGTH.fullmatch(text)
    if found is None:
        units = ", ".join(MILLIMETRES)
        raise InputError(f"{text!r} is not a length; give a number and its unit ({units}), for instance 120mm")
    length = float(found[1]) * MILLIMETRES[found[2].lower()]
    if not SHORTEST <= length <= LONGEST:
        raise InputError(f"{text} is not a length that can be photographed; give 0.001mm to 1000m")
    return length
