"""Markers over a photo or a viewport, and their colours, for a region's draw handler."""

from collections.abc import Iterable, Sequence

import blf
import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from mpsnet_core.estimate.alignment.points import PIXEL_ERROR, WRONG_PIXELS

from .places import Place

Colour = tuple[float, float, float]

_RADIUS = 7.0  # pixels at UI scale 1
# Colours by the residual of a pair.
OPEN, _FITS, _OFF, _WRONG = (1.0, 1.0, 1.0), (0.25, 0.9, 0.35), (1.0, 0.75, 0.15), (1.0, 0.25, 0.2)


def colour_of(residual: float, size: tuple[int, int]) -> Colour:
    """Green, yellow or red by a pair's residual in pixels, for a photo of this size; white if it is unknown."""
    unit = max(size) / 1024
    if residual < 0:
        return OPEN
    return _FITS if residual <= 2 * PIXEL_ERROR * unit else _OFF if residual <= WRONG_PIXELS * unit else _WRONG


def draw_marker(place: Place, text: str, colour: Colour, alpha: float = 1.0) -> None:
    """Draw a ring with a cross in it, and text next to it."""
    scale = bpy.context.preferences.system.ui_scale
    (x, y), reach, turns = place, 2.5 * scale, np.linspace(0, 2 * np.pi, 25)
    draw_line(_RADIUS * scale * np.stack([np.cos(turns), np.sin(turns)], axis=-1) + place, colour, alpha)
    draw_line([(x - reach, y), (x + reach, y)], colour, alpha)
    draw_line([(x, y - reach), (x, y + reach)], colour, alpha)
    draw_text((x + 11 * scale, y + 5 * scale), text, colour, alpha)


def draw_line(places: Iterable[Sequence[float]], colour: Colour, alpha: float = 1.0) -> None:
    """Draw a line through places."""
    shader, region = gpu.shader.from_builtin("POLYLINE_UNIFORM_COLOR"), bpy.context.region
    batch = batch_for_shader(shader, "LINE_STRIP", {"pos": [(*place, 0.0) for place in places]})
    gpu.state.blend_set("ALPHA")
    # A dark line beneath makes it visible on any photo.
    for width, ink in ((4.0, (0.0, 0.0, 0.0, alpha / 2)), (2.0, (*colour, alpha))):
        shader.uniform_float("viewportSize", (region.width, region.height))
        shader.uniform_float("lineWidth", width * bpy.context.preferences.system.ui_scale)
        shader.uniform_float("color", ink)
        batch.draw(shader)
    gpu.state.blend_set("NONE")


def draw_text(place: Place, text: str, colour: Colour, alpha: float = 1.0, size: float = 14.0) -> None:
    """Draw text that starts at a place."""
    blf.size(0, size * bpy.context.preferences.system.ui_scale)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 6, 0.0, 0.0, 0.0, alpha)  # an outline
    blf.position(0, *place, 0)
    blf.color(0, *colour, alpha)
    blf.draw(0, text)
    blf.disable(0, blf.SHADOW)
