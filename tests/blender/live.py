"""A Blender with a window on a real screen: what it is asked, where its buttons are, and how it looks."""

import json
import os
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

EDITORS = 1310  # where Blender's other editors begin, right of the viewport and its sidebar, in pixels
BELOW = 905  # and below it
STEP = 8  # pixels; a button is about 20 high
# How long to wait for what will come: a busy machine draws a window in software, and takes a minute for some frames.
PATIENCE = 300  # seconds
IN_GERMAN = """
view = bpy.context.preferences.view
view.language, view.use_translate_interface, view.use_translate_tooltips = "de_DE", True, True
"""


class Window:
    """A Blender with a window, which says in `state` how things stand; see scripts/window.py."""

    def __init__(self, state: Path, request: Path, screen: list[str]) -> None:
        self.file, self.request, self.screen = state, request, screen
        self.requests = 0

    @property
    def state(self) -> dict[str, Any]:
        return json.loads(self.file.read_text(encoding="utf-8")) if self.file.exists() else {"sidebar": None}

    def wait(self, until: Callable[[dict[str, Any]], Any], what: str) -> dict[str, Any]:
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            state = self.state
            if until(state):
                return state
            time.sleep(0.02)
        pytest.fail(f"after {PATIENCE} s still no {what}: {self.state}")

    def input(self, *arguments: str | int) -> None:
        subprocess.run([*self.screen, "xdotool", *map(str, arguments)], check=True, capture_output=True)

    def ask(self, verb: str, *arguments: Any) -> None:
        self.requests += 1
        unfinished = self.request.with_suffix(".unfinished")
        unfinished.write_text(json.dumps([self.requests, verb, *arguments]), encoding="utf-8")
        unfinished.replace(self.request)
        if verb != "quit":
            self.wait(lambda state: state.get("answered") == self.requests, f"answer to {verb} {arguments}")

    def under_mouse(self, x: int, y: int) -> str:
        """The Python command of the button at (x, y), which Blender copies on Ctrl C; "" where there is none."""
        self.ask("clear")
        # The first move may only leave the button before.
        self.input("mousemove", x - 2, y, "sleep", "0.05", "mousemove", x, y, "sleep", "0.05", "key", "ctrl+c")
        sent, answer_by = self.state["ticks"], time.monotonic() + 0.3

        def over(state: dict[str, Any]) -> bool:
            return state["clipboard"] or (state["ticks"] >= sent + 3 and time.monotonic() > answer_by)

        done = self.wait(over, "answer to Ctrl C")
        return done["clipboard"]

    def find(self, operator: str, below: int = STEP, at: float = 0.5) -> tuple[int, int]:
        """Where in the sidebar, looking from `below` its top to its bottom, the button of `operator` is.

        at: which share of the sidebar's width is left of where it looks.
        """
        left, top, width, height = self.state["sidebar"]
        x = left + round(width * at)
        picture = self.screenshot()[top : top + height, left : left + width]
        for y in lines(picture):
            if y >= below and self.under_mouse(x, top + y).startswith(f"bpy.ops.{operator}("):
                return x, top + y
        pytest.fail(f"no button for {operator} in the sidebar")

    def click(self, x: int, y: int) -> None:
        self.input("mousemove", x, y, "sleep", "0.2", "click", 1)

    def screenshot(self) -> np.ndarray:
        """(H, W, 3) values 0 to 1 of the whole screen, once Blender has drawn what it was asked for before."""
        seen = self.state.get("ticks", 0)
        self.wait(lambda state: state.get("ticks", 0) >= seen + 3, "tick")  # it draws between two of them
        path = self.file.with_name("screen.bmp")  # to compress it takes ten times as long
        subprocess.run([*self.screen, "import", "-window", "root", path], check=True)
        return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[..., :3]

    def see(self, look: Callable[[], Any], until: Callable[[Any], Any], what: str) -> Any:
        """What `look` shows as soon as it is as it should be: how long Blender takes to draw, nobody knows."""
        deadline = time.monotonic() + PATIENCE
        while not until(seen := look()):
            if time.monotonic() > deadline:
                pytest.fail(f"after {PATIENCE} s still no {what} to be seen")
            time.sleep(0.5)
        return seen

    def photograph(self, path: Path, *panels: str, beside: int = EDITORS) -> None:
        """The viewport beside these panels alone, or beside the sidebar as it is, for a person to look at.

        beside: how many pixels of the viewport, at most. Only where MPSNET_SCREENSHOTS says where such pictures go, as
        each takes seconds.
        """
        if panels:
            self.ask("alone", *panels)
        if not os.environ.get("MPSNET_SCREENSHOTS"):
            return
        self.input("mousemove", 300, 880, "sleep", "3" if panels else "1")
        left = max(self.state["sidebar"][0] - beside, 0)
        save(path, self.screenshot()[24:BELOW, left:EDITORS])


def drawn(picture: np.ndarray) -> np.ndarray:
    """(H,) whether a row of the sidebar (H, W, 3) shows text: has an edge of some contrast, left of the tabs."""
    grey = picture.mean(axis=-1)[:, : picture.shape[1] * 9 // 10]
    return np.abs(np.diff(grey, axis=1)).max(axis=1) > 0.25


def lines(picture: np.ndarray) -> list[int]:
    """The middle row of each line of text of the sidebar (H, W, 3), and every STEP rows of what is higher."""
    ends = np.flatnonzero(np.diff(np.r_[False, drawn(picture), False]))
    return [
        y
        for start, end in zip(ends[::2], ends[1::2], strict=True)
        for y in ([int(start + end) // 2] if end - start < 3 * STEP else range(start, end, STEP))
    ]


def save(path: Path, picture: np.ndarray) -> None:
    image = oiio.ImageBuf(oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, oiio.UINT8))
    image.set_pixels(oiio.ROI(), np.ascontiguousarray(picture))
    assert image.write(str(path)), image.geterror()
