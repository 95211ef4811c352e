"""Captures: a photo in linear values with its mask, rig and camera, and optionally a white photo."""

import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.sizes import SAME_CAMERA, check_same_size
from mpsnet_core.capture.correction import Correction, corrected
from mpsnet_core.capture.masks import Notes, find_mask, follows_values
from mpsnet_core.capture.reading import AS_STATED, Reading
from mpsnet_core.capture.rig_check import warn_of_wrong_rig
from mpsnet_core.capture.transfer_curve import is_taken_as_linear, warn_of_doubtful_curve
from mpsnet_core.defaults import MASK
from mpsnet_core.errors import FormatError, GeometryError, NoObject, SettingsError
from mpsnet_core.io.files import prefix_errors, resolved
from mpsnet_core.io.frames import expand_images
from mpsnet_core.io.image import CHANNELS, SATURATED_SHARE, Image
from mpsnet_core.io.image_encoding import Encoding, with_stored_values
from mpsnet_core.scene.camera import Camera, camera_of_lens
from mpsnet_core.scene.rig import LightRig, NearLights

log = logging.getLogger(__name__)

T = TypeVar("T", bound=np.floating[Any])

# A mesh that covers a smaller share of the mask probably does not belong to the photo.
MIN_KNOWN = 0.8
# An object that is nearer or farther than the lights' target by this factor is probably in another unit.
MAX_OFF = 2.0
# Below this angle in radians between two channels, as vectors over all pixels, they show the same light.
ALIKE = 0.03
# Below this share of the brightest channel's mean, a channel's light was probably off.
BLACK = 0.01
# Pixels by which a mesh's depth is extended beyond the mesh.
DEPTH_MARGIN = 32


@dataclass(frozen=True, eq=False)
class Capture:
    """One photo under three lights at once, optionally with a second one under white light.

    Parameters
    ----------
    image : (H, W, 3) float32 or float16
        Linear; the channels are the camera's R, G, B. float16 is kept, other types become float32.
    mask : (H, W) bool
        The pixels of the object. Floating-point values, such as alpha, are thresholded at 0.5.
    rig
        The lights, in camera space.
    camera
        Projection and pose, if known.
    clip
        Linear value at which a channel saturates. Infinity for renders, and if `clipped` is given.
    depth : (H, W) float32
        Distance of each pixel's surface in front of the camera, along its axis, in the unit of the camera's pose.
        Required if the rig's lights are near.
    clipped : (H, W, 3) bool
        Where a channel is saturated; None if `clip` decides it.
    white : (H, W, 3) float32
        Linear RGB of the same pose under white light. Values outside the mask that are not finite become zero. Clipped
        pixels keep their value, a lower bound.
    white_clipped : (H, W, 3) bool
        Where a channel of `white` is saturated; None if nowhere.
    white_light : (3,) float64
        Unit vector from the surface to the one lamp that lit `white`; None if the rig's three lights, turned white,
        lit it.

    Raises
    ------
    GeometryError
        If shapes differ, the mask is empty, the photo is black inside it, near lights lack camera or depth, or the
        white photo's lamp is behind the object.
    FormatError
        If an image does not have three channels, or is not finite inside the mask.

    Examples
    --------
    >>> import numpy as np
    >>> from mpsnet_core import Capture, published_rig
    >>> capture = Capture(np.full((2, 3, 3), 0.5), np.ones((2, 3), bool), published_rig(), clip=1.0)
    >>> capture.image.dtype, bool(capture.saturated.any())
    (dtype('float32'), False)
    """

    image: NDArray[np.floating[Any]]
    mask: NDArray[np.bool_]
    rig: LightRig
    camera: Camera | None = None
    clip: float = np.inf
    depth: NDArray[np.float32] | None = None
    clipped: NDArray[np.bool_] | None = None
    white: NDArray[np.float32] | None = None
    white_clipped: NDArray[np.bool_] | None = None
    white_light: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        image, mask = np.asarray(self.image), np.asarray(self.mask)
        mask = mask > 0.5 if mask.dtype.kind == "f" else mask.astype(bool, copy=False)
        if image.dtype != np.float16:
            image = image.astype(np.float32, copy=False)
        if image.ndim != 3 or image.shape[2] != 3:
            raise FormatError(f"a photo has three channels a pixel; this one has shape {image.shape}")
        self._check_sizes(mask.shape, image.shape)
        if not mask.any():
            raise NoObject("the mask is empty: no pixel of the object is marked; choose another mask or threshold")
        if self.clipped is not None:
            object.__setattr__(self, "clipped", np.asarray(self.clipped, bool))
            check_same_size("what is clipped", self.clipped.shape, "the photo", image.shape)
        image = _finite_and_lit(image, mask, "photo", "were the lights on, and is it the right mask?")
        if self.rig.near is not None and (self.camera is None or self.depth is None):
            raise GeometryError(
                "the rig's lights stand near the object, so its distance counts: give the camera, and the object's "
                "mesh or distance"
            )
        if self.depth is not None:
            depth = np.asarray(self.depth, np.float32)
            if not (np.isfinite(depth) & (depth > 0)).all(where=mask):
                raise GeometryError(
                    "the object's depth is not above 0 everywhere inside the mask; check camera and mesh"
                )
            object.__setattr__(self, "depth", depth)
        if self.white is not None:
            if self.white_clipped is not None:
                object.__setattr__(self, "white_clipped", np.asarray(self.white_clipped, bool))
            object.__setattr__(self, "white", _checked_white(self.white, self.white_clipped, mask))
        if self.white_light is not None:
            object.__setattr__(self, "white_light", _towards_lamp(self.white_light))
        object.__setattr__(self, "image", image)
        object.__setattr__(self, "mask", mask)

    def _check_sizes(self, mask: tuple[int, ...], photo: tuple[int, ...]) -> None:
        parts = {
            "the mask": mask,
            "the camera": None if self.camera is None else (self.camera.height, self.camera.width),
            "the depth": None if self.depth is None else np.shape(self.depth),
        }
        for name, shape in parts.items():
            if shape is not None:
                check_same_size(name, shape, "the photo", photo[:2])

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """(H, W, 3) whether a channel is saturated."""
        return self.saturated_in(slice(None))

    @property
    def saturated_lights(self) -> NDArray[np.bool_]:
        """(H, W, 3) whether saturation affects a light after unmixing. Read-only."""
        saturated = self.saturated
        if np.array_equal(self.rig.mixing, np.eye(3)):
            return saturated
        # Unmixing computes each light from all channels, so one saturated channel affects all three.
        return np.broadcast_to(saturated.any(axis=-1, keepdims=True), saturated.shape)

    def saturated_in(self, rows: slice) -> NDArray[np.bool_]:
        """(h, W, 3) whether a channel is saturated, for some rows."""
        return self.image[rows] >= SATURATED_SHARE * self.clip if self.clipped is None else self.clipped[rows]


def finite_inside(image: NDArray[T], mask: NDArray[np.bool_], name: str) -> NDArray[T]:
    """The image (H, W, 3) with zeros in place of values that are not finite; unchanged if there are none.

    Raises FormatError if such a value is inside the mask.
    """
    result = image
    for channel in range(3):  # one at a time to save memory
        finite = np.isfinite(image[..., channel])
        if not finite.all(where=mask):
            row, column = np.argwhere(~finite & mask)[0]
            raise FormatError(
                f"the {name} holds values that are not finite inside the mask, the first at x {column}, y {row}; "
                "export it again, or leave them out of the mask"
            )
        if not finite.all():
            result = image.copy() if result is image else result
            result[..., channel][~finite] = 0
    return result


def _finite_and_lit(image: NDArray[T], mask: NDArray[np.bool_], name: str, black: str) -> NDArray[T]:
    """As :func:`finite_inside`. Raises GeometryError, with the question `black`, if the image is black in the mask."""
    result = finite_inside(image, mask, name)
    if not any((result[..., channel] > 0).any(where=mask) for channel in range(3)):
        raise GeometryError(f"the {name} is black inside the mask; {black}")
    return result


def _checked_white(
    white: NDArray[np.float32], clipped: NDArray[np.bool_] | None, mask: NDArray[np.bool_]
) -> NDArray[np.float32]:
    white = np.asarray(white, np.float32)
    if white.ndim != 3 or white.shape[2] != 3:
        raise FormatError(f"a white photo has three channels a pixel; this one has shape {white.shape}")
    check_same_size("the white photo", white.shape[:2], "the photo", mask.shape, SAME_CAMERA)
    white = _finite_and_lit(white, mask, "white photo", "was the light on, and is it of the same pose?")
    if clipped is not None:
        check_same_size("what is clipped in the white photo", clipped.shape, "the white photo", white.shape)
    return white


def _towards_lamp(direction: ArrayLike) -> NDArray[np.float64]:
    towards = np.asarray(direction, np.float64)
    if towards.shape != (3,) or not np.isfinite(towards).all() or towards[2] <= 0:
        raise GeometryError(
            f"the white light is not in front of the object ({direction!r}); give where it was, z above 0"
        )
    return np.asarray(towards / np.linalg.norm(towards))


def read_capture(
    path: str | os.PathLike[str],
    rig: LightRig,
    *,
    mask: str | os.PathLike[str] = MASK,
    encoding: Encoding = "auto",
    layer: str | None = None,
    camera: Camera | float | None = None,
    depth: NDArray[np.float32] | float | None = None,
    correction: Correction | None = None,
    white: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | None = None,
    white_light: ArrayLike | None = None,
) -> Capture:
    """Read a photo as a capture.

    Parameters
    ----------
    path : str or path
        The photo.
    rig : LightRig
        The lights, in camera space.
    mask : str or path
        A mask file, or a keyword of :func:`find_mask`. By default the photo's alpha if it has any, else the object that
        stands out clearly from its background, else the whole photo.
    encoding, layer : str, optional
        As in :func:`read_image`, with one exception: if neither `encoding` nor the file states the encoding, and the
        shading shows that values are linear (:mod:`mpsnet_core.capture.transfer_curve`), they are read as linear.
    camera : Camera or float, optional
        The camera, or the focal length of its lens in mm on a sensor 36 mm wide.
    depth : (H, W) array or float, optional
        Distance of the surface in front of the camera, infinity where unknown. By default that of the lights' target.
    correction : Correction, optional
        Dark frame and flat field, also applied to the white photo.
    white : str, path or sequence of them, optional
        A photo of the same pose under white light, or several to add up, one for each light turned white.
    white_light : (3,) array, optional
        Direction from the surface to the one lamp that lit the white photo, in camera space. By default the rig's
        lights, turned white, lit it.

    Raises
    ------
    InputError
        If a file is missing or damaged, or photo, mask, camera, depth and white photo do not match.
    """
    reading = Reading(encoding, layer, correction)
    image = reading.photo(path, compact=correction is None)

    def taken(image: Image, notes: Notes = "all") -> Capture:
        with prefix_errors(path):
            return capture_from(image, rig, mask=mask, reading=reading, camera=camera, depth=depth, notes=notes)

    capture = taken(image)
    if correction is not None:  # the correction was read as sRGB, so the photo stays sRGB
        warn_of_doubtful_curve(Path(path).name, image, capture.mask, rig)
    elif is_taken_as_linear(Path(path).name, image, capture.mask, rig):
        reading, image = replace(reading, encoding="linear"), with_stored_values(image)
        # A mask found by brightness depends on the curve: find it again, but report it once. Any other mask stays.
        capture = taken(image, "none") if follows_values(mask, image) else replace(capture, image=image.pixels)
    if white is not None:
        several = [white] if isinstance(white, str | os.PathLike) else white
        if any(resolved(file) == resolved(path) for file in several):
            raise _white_is_the_photo(path)
        capture = with_white(capture, several, reading, light=white_light)
    warn_of_doubts(capture)
    return capture


def with_white(
    capture: Capture,
    photos: Sequence[str | os.PathLike[str]],
    reading: Reading,
    *,
    light: ArrayLike | None = None,
    straightened: Callable[[Image], Image] = lambda image: image,
) -> Capture:
    """The capture with the sum of `photos` as its white photo.

    reading: as for the photo. light: direction to the one lamp that lit them, None for the rig's lights. straightened:
    removes lens distortion from an image, if it was removed from the photo.

    Raises InputError if one cannot be read, is the photo itself, or does not match it.
    """
    total, clipped = np.zeros(capture.image.shape, np.float32), np.zeros(capture.image.shape, bool)
    for file in expand_images(photos):
        image = reading.companion(file)
        with prefix_errors(file):
            image = straightened(corrected(image, reading.correction))
            # Checked one by one, to name the one that does not match.
            total += _checked_white(image.pixels, None, capture.mask)
        clipped |= image.saturated
    if np.array_equal(total.astype(capture.image.dtype), capture.image):
        raise _white_is_the_photo(photos[0])
    lamp = None if light is None else np.asarray(light, np.float64)
    return replace(capture, white=total, white_clipped=clipped if clipped.any() else None, white_light=lamp)


def _white_is_the_photo(path: str | os.PathLike[str]) -> SettingsError:
    return SettingsError(f"{path}: the white photo is the photo itself; give the one under white light")


def capture_from(
    image: Image,
    rig: LightRig,
    *,
    mask: str | os.PathLike[str] = MASK,
    reading: Reading = AS_STATED,
    camera: Camera | float | None = None,
    depth: NDArray[np.float32] | float | None = None,
    notes: Notes = "all",
) -> Capture:
    """A capture from an image in memory, such as a video frame. Other parameters as in :func:`read_capture`.

    notes: what to log about a mask that is found, see :func:`find_mask`.

    Raises InputError if the mask cannot be read, or image, mask, camera and depth do not match.
    """
    image, inside = corrected_and_masked(image, rig, mask, reading, notes)
    height, width, _ = image.pixels.shape
    if camera is not None and not isinstance(camera, Camera):
        camera = camera_of_lens(camera, width, height)
    return capture_of(image, inside, rig, camera, depth)


def corrected_and_masked(
    image: Image,
    rig: LightRig,
    mask: str | os.PathLike[str],
    reading: Reading,
    notes: Notes = "all",
) -> tuple[Image, NDArray[np.bool_]]:
    """The corrected image and its mask (H, W). Parameters as in :func:`capture_from`."""
    correction = reading.correction
    if rig.near is not None and correction is not None and correction.gain is not None:
        raise SettingsError(
            "the rig's lights stand near the object, and their fall-off is in the flat field too; leave the flat field "
            "out, or give the lights as directions"
        )
    image = corrected(image, correction)
    return image, find_mask(image, mask, **vars(reading), notes=notes)


def capture_of(
    image: Image,
    mask: NDArray[np.bool_],
    rig: LightRig,
    camera: Camera | None,
    depth: NDArray[np.float32] | float | None,
) -> Capture:
    """A capture from the result of :func:`corrected_and_masked`. depth: as in :func:`read_capture`."""
    inside = _depth_within(mask, depth, rig) if mask.any() else None  # Capture rejects an empty mask
    return Capture(image.pixels, mask, rig, camera, image.clip, inside, image.clipped)


def _depth_within(
    mask: NDArray[np.bool_], depth: NDArray[np.float32] | float | None, rig: LightRig
) -> NDArray[np.float32] | None:
    """(H, W) depth at every pixel of the mask, with unknown depth filled in; None for distant lights."""
    if rig.near is None:
        if depth is not None:
            log.info("the rig's lights are distant, so the object's distance is not used")
        return None
    if depth is None:
        depth = -float(rig.near.target[2])
        log.info("the object is assumed flat, %.4g in front of the camera as the lights' target is", depth)
    if not isinstance(depth, np.ndarray):
        if not (np.isfinite(depth) and depth > 0):
            raise SettingsError(f"the object's distance is a number above 0, not {depth:g}")
        _log_assumed_unit(depth, rig.near)
        return np.full(mask.shape, depth, np.float32)
    check_same_size("the camera", depth.shape, "the photo", mask.shape)
    known = np.isfinite(depth)
    inside = np.count_nonzero(known & mask)
    if not inside:
        raise GeometryError("the camera sees nothing of the mesh inside the mask; check that they belong to one photo")
    if inside < MIN_KNOWN * mask.sum():
        log.info(
            "the mesh covers %.0f%% of the mask: do camera, mesh and mask belong to this photo?",
            100 * inside / mask.sum(),
        )
    _log_assumed_unit(float(np.median(depth[known & mask])), rig.near)
    # Close to the mesh use the depth of its nearest pixel, far from it the mean.
    filled = np.where(known, depth, depth[known & mask].mean())[..., None]
    return extend_to_nearest(filled, known, DEPTH_MARGIN)[..., 0]


def _log_assumed_unit(distance: float, near: NearLights) -> None:
    """Report an object far from the lights' target: its distance is probably in another unit."""
    expected = -float(near.target[2])
    if not expected / MAX_OFF < distance < expected * MAX_OFF:
        log.info(
            "the object is %.3g away, but the lights' target %.3g: are camera, mesh and rig in one unit?",
            distance,
            expected,
        )


def channel_angles(
    means: NDArray[np.float64], products: NDArray[np.float64], pixels: int
) -> NDArray[np.float64] | None:
    """(3,) angles in radians between the channels red and green, red and blue, green and blue as vectors over pixels.

    None if the whole object faces one way, unless the channels are equal: a flat object's channels are alike under any
    lights. means: (3,) of the pixels. products: (3, 3) sums over pixels of products of two channels.
    """
    sizes = np.sqrt(np.diag(products))
    varied = sizes**2 / pixels > 1.01 * means**2
    if np.ptp(means) > 1e-3 * means.max() and not varied[means > 0].all():
        return None
    cosines = products / np.maximum(np.outer(sizes, sizes), 1e-30)
    return np.asarray(np.arccos(np.clip(cosines[[0, 0, 1], [1, 2, 2]], -1, 1)))


def warn_of_doubts(capture: Capture, name: str = "", *, rig_checked: bool = False) -> None:
    """Report photos whose normals are probably wrong.

    name: of the photo, if there are several. rig_checked: whether another photo showed whether the rig fits.
    """
    which = f"{name}: " if name else ""
    spoilt = 0
    total, products = np.zeros(3), np.zeros((3, 3))
    for rows in bands(len(capture.mask)):
        mask = capture.mask[rows]
        inside = capture.image[rows][mask]
        if len(inside):
            spoilt += int(capture.saturated_in(rows)[mask].any(axis=1).sum())
            total += inside.sum(axis=0, dtype=np.float64)
            products += inside.T.astype(np.float64) @ inside
    pixels = int(capture.mask.sum())
    means = total / pixels
    angles = channel_angles(means, products, pixels)
    if angles is not None and angles.max() <= ALIKE:
        log.warning(
            "%sthe photo's three channels are nearly the same: it looks like a photo under white light, which "
            "does not show normals; if you have three photos, each under one white light, combine them with "
            "mpsnet superpose --channels [channels-alike]",
            which,
        )
    for channel, mean in zip(CHANNELS, means, strict=True):
        if mean < BLACK * means.max():
            log.warning("%sthe %s channel is black: was its light on? [black-channel]", which, channel)
    if spoilt > 0.05 * pixels:
        share = 100 * spoilt / pixels
        log.info(
            "%s%.0f%% of the object's pixels are saturated and therefore wrong; use a shorter exposure [clipped-photo]",
            which,
            share,
        )
    if capture.white_clipped is not None:
        spoilt = int(capture.white_clipped[capture.mask].any(axis=1).sum())
        if spoilt > 0.05 * pixels:
            log.info(
                "%s%.0f%% of the white photo's pixels are saturated; use a shorter exposure",
                which,
                100 * spoilt / pixels,
            )
    if not rig_checked:
        warn_of_wrong_rig(capture.image, capture.mask, capture.rig, which)
    # A white photo removes the object's colour and the lights' relative strengths.
    alone = capture.white is None and np.array_equal(capture.rig.mixing, np.eye(3))
    if alone and means.min() > 0 and means.max() > 1.5 * means.min():
        log.info(
            "%sone channel is %.1f times as bright as another: the object is coloured or the lights are unequal; the "
            "default model allows for it, equation 2 (lambertian) and mpsnet only with the mixing in the rig",
            which,
            means.max() / means.min(),
        )
