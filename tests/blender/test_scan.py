"""Scan, pressed with the mouse: from an empty scene, a mesh file and a photo become a lit, textured object."""

import shutil

from live import IN_GERMAN, Window

# Takes the photo of a statue under a rig, writes its mesh without UVs, and leaves an empty scene.
STATUE = """
bpy.ops.object.select_all(action="SELECT")
bpy.ops.object.delete()
bpy.ops.mesh.primitive_monkey_add()
statue = bpy.context.object
bpy.ops.mesh.primitive_cube_add(size=0.7, location=(0.5, 0.1, 0.9))
statue.select_set(True)
bpy.context.view_layer.objects.active = statue
bpy.ops.object.join()
statue.name, statue.rotation_euler = "statue", (0.2, -0.15, 0.5)
statue.modifiers.new("Smooth", "SUBSURF").levels = 2
bpy.ops.object.shade_smooth()
bpy.ops.mps.add_rig(projection="PERSPECTIVE", focal_length=60)
bpy.ops.mps.render_photo(width=320, height=320, samples=8, white=True, output={photo!r})
statue.rotation_euler = (0, 0, 0)
bpy.ops.wm.obj_export(filepath={mesh!r}, export_selected_objects=True, apply_modifiers=True, export_uv=False,
                      export_materials=False)
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
DECOY = """
with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
    bpy.ops.mesh.primitive_cube_add(location=(0, 90, 0))
    bpy.context.object.name = "decoy"
view = next(area for area in bpy.data.screens["Layout"].areas if area.type == "VIEW_3D").spaces.active.region_3d
view.view_location, view.view_distance = (0, 0, 0), 6
"""
TARGET = """
mps = bpy.context.scene.mps
open({told!r}, "w").write(f"{{mps.bake.target.name}} {{mps.photo.image.filepath}} {{mps.estimate.white}}")
"""


def imported(window: Window, folder) -> None:
    """An empty scene with the statue's mesh imported, and the folder with its photo as it came from a camera."""
    mesh, photo = folder / "statue.obj", folder / "rendered.exr"
    window.ask("run", STATUE.format(mesh=str(mesh), photo=str(photo)))
    shutil.copy(photo, folder / "photo.exr")  # without the files beside it that tell of the rig and the camera
    shutil.copy(folder / "rendered_white.exr", folder / "white.exr")
    window.ask("run", IMPORT.format(mesh=str(mesh)))
    window.wait(lambda state: state["objects"] == ["statue"], "imported mesh")


def test_a_photo_and_its_white_photo_dropped_on_a_mesh_are_scanned_onto_it(window, album, tmp_path):
    imported(window, tmp_path)
    window.ask("run", DECOY)
    left, top, width, height = window.state["sidebar"]
    x, y = (left + width) // 2, top + height // 2
    window.input("mousemove", x - 5, y, "sleep", "1", "mousemove", x, y, "sleep", "1")
    before = window.screenshot()
    window.ask("run", DROP.format(folder=str(tmp_path), names=["photo.exr", "white.exr"]))
    window.see(lambda: (abs(window.screenshot() - before) > 0.1).sum(), lambda changed: changed > 3000, "menu")
    window.photograph(album / "drop_menu.png")  # Blender's own image drop is still there
    window.input("mousemove", x, y, "sleep", "0.5", "mousemove", x, y + 20, "sleep", "0.5", "click", 1)  # Scan
    window.wait(lambda state: state["running"] == "MPS_OT_align_photo", "search of the camera")
    window.ask("run", TARGET.format(told=str(tmp_path / "told")))
    target, photo, white = (tmp_path / "told").read_text(encoding="utf-8").split()
    assert target == "statue" and photo.endswith("photo.exr") and white.endswith("white.exr")
    window.input("key", "Escape")
    window.wait(lambda state: not state["running"], "end")


def test_a_mesh_and_a_photo_become_a_lit_object_in_three_clicks(window, album, tmp_path):
    imported(window, tmp_path)
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
