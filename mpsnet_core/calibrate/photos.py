"""From photo files to balls and highlights, one photo in memory at a time."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.sizes import check_same_size, size
from mpsnet_core.arrays.types import F32, Bools, Floats
from mpsnet_core.calibrate.ball import Ball, Circle, ball_from_circle, ball_from_mask
from mpsnet_core.calibrate.circles import find_balls
from mpsnet_core.calibrate.highlights import Highlight, find_coloured_highlights, find_highlight
from mpsnet_core.calibrate.lights import Sighting
from mpsnet_core.capture.decode import AS_STATED, PhotoReadOptions, corrected
from mpsnet_core.capture.open import PhotoSet, Source
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.files import prefix_errors
from mpsnet_core.io.image import CHANNELS, Image, in_one_frame
from mpsnet_core.io.image_reading import read_mask
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.camera import Camera, camera_for, pixel_camera
from mpsnet_core.scene.rig import LightRig


@dataclass(frozen=True)
class BallPhotos:
    """Photos of a ball and how to read them."""

    files: Sequence[Path]
    """Photos of the ball at one place: one under all lights, or one for each light alone."""
    circles: Sequence[Circle] = ()
    """Outlines of the balls, drawn by hand."""
    mask: Path | None = None
    """Mask file of the ball. Without circles and mask the balls are detected."""
    balls: int = 1
    """Number of balls."""
    radius: float = 1.0
    """Radius of the balls, in the desired unit of positions."""
    camera: Camera | float | None = None
    """A camera, the focal length of its lens in mm (:func:`camera_of_lens`), or None for a distant camera."""
    options: PhotoReadOptions = AS_STATED
    """How to read the photos."""
    mirror: bool = True
    """Whether the ball is a mirror; if not, it is matt."""

    def read(self, *, corrected_too: bool = True) -> Iterator[Image]:
        """Read the photos, one at a time: the camera stood still. Those of one light each may have one channel."""
        for image in in_one_frame(self.files, partial(self.options.photo, grey=len(self.files) > 1)):
            yield corrected(image, self.options.correction) if corrected_too else image


def read_lit(photos: BallPhotos, rig: LightRig) -> list[Image]:
    """The photos of a matt surface under a known rig, one or one for each light; all of them are held in memory.

    Its shading tells whether files that do not state their encoding are linear. Raises InputError if a file cannot be
    read, or the surface is not found.
    """
    images = [*photos.read(corrected_too=False)]
    together = images[0]
    if len(images) == len(CHANNELS):  # each shows its own light in its own channel
        assumed = together.assumed if len({image.assumed for image in images}) == 1 else None
        pixels = np.stack([image.pixels[..., light] for light, image in enumerate(images)], axis=-1)
        together = replace(together, pixels=pixels, assumed=assumed)
    if together.assumed:
        source = Source(lambda: together, rig, partial(lit_surface, photos), photos.files[0].name)
        decided = PhotoSet([source], photos.options)
        decided.masked(source)
        images = [*replace(photos, options=decided.options).read(corrected_too=False)]
    images = [corrected(image, photos.options.correction) for image in images]
    if len(images) == len(CHANNELS) and all(not np.ptp(image.pixels, axis=-1).any() for image in images):
        # A camera without colours: `superpose --channels` makes a channel of each light's photo.
        own = np.eye(len(CHANNELS), dtype=np.float32)
        images = [replace(image, pixels=image.pixels * own[light]) for light, image in enumerate(images)]
    return images


def lit_surface(photos: BallPhotos, image: Image) -> Bools:
    """(H, W) the ball or card: its mask or circle, else the ball that is found. Raises InputError if there is none."""
    if photos.mask is not None and not photos.circles:
        return _mask(photos.mask, image.pixels)
    circle = photos.circles[0] if photos.circles else seen_balls(photos, image.pixels)[0].circle
    height, width = image.pixels.shape[:2]
    x, y = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
    return np.hypot(x - circle.x, y - circle.y) < circle.radius


def mean_photo(photos: BallPhotos, images: Iterable[Image] | None = None) -> F32:
    """(H, W, 3) linear mean of the photos, in which the whole ball is lit. Raises GeometryError if sizes differ.

    images: the photos, if they have been read already.
    """
    total: F32 = np.zeros((), np.float32)
    for image in images or photos.read():
        total = total + image.pixels
    return np.nan_to_num(total / np.float32(len(photos.files)), posinf=0.0, neginf=0.0)


def seen_balls(photos: BallPhotos, image: F32) -> list[Ball]:
    """The balls in the photos. image: (H, W, 3), their mean. Raises InputError if they are not found."""
    height, width = image.shape[:2]
    camera = camera_for(photos.camera, width, height) or pixel_camera(width, height)
    if photos.circles:
        for circle in photos.circles:
            if circle.radius > max(width, height):
                raise GeometryError(f"a radius of {circle.radius:g} pixels is more than the photo, {size(image.shape)}")
            if not (0 <= circle.x <= width and 0 <= circle.y <= height):
                raise GeometryError(
                    f"the circle {circle.x:g},{circle.y:g},{circle.radius:g} has its centre outside the photo, which "
                    f"is {size(image.shape)}; x and y count pixels from the top left corner"
                )
        return [ball_from_circle(circle, camera, photos.radius) for circle in photos.circles]
    if photos.mask is not None:
        return [ball_from_mask(_mask(photos.mask, image), camera, photos.radius)]
    with prefix_errors(photos.files[0]):
        return find_balls(image, camera, count=photos.balls, radius=photos.radius, mirror=photos.mirror)


def read_sightings(photos: BallPhotos, progress: Progress = silent) -> list[Sighting]:
    """Highlights in each ball: of the red, green and blue light in a single photo, of one light each in several.

    Raises InputError if a file cannot be read, or a ball or a highlight is not found.
    """
    progress(0.0, "looking for the ball")
    balls = seen_balls(photos, mean_photo(photos))
    found: list[list[Highlight]] = [[] for _ in balls]
    for number, (file, image) in enumerate(zip(photos.files, photos.read(), strict=True), 1):
        progress(number / (len(photos.files) + 1), f"looking for highlights in {file.name}")
        with prefix_errors(file):
            for spots, ball in zip(found, balls, strict=True):
                if len(photos.files) == 1:
                    spots += find_coloured_highlights(image, ball)
                else:
                    spots.append(find_highlight(image, ball))
    lens_known = photos.camera is not None
    return [Sighting(ball, tuple(spots), lens_known) for ball, spots in zip(balls, found, strict=True)]


def _mask(file: Path, image: Floats) -> Bools:
    mask = read_mask(file)
    check_same_size(f"the mask {file}", mask.shape, "the photo", image.shape[:2])
    return mask
