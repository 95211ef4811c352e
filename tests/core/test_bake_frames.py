"""A sequence of normal maps becomes a sequence of textures, a frame as it would be baked alone."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from mesh_file import write_mesh
from surface_shapes import camera_looking, sphere_mesh, sphere_view
from synthetic import left_by, listing

from mpsnet_core import NormalMap, write_camera, write_normals
from mpsnet_core.cli import main
from mpsnet_core.io.image_reading import image_description

NUMBERS = (7, 8, 10)


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """Normals of a sphere whose relief differs from frame to frame; frame 9 is missing."""
    camera = camera_looking((0.3, -1, 0.2), size=48)
    view = sphere_view(camera)
    write_camera(tmp_path / "camera.json", camera)
    write_mesh(tmp_path / "mesh.npz", sphere_mesh(24, 12))
    (tmp_path / "normals").mkdir()
    for number in NUMBERS:
        bent = NormalMap(view.normals.vectors + np.float32([0.05 * number, 0, 0]), view.normals.mask)
        write_normals(tmp_path / "normals" / f"f_{number}_normals.png", bent)
    return tmp_path


def bake(bench: Path, normals: str = "normals/f_#_normals.png", output: str = "skin", *more: str) -> int:
    view = f"{bench / 'camera.json'}={bench / normals}"
    command = ["bake", "--mesh", str(bench / "mesh.npz"), "--view", view, "--size", "32", "--space", "object"]
    return main([*command, "--progress", "none", "-o", str(bench / output), *more])


@pytest.mark.parametrize("normals", ["normals", "normals/f_*_normals.png"])
def test_each_frame_is_baked_as_alone(bench: Path, normals: str) -> None:
    assert bake(bench, normals) == 0
    assert listing(bench / "skin") == [f"skin_{number:04d}.png" for number in NUMBERS]
    for number in NUMBERS:
        assert bake(bench, f"normals/f_{number}_normals.png", "alone.png") == 0
        from mpsnet_core.io.image_reading import read_image

        alone, frame = (read_image(bench / n).pixels for n in ("alone.png", f"skin/skin_{number:04d}.png"))
        np.testing.assert_array_equal(frame, alone)


def test_what_is_there_is_not_made_again_unless_it_is_of_something_else(bench: Path) -> None:
    bake(bench, "normals")
    skin = bench / "skin"
    made = {file.name: file.stat().st_mtime_ns for file in skin.iterdir()}

    def again(*more: str) -> set[str]:
        assert bake(bench, "normals", "skin", *more) == 0
        now = {file.name: file.stat().st_mtime_ns for file in skin.iterdir()}
        changed = {name for name in now if now[name] != made.get(name)}
        made.update(now)
        return changed

    assert again() == set()
    (skin / "skin_0008.png").unlink()
    assert again() == {"skin_0008.png"}
    map_file = bench / "normals" / "f_10_normals.png"
    map_file.write_bytes((bench / "normals" / "f_7_normals.png").read_bytes())
    assert again() == {"skin_0010.png"}
    assert again("--convention", "opengl", "--level", "auto", "--format", "png") == set()  # what is taken unless given
    given: list[str] = []
    for another in (("--convention", "directx"), ("--bits", "8"), ("--level", "on"), ("--strength", "0.5")):
        given += another
        assert len(again(*given)) == 3, another
    assert len(again("--margin", "3")) == 3
    whole = (skin / "skin_0007.png").read_bytes()
    (skin / "skin_0007.png").write_bytes(whole[:-9])
    left_by(999999999, skin / "skin_0008.png").write_bytes(b"left by a run that was killed")
    assert again("--margin", "3") == {"skin_0007.png"}
    assert image_description(skin / "skin_0007.png").startswith("texture by mpsnet")
    assert (skin / "skin_0007.png").read_bytes() == whole
    assert not [name for name in listing(skin) if "unfinished" in name]


def test_a_broken_frame_is_named_and_the_others_are_baked(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = bench / "normals" / "f_7_normals.png"
    whole = broken.read_bytes()
    broken.write_bytes(whole[:100])
    assert bake(bench, "normals", "skin", "--progress", "json") == 2
    result = json.loads(capsys.readouterr().out.splitlines()[-1])["result"]
    assert listing(bench / "skin") == ["skin_0008.png", "skin_0010.png"]
    assert (result["first"], result["last"], result["count"], result["made"]) == (8, 10, 2, 2)
    [sentence] = result["failed"]
    assert str(broken) in sentence
    broken.write_bytes(whole)
    assert bake(bench, "normals", "skin", "--progress", "json") == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])["result"]
    assert (result["first"], result["made"], result["there"], result.get("failed")) == (7, 1, 2, None)


def test_meshes_and_cameras_may_move_along(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A mesh and a camera turned about the same axis give the first frame's texture again."""
    for number in NUMBERS:
        write_camera(bench / f"camera_{number:02d}.json", camera_looking((0.3, -1, 0.2), size=48))
        write_mesh(bench / f"mesh_{number:02d}.npz", sphere_mesh(24, 12))
    (bench / "camera_08.json").unlink()
    view = f"{bench / 'camera_##.json'}={bench / 'normals'}"
    command = ["bake", "--mesh", str(bench / "mesh_##.npz"), "--view", view, "--size", "16", "--space", "object"]
    assert main([*command, "--progress", "json", "-o", str(bench / "skin"), "--format", "exr"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])["result"]
    assert [Path(result["first_output"]).name, result["first"], result["last"]] == ["skin_0007.exr", 7, 10]
    assert (result["count"], result["made"], result["there"]) == (2, 2, 0)
    assert "1 frame(s) are left out" in result["notes"][0]
    assert listing(bench / "skin") == ["skin_0007.exr", "skin_0010.exr"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("none/*.png", "skin"), "no normal map matches .*; check the pattern"),
        (("normals", "normals/f_7_normals.png"), "is one file, but a sequence is baked; give a folder"),
        (("normals", "skin", "--confidence", "c.png"), "--confidence is for a single pose; leave it out"),
        (("odd", "skin"), "their names may differ in one number only"),
        (("broken", "skin"), r"all 3 that were tried failed; the first: .*b_1\.png: "),
    ],
)
def test_bad_input_gets_one_sentence(bench: Path, capsys, arguments: tuple[str, ...], sentence: str) -> None:
    source = (bench / "normals" / "f_7_normals.png").read_bytes()
    for folder, names in (("odd", ("a.png", "b.png")), ("broken", ("b_1.png", "b_2.png", "b_3.png", "b_4.png"))):
        (bench / folder).mkdir()
        for name in names:
            (bench / folder / name).write_bytes(source[: 100 if folder == "broken" else None])
    assert bake(bench, *arguments) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(sentence, line), line
