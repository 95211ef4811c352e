"""Images: a photo's linear values with what its file states about them; the sRGB curve."""

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

log = logging.getLogger(__name__)

# Names of a photo's channels, and of the rig's lights in them.
CHANNELS = ("red", "green", "blue")

# Checked before any memory is allocated: a broken or hostile header can claim any size.
MAX_PIXELS = 400_000_000

# Photos and normals with more pixels are stored as half floats (exact to 0.05%): 100 megapixels take 2 GB.
HALF_ABOVE = 1 << 24

# Relative tolerance of equal exposure times: files round them.
SAME_EXPOSURE = 0.1

# The fraction of saturated pixels from which on a photo gets a warning.
SPOILT_SHARE = 0.005

# A channel above this fraction of the clip value is saturated: an 8-bit sRGB 254 is linear 0.991.
SATURATED_SHARE = 0.99


@dataclass(frozen=True)
class Image:
    """An image as read.

    Attributes
    ----------
    pixels : (H, W, 3) float32 array
        Linear, row 0 on top, not premultiplied by alpha; float16 for a large photo that was read compactly.
    alpha : (H, W) float32 array or None
        From 0 to 1; None if the file has none.
    clip : float
        The linear value where channels saturate: 1 in integer files, infinity in float files and with `clipped`.
    clipped : (H, W, 3) bool array or None
        Where a channel is saturated; None if `clip` determines it.
    exposure_time : float or None
        In seconds, if the file states it.
    assumed : bool
        Whether sRGB is assumed, as usual for such files, but neither stated by the file nor requested.
    """

    pixels: NDArray[np.floating[Any]]
    alpha: NDArray[np.float32] | None
    clip: float
    clipped: NDArray[np.bool_] | None = None
    exposure_time: float | None = None
    assumed: bool = False

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """(H, W, 3) where a channel is saturated, and its value wrong."""
        return self.pixels >= SATURATED_SHARE * self.clip if self.clipped is None else self.clipped


def warn_of_saturation(name: object, image: Image) -> None:
    """Warn of saturation in a photo that is written as floats, which lose that information."""
    spoilt = image.saturated.any(axis=-1).mean()
    if spoilt > SPOILT_SHARE:
        log.warning(
            "%.1f%% of %s is saturated and therefore wrong; use a shorter exposure [clipped-photo]", 100 * spoilt, name
        )


def storage_type(shape: tuple[int, ...]) -> type[np.floating[Any]]:
    """The type that stores values of an image (H, W): half floats if it is large."""
    return np.float16 if shape[0] * shape[1] > HALF_ABOVE else np.float32


def srgb_to_linear(values: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """The inverse of the sRGB curve (IEC 61966-2-1); any shape, 0 to 1."""
    return np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(values: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """The sRGB curve (IEC 61966-2-1); any shape, clipped to 0 to 1."""
    values = np.clip(values, 0, 1)
    return np.where(values <= 0.0031308, values * 12.92, 1.055 * values ** (1 / 2.4) - 0.055)


def exposed_otherwise(time: float | None, reference: float | None) -> bool:
    """Whether two exposure times differ, as far as both are known."""
    if not time or not reference:
        return False
    return not 1 - SAME_EXPOSURE < time / reference < 1 + SAME_EXPOSURE
