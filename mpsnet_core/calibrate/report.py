"""Results of a calibration: data for programs, which `str` turns into lines for people."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.arrays.types import F32, F64
from mpsnet_core.calibrate.ball import Ball, Circle
from mpsnet_core.calibrate.lights import LightsFound, Sighting
from mpsnet_core.calibrate.mixing import MixingFound
from mpsnet_core.io.image import CHANNELS, linear_to_srgb
from mpsnet_core.scene.pictures import font, scaled
from mpsnet_core.scene.rig import angles_of

# --- overlays of a calibration on the photo: outline, highlights, and the direction of each light ---------------------


Colour = tuple[float, float, float]
Side = Literal["left", "middle", "right"]
Point = tuple[float, float] | F64
OUTLINE: Colour = (0.98, 0.85, 0.25)
# Red, green and blue that are visible on dark and on bright, lighter variants of Okabe and Ito's palette.
LIGHT_COLOURS: tuple[Colour, ...] = ((1.0, 0.35, 0.30), (0.30, 0.90, 0.45), (0.40, 0.65, 1.0))
# With more lights than colours, all are drawn alike.
PLAIN: Colour = (0.55, 0.85, 1.0)
INK: Colour = (0.08, 0.08, 0.08)
TEXT = 17
# The overlay is cropped to the ball with a margin of this share of its radius, and is this high in pixels.
MARGIN = 0.6
PICTURE_SIDE = 720


def lights_picture(image: F32, sighting: Sighting, directions: F64, names: Sequence[str]) -> F32:
    """(H, W, 3) display values: the ball, enlarged, with its outline, highlights and arrows towards the lights.

    image: (H, W, 3) linear. directions: (N, 3). names: short names of the lights. An arrow starts at the ball's centre.
    Its length is the direction's component across the view, in ball radii.
    """
    canvas = _Canvas(image, sighting.ball)
    many = len(sighting.highlights) > len(LIGHT_COLOURS)
    circle = sighting.ball.circle
    for number, (spot, direction, name) in enumerate(zip(sighting.highlights, directions, names, strict=True)):
        if many:
            canvas.ring(Circle(spot.x, spot.y, spot.radius + 1.0), PLAIN)
            canvas.label(name, spot.point, PLAIN, side="middle")
            continue
        colour = LIGHT_COLOURS[number]
        tip = (circle.x + circle.radius * direction[0], circle.y - circle.radius * direction[1])
        canvas.arrow((circle.x, circle.y), tip, colour)
        canvas.ring(Circle(spot.x, spot.y, spot.radius + 2.0), colour)
        words = "{}: slant {:.1f}°, tilt {:.1f}°".format(name, *angles_of(direction))
        canvas.label(words, tip, colour, side="left" if direction[0] < -0.05 else "right")
    return canvas.pixels


def ball_picture(image: F32, ball: Ball, words: str) -> F32:
    """(H, W, 3) display values: the ball, enlarged, with its outline and a caption."""
    canvas = _Canvas(image, ball)
    canvas.label(words, (ball.circle.x, ball.circle.y + 1.15 * ball.circle.radius), OUTLINE, side="middle")
    return canvas.pixels


class _Canvas:
    """The enlarged part of the photo around the ball. Drawing uses the photo's pixel coordinates."""

    def __init__(self, image: F32, ball: Ball) -> None:
        circle, (height, width) = ball.circle, image.shape[:2]
        reach = (1 + MARGIN) * circle.radius
        self.left, self.top = max(int(circle.x - reach), 0), max(int(circle.y - reach), 0)
        right, bottom = min(int(circle.x + reach) + 1, width), min(int(circle.y + reach) + 1, height)
        part = np.clip(image[self.top : bottom, self.left : right], 0, None)
        # A mirror ball is dark except for the lights: the cube root shows both.
        white = max(float(np.percentile(part, 99.9)), 1e-9)
        shown = 0.5 * linear_to_srgb(part / white) + 0.5 * np.clip(np.cbrt(part / white), 0, 1)
        self.scale = PICTURE_SIDE / max(part.shape[:2])
        self.pixels = scaled(shown, self.scale)
        self.label_boxes: list[tuple[float, float, float]] = []
        self.loop(ball.outline(), OUTLINE)
        self.cross((circle.x, circle.y), OUTLINE, 6)

    def line(self, start: Point, end: Point, colour: Colour, half_width: float = 0.8, strength: float = 1.0) -> None:
        """Draw an antialiased line between points of the photo; its width is in pixels of the overlay."""
        a, b = self._here(start), self._here(end)
        reach = half_width + 2
        limit = self.pixels.shape[1::-1]
        low = np.clip(np.floor(np.minimum(a, b) - reach), 0, limit).astype(int)
        high = np.clip(np.ceil(np.maximum(a, b) + reach), 0, limit).astype(int)
        if (high <= low).any():
            return
        x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
        along = b - a
        share = np.clip(((x - a[0]) * along[0] + (y - a[1]) * along[1]) / max(float(along @ along), 1e-9), 0, 1)
        away = np.hypot(x - a[0] - share * along[0], y - a[1] - share * along[1])
        cover = strength * np.clip(half_width + 0.5 - away, 0, 1)[..., None]
        part = self.pixels[low[1] : high[1], low[0] : high[0]]
        part[...] = part * (1 - cover) + np.array(colour) * cover

    def loop(self, points: F64, colour: Colour) -> None:
        """Draw a closed line through points (N, 2) of the photo, with a dark outline for bright backgrounds."""
        for paint, half_width, strength in ((INK, 2.0, 0.15), (colour, 0.8, 1.0)):
            for start, end in zip(points, np.roll(points, -1, axis=0), strict=True):
                self.line(start, end, paint, half_width, strength)

    def ring(self, circle: Circle, colour: Colour) -> None:
        self.loop(circle.points(48), colour)

    def cross(self, point: tuple[float, float], colour: Colour, arm: float) -> None:
        """Draw a cross; the length of its arms is in pixels of the overlay."""
        reach = arm / self.scale
        self.line((point[0] - reach, point[1]), (point[0] + reach, point[1]), colour)
        self.line((point[0], point[1] - reach), (point[0], point[1] + reach), colour)

    def arrow(self, start: Point, end: Point, colour: Colour) -> None:
        along = np.subtract(start, end)
        length = float(np.linalg.norm(along))
        back = along / max(length, 1e-9) * min(12 / self.scale, length / 2)
        sides = [end + back + side * np.array([-back[1], back[0]]) for side in (-0.4, 0.4)]
        for paint, half_width, strength in ((INK, 2.2, 0.5), (colour, 0.9, 1.0)):
            for a, b in ((start, end), (end, sides[0]), (end, sides[1])):
                self.line(a, b, paint, half_width, strength)

    def label(self, words: str, point: Point, colour: Colour, *, side: Side = "right") -> None:
        """Write a label at a point of the photo, moved down if it would overlap another label."""
        height, breadth = self.pixels.shape[:2]
        box = oiio.ImageBufAlgo.text_size(words, TEXT, font())
        x, y = self._here(point)
        x += {"left": -10 - box.width, "middle": -box.width / 2 - 1, "right": 10}[side]
        x = float(np.clip(x, 4, max(breadth - box.width - 6, 4)))
        y = float(np.clip(y + TEXT / 3, TEXT, height - 8))
        while side != "middle" and self._overlaps_label(x, x + box.width, y):
            y += 2
        self.label_boxes.append((x, x + box.width, y))
        buffer = oiio.ImageBuf(np.ascontiguousarray(self.pixels))
        for right, down in ((-1, 0), (1, 0), (0, -1), (0, 1), (1, 1)):
            oiio.ImageBufAlgo.render_text(buffer, round(x) + right, round(y) + down, words, TEXT, font(), INK)
        oiio.ImageBufAlgo.render_text(buffer, round(x), round(y), words, TEXT, font(), colour)
        self.pixels[...] = np.asarray(buffer.get_pixels(oiio.FLOAT))

    def _overlaps_label(self, left: float, right: float, y: float) -> bool:
        return any(abs(y - other) < TEXT + 2 and left < end and start < right for start, end, other in self.label_boxes)

    def _here(self, point: Point) -> F64:
        return (np.array(point, np.float64) - [self.left, self.top]) * self.scale


@dataclass(frozen=True)
class LightFacts:
    """A light as it was found."""

    name: str
    """Name of the light."""
    direction: list[float]
    """(3,). Unit vector to the light, in camera space."""
    slant: float
    """Angle to the viewing direction, in degrees."""
    tilt: float
    """Direction in the image, in degrees counter-clockwise from the right."""
    file: str | None = None
    """The photo or entry that shows it."""
    uncertainty: float | None = None
    """One standard deviation of the direction, in degrees, if calibrated by balls."""
    highlights: list[dict[str, Any]] | None = None
    """Its highlights, if calibrated by balls: the number of the ball, and the fields of
    :class:`mpsnet_core.calibrate.highlights.Highlight`."""
    position: list[float] | None = None
    """(3,). Its position in camera space, if it was found."""
    position_uncertainty: float | None = None
    """One standard deviation of the position."""
    gap: float | None = None
    """Distance by which the rays to the light miss one another."""

    def __str__(self) -> str:
        shown = f" ({self.file})" if self.file else ""
        line = f"{self.name.rjust(6)}{shown}: slant {self.slant:.2f}°, tilt {self.tilt:.2f}°"
        if self.uncertainty is not None:
            line += f", ± {self.uncertainty:.2f}°"
        if self.position is not None:
            place = ", ".join(f"{value:.4g}" for value in self.position)
            line += f"; at {place}, ± {self.position_uncertainty:.2g}, rays meet to {self.gap:.2g}"
        return line + (" (clipped)" if any(spot["clipped"] for spot in self.highlights or ()) else "")


@dataclass(frozen=True)
class BallFacts:
    """A ball as it was found: see :class:`mpsnet_core.calibrate.ball.Ball`."""

    by_hand: bool
    """Whether the user drew the outline."""
    circle: list[float]
    """(3,). Centre x, y and radius in the photo, in pixels."""
    residual: float
    """RMS distance of the outline's inliers from the fit, in pixels."""
    seen: float
    """Share of the outline that was found, 0 to 1."""
    centre: list[float]
    """(3,). Position in camera space."""
    radius: float
    """Radius, in the unit of the position."""

    def __str__(self) -> str:
        x, y, radius = self.circle
        line = f"  ball: {x:.1f},{y:.1f},{radius:.1f} pixels"
        if self.by_hand:
            return f"{line}, given by hand"
        return f"{line}, {self.seen:.0%} of its outline seen, fits to {self.residual:.2f} pixels"


def lights_facts(directions: F64, names: Sequence[str], **columns: Sequence[Any] | None) -> list[LightFacts]:
    """Facts of lights in the directions (N, 3). columns: what else is known of each light, by its field."""
    known = {field: values for field, values in columns.items() if values is not None}
    return [
        LightFacts(name, direction.tolist(), float(slant), float(tilt), **{field: known[field][k] for field in known})
        for k, (name, direction, slant, tilt) in enumerate(zip(names, directions, *angles_of(directions), strict=True))
    ]


def lights_by_balls(found: LightsFound, names: Sequence[str], files: Sequence[Path] | None) -> list[LightFacts]:
    """Facts of lights that were calibrated by balls."""
    spots = zip(*(sighting.highlights for sighting in found.sightings), strict=True)
    columns = {"uncertainty": found.uncertainties, "position": found.positions, "gap": found.gaps}
    columns["position_uncertainty"] = found.position_uncertainties
    return lights_facts(
        found.directions,
        names,
        file=files and [file.name for file in files],
        highlights=[[{"ball": ball, **asdict(spot)} for ball, spot in enumerate(of_light)] for of_light in spots],
        **{field: None if values is None else values.tolist() for field, values in columns.items()},
    )


def ball_facts(ball: Ball) -> BallFacts:
    """Facts of a ball."""
    circle = [ball.circle.x, ball.circle.y, ball.circle.radius]
    return BallFacts(ball.by_hand, circle, ball.residual, ball.seen, ball.centre.tolist(), ball.radius)


def mixing_lines(found: MixingFound, off: float | None) -> list[str]:
    """Lines on the mixing matrix and how well it explains the photo. off: `lambertian_error` in degrees."""
    lines = [
        f"{channel.rjust(6)}: " + "  ".join(f"{value:6.3f}" for value in row)
        for channel, row in zip(CHANNELS, found.mixing, strict=True)
    ]
    if not found.determined:
        lines.append("the lights' strengths alone: the photo does not show how their colours mix")
    left_out = f"{found.left_out:.1%} of {found.pixels} pixels left out"
    lines.append(f"{found.residual:.2%} of the brightness unexplained, {left_out}")
    if off is not None:
        lines.append(f"equation 2 finds the ball's normals to {off:.1f}° where all three lights reach")
    return lines
