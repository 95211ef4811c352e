"""Pick Points in a real window: photo and mesh side by side, clicked with the mouse."""

import json

import numpy as np
import pytest

from mpsnet_core.io.image_writing import write_image

SIZE = (400, 300)
READY = """
scene, cube = bpy.context.scene, bpy.data.objects["Cube"]
scene.mps.bake.target = cube
space = bpy.context.window_manager.windows[0].screen.areas[:]
space = next(area.spaces.active for area in space if area.type == "VIEW_3D")
space.region_3d.view_location = (2.5, 2.5, 0)  # the sidebar hides the right half of the viewport's half
"""
# Where the window shows the cube's corners and the photo's places by Blender's own functions, and what was picked.
TELL = """
import json
from bpy_extras.view3d_utils import location_3d_to_region_2d
window = bpy.context.window_manager.windows[0]
def on_screen(region, place):
    return [region.x + place[0], window.height - 1 - region.y - place[1]]
found = {"areas": sorted(area.type for area in window.screen.areas), "points": [], "pixels": []}
for area in window.screen.areas:
    region = next(region for region in area.regions if region.type == "WINDOW")
    if area.type == "VIEW_3D":
        for vertex in bpy.data.meshes["Cube"].vertices:
            corner = vertex.co * 0.98
            place = location_3d_to_region_2d(region, area.spaces.active.region_3d, corner)
            found["points"].append([list(corner), on_screen(region, place)])
    if area.type == "IMAGE_EDITOR":
        for u, v in [(0.2, 0.2), (0.8, 0.2), (0.8, 0.8), (0.2, 0.8), (0.5, 0.5)]:
            found["pixels"].append([[u * 400, (1 - v) * 300], on_screen(region, region.view2d.view_to_region(u, v))])
photo = bpy.context.scene.mps.photo.image
found["pairs"] = [[list(pair.pixel), list(pair.point), pair.residual] for pair in photo.mps.pairs]
with open(PATH, "w") as file:
    json.dump(found, file)
"""


@pytest.fixture
def picking(window, tmp_path):
    """A window with the cube and a photo, where points are picked, and what says how things stand."""
    write_image(tmp_path / "photo.png", np.random.default_rng(0).uniform(0.1, 0.4, (*SIZE[::-1], 3)))

    def stands():
        path = tmp_path / "stands.json"
        window.ask("run", TELL.replace("PATH", repr(str(path))))
        return json.loads(path.read_text(encoding="utf-8"))

    window.ask("run", READY)
    window.ask("photo", str(tmp_path / "photo.png"))
    before = stands()["areas"]
    window.ask("invoke", "pick_points", {})
    window.input("mousemove", 300, 400, "sleep", "0.5", "mousemove", 310, 410, "sleep", "1")
    yield window, stands
    if window.state["sidebar"]:
        window.input("key", "Escape", "sleep", "1")
        assert stands()["areas"] == before


def click(window, place):
    window.click(*map(round, place))
    window.input("sleep", "0.3")


def seen(found):
    """Four corners of the cube that the viewport shows, as Blender's startup file stands."""
    return [one for one in found["points"] if sum(one[0]) > 0.5]


def test_places_are_clicked_in_turn_moved_deleted_and_taken_back(picking, album, tmp_path):
    window, stands = picking

    def places():  # without the residuals: four pairs at rest align the photo by themselves
        return [pair[:2] for pair in stands()["pairs"]]

    found = stands()
    assert found["areas"].count("IMAGE_EDITOR") == 1
    pixels, points = found["pixels"], seen(found)
    for number, ((_, pixel), (_, point)) in enumerate(zip(pixels, points, strict=False)):
        for place in (pixel, point) if number % 2 == 0 else (point, pixel):
            click(window, place)
    click(window, pixels[4][1])  # half a pair, which is none
    window.photograph(album / "pick_points.png")
    picked = places()
    assert len(picked) == len(points) == 4
    for (pixel, point), (its_pixel, _), (its_point, _) in zip(picked, pixels, points, strict=False):
        np.testing.assert_allclose(pixel, its_pixel, atol=1)
        np.testing.assert_allclose(point, its_point, atol=0.15)

    window.input("mousemove", *map(round, pixels[0][1]), "sleep", "0.2", "mousedown", 1, "sleep", "0.2")
    window.input("mousemove", *(round(at + 20) for at in pixels[0][1]), "sleep", "0.3", "mouseup", 1, "sleep", "0.3")
    moved = places()
    assert np.linalg.norm(np.subtract(moved[0][0], picked[0][0])) > 5 and moved[1:] == picked[1:]

    window.input("key", "ctrl+z", "sleep", "0.5")  # of the half pair
    assert places() == moved
    window.input("key", "ctrl+z", "sleep", "0.5")
    assert places() == moved[:3]
    window.input("mousemove", *map(round, points[1][1]), "sleep", "0.3", "key", "x", "sleep", "0.5")
    assert places() == [moved[0], moved[2]]
    assert "Cube" in window.state["objects"]


def test_four_pairs_align_the_photo_by_themselves(picking):
    window, stands = picking
    found = stands()
    for (_, pixel), (_, point) in zip(found["pixels"], seen(found), strict=False):
        click(window, pixel)
        click(window, point)
    window.see(
        lambda: [residual for _, _, residual in stands()["pairs"]],
        lambda residuals: residuals and -1 not in residuals,
        "alignment that nobody asked for",
    )


EDITOR = """
window = bpy.context.window_manager.windows[0]
area = next(area for area in window.screen.areas if area.type in {"DOPESHEET_EDITOR", "IMAGE_EDITOR"})
area.type = "IMAGE_EDITOR"
"""
LOOK = f"{EDITOR}\nimage = area.spaces.active.image\nopen(PATH, 'w').write(image.name if image else 'none')"


def test_an_editor_that_is_there_shows_the_photo_meanwhile_and_another_file_ends_it(window, tmp_path):
    write_image(tmp_path / "photo.png", np.full((*SIZE[::-1], 3), 0.3))

    def shown():
        window.ask("run", LOOK.replace("PATH", repr(str(tmp_path / "shown"))))
        return (tmp_path / "shown").read_text()

    window.ask("run", READY)
    window.ask("photo", str(tmp_path / "photo.png"))
    window.ask("run", f"{EDITOR}\narea.spaces.active.image = bpy.data.images.new('Mine', 8, 8)")
    window.ask("invoke", "pick_points", {})
    assert shown() == "photo"
    window.ask("invoke", "pick_points", {})  # pressed again
    assert shown() == "Mine"
    window.ask("invoke", "pick_points", {})
    assert shown() == "photo"
    window.ask("run", "bpy.ops.wm.read_homefile()")
    window.wait(lambda state: state["sidebar"] and "photo" not in state["images"], "another file")
    window.input("mousemove", 300, 400, "click", 1, "sleep", "1", "mousemove", 310, 410)
    assert shown() == "none"
