"""The lights of photos without a rig: found in the photos themselves, by their shading and outlines."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import finite_inside
from mpsnet_core.capture.decode import PhotoReadOptions
from mpsnet_core.capture.open import PhotoSet
from mpsnet_core.capture.sources import Source
from mpsnet_core.errors import GeometryError, InputError, NoObject, Note
from mpsnet_core.estimate.lights.network import LightsGuess, guess_lights
from mpsnet_core.estimate.lights.refine import refine
from mpsnet_core.io.image import CHANNELS
from mpsnet_core.scene.rig import LightRig, angles_of

log = logging.getLogger(__name__)

# Lights are found in at most this many photos of a set, evenly spread.
MAX_PHOTOS = 6
# Of the variance of a light's error in one photo, the share that photos of one object have in common.
SHARED = 0.5
SMALLEST = 16  # pixels of an object's longer side: a smaller one tells nothing of the lights
# Where a light comes from at every 45 degrees of its tilt.
SIDES = ("right", "top right", "top", "top left", "left", "bottom left", "bottom", "bottom right")


@dataclass(frozen=True)
class LightFound:
    """A light that was found in a photo."""

    name: str
    """The camera's channel that shows it: red, green or blue."""
    direction: list[float]
    """Unit vector from the surface to the light, in camera space."""
    slant: float
    """Angle from the camera's axis, in degrees."""
    tilt: float
    """Angle in the photo, in degrees counter-clockwise from the right."""
    uncertainty: float
    """Expected error in degrees; 19 of 20 lights are within twice of it."""

    def __str__(self) -> str:
        side = SIDES[round(self.tilt / 45) % 8]
        return Note("%s from the %s, slant %.0f°, ± %.0f°", self.name, side, self.slant, self.uncertainty)


@dataclass(frozen=True, eq=False)
class FoundLights:
    """The lights that were found in photos."""

    rig: LightRig
    """The lights, in camera space. Crosstalk is part of their directions, so there is no mixing."""
    errors: NDArray[np.float64]
    """(3,) expected angular errors in degrees."""

    def __str__(self) -> str:
        return Note("%s; %s; %s", *map(str, self.facts()))

    def facts(self) -> list[LightFound]:
        """Each light, for people and for programs."""
        found = []
        for name, direction, error in zip(CHANNELS, self.rig.directions, self.errors, strict=True):
            slant, tilt = map(float, angles_of(direction))
            place = direction.round(4).tolist()
            found.append(LightFound(name, place, round(slant, 2), round(tilt, 2), round(float(error), 2)))
        return found


def find_lights(photos: Sequence[tuple[NDArray[np.floating[Any]], NDArray[np.bool_]]]) -> FoundLights:
    """The lights of photos under the same three lights, without a rig.

    Parameters
    ----------
    photos : sequence of pairs
        The linear pixels (H, W, 3) of each, and the object's mask (H, W).

    Returns
    -------
    FoundLights

    Raises
    ------
    GeometryError
        If the object is too small, or the channels show lights from one side, as in a photo under white light.
    """
    guesses = []
    for pixels, mask in photos:
        if np.ptp(np.nonzero(mask), axis=1).max() < SMALLEST:
            raise GeometryError(
                "the object is too small in the photo to find its lights; give the rig, or another mask"
            )
        guesses.append(guess_lights(finite_inside(pixels, mask, "photo"), mask))
    directions = np.array([one.directions for one in guesses])
    errors = np.array([one.errors for one in guesses])
    together = normalised((directions / errors[..., None] ** 2).sum(axis=0))
    error = np.sqrt((errors**2).mean(axis=0) * (SHARED + (1 - SHARED) / len(guesses)))
    found = refine(photos, LightsGuess(together, error))
    try:
        return FoundLights(LightRig(found.directions), np.degrees(found.errors))
    except GeometryError:
        raise GeometryError(
            "the photo's channels seem to show lights from one side, which do not determine a normal; light the object "
            "from three sides, or give the rig"
        ) from None


def find_lights_of(sources: Sequence[Source], options: PhotoReadOptions) -> FoundLights:
    """The lights of photo files without a rig; photos that cannot be read are left out, as long as one can.

    Raises InputError if none can be read, or as :func:`find_lights`.
    """
    count = min(len(sources), MAX_PHOTOS)
    # A video's frame can be read once.
    chosen = [_read_once(sources[round(number)]) for number in np.linspace(0, len(sources) - 1, count)]
    found = find_lights(_opened(chosen, options)[0])
    photos, decided = _opened([replace(source, rig=found.rig) for source in chosen], options)
    # Under these lights, their shading may show another encoding.
    return found if decided == options else find_lights(photos)


def with_lights(
    source: Source, photos: Sequence[Source], options: PhotoReadOptions
) -> tuple[Source, list[LightFound] | None]:
    """A source with a rig: if it has none, with the lights that are found in photos, which are returned, too.

    Raises as :func:`find_lights_of`.
    """
    if source.rig is not None:
        return source, None
    found = find_lights_of(photos, options)
    log.warning("lights found in the photo: %s; calibrate to gain up to 1.5° [lights-found]", str(found))
    return replace(source, rig=found.rig), found.facts()


def _read_once(source: Source) -> Source:
    return source if isinstance(source.photo, Path) else replace(source, photo=cache(source.photo))


def _opened(
    sources: Sequence[Source], options: PhotoReadOptions
) -> tuple[list[tuple[NDArray[np.floating[Any]], NDArray[np.bool_]]], PhotoReadOptions]:
    """Pixels and masks of the photos that can be read, and the options by which the set was read."""
    photos, found, failure = PhotoSet(sources, options), [], None
    for source in sources:
        try:
            shot = photos.masked(source)
        except InputError as error:
            failure = error
        else:
            if shot.mask.any():
                found.append((shot.image.pixels, shot.mask))
            else:
                failure = NoObject(f"{source}: the mask is empty: no pixel of the object is marked")
    if not found and failure:
        raise failure
    return found, photos.options
