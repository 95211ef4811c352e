"""Results of a calibration: data for programs, which `str` turns into lines for people."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.calibrate.ball import Ball
from mpsnet_core.calibrate.lights import LightsFound
from mpsnet_core.calibrate.mixing import MixingFound
from mpsnet_core.io.image import CHANNELS
from mpsnet_core.scene.rig import angles_of


@dataclass(frozen=True)
class HighlightFacts:
    """A light's highlight on a ball: see :class:`mpsnet_core.calibrate.highlights.Highlight`."""

    ball: int
    """Number of the ball."""
    x: float
    """Centre in the photo, in pixels from the left."""
    y: float
    """Centre in the photo, in pixels from the top."""
    radius: float
    """Radius of a disc of the same area, in pixels."""
    clipped: bool
    """Whether any of its pixels is saturated."""
    rival: float
    """Light of the second-best spot, as a share of this one's."""
    colour: list[float]
    """Red, green and blue, scaled to a maximum of 1."""


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
    highlights: list[HighlightFacts] | None = None
    """Its highlights, if calibrated by balls."""
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
        return line + (" (clipped)" if any(spot.clipped for spot in self.highlights or ()) else "")


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


def directions_facts(
    directions: NDArray[np.float64], names: Sequence[str], files: Sequence[str] | None
) -> list[LightFacts]:
    """Facts of lights with known directions only. directions: (N, 3)."""
    lights = []
    for number, (name, direction) in enumerate(zip(names, directions, strict=True)):
        slant, tilt = (float(angle) for angle in angles_of(direction))
        lights.append(LightFacts(name, direction.tolist(), slant, tilt, None if files is None else files[number]))
    return lights


def lights_facts(found: LightsFound, names: Sequence[str], files: Sequence[Path] | None) -> list[LightFacts]:
    """Facts of lights that were calibrated by balls."""
    lights = directions_facts(found.directions, names, None if files is None else [file.name for file in files])
    return [_light_facts(light, found, k) for k, light in enumerate(lights)]


def _light_facts(light: LightFacts, found: LightsFound, k: int) -> LightFacts:
    spots = [sighting.highlights[k] for sighting in found.sightings]
    light = replace(
        light,
        uncertainty=float(found.uncertainties[k]),
        highlights=[
            HighlightFacts(number, spot.x, spot.y, spot.radius, spot.clipped, spot.rival, list(spot.colour))
            for number, spot in enumerate(spots)
        ],
    )
    if found.positions is None or found.position_uncertainties is None or found.gaps is None:
        return light
    return replace(
        light,
        position=found.positions[k].tolist(),
        position_uncertainty=float(found.position_uncertainties[k]),
        gap=float(found.gaps[k]),
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
