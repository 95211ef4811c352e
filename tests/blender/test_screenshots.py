"""Every state of every step of the panel, photographed in a real window at two scales and in a light theme.

The pictures are left in the folder that MPSNET_SCREENSHOTS names, to look at; what can be measured is asserted: that a
panel is drawn at all, that its text can be told from what is behind it, and that no text runs into the right border.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from live import Window

SETTLE = "0.7"  # seconds in which Blender draws what has changed
LOOKS = {
    "1x": "",
    "2x": "bpy.context.preferences.view.ui_scale = 2.0",
    "light": "import os; bpy.ops.script.execute_preset(menu_idname='USERPREF_MT_interface_theme_presets', filepath="
    "next(path for path in [os.path.join(bpy.utils.preset_paths('interface_theme')[0], 'Blender_Light.xml')]))",
}
EMISSION = """
shader = bpy.data.objects["Cube"].active_material.node_tree.nodes["Principled BSDF"]
shader.inputs["Emission Strength"].default_value = {}
"""
TAB = 24  # pixels at scale 1 at the sidebar's right edge, where its tabs are
BORDER = 3  # pixels at scale 1 before the tabs that no text may touch

STEPS = {
    "rig": ("MPS_PT_rig",),
    "calibrate": ("MPS_PT_rig", "MPS_PT_calibrate", "MPS_PT_outline"),
    "photo": ("MPS_PT_photo", "MPS_PT_real", "MPS_PT_near", "MPS_PT_mask"),
    "estimate": ("MPS_PT_estimate",),
    "bake": ("MPS_PT_bake",),
    "views": ("MPS_PT_views",),
    "samples": ("MPS_PT_samples",),
}


@dataclass
class Album:
    """Photographs steps of the panel, and collects what is wrong with them."""

    window: Window
    folder: Path
    look: str
    faults: list[str] = field(default_factory=list)

    def photograph(self, state: str, *steps: str) -> None:
        for step in steps or STEPS:
            self.window.ask("alone", *STEPS[step])
            # A message of Blender's goes once the mouse has left it.
            self.window.input("mousemove", 300, 300, "sleep", "0.2", "mousemove", 20, 980, "sleep", SETTLE)
            picture = self._look(f"{self.look}_{state}_{step}.png")
            left, top, _, height = self.window.state["sidebar"]
            if self.look == "2x" and drawn(picture)[-60:].any():  # there is more below
                over = ("mousemove", left + 100, top + height // 2)
                self.window.input(*over, "click", "--repeat", 30, 5, "mousemove", 20, 980, "sleep", SETTLE)
                self._look(f"{self.look}_{state}_{step}_below.png")
                self.window.input(*over, "click", "--repeat", 30, 4)

    def _look(self, name: str) -> np.ndarray:
        left, top, width, height = self.window.state["sidebar"]
        screen = self.window.screenshot(self.folder / "screen.png")
        picture = np.ascontiguousarray(screen[top : top + height, left : left + width])
        save(self.folder / name, picture)
        self.faults += [f"{name}: {fault}" for fault in faults(picture, 2 if self.look == "2x" else 1)]
        return picture


def save(path: Path, picture: np.ndarray) -> None:
    image = oiio.ImageBuf(oiio.ImageSpec(picture.shape[1], picture.shape[0], 3, oiio.UINT8))
    image.set_pixels(oiio.ROI(), picture)
    assert image.write(str(path)), image.geterror()


def drawn(picture: np.ndarray) -> np.ndarray:
    """(H,) whether a row of pixels shows text: has an edge of some contrast, left of the tabs."""
    grey = picture.mean(axis=-1)[:, : picture.shape[1] * 9 // 10]
    return np.abs(np.diff(grey, axis=1)).max(axis=1) > 0.25


def faults(picture: np.ndarray, scale: int) -> list[str]:
    """What is wrong with a picture of the sidebar: (H, W, 3), 0 to 1."""
    grey = picture.mean(axis=-1)
    panel = grey[:, : -TAB * scale]
    found = []
    share = drawn(picture).mean()
    if share < 0.05:
        found.append(f"only {share:.1%} of its rows show anything: it is empty or without contrast")
    border = panel[:, -BORDER * scale :]
    touched = np.ptp(border, axis=1) > 0.3
    if touched.any():
        found.append(f"something touches the right border in row {int(np.argmax(touched))}")
    return found


@pytest.mark.parametrize("look", LOOKS)
def test_every_state_of_every_step(unfolded, tmp_path, look):
    window = unfolded
    folder = Path(os.environ.get("MPSNET_SCREENSHOTS") or tmp_path)
    folder.mkdir(parents=True, exist_ok=True)
    album = Album(window, folder, look)
    if LOOKS[look]:
        window.ask("run", LOOKS[look])
        window.input("sleep", "1")

    def run(code: str) -> None:
        window.ask("run", code)

    def work(operator: str, **settings) -> None:
        window.ask("invoke", operator, settings)
        window.wait(lambda state: not state["running"], 120, f"end of {operator}")

    run("for obj in bpy.data.objects: obj.select_set(False)\nbpy.context.view_layer.objects.active = None")
    album.photograph("to_do")
    work("add_rig")
    album.photograph("failed", "rig")
    run(
        "bpy.ops.mps.dismiss(verb='add_rig'); cube = bpy.data.objects['Cube']; cube.select_set(True)\n"
        "bpy.context.view_layer.objects.active = cube"
    )
    album.photograph("ready", "rig")
    work("add_rig", light_type="AREA", projection="PERSPECTIVE")
    album.photograph("done", "rig")
    album.photograph("ready", "photo")
    run(EMISSION.format(1))
    work("render_photo", width=1024, height=1024, samples=4, output=str(tmp_path / "photo.exr"))
    album.photograph("failed", "photo")
    run(EMISSION.format(0))
    work("render_photo")
    work("show_mask", mask="FIND")
    album.photograph("done", "photo")
    album.photograph("ready", "estimate")
    work("estimate", model="FILE", model_file=str(tmp_path / "a model that is not there.onnx"))
    album.photograph("failed", "estimate")
    window.ask("invoke", "estimate", {"model": "MULTISCALE_AVERAGED"})
    window.wait(lambda state: state["progress"] > 0.05, 60, "progress of the estimate")
    album.photograph("running", "estimate")
    window.wait(lambda state: not state["running"], 120, "normals")
    album.photograph("done", "estimate")
    album.photograph("ready", "bake")
    run("bpy.context.scene.mps.bake.uv_map = 'Gone'")
    work("bake")
    album.photograph("failed", "bake")
    window.ask("invoke", "bake", {"uv_map": "", "size": 8192, "output": str(tmp_path / "large.png")})
    window.wait(lambda state: state["left"] or not state["running"], 120, "time left of the bake")
    album.photograph("running", "bake")
    window.input("mousemove", 500, 500, "key", "Escape")
    window.wait(lambda state: not state["running"], 60, "end of the cancelled bake")
    work("bake", size=256, output=str(tmp_path / "texture.png"))
    album.photograph("done", "bake")
    run(
        "light = bpy.data.objects['MPS Red']; light.location.x += 1\nmps = bpy.context.scene.mps\n"
        "mps.estimate.model = 'LAMBERTIAN'; mps.bake.size = 512"
    )
    album.photograph("out_of_date", "photo", "estimate", "bake")
    run("bpy.ops.mps.new_rig()")
    album.photograph("several", "rig", "photo", "bake")
    assert not album.faults, "\n".join(album.faults)
