"""The panel in a real window: drawn, and clicked through as a person would."""

import json
import os
import shlex
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from mirror_ball import CROSSTALK, Scene, around, grey_photograph, lamps_around, photograph
from synthetic import degrees_between, shaded_sphere

from mpsnet_core.images import write_image
from mpsnet_core.rig import published_rig, read_rig, write_rig
from mpsnet_core.synthesis.job import sample_path, samples_there

SCRIPT = Path(__file__).parent / "scripts" / "window.py"
STEP = 8  # pixels; a button is about 20 high
TITLE = 16  # from a panel's top to the middle of its title


class Window:
    """A Blender with a window, which says in `state` how things stand; see scripts/window.py."""

    def __init__(self, state: Path, request: Path, screen: list[str]) -> None:
        self.file, self.request, self.screen = state, request, screen
        self.requests = 0

    @property
    def state(self) -> dict[str, Any]:
        return json.loads(self.file.read_text(encoding="utf-8")) if self.file.exists() else {"sidebar": None}

    def wait(self, until: Callable[[dict[str, Any]], Any], seconds: float, what: str) -> dict[str, Any]:
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            state = self.state
            if until(state):
                return state
            time.sleep(0.1)
        pytest.fail(f"after {seconds} s still no {what}: {self.state}")

    def input(self, *arguments: str | int) -> None:
        subprocess.run([*self.screen, "xdotool", *map(str, arguments)], check=True, capture_output=True)

    def ask(self, verb: str, *arguments: Any) -> None:
        self.requests += 1
        unfinished = self.request.with_suffix(".unfinished")
        unfinished.write_text(json.dumps([self.requests, verb, *arguments]), encoding="utf-8")
        unfinished.replace(self.request)
        if verb != "quit":
            self.wait(lambda state: state.get("answered") == self.requests, 60, f"answer to {verb} {arguments}")

    def under_mouse(self, x: int, y: int) -> str:
        """The Python command of the button at (x, y), which Blender copies on Ctrl C; "" where there is none."""
        self.ask("clear")
        self.input("mousemove", x, y, "sleep", "0.1", "key", "ctrl+c")
        sent = self.state["ticks"]
        return self.wait(lambda state: state["ticks"] >= sent + 3, 60, "answer to Ctrl C")["clipboard"]

    def find(self, operator: str, below: int = STEP) -> tuple[int, int]:
        """Where in the sidebar, looking from `below` its top to its bottom, the button of `operator` is."""
        left, top, width, height = self.state["sidebar"]
        x = left + width // 2
        for y in range(top + below, top + height, STEP):
            if self.under_mouse(x, y).startswith(f"bpy.ops.{operator}("):
                return x, y
        pytest.fail(f"no button for {operator} in the sidebar")

    def click(self, x: int, y: int) -> None:
        self.input("mousemove", x, y, "sleep", "0.2", "click", 1)

    def open(self, y: int) -> None:
        """Click on the title of a closed panel, and leave it time to unfold."""
        left, _, width, _ = self.state["sidebar"]
        self.input("mousemove", left + width // 2, y, "sleep", "1")
        self.click(left + width // 2, y)
        self.input("sleep", "2")

    def screenshot(self, path: Path) -> np.ndarray:
        """(H, W, 3) values 0 to 1 of the whole screen."""
        subprocess.run([*self.screen, "import", "-window", "root", path], check=True)
        return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)[..., :3]


@pytest.fixture
def window(blender, tmp_path) -> Iterator[Window]:
    if "MPSNET_BLENDER_UI" not in os.environ:
        pytest.skip("MPSNET_BLENDER_UI is not set")
    state, request = tmp_path / "state.json", tmp_path / "request"
    command = [*shlex.split(os.environ["MPSNET_BLENDER_UI"]), "--python", SCRIPT, "--", state, request]
    with (tmp_path / "window.log").open("w") as log:
        process = subprocess.Popen(
            command, env=blender.environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True
        )
        window = Window(state, request, shlex.split(os.environ.get("MPSNET_SCREEN", "")))
        try:
            window.wait(lambda state: state["sidebar"], 120, "sidebar")
            yield window
            window.screenshot(tmp_path / "last.png")
        finally:
            window.ask("quit")
            try:
                process.wait(30)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGTERM)


def test_panel_is_drawn_and_its_button_adds_a_rig(window, tmp_path):
    before = window.wait(lambda state: "Cube" in state["objects"], 10, "default scene")
    left, top, width, height = before["sidebar"]
    assert width > 100 and height > 400
    x, y = window.find("mps.add_rig")
    window.input("mousemove", 10, 500, "sleep", "0.5")
    picture = window.screenshot(tmp_path / "panel.png").mean(axis=-1)
    panel, button = picture[top : top + height, left : left + width], picture[y : y + STEP, left : left + width]
    # An empty or black sidebar is of one colour; the button has its label, and everything above it labels and fields.
    assert panel.std() > 0.02
    assert np.ptp(button, axis=1).max() > 0.3
    edges = np.abs(np.diff(picture[top:y, left : left + width], axis=1)) > 0.1
    assert edges.any(axis=1).mean() > 0.3

    window.click(x, y)
    after = window.wait(lambda state: len(state["objects"]) > len(before["objects"]), 60, "rig")
    added = set(after["objects"]) - set(before["objects"])
    assert {"MPS Red", "MPS Green", "MPS Blue", "MPS Camera"} <= added

    window.input("key", "ctrl+z")
    window.wait(lambda state: state["objects"] == before["objects"], 60, "undo")


def test_the_steps_run_beside_a_live_window(window, tmp_path):
    window.ask("invoke", "add_rig", {})
    window.ask("invoke", "render_photo", {"width": 128, "height": 128, "samples": 16})
    window.wait(lambda state: "MPS Photo" in state["images"], 120, "photo")

    window.ask("invoke", "estimate", {})
    # The operator came back at once, and the window goes on ticking until the normals are there.
    window.wait(lambda state: "MPS Normals" in state["images"] and not state["running"], 120, "normals")

    cancelled = tmp_path / "cancelled.png"
    window.ask("invoke", "bake", {"size": 16384, "output": str(cancelled)})
    window.wait(lambda state: state["running"] and state["progress"] > 0, 60, "running bake")
    window.input("mousemove", 500, 500, "key", "Escape")
    window.wait(lambda state: not state["running"], 60, "end of the cancelled bake")
    assert not [path.name for path in tmp_path.iterdir() if "cancelled" in path.name]

    plain = window.state["nodes"]
    texture = tmp_path / "texture.png"
    window.ask("invoke", "bake", {"size": 128, "output": str(texture)})
    window.wait(lambda state: "MPS Cube" in state["images"] and not state["running"], 120, "texture")
    assert texture.is_file()
    assert set(window.state["nodes"]) - set(plain) == {"MPS UV", "MPS Texture", "MPS Normal"}

    window.input("key", "ctrl+z")
    window.wait(lambda state: state["nodes"] == plain, 60, "undo of the bake")
    window.input("key", "ctrl+shift+z")
    window.wait(lambda state: "MPS Normal" in state["nodes"], 60, "redo of the bake")


def test_training_data_grows_in_its_section(window, tmp_path):
    folder, count = tmp_path / "samples", 24
    settings = {"count": count, "size": 32, "samples": 1, "kinds": ["BLOBS"], "processes": 2, "output": str(folder)}
    window.ask("set", "samples", settings)
    window.ask("alone", "MPS_PT_samples")
    left, top, width, height = window.state["sidebar"]
    window.open(top + TITLE)
    x, y = window.find("mps.render_samples", below=300)
    window.input("mousemove", 500, 500, "sleep", "1")
    before = window.screenshot(tmp_path / "before.png")

    window.click(x, y)
    window.wait(lambda state: state["running"] and "MPS Samples" in state["images"], 120, "contact sheet")
    window.input("mousemove", 500, 500, "sleep", "1", "key", "Escape")
    window.wait(lambda state: not state["running"], 60, "end of the cancelled rendering")
    there = samples_there(folder)
    assert 0 < len(there) < count
    assert not list(folder.glob(".*"))

    # Below the button there was nothing, and now there is a picture in colour.
    def colourful(picture):
        below = picture[y + 2 * STEP : top + height, left : left + width - 40]
        return (np.ptp(below, axis=-1) > 0.2).sum()

    shown = window.screenshot(tmp_path / "shown.png")
    assert colourful(shown) > colourful(before) + 500

    kept = {number: sample_path(folder, number).stat().st_mtime_ns for number in there}
    window.click(x, y)
    window.wait(lambda state: state["running"], 60, "rendering that goes on")
    window.wait(lambda state: not state["running"], 240, "end of the rendering")
    assert samples_there(folder) == set(range(count))
    assert {number: sample_path(folder, number).stat().st_mtime_ns for number in there} == kept
    window.input("mousemove", 500, 500, "sleep", "1")
    assert colourful(window.screenshot(tmp_path / "grown.png")) > 1.5 * colourful(shown)


def test_real_lights_are_found_and_undone(window, tmp_path):
    angles = [(30, 90), (35, 205), (25, 335)]
    directions = np.array([around(*angle) for angle in angles])
    scene = Scene([((0.0, 0.0, 0.0), 97.4)], lamps_around((0, 0, 0), 2e4, angles=angles), (300, 300))
    write_image(tmp_path / "mirror.exr", photograph(scene))
    write_image(tmp_path / "grey.exr", grey_photograph(scene, CROSSTALK, directions))
    rig = tmp_path / "rig.json"
    settings = {"ball": str(tmp_path / "mirror.exr"), "grey": str(tmp_path / "grey.exr"), "output": str(rig)}
    window.ask("set", "calibrate", settings)
    window.ask("alone", "MPS_PT_rig", "MPS_PT_calibrate")
    _, top, _, _ = window.state["sidebar"]
    _, above = window.find("mps.add_rig", below=240)
    window.open(above + 38)  # the title is next below
    lights = window.find("mps.calibrate_lights", below=above + 140 - top)

    window.click(*lights)
    window.wait(lambda state: state["rig_file"] and not state["running"], 60, "lights")
    assert "MPS Calibration" in window.state["images"]
    assert "Slant" in window.state["found"].splitlines()[0]
    assert degrees_between(read_rig(rig).directions, directions).max() < 1

    window.click(*window.find("mps.calibrate_mixing", below=lights[1] + 4 * STEP - top))
    after = window.wait(lambda state: "Channel" in state["found"] and not state["running"], 60, "mixing")
    np.testing.assert_allclose(read_rig(rig).mixing, CROSSTALK, atol=0.02)
    assert after["rig_file"] == str(rig)

    window.input("mousemove", 500, 500, "key", "ctrl+z")
    window.wait(lambda state: "Slant" in state["found"], 60, "undo of the mixing")
    window.input("key", "ctrl+z")
    window.wait(lambda state: not state["rig_file"] and "MPS Calibration" not in state["images"], 60, "undo of both")
    assert rig.is_file()


def test_the_mask_is_shown_below_its_button(window, tmp_path):
    sphere = shaded_sphere(128)
    photo = np.full((256, 256, 3), 0.01, np.float32)
    photo[64:192, 64:192][sphere.mask] = sphere.image[sphere.mask]
    write_image(tmp_path / "photo.exr", photo)
    window.ask("photo", str(tmp_path / "photo.exr"))
    window.ask("set", "estimate", {"mask": "FIND"})
    window.ask("alone", "MPS_PT_photo", "MPS_PT_mask")
    left, top, width, height = window.state["sidebar"]
    x, y = window.find("mps.show_mask", below=400)

    def below():
        window.input("mousemove", 500, 500, "sleep", "1")
        return window.screenshot(tmp_path / "screen.png")[y + 4 * STEP : top + height, left : left + width - 40]

    before = below()
    window.click(x, y)
    window.wait(lambda state: "MPS Mask" in state["images"] and not state["running"], 60, "mask")
    assert (np.abs(below() - before).max(axis=-1) > 0.1).sum() > 5000

    window.input("mousemove", 500, 500, "key", "ctrl+z")
    window.wait(lambda state: "MPS Mask" not in state["images"], 60, "undo of the mask")


def test_many_views_are_baked_and_reported(window, tmp_path):
    write_image(tmp_path / "photo.exr", np.full((64, 64, 3), 0.5, np.float32))
    write_rig(tmp_path / "rig.json", published_rig())
    texture, report = tmp_path / "texture.png", tmp_path / "texture_report.html"
    window.ask("behind", str(tmp_path / "photo.exr"))
    window.ask("set", "estimate", {"model": "LAMBERTIAN", "rig_file": str(tmp_path / "rig.json")})
    window.ask("set", "bake", {"size": 64, "output": str(texture)})
    window.ask("alone", "MPS_PT_views")
    _, top, _, _ = window.state["sidebar"]
    window.open(top + TITLE)
    plain = window.state["nodes"]
    x, y = window.find("mps.bake_views", below=200)

    window.click(x, y)
    done = window.wait(lambda state: "MPS Cube" in state["images"] and not state["running"], 60, "texture")
    assert set(done["nodes"]) - set(plain) == {"MPS UV", "MPS Texture", "MPS Normal"}
    assert texture.is_file() and "Camera" in report.read_text(encoding="utf-8")
    x, y = window.find("wm.path_open", below=y + 3 * STEP - top)
    assert str(report) in window.under_mouse(x, y)

    window.input("mousemove", 500, 500, "key", "ctrl+z")
    window.wait(lambda state: state["nodes"] == plain, 60, "undo of the bake")
    assert not window.under_mouse(x, y)
