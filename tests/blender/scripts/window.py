"""Runs inside a Blender with a window: opens the sidebar's MPS tab, says many times a second how things stand, and
does what it is asked to.

Arguments: the JSON file to write the state to, the JSON file of the request, and "unfolded" where no panel shall be
folded at first. A request is [number, verb, argument...] with
"clear" (empty the clipboard), "invoke" (an operator with settings, as its button does), "set" (settings of a step),
"photo" (open one from a file), "alone" (take all other panels away), "run" (Python, for what a person does elsewhere in
Blender) and "quit".
"""

import contextlib
import json
import sys
from pathlib import Path

import bpy

state_file, request_file, *unfolded = map(Path, sys.argv[sys.argv.index("--") + 1 :])
answered, ticks = 0, 0
TICK = 0.03  # seconds

bpy.context.preferences.view.show_splash = False
bpy.context.preferences.use_preferences_save = False  # the next window has them as they come
# In the order of their registration, which is that of the sidebar.
PANELS = sys.modules[bpy.types.MPS_PT_rig.__module__.rpartition(".")[0]]
EVERY_PANEL = [cls for cls in PANELS.CLASSES if issubclass(cls, bpy.types.Panel)]
category = "MPS"  # the tab that is shown
if unfolded:
    PANELS.step.FOLDED = False
    for panel in EVERY_PANEL:
        panel.bl_options = set()


def viewport():
    window = bpy.context.window_manager.windows[0]
    return window, next(area for area in window.screen.areas if area.type == "VIEW_3D")


def sidebar():
    """The 3D viewport's sidebar once it shows the tab."""
    _, area = viewport()
    if not area.spaces.active.show_region_ui:  # to set it draws all anew
        area.spaces.active.show_region_ui = True
    region = next(region for region in area.regions if region.type == "UI")
    if region.active_panel_category == category:
        return region
    # The tabs cannot be chosen before they have been drawn.
    with contextlib.suppress(AttributeError, TypeError):
        region.active_panel_category = category
    area.tag_redraw()
    return None


def state():
    region = sidebar()
    if region is None:
        return {"sidebar": None}
    manager = bpy.context.window_manager
    return {
        "answered": answered,
        "ticks": ticks,
        # Left, top, width and height in pixels from the window's upper left corner.
        "sidebar": [region.x, manager.windows[0].height - region.y - region.height, region.width, region.height],
        "clipboard": manager.clipboard,
        "objects": sorted(bpy.data.objects.keys()),
        "images": sorted(bpy.data.images.keys()),
        "nodes": sorted(
            node.name for material in bpy.data.materials if material.node_tree for node in material.node_tree.nodes
        ),
        "rig_file": bpy.context.scene.mps.estimate.rig_file,
        "found": bpy.context.scene.mps.calibrate.summary,
        "rig": [light.object.session_uid for light in bpy.context.scene.mps.rig.lights],
        "errors": {
            record.name: record.error
            for record in (*bpy.context.scene.mps.records, *bpy.context.scene.mps.chosen.records)
        },
        "running": manager.mps.running,
        "progress": manager.mps.progress,
        "message": manager.mps.message,
        "left": manager.mps.left,
    }


def answer(verb, *arguments):
    if verb == "quit":
        bpy.ops.wm.quit_blender()
    elif verb == "clear":
        bpy.context.window_manager.clipboard = ""
    elif verb == "alone":
        alone(*arguments)
    elif verb == "run":
        exec(arguments[0], {"bpy": bpy})
        viewport()[1].tag_redraw()
    elif verb == "set":
        step, settings = arguments
        for name, value in settings.items():
            setattr(getattr(bpy.context.scene.mps, step), name, set(value) if isinstance(value, list) else value)
    elif verb == "photo":
        bpy.ops.mps.open_photo(filepath=arguments[0])
    elif verb == "invoke":
        operator, settings = arguments
        window, area = viewport()
        region = next(region for region in area.regions if region.type == "WINDOW")
        # What fails raises as well; the panel and the window's message say so.
        with bpy.context.temp_override(window=window, area=area, region=region), contextlib.suppress(RuntimeError):
            getattr(bpy.ops.mps, operator)("INVOKE_DEFAULT", **settings)


def alone(*panels):
    global category
    for cls in EVERY_PANEL:
        if cls.is_registered:
            bpy.utils.unregister_class(cls)
    for cls in EVERY_PANEL:
        if cls.__name__ in panels:
            bpy.utils.register_class(cls)
    shown = [cls for cls in EVERY_PANEL if cls.__name__ in panels]
    category = shown[0].bl_category if shown else category
    viewport()[1].tag_redraw()


def tick():
    global answered, ticks
    ticks += 1
    if request_file.exists():
        number, *request = json.loads(request_file.read_text(encoding="utf-8"))
        if number != answered:
            answered = number
            answer(*request)
            return TICK  # where that opened another file, its window is not yet to be asked
    unfinished = state_file.with_suffix(".unfinished")
    unfinished.write_text(json.dumps(state()), encoding="utf-8")
    unfinished.replace(state_file)
    return TICK


if unfolded:
    alone(*(panel.__name__ for panel in EVERY_PANEL))
bpy.app.timers.register(tick, first_interval=0.5, persistent=True)  # whatever file is opened
