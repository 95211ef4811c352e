"""The lights of photos without a rig: found in the photos themselves, by their shading and outlines."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from onnxruntime import InferenceSession

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.orientation import WHOLE, outline_of
from mpsnet_core.arrays.resampling import bilinear, block_means
from mpsnet_core.arrays.types import F32, F64, Bools, Floats
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.capture.capture import finite_inside
from mpsnet_core.capture.decode import PhotoReadOptions
from mpsnet_core.capture.open import PhotoSet, Source
from mpsnet_core.errors import GeometryError, InputError, NoObject, Note
from mpsnet_core.estimate.onnx_model import open_session, run_session
from mpsnet_core.estimate.registry import MODELS_FOLDER
from mpsnet_core.io.image import CHANNELS
from mpsnet_core.scene.rig import LightRig, angles_of

# --- the object of a photo as the network of lights sees it: small, centred, scaled to fit, at several angles ---------


SIDE = 64  # pixels a side of a crop
ROOM = 1.06  # from a crop's centre to its border, in radii of the object
MAX_PIXELS = 136  # The object's longer side is reduced to at most this many before it is resampled.
# Lower limit of a channel's mean, as a share of the largest: an all-black channel must not divide by zero.
MIN_MEAN = 1e-4
# Each view is mirrored left to right or not, and then turned counter-clockwise by an angle in radians.
MIRRORED = np.tile([1.0, -1.0], 6)
ANGLES = np.repeat(np.arange(6) * np.pi / 3, 2)


def crops(pixels: Floats, mask: Bools) -> F32:
    """(V, SIDE, SIDE, 4) the object in each view: linear channels divided by their means, and the mask, 0 to 1.

    pixels: (H, W, 3). mask: (H, W), not empty.
    """
    values = _reduced(pixels, mask)
    rows, columns = np.nonzero(values[..., 3])
    y, x = rows.mean(), columns.mean()
    reach = max(float(np.hypot(rows - y, columns - x).max()), 1.0) * ROOM
    steps = np.linspace(-reach, reach, SIDE)
    across, down = np.meshgrid(steps, steps)
    cosine, sine, sign = (one[:, None, None] for one in (np.cos(ANGLES), np.sin(ANGLES), MIRRORED))
    # What a crop that was turned counter-clockwise shows at a place was clockwise of there.
    right = sign * (cosine * across - sine * down)
    # Black beyond the box. A pixel's centre is at its index + 0.5, and one more as of the border.
    bordered = np.pad(values, [(1, 1), (1, 1), (0, 0)])
    seen = bilinear(bordered, x + right + 1.5, y + sine * across + cosine * down + 1.5, np.float32)
    return np.asarray(seen, np.float32)


def into_views(vectors: Floats) -> Floats:
    """Vectors (V, N, 3) in camera space, as each view shows them."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    x = MIRRORED[:, None] * x
    cosine, sine = np.cos(ANGLES)[:, None], np.sin(ANGLES)[:, None]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, z], axis=-1)


def out_of_views(vectors: Floats) -> Floats:
    """The inverse of :func:`into_views`."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    cosine, sine = np.cos(ANGLES)[:, None], np.sin(ANGLES)[:, None]
    return np.stack([MIRRORED[:, None] * (cosine * x + sine * y), cosine * y - sine * x, z], axis=-1)


def _reduced(pixels: Floats, mask: Bools) -> F32:
    """(h, w, 4) the object's bounding box in blocks: channels divided by their means, and whether it covers a block."""
    box = bounding_box(mask)
    inside = mask[box][..., None]
    factor = -(-max(inside.shape) // MAX_PIXELS)
    means = block_means(np.concatenate([np.where(inside, pixels[box], 0), inside], axis=-1, dtype=np.float32), factor)
    covered = means[..., 3]
    known = covered > min(0.5, float(covered.max()) / 2)
    colour = np.where(known[..., None], means[..., :3] / np.maximum(covered, 1e-6)[..., None], 0)
    overall = colour[known].mean(axis=0)
    colour /= np.maximum(overall, max(MIN_MEAN * float(overall.max()), 1e-30))
    return np.concatenate([colour, known[..., None]], axis=-1, dtype=np.float32)


# --- the network that tells a photo's lights from its shading and outline ---------------------------------------------


NETWORK = MODELS_FOLDER / "lights.onnx"
# Factor on the network's own errors that makes about 19 of 20 lights of held-out samples lie within twice of them, if
# they are around the camera.
ERROR_SCALE = 1.85


class LightsGuess(NamedTuple):
    """Lights as far as a photo tells."""

    directions: F64
    """(3, 3) unit vectors in camera space, one light per row, in the order of the photo's channels."""
    errors: F64
    """(3,) expected angular errors in radians."""


def guess_lights(pixels: Floats, mask: Bools) -> LightsGuess:
    """The lights of a photo (H, W, 3) of an object with its mask (H, W): the mean of what each view tells.

    Crosstalk is part of the directions: those that explain each channel best.
    """
    seen = np.moveaxis(crops(pixels, mask), -1, 1)
    inputs = {"photo": np.ascontiguousarray(seen[:, :3]), "mask": np.ascontiguousarray(seen[:, 3:])}
    directions, errors = (value.astype(np.float64) for value in run_session(_session(), inputs))
    together = normalised((out_of_views(directions) / errors[..., None] ** 2).sum(axis=0))
    return LightsGuess(together, ERROR_SCALE * np.exp(np.log(errors).mean(axis=0)))


@cache
def _session() -> InferenceSession:
    return open_session(NETWORK, "cpu", 0)


# --- Lights refined by the object itself: they are right if the normals that follow from them belong to one surface
# Equation 2 makes three normals' components of three channels. Under the right lights
#
# - their gradients have no curl (Yuille and Snow, "Shape and albedo from multiple images using integrability", CVPR
# 1997); paint of one hue cancels in that, - most of the object has one albedo (Alldrin, Mallick and Kriegman,
# "Resolving the generalized bas-relief ambiguity by entropy minimization", CVPR 2007), - normals at the outline point
# outwards.
#
# Each of them fails somewhere: at shadows, highlights, and edges of paint. So residuals have Cauchy's distribution,
# whose width follows them, and the network's guess is the prior.


BLOCKS = 90  # The object's longer side is reduced to about this many.
SHADOW = 0.08  # Lights up to this share of their channel's 95th percentile do not reach a block.
MIN_BLOCKS = 300  # with a curl
# How many independent observations the blocks' curl, albedo and outline count as, and the least widths of their
# distributions.
CURL, ALBEDO, OUTLINE = 60.0, 30.0, 20.0
LEAST_CURL, LEAST_ALBEDO, LEAST_OUTLINE, LEAST_FACING = 0.05, 0.05, 0.15, 0.1
STEEP = 0.6  # z that normals at the outline do not exceed
STRENGTHS = 0.5  # standard deviation of the logarithms of the channels' strengths
WIDTHS, STEPS, SETTLED = 3, 20, 1e-3  # rounds of new widths, steps in each, and radians
UNDAMPED = 1e-2


def refine(photos: Sequence[tuple[Floats, Bools]], guess: LightsGuess) -> LightsGuess:
    """The lights of photos (H, W, 3) under the same three lights, of objects with masks (H, W), near a guess.

    Photos of which too little is lit by all lights are left out.
    """
    seen = [one for one in (_observed(*photo) for photo in photos) if len(one.across) >= MIN_BLOCKS]
    if not seen:
        return guess
    fit = _Fit(seen, guess)
    for _ in range(WIDTHS):
        fit.new_widths()
        for _ in range(STEPS):
            if not fit.step():
                break
    return fit.result()


class _Observed(NamedTuple):
    """What a photo shows, in blocks that all lights reach."""

    lit: F64
    """(P, 3) colours."""
    across: F64
    """(Q, 3) cross products of colours, where the neighbours are lit, too, with their derivatives to the right."""
    up: F64
    """(Q, 3) those with their derivatives upwards."""
    rim: F64
    """(R, 3) colours at the outline."""
    outwards: F64
    """(R, 2) unit vectors across the outline."""


def _observed(pixels: Floats, mask: Bools) -> _Observed:
    box = bounding_box(mask)
    border = [(part.start == 0, part.stop >= size) for part, size in zip(box, mask.shape, strict=True)]
    inside = mask[box][..., None]
    factor = max(1, round(max(inside.shape) / BLOCKS))
    planes = np.concatenate([np.where(inside, pixels[box], 0), inside], axis=-1, dtype=np.float32)
    means = np.pad(block_means(planes, factor).astype(np.float64), [(1, 1), (1, 1), (0, 0)])
    colours, covered = means[..., :3], means[..., 3]
    whole = covered > WHOLE
    bright = np.percentile(colours[whole], 95, axis=0) if whole.any() else np.ones(3)
    colours = colours / np.maximum(bright, 1e-12)
    lit = whole & (colours > SHADOW).all(axis=-1)
    inner = lit.copy()
    for axis in (0, 1):
        inner &= np.roll(lit, 1, axis) & np.roll(lit, -1, axis)
    down, right = np.gradient(colours, axis=(0, 1)) if inner.any() else (colours, colours)
    outline = outline_of(covered[1:-1, 1:-1], border)
    rim = np.pad(outline.rim, 1) & lit
    own = colours[inner]
    outwards = outline.outwards[rim[1:-1, 1:-1]]
    return _Observed(colours[lit], np.cross(own, right[inner]), np.cross(own, -down[inner]), colours[rim], outwards)


class _Fit:
    """Unknowns: two angles of each light, and for each photo the logarithms of two channels' strengths."""

    def __init__(self, seen: Sequence[_Observed], guess: LightsGuess) -> None:
        self.seen, self.guess = seen, guess
        self.tangents = np.array([np.linalg.svd(light[None])[2][1:] for light in guess.directions])
        self.values = np.zeros(6 + 2 * len(seen))
        self.widths = [np.ones(4)] * len(seen)
        self.damping = 1e-3
        self.matrix = np.eye(len(self.values))

    def directions(self, angles: F64) -> F64:
        """(3, 3) unit vectors by six angles."""
        return normalised(self.guess.directions + np.einsum("ka,kai->ki", angles.reshape(3, 2), self.tangents))

    def measures(self, number: int, values: F64) -> list[F64]:
        """Curl, deviation of the albedo, of the outline and of facing the camera, of a photo by its own (8,) values."""
        seen, strengths = self.seen[number], np.exp([values[6], values[7], -values[6] - values[7]])
        inverse = np.linalg.inv(self.directions(values[:6]) * strengths[:, None])
        along = np.cross(inverse[2], inverse[:2]).T
        x, y = seen.across @ along, seen.up @ along
        size = np.sqrt(dot(x, x) + dot(y, y))
        curl = (y[:, 0] - x[:, 1]) / (size + 0.1 * np.median(size) + 1e-12)
        scaled = seen.lit @ inverse.T
        length = np.maximum(np.linalg.norm(scaled, axis=1), 1e-12)
        albedo = np.log(length)
        rim = normalised(seen.rim @ inverse.T)
        turned = rim[:, 0] * seen.outwards[:, 1] - rim[:, 1] * seen.outwards[:, 0]
        inwards = np.minimum(dot(rim[:, :2], seen.outwards), 0)
        outline = np.concatenate([turned, inwards, np.minimum(rim[:, 2], 0), np.maximum(rim[:, 2] - STEEP, 0)])
        return [curl, albedo - np.median(albedo), outline, np.minimum(scaled[:, 2] / length, 0)]

    def new_widths(self) -> None:
        """Set each distribution's width to what its residuals have now."""
        least = np.array([LEAST_CURL, LEAST_ALBEDO, LEAST_OUTLINE])
        for number in range(len(self.seen)):
            measures = self.measures(number, self.own(number))[:3]
            spread = [1.4826 * np.median(np.abs(one)) if len(one) else 0 for one in measures]
            self.widths[number] = np.append(np.maximum(spread, least), LEAST_FACING)

    def own(self, number: int, values: F64 | None = None) -> F64:
        """(8,) the values of one photo."""
        values = self.values if values is None else values
        return np.concatenate([values[:6], values[6 + 2 * number : 8 + 2 * number]])

    def residuals(self, number: int, values: F64) -> F64:
        """Of a photo: the sum of their squares is the negative logarithm of the probability, doubled."""
        found, counts = [], (CURL, ALBEDO, OUTLINE, OUTLINE)
        for one, width, count in zip(self.measures(number, values), self.widths[number], counts, strict=True):
            weight = count / max(len(one), 1)
            found.append(np.sign(one) * np.sqrt(weight * np.log1p((one / width) ** 2)))
        return np.concatenate([*found, np.array([*values[6:], values[6:].sum()]) / STRENGTHS])

    def prior(self, values: F64) -> F64:
        """(6,) deviations of the angles from the guess."""
        return (values[:6].reshape(3, 2) / self.guess.errors[:, None]).ravel()

    def cost(self, values: F64) -> float:
        photos = sum(float(np.sum(self.residuals(k, self.own(k, values)) ** 2)) for k in range(len(self.seen)))
        return float(np.sum(self.prior(values) ** 2)) + photos

    def step(self) -> bool:
        """A step of Levenberg and Marquardt. Returns whether another may help."""
        count, small = len(self.values), 1e-5
        matrix, right = np.zeros((count, count)), np.zeros(count)
        precision = np.repeat(1 / self.guess.errors**2, 2)
        matrix[range(6), range(6)] = precision
        right[:6] = precision * self.values[:6]
        for number in range(len(self.seen)):
            own = self.own(number)
            residuals = self.residuals(number, own)
            moved = [self.residuals(number, own + small * one) for one in np.eye(8)]
            jacobian = (np.array(moved).T - residuals[:, None]) / small
            places = [*range(6), 6 + 2 * number, 7 + 2 * number]
            matrix[np.ix_(places, places)] += jacobian.T @ jacobian
            right[places] += jacobian.T @ residuals
        self.matrix, before = matrix, self.cost(self.values)
        while self.damping < 1e3:
            change = np.linalg.solve(matrix + self.damping * np.diag(np.diag(matrix)), right)
            if self.cost(self.values - change) < before:
                self.values = self.values - change
                damped, self.damping = self.damping > UNDAMPED, max(self.damping / 5, 1e-4)
                return damped or bool(np.abs(change).max() > SETTLED)  # a damped step is small anywhere
            self.damping *= 5
        self.damping = 1e-3
        return False

    def result(self) -> LightsGuess:
        spread = np.diag(np.linalg.inv(self.matrix))[:6].reshape(3, 2).sum(axis=1)
        return LightsGuess(self.directions(self.values[:6]), np.sqrt(spread))


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
    """Expected error in degrees; nine of ten lights around the camera are within twice of it."""

    def __str__(self) -> str:
        side = SIDES[round(self.tilt / 45) % 8]
        return Note("%s from the %s, slant %.0f°, ± %.0f°", self.name, side, self.slant, self.uncertainty)


@dataclass(frozen=True, eq=False)
class FoundLights:
    """The lights that were found in photos."""

    rig: LightRig
    """The lights, in camera space. Crosstalk is part of their directions, so there is no mixing."""
    errors: F64
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


def find_lights(photos: Sequence[tuple[Floats, Bools]]) -> FoundLights:
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
            raise GeometryError("the object is too small to find its lights; give the rig, or another mask")
        guesses.append(guess_lights(finite_inside(pixels, mask, "photo"), mask))
    directions = np.array([one.directions for one in guesses])
    errors = np.array([one.errors for one in guesses])
    together = normalised((directions / errors[..., None] ** 2).sum(axis=0))
    error = np.sqrt((errors**2).mean(axis=0) * (SHARED + (1 - SHARED) / len(guesses)))
    found = refine(photos, LightsGuess(together, error))
    try:
        return FoundLights(LightRig(found.directions), np.degrees(found.errors))
    except GeometryError:
        words = "the photo's channels seem to show lights from one side; light it from three sides, or give the rig"
        raise GeometryError(words) from None


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
    log.warning("lights found in the photo: %s; calibrate to gain up to 2° [lights-found]", str(found))
    return replace(source, rig=found.rig), found.facts()


def _read_once(source: Source) -> Source:
    return source if isinstance(source.photo, Path) else replace(source, photo=cache(source.photo))


def _opened(
    sources: Sequence[Source], options: PhotoReadOptions
) -> tuple[list[tuple[Floats, Bools]], PhotoReadOptions]:
    """Pixels and masks of the photos that can be read, and the options by which the set was read."""
    photos, found, failure = PhotoSet(sources, options), [], None
    for source in sources:
        try:
            shot = photos.masked(source)
            if not shot.mask.any():
                raise NoObject(f"{source}: the mask is empty: no pixel of the object is marked")
            found.append((shot.image.pixels, shot.mask))
        except InputError as error:
            failure = error
    if not found and failure:
        raise failure
    return found, photos.options
