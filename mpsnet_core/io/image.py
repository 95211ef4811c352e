"""Images: a photo's linear values with what its file states about them; the sRGB curve."""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.sizes import SAME_CAMERA, check_same_size
from mpsnet_core.arrays.types import F32, Bools, Floats

log = logging.getLogger(__name__)

T = TypeVar("T", bound=np.generic)
File = TypeVar("File")

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


Assumed = Literal["srgb", "linear"]
# The EXIF orientation that undoes another one, where it is another.
_INVERSE = {6: 8, 8: 6}


@dataclass(frozen=True)
class Image:
    """An image as read."""

    pixels: Floats
    """(H, W, 3) float32. Linear, row 0 on top, not premultiplied by alpha; float16 for a large photo that was read
    compactly."""
    alpha: F32 | None
    """(H, W) float32. From 0 to 1; None if the file has none."""
    clip: float
    """The linear value where channels saturate: 1 in integer files, infinity in float files and with `clipped`."""
    clipped: Bools | None = None
    """(H, W, 3) bool. Where a channel is saturated; None if `clip` determines it."""
    exposure_time: float | None = None
    """Exposure time in seconds; None if the file does not state it."""
    assumed: Assumed | None = None
    """The encoding, "srgb" or "linear", that is assumed, as usual for such files; None if the file states it or the
    user requested it."""
    orientation: int | None = None
    """The EXIF orientation, 1 to 8, by which the stored pixels were turned; None if a decoder has turned them."""

    @property
    def saturated(self) -> Bools:
        """(H, W, 3) where a channel is saturated, and its value wrong."""
        return self.pixels >= SATURATED_SHARE * self.clip if self.clipped is None else self.clipped


def oriented(values: NDArray[T], orientation: int) -> NDArray[T]:
    """Stored pixels (H, W, ...) turned by their EXIF orientation, as viewers display them."""
    if orientation >= 5:
        values = values.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    return values


def turned(values: NDArray[T], before: int | None, after: int | None) -> NDArray[T]:
    """Pixels that were turned by the EXIF orientation `before`, as if it had been `after`; as they are if unknown."""
    if before is None or after is None or before == after:
        return values
    return oriented(oriented(values, _INVERSE.get(before, before)), after)


def in_frame_of(image: Image, name: object, first: Image, first_name: object) -> Image:
    """An image turned by the EXIF orientation of the first one, where the camera did not move between them.

    A camera that looks down states one at random. Reports it if the image stated another. An image that has the first
    one's size only by its own orientation keeps it: a program has turned one of the two.
    """
    if None in (image.orientation, first.orientation) or image.orientation == first.orientation:
        return image
    pixels = turned(image.pixels, image.orientation, first.orientation)
    if pixels.shape[:2] != first.pixels.shape[:2] == image.pixels.shape[:2]:
        return image
    log.warning(
        "%s states the orientation %s and %s %s (EXIF); both are taken to lie as on the camera's sensor, "
        "and are turned by the latter",
        name,
        image.orientation,
        first_name,
        first.orientation,
    )
    alpha = None if image.alpha is None else turned(image.alpha, image.orientation, first.orientation)
    clipped = None if image.clipped is None else turned(image.clipped, image.orientation, first.orientation)
    return replace(image, pixels=pixels, alpha=alpha, clipped=clipped, orientation=first.orientation)


def in_one_frame(files: Sequence[File], read: Callable[[File], Image]) -> Iterator[Image]:
    """Photos of a camera that stood still, one at a time, each turned as the first one is: see :func:`in_frame_of`.

    Raises GeometryError if sizes differ.
    """
    first: Image | None = None
    for file in files:
        image = read(file)
        if first is None:  # only what states how it was turned
            empty = np.broadcast_to(np.float32(0), image.pixels.shape)
            first = replace(image, pixels=empty, alpha=None, clipped=None)
        image = in_frame_of(image, file, first, files[0])
        check_same_size(str(file), image.pixels.shape, str(files[0]), first.pixels.shape, SAME_CAMERA)
        yield image


def warn_of_saturation(name: object, image: Image) -> None:
    """Warn of saturation in a photo that is written as floats, which lose that information."""
    spoilt = image.saturated.any(axis=-1).mean()
    if spoilt > SPOILT_SHARE:
        log.warning("%.1f%% of %s is saturated, so wrong; use a shorter exposure [clipped-photo]", 100 * spoilt, name)


def storage_type(shape: tuple[int, ...]) -> type[np.floating[Any]]:
    """The type that stores values of an image (H, W): half floats if it is large."""
    return np.float16 if shape[0] * shape[1] > HALF_ABOVE else np.float32


def srgb_to_linear(values: Floats) -> Floats:
    """The inverse of the sRGB curve (IEC 61966-2-1); any shape, 0 to 1."""
    return np.where(values <= 0.04045, values / 12.92, ((np.maximum(values, 0) + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(values: Floats) -> Floats:
    """The sRGB curve (IEC 61966-2-1); any shape, clipped to 0 to 1."""
    values = np.clip(values, 0, 1)
    return np.where(values <= 0.0031308, values * 12.92, 1.055 * values ** (1 / 2.4) - 0.055)


def exposed_otherwise(time: float | None, reference: float | None) -> bool:
    """Whether two exposure times differ, as far as both are known."""
    if not time or not reference:
        return False
    return not 1 - SAME_EXPOSURE < time / reference < 1 + SAME_EXPOSURE
