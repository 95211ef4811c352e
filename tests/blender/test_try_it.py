"""Try It, Before / After and Relight, with the mouse; what the guided tour shows is photographed on the way."""

import os
from pathlib import Path

import numpy as np
import pytest
from live import EDITORS, Window

# What these do, the panel's tests and those of its states do as well.
for_the_docs = pytest.mark.skipif(
    not os.environ.get("MPSNET_SCREENSHOTS"), reason="takes pictures for the docs; MPSNET_SCREENSHOTS names the folder"
)


# Where the dividers of Before / After are at first, as shares of the width of viewport and tools.
DIVIDERS = 0.5, 0.62


def viewport(window: Window) -> np.ndarray:
    """(H, W, 3) of the viewport without its sidebar."""
    left, top, _, height = window.state["sidebar"]
    return window.screenshot()[top : top + height, :left]


def work(window: Window, operator: str, **settings) -> None:
    window.ask("invoke", operator, settings)
    window.wait(lambda state: not state["running"], f"end of {operator}")


def sweep(window: Window, right: int, top: int) -> None:
    """The light once around the object, and then both dividers over it and back."""
    for angle in np.arange(0, 2 * np.pi, np.pi / 12):
        x, y = right * (0.55 + 0.4 * np.cos(angle)), top + 400 - 300 * np.sin(angle)
        window.input("mousemove", round(x), round(y), "sleep", "0.4")
    dividers = [round(right * share) for share in DIVIDERS]
    for number, divider in enumerate(dividers):
        window.input("mousemove", divider, top + 700, "mousedown", 1)
        for x in [*np.linspace(divider, right * (0.55 if number else 0.6), 8), *[divider] * 2]:
            window.input("mousemove", round(float(x)), top + 700, "sleep", "0.4")
        window.input("mouseup", 1)


def test_try_it_ends_in_before_and_after_and_then_in_relight(unfolded, album):
    window = unfolded
    with window.larger():
        button = window.find("mps.try_it")
        with window.film(album / "try_it.webp") as hold:
            window.click(*button)
            for name in ("MPS Photo", "MPS Normals"):
                window.wait(lambda state, name=name: name in state["images"], name)
                hold()
            window.wait(lambda state: "MPS White Lamp" in state["objects"], "result of Try It")
            done = window.wait(lambda state: not state["running"], "end of Try It")
            window.wait_for_shaders()
            hold()
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
    if os.environ.get("MPSNET_SCREENSHOTS"):
        with window.larger(), window.film(album / "before_after.webp"):
            sweep(window, *window.state["sidebar"][:2])
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


STATUE = """
import runpy
made = runpy.run_path({script!r})
made["photographed"]({photo!r}, 512)
made["statue"].hide_set(True)
bpy.context.scene.mps.bake.target = bpy.context.view_layer.objects.active = made["plain"]
bpy.ops.object.select_all(action="DESELECT")
"""
VIEW = """
from mathutils import Euler
area = next(area for area in bpy.context.screen.areas if area.type == "VIEW_3D")
view, shading = area.spaces.active.region_3d, area.spaces.active.shading
view.view_location, view.view_distance, view.view_rotation = {}, {}, Euler({}).to_quaternion()
shading.type = {!r}
"""


def photographed(window: Window, folder: Path) -> None:
    """The statue's plain mesh, the bake's target, and the rig that has taken the statue's photo."""
    script = Path(__file__).with_name("scripts") / "statue.py"
    window.ask("run", STATUE.format(script=str(script), photo=str(folder / "photo.exr")))


@for_the_docs
def test_a_statue_is_displaced_and_a_material_is_made(unfolded, album, tmp_path):
    window = unfolded
    photographed(window, tmp_path)
    work(window, "estimate")
    work(window, "bake", size=1024, output=str(tmp_path / "statue.png"))
    work(window, "displace", method="MODIFIER", output=str(tmp_path / "height.exr"))
    work(window, "integrate", mesh=False, curvature=True, output=str(tmp_path / "view.exr"))
    window.ask("run", VIEW.format((0.8, 0, 0), 5, (1.3, 0, 0.2), "SOLID"))
    window.photograph(album / "tour_height.png", "MPS_PT_heights", "MPS_PT_displace")
    window.ask(
        "run",
        "mps = bpy.context.scene.mps\n"
        "bpy.ops.mesh.primitive_grid_add(x_subdivisions=500, y_subdivisions=500, size=2)\n"
        "plaster = bpy.context.object\n"
        "texture = bpy.data.textures.new('Grain', 'VORONOI'); texture.noise_scale = 0.1\n"
        "modifier = plaster.modifiers.new('Grain', 'DISPLACE')\n"
        "modifier.texture, modifier.strength = texture, 0.04\n"
        "bpy.ops.mps.new_rig(); bpy.ops.mps.add_rig(view='TOP')\n"
        "mps.rig.camera.data.ortho_scale = 1.8\n"
        "for name in ('statue', 'Carved'): bpy.data.objects[name].hide_render = True",
    )
    work(window, "render_photo", width=512, height=512, samples=8, output=str(tmp_path / "plaster.exr"))
    work(window, "make_material", repeats=3, output=str(tmp_path / "plaster"))
    window.ask(
        "run",
        "plane = bpy.context.scene.mps.material.plane\n"
        "for obj in bpy.context.view_layer.objects: obj.hide_set(obj != plane)\n"
        + VIEW.format("plane.location", 7, (0.79, 0, 0.35), "MATERIAL"),
    )
    window.input("sleep", "6")
    window.photograph(album / "tour_material.png", "MPS_PT_material")
    assert not any(window.state["errors"].values())


@for_the_docs
def test_a_statue_is_baked_from_all_around(unfolded, album, tmp_path):
    window = unfolded
    photographed(window, tmp_path)
    window.ask(
        "run",
        "import math, mathutils\nscene = bpy.context.scene\nrig = scene.mps.rig\n"
        "front = rig.target.matrix_world.copy()\n"
        "for number in range(4):\n"
        "    rig.target.matrix_world = mathutils.Matrix.Rotation(math.pi / 2 * number, 4, 'Z') @ front\n"
        "    bpy.context.view_layer.update()\n"
        f"    name = {str(tmp_path / 'side')!r} + f'{{number}}.exr'\n"
        "    bpy.ops.mps.render_photo(width=512, height=512, samples=8, output=name)\n"
        "    camera = bpy.data.objects.new(f'Side {number}', rig.camera.data.copy())\n"
        "    camera.matrix_world = rig.camera.matrix_world\n"
        "    scene.collection.objects.link(camera)\n"
        "    camera.data.background_images.new().image = bpy.data.images.load(name)\n"
        "for obj in (*(light.object for light in rig.lights), rig.camera): obj.hide_set(True)",
    )
    window.ask("set", "bake", {"size": 1024, "output": str(tmp_path / "around.png")})
    work(window, "bake_views")
    window.ask(
        "run",
        VIEW.format((0.8, 0, 0), 9, (1.2, 0, 0.5), "MATERIAL")
        + "shading.use_scene_lights, shading.use_scene_world, shading.studiolight_intensity = True, False, 0.2",
    )
    window.input("sleep", "6")
    window.photograph(album / "panel_views.png", "MPS_PT_views")
    assert (tmp_path / "around_report.html").is_file()
    assert not any(window.state["errors"].values())
