"""From photo files to balls and highlights, one photo in memory at a time."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.sizes import check_same_size, size
from mpsnet_core.capture.calibrate.ball import Ball, Circle, ball_from_circle, ball_from_mask
from mpsnet_core.capture.calibrate.circles import find_balls
from mpsnet_core.capture.calibrate.highlights import Highlight, find_coloured_highlights, find_highlight
from mpsnet_core.capture.calibrate.lights import Sighting
from mpsnet_core.capture.correction import corrected
from mpsnet_core.capture.reading import AS_STATED, Reading
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.files import prefix_errors
from mpsnet_core.io.image import Image
from mpsnet_core.io.image_reading import read_mask
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.camera import Camera, camera_of_lens, pixel_camera


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
    reading
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
    reading: Reading = AS_STATED
    mirror: bool = True

    def read(self, file: Path) -> Image:
        """Read one of the photos."""
        return corrected(self.reading.photo(file), self.reading.correction)


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
    if photos.camera is None:
        return pixel_camera(width, height)
    if not isinstance(photos.camera, Camera):
        return camera_of_lens(photos.camera, width, height)
    check_same_size("the camera", (photos.camera.height, photos.camera.width), "the photo", (height, width))
    return photos.camera
