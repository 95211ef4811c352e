"""Scan, pressed with the mouse: from an empty scene, a mesh file and a photo become a lit, textured object."""

import os
import shutil
from pathlib import Path

from live import IN_GERMAN, Window

SCRIPTS = Path(__file__).with_name("scripts")

# Takes the photo of a statue under a rig, writes its mesh without UVs, and leaves an empty scene.
STATUE = """
import runpy
statue = runpy.run_path({script!r})
statue["photographed"]({photo!r}, {size})
bpy.ops.object.select_all(action="DESELECT")
statue["plain"].rotation_euler = (0, 0, 0)
statue["plain"].select_set(True)
bpy.ops.wm.obj_export(filepath={mesh!r}, export_selected_objects=True, export_uv=False, export_materials=False)
bpy.ops.mps.remove_rig()
bpy.data.batch_remove([*bpy.data.objects, bpy.data.images["MPS Photo"]])
"""
IMPORT = """
with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
    bpy.ops.wm.obj_import(filepath={mesh!r})
"""
# Drops files onto the viewport: what Blender does then, and what it does once the menu's entry is chosen.
DROP = """
window = bpy.context.window_manager.windows[0]
area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
region = next(region for region in area.regions if region.type == "WINDOW")
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.wm.drop_import_file("INVOKE_DEFAULT", directory={folder!r}, files=[{{"name": name}} for name in {names!r}])
"""
NEARER = """
view = next(area for area in bpy.data.screens["Layout"].areas if area.type == "VIEW_3D").spaces.active.region_3d
view.view_location, view.view_distance = (0, 0, 0), 6
"""
DECOY = """
with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
    bpy.ops.mesh.primitive_cube_add(location=(60, -60, 40))
    bpy.context.object.name = "other"
"""
TARGET = """
mps = bpy.context.scene.mps
open({told!r}, "w").write(f"{{mps.bake.target.name}} {{mps.photo.image.filepath}} {{mps.estimate.white}}")
"""


def photographed(window: Window, folder) -> Path:
    """The statue's mesh in an empty scene's folder, with its photo and white photo as they come from a camera."""
    mesh, photo = folder / "statue.obj", folder / "rendered.exr"
    size = 640 if os.environ.get("MPSNET_SCREENSHOTS") else 320
    window.ask("run", STATUE.format(script=str(SCRIPTS / "statue.py"), mesh=str(mesh), photo=str(photo), size=size))
    shutil.copy(photo, folder / "photo.exr")  # without the files beside it that tell of the rig and the camera
    shutil.copy(folder / "rendered_white.exr", folder / "white.exr")
    return mesh


def test_a_mesh_is_dropped_and_its_photo_and_white_photo_are_scanned_onto_it(window, album, tmp_path):
    photographed(window, tmp_path)
    window.ask("run", NEARER)
    with window.larger():
        scanned_by_drop(window, album, tmp_path)


def scanned_by_drop(window, album, tmp_path):
    left, top, width, height = window.state["sidebar"]
    x, y = (left + width) // 2, top + height // 2

    def drop(*names):
        window.input("mousemove", x - 5, y, "sleep", "0.5", "mousemove", x, y, "sleep", "0.5")
        before = window.screenshot()
        window.ask("run", DROP.format(folder=str(tmp_path), names=names))
        window.see(lambda: (abs(window.screenshot() - before) > 0.1).sum(), lambda changed: changed > 3000, "menu")

    with window.film(album / "scan.webp") as hold:
        drop("statue.obj")
        hold()
        window.input("key", "Return")
        window.wait(lambda state: state["objects"] == ["statue"], "imported mesh")
        window.ask("run", DECOY)
        drop("photo.exr", "white.exr")
        window.input("mousemove_relative", 0, 22, "sleep", "0.3")  # beside Blender's own image drop
        hold()
        window.input("click", 1)
        window.wait(lambda state: state["running"] == "MPS_OT_align_photo", "search of the camera")
        window.ask("run", TARGET.format(told=str(tmp_path / "told")))
        target, photo, white = (tmp_path / "told").read_text(encoding="utf-8").split()
        assert target == "statue" and photo.endswith("photo.exr") and white.endswith("white.exr")
        hold()
        if os.environ.get("MPSNET_SCREENSHOTS"):
            for name in ("MPS Alignment", "MPS Normals"):
                window.wait(lambda state, name=name: name in state["images"], name)
                hold()
            window.wait(lambda state: "MPS White Lamp" in state["objects"], "end of the scan")
            window.wait_for_shaders()
            window.input("sleep", "8")
        window.input("key", "Escape")
        window.wait(lambda state: not state["running"], "end")


def test_a_mesh_and_a_photo_become_a_lit_object_in_three_clicks(window, album, tmp_path):
    mesh = photographed(window, tmp_path)
    window.ask("run", IMPORT.format(mesh=str(mesh)))
    window.wait(lambda state: state["objects"] == ["statue"], "imported mesh")
    window.photograph(album / "panel_scan_before.png", beside=200)
    window.ask("photo", str(tmp_path / "photo.exr"))
    button = window.find("mps.scan")
    window.click(*button)
    window.wait(lambda state: state["progress"] > 0.1, "progress of the camera")
    window.photograph(album / "panel_scan_running.png", beside=200)
    window.wait(lambda state: "MPS Alignment" in state["images"], "camera")
    window.wait(lambda state: "MPS Normals" in state["images"], "normals")
    done = window.wait(lambda state: not state["running"] and "MPS White Lamp" in state["objects"], "end of the scan")
    assert not any(done["errors"].values())
    assert {"MPS Alignment", "MPS Normals", "MPS statue"} <= set(done["images"])
    assert "MPS Normal" in done["nodes"] and "Slant" in done["found"]
    window.photograph(album / "panel_scan.png")
    window.ask("run", IN_GERMAN)
    window.photograph(album / "panel_scan_german.png", beside=200)
