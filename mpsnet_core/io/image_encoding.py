"""Transfer curves of images from ICC profiles (ICC.1:2022 or version 2) and from code points of ITU-T H.273."""

import logging
import struct
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import Floats
from mpsnet_core.errors import Choices, FormatError
from mpsnet_core.io.file_kinds import FORMAT, STATES_CURVE, STATES_TABLE, TRANSFER
from mpsnet_core.io.image import Assumed, Image, linear_to_srgb, srgb_to_linear
from mpsnet_core.io.image_input import image_attribute
from mpsnet_core.io.marks import assumed_curve

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


# ----------------------------------------------------------------------------------------------------------------------
# The transfer curve of an image file: the one that its profile, gamma or format states, or the usual one.


log = logging.getLogger(__name__)

Encoding = Literal["auto", "linear", "srgb"]
# Whether values are linear; None if the file decides.
IS_LINEAR = Choices[bool | None]("encoding", {"auto": None, "linear": True, "srgb": False})

# The PNG gamma that represents the sRGB curve, and the plausible range of others.
SRGB_GAMMA, OTHER_GAMMAS = 2.2, (0.2, 5.0)
# Tolerance within which a profile's curve counts as sRGB or linear: small profiles have coarse tables.
SAME_CURVE = 0.003

# Formats that have the sRGB curve, or for floats are linear, unless they say otherwise.
OF_ITSELF = ("jpeg", "webp", "heif", "openexr", "hdr")


def curve_of(path: Path, spec: Any, encoding: Encoding) -> tuple[Curve, Assumed | None]:
    """The transfer curve of a file, and the encoding that is assumed if neither the file nor `encoding` states one.

    Reports what is read, and how that may be wrong. A photo that was made of others, whose encoding was assumed, is
    linear as far as that was right; the encoding is that of the others.
    """
    linear = IS_LINEAR[encoding]
    description = image_attribute(spec, "ImageDescription", str) or ""
    assumed = assumed_curve(description) if is_float(spec) else None
    if linear is None:
        decoded, of_itself = _stated_encoding(path, spec)
        return decoded, assumed or of_itself
    if assumed is None:
        return (identity_curve if linear else srgb_to_linear), None
    if encoding == assumed:
        return identity_curve, None
    return (linear_to_srgb if linear else srgb_to_linear), None


def _stated_encoding(path: Path, spec: Any) -> tuple[Curve, Assumed | None]:
    """The transfer curve that a file states, or the usual one, and the encoding that is assumed if it states none."""
    floats, kind = is_float(spec), spec.getattribute(FORMAT)
    stated = (image_attribute(spec, "oiio:ColorSpace", str) or "").lower()
    profile = image_attribute(spec, "ICCProfile", np.ndarray)
    transfer = image_attribute(spec, TRANSFER, int) or UNKNOWN_TRANSFER
    if transfer != UNKNOWN_TRANSFER:  # it overrides a PNG's profile and gamma
        linear, curve = transfer_is_linear(path, transfer), None
    else:
        linear = "lin" in stated or stated in ("raw", "data")
        curve = None if linear or profile is None else profile_curve(profile.tobytes())
        if profile is not None and curve is None and not linear:
            log.warning("%s has a colour profile of tables, without curves, not used; convert it to sRGB", path)
        if profile is None and image_attribute(spec, STATES_TABLE, int) == 1:
            log.warning("%s states its curve by a table (TransferFunction), not read; save it as sRGB", path)
        linear = linear or (floats and curve is None)
        if curve is None and not linear:
            curve = _gamma_curve(image_attribute(spec, "oiio:Gamma", float), path)
    says = bool(image_attribute(spec, STATES_CURVE, int)) or kind in OF_ITSELF or "lin" in stated
    says = says or any(spec.getattribute(name) is not None for name in ("oiio:Gamma", "Exif:ColorSpace"))
    assumed: Assumed | None = None
    if not says and transfer == UNKNOWN_TRANSFER and curve is None and not (floats and profile is not None):
        assumed = "linear" if linear else "srgb"
    known: tuple[tuple[str, Curve], ...] = (("linear", identity_curve), ("sRGB", srgb_to_linear))
    name, decoded = known[0] if linear else known[1]
    if curve is not None:
        same = (pair for pair in known if np.abs(sampled(pair[1]) - sampled(curve)).max() < SAME_CURVE)
        name, decoded = next(same, ("the file states", curve))
    hint = ""
    if assumed == "srgb" and spec.format.basetype == oiio.UINT16:
        hint = "; if a raw converter wrote linear values, set the encoding to linear"
    log.info("read as %s (%s file)%s", name, "float" if floats else spec.format, hint)
    return decoded, assumed


def is_float(spec: Any) -> bool:
    """Whether a file's values are floats."""
    return spec.format.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)


def _gamma_curve(gamma: float | None, path: Path) -> Curve | None:
    """The curve of a file that states only its gamma; None if that represents the sRGB curve, or no file has it."""
    if gamma is None or abs(gamma - SRGB_GAMMA) < 0.01:
        return None
    if not OTHER_GAMMAS[0] <= gamma <= OTHER_GAMMAS[1]:
        log.warning("%s states a gamma of %.4g, which no file has; sRGB is assumed; set the encoding", path, gamma)
        return None
    return lambda values: np.maximum(values, 0) ** np.float32(gamma)


def identity_curve(values: Floats) -> Floats:
    """The curve of linear values."""
    return values


def otherwise_encoded(image: Image) -> Image:
    """An image whose encoding was assumed, by the other one: sRGB values as linear ones, or linear ones as sRGB.

    It is overwritten.
    """
    curve = linear_to_srgb if image.assumed == "srgb" else srgb_to_linear
    for rows in bands(len(image.pixels)):
        image.pixels[rows] = curve(image.pixels[rows].astype(np.float32, copy=False))
    return replace(image, assumed=None)
