"""Scan, pressed with the mouse: from an empty scene, a mesh file and a photo become a lit, textured object."""

import shutil

from live import Window

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
bpy.ops.mps.render_photo(width=320, height=320, samples=8, output={photo!r})
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
IN_GERMAN = """
view = bpy.context.preferences.view
view.language, view.use_translate_interface, view.use_translate_tooltips = "de_DE", True, True
"""


def imported(window: Window, folder) -> None:
    """An empty scene with the statue's mesh imported, and the folder with its photo as it came from a camera."""
    mesh, photo = folder / "statue.obj", folder / "rendered.exr"
    window.ask("run", STATUE.format(mesh=str(mesh), photo=str(photo)))
    shutil.copy(photo, folder / "photo.exr")  # without the files beside it that tell of the rig and the camera
    window.ask("run", IMPORT.format(mesh=str(mesh)))
    window.wait(lambda state: state["objects"] == ["statue"], "imported mesh")


def test_a_mesh_and_a_photo_become_a_lit_object_in_three_clicks(window, album, tmp_path):
    imported(window, tmp_path)
    window.photograph(album / "panel_scan_before.png", beside=200)
    window.ask("photo", str(tmp_path / "photo.exr"))
    window.click(*window.find("mps.scan"))
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
