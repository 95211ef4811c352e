"""The results of a calibration as plain data for programs and as lines for people."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.capture.calibrate.ball import Ball
from mpsnet_core.capture.calibrate.lights import LightsFound
from mpsnet_core.capture.calibrate.mixing import MixingFound
from mpsnet_core.scene.rig import angles_of

COLOURS = ("red", "green", "blue")


def directions_data(
    directions: NDArray[np.float64], names: Sequence[str], files: Sequence[str] | None
) -> list[dict[str, Any]]:
    """Each light's name, unit direction in camera space, slant and tilt in degrees, and the file that shows it.

    directions: (N, 3).
    """
    lights = []
    for number, (name, direction) in enumerate(zip(names, directions, strict=True)):
        slant, tilt = (float(angle) for angle in angles_of(direction))
        shown = {} if files is None else {"file": files[number]}
        lights.append({"name": name, **shown, "direction": direction.tolist(), "slant": slant, "tilt": tilt})
    return lights


def lights_data(found: LightsFound, names: Sequence[str], files: Sequence[Path] | None) -> list[dict[str, Any]]:
    """Also each light's uncertainty in degrees, its highlight on each ball, and its position where that is known."""
    lights = directions_data(found.directions, names, None if files is None else [file.name for file in files])
    for k, light in enumerate(lights):
        light["uncertainty"] = float(found.uncertainties[k])
        light["highlights"] = [
            {
                "ball": number,
                "x": spot.x,
                "y": spot.y,
                "radius": spot.radius,
                "clipped": spot.clipped,
                "rival": spot.rival,
                "colour": list(spot.colour),
            }
            for number, spot in enumerate(sighting.highlights[k] for sighting in found.sightings)
        ]
        if found.positions is not None and found.position_uncertainties is not None and found.gaps is not None:
            light["position"] = found.positions[k].tolist()
            light["position_uncertainty"] = float(found.position_uncertainties[k])
            light["gap"] = float(found.gaps[k])
    return lights


def light_line(light: dict[str, Any]) -> str:
    """A light of :func:`directions_data` or :func:`lights_data` for people."""
    shown = f" ({light['file']})" if "file" in light else ""
    line = f"{light['name'].rjust(6)}{shown}: slant {light['slant']:.2f}°, tilt {light['tilt']:.2f}°"
    if "uncertainty" in light:
        line += f", ± {light['uncertainty']:.2f}°"
    if "position" in light:
        place = ", ".join(f"{value:.4g}" for value in light["position"])
        line += f"; at {place}, ± {light['position_uncertainty']:.2g}, rays meet to {light['gap']:.2g}"
    clipped = any(spot["clipped"] for spot in light.get("highlights", ()))
    return line + (" (clipped)" if clipped else "")


def ball_data(ball: Ball) -> dict[str, Any]:
    """Where a ball is in the photo, in pixels, and in camera space; how well its outline is known."""
    circle = ball.circle
    return {
        "by_hand": ball.by_hand,
        "circle": [circle.x, circle.y, circle.radius],
        "residual": ball.residual,
        "seen": ball.seen,
        "centre": ball.centre.tolist(),
        "radius": ball.radius,
    }


def ball_line(ball: dict[str, Any]) -> str:
    """A ball of :func:`ball_data` for people."""
    x, y, radius = ball["circle"]
    line = f"  ball: {x:.1f},{y:.1f},{radius:.1f} pixels"
    if ball["by_hand"]:
        return f"{line}, given by hand"
    return f"{line}, {ball['seen']:.0%} of its outline seen, fits to {ball['residual']:.2f} pixels"


def mixing_lines(found: MixingFound) -> list[str]:
    """The mixing matrix for people, and how well it explains the photo."""
    lines = [
        f"{channel.rjust(6)}: " + "  ".join(f"{value:6.3f}" for value in row)
        for channel, row in zip(COLOURS, found.mixing, strict=True)
    ]
    if not found.determined:
        lines.append("the lights' strengths alone: the photo does not show how their colours mix")
    left_out = f"{found.left_out:.1%} of {found.pixels} pixels left out"
    return [*lines, f"{found.residual:.2%} of the brightness unexplained, {left_out}"]
