"""Runs inside a Blender with a window: photographs, estimates and bakes a heavy object as its buttons do, and tells how
long the window was blocked at a time; see tests/benchmarks/window_blocked.py.

Arguments: the JSON file to write, how many faces, 1 for an n-gon beside them, how the viewport is shaded.
"""

import json
import sys
import time
from pathlib import Path

import bpy
import numpy as np

report, faces, ngon, shading = sys.argv[sys.argv.index("--") + 1 :]
folder, side = Path(report).parent, round(int(faces) ** 0.5)
TICK, QUIET = 0.005, 30  # seconds; so many ticks in a row without a longer block between steps
STEPS = (
    ("render_photo", {"width": 64, "height": 64, "samples": 1, "output": str(folder / "photo.exr")}),
    ("estimate", {"model": "LAMBERTIAN", "output": str(folder / "normals.png")}),
    ("bake", {"size": 512, "output": str(folder / "texture.png")}),
)

bpy.context.preferences.view.show_splash = False
bpy.context.preferences.use_preferences_save = False
step, quiet, last, drawn, found = -1, 0, (0.0, 0.0), 0, {}


def viewport():
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    return window, area, next(region for region in area.regions if region.type == "WINDOW")


def call(operator, *how, **settings):
    window, area, region = viewport()
    with bpy.context.temp_override(window=window, area=area, region=region):
        operator(*how, **settings)


def build():
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=side, y_subdivisions=side)
    obj = bpy.context.object
    bpy.ops.object.shade_smooth()
    if ngon == "1":
        bpy.ops.mesh.primitive_circle_add(vertices=8, radius=0.1, fill_type="NGON", location=(1.2, 0, 0))
        obj.select_set(True)
        bpy.context.view_layer.objects.active = obj
        bpy.ops.object.join()
    points = np.empty((len(obj.data.vertices), 3), np.float32)
    obj.data.vertices.foreach_get("co", points.ravel())
    points[:, 2] = 0.05 * np.sin(20 * points[:, 0]) * np.sin(15 * points[:, 1])
    obj.data.vertices.foreach_set("co", points.ravel())
    obj.data.update()
    call(bpy.ops.mps.add_rig, view="TOP")
    space = viewport()[1].spaces.active
    space.shading.type, space.show_region_ui = shading, True


def count():
    global drawn
    drawn += 1


def tick():
    """Called again and again; what lies between two calls is what the window was blocked for."""
    global step, quiet, last, drawn
    now = time.monotonic(), time.thread_time()
    passed = [one - other for one, other in zip(now, last, strict=True)]
    last = now
    quiet = quiet + 1 if passed[0] < 0.1 and not bpy.context.window_manager.mps.running else 0
    if step >= 0:
        told = found[STEPS[step][0]]
        told["blocked"], told["processor"] = max(told["blocked"], passed[0]), max(told["processor"], passed[1])
        told["seconds"] += passed[0]
        told["drawn"] = drawn
    sidebar = next(region for region in viewport()[1].regions if region.type == "UI")
    if sidebar.active_panel_category not in {"MPS", "UNSUPPORTED"}:
        sidebar.active_panel_category = "MPS"
    if quiet < QUIET:
        return TICK
    step, quiet, drawn = step + 1, 0, 0
    if step == len(STEPS):
        Path(report).write_text(json.dumps(found), encoding="utf-8")
        bpy.ops.wm.quit_blender()
        return None
    operator, settings = STEPS[step]
    begun = time.monotonic(), time.thread_time()
    call(getattr(bpy.ops.mps, operator), "INVOKE_DEFAULT", **settings)
    passed = [one - other for one, other in zip((time.monotonic(), time.thread_time()), begun, strict=True)]
    found[operator] = {"begun": passed, "blocked": 0.0, "processor": 0.0, "seconds": 0.0}
    return TICK


def begin():
    build()
    bpy.types.SpaceView3D.draw_handler_add(count, (), "WINDOW", "POST_PIXEL")
    bpy.app.timers.register(tick, first_interval=1)


bpy.app.timers.register(begin, first_interval=1)
