"""From photo files to balls and highlights, one photo in memory at a time."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.sizes import check_same_size, size
from mpsnet_core.calibrate.ball import Ball, Circle, ball_from_circle, ball_from_mask
from mpsnet_core.calibrate.circles import find_balls
from mpsnet_core.calibrate.highlights import Highlight, find_coloured_highlights, find_highlight
from mpsnet_core.calibrate.lights import Sighting
from mpsnet_core.capture.correction import corrected
from mpsnet_core.capture.decode import AS_STATED, PhotoReadOptions
from mpsnet_core.capture.open import PhotoSet
from mpsnet_core.capture.sources import Source
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.files import prefix_errors
from mpsnet_core.io.image import CHANNELS, Image, in_frame_of
from mpsnet_core.io.image_reading import read_mask
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.camera import Camera, camera_for, pixel_camera
from mpsnet_core.scene.rig import LightRig


@dataclass(frozen=True)
class BallPhotos:
    """Photos of a ball and how to read them.

    Attributes
    ----------
    files
        Photos of the ball at one place: one under all lights, or one for each light alone.
    circles
        Outlines of the balls, drawn by hand.
    mask
        Mask file of the ball. Without circles and mask the balls are detected.
    balls, radius
        Number of balls, and their radius in the desired unit of positions.
    camera
        A camera, the focal length of its lens in mm (:func:`camera_of_lens`), or None for a distant camera.
    options
        How to read the photos.
    mirror
        Whether the ball is a mirror; if not, it is matt.
    """

    files: Sequence[Path]
    circles: Sequence[Circle] = ()
    mask: Path | None = None
    balls: int = 1
    radius: float = 1.0
    camera: Camera | float | None = None
    options: PhotoReadOptions = AS_STATED
    mirror: bool = True

    _frame: list[Image] = field(default_factory=list, init=False, repr=False)  # what states how the first was turned

    def read(self, file: Path) -> Image:
        """Read one of the photos, the first one first, whose frame the others share: the camera stood still."""
        return corrected(self.as_read(file), self.options.correction)

    def as_read(self, file: Path) -> Image:
        """As :meth:`read`, without correction. Photos of one light each may have one channel."""
        image = self.options.photo(file, grey=len(self.files) > 1)
        if not self._frame:
            empty = np.broadcast_to(np.float32(0), image.pixels.shape)
            self._frame.append(replace(image, pixels=empty, alpha=None, clipped=None))
        return in_frame_of(image, file, self._frame[0], self.files[0])


def read_lit(photos: BallPhotos, rig: LightRig) -> list[Image]:
    """The photos of a matt surface under a known rig, one or one for each light; all of them are held in memory.

    Its shading tells whether files that do not state their encoding are linear. Raises InputError if a file cannot be
    read, or the surface is not found.
    """
    images = [*map(photos.as_read, photos.files)]
    together = images[0]
    if len(images) == len(CHANNELS):  # each shows its own light in its own channel
        for file, image in zip(photos.files, images, strict=True):
            check_same_size(str(file), image.pixels.shape, str(photos.files[0]), together.pixels.shape)
        assumed = together.assumed if len({image.assumed for image in images}) == 1 else None
        pixels = np.stack([image.pixels[..., light] for light, image in enumerate(images)], axis=-1)
        together = replace(together, pixels=pixels, assumed=assumed)
    if together.assumed:
        source = Source(lambda: together, rig, partial(lit_surface, photos), photos.files[0].name)
        decided = PhotoSet([source], photos.options)
        decided.masked(source)
        images = [*map(replace(photos, options=decided.options).as_read, photos.files)]
    images = [corrected(image, photos.options.correction) for image in images]
    if len(images) == len(CHANNELS) and all(not np.ptp(image.pixels, axis=-1).any() for image in images):
        # A camera without colours: `superpose --channels` makes a channel of each light's photo.
        own = np.eye(len(CHANNELS), dtype=np.float32)
        images = [replace(image, pixels=image.pixels * own[light]) for light, image in enumerate(images)]
    return images


def lit_surface(photos: BallPhotos, image: Image) -> NDArray[np.bool_]:
    """(H, W) the ball or card: its mask or circle, else the ball that is found. Raises InputError if there is none."""
    if photos.mask is not None and not photos.circles:
        mask = read_mask(photos.mask)
        check_same_size(f"the mask {photos.mask}", mask.shape, "the photo", image.pixels.shape[:2])
        return mask
    circle = photos.circles[0] if photos.circles else seen_balls(photos, image.pixels)[0].circle
    height, width = image.pixels.shape[:2]
    x, y = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
    inside: NDArray[np.bool_] = np.hypot(x - circle.x, y - circle.y) < circle.radius
    return inside


def mean_photo(photos: BallPhotos, images: Iterable[Image] | None = None) -> NDArray[np.float32]:
    """(H, W, 3) linear mean of the photos, in which the whole ball is lit. Raises GeometryError if sizes differ.

    images: the photos, if they have been read already.
    """
    total: NDArray[np.float32] = np.zeros((), np.float32)
    for file, image in zip(photos.files, images or map(photos.read, photos.files), strict=True):
        if total.ndim:
            check_same_size(str(file), image.pixels.shape, str(photos.files[0]), total.shape)
        total = total + image.pixels
    mean: NDArray[np.float32] = np.nan_to_num(total / np.float32(len(photos.files)), posinf=0.0, neginf=0.0)
    return mean


def seen_balls(photos: BallPhotos, image: NDArray[np.float32]) -> list[Ball]:
    """The balls in the photos. image: (H, W, 3), their mean. Raises InputError if they are not found."""
    height, width = image.shape[:2]
    camera = _camera(photos, width, height)
    if photos.circles:
        for circle in photos.circles:
            if circle.radius > max(width, height):
                raise GeometryError(
                    f"a circle of {circle.radius:g} pixels is larger than the photo, {size(image.shape)}"
                )
            if not (0 <= circle.x <= width and 0 <= circle.y <= height):
                raise GeometryError(
                    f"the circle {circle.x:g},{circle.y:g},{circle.radius:g} has its middle outside the photo, which "
                    f"is {size(image.shape)}; x and y count pixels from the top left corner"
                )
        return [ball_from_circle(circle, camera, photos.radius) for circle in photos.circles]
    if photos.mask is not None:
        mask = read_mask(photos.mask)
        check_same_size(f"the mask {photos.mask}", mask.shape, "the photo", image.shape[:2])
        return [ball_from_mask(mask, camera, photos.radius)]
    with prefix_errors(photos.files[0]):
        return find_balls(image, camera, count=photos.balls, radius=photos.radius, mirror=photos.mirror)


def read_sightings(photos: BallPhotos, progress: Progress = silent) -> list[Sighting]:
    """Highlights in each ball: of the red, green and blue light in a single photo, of one light each in several.

    Raises InputError if a file cannot be read, or a ball or a highlight is not found.
    """
    progress(0.0, "looking for the ball")
    balls = seen_balls(photos, mean_photo(photos))
    found: list[list[Highlight]] = [[] for _ in balls]
    for number, file in enumerate(photos.files):
        progress((number + 1) / (len(photos.files) + 1), f"looking for highlights in {file.name}")
        image = photos.read(file)
        with prefix_errors(file):
            for spots, ball in zip(found, balls, strict=True):
                if len(photos.files) == 1:
                    spots += find_coloured_highlights(image, ball)
                else:
                    spots.append(find_highlight(image, ball))
    lens_known = photos.camera is not None
    return [Sighting(ball, tuple(spots), lens_known) for ball, spots in zip(balls, found, strict=True)]


def _camera(photos: BallPhotos, width: int, height: int) -> Camera:
    return camera_for(photos.camera, width, height) or pixel_camera(width, height)
