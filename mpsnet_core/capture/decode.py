"""From files to linear pixels: how to read photos and their companions, all of them alike."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.sizes import SAME_CAMERA, check_same_size
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.errors import FormatError, SettingsError
from mpsnet_core.io.frames import expand_images
from mpsnet_core.io.image import CHANNELS, Assumed, Image, exposed_otherwise, in_frame_of, in_one_frame, turned
from mpsnet_core.io.image_encoding import Encoding, otherwise_encoded
from mpsnet_core.io.image_reading import layer_in, read_image
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.photogrammetry.posed_photo import Lens, undistorted, undistorted_mask

# --- dark frame and flat field: remove offset and ambient light, and the falloff of lens and lights -------------------


log = logging.getLogger(__name__)

# Below this share of its mean in the middle, a flat field is unusable: dividing by it amplifies noise.
MIN_FLAT = 0.05
# Largest share of unusable pixels in a flat field. Some are expected: sensors have dead and hot pixels.
BAD_SHARE = 0.001


@dataclass(frozen=True, eq=False)
class Correction:
    """An image to subtract from a photo, and one to multiply the difference by."""

    dark: F32 | None
    """(H, W, 3) float32. Dark frame: the linear values of a photo without the three lights."""
    gain: F32 | None
    """(H, W, 3) float32. Reciprocal of the flat field, which has mean 1 in the middle in each channel."""
    unusable: Bools | None
    """(H, W, 3) bool. Where dark frame or flat field are saturated or too weak; None if there is neither."""
    exposure_time: float | None
    """Exposure time of the dark frame in seconds, if its file states it."""
    orientation: int | None = None
    """The EXIF orientation by which the frames were turned, as :attr:`mpsnet_core.io.image.Image.orientation`."""

    def oriented_like(self, photo: Image) -> "Correction":
        """The correction in the frame of a photo: turned by the photo's orientation, if that makes the sizes equal."""
        ways = self.orientation, photo.orientation
        frame = self.dark if self.dark is not None else self.gain
        if frame is None or ways[0] == ways[1] or turned(frame, *ways).shape[:2] != photo.pixels.shape[:2]:
            return self
        frames = {name: getattr(self, name) for name in ("dark", "gain", "unusable")}
        shown: dict[str, Any] = {name: one if one is None else turned(one, *ways) for name, one in frames.items()}
        return replace(self, **shown, orientation=photo.orientation)


def read_correction(
    dark: AnyPath | None = None,
    flat: AnyPath | None = None,
    *,
    encoding: Encoding = "auto",
    layer: str | None = None,
    smooth: int = 0,
) -> Correction:
    """Read dark frame and flat field. Each is a file, or a folder or pattern of frames to average.

    Parameters
    ----------
    dark : str or path, optional
        Photos with the three lights off, with the exposure and sensitivity of the photo. Cover the lens, or leave the
        room light as it was.
    flat : str or path, optional
        Photos of an even white, matt card in the object's place, under the same lights and through the same lens.
    encoding, layer : str, optional
        As in :func:`read_image`; the layer applies to files with several layers.
    smooth : int
        Remove detail finer than this many pixels from the flat field, if the card's grain shows; 0 for none.

    Returns
    -------
    Correction

    Raises
    ------
    InputError
        If a file is missing or damaged, frame sizes differ, or the flat field is overexposed or nearly black.

    Notes
    -----
    The dark frame is also subtracted from the flat field. Each channel of the difference is then divided by its mean in
    the middle third of the image: the lights keep their relative strengths, and the middle its brightness.
    """
    if smooth < 0:
        raise SettingsError(f"a flat field can be smoothed over 0 pixels or more, not {smooth}")
    level = gain = unusable = None
    first: Image | None = None
    if dark is not None:
        first = _mean_frame(dark, encoding, layer)
        level, unusable = first.pixels, first.saturated
        if unusable.mean() > BAD_SHARE:
            raise FormatError(f"{dark} is no dark frame: it is overexposed; switch the lights off, or expose less")
    if flat is not None:
        mean = _mean_frame(flat, encoding, layer)
        mean = mean if first is None else in_frame_of(mean, flat, first, dark)
        field, clipped = mean.pixels, mean.saturated
        if clipped.mean() > BAD_SHARE:
            raise FormatError(f"{clipped.mean():.1%} of the flat field {flat} is overexposed; use a shorter exposure")
        if level is not None:
            check_same_size(f"the dark frame {dark}", level.shape, f"the flat field {flat}", field.shape, SAME_CAMERA)
            field = field - level
        if smooth:
            field = _smoothed(field, smooth)
        gain, weak = _gain(field, flat)
        unusable = clipped | weak if unusable is None else unusable | clipped | weak
        first = first or replace(mean, exposure_time=None)
    time, orientation = (None, None) if first is None else (first.exposure_time, first.orientation)
    return Correction(level, gain, unusable, time, orientation)


def corrected(image: Image, correction: Correction | None) -> Image:
    """The photo minus the dark frame, divided by the flat field, clamped at zero; unchanged if there is neither.

    Clipped pixels stay clipped, and pixels that are unusable in dark frame or flat field count as clipped.

    Raises GeometryError if sizes differ, FormatError if the photo is no brighter than the dark frame.
    """
    if correction is None:
        return image
    correction = correction.oriented_like(image)
    for name, frame in (("dark frame", correction.dark), ("flat field", correction.gain)):
        if frame is not None:
            check_same_size(f"the {name}", frame.shape, "the photo", image.pixels.shape, SAME_CAMERA)
    if correction.dark is not None:
        dark, photo = correction.exposure_time, image.exposure_time
        if exposed_otherwise(dark, photo):
            log.warning("dark frame exposed for %.3g s, the photo for %.3g s: use the same for both", dark, photo)
        if np.nanmean(image.pixels) <= correction.dark.mean():
            raise FormatError("the dark frame is as bright as the photo; take it with the three lights off")
    clipped = image.saturated
    if correction.unusable is not None:
        clipped = clipped | correction.unusable
    pixels = np.empty_like(image.pixels)
    for rows in bands(len(pixels)):
        pixels[rows] = image.pixels[rows]
        if correction.dark is not None:
            pixels[rows] = np.maximum(pixels[rows] - correction.dark[rows], 0)
        if correction.gain is not None:
            pixels[rows] *= correction.gain[rows]
    # The transfer curve of corrected values cannot be judged any more, hence assumed=None.
    return replace(image, pixels=pixels, clip=np.inf, clipped=clipped, assumed=None)


def _mean_frame(path: AnyPath, encoding: Encoding, layer: str | None) -> Image:
    """Mean of all frames; `clipped` where any of them is saturated, and the rest as in the first one.

    Frames of one channel are taken: what is dark, or even, has no colour.
    """
    files = expand_images([path])

    def read(file: AnyPath) -> Image:
        return read_image(file, encoding=encoding, layer=layer_in(file, layer), grey=True)

    frames = in_one_frame(files, read)
    mean = next(frames)
    total, clipped = mean.pixels, mean.saturated
    for image in frames:
        total, clipped = total + image.pixels, clipped | image.saturated
    if not np.isfinite(total).all():
        raise FormatError(f"{path} holds values that are not finite; export it again")
    return replace(mean, pixels=total / np.float32(len(files)), clipped=clipped)


def _gain(field: F32, flat: AnyPath) -> tuple[F32, Bools]:
    """Reciprocal of the flat field (H, W, 3), 1 where it is too weak, and where that is (H, W, 3)."""
    height, width, _ = field.shape
    middle = field[height // 3 : height - height // 3, width // 3 : width - width // 3].mean(axis=(0, 1))
    if not (middle > 0).all():
        channel = CHANNELS[int(np.argmin(middle))]
        raise FormatError(f"the flat field {flat} is black in the middle of its {channel} channel; were all lights on?")
    field = field / middle
    weak = field < MIN_FLAT
    if weak.mean() > BAD_SHARE:
        raise FormatError(f"{weak.mean():.1%} of the flat field {flat} is nearly black; fill the picture with the card")
    return np.divide(1, field, out=np.ones_like(field), where=~weak), weak


def _smoothed(field: F32, pixels: int) -> F32:
    """The field without detail finer than `pixels`: downsampled and upsampled."""
    height, width, _ = field.shape
    small = oiio.ROI(0, -(-width // pixels), 0, -(-height // pixels), 0, 1, 0, 3)
    whole = oiio.ROI(0, width, 0, height, 0, 1, 0, 3)
    source = oiio.ImageBuf(np.ascontiguousarray(field))
    resized = oiio.ImageBufAlgo.resize(oiio.ImageBufAlgo.resize(source, "gaussian", roi=small), "cubic", roi=whole)
    return np.asarray(resized.get_pixels(oiio.FLOAT), np.float32)


@dataclass(frozen=True)
class PhotoReadOptions:
    """How to read a photo and its companions: the photo of the background and the one under white light."""

    encoding: Encoding = "auto"
    """How the values encode light, as in :func:`mpsnet_core.read_image`."""
    layer: str | None = None
    """Layer of a file with several, as in :func:`mpsnet_core.read_image`."""
    correction: Correction | None = None
    """Dark frame and flat field; None if there is neither."""
    assumed: Assumed | None = None
    """The encoding of files that do not state it. By default the usual one: sRGB for integers, linear for floats."""

    def photo(self, path: AnyPath, *, grey: bool = False) -> Image:
        """Read a photo, without correction. grey and errors: as in :func:`read_image`.

        A large photo is held in half floats, unless it will be corrected.
        """
        compact = self.correction is None
        return self._meant(read_image(path, encoding=self.encoding, layer=self.layer, grey=grey, compact=compact))

    def companion(self, path: AnyPath, photo: Image) -> Image:
        """Read a companion of the photo, without correction, from the photo's layer if the file has several.

        It is turned as the photo was: the camera stood still.
        """
        image = self._meant(read_image(path, encoding=self.encoding, layer=layer_in(path, self.layer)))
        return in_frame_of(image, path, photo, "the photo")

    def _meant(self, image: Image) -> Image:
        other = image.assumed and self.assumed not in (None, image.assumed)
        return otherwise_encoded(image) if other else image


AS_STATED: PhotoReadOptions = PhotoReadOptions()  # the encoding that the files state


def undistorted_photo(image: Image, camera: Camera, lens: Lens | None) -> Image:
    """An image of the camera's size without lens distortion."""
    if lens is None:
        return image
    pixels = undistorted(image.pixels, camera, lens)
    clip, clipped = image.clip, image.clipped
    if clipped is not None or np.isfinite(clip):
        # Resampled pixels that a clipped one contributed to are wrong, although they are below the clipping value.
        whole = undistorted_mask(~np.any(image.saturated, axis=-1), camera, lens)
        clip, clipped = np.inf, np.broadcast_to(~whole[..., None], pixels.shape)
    return replace(image, pixels=pixels, alpha=None, clip=clip, clipped=clipped)


def warn_of_other_exposures(photos: Sequence[AnyPath], images: Sequence[Image]) -> None:
    """Report photos of one light each whose exposure time, by their files, differs from the first one's."""
    first = images[0].exposure_time
    for photo, image in zip(photos, images, strict=True):
        if exposed_otherwise(image.exposure_time, first):
            times = photo, image.exposure_time, photos[0], first
            log.warning("%s was exposed for %.3g s, %s for %.3g s: use the same for all lights", *times)
