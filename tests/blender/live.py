"""A Blender with a window on a real screen: what it is asked, where its buttons are, and how it looks."""

import json
import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
FILM = 44  # frames of a film, at most
LARGER = "view = bpy.context.preferences.view\nview.ui_scale, view.show_tooltips = {}, {}"
POINTER = ((0, 0), (0, 20), (5, 15), (9, 24), (13, 22), (9, 14), (16, 14))
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

    def wait_for_shaders(self) -> None:
        """Until what is in the middle of the viewport is drawn."""
        left, top, _, height = self.state["sidebar"]
        rows, columns = (slice(size // 3, size * 2 // 3) for size in (height, left))
        self.see(lambda: self.screenshot()[top:][rows, columns].std(), lambda spread: spread > 0.1, "object")

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

    @contextmanager
    def larger(self) -> Iterator[None]:
        """Text that can be read in a film, which is smaller than the screen, and no tooltips."""
        self.ask("run", LARGER.format(1.3, False))
        self.input("mousemove", 300, 880, "sleep", "1")
        yield
        self.ask("run", LARGER.format(1, True))
        self.input("sleep", "1")

    @contextmanager
    def film(self, path: Path, width: int = 1000) -> Iterator[Callable[[], None]]:
        """An animated WebP of viewport and sidebar as long as the context lasts, without times when nothing changes.

        Only where MPSNET_SCREENSHOTS says where it goes. It needs Pillow.
        Yields what to call while something is to be looked at, which is then shown longer.
        """
        if not os.environ.get("MPSNET_SCREENSHOTS"):
            yield lambda: None
            return
        frames, changes, ended = [], [], threading.Event()
        times = {}  # of a frame by its identity, in milliseconds

        def hold() -> None:
            time.sleep(2)
            changes[-1], times[id(frames[-1])] = EDITORS * BELOW, 1000

        def record() -> None:
            while not ended.is_set():
                frame = self._filmed(width)
                changed = np.abs(np.subtract(frame, frames[-1], dtype=np.int16)) if frames else np.array(frame)
                if (count := np.count_nonzero(changed.max(axis=-1) > 12)) > 60:
                    frames.append(frame)
                    changes.append(count)
                ended.wait(0.2)

        recorder = threading.Thread(target=record)
        recorder.start()
        try:
            yield hold
        finally:
            ended.set()
            recorder.join()
        while len(frames) > FILM:
            least = 1 + int(np.argmin(changes[1:-1]))
            changes[least + 1] += changes.pop(least)
            frames.pop(least)
        shown = [*(times.get(id(frame), 130) for frame in frames[:-1]), 2000]
        frames[0].save(path, save_all=True, append_images=frames[1:], duration=shown, loop=0, quality=60, method=6)

    def _filmed(self, width: int) -> Any:
        """Pillow's image of viewport and sidebar, with the mouse pointer, which the screen's own picture has not."""
        from PIL import Image, ImageDraw

        file = self.file.with_name("frame.bmp")
        look = ["sh", "-c", f"import -window root '{file}' && xdotool getmouselocation"]
        told = subprocess.run([*self.screen, *look], check=True, capture_output=True, text=True).stdout
        x, y = (int(word[2:]) for word in told.split()[:2])
        with Image.open(file) as picture:
            shown = picture.convert("RGB")
        ImageDraw.Draw(shown).polygon([(x + right, y + down) for right, down in POINTER], "white", "black")
        return shown.crop((0, 24, EDITORS, BELOW)).resize((width, width * (BELOW - 24) // EDITORS))


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
