"""The films and pictures of Blender's window in the docs: pytest takes them in a real window.

    MPSNET_BLENDER=blender MPSNET_BLENDER_UI=blender python -m pytest -m '' examples/window_pictures.py

Leaves them in examples/output/window. tests/blender/blender_fixtures.py explains the variables. It needs xdotool,
ImageMagick and Pillow. What the tests show as well they photograph on the way: tour_try_it, tour_estimate, tour_bake,
panel_calibrate.
"""

import json
import os
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from blender_fixtures import blender, extension_zip, unfolded  # noqa: F401
from live import BELOW, EDITORS, Window
from PIL import Image, ImageDraw

HERE = Path(__file__).resolve().parent
OUTPUT = HERE / "output" / "window"
OUTPUT.mkdir(parents=True, exist_ok=True)
os.environ["MPSNET_SCREENSHOTS"] = str(OUTPUT)

WIDTH, FRAMES = 1000, 44  # of a film, at most
LENGTH, SHOWN, HELD, LAST = 12000, 220, 1000, 1500  # of a film, and of its frames at most, in milliseconds
POINTER = ((0, 0), (0, 20), (5, 15), (9, 24), (13, 22), (9, 14), (16, 14))
# Text that can be read in a film, which is smaller than the screen.
LARGER = "view = bpy.context.preferences.view\nview.ui_scale, view.show_tooltips = 1.3, False"
VIEW = """
from mathutils import Euler
area = next(area for area in bpy.context.screen.areas if area.type == "VIEW_3D")
view, shading = area.spaces.active.region_3d, area.spaces.active.shading
view.view_location, view.view_distance, view.view_rotation = {}, {}, Euler({}).to_quaternion()
shading.type = {!r}
"""


@contextmanager
def film(window: Window, name: str) -> Iterator[Callable[[], None]]:
    """An animated WebP of viewport and sidebar as long as the context lasts, without times when nothing changes.

    Yields what to call while there is something to look at, which is then shown longer.
    """
    frames, changes, times, ended = [], [], {}, threading.Event()

    def hold() -> None:
        time.sleep(2)
        changes[-1], times[id(frames[-1])] = EDITORS * BELOW, HELD

    def record() -> None:
        while not ended.is_set():
            frame = with_pointer(window)
            changed = np.abs(np.subtract(frame, frames[-1], dtype=np.int16)) if frames else np.array(frame)
            if (count := np.count_nonzero(changed.max(axis=-1) > 12)) > 60:
                changes.append(count)
                frames.append(frame)
            ended.wait(0.2)

    recorder = threading.Thread(target=record)
    recorder.start()
    try:
        yield hold
    finally:
        ended.set()
        recorder.join()
    while len(frames) > FRAMES:
        least = 1 + int(np.argmin(changes[1:-1]))
        changes[least + 1] += changes.pop(least)
        frames.pop(least)
    each = min(SHOWN, (LENGTH - sum(times.values()) - LAST) // len(frames))
    shown = [*(times.get(id(frame), each) for frame in frames[:-1]), LAST]
    path = OUTPUT / f"{name}.webp"
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=shown, loop=0, quality=60, method=6)


def with_pointer(window: Window) -> Image.Image:
    """Viewport and sidebar with the mouse pointer, which a picture of the screen lacks."""
    file = window.file.with_name("frame.bmp")
    look = ["sh", "-c", f"import -window root '{file}' && xdotool getmouselocation"]
    told = subprocess.run([*window.screen, *look], check=True, capture_output=True, text=True).stdout
    x, y = (int(word[2:]) for word in told.split()[:2])
    with Image.open(file) as picture:
        shown = picture.convert("RGB")
    ImageDraw.Draw(shown).polygon([(x + right, y + down) for right, down in POINTER], "white", "black")
    return shown.crop((0, 24, EDITORS, BELOW)).resize((WIDTH, WIDTH * (BELOW - 24) // EDITORS))


def wait_for_shaders(window: Window, painted: bool = True) -> None:
    """Until what is in the middle of the viewport is drawn: at first it is missing, and then grey."""
    left, top, _, height = window.state["sidebar"]
    rows, columns = (slice(size // 3, size * 2 // 3) for size in (height, left))

    def shown() -> float:
        middle = window.screenshot()[top:][rows, columns]
        return float(np.ptp(middle, axis=-1).mean() if painted else middle.std())

    window.see(shown, lambda value: value > (0.025 if painted else 0.08), "object")
    window.input("sleep", "10")


def statue(window: Window, folder: Path, then: str, size: int = 640) -> None:
    """The statue's photo and white photo in a folder, without the files that tell of rig and camera.

    then: Python that may use the names in statue.py.
    """
    code = (HERE / "statue.py").read_text(encoding="utf-8")
    window.ask("run", f"{code}\nphotographed({str(folder / 'rendered.exr')!r}, {size})\n{then}")
    shutil.copy(folder / "rendered.exr", folder / "photo.exr")
    shutil.copy(folder / "rendered_white.exr", folder / "white.exr")


def work(window: Window, operator: str, **settings) -> None:
    window.ask("invoke", operator, settings)
    window.wait(lambda state: not state["running"], f"end of {operator}")


# Writes the mesh, without UVs, and leaves an empty scene.
EXPORTED = """
bpy.ops.object.select_all(action="DESELECT")
plain.rotation_euler = (0, 0, 0)
plain.select_set(True)
bpy.ops.wm.obj_export(filepath={!r}, export_selected_objects=True, export_uv=False, export_materials=False)
bpy.ops.mps.remove_rig()
bpy.data.batch_remove([*bpy.data.objects, bpy.data.images["MPS Photo"]])
view = next(area for area in bpy.data.screens["Layout"].areas if area.type == "VIEW_3D").spaces.active.region_3d
view.view_location, view.view_distance = (0, 0, 0), 6
"""
# What Blender does where files are dropped onto the viewport.
DROP = """
window = bpy.context.window_manager.windows[0]
area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
region = next(region for region in area.regions if region.type == "WINDOW")
with bpy.context.temp_override(window=window, area=area, region=region):
    files = [{{"name": name}} for name in {names!r}]
    bpy.ops.wm.drop_import_file("INVOKE_DEFAULT", directory={folder!r}, files=files)
"""


def test_scan(unfolded, tmp_path):  # noqa: F811
    window = unfolded
    statue(window, tmp_path, EXPORTED.format(str(tmp_path / "statue.obj")))
    window.ask("run", LARGER)
    left, top, width, height = window.state["sidebar"]
    x, y = (left + width) // 2, top + height // 2

    def drop(*names: str) -> None:
        window.input("mousemove", x - 5, y, "sleep", "0.5", "mousemove", x, y, "sleep", "0.5")
        before = window.screenshot()
        window.ask("run", DROP.format(folder=str(tmp_path), names=names))
        window.see(lambda: (abs(window.screenshot() - before) > 0.1).sum(), lambda changed: changed > 3000, "menu")

    with film(window, "scan") as hold:
        drop("statue.obj")
        hold()
        window.input("key", "Return")
        window.wait(lambda state: state["objects"] == ["statue"], "imported mesh")
        drop("photo.exr", "white.exr")
        window.input("mousemove_relative", 0, 22, "sleep", "0.5")  # to Scan, the third entry
        hold()
        window.input("click", 1)
        for name in ("photo", "MPS Alignment", "MPS Normals"):
            window.wait(lambda state, name=name: any(image.startswith(name) for image in state["images"]), name)
            hold()
        window.wait(lambda state: "MPS White Lamp" in state["objects"], "end of the scan")
        wait_for_shaders(window)
        window.input("sleep", "20")  # while the lamp swings


# The statue alone with its photo, and where the photo shows some places of it that anyone finds again.
PLACES = """
import json
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Vector
scene, found = bpy.context.scene, []
scene.render.resolution_x = scene.render.resolution_y
for near in (-0.35, -0.9, 0.24), (0, -0.8, -0.75), (-1.2, 0, 0.45), (0, -0.6, 0.75), (0, -1, -0.1), (0.35, -0.9, 0.24):
    vertex = min(plain.data.vertices, key=lambda vertex: (vertex.co - Vector(near)).length)
    point = plain.matrix_world @ vertex.co
    found.append([list(world_to_camera_view(scene, scene.mps.rig.camera, point)[:2]), list(point)])
json.dump(found, open({!r}, "w"))
bpy.ops.mps.remove_rig()
bpy.data.batch_remove([carved, bpy.data.images["MPS Photo"]])
bpy.context.scene.mps.bake.target = plain
view = next(area for area in bpy.data.screens["Layout"].areas if area.type == "VIEW_3D").spaces.active.region_3d
view.view_rotation = Euler((1.26, 0, -0.3)).to_quaternion()
view.view_location, view.view_distance = (1.0, -0.3, 0), 6  # the sidebar hides the right half of the viewport's half
"""
# Where the window shows those places, and how far the pairs that were picked are off.
SHOWN_AT = """
import json
from bpy_extras.view3d_utils import location_3d_to_region_2d
window = bpy.context.window_manager.windows[0]
pairs = bpy.context.scene.mps.photo.image.mps.pairs
found = {{"VIEW_3D": [], "IMAGE_EDITOR": [], "off": [pair.residual for pair in pairs]}}
for area in window.screen.areas:
    if area.type in found:
        region, space = next(region for region in area.regions if region.type == "WINDOW"), area.spaces.active
        for place, point in {places!r}:
            if area.type == "VIEW_3D":
                x, y = location_3d_to_region_2d(region, space.region_3d, point)
            else:
                x, y = region.view2d.view_to_region(*place)
            found[area.type].append([round(region.x + x), round(window.height - 1 - region.y - y)])
json.dump(found, open({path!r}, "w"))
"""


def test_pick_points(unfolded, tmp_path):  # noqa: F811
    window, path = unfolded, tmp_path / "places.json"
    statue(window, tmp_path, PLACES.format(str(path)))
    places = json.loads(path.read_text(encoding="utf-8"))
    window.ask("photo", str(tmp_path / "photo.exr"))
    window.ask("alone", "MPS_PT_photo", "MPS_PT_align")
    window.ask("run", LARGER)

    def shown() -> dict[str, list]:
        window.ask("run", SHOWN_AT.format(places=places, path=str(path)))
        return json.loads(path.read_text(encoding="utf-8"))

    def click(x: int, y: int) -> None:
        window.click(x, y)
        window.input("sleep", "0.8")

    button = window.find("mps.pick_points")
    with film(window, "pick_points") as hold:
        window.click(*button)
        window.input("mousemove", 300, 400, "sleep", "2")
        found = shown()
        pixels, (right, down) = found["IMAGE_EDITOR"], found["IMAGE_EDITOR"][4]
        wrong = right + 40, down + 25
        for pixel, point in zip([*pixels[:4], wrong, pixels[5]], found["VIEW_3D"], strict=True):
            click(*pixel)
            click(*point)
        assert len(shown()["off"]) == len(places)
        window.see(lambda: shown()["off"], lambda off: -1 not in off and max(off) > 5, "alignment")
        hold()
        # Blender asks where the mouse is when it hears of the button.
        window.input("mousemove", *wrong, "sleep", "1", "mousedown", 1, "sleep", "2")
        window.input("mousemove", right, down, "sleep", "2", "mouseup", 1, "sleep", "1")
        window.see(lambda: shown()["off"], lambda off: -1 not in off and max(off) < 5, "alignment")
        hold()


def test_try_it_and_before_after(unfolded):  # noqa: F811
    window = unfolded
    window.ask("run", LARGER)
    button = window.find("mps.try_it")
    with film(window, "try_it") as hold:
        window.click(*button)
        for name in ("MPS Photo", "MPS Normals"):
            window.wait(lambda state, name=name: name in state["images"], name)
            hold()
        window.wait(lambda state: not state["running"] and "MPS White Lamp" in state["objects"], "end of Try It")
        wait_for_shaders(window)
        hold()
    right, top = window.state["sidebar"][:2]
    with film(window, "before_after"):
        sweep(window, right, top)


def sweep(window: Window, right: int, top: int) -> None:
    """The light once around the object, and then both dividers over it and back."""
    for angle in np.arange(0, 2 * np.pi, np.pi / 12):
        x, y = right * (0.55 + 0.4 * np.cos(angle)), top + 400 - 300 * np.sin(angle)
        window.input("mousemove", round(x), round(y), "sleep", "0.4")
    dividers = [round(right * share) for share in (0.5, 0.62)]  # where they are at first
    for number, divider in enumerate(dividers):
        window.input("mousemove", divider, top + 700, "mousedown", 1)
        for x in [*np.linspace(divider, right * (0.55 if number else 0.6), 8), *[divider] * 2]:
            window.input("mousemove", round(float(x)), top + 700, "sleep", "0.4")
        window.input("mouseup", 1)


TARGETED = """
carved.hide_set(True)
bpy.context.scene.mps.bake.target = bpy.context.view_layer.objects.active = plain
bpy.ops.object.select_all(action="DESELECT")
"""


NO_RIG = "area.spaces.active.overlay.show_extras = False"


def test_heights(unfolded, tmp_path):  # noqa: F811
    window = unfolded
    statue(window, tmp_path, TARGETED, 512)
    work(window, "estimate")
    work(window, "bake", size=1024, output=str(tmp_path / "statue.png"))
    work(
        window, "displace", method="MODIFIER", automatic=False, levels=2, scale=0.1, output=str(tmp_path / "height.exr")
    )
    work(window, "integrate", mesh=False, curvature=True, output=str(tmp_path / "view.exr"))
    window.ask("run", VIEW.format((0.8, 0, 0), 4.5, (1.3, 0, 0.2), "SOLID") + NO_RIG)
    window.photograph(OUTPUT / "tour_height.webp", "MPS_PT_heights", "MPS_PT_displace")
    assert not any(window.state["errors"].values())


PLASTER = """
bpy.data.batch_remove(bpy.data.objects)
bpy.ops.mesh.primitive_grid_add(x_subdivisions=500, y_subdivisions=500, size=2)
texture = bpy.data.textures.new("Grain", "VORONOI")
modifier = bpy.context.object.modifiers.new("Grain", "DISPLACE")
texture.noise_scale, modifier.texture, modifier.strength = 0.1, texture, 0.04
bpy.ops.mps.add_rig(view="TOP")
bpy.context.scene.mps.rig.camera.data.ortho_scale = 1.8
"""
PLANE = """
plane = bpy.context.scene.mps.material.plane
for obj in bpy.context.view_layer.objects:
    obj.hide_set(obj != plane)
"""


def test_material(unfolded, tmp_path):  # noqa: F811
    window = unfolded
    window.ask("run", PLASTER)
    work(window, "render_photo", width=512, height=512, samples=8, output=str(tmp_path / "plaster.exr"))
    work(window, "make_material", repeats=3, output=str(tmp_path / "plaster"))
    window.ask("run", PLANE + VIEW.format("plane.location", 7, (0.79, 0, 0.35), "MATERIAL"))
    wait_for_shaders(window, painted=False)
    window.photograph(OUTPUT / "tour_material.webp", "MPS_PT_material")
    assert not any(window.state["errors"].values())


AROUND = """
import math, mathutils
scene, rig = bpy.context.scene, bpy.context.scene.mps.rig
front = rig.target.matrix_world.copy()
carved.data.materials.clear()  # its paint asks for white photos
for number in range(4):
    rig.target.matrix_world = mathutils.Matrix.Rotation(math.pi / 2 * number, 4, "Z") @ front
    bpy.context.view_layer.update()
    name = {!r} + f"{{number}}.exr"
    bpy.ops.mps.render_photo(width=512, height=512, samples=8, white=False, output=name)
    camera = bpy.data.objects.new(f"Side {{number}}", rig.camera.data.copy())
    camera.matrix_world = rig.camera.matrix_world
    scene.collection.objects.link(camera)
    camera.data.background_images.new().image = bpy.data.images.load(name)
for obj in (*(light.object for light in rig.lights), rig.camera):
    obj.hide_set(True)
"""
DIM = "shading.use_scene_lights, shading.use_scene_world, shading.studiolight_intensity = True, False, 0.2"


def test_many_views(unfolded, tmp_path):  # noqa: F811
    window = unfolded
    statue(window, tmp_path, TARGETED + AROUND.format(str(tmp_path / "side")), 64)
    window.ask("set", "bake", {"size": 1024, "output": str(tmp_path / "around.png")})
    work(window, "bake_views")
    window.ask("run", VIEW.format((0.8, 0, 0), 9, (1.2, 0, 0.5), "MATERIAL") + DIM)
    wait_for_shaders(window, painted=False)
    window.photograph(OUTPUT / "panel_views.webp", "MPS_PT_views")
    assert (tmp_path / "around_report.html").is_file()
    assert not any(window.state["errors"].values())
