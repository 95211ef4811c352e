"""The transfer curve of an image file: the one that its profile, gamma or format states, or the usual one."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import Floats
from mpsnet_core.errors import Choices
from mpsnet_core.io.colour_profile import UNKNOWN_TRANSFER, Curve, profile_curve, sampled, transfer_is_linear
from mpsnet_core.io.file_kinds import STATES_CURVE, STATES_TABLE, TRANSFER
from mpsnet_core.io.image import Assumed, Image, linear_to_srgb, srgb_to_linear
from mpsnet_core.io.image_input import image_attribute
from mpsnet_core.io.image_layers import FORMAT
from mpsnet_core.io.marks import assumed_curve

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
            log.warning(
                "%s has a colour profile without curves, of tables alone, which is not applied; convert it to sRGB's",
                path,
            )
        if profile is None and image_attribute(spec, STATES_TABLE, int) == 1:
            log.warning(
                "%s states its curve by a table (TIFF's TransferFunction), which is not applied; save it as sRGB", path
            )
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
