"""Presets: each engine's file as its documentation asks for it, read without the core's help."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from mesh_file import write_mesh
from surface_shapes import camera_looking, sphere_mesh, sphere_view

from mpsnet_core import PRESETS, write_camera, write_normals
from mpsnet_core.cli import main

# What the engines' documentation says: the file of an object called HeroHead, whether green is up, bits.
EXPECTED = {
    "blender": ("HeroHead_normal.png", True, 16),
    "unreal": ("T_HeroHead_N.png", False, 16),
    "unity": ("HeroHead_Normal.png", True, 8),
    "godot": ("hero_head_normal.png", True, 8),
    "gltf": ("HeroHead_normal.png", True, 8),
}


@pytest.fixture
def tilted(tmp_path: Path) -> list[str]:
    """`mpsnet bake` of a sphere seen by a view that is turned up: what was flat points towards +v in tangent space."""
    view = sphere_view(camera_looking((1, 0, 0), size=96))
    up = view.normals.vectors + np.array([0, 0.5, 0]) * view.normals.mask[..., None]
    write_camera(tmp_path / "camera.json", view.camera)
    write_normals(tmp_path / "normals.exr", type(view.normals)(up, view.normals.mask))
    write_mesh(tmp_path / "HeroHead.npz", sphere_mesh())
    (tmp_path / "out").mkdir()
    views = f"{tmp_path / 'camera.json'}={tmp_path / 'normals.exr'}"
    return ["bake", "--mesh", str(tmp_path / "HeroHead.npz"), "--view", views, "--size", "64"]


def stored(path: Path) -> tuple[str, np.ndarray]:
    """The type of the file's numbers, and its values (H, W, C) 0 to 1."""
    source = oiio.ImageInput.open(str(path))
    kind, values = str(source.spec().format), source.read_image(oiio.FLOAT)
    source.close()
    return kind, values


def middle_green(path: Path) -> float:
    """Green in the texture's middle, where the view from +x sees the sphere straight on."""
    return float(stored(path)[1][30:34, 15:17, 1].mean())


@pytest.mark.parametrize("name", EXPECTED)
def test_in_a_folder_each_preset_names_and_writes_its_file(name: str, tilted: list[str], tmp_path: Path) -> None:
    file, up, bits = EXPECTED[name]
    assert main([*tilted, "--preset", name, "-o", f"{tmp_path / 'out'}"]) == 0
    (written,) = (tmp_path / "out").iterdir()
    assert written.name == file
    assert stored(written)[0] == f"uint{bits}"
    assert abs(middle_green(written) - 0.5) > 0.1
    assert (middle_green(written) > 0.5) == up
    assert set(EXPECTED) == set(PRESETS)


def test_what_is_given_wins_over_the_preset(tilted: list[str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main([*tilted, "--preset", "unreal", "--convention", "opengl", "--bits", "8", "-o", str(out)]) == 0
    kind, _ = stored(out / "T_HeroHead_N.png")
    assert kind == "uint8" and middle_green(out / "T_HeroHead_N.png") > 0.5
    assert main([*tilted, "--preset", "unreal", "--format", "exr", "-o", str(out)]) == 0
    kind, _ = stored(out / "T_HeroHead_N.exr")
    assert kind == "float" and middle_green(out / "T_HeroHead_N.exr") < 0.5
    assert main([*tilted, "--preset", "unity", "--format", "PNG", "-o", str(out / "t.png")]) == 0
    assert stored(out / "t.png")[0] == "uint8"


@pytest.mark.parametrize("padding", [[], ["--padding", "push-pull"]])
def test_no_texture_is_too_small_for_a_margin_unasked_for(padding: list[str], tilted: list[str], tmp_path) -> None:
    assert main([*tilted, "--size", "8", *padding, "-o", str(tmp_path / "small.png")]) == 0
    assert stored(tmp_path / "small.png")[1].shape[:2] == (8, 8)


@pytest.mark.parametrize(
    ("given", "stem"),
    [
        ("HeroHead", "hero_head"),
        ("Old oak.001", "old_oak_001"),
        ("LOD2Mesh", "lod2_mesh"),
        ("already_so", "already_so"),
    ],
)
def test_godots_names_are_in_snake_case(given: str, stem: str) -> None:
    assert PRESETS["godot"].stem(given) == f"{stem}_normal"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--preset", "cryengine"], "preset 'cryengine' is not known; choose blender, unreal"),
        (["--preset", "gltf", "-o", "texture.exr"], "the preset for glTF writes .png, but texture.exr ends in .exr"),
        (["--preset", "unity", "--bits", "32"], "hold 8 or 16 bits per channel, not 32"),
        (["-o", "{folder}"], "it is a folder; give a file name"),
        (["--padding", "none", "--margin", "4"], "--margin goes with --padding nearest, not with none; leave it out"),
        (["--padding", "push-pull", "--margin", "0"], "--margin goes with --padding nearest, not with push-pull"),
    ],
)
def test_bad_presets_get_one_sentence(arguments: list[str], sentence: str, tilted: list[str], tmp_path, capsys) -> None:
    out = tmp_path / "out"
    given = [argument.format(folder=out) for argument in arguments]
    assert main([*tilted, "-o", str(out / "texture.png"), *given]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert sentence in line
    assert not list(out.iterdir())
