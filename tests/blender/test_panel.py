"""The panel in a real window: drawn, and clicked through as a person would."""

import json

import numpy as np
from dng import write_dng
from live import STEP
from mirror_ball import CROSSTALK, Scene, around, grey_photograph, lamps_around, photograph
from synthetic import degrees_between

from mpsnet_core import read_rig, write_image
from mpsnet_core.synthesis.job import sample_path, samples_there


def test_panel_is_drawn_and_its_button_adds_a_rig(window, tmp_path):
    before = window.wait(lambda state: "Cube" in state["objects"], "default scene")
    left, top, width, height = before["sidebar"]
    assert width > 100 and height > 400
    window.ask("run", "bpy.context.scene.mps.way = 'RENDER'")
    x, y = window.find("mps.add_rig")
    window.input("mousemove", 10, 500, "sleep", "0.5")
    picture = window.screenshot().mean(axis=-1)
    panel, button = picture[top : top + height, left : left + width], picture[y : y + STEP, left : left + width]
    # An empty or black sidebar is of one colour; the button has its label, and everything above it labels and fields.
    assert panel.std() > 0.02
    assert np.ptp(button, axis=1).max() > 0.3
    edges = np.abs(np.diff(picture[top:y, left : left + width], axis=1)) > 0.1
    assert edges.any(axis=1).mean() > 0.3

    window.click(x, y)
    after = window.wait(lambda state: len(state["objects"]) > len(before["objects"]), "rig")
    added = set(after["objects"]) - set(before["objects"])
    assert {"MPS Red", "MPS Green", "MPS Blue", "MPS Camera"} <= added

    window.input("key", "ctrl+z")
    window.wait(lambda state: state["objects"] == before["objects"], "undo")


def test_the_steps_run_beside_a_live_window(window, tmp_path):
    window.ask("invoke", "add_rig", {})
    window.ask("invoke", "render_photo", {"width": 128, "height": 128, "samples": 16})
    window.wait(lambda state: "MPS Photo" in state["images"], "photo")

    window.ask("invoke", "estimate", {})
    # The operator came back at once, and the window goes on ticking until the normals are there.
    window.wait(lambda state: "MPS Normals" in state["images"] and not state["running"], "normals")

    cancelled = tmp_path / "cancelled.png"
    window.ask("invoke", "bake", {"size": 16384, "output": str(cancelled)})
    window.wait(lambda state: state["running"] and state["progress"] > 0, "running bake")
    window.input("mousemove", 500, 500, "key", "Escape")
    window.wait(lambda state: not state["running"], "end of the cancelled bake")
    assert not [path.name for path in tmp_path.iterdir() if "cancelled" in path.name]

    plain = window.state["nodes"]
    texture = tmp_path / "texture.png"
    window.ask("invoke", "bake", {"size": 128, "output": str(texture)})
    window.wait(lambda state: "MPS Cube" in state["images"] and not state["running"], "texture")
    assert texture.is_file()
    assert set(window.state["nodes"]) - set(plain) == {"MPS UV", "MPS Texture", "MPS Normal"}

    window.input("key", "ctrl+z")
    window.wait(lambda state: state["nodes"] == plain, "undo of the bake")
    window.input("key", "ctrl+shift+z")
    window.wait(lambda state: "MPS Normal" in state["nodes"], "redo of the bake")


# Counts how often the viewport is drawn, and how often the sidebar is; a slice of a mesh fills a tick.
COUNTING = """
import sys
bpy.app.driver_namespace["drawn"] = drawn = {"WINDOW": 0, "UI": 0}
def count(region):
    drawn[region] += 1
for region in drawn:
    bpy.types.SpaceView3D.draw_handler_add(count, (region,), region, "POST_PIXEL")
addon = sys.modules[bpy.types.MPS_OT_cancel.__module__]
addon.SLICE_SECONDS = 0
bpy.ops.mesh.primitive_grid_add(x_subdivisions=400, y_subdivisions=400, location=(0, -2, 0), rotation=(1.5708, 0, 0))
"""
TELL = """
import json
with open({path!r}, "w") as file:
    json.dump(bpy.app.driver_namespace["drawn"], file)
"""


def test_a_heavy_bake_leaves_the_viewport_undrawn_and_is_cancelled_before_it_began(window, tmp_path):
    def drawn():
        window.ask("run", TELL.format(path=str(tmp_path / "drawn.json")))
        return json.loads((tmp_path / "drawn.json").read_text())

    window.ask("invoke", "add_rig", {})
    window.ask("invoke", "render_photo", {"width": 64, "height": 64, "samples": 1})
    window.wait(lambda state: "MPS Photo" in state["images"] and not state["running"], "photo")
    window.ask("invoke", "estimate", {"model": "LAMBERTIAN"})
    window.wait(lambda state: "MPS Normals" in state["images"] and not state["running"], "normals")
    window.ask("run", COUNTING)
    window.input("mousemove", 300, 880, "sleep", "3")

    texture = tmp_path / "texture.png"
    window.ask("invoke", "bake", {"size": 2048, "output": str(texture)})
    window.wait(lambda state: state["message"] == "starting", "mesh that is handed over")
    window.input("key", "Escape")
    window.wait(lambda state: not state["running"], "end of the cancelled bake")
    assert not texture.exists() and not window.state["errors"].get("bake")

    window.input("sleep", "3")
    window.ask("invoke", "bake", {"size": 2048, "output": str(texture)})
    before = window.wait(lambda state: state["progress"] > 0, "running bake") and drawn()
    window.wait(lambda state: state["progress"] > 0.5 or not state["running"], "half of the bake")
    after = drawn()
    assert after["UI"] - before["UI"] >= 4
    assert after["WINDOW"] - before["WINDOW"] <= 2  # `drawn` itself has it drawn
    window.wait(lambda state: "MPS Grid" in state["images"] and not state["running"], "texture")


def test_a_photo_is_rendered_beside_a_live_window(window, album, tmp_path):
    """Pressed with the mouse, cancelled by Esc, by the panel's X and by another file, and once let come to its end."""
    window.ask("invoke", "add_rig", {})
    slow = {"width": 1024, "height": 1024, "samples": 100, "output": str(tmp_path / "slow.exr")}
    window.ask("set", "photo", slow)
    window.ask("alone", "MPS_PT_photo")
    x, y = window.find("mps.render_photo")
    scenes = "from pathlib import Path; Path({!r}).write_text(repr([*bpy.data.scenes.keys(), bpy.data.is_dirty]))"
    window.ask("run", scenes.format(str(tmp_path / "before")))

    window.click(x, y)
    before = window.wait(lambda state: state["running"] and state["progress"] > 0.001, "progress")
    # The window ticks on, shows how far it is, and the time left once that can be told.
    window.wait(lambda state: state["ticks"] > before["ticks"] + 10 and state["left"], "time left")
    window.photograph(album / "panel_photo_running.png", beside=200)
    window.ask("run", scenes.format(str(tmp_path / "meanwhile")))
    assert (tmp_path / "meanwhile").read_text() == (tmp_path / "before").read_text()
    window.input("key", "Escape")
    window.wait(lambda state: not state["running"], "end by Esc")

    window.ask("invoke", "render_photo", {})
    window.wait(lambda state: state["running"], "running photo")
    left, _, width, _ = window.state["sidebar"]
    assert window.under_mouse(left + width - 50, y).startswith("bpy.ops.mps.cancel(")  # right of the progress
    window.click(left + width - 50, y)
    window.wait(lambda state: not state["running"], "end by the X")
    window.ask("invoke", "render_truth", {"output": str(tmp_path / "slow_truth.exr")})
    assert window.state["running"] == "MPS_OT_render_truth"
    window.ask("run", "bpy.ops.mps.cancel()")
    window.wait(lambda state: not state["running"], "end of the true normals")
    assert not [path.name for path in tmp_path.iterdir() if "slow" in path.name]

    quick = {"width": 64, "height": 64, "samples": 1, "output": str(tmp_path / "quick.exr")}
    window.ask("invoke", "render_photo", quick)
    window.wait(lambda state: "MPS Photo" in state["images"] and not state["running"], "photo")
    assert (tmp_path / "quick.exr").is_file() and (tmp_path / "quick.rig.json").is_file()
    window.ask("invoke", "render_photo", slow)
    window.wait(lambda state: state["running"] and state["progress"] > 0, "another running photo")
    window.ask("run", "bpy.ops.wm.read_homefile()")
    window.wait(lambda state: state["sidebar"] and not state["running"], "another file")
    assert not [path.name for path in tmp_path.iterdir() if "slow" in path.name]


PAIRS = """
import json
rigs = bpy.context.scene.mps.rigs
with open({path!r}, "w") as file:
    json.dump([(one.estimate.image.mps.photo.name, one.photo.image.name) for one in rigs], file)
"""


def test_all_rigs_take_their_photos_in_one_job(window, album, tmp_path):
    """Of the scene as it was, pressed with the mouse; what is done is undone in one step, and stays when cancelled."""

    def made(state, what):
        return sum(name.startswith(what) for name in state["images"])

    window.ask("invoke", "add_rig_ring", {"count": 3})
    photo = "one.photo.width, one.photo.height, one.photo.samples = 64, 48, {}"
    sizes = f"for one in bpy.context.scene.mps.rigs: {photo}"
    window.ask("run", f"{sizes.format(1)}\nbpy.ops.ed.undo_push(message='rigs')")
    window.ask("alone", "MPS_PT_photo")
    x, y = window.find("mps.render_photo", at=0.75)
    assert "all_rigs=True" in window.under_mouse(x, y)
    window.photograph(album / "panel_all_rigs.png", beside=200)
    window.click(x, y)
    window.wait(lambda state: state["message"].startswith("Rig 1: "), "first rig")
    window.ask("run", "bpy.data.objects['Cube'].hide_render = True")  # without it nothing would be seen
    window.wait(lambda state: state["message"].startswith("Rig 2: ") and state["progress"] > 0.3, "second rig")
    window.photograph(album / "panel_all_rigs_running.png", beside=200)
    window.wait(lambda state: not state["running"], "end")
    assert made(window.state, "MPS Photo") == 3 and not window.state["errors"].get("render_photo")
    window.ask("invoke", "estimate", {"all_rigs": True, "model": "LAMBERTIAN"})
    window.wait(lambda state: made(state, "MPS Normals") == 3 and not state["running"], "normals of all")
    window.ask("run", PAIRS.format(path=str(tmp_path / "pairs.json")))
    pairs = json.loads((tmp_path / "pairs.json").read_text())
    assert len({photo for _, photo in pairs}) == 3 and all(of == photo for of, photo in pairs)
    window.input("mousemove", 500, 500, "key", "ctrl+z")
    window.wait(lambda state: not made(state, "MPS Normals"), "undo of the normals")
    window.input("key", "ctrl+z")
    window.wait(lambda state: not made(state, "MPS Photo"), "undo of the photos")

    window.ask("run", sizes.format(20000))
    window.ask("run", "bpy.context.scene.mps.rigs[0].photo.samples = 1; bpy.data.objects['Cube'].hide_render = False")
    window.click(x, y)
    window.wait(lambda state: state["message"].startswith("Rig 2: ") and state["progress"] > 0.34, "second rig")
    window.input("mousemove", 500, 500, "key", "Escape")
    window.wait(lambda state: not state["running"], "end of the cancelled job")
    assert made(window.state, "MPS Photo") == 1


TRAINING = """
package = bpy.types.MPS_PT_rig.__module__.rpartition(".panels")[0]
bpy.context.preferences.addons[package].preferences.training = True
"""


def test_training_data_grows_in_its_section(window, album, tmp_path):
    folder, count = tmp_path / "samples", 24
    settings = {"count": count, "size": 32, "samples": 1, "kinds": ["BLOBS"], "processes": 2, "output": str(folder)}
    window.ask("set", "samples", settings)
    window.ask("run", TRAINING)
    window.ask("alone", "MPS_PT_samples")
    window.wait(lambda state: state["sidebar"], "tab of its own")
    left, top, width, height = window.state["sidebar"]
    x, y = window.find("mps.render_samples", below=200)
    window.input("mousemove", 500, 500, "sleep", "1")
    before = window.screenshot()

    window.click(x, y)
    window.wait(lambda state: state["running"] and "MPS Samples" in state["images"], "contact sheet")
    window.input("mousemove", 500, 500, "sleep", "1", "key", "Escape")
    window.wait(lambda state: not state["running"], "end of the cancelled rendering")
    there = samples_there(folder)
    assert 0 < len(there) < count
    assert not list(folder.glob(".*"))

    # Below the button there was nothing, and now there is a picture in colour.
    def colourful(picture):
        below = picture[y + 2 * STEP : top + height, left : left + width - 40]
        return (np.ptp(below, axis=-1) > 0.2).sum()

    def look():
        return colourful(window.screenshot())

    shown = window.see(look, lambda pixels: pixels > colourful(before) + 500, "contact sheet")

    kept = {number: sample_path(folder, number).stat().st_mtime_ns for number in there}
    window.click(x, y)
    window.wait(lambda state: state["running"], "rendering that goes on")
    window.photograph(album / "panel_training_data.png", beside=200)
    window.wait(lambda state: not state["running"], "end of the rendering")
    assert samples_there(folder) == set(range(count))
    assert {number: sample_path(folder, number).stat().st_mtime_ns for number in there} == kept
    window.input("mousemove", 500, 500)
    window.see(look, lambda pixels: pixels > 1.5 * shown, "contact sheet of all")


def test_real_lights_are_found_and_undone(unfolded, album, tmp_path):
    window = unfolded
    angles = [(30, 90), (35, 205), (25, 335)]
    directions = np.array([around(*angle) for angle in angles])
    scene = Scene([((0.0, 0.0, 0.0), 97.4)], lamps_around((0, 0, 0), 2e4, angles=angles), (300, 300))
    write_image(tmp_path / "mirror.exr", photograph(scene))
    write_image(tmp_path / "grey.exr", grey_photograph(scene, CROSSTALK, directions))
    rig = tmp_path / "rig.json"
    settings = {"ball": str(tmp_path / "mirror.exr"), "grey": str(tmp_path / "grey.exr"), "output": str(rig)}
    window.ask("set", "calibrate", settings)
    window.ask("alone", "MPS_PT_lights", "MPS_PT_calibrate")
    _, top, _, _ = window.state["sidebar"]
    lights = window.find("mps.calibrate_lights", below=140)

    window.click(*lights)
    window.wait(lambda state: state["rig_file"] and not state["running"], "lights")
    assert "MPS Calibration" in window.state["images"]
    assert "Slant" in window.state["found"].splitlines()[0]
    assert degrees_between(read_rig(rig).directions, directions).max() < 1

    window.click(*window.find("mps.calibrate_mixing", below=lights[1] + 4 * STEP - top))
    after = window.wait(lambda state: "Channel" in state["found"] and not state["running"], "mixing")
    np.testing.assert_allclose(read_rig(rig).mixing, CROSSTALK, atol=0.02)
    assert after["rig_file"] == str(rig)
    window.input("mousemove", *lights, "sleep", "0.4", "click", "--repeat", 12, "--delay", 30, 5)
    window.photograph(album / "panel_calibrate.png", beside=200)

    window.input("mousemove", 500, 500, "key", "ctrl+z")
    window.wait(lambda state: "Slant" in state["found"], "undo of the mixing")
    window.input("key", "ctrl+z")
    window.wait(lambda state: not state["rig_file"] and "MPS Calibration" not in state["images"], "undo of both")
    assert rig.is_file()


def test_a_raw_photo_is_shown_by_its_own_file(window, tmp_path):
    write_dng(tmp_path / "photo.dng", np.full((48, 64), 900, np.uint16))
    window.ask("photo", str(tmp_path / "photo.dng"))
    x, y = window.find("wm.path_open", at=0.83)
    assert f'filepath="{tmp_path}"' in window.under_mouse(x, y)


EDITORS_SHOW = """
import json
image = bpy.context.scene.mps.photo.image
areas = bpy.context.window_manager.windows[0].screen.areas
shown = [area.spaces.active.image.name for area in areas if area.type == "IMAGE_EDITOR" and area.spaces.active.image]
with open({path!r}, "w") as file:
    json.dump([image.session_uid, image.mps.shown, list(image.preview_ensure().image_size), shown], file)
"""


def test_a_result_shows_itself_finely_and_opens_in_an_image_editor(window, tmp_path):
    def stands():
        window.ask("run", EDITORS_SHOW.format(path=str(tmp_path / "shown.json")))
        return json.loads((tmp_path / "shown.json").read_text())

    write_image(tmp_path / "shot.exr", np.full((300, 400, 3), 0.3))
    window.ask("photo", str(tmp_path / "shot.exr"))
    uid, unfolded, size, shown = stands()
    assert (unfolded, size, shown) == (True, [512, 512], [])
    window.ask("run", "bpy.context.scene.mps.photo.image.mps.shown = False")
    window.ask("photo", str(tmp_path / "shot.exr"))
    assert stands()[1]
    window.ask("invoke", "show_image", {"image": uid})
    assert stands()[3] == ["shot"]
    window.ask("invoke", "show_image", {"image": uid})  # in the editor that is open now
    assert stands()[3] == ["shot"]
