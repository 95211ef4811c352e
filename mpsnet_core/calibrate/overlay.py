"""Overlays of a calibration on the photo: outline, highlights, and the direction of each light."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.calibrate.ball import Ball, Circle
from mpsnet_core.calibrate.lights import Sighting
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.scene.pictures import font, scaled
from mpsnet_core.scene.rig import angles_of

Colour = tuple[float, float, float]
Side = Literal["left", "middle", "right"]
Point = tuple[float, float] | NDArray[np.float64]
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


def lights_picture(
    image: NDArray[np.float32], sighting: Sighting, directions: NDArray[np.float64], names: Sequence[str]
) -> NDArray[np.float32]:
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
        slant, tilt = angles_of(direction)
        canvas.label(
            f"{name}: slant {slant:.1f}°, tilt {tilt:.1f}°",
            tip,
            colour,
            side="left" if direction[0] < -0.05 else "right",
        )
    return canvas.pixels


def ball_picture(image: NDArray[np.float32], ball: Ball, words: str) -> NDArray[np.float32]:
    """(H, W, 3) display values: the ball, enlarged, with its outline and a caption."""
    canvas = _Canvas(image, ball)
    canvas.label(words, (ball.circle.x, ball.circle.y + 1.15 * ball.circle.radius), OUTLINE, side="middle")
    return canvas.pixels


class _Canvas:
    """The enlarged part of the photo around the ball. Drawing uses the photo's pixel coordinates."""

    def __init__(self, image: NDArray[np.float32], ball: Ball) -> None:
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

    def loop(self, points: NDArray[np.float64], colour: Colour) -> None:
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

    def _here(self, point: Point) -> NDArray[np.float64]:
        here: NDArray[np.float64] = (np.array(point, np.float64) - [self.left, self.top]) * self.scale
        return here
