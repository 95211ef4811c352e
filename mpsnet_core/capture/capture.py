"""Captures: a photo in linear values with its mask, rig and camera, and optionally a white photo."""

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.arrays.resampling import block_means, sampled_rows
from mpsnet_core.arrays.sizes import SAME_CAMERA, check_same_size
from mpsnet_core.arrays.types import F32, F64, Bools, Floats
from mpsnet_core.errors import FormatError, GeometryError, NoObject, Note, SettingsError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image import CHANNELS, SATURATED_SHARE
from mpsnet_core.io.shown import Shown
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rig import LightRig, NearLights

# --- whether a white photo shows the same scene as its photo, by their edges, whatever lamp lit it --------------------
# Creases, outlines and borders of paint are steep in each of the photo's three lights, and in the white photo, at the
# same pixels. In a white photo of another object or pose they are elsewhere: it agrees no better with the photo than
# when it is shifted.


# The object's size, in pixels, to which both photos are reduced: noise averages out.
SIDE = 192
# The shift that edges are compared at, as a fraction of the object's size.
SHIFT = 0.05
# The photo's own lights must agree on edges by this much for its edges to tell anything; smooth objects' differ.
TELLING = 0.04
# A white photo that agrees with the photo less than this share of what the photo's lights agree does not fit.
# In right ones it is 1.2 to 7 times as much, in others 0.3 or less.
SHARE = 0.3
DARKEST = 0.03  # of the 99th percentile


def shows_another_scene(photo: Floats, white: Floats, mask: Bools) -> bool:
    """Whether a white photo (H, W, 3) has its edges elsewhere than the photo (H, W, 3); False where there are none."""
    box = bounding_box(mask)
    factor = max(1, round(np.sqrt(np.count_nonzero(mask)) / SIDE))
    inside = block_means(mask[box][..., None].astype(np.float32), factor)[..., 0] > 0.99
    shift = max(3, round(SHIFT * np.sqrt(np.count_nonzero(inside))))
    shifts = [(down, right) for down in (-shift, 0, shift) for right in (-shift, 0, shift)]
    inner = np.pad(inside, shift)
    inner = np.logical_and.reduce([np.roll(inner, by, (0, 1)) for by in shifts])[shift:-shift, shift:-shift]
    if np.count_nonzero(inner) < SIDE:
        return False
    lights = np.moveaxis(block_means(np.where(mask[box][..., None], photo[box], 0), factor), -1, 0)
    whole = block_means(np.where(mask[box][..., None], white[box], 0), factor).mean(axis=-1)
    *own, other = (_steepness(values, inside, inner) for values in (*lights, whole))

    def agreement(one: F64, two: F64) -> float:
        """How much better two pictures' edges correlate in place than shifted."""
        found = {by: float(np.corrcoef(one[inner], np.roll(two, by, (0, 1))[inner])[0, 1]) for by in shifts}
        return found.pop((0, 0)) - max(found.values())

    among = np.mean([agreement(own[one], own[two]) for one, two in ((0, 1), (0, 2), (1, 2))])
    return bool(among > TELLING and np.mean([agreement(one, other) for one in own]) < SHARE * among)


def _steepness(values: F32, inside: Bools, inner: Bools) -> F64:
    """(h, w) the slope of the logarithm, in which shading and paint add up; outliers are cut."""
    lowest = max(DARKEST * float(np.percentile(values[inside], 99)), 1e-12)
    slope = np.hypot(*np.gradient(np.log(np.maximum(values.astype(np.float64), lowest))))
    return np.asarray(np.minimum(slope, np.percentile(slope[inner], 99)))


log = logging.getLogger(__name__)
WARN, INFO = logging.WARNING, logging.INFO

T = TypeVar("T", bound=np.floating[Any])

# A mesh that covers a smaller share of the mask probably does not belong to the photo.
MIN_KNOWN = 0.8
# An object that is nearer or farther than the lights' target by this factor is probably in another unit.
MAX_OFF = 2.0
# Below this angle in radians between two channels, as vectors over all pixels, they show the same light.
ALIKE = 0.03
# The channels that each of three angles is between.
PAIRS = (("red", "green"), ("red", "blue"), ("green", "blue"))
# Below this share of the brightest channel's mean, a channel's light was probably off.
BLACK = 0.01
# An object of fewer pixels is hardly one.
FEW = 9
# About how many pixels of the object are looked at for doubts.
SAMPLED = 1 << 17
# Above this share of saturated pixels, there is a doubt.
SPOILT = 0.05
WHITE_MISFIT = Note(
    "the white photo does not fit the photo: is it of the same object and pose, and under the rig's three lights "
    "turned white? if one lamp lit it, say where that was (--white-light) [white-photo-misfit]"
)
# Pixels by which a mesh's depth is extended beyond the mesh.
DEPTH_MARGIN = 32


@takes_files
@dataclass(frozen=True, eq=False, repr=False)
class Capture(Shown):
    """One photo under three lights at once, optionally with a second one under white light.

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

    array_name: ClassVar[str] = "image"

    image: Floats
    """(H, W, 3) float32 or float16. The photo, linear; the channels are the camera's R, G, B. float16 is kept, other
    types become float32."""
    mask: Bools
    """(H, W) bool. The pixels of the object. Floating-point values, such as alpha, are thresholded at 0.5."""
    rig: LightRig
    """The lights, in camera space."""
    camera: Camera | None = None
    """Projection and pose, if known."""
    clip: float = np.inf
    """Linear value at which a channel saturates. Infinity for renders, and if `clipped` is given."""
    depth: F32 | None = None
    """(H, W) float32. Distance of each pixel's surface in front of the camera, along its axis, in the unit of the
    camera's pose. Required if the rig's lights are near."""
    clipped: Bools | None = None
    """(H, W, 3) bool. Where a channel is saturated; None if `clip` decides it."""
    white: F32 | None = None
    """(H, W, 3) float32. Linear RGB of the same pose under white light. Values outside the mask that are not finite
    become zero. Clipped pixels keep their value, a lower bound."""
    white_clipped: Bools | None = None
    """(H, W, 3) bool. Where a channel of `white` is saturated; None if nowhere."""
    white_light: F64 | None = None
    """(3,) float64. Unit vector from the surface to the one lamp that lit `white`; None if the rig's three lights,
    turned white, lit it."""

    def __post_init__(self) -> None:
        image, mask = np.asarray(self.image), np.asarray(self.mask)
        mask = mask > 0.5 if mask.dtype.kind == "f" else mask.astype(bool, copy=False)
        if image.dtype != np.float16:
            image = image.astype(np.float32, copy=False)
        if image.ndim != 3 or image.shape[2] != 3:
            raise FormatError(f"a photo has three channels per pixel; this one has shape {image.shape}")
        shapes = {
            "the mask": mask.shape,
            "the camera": None if self.camera is None else (self.camera.height, self.camera.width),
            "the depth": None if self.depth is None else np.shape(self.depth),
        }
        for name, shape in shapes.items():
            if shape is not None:
                check_same_size(name, shape, "the photo", image.shape[:2])
        if not mask.any():
            raise NoObject("the mask is empty: no pixel of the object is marked; choose another mask or threshold")
        if self.clipped is not None:
            object.__setattr__(self, "clipped", np.asarray(self.clipped, bool))
            check_same_size("what is clipped", self.clipped.shape, "the photo", image.shape)
        image = _finite_and_lit(image, mask, "photo", "were the lights on, and is it the right mask?")
        if self.rig.near is not None and (self.camera is None or self.depth is None):
            raise GeometryError("the rig's lights are near: give the camera, and the object's mesh or distance")
        if self.depth is not None:
            depth = np.asarray(self.depth, np.float32)
            if not (np.isfinite(depth) & (depth > 0)).all(where=mask):
                raise GeometryError("the object's depth is not above 0 everywhere in the mask; check camera and mesh")
            object.__setattr__(self, "depth", depth)
        if self.white is not None:
            if self.white_clipped is not None:
                object.__setattr__(self, "white_clipped", np.asarray(self.white_clipped, bool))
            object.__setattr__(self, "white", checked_white(self.white, self.white_clipped, mask))
        if self.white_light is not None:
            object.__setattr__(self, "white_light", _towards_lamp(self.white_light))
        object.__setattr__(self, "image", image)
        object.__setattr__(self, "mask", mask)

    def facts(self) -> str:
        extras = (("camera", self.camera), ("depth", self.depth), ("white photo", self.white))
        known = [name for name, value in extras if value is not None]
        return ", ".join([f"object of {self.mask.sum():,} pixels", *known])

    def picture(self, step: int = 1) -> F32:
        from mpsnet_core.scene.pictures import mask_bands

        return mask_bands(self.image[::step, ::step], self.mask[::step, ::step])(slice(None))

    @property
    def saturated(self) -> Bools:
        """(H, W, 3) whether a channel is saturated."""
        return self.saturated_in(slice(None))

    @property
    def saturated_lights(self) -> Bools:
        """(H, W, 3) whether saturation affects a light after unmixing. Read-only."""
        saturated = self.saturated_lights_in(slice(None))
        return saturated if saturated.any() else np.broadcast_to(False, saturated.shape)  # which takes no memory

    def saturated_lights_in(self, rows: slice) -> Bools:
        """(h, W, 3) whether saturation affects a light after unmixing, for some rows. Read-only."""
        saturated = self.saturated_in(rows)
        if np.array_equal(self.rig.mixing, np.eye(3)):
            return saturated
        # Unmixing computes each light from all channels, so one saturated channel affects all three.
        return np.broadcast_to(saturated.any(axis=-1, keepdims=True), saturated.shape)

    def saturated_in(self, rows: slice) -> Bools:
        """(h, W, 3) whether a channel is saturated, for some rows."""
        return self.image[rows] >= SATURATED_SHARE * self.clip if self.clipped is None else self.clipped[rows]


def finite_inside(image: NDArray[T], mask: Bools, name: str) -> NDArray[T]:
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


def _finite_and_lit(image: NDArray[T], mask: Bools, name: str, black: str) -> NDArray[T]:
    """As :func:`finite_inside`. Raises GeometryError, with the question `black`, if the image is black in the mask."""
    result = finite_inside(image, mask, name)
    if not any((result[..., channel] > 0).any(where=mask) for channel in range(3)):
        raise GeometryError(f"the {name} is black inside the mask; {black}")
    return result


def checked_white(white: F32, clipped: Bools | None, mask: Bools) -> F32:
    white = np.asarray(white, np.float32)
    if white.ndim != 3 or white.shape[2] != 3:
        raise FormatError(f"a white photo has three channels per pixel; this one has shape {white.shape}")
    check_same_size("the white photo", white.shape[:2], "the photo", mask.shape, SAME_CAMERA)
    white = _finite_and_lit(white, mask, "white photo", "was the light on, and is it of the same pose?")
    if clipped is not None:
        check_same_size("what is clipped in the white photo", clipped.shape, "the white photo", white.shape)
    return white


def _towards_lamp(direction: ArrayLike) -> F64:
    towards = np.asarray(direction, np.float64)
    if towards.shape != (3,) or not np.isfinite(towards).all() or towards[2] <= 0:
        raise GeometryError(f"the white light is not in front of the object ({direction!r}); its z must be above 0")
    return np.asarray(towards / np.linalg.norm(towards))


def depth_within(mask: Bools, depth: F32 | float | None, rig: LightRig) -> F32 | None:
    """(H, W) depth at every pixel of the mask, with unknown depth filled in; None for distant lights.

    depth: as in :func:`mpsnet_core.read_capture`. Raises InputError if it does not fit the mask.
    """
    if rig.near is None:
        if depth is not None:
            log.info("the rig's lights are distant, so the object's distance is not used")
        return None
    if depth is None:
        depth = -float(rig.near.target[2])
        log.info("the object is assumed to be flat and %.4g in front of the camera, like the lights' target", depth)
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
        share = 100 * inside / mask.sum()
        log.warning("the mesh covers %.0f%% of the mask: do camera, mesh and mask belong to this photo?", share)
    _log_assumed_unit(float(np.median(depth[known & mask])), rig.near)
    # Close to the mesh use the depth of its nearest pixel, far from it the mean.
    filled = np.where(known, depth, depth[known & mask].mean())[..., None]
    return extend_to_nearest(filled, known, DEPTH_MARGIN)[..., 0]


def _log_assumed_unit(distance: float, near: NearLights) -> None:
    """Report an object far from the lights' target: its distance is probably in another unit."""
    expected = -float(near.target[2])
    if not expected / MAX_OFF < distance < expected * MAX_OFF:
        words = "the object is %.3g away, but the lights' target %.3g: are camera, mesh and rig in the same unit?"
        log.warning(words, distance, expected)


def channel_angles(values: F64) -> F64 | None:
    """(3,) angles in radians between the channels red and green, red and blue, green and blue as vectors over pixels.

    values: (N, 3). None if the whole object faces one way, unless the channels are equal: a flat object's channels are
    alike under any lights.
    """
    means, products, pixels = values.mean(axis=0), values.T @ values, len(values)
    sizes = np.sqrt(np.diag(products))
    varied = sizes**2 / pixels > 1.01 * means**2
    if np.ptp(means) > 1e-3 * means.max() and not varied[means > 0].all():
        return None
    cosines = products / np.maximum(np.outer(sizes, sizes), 1e-30)
    return np.asarray(np.arccos(np.clip(cosines[[0, 0, 1], [1, 2, 2]], -1, 1)))


def doubts(capture: Capture) -> Iterator[tuple[int, str, Note]]:
    """What makes a photo's normals probably wrong: the level to log each doubt at, its kind, and the words."""
    sampled = [*sampled_rows(capture.mask, SAMPLED)]
    inside = np.concatenate([capture.image[rows][mask] for rows, mask in sampled]).astype(np.float64)
    spoilt = np.concatenate([capture.saturated_in(rows)[mask].any(axis=1) for rows, mask in sampled]).mean()
    pixels, means, angles = int(capture.mask.sum()), inside.mean(axis=0), channel_angles(inside)
    if pixels < FEW:
        yield WARN, "few", Note("the object has %d pixel(s), too few for a surface: is it the right file?", pixels)
    if angles is not None and angles.max() <= ALIKE:
        yield (
            WARN,
            "alike",
            Note(
                "the photo's three channels are nearly the same: it looks like a photo under white light, which does "
                "not show normals; if you have three photos, each under one white light, combine them with mpsnet "
                "superpose --channels [channels-alike]"
            ),
        )
    elif angles is not None and angles.min() <= ALIKE:
        words = (
            "the %s and the %s channel show nearly the same light; check the lights' colours, and that all three are "
            "on [channels-alike]"
        )
        yield WARN, "alike", Note(words, *PAIRS[int(angles.argmin())])
    for channel, mean in zip(CHANNELS, means, strict=True):
        if mean < BLACK * means.max():
            yield WARN, channel, Note("the %s channel is black: was its light on? [black-channel]", channel)
    if spoilt > SPOILT:
        words = (
            "%.0f%% of the object's pixels are saturated and therefore wrong; use a shorter exposure [clipped-photo]"
        )
        yield WARN, "clipped", Note(words, 100 * spoilt)
    if capture.white is not None and shows_another_scene(capture.image, capture.white, capture.mask):
        yield WARN, "white misfit", WHITE_MISFIT
    if capture.white_clipped is not None:
        share = capture.white_clipped[capture.mask].any(axis=1).mean()
        if share > SPOILT:
            words = "%.0f%% of the white photo's pixels are saturated; use a shorter exposure"
            yield WARN, "clipped white", Note(words, 100 * share)
    # A white photo removes the object's colour and the lights' relative strengths.
    alone = capture.white is None and np.array_equal(capture.rig.mixing, np.eye(3))
    if alone and means.min() > 0 and means.max() > 1.5 * means.min():
        words = (
            "one channel is %.1f times as bright as another: the object is coloured or the lights are unequal; the "
            "default model allows for it, equation 2 (lambertian) and mpsnet only with the mixing in the rig"
        )
        yield INFO, "unequal", Note(words, means.max() / means.min())
