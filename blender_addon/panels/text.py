"""Text in a panel: as wide as the region allows, at every scale of the interface and in every language's letters."""

from collections.abc import Callable
from typing import Any

import blf
import bpy

from mpsnet_core.errors import LONGEST, in_one_line

# What stands left and right of a label besides its text, in Blender's unit of widgets (20 pixels at scale 1): the
# panel's and a box's margins, the label's own, and the tabs at the region's edge.
_BESIDE = 3.2
_ICON = 1.1
_LEAST = 4.0
_WIDGET = 20.0


def wrapped(layout: Any, sentence: str, icon: str = "NONE") -> None:
    """A sentence over as many labels as it takes: Blender cuts a label off where the panel ends."""
    column = layout.column(align=True)
    for number, line in enumerate(lines(sentence, available(with_icon=icon != "NONE"), text_width)):
        if icon == "NONE":
            column.label(text=line)
        else:
            column.label(text=line, icon="BLANK1" if number else icon)


def fitted(text: str, take: float = 0.0) -> str:
    """A text in one line, with its middle left out where it does not fit. take: units of widgets that others need."""
    return shortened(text, available() - take * _unit(), text_width)


def lines(sentence: str, width: float, measure: Callable[[str], float]) -> list[str]:
    """Break a sentence at its spaces into lines up to `width` wide; a longer word, a path, where it has to."""
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
    """The text with as much of its middle as must go replaced by "…"."""
    for kept in range(min(len(text), LONGEST), 1, -1):
        head = kept - kept // 2
        shorter = text if kept == len(text) else f"{text[:head]}…{text[len(text) - kept // 2 :]}"
        if measure(shorter) <= width:
            return shorter
    return "…"


def available(*, with_icon: bool = False) -> float:
    """How wide a label's text may be in the region that is drawn now, in pixels."""
    view = bpy.context.region.view2d
    # Not the region's width: its contents may be zoomed.
    width = view.region_to_view(bpy.context.region.width, 0)[0] - view.region_to_view(0, 0)[0]
    beside = _BESIDE + _ICON if with_icon else _BESIDE
    return max(width - beside * _unit(), _LEAST * _unit())


def text_width(text: str) -> float:
    """How wide a label writes a text, in pixels."""
    preferences = bpy.context.preferences
    blf.size(0, preferences.ui_styles[0].widget.points * preferences.system.ui_scale)
    return float(blf.dimensions(0, text)[0])


def _unit() -> float:
    return _WIDGET * bpy.context.preferences.system.ui_scale
