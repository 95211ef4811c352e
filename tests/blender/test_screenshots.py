"""Every state of every step of the panel, photographed in a real window in the dark theme; those of a new scene also
twice as large in the light one, and in German.

Twice as large, a line has twice the room: what a state adds fits as it does at the usual size.

The pictures are left in the folder that MPSNET_SCREENSHOTS names, to look at; what can be measured is asserted: that a
panel is drawn at all, that its text can be told from what is behind it, and that no line of text is cut off.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from live import IN_GERMAN, Window, drawn, save

SETTLE = "0.3"  # seconds in which Blender sees where the mouse is
THEME = """
import os
folder = bpy.utils.preset_paths("interface_theme")[0]
bpy.ops.script.execute_preset(
    menu_idname="USERPREF_MT_interface_theme_presets", filepath=os.path.join(folder, "Blender_{}.xml")
)
"""
LOOKS = {"1x": (1, "Dark"), "2x": (2, "Light"), "german": (1, "Light")}  # the scale and the theme
# What is beside the panel costs most of a redraw, and no picture shows it.
PLAIN = """
space = next(area for area in bpy.context.screen.areas if area.type == "VIEW_3D").spaces.active
space.shading.type, space.overlay.show_overlays, space.show_gizmo = "WIREFRAME", False, False
"""
EMISSION = """
shader = bpy.data.objects["Cube"].active_material.node_tree.nodes["Principled BSDF"]
shader.inputs["Emission Strength"].default_value = {}
"""
# Lines that end with an ellipsis, on a panel and in a box; and one in the middle of which Blender puts it itself.
PROBE = """
LETTERS = ("ab", "iab", "tab", "jab")
class MPS_PT_probe(bpy.types.Panel):
    bl_space_type, bl_region_type, bl_category, bl_label = "VIEW_3D", "UI", "MPS", "Probe"
    long = 0
    def draw(self, context):
        for layout in (self.layout, self.layout.box()):
            for letters in LETTERS:
                layout.label(text="clipped, as it has more words than fit" * self.long + letters + "\u2026")
bpy.utils.register_class(MPS_PT_probe)
"""
INK = 0.2  # what text differs by from what is behind it, at least

STEPS = {
    "rig": ("MPS_PT_start", "MPS_PT_rig", "MPS_PT_rig_placement"),
    "calibrate": ("MPS_PT_lights", "MPS_PT_calibrate", "MPS_PT_outline"),
    "photo": (
        "MPS_PT_photo",
        "MPS_PT_render",
        "MPS_PT_align",
        "MPS_PT_mask",
        "MPS_PT_real",
        "MPS_PT_colour",
        "MPS_PT_superpose",
    ),
    "estimate": ("MPS_PT_estimate", "MPS_PT_estimate_options"),
    "bake": ("MPS_PT_bake", "MPS_PT_texture", "MPS_PT_detail"),
    "heights": ("MPS_PT_heights", "MPS_PT_displace"),
    "views": ("MPS_PT_views",),
    "material": ("MPS_PT_material", "MPS_PT_material_crop"),
}


@dataclass
class Photographer:
    """Photographs steps of the panel, and collects what is wrong with them."""

    window: Window
    folder: Path
    look: str
    ellipsis: "Ellipsis" = field(init=False)
    faults: list[str] = field(default_factory=list)
    scale: int = 1
    still: list[str] = field(default_factory=list)  # panels that do not scroll

    def __post_init__(self) -> None:
        self.scale, theme = LOOKS[self.look]
        self.window.ask("run", THEME.format(theme))
        if self.look == "german":
            self.window.ask("run", IN_GERMAN)
        self.window.ask("run", f"bpy.context.preferences.view.ui_scale = {self.scale}")
        self.window.ask("run", PLAIN)
        self.window.input("sleep", "1")
        self.ellipsis = Ellipsis.photographed(self.window, self.scale)

    def judge(self) -> None:
        assert not self.faults, "\n".join(self.faults)
        # A panel may end where the picture does; many such mean that a message covers them, or keeps the mouse.
        assert len(self.still) < 6, self.still

    def photograph(self, state: str, *steps: str) -> None:
        for step in steps or STEPS:
            self.window.ask("alone", *STEPS[step])
            self.window.input("mousemove", 20, 980, "sleep", SETTLE)
            self._photograph(f"{self.look}_{state}_{step}")

    def _photograph(self, name: str) -> None:
        picture = self._look(f"{name}.png")
        left, top, _, height = self.window.state["sidebar"]
        if self.scale == 2 and drawn(picture)[-60:].any():  # there is more below
            over = ("mousemove", left + 100, top + height // 2)
            self.window.input(*over, "sleep", "0.2", "click", "--repeat", 20, "--delay", 12, 5)
            self.window.input("mousemove", 20, 980, "sleep", SETTLE)
            below = self._look(f"{name}_below.png")
            if np.abs(below - picture).max(axis=-1).mean() < 0.01:
                self.still.append(name)
            self.window.input(*over, "sleep", "0.2", "click", "--repeat", 20, "--delay", 12, 4)

    def _look(self, name: str) -> np.ndarray:
        left, top, width, height = self.window.state["sidebar"]
        picture = self.window.screenshot()[top : top + height, left : left + width]
        save(self.folder / name, picture)
        shown = drawn(picture).mean()
        if shown < 0.05:
            self.faults.append(f"{name}: {shown:.1%} of its rows show anything, so it is empty or without contrast")
        for row, column in self.ellipsis.found(picture.mean(axis=-1)):
            self.faults.append(f"{name}: text that does not fit is cut off near row {row}, column {column}")
        return picture


@dataclass(frozen=True)
class Ellipsis:
    """How "…" looks on a panel's and on a box's background: Blender puts it where it leaves out what does not fit."""

    templates: np.ndarray  # (N, height, width), values 0 to 1

    @classmethod
    def photographed(cls, window: Window, scale: int) -> "Ellipsis":
        """As labels of a panel of our own end with it, at all the places between two pixels that it can have."""
        window.ask("run", PROBE)
        window.ask("alone")  # not before it: without any panel the sidebar loses its tab
        window.input("mousemove", 20, 980, "sleep", "1")
        left, top, width, height = window.state["sidebar"]
        screen = window.screenshot().mean(axis=-1)[top : top + height]
        grey = screen[30 * scale :, left + 14 * scale : left + width * 3 // 5]  # below the title, within the box
        band, templates = np.abs(grey[:, 1:] - grey[:, :-1]).max(axis=1) > INK, []
        starts = np.flatnonzero(np.diff(np.r_[0, band.astype(int)]) == 1)
        ends = np.flatnonzero(np.diff(np.r_[band.astype(int), 0]) == -1)
        for start, end in zip(starts, ends, strict=True):
            columns = np.flatnonzero(np.ptp(grey[start : end + 1], axis=0) > INK)
            if not 6 * scale < end - start < 20 * scale:
                continue  # the edge of a box, not a line of text
            if len(templates) == 8:
                break
            bottom = max(np.flatnonzero(np.ptp(grey[start : end + 1, columns[-1] - 2 : columns[-1] + 1], axis=1) > 0.1))
            last = start + bottom + 2
            templates.append(grey[last - 9 * scale : last, columns[-1] + 2 - 10 * scale : columns[-1] + 2])
        window.ask("alone", *STEPS["rig"])
        window.ask("run", "bpy.utils.unregister_class(bpy.types.MPS_PT_probe)")
        return cls(np.stack(templates))

    def found(self, grey: np.ndarray) -> list[tuple[int, int]]:
        """(row, column) of each place of a picture (H, W) where it stands."""
        _, height, width = self.templates.shape
        patterns = self.templates - self.templates.mean(axis=(1, 2), keepdims=True)
        patterns /= np.linalg.norm(patterns, axis=(1, 2), keepdims=True)
        # The normalised cross-correlation with every template, at all places at once.
        (whole,), (squares,) = (summed(one, np.ones((1, height, width))) for one in (grey, grey**2))
        variation = squares - whole**2 / (height * width)
        likeness = summed(grey, patterns).max(axis=0) / np.sqrt(variation.clip(INK**2))
        windows = np.lib.stride_tricks.sliding_window_view(grey, (height, width))
        grounds = np.median(self.templates, axis=(1, 2))
        return [
            (int(row), int(column))
            for row, column in np.argwhere(likeness > 0.95)
            if np.ptp(windows[row, column]) > INK and np.abs(np.median(windows[row, column]) - grounds).min() < 0.015
        ]


def summed(grey: np.ndarray, patterns: np.ndarray) -> np.ndarray:
    """(N, H - h + 1, W - w + 1) sums of a picture (H, W) times each pattern (N, h, w) laid on every place of it."""
    size = [64 * -(-length // 64) for length in grey.shape]  # a prime number of rows takes several times as long
    spectra = np.fft.rfft2(grey, size) * np.fft.rfft2(patterns, size).conj()
    _, height, width = patterns.shape
    return np.fft.irfft2(spectra, size)[:, : len(grey) - height + 1, : grey.shape[1] - width + 1]


def check_cut_off_text_is_seen(window: Window, ellipsis: Ellipsis) -> None:
    """The measure can fail: it finds what Blender cuts off, and nothing where all fits."""
    for probe, expected in ((PROBE.replace("long = 0", "long = 1"), True), (PROBE.replace("…", ""), False)):
        window.ask("run", probe)
        window.ask("alone")
        window.input("mousemove", 20, 980, "sleep", "1")
        left, top, width, height = window.state["sidebar"]
        screen = window.screenshot().mean(axis=-1)
        assert bool(ellipsis.found(screen[top : top + height, left : left + width])) == expected
        window.ask("alone", *STEPS["rig"])
        window.ask("run", "bpy.utils.unregister_class(bpy.types.MPS_PT_probe)")


@pytest.mark.parametrize("look", LOOKS)
def test_every_state_of_every_step(unfolded, album, tmp_path, look):
    window = unfolded
    photographer = Photographer(window, album, look)
    check_cut_off_text_is_seen(window, photographer.ellipsis)

    def run(code: str) -> None:
        window.ask("run", code)

    def work(operator: str, **settings) -> None:
        window.input("mousemove", 300, 300)
        window.ask("invoke", operator, settings)
        window.wait(lambda state: not state["running"], f"end of {operator}")
        window.input("sleep", SETTLE, "key", "Escape")  # takes away Blender's message, which covers the panel at 2x

    run("for obj in bpy.data.objects: obj.select_set(False)\nbpy.context.view_layer.objects.active = None")
    photographer.photograph("to_do")
    run("bpy.context.scene.mps.way = 'RENDER'")
    photographer.photograph("to_do_render", "rig", "photo")
    if look != "1x" and not os.environ.get("MPSNET_SCREENSHOTS"):  # the other pictures are for people to look at
        photographer.judge()
        return
    run("bpy.data.objects['Camera'].select_set(True)")  # around which no rig can stand
    work("add_rig")
    photographer.photograph("failed", "rig")
    run(
        "bpy.ops.mps.dismiss(verb='add_rig'); cube = bpy.data.objects['Cube']; cube.select_set(True)\n"
        "bpy.data.objects['Camera'].select_set(False)\n"
        "bpy.context.view_layer.objects.active = cube"
    )
    photographer.photograph("ready", "rig")
    work("add_rig", light_type="AREA", projection="PERSPECTIVE")
    photographer.photograph("done", "rig")
    photographer.photograph("ready", "photo")
    run(EMISSION.format(1))
    work("render_photo", width=512, height=512, samples=4, output=str(tmp_path / "photo.exr"))
    photographer.photograph("failed", "photo")
    run(EMISSION.format(0))
    window.ask("invoke", "render_photo", {"samples": 1000})
    window.wait(lambda state: state["progress"] > 0 or not state["running"], "progress of the photo")
    photographer.photograph("running", "photo")
    window.input("mousemove", 500, 500, "key", "Escape")
    window.wait(lambda state: not state["running"], "end of the cancelled photo")
    work("render_photo", samples=4, output=str(tmp_path / "photo.exr"))
    work("show_mask", mask="FIND")
    photographer.photograph("done", "photo")
    photographer.photograph("ready", "estimate")
    work("estimate", model="FILE", model_file=str(tmp_path / "a model that is not there.onnx"))
    photographer.photograph("failed", "estimate")
    window.ask("invoke", "estimate", {"model": "MULTISCALE"})
    window.wait(lambda state: state["progress"] > 0.05, "progress of the estimate")
    photographer.photograph("running", "estimate")
    window.wait(lambda state: not state["running"], "normals")
    photographer.photograph("done", "estimate")
    photographer.photograph("ready", "bake")
    run("bpy.context.scene.mps.bake.uv_map = 'Gone'")
    work("bake")
    photographer.photograph("failed", "bake")
    window.ask("invoke", "bake", {"uv_map": "", "size": 8192, "output": str(tmp_path / "large.png")})
    window.wait(lambda state: state["left"] or not state["running"], "time left of the bake")
    photographer.photograph("running", "bake")
    window.input("mousemove", 500, 500, "key", "Escape")
    window.wait(lambda state: not state["running"], "end of the cancelled bake")
    work("bake", size=256, output=str(tmp_path / "texture.png"))
    photographer.photograph("done", "bake")
    photographer.photograph("ready", "heights", "material")
    work("integrate", distance=5, faces=1000, output=str(tmp_path / "height.exr"))
    work("displace", levels=1, output=str(tmp_path / "missing" / "displacement.exr"))
    photographer.photograph("failed", "heights")
    work("displace", output=str(tmp_path / "displacement.exr"))
    photographer.photograph("done", "heights")
    work("make_material", output=str(tmp_path / "material"))
    photographer.photograph("failed", "material")
    sides = {f"crop_{side}": 200 for side in ("left", "right", "top", "bottom")}
    work("make_material", width=2.0, **sides)
    photographer.photograph("done", "material")
    run(
        "light = bpy.data.objects['MPS Red']; light.location.x += 1\nmps = bpy.context.scene.mps\n"
        "mps.estimate.model = 'LAMBERTIAN'; mps.bake.size = 512\n"
        "mps.heights.method = 'BILATERAL'; mps.displace.levels = 2; mps.material.bend = 2"
    )
    photographer.photograph("out_of_date", "photo", "estimate", "bake", "heights", "material")
    run("bpy.ops.mps.new_rig()")
    photographer.photograph("several", "rig", "photo", "bake")
    run(f"bpy.ops.mps.open_photo(filepath={str(tmp_path / 'photo.exr')!r})")
    photographer.photograph("opened", "rig", "photo", "estimate")
    photographer.judge()
