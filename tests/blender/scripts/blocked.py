"""Runs inside a Blender with a window: photographs, estimates and bakes a heavy object as its buttons do, and tells how
long the window was blocked at a time; see tests/benchmarks/window_blocked.py.

Arguments: the JSON file to write, and the benchmark's options as JSON.
"""

import json
import sys
import time
from pathlib import Path

import bpy
import numpy as np

report, options = sys.argv[sys.argv.index("--") + 1 :]
folder, options = Path(report).parent, json.loads(options)
side, frames = round(options["faces"] ** 0.5), options["frames"]
TICK, QUIET = 0.005, 30  # seconds; so many ticks in a row without a longer block between steps


def place(name):
    """A file for a result, a folder for the frames of one."""
    return str(folder / (name if frames == 1 else Path(name).stem))


moving = {"animation": True} if frames > 1 else {}
STEPS = (
    ("render_photo", {"width": 64, "height": 64, "samples": 1, "output": place("photo.exr"), **moving}),
    ("estimate", {"model": "LAMBERTIAN", "output": place("normals.png")}),
    ("bake", {"size": options["size"], "output": place("texture.png"), "animated": frames > 1}),
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
    subdivided = options["subdivided"]
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=side >> subdivided, y_subdivisions=side >> subdivided)
    obj = bpy.context.object
    bpy.ops.object.shade_smooth()
    if options["ngon"]:
        bpy.ops.mesh.primitive_circle_add(vertices=8, radius=0.1, fill_type="NGON", location=(1.2, 0, 0))
        obj.select_set(True)
        bpy.context.view_layer.objects.active = obj
        bpy.ops.object.join()
    points = np.empty((len(obj.data.vertices), 3), np.float32)
    obj.data.vertices.foreach_get("co", points.ravel())
    points[:, 2] = 0.05 * np.sin(20 * points[:, 0]) * np.sin(15 * points[:, 1])
    obj.data.vertices.foreach_set("co", points.ravel())
    obj.data.update()
    if subdivided:
        modifier = obj.modifiers.new("Subdivision", "SUBSURF")
        modifier.levels, modifier.render_levels = 0, 1
    if frames > 1:
        bpy.context.scene.frame_end = frames
        obj.modifiers.new("Wave", "WAVE").height = 0.05
    call(bpy.ops.mps.add_rig, view="TOP")
    space = viewport()[1].spaces.active
    space.shading.type, space.show_region_ui = options["shading"], True


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
        phase = told["runs" if bpy.context.window_manager.mps.running else "ends"]
        phase[:] = map(max, phase, passed)
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
    last = time.monotonic(), time.thread_time()
    passed = [one - other for one, other in zip(last, begun, strict=True)]
    found[operator] = {"begins": passed, "runs": [0.0, 0.0], "ends": [0.0, 0.0], "seconds": 0.0}
    return TICK


def begin():
    build()
    bpy.types.SpaceView3D.draw_handler_add(count, (), "WINDOW", "POST_PIXEL")
    bpy.app.timers.register(tick, first_interval=1)


bpy.app.timers.register(begin, first_interval=1)
