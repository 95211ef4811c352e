"""Transfer curves of images from ICC profiles (ICC.1:2022 or version 2) and from code points of ITU-T H.273."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.types import Floats
from mpsnet_core.errors import FormatError

Curve = Callable[[Floats], Floats]

# Transfer characteristics by their code points in H.273: unknown, linear, and those that differ much from sRGB.
UNKNOWN_TRANSFER, LINEAR_TRANSFER = 2, 8
OTHER_TRANSFERS = {9: "logarithmic", 10: "logarithmic", 16: "PQ (HDR)", 17: "DCI", 18: "HLG (HDR)"}

HEADER = 128
MIN_RISE = 0.5  # a curve that rises less from 0 to 1 is damaged
# The parameters of parametric curve types 0 to 4, in file order.
_PARAMETERS = ("g", "gab", "gabe", "gabcd", "gabcdef")


def profile_curve(profile: bytes) -> Curve | None:
    """The curve from stored values (..., 3), 0 to 1, to linear ones; None if the profile has none, or is damaged.

    Matrix/TRC profiles have curves: those of cameras, displays and working spaces, but not those of printers.
    """
    try:
        (count,) = struct.unpack_from(">I", profile, HEADER)
        entries = (struct.unpack_from(">4sII", profile, HEADER + 4 + 12 * number) for number in range(min(count, 100)))
        tags = {name: profile[start : start + size] for name, start, size in entries}
        names = (b"kTRC",) * 3 if b"kTRC" in tags else (b"rTRC", b"gTRC", b"bTRC")
        curves = [_curve(tags[name]) for name in names]
    except (struct.error, KeyError, ValueError):
        return None

    def linear(values: Floats) -> Floats:
        with np.errstate(all="ignore"):
            parts = [curve(values[..., channel]) for channel, curve in enumerate(curves)]
            return np.clip(np.stack(parts, axis=-1), 0, 1)

    rises = np.ptp(sampled(linear), axis=0) > MIN_RISE  # False for NaN
    return linear if rises.all() else None


def transfer_is_linear(path: Path, transfer: int) -> bool:
    """Whether the values of an image or video are linear; otherwise their curve is close to sRGB's.

    Raises FormatError for any other curve.
    """
    if transfer in OTHER_TRANSFERS:
        raise FormatError(
            f"{path} follows the {OTHER_TRANSFERS[transfer]} curve, which this program does not undo; convert it to "
            "BT.709 or sRGB, or set the encoding to sRGB to take it as it is"
        )
    return transfer == LINEAR_TRANSFER


def sampled(curve: Curve) -> Floats:
    """(256, 3) linear values of a curve for stored values from 0 to 1."""
    return curve(np.linspace(0, 1, 256, dtype=np.float32)[:, None].repeat(3, axis=1))


def _curve(tag: bytes) -> Curve:
    """One channel's curve. Raises struct.error, KeyError or ValueError if the tag is no curve."""
    if tag[:4] == b"curv":
        (count,) = struct.unpack_from(">I", tag, 8)
        if count > 1:
            table = np.frombuffer(tag, ">u2", count, 12) / np.float32(65535)
            return lambda values: np.interp(values, np.linspace(0, 1, count), table)
        power = struct.unpack_from(">H", tag, 12)[0] / 256 if count else 1.0
        return lambda values: np.maximum(values, 0) ** np.float32(power)
    if tag[:4] != b"para":
        raise ValueError
    (kind,) = struct.unpack_from(">H", tag, 8)
    letters = dict(enumerate(_PARAMETERS))[kind]
    given = dict(zip(letters, np.frombuffer(tag, ">i4", len(letters), 12) / 65536, strict=True))
    g, a, b, c, d, e, f = ({"a": 1.0, **given}.get(letter, 0.0) for letter in "gabcdef")
    if kind in (1, 2):  # constant below the threshold
        d, f = -b / a if a else 0.0, e
    return lambda values: np.where(values >= d, np.maximum(a * values + b, 0) ** g + e, c * values + f)
