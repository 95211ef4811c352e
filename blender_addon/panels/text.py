"""Text layout in a panel, to the width of the region, for any UI scale and script."""

from collections.abc import Callable
from typing import Any

import blf
import bpy

from mpsnet_core.errors import LONGEST, in_one_line

from ..settings.messages import in_blender

# Width around a label's text, in Blender's widget units (20 pixels at scale 1): margins of the panel, a box and the
# label, and the tabs at the region's edge.
_BESIDE = 3.2
_ICON = 1.1
_MIN_WIDTH = 4.0
_WIDGET = 20.0
_POPUP = 24.0


def sentence(text: str) -> str:
    """A message as a sentence of the panel."""
    text = in_blender(text)
    return text[:1].upper() + text[1:]


def wrapped(layout: Any, text: str, icon: str = "NONE") -> None:
    """Show a sentence wrapped over several labels: Blender cuts off a label at the panel's edge."""
    column = layout.column(align=True)
    for number, line in enumerate(lines(sentence(text), available(with_icon=icon != "NONE"), text_width)):
        column.label(text=line, translate=False, icon="BLANK1" if number and icon != "NONE" else icon)


def across_sidebar() -> float:
    """The scale at which a picture is as wide as the region, for ``template_icon``."""
    return available() / _unit() + 1


def across_popup() -> float:
    """The width of a line of text in a menu that pops up, in pixels."""
    return _POPUP * _unit()


def fitted(text: str, take: float = 0.0) -> str:
    """A text in one line, with its middle left out if it does not fit. take: widget units that other items need."""
    return shortened(text, available() - take * _unit(), text_width)


def lines(sentence: str, width: float, measure: Callable[[str], float]) -> list[str]:
    """Break a sentence at spaces into lines up to `width` wide. Longer words, such as paths, are broken anywhere."""
    broken: list[str] = []
    line = ""
    for word in in_one_line(sentence).split():
        longer = f"{line} {word}" if line else word
        if measure(longer) <= width:
            line = longer
            continue
        if line:
            broken.append(line)
        while measure(word) > width and len(word) > 1:
            fits = next((end for end in range(len(word) - 1, 1, -1) if measure(word[:end]) <= width), 1)
            broken.append(word[:fits])
            word = word[fits:]
        line = word
    return [*broken, line] if line else broken


def shortened(text: str, width: float, measure: Callable[[str], float]) -> str:
    """The text with as much of its middle as necessary replaced by "…"."""
    for kept in range(min(len(text), LONGEST), 1, -1):
        head = kept - kept // 2
        shorter = text if kept == len(text) else f"{text[:head]}…{text[len(text) - kept // 2 :]}"
        if measure(shorter) <= width:
            return shorter
    return "…"


def available(*, with_icon: bool = False) -> float:
    """Available width of a label's text in the region that is being drawn, in pixels."""
    view = bpy.context.region.view2d
    # Not the region's width: its contents may be zoomed.
    width = view.region_to_view(bpy.context.region.width, 0)[0] - view.region_to_view(0, 0)[0]
    beside = _BESIDE + _ICON if with_icon else _BESIDE
    return max(width - beside * _unit(), _MIN_WIDTH * _unit())


def text_width(text: str) -> float:
    """Width of a label's text, in pixels."""
    preferences = bpy.context.preferences
    blf.size(0, preferences.ui_styles[0].widget.points * preferences.system.ui_scale)
    return float(blf.dimensions(0, text)[0])


def _unit() -> float:
    return _WIDGET * bpy.context.preferences.system.ui_scale
