"""Presets: the same relief, lit from the same side, in a Blender that knows nothing of the bake; and glTF."""

import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest

from blender_addon.image_records import remember
from blender_addon.images import load_image
from mpsnet_core import read_image, write_camera, write_normals

from .rendering import detailed_object, matte, set_up_cycles, simplified, with_materials
from .test_bake_against_blender import add_sun, camera_at, normal_view

# What each program's documentation says: the file of an object called "Old Oak", whether green is up, bits.
EXPECTED = {
    "BLENDER": ("Old_Oak_normal.png", True, "uint16"),
    "UNREAL": ("T_Old_Oak_N.png", False, "uint16"),
    "UNITY": ("Old_Oak_Normal.png", True, "uint8"),
    "GODOT": ("old_oak_normal.png", True, "uint8"),
    "GLTF": ("Old_Oak_normal.png", True, "uint8"),
}
SIDE = (0.5, -1, 0.3)


@pytest.fixture
def seen(scene, tmp_path):
    """A low-poly called "Old Oak", beside the detailed one whose normals a camera saw; ready to be baked."""
    set_up_cycles(384)
    detailed = detailed_object()
    low = simplified(detailed, 3000)
    low.name = "Old Oak"
    with_materials(detailed, low)
    view = normal_view(SIDE, detailed, tmp_path / "view.exr", "ORTHO")
    for obj in (detailed, low):
        obj.data.materials[0] = matte()
    write_camera(tmp_path / "seen.camera.json", view.camera)
    write_normals(tmp_path / "seen.png", view.normals)
    image = load_image(tmp_path / "seen.png", "Seen", is_data=True)
    remember(image, "camera", (tmp_path / "seen.camera.json").read_text())
    scene.mps.estimate.image, scene.mps.bake.target, scene.mps.bake.size = image, low, 1024
    return low


def rendered(name: str, *jobs: str) -> None:
    """Render in a Blender of its own; see render_fresh.py."""
    script = Path(__file__).with_name("render_fresh.py")
    subprocess.run([sys.executable, str(script), name, *jobs], check=True, capture_output=True, timeout=300)


def test_every_preset_looks_like_the_true_geometry_in_a_fresh_blender(seen, scene, tmp_path):
    add_sun()
    scene.camera = camera_at(SIDE)
    scene.render.resolution_x = scene.render.resolution_y = 192
    scene.cycles.max_bounces, scene.cycles.samples = 0, 1
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "plain.blend"))
    for preset in EXPECTED:
        (tmp_path / preset).mkdir()
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / preset / "scene.blend"))
        bpy.ops.mps.bake(preset=preset)
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / preset / "scene.blend"))
    jobs = [f"{tmp_path / preset / 'scene.blend'}={tmp_path / preset}.exr" for preset in EXPECTED]
    flips = [f"{tmp_path / preset / 'scene.blend'}={tmp_path / preset}_flipped.exr=flip" for preset in EXPECTED]
    rendered("Old Oak", f"{tmp_path / 'plain.blend'}={tmp_path / 'plain.exr'}", *jobs, *flips)
    rendered("Detailed", f"{tmp_path / 'plain.blend'}={tmp_path / 'truth.exr'}")

    pictures = {file.stem: read_image(file) for file in tmp_path.glob("*.exr") if file.stem != "view"}
    truth = pictures["truth"]
    inside = np.all([picture.alpha > 0.99 for picture in pictures.values()], axis=0)

    def apart(name: str, other: str = "truth") -> float:
        return float(np.abs(pictures[name].pixels - pictures[other].pixels)[inside].mean())

    assert inside.mean() > 0.3 and truth.pixels[inside].std() > 0.05
    print({name: round(apart(name), 4) for name in pictures})
    for preset in EXPECTED:
        assert apart(preset) < 0.3 * apart("plain")
        assert apart(preset, "BLENDER") < 0.003
        # The same with green turned over: what this test has to be able to see.
        assert apart(f"{preset}_flipped") > 3 * apart(preset)
        assert apart(f"{preset}_flipped", "BLENDER") > 0.02


@pytest.mark.parametrize("preset", EXPECTED)
def test_the_file_is_named_and_written_as_the_preset_says(seen, scene, tmp_path, preset):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.mps.bake(preset=preset, size=64)
    name, up, kind = EXPECTED[preset]
    written = tmp_path / name
    source = oiio.ImageInput.open(str(written))
    assert str(source.spec().format) == kind
    source.close()
    settings = scene.mps.bake
    assert (settings.preset, settings.convention) == (preset, "OPENGL" if up else "DIRECTX")
    assert (settings.space, settings.file_format, settings.bits) == ("TANGENT", "PNG", kind.removeprefix("uint"))


def test_a_format_that_cannot_hold_the_presets_depth_takes_its_own(seen, scene, tmp_path):
    settings = scene.mps.bake
    settings.preset = "GLTF"
    bpy.ops.mps.bake(preset="CUSTOM", file_format="EXR", size=32, output=f"{tmp_path}/")
    assert (settings.bits, settings.convention) == ("AUTO", "OPENGL") and (tmp_path / "Old_Oak_normal.exr").exists()
    settings.bits = "32"
    settings.file_format = "TIFF"
    assert settings.bits == "32"
    settings.file_format = "PNG"
    assert settings.bits == "AUTO"
