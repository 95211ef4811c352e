"""Capture: the one photo as linear values, with its mask, rig and camera."""

import logging
import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.bands import bands
from mpsnet_core.camera import Camera, camera_of_lens
from mpsnet_core.errors import InputError
from mpsnet_core.images import Encoding, Image, read_image, read_mask
from mpsnet_core.rig import LightRig
from mpsnet_core.surface.raster import grown

log = logging.getLogger(__name__)

# Above this share of the clip value a channel counts as saturated: an 8-bit sRGB 254 is linear 0.991.
SATURATED_SHARE = 0.99

# A mesh that covers less of the mask than this hardly belongs to the photo.
LEAST_KNOWN = 0.8
# Pixels by which a mesh's depth is continued where the mask is larger than the mesh.
DEPTH_MARGIN = 32


@dataclass(frozen=True)
class Capture:
    """One photo under three lights at once.

    image: (H, W, 3) float32, linear; channel i is camera channel R, G, B.
    mask: (H, W) bool, the pixels of the object.
    rig: the lights, in camera space.
    camera: its projection and pose, where known.
    clip: linear value at which a channel saturates; infinity for renders.
    depth: (H, W) how far in front of the camera, along its axis, each pixel's surface is, in the unit of the camera's
        pose; needed where the rig's lights are near.

    Raises InputError where the shapes do not agree, the mask is empty, a value is not finite or the depth is lacking.
    """

    image: NDArray[np.float32]
    mask: NDArray[np.bool_]
    rig: LightRig
    camera: Camera | None = None
    clip: float = np.inf
    depth: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        image, mask = np.asarray(self.image, np.float32), np.asarray(self.mask, bool)
        if image.ndim != 3 or image.shape[2] != 3:
            raise InputError(f"a photo has three channels a pixel; this one has shape {image.shape}")
        if mask.shape != image.shape[:2]:
            raise InputError(f"the mask is {_size(mask)} but the photo is {_size(image)}; they must be the same size")
        if not mask.any():
            raise InputError("the mask is empty: no pixel of the object is marked; choose another mask or threshold")
        finite = np.isfinite(image)
        if not finite.all(where=mask[..., None]):
            raise InputError("the photo holds values that are not finite inside the mask; export it again")
        if not (image > 0).any(where=mask[..., None]):
            raise InputError("the photo is black inside the mask; were the lights on, and is it the right mask?")
        if self.camera is not None and (self.camera.height, self.camera.width) != mask.shape:
            raise InputError(
                f"the camera is {self.camera.width} x {self.camera.height} but the photo is {_size(image)}; "
                "they must be the same size"
            )
        if self.rig.near is not None and (self.camera is None or self.depth is None):
            raise InputError(
                "the rig's lights stand near the object, so its distance counts: give the camera, and the object's "
                "mesh or distance"
            )
        if self.depth is not None:
            depth = np.asarray(self.depth, np.float32)
            if depth.shape != mask.shape:
                raise InputError(
                    f"the depth is {_size(depth)} but the photo is {_size(image)}; they must be the same size"
                )
            if not (np.isfinite(depth) & (depth > 0)).all(where=mask):
                raise InputError("the object's depth is not above 0 everywhere inside the mask; check camera and mesh")
            object.__setattr__(self, "depth", depth)
        # Outside the mask nothing counts; inside, everything is finite.
        object.__setattr__(self, "image", np.where(finite, image, np.float32(0)))
        object.__setattr__(self, "mask", mask)

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """(H, W, 3) where a channel is at its end, and so wrong."""
        return self.image >= SATURATED_SHARE * self.clip


def _size(array: NDArray[np.generic]) -> str:
    return f"{array.shape[1]} x {array.shape[0]}"


def read_capture(
    path: str | os.PathLike[str],
    rig: LightRig,
    *,
    mask: str | os.PathLike[str] | None = None,
    encoding: Encoding = "auto",
    layer: str | None = None,
    camera: Camera | float | None = None,
    depth: NDArray[np.float32] | float | None = None,
) -> Capture:
    """Read a photo as a capture.

    mask: a mask file, or "alpha", "none" (the whole photo), or "threshold:T" (pixels whose brightest channel is
        above T times the photo's 99.9th percentile). Unless given: alpha where the photo has it, else the whole photo.
    encoding, layer: as in :func:`mpsnet_core.images.read_image`.
    camera: or the focal length of its lens in millimetres, see :func:`mpsnet_core.camera.camera_of_lens`.
    depth: (H, W) how far in front of the camera the surface is, with infinity where that is not known (see
        :func:`mpsnet_core.surface.depth.depth_of_mesh`), or one distance for all. Under near lights, unless given, that
        of the lights' target.

    Raises InputError where a file is missing or broken, or photo, mask, camera and depth do not fit each other.
    """
    image = read_image(path, encoding=encoding, layer=layer)
    try:
        height, width, _ = image.pixels.shape
        if camera is not None and not isinstance(camera, Camera):
            camera = camera_of_lens(camera, width, height)
        inside = _mask(image, mask)
        distances = _depth(depth, rig, inside)
        capture = Capture(image.pixels, inside, rig, camera, image.clip, distances)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    _note_doubts(capture)
    return capture


def _depth(
    depth: NDArray[np.float32] | float | None, rig: LightRig, mask: NDArray[np.bool_]
) -> NDArray[np.float32] | None:
    """(H, W) a depth for every pixel of the mask, None where it does not count."""
    if rig.near is None:
        if depth is not None:
            log.info("the rig's lights are distant, so how far the object is does not count")
        return None
    if depth is None:
        depth = -float(rig.near.target[2])
        log.info("the object is taken as flat, %.4g in front of the camera as the lights' target is", depth)
    if not isinstance(depth, np.ndarray):
        return np.full(mask.shape, depth, np.float32)
    if depth.shape != mask.shape:
        raise InputError(f"the camera is {_size(depth)} but the photo is {_size(mask)}; they must be the same size")
    known = np.isfinite(depth)
    inside = np.count_nonzero(known & mask)
    if not inside:
        raise InputError("the camera sees nothing of the mesh inside the mask; check that they belong to one photo")
    if inside < LEAST_KNOWN * mask.sum():
        log.info(
            "the mesh covers %.0f%% of the mask: do camera, mesh and mask belong to this photo?",
            100 * inside / mask.sum(),
        )
    # Beside the mesh, its nearest pixel's depth, and far from it the mean.
    filled = np.where(known, depth, depth[known & mask].mean())[..., None]
    return grown(filled, known, DEPTH_MARGIN)[..., 0]


def _note_doubts(capture: Capture) -> None:
    """Tell of photos that normals can be estimated from, but hardly right ones."""
    spread = brightest = saturated = 0.0
    total = np.zeros(3)
    for rows in bands(len(capture.mask)):
        inside = capture.image[rows][capture.mask[rows]]
        if len(inside):
            spread, brightest = max(spread, float(np.ptp(inside, axis=1).max())), max(brightest, float(inside.max()))
            saturated += int((inside >= SATURATED_SHARE * capture.clip).any(axis=1).sum())
            total += inside.sum(axis=0, dtype=np.float64)
    pixels = int(capture.mask.sum())
    if spread <= 1e-3 * brightest:
        log.info("the photo's three channels are the same: was it lit by red, green and blue light?")
    if saturated > 0.05 * pixels:
        log.info("%.0f%% of the object's pixels are saturated, and wrong; expose shorter", 100 * saturated / pixels)
    means = total / pixels
    if np.array_equal(capture.rig.mixing, np.eye(3)) and means.min() > 0 and means.max() > 1.5 * means.min():
        log.info(
            "one channel is %.1f times as bright as another: the object is coloured or the lights are unequal, which "
            "misleads the models lambertian and mpsnet unless the mixing is in the rig; multiscale allows for it",
            means.max() / means.min(),
        )


def _mask(image: Image, mask: str | os.PathLike[str] | None) -> NDArray[np.bool_]:
    choice = "" if mask is None else os.fspath(mask)
    if choice == "none" or (not choice and image.alpha is None):
        if not choice:
            log.warning("no mask and no alpha: the whole photo is taken as the object")
        return np.ones(image.pixels.shape[:2], bool)
    if choice in ("", "alpha"):
        if image.alpha is None:
            raise InputError("the photo has no alpha channel to take the mask from; give a mask file or a threshold")
        return image.alpha > 0.5
    if choice.startswith("threshold:"):
        return threshold_mask(image.pixels, choice.partition(":")[2])
    return read_mask(choice)


def threshold_mask(pixels: NDArray[np.float32], threshold: str | float) -> NDArray[np.bool_]:
    """(H, W) bool: where the brightest channel is above `threshold` (0 to 1) times its 99.9th percentile."""
    try:
        level = float(threshold)
    except ValueError:
        level = -1.0
    if not 0 <= level < 1:
        raise InputError(f"a mask threshold is a number from 0 up to 1, not {threshold!r}; 0.05 is a good start")
    brightest = np.nan_to_num(pixels.max(axis=-1), posinf=0.0)
    return brightest > level * np.percentile(brightest, 99.9)
