"""Runs inside a Blender with a window: opens the sidebar's MPS tab, and says ten times a second how things stand.

Arguments: the JSON file to write the state to, and a file whose text is the number of the last request: each new
number empties the clipboard, and "quit" ends Blender.
"""

import contextlib
import json
import sys
from pathlib import Path

import bpy

state_file, request_file = map(Path, sys.argv[sys.argv.index("--") + 1 :])
answered = ""

bpy.context.preferences.view.show_splash = False


def sidebar():
    """The 3D viewport's sidebar once it shows the tab."""
    area = next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")
    area.spaces.active.show_region_ui = True
    region = next(region for region in area.regions if region.type == "UI")
    if region.active_panel_category == "MPS":
        return region
    # The tabs cannot be chosen before they have been drawn.
    with contextlib.suppress(AttributeError, TypeError):
        region.active_panel_category = "MPS"
    area.tag_redraw()
    return None


def state():
    region = sidebar()
    if region is None:
        return {"answered": answered, "sidebar": None}
    manager = bpy.context.window_manager
    return {
        "answered": answered,
        # Left, top, width and height in pixels from the window's upper left corner.
        "sidebar": [region.x, manager.windows[0].height - region.y - region.height, region.width, region.height],
        "clipboard": manager.clipboard,
        "objects": sorted(bpy.data.objects.keys()),
        "images": sorted(image.name for image in bpy.data.images if image.has_data),
        "running": manager.mps.running,
    }


def tick():
    global answered
    request = request_file.read_text(encoding="utf-8") if request_file.exists() else ""
    if request == "quit":
        bpy.ops.wm.quit_blender()
    elif request != answered:
        bpy.context.window_manager.clipboard = ""
        answered = request
    unfinished = state_file.with_suffix(".unfinished")
    unfinished.write_text(json.dumps(state()), encoding="utf-8")
    unfinished.replace(state_file)
    return 0.1


bpy.app.timers.register(tick, first_interval=0.5)
