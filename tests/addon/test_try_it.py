"""Try It and Relight: what a newcomer presses first."""

import math
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from blender_addon.bake.before_after import textures_of
from blender_addon.images import pixels_of
from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.io.image_reading import read_data

from .rendering import shader_of


@pytest.fixture(scope="module")
def tried(tmp_path_factory):
    """A file saved after Try It, made in a process of its own."""
    path = tmp_path_factory.mktemp("demo") / "tried.blend"
    script = f"""
import bpy, blender_addon
blender_addon.register()
bpy.ops.mps.try_it(pixels=256, samples=8, size=256)
bpy.ops.wm.save_as_mainfile(filepath={str(path)!r})
"""
    subprocess.run([sys.executable, "-c", script], check=True, stdout=subprocess.DEVNULL, timeout=300)
    return path


@pytest.fixture
def demo(scene, tried):
    """The demo's scene, from the saved file: what was in a temporary folder travels in it."""
    bpy.ops.wm.open_mainfile(filepath=str(tried))
    return bpy.context.scene


def test_the_demo_needs_no_file_and_leaves_the_other_scene_alone(demo):
    assert demo.name == "MPS Demo" and bpy.data.scenes["Scene"].mps.rig.lights.keys() == []
    images = [demo.mps.photo.image, demo.mps.estimate.image, demo.mps.bake.image]
    assert all(image.packed_file for image in images)
    assert not any((demo.mps.photo.output, demo.mps.estimate.output, demo.mps.bake.output))
    low = bpy.context.view_layer.objects.active
    assert low.name == "Demo Low Poly" and low.visible_get() and not low.hide_render
    assert not bpy.data.objects["Demo Detailed"].visible_get()
    assert np.ptp(pixels_of(images[2])[..., :2]) > 0.5  # relief, not a flat blue
    colours = pixels_of(textures_of(low)["albedo"])[..., :3]
    assert min(np.ptp(colours[..., 0] - colours[..., 2]), np.ptp(colours)) > 0.3  # gold and blue


@pytest.mark.accuracy
def test_the_demo_shows_what_the_normals_are_worth(demo, tmp_path):
    """The estimate, against the normals that Blender renders of the same view."""
    truth, shown = tmp_path / "truth.exr", bpy.data.objects["Demo Detailed"]
    shown.hide_render, bpy.data.objects["Demo Low Poly"].hide_render = False, True
    shown.hide_set(False)
    bpy.ops.mps.render_truth(output=str(truth))
    world, _ = read_data(truth, layer="Normal")
    _, alpha = read_data(truth, layer="Combined")
    turn = np.array(demo.mps.rig.camera.matrix_world.normalized().to_3x3(), np.float32)
    estimate = pixels_of(demo.mps.estimate.image)[::-1]
    inside = (alpha > 0.99) & (estimate[..., 3] > 0.99)
    assert angular_error(estimate[inside][:, :3] * 2 - 1, world[inside] @ turn).mean() < 12


def test_what_a_step_says_is_what_the_demo_says(scene, tmp_path):
    (tmp_path / "MPS_Demo_photo.rig.json").mkdir()
    with pytest.raises(RuntimeError) as told:
        bpy.ops.mps.try_it(pixels=32, samples=1, output=str(tmp_path))
    assert "Traceback" not in str(told.value) and "MPS_Demo_photo.rig.json" in str(told.value)
    assert "MPS_Demo_photo.rig.json" in scene.mps.records["try_it"].error


def test_a_folder_that_cannot_be_leaves_no_half_made_demo(scene, tmp_path):
    with pytest.raises(RuntimeError, match="nowhere does not exist"):
        bpy.ops.mps.try_it(output=str(tmp_path / "nowhere" / "demo"))
    assert bpy.data.scenes[:] == [scene] and bpy.context.scene == scene


@pytest.mark.parametrize("stuck", ["photo.exr/MPS_Demo_photo", "texture.png/Demo_Low_Poly_normal"])
def test_a_demo_that_comes_to_no_end_leaves_nothing(scene, tmp_path, stuck):
    (tmp_path / f"MPS_Demo_{stuck}{Path(stuck).parent.suffix}").mkdir(parents=True)
    before = everything()
    with pytest.raises(RuntimeError, match=stuck):
        bpy.ops.mps.try_it(pixels=32, samples=1, size=16, output=str(tmp_path))
    assert bpy.context.scene == scene and everything() == before


def everything():
    """The names of all datablocks but the picture that Blender keeps of any render."""
    kinds = ("scenes", "objects", "meshes", "materials", "images", "lights", "cameras", "collections", "textures")
    return {kind: set(getattr(bpy.data, kind).keys()) - {"Render Result"} for kind in kinds}


def test_relight_takes_the_rigs_place_and_gives_it_back(sphere):
    bpy.ops.mps.add_rig(view="RIGHT")
    settings, before = bpy.context.scene.mps, set(bpy.data.objects)
    lights = [light.object for light in settings.rig.lights]
    sphere.select_set(True)
    bpy.ops.mps.relight()
    lamp = settings.relight.lamp
    assert lamp.data.type == "SUN" and tuple(lamp.data.color) == (1, 1, 1)
    bpy.context.view_layer.update()
    # From the side that the rig's camera sees the sphere from, and aslant.
    towards = lamp.matrix_world.to_3x3().col[2]
    assert math.degrees(towards.angle((1, 0, 0))) == pytest.approx(74, abs=0.1)
    assert all(light.hide_get() for light in lights)
    bpy.ops.mps.render_photo(width=16, height=16, samples=1)  # the lamp is for the viewport alone
    bpy.ops.mps.relight()
    assert settings.relight.lamp is None and set(bpy.data.objects) == before
    assert not any(light.hide_get() for light in lights)
    assert not [light for light in bpy.data.lights if light.name.startswith(("MPS White", "MPS Fill"))]


def test_relight_hides_the_lights_of_all_rigs_and_shows_only_those_that_it_hid(sphere, scene):
    bpy.ops.mps.add_rig()
    first = [light.object for light in scene.mps.rig.lights]
    first[0].hide_set(True)
    bpy.ops.mps.new_rig()
    sphere.select_set(True)
    bpy.ops.mps.add_rig(view="BACK")
    second = [light.object for light in scene.mps.rig.lights]
    bpy.ops.mps.relight()
    assert all(light.hide_get() for light in first + second)
    bpy.ops.mps.choose_rig(index=0)
    bpy.ops.mps.relight()
    assert [light.hide_get() for light in first + second] == [True, False, False, False, False, False]


def test_relight_gives_the_viewport_that_it_took_its_shading_back(sphere):
    view, *_ = [area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D"]
    others = [
        area.spaces.active.shading
        for screen in bpy.data.screens
        for area in screen.areas
        if area.type == "VIEW_3D" and area != view
    ]
    before = [one.type for one in others]
    shading = view.spaces.active.shading
    shading.type = "MATERIAL"
    shading.studiolight_intensity = 0.7
    shading.type = "WIREFRAME"
    with bpy.context.temp_override(area=view):
        bpy.ops.mps.relight()
    assert shading.type == "MATERIAL"
    bpy.ops.mps.relight()  # from somewhere else
    assert shading.type == "WIREFRAME"
    shading.type = "MATERIAL"
    assert shading.studiolight_intensity == pytest.approx(0.7)
    assert [one.type for one in others] == before


def test_relight_survives_the_file_and_its_lamps_deletion(sphere, tmp_path):
    bpy.ops.mps.add_rig()
    sphere.select_set(True)
    bpy.ops.mps.relight()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "lit.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "lit.blend"))
    settings = bpy.context.scene.mps
    bpy.data.objects.remove(settings.relight.lamp)
    bpy.ops.mps.relight()  # begins anew, in place of what is left of the old one
    assert settings.relight.lamp is not None
    bpy.ops.mps.relight()
    assert not [obj for obj in bpy.data.objects if obj.name.startswith(("MPS White", "MPS Relight"))]


def test_relight_of_nothing(scene):
    with pytest.raises(RuntimeError, match="no selected object has a surface"):
        bpy.ops.mps.relight()


def test_relights_key_grazes_what_is_seen_and_shows_it_in_contrast(sphere):
    """By the lamps as they stand: of a matt sphere's front, a part is dark, the rest has many greys, nothing clips."""
    bpy.ops.mps.relight()
    bpy.context.view_layer.update()
    lamps = [obj for obj in bpy.context.scene.objects if obj.type == "LIGHT"]
    y, x = np.mgrid[-1:1:101j, -1:1:101j]
    inside = x**2 + y**2 < 0.95
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)[inside]
    viewer = np.array(bpy.context.scene.mps.relight.pivot.matrix_world.to_3x3())
    towards = [np.array(lamp.matrix_world.to_3x3())[:, 2] @ viewer for lamp in lamps]
    grey = sum(
        0.5 * lamp.data.energy / np.pi * np.maximum(normals @ way, 0) for lamp, way in zip(lamps, towards, strict=True)
    )
    lit = linear_to_srgb(grey[grey > 0.1])
    assert np.ptp(np.percentile(lit, [10, 90])) > 0.25 and grey.max() < 1
    assert 0.2 < (grey < 0.1).mean() < 0.6
    bpy.ops.mps.relight()
    assert not [obj for obj in bpy.context.scene.objects if obj.type == "LIGHT"]


def test_one_comes_back_from_the_demo(scene, monkeypatch):
    mine, demo = bpy.context.scene, bpy.data.scenes.new("Demo")
    assert not bpy.ops.mps.back_to_scene.poll()
    demo["mpsnet_before"] = mine
    bpy.context.window.scene = demo
    bpy.ops.mps.back_to_scene()
    assert bpy.context.window.scene == mine


def test_relight_shows_the_relief_in_grey_and_leaves_the_materials_alone(estimated, scene, tmp_path):
    """The colour and the gloss are gone, the normal map is not. An albedo that was baked stays."""
    bpy.ops.mps.bake(size=64, output=str(tmp_path / "texture.png"))
    material = estimated.material_slots[0].material
    shader = shader_of(material.node_tree)
    shader.inputs["Base Color"].default_value = (0.4, 0.02, 0.02, 1)
    shader.inputs["Metallic"].default_value = 1
    before = set(bpy.data.objects), set(bpy.data.materials)
    estimated.select_set(True)
    bpy.ops.mps.relight()
    (overlay,) = (obj for obj in set(bpy.data.objects) - before[0] if obj.type == "MESH")
    shown, own = overlay.material_slots[0].material, estimated.material_slots[0].material
    assert own == material and tuple(shader.inputs["Base Color"].default_value[:2]) == pytest.approx((0.4, 0.02))
    grey = shader_of(shown.node_tree).inputs
    assert len(set(grey["Base Color"].default_value[:3])) == 1 and grey["Metallic"].default_value == 0
    (link,) = grey["Normal"].links
    assert link.from_node.inputs["Color"].links[0].from_node.image == scene.mps.bake.image
    bpy.ops.mps.relight()
    assert (set(bpy.data.objects), set(bpy.data.materials)) == before

    material.node_tree.nodes.new("ShaderNodeTexImage").name = "MPS Albedo"  # known colours are shown
    for neutral in (True, False):
        scene.mps.relight.neutral = neutral
        bpy.ops.mps.relight()
        assert not scene.mps.relight.overlays
        bpy.ops.mps.relight()
