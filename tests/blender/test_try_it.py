"""Try It, Before / After and Relight, with the mouse; what the guided tour shows is photographed on the way."""

import numpy as np
from live import EDITORS, Window


def viewport(window: Window) -> np.ndarray:
    """(H, W, 3) of the viewport without its sidebar."""
    left, top, _, height = window.state["sidebar"]
    return window.screenshot()[top : top + height, :left]


def test_try_it_ends_in_before_and_after_and_then_in_relight(unfolded, album):
    window = unfolded
    button = window.find("mps.try_it")
    window.click(*button)
    window.wait(lambda state: "MPS White Lamp" in state["objects"], "result of Try It")
    done = window.wait(lambda state: not state["running"], "end of Try It")
    assert {"MPS Photo", "MPS Normals", "MPS Demo Low Poly"} <= set(done["images"])
    assert not any(done["errors"].values())

    def changed(seconds: float) -> int:
        """How many pixels of the viewport are others after that time."""
        first = viewport(window)
        window.input("sleep", seconds)
        return int((np.abs(viewport(window) - first).max(axis=-1) > 0.1).sum())

    right, top = window.state["sidebar"][:2]

    def under(x: int, y: int) -> np.ndarray:
        """The viewport with the mouse there."""
        window.input("mousemove", x - 5, y, "sleep", "0.3", "mousemove", x, y, "sleep", "2")
        return viewport(window)

    def differ(one: np.ndarray, other: np.ndarray) -> int:
        return int((np.abs(one - other).max(axis=-1) > 0.1).sum())

    # The texture's relief changes with the light, which is where the mouse is; nothing moves by itself.
    lit = window.see(
        lambda: (under(right - 100, top + 150), under(right - 100, top + 550)),
        lambda two: differ(*two) > 2000,
        "light that follows the mouse",
    )
    assert changed(1.5) < 500
    window.photograph(album / "tour_try_it.png", beside=EDITORS)
    # A divider that is dragged to the right uncovers the plain mesh, which has no colours.
    colourful = np.ptp(lit[1], axis=-1).mean()
    window.input("mousemove", right - 200, top + 550, "mousedown", 1, "sleep", "0.3")
    window.input("mousemove", right - 60, top + 550, "sleep", "0.3", "mousemove", right - 20, top + 550, "mouseup", 1)
    window.see(
        lambda: np.ptp(under(right - 100, top + 550), axis=-1).mean(),
        lambda colours: colours < 0.8 * colourful,
        "more of the plain mesh",
    )
    before = window.state["objects"], window.state["images"], window.state["nodes"]
    window.input("key", "Escape", "mousemove", 300, 880)
    window.see(lambda: changed(1.5), lambda pixels: pixels > 5000, "lamp that swings")
    assert (window.state["objects"], window.state["images"], window.state["nodes"]) == before
    assert not any(window.state["errors"].values())
    window.photograph(album / "tour_relight.png", "MPS_PT_start", "MPS_PT_rig", "MPS_PT_photo")
    window.photograph(album / "tour_estimate.png", "MPS_PT_photo", "MPS_PT_estimate")
    window.photograph(album / "tour_bake.png", "MPS_PT_bake")
    window.click(*window.find("mps.relight", below=100, at=0.25))
    window.wait(lambda state: "MPS White Lamp" not in state["objects"], "end of Relight")
    window.input("mousemove", 300, 880)
    window.see(lambda: changed(1), lambda pixels: pixels < 500, "still picture")
