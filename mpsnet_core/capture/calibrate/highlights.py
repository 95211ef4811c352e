"""Highlights: where a mirror ball shows each light, and which light's it is by its colour."""

from dataclasses import dataclass, replace
from itertools import combinations, permutations

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import dilated, labelled
from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.capture.calibrate.ball import Ball, surface
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.image import CHANNELS, Image

# Of the ball's radius: nearer to its rim a mirror shows what lies behind it, squeezed, and the rim is blurred.
USED_RADIUS = 0.96
# A spot reaches to where it is half as bright as at its brightest; what counts for its middle reaches further out.
SPOT = 0.5
SKIRT = 0.2
# From this share of a highlight's brightness on, another spot is a candidate too.
CANDIDATE = 0.25
# Of a spot's radius, how far its middle may be off: a clipped spot hides where it is brightest.
CENTROID_SHARE = 0.05
CLIPPED_SHARE = 0.1
LEAST_UNCERTAINTY = 0.1
# Where clipped highlights touch, one hides a part of the other.
HIDDEN_SHARE = 0.25
# Pixels whose chromaticity differs by less are of one colour.
SAME_COLOUR = 0.08
# How much likelier, in natural logarithms, the colours must fit the best order of the lights than the next best.
LEAST_MARGIN = 0.2


@dataclass(frozen=True)
class Highlight:
    """A light as a ball mirrors it.

    Attributes
    ----------
    x, y
        Its middle in the photo, in pixels.
    radius
        Of a disc of its area, in pixels.
    uncertainty
        Of its middle, in pixels.
    clipped
        Whether any of it is saturated.
    rival
        How much light the next likely spot holds, as a share of this one's: 0 where it stands alone, 1 where both are
        as likely.
    colour
        Red, green and blue, the largest 1.
    """

    x: float
    y: float
    radius: float
    uncertainty: float
    clipped: bool
    rival: float
    colour: tuple[float, float, float]

    @property
    def point(self) -> tuple[float, float]:
        """(x, y) in pixels."""
        return self.x, self.y


@dataclass(frozen=True)
class _Window:
    """The part of a photo that holds the ball.

    excess: (H, W, 3) above what the ball mirrors elsewhere. clipped: (H, W, 3) which of it is saturated.
    """

    left: int
    top: int
    inside: NDArray[np.bool_]
    excess: NDArray[np.float64]
    clipped: NDArray[np.bool_]


def find_highlight(photo: Image, ball: Ball) -> Highlight:
    """The highlight of the one light that is on. Raises GeometryError where the ball shows none."""
    window = _window(photo, ball)
    light = window.excess.max(axis=-1)
    return _highlight(window, light / _peak(light), np.zeros_like(light), "the light")


def find_coloured_highlights(photo: Image, ball: Ball) -> tuple[Highlight, Highlight, Highlight]:
    """The highlights of the red, the green and the blue light that are on at once, in this order.

    The three colours are those of the ball's most different bright pixels (successive projections, Gillis and Vavasis,
    "Fast and robust recursive algorithms for separable nonnegative matrix factorization", PAMI 2014), so that what is
    white is none of them. Which is whose follows from the order of the lights that makes the product of
    red in the red, green in the green and blue in the blue largest: neither the lights' brightness nor the channels'
    gains change that. Unmixed by the inverse of these colours each light stands alone, though highlights overlap.
    Clipped pixels have lost their colour; they get that of the nearest pixel that has one.

    Raises GeometryError where the ball shows no highlights or they do not differ in colour.
    """
    window = _window(photo, ball)
    gains = np.array([_peak(window.excess[..., channel]) for channel in range(3)])
    share = (window.excess / gains).max(axis=-1)
    bright, clipped = share > SKIRT, np.any(window.clipped, axis=-1)
    # One saturated channel leaves two that show which light a pixel belongs to, if not its colour; two do not.
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
        # A clipped highlight counts as fully bright where its strongest channel is saturated.
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
            raise GeometryError(
                "two highlights lie at one place, so their lights cannot be told apart; photograph each light alone"
            )
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


def _peak(values: NDArray[np.float64]) -> float:
    """The brightest pixel, but not one that shines alone: the brightest mean of two neighbours across and down."""
    pairs = (values[:-1, :-1] + values[1:, :-1] + values[:-1, 1:] + values[1:, 1:]) / 4
    return max(float(pairs.max()), 1e-12)


def _three_colours(pixels: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """(3, 3) the most different colours of pixels (N, 3), a column each, in the order red, green, blue.

    None where they are too alike to assign.
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
        # The rest is perpendicular to the colours found so far.
        base, _ = np.linalg.qr(np.stack(columns, axis=-1))
        rest = shares - shares @ base @ base.T
    colours = np.stack(columns, axis=-1)
    logs = np.log(np.maximum(colours, 1e-6))
    orders = sorted(permutations(range(3)), key=lambda order: -sum(logs[k, order[k]] for k in range(3)))
    best, second = (sum(logs[k, order[k]] for k in range(3)) for order in orders[:2])
    singular = np.linalg.svd(colours, compute_uv=False)
    if best - second < LEAST_MARGIN or singular[-1] < 0.05 * singular[0]:
        return None
    ordered: NDArray[np.float64] = colours[:, orders[0]]
    return ordered


def _owners(
    lights: NDArray[np.float64], attributable: NDArray[np.bool_], clipped: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """(H, W) the light that a clipped pixel belongs to, by the nearest attributable pixel; -1 elsewhere."""
    nearest = np.where(attributable, lights.argmax(axis=-1), -1).astype(np.float32)[..., None]
    nearest = extend_to_nearest(nearest, attributable, max(clipped.shape))
    return np.where(clipped, nearest[..., 0].astype(np.int64), -1)


def _highlight(window: _Window, weight: NDArray[np.float64], others: NDArray[np.float64], name: str) -> Highlight:
    """The likeliest spot of a light.

    weight: (H, W) its brightness, 1 at its brightest. others: (H, W) the same of the other lights; a spot that is as
    bright in those is white, and so a window rather than a light.
    """
    labels, sizes = labelled(weight > CANDIDATE, diagonal=True)
    number, count = labels - 1, len(sizes) - 1
    bright = number >= 0
    light = np.bincount(number[bright], np.clip(weight - others, 0, None)[bright], count)
    # One bright pixel alone is the sensor's own.
    light = np.where(np.bincount(number[bright], weight[bright] > SPOT, count) > 1, light, 0)
    if not light.any():
        raise GeometryError(f"no highlight of {name} was found on the ball; is it on, and is this the mirror ball?")
    order = np.argsort(-light)
    spot = number == order[0]
    amount = np.minimum(weight[spot], 1)
    row, column = (np.average(places, weights=amount) for places in np.nonzero(spot))
    radius = float(np.sqrt((spot & (weight > SPOT)).sum() / np.pi))
    clipped = bool((spot & window.clipped.any(axis=-1)).any())
    return Highlight(
        window.left + float(column) + 0.5,
        window.top + float(row) + 0.5,
        radius,
        float(np.hypot((CLIPPED_SHARE if clipped else CENTROID_SHARE) * radius, LEAST_UNCERTAINTY)),
        clipped,
        float(light[order[1]] / light[order[0]]) if count > 1 else 0.0,
        _colour(window.excess[spot].sum(axis=0)),
    )


def _colour(values: NDArray[np.float64]) -> tuple[float, float, float]:
    red, green, blue = values / max(float(values.max()), 1e-12)
    return float(red), float(green), float(blue)
