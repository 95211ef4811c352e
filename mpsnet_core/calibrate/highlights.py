"""Highlights of the lights in a mirror ball, assigned to lights by their colours."""

from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np

from mpsnet_core.arrays.mask_regions import dilated, labelled
from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.arrays.types import F64, I64, Bools
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.calibrate.ball import Ball, surface
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.image import CHANNELS, Image

# Share of the ball's radius to search. Closer to the rim, a mirror shows what is behind it, and the rim is blurred.
USED_RADIUS = 0.96
# A spot is the region above this share of its maximum brightness; its centroid also uses pixels above the second one.
SPOT = 0.5
SKIRT = 0.2
# Another spot above this share of the highlight's brightness is a candidate, too.
CANDIDATE = 0.25
# Uncertainty of a spot's centroid, as a share of its radius: normally, and for a clipped spot, which hides its peak.
CENTROID_SHARE = 0.05
CLIPPED_SHARE = 0.1
MIN_UNCERTAINTY = 0.1
# The same where clipped highlights touch: one hides part of the other.
HIDDEN_SHARE = 0.25
# Pixels whose chromaticities differ by less have one colour.
SAME_COLOUR = 0.08
# Least difference of log likelihood between the best and the second-best order of the lights.
MIN_MARGIN = 0.2


@dataclass(frozen=True)
class Highlight:
    """A light's reflection in a mirror ball."""

    x: float
    """Its centre in the photo, in pixels from the left."""
    y: float
    """Its centre in the photo, in pixels from the top."""
    radius: float
    """Radius of a disc of the same area, in pixels."""
    uncertainty: float
    """Standard deviation of the centre, in pixels."""
    clipped: bool
    """Whether any of its pixels is saturated."""
    rival: float
    """Light of the second-best spot as a share of this one's: 0 if there is none, 1 if both are equally likely."""
    colour: tuple[float, float, float]
    """Red, green and blue, scaled to a maximum of 1."""

    @property
    def point(self) -> tuple[float, float]:
        """(x, y) in pixels."""
        return self.x, self.y


@dataclass(frozen=True)
class _Window:
    """The part of a photo that contains the ball."""

    left: int
    """Its first column in the photo."""
    top: int
    """Its first row in the photo."""
    inside: Bools
    """(H, W). Pixels of the ball."""
    excess: F64
    """(H, W, 3). Light above what the ball mirrors elsewhere."""
    clipped: Bools
    """(H, W, 3). Whether it is saturated."""


def find_highlight(photo: Image, ball: Ball) -> Highlight:
    """The highlight of the one light that is on. Raises GeometryError if the ball shows none."""
    window = _window(photo, ball)
    light = window.excess.max(axis=-1)
    return _highlight(window, light / _peak(light), np.zeros_like(light), "the light")


def find_coloured_highlights(photo: Image, ball: Ball) -> tuple[Highlight, Highlight, Highlight]:
    """The highlights of the red, green and blue light, in this order, when all are on at once.

    The lights' colours are those of the ball's most different bright pixels, by successive projections (Gillis and
    Vavasis, "Fast and robust recursive algorithms for separable nonnegative matrix factorization", PAMI 2014). White
    pixels are therefore none of them. The colours are assigned to the lights in the order that maximises the product of
    red in the red light, green in the green and blue in the blue: neither light brightness nor channel gains change
    that order. Multiplying by the inverse of the colours separates the lights, even if highlights overlap. Clipped
    pixels have lost their colour and get that of the nearest pixel that has one.

    Raises GeometryError if the ball shows no highlights, or they do not differ in colour.
    """
    window = _window(photo, ball)
    gains = np.array([_peak(window.excess[..., channel]) for channel in range(3)])
    share = (window.excess / gains).max(axis=-1)
    bright, clipped = share > SKIRT, np.any(window.clipped, axis=-1)
    # With one saturated channel, the other two still show which light a pixel belongs to; with two they do not.
    attributable = bright & (window.clipped.sum(axis=-1) < 2)
    colours = _three_colours(window.excess[bright & ~clipped] / gains)
    if colours is None:
        colours = _three_colours(window.excess[attributable] / gains)
    if colours is None:
        raise GeometryError(
            "the highlights do not differ in colour, so the lights cannot be told apart; expose so that they do not "
            "clip, or take one photo of each light alone"
        )
    colours *= gains[:, None]
    colours /= colours.max(axis=0)
    lights = np.clip(window.excess @ np.linalg.inv(colours).T, 0, None)
    weight = np.zeros(lights.shape)
    owner = _owners(lights, attributable, clipped)
    for light in range(3):
        here = lights[..., light]
        own = clipped & (owner == light)
        # A pixel is fully bright where the light's strongest channel is saturated.
        strongest = int(colours[:, light].argmax())
        ends = window.excess[own & window.clipped[..., strongest], strongest]
        top = float(ends.min()) if ends.size else _peak(here)
        weight[..., light] = np.where(clipped, own, np.minimum(here / top, 1))
    found = []
    for light, name in enumerate(CHANNELS):
        others = weight.sum(axis=-1) - weight[..., light]
        spot = _highlight(window, weight[..., light], others, f"the {name} light")
        if (dilated(owner == light, 1) & (owner >= 0) & (owner != light)).any():
            spot = replace(spot, uncertainty=float(np.hypot(spot.uncertainty, HIDDEN_SHARE * spot.radius)))
        found.append(replace(spot, colour=_colour(colours[:, light])))
    for a, b in combinations(found, 2):
        if np.hypot(a.x - b.x, a.y - b.y) < 0.5 * min(a.radius, b.radius):
            raise GeometryError("two highlights lie at one place; photograph each light alone (--per-light)")
    return found[0], found[1], found[2]


def _window(photo: Image, ball: Ball) -> _Window:
    height, width = photo.pixels.shape[:2]
    left, right, top, bottom = ball.window(width, height)
    if right - left < 5 or bottom - top < 5:
        raise GeometryError("the ball lies outside the photo, or is smaller than five pixels; check the circle")
    x, y = np.meshgrid(np.arange(left, right) + 0.5, np.arange(top, bottom) + 0.5)
    _, normal, back = surface(ball, np.stack([x.ravel(), y.ravel()], axis=-1))
    inside = (dot(normal, back) > np.sqrt(1 - USED_RADIUS**2)).reshape(x.shape)
    pixels = np.nan_to_num(photo.pixels[top:bottom, left:right].astype(np.float64), posinf=0.0, neginf=0.0)
    background = np.median(pixels[inside], axis=0)
    excess = np.where(inside[..., None], np.clip(pixels - background, 0, None), 0)
    if not excess.any():
        raise GeometryError("the ball shows no highlight: all of it is equally bright; were the lights on?")
    clipped = photo.saturated[top:bottom, left:right] & inside[..., None]
    return _Window(left, top, inside, excess, clipped)


def _peak(values: F64) -> float:
    """Peak brightness, robust to single hot pixels: the largest mean of 2 x 2 pixels."""
    pairs = (values[:-1, :-1] + values[1:, :-1] + values[:-1, 1:] + values[1:, 1:]) / 4
    return max(float(pairs.max()), 1e-12)


def _three_colours(pixels: F64) -> F64 | None:
    """(3, 3) the most different colours of pixels (N, 3), one per column, in the order red, green, blue.

    None if they are too similar to assign.
    """
    if len(pixels) < 3:
        return None
    shares = pixels / pixels.sum(axis=1, keepdims=True)
    rest = shares.copy()
    columns = []
    for _ in range(3):
        length = np.linalg.norm(rest, axis=1)
        purest = shares[length.argmax()]
        near = np.linalg.norm(shares - purest, axis=1) < SAME_COLOUR
        columns.append(np.average(shares[near], axis=0, weights=pixels[near].sum(axis=1)))
        # Project onto the complement of the colours found so far.
        base, _ = np.linalg.qr(np.stack(columns, axis=-1))
        rest = shares - shares @ base @ base.T
    colours = np.stack(columns, axis=-1)
    logs = np.log(np.maximum(colours, 1e-6))
    orders = sorted(permutations(range(3)), key=lambda order: -sum(logs[k, order[k]] for k in range(3)))
    best, second = (sum(logs[k, order[k]] for k in range(3)) for order in orders[:2])
    singular = np.linalg.svd(colours, compute_uv=False)
    if best - second < MIN_MARGIN or singular[-1] < 0.05 * singular[0]:
        return None
    return colours[:, orders[0]]


def _owners(lights: F64, attributable: Bools, clipped: Bools) -> I64:
    """(H, W) index of the light that a clipped pixel belongs to, by its nearest attributable pixel; -1 elsewhere."""
    nearest = np.where(attributable, lights.argmax(axis=-1), -1).astype(np.float32)[..., None]
    nearest = extend_to_nearest(nearest, attributable, max(clipped.shape))
    return np.where(clipped, nearest[..., 0].astype(np.int64), -1)


def _highlight(window: _Window, weight: F64, others: F64, name: str) -> Highlight:
    """The most likely spot of a light.

    weight: (H, W) its brightness, with a maximum of 1. others: (H, W) the same for the other lights. A spot that is
    equally bright in those is white: a window rather than a light.
    """
    labels, sizes = labelled(weight > CANDIDATE, diagonal=True)
    number, count = labels - 1, len(sizes) - 1
    bright = number >= 0
    light = np.bincount(number[bright], np.clip(weight - others, 0, None)[bright], count)
    # A single bright pixel is a sensor defect.
    light = np.where(np.bincount(number[bright], weight[bright] > SPOT, count) > 1, light, 0)
    if not light.any():
        raise GeometryError(f"no highlight of {name} was found on the ball; is it on, and is this the mirror ball?")
    order = np.argsort(-light)
    spot = number == order[0]
    amount = np.minimum(weight[spot], 1)
    row, column = (np.average(places, weights=amount) for places in np.nonzero(spot))
    radius = float(np.sqrt((spot & (weight > SPOT)).sum() / np.pi))
    clipped = bool((spot & window.clipped.any(axis=-1)).any())
    unsure = float(np.hypot((CLIPPED_SHARE if clipped else CENTROID_SHARE) * radius, MIN_UNCERTAINTY))
    rival = float(light[order[1]] / light[order[0]]) if count > 1 else 0.0
    x, y = window.left + float(column) + 0.5, window.top + float(row) + 0.5
    return Highlight(x, y, radius, unsure, clipped, rival, _colour(window.excess[spot].sum(axis=0)))


def _colour(values: F64) -> tuple[float, float, float]:
    red, green, blue = values / max(float(values.max()), 1e-12)
    return float(red), float(green), float(blue)
