"""Presets: the same relief, lit from the same side, in a Blender that knows nothing of the bake; and glTF."""

import json
import struct
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

from .rendering import array_of, matte
from .test_bake_against_blender import (
    add_sun,
    camera_at,
    detailed_object,
    normal_view,
    set_up_cycles,
    simplified,
    with_materials,
)

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


def test_a_folder_gets_the_texture_by_the_presets_name(seen, scene, tmp_path):
    (tmp_path / "there").mkdir()
    bpy.ops.mps.bake(preset="UNREAL", size=32, output=str(tmp_path / "there"))
    bpy.ops.mps.bake(size=32, output=f"{tmp_path / 'new'}/")
    seen.data.materials[0].name = "Bark"
    bpy.ops.mps.bake(size=32, split="MATERIAL", output=f"{tmp_path / 'new'}/")
    written = sorted(str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*_N.png"))
    assert written == ["new/T_Bark_N.png", "new/T_Old_Oak_N.png", "there/T_Old_Oak_N.png"]


def test_what_is_set_after_or_beside_the_preset_wins(seen, scene, tmp_path):
    settings = scene.mps.bake
    settings.preset = "UNREAL"
    assert settings.convention == "DIRECTX"
    settings.convention = "OPENGL"
    bpy.ops.mps.bake(size=32, output=str(tmp_path / "a.png"))
    assert (settings.preset, settings.convention) == ("UNREAL", "OPENGL")
    bpy.ops.mps.bake(size=32, preset="UNREAL", bits="8", output=str(tmp_path / "b.png"))
    assert (settings.convention, settings.bits) == ("DIRECTX", "8")


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


def glb(path: Path) -> tuple[dict, bytes]:
    """The JSON and the binary chunk of a GLB file."""
    data = path.read_bytes()
    assert data[:4] == b"glTF"
    length, kind = struct.unpack("<I4s", data[12:20])
    assert kind == b"JSON"
    return json.loads(data[20 : 20 + length]), data[20 + length + 8 :]


def accessor(scene: dict, binary: bytes, number: int) -> np.ndarray:
    described = scene["accessors"][number]
    view = scene["bufferViews"][described["bufferView"]]
    assert described["componentType"] == 5126 and "byteStride" not in view  # packed float32
    width = {"VEC2": 2, "VEC3": 3, "VEC4": 4}[described["type"]]
    start = view.get("byteOffset", 0) + described.get("byteOffset", 0)
    return np.frombuffer(binary, np.float32, described["count"] * width, start).reshape(-1, width)


def test_blenders_gltf_exporter_takes_the_texture_along_as_it_is(seen, scene, tmp_path):
    seen.data.uv_layers.new(name="Second")  # the bake's UV map is not the only one
    bpy.ops.mps.bake(preset="GLTF", size=128, output=str(tmp_path / "oak.png"))
    bpy.data.objects["Detailed"].hide_set(True)
    bpy.ops.object.select_all(action="DESELECT")
    seen.select_set(True)
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "oak.glb"), use_selection=True, export_tangents=True)
    exported, binary = glb(tmp_path / "oak.glb")
    (material,) = exported["materials"]
    texture = material["normalTexture"]
    assert texture.get("scale", 1) == 1 and "extensions" not in texture
    image = exported["images"][exported["textures"][texture["index"]]["source"]]
    assert image["mimeType"] == "image/png"
    view = exported["bufferViews"][image["bufferView"]]
    start = view.get("byteOffset", 0)
    (tmp_path / "exported.png").write_bytes(binary[start : start + view["byteLength"]])
    ours, theirs = (read_image(tmp_path / name, encoding="linear").pixels for name in ("oak.png", "exported.png"))
    assert np.array_equal(ours, theirs)

    attributes = exported["meshes"][0]["primitives"][0]["attributes"]
    uvs = accessor(exported, binary, attributes[f"TEXCOORD_{texture.get('texCoord', 0)}"])
    points, tangents = (accessor(exported, binary, attributes[name]) for name in ("POSITION", "TANGENT"))
    mesh = seen.data
    mesh.calc_tangents(uvmap=mesh.uv_layers[0].name)
    vertex = array_of(mesh.loops, "vertex_index", 1, np.int32).ravel()
    corners = array_of(mesh.vertices, "co", 3)[vertex]
    expected = np.hstack([array_of(mesh.loops, "tangent", 3), array_of(mesh.loops, "bitangent_sign", 1)])

    def keyed(places: np.ndarray, uv: np.ndarray) -> list[tuple]:
        return [tuple(row) for row in np.round(np.hstack([places, uv]).astype(np.float64), 3).tolist()]

    # glTF's y is up, and its v points down the picture.
    of_corner = dict(
        zip(keyed(corners, array_of(mesh.uv_layers[0].uv, "vector", 2)), expected, strict=True),
    )
    back = points[:, [0, 2, 1]] * [1, -1, 1]
    found = [of_corner.get(key) for key in keyed(back, uvs * [1, -1] + [0, 1])]
    known = np.array([one is not None for one in found])
    assert known.mean() > 0.98  # the others are rounded the other way
    blenders = np.array([one for one in found if one is not None])
    turned = tangents[known][:, [0, 2, 1]] * [1, -1, 1]
    close = (turned * blenders[:, :3]).sum(1) > 0.99
    assert close.mean() > 0.97 and (tangents[known][:, 3] == blenders[:, 3]).mean() > 0.97
