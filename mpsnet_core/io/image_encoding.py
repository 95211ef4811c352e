"""The transfer curve of an image file: the one that its profile, gamma or format states, or the usual one."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.errors import Choices
from mpsnet_core.io.colour_profile import UNKNOWN_TRANSFER, Curve, profile_curve, sampled, transfer_is_linear
from mpsnet_core.io.image import Image, linear_to_srgb, srgb_to_linear
from mpsnet_core.io.image_input import PNG_SIGNATURE, image_attribute

log = logging.getLogger(__name__)

Encoding = Literal["auto", "linear", "srgb"]
# Whether values are linear; None if the file decides.
IS_LINEAR = Choices[bool | None]("encoding", {"auto": None, "linear": True, "srgb": False})

# The PNG gamma that represents the sRGB curve, and the plausible range of others.
SRGB_GAMMA, OTHER_GAMMAS = 2.2, (1.0, 3.0)
# Tolerance within which a profile's curve counts as sRGB or linear: small profiles have coarse tables.
SAME_CURVE = 0.003

# A PNG's chunks before its pixels are within this many bytes.
PNG_HEAD = 65_536


def stated_encoding(path: Path, spec: Any) -> tuple[Curve, bool]:
    """The transfer curve of a file, and whether it is assumed to be sRGB without a statement."""
    floats = is_float(spec)
    stated = (image_attribute(spec, "oiio:ColorSpace", str) or "").lower()
    profile = image_attribute(spec, "ICCProfile", np.ndarray)
    transfer = _png_transfer(path)
    if transfer is not None:  # it overrides a PNG's profile and gamma
        linear, curve = transfer_is_linear(path, transfer), None
    else:
        linear = "lin" in stated or stated in ("raw", "data")
        curve = None if linear or profile is None else profile_curve(profile.tobytes())
        linear = linear or (floats and curve is None)
        if curve is None and not linear:
            curve = _gamma_curve(image_attribute(spec, "oiio:Gamma", float))
    assumed = not (linear or curve is not None or transfer is not None or _states_its_curve(path, spec))
    known: tuple[tuple[str, Curve], ...] = (("linear", identity_curve), ("sRGB", srgb_to_linear))
    name, decoded = known[0] if linear else known[1]
    if curve is not None:
        same = (pair for pair in known if np.abs(sampled(pair[1]) - sampled(curve)).max() < SAME_CURVE)
        name, decoded = next(same, ("the file states", curve))
    hint = ""
    if assumed and spec.format.basetype == oiio.UINT16:
        hint = "; if a raw converter wrote linear values, set the encoding to linear"
    log.info("read as %s (%s file)%s", name, "float" if floats else spec.format, hint)
    return decoded, assumed


def is_float(spec: Any) -> bool:
    """Whether a file's values are floats."""
    return spec.format.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE)


def _gamma_curve(gamma: float | None) -> Curve | None:
    """The curve of a PNG that states only its gamma; None if that represents the sRGB curve, or is invalid."""
    if gamma is None or abs(gamma - SRGB_GAMMA) < 0.01 or not OTHER_GAMMAS[0] <= gamma <= OTHER_GAMMAS[1]:
        return None
    return lambda values: np.maximum(values, 0) ** np.float32(gamma)


def identity_curve(values: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """The curve of linear values."""
    return values


def with_stored_values(image: Image) -> Image:
    """An image that was decoded as sRGB, with the file's values as linear ones. It is overwritten."""
    for rows in bands(len(image.pixels)):
        image.pixels[rows] = linear_to_srgb(image.pixels[rows].astype(np.float32, copy=False))
    return replace(image, assumed=False)


def _states_its_curve(path: Path, spec: Any) -> bool:
    """Whether a file states its encoding by other means than a profile, as JPEG does.

    OpenImageIO reports sRGB for files without a statement, too.
    """
    if any(spec.getattribute(name) is not None for name in ("oiio:Gamma", "Exif:ColorSpace")):
        return True
    if path.suffix.lower() == ".png":
        return b"sRGB" in _png_head(path)
    return path.suffix.lower() in (".jpg", ".jpeg")


def _png_transfer(path: Path) -> int | None:
    """The transfer characteristics in a PNG's chunk cICP, which OpenImageIO 3.0 ignores."""
    _, found, body = _png_head(path).partition(b"\0\0\0\4cICP")
    return body[1] if found and len(body) > 1 and body[1] != UNKNOWN_TRANSFER else None


def _png_head(path: Path) -> bytes:
    """The bytes before a PNG's pixels; empty for other files."""
    with path.open("rb") as file:
        if file.read(len(PNG_SIGNATURE)) != PNG_SIGNATURE:
            return b""
        return file.read(PNG_HEAD).partition(b"IDAT")[0]
