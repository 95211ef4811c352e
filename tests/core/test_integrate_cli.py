"""The verb integrate, from a normal map to all that is made of it; and what is said of bad input."""

import json
from pathlib import Path

import numpy as np
import pytest
from height_shapes import ball, orthographic
from mesh_file import write_mesh
from relief_shapes import cube_sphere
from synthetic import listing, write_file

from mpsnet_core import Camera, NormalMap, read_height, read_image, read_mesh, write_camera, write_normals
from mpsnet_core.cli import main
from mpsnet_core.io.image_reading import read_channel

BALL = ball(orthographic(64, 72, 16), (0, 0, 0), 3.5)  # larger than the picture: no rim
NEAR = ball(Camera("perspective", 72, 64, (100.0, 100.0)), (0, 0, -6), 2.6)
ALL = "--height h.png --mesh m.ply --curvature c.exr --occlusion ao.png --relit r.png"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, surface in (("n.png", BALL), ("near.exr", NEAR)):
        write_normals(name, surface.normals)
    write_camera("camera.json", BALL.camera)
    write_camera("near.json", NEAR.camera)
    return tmp_path


def result(capsys: pytest.CaptureFixture[str], words: str) -> dict:
    code = main(["integrate", *words.split(), "--progress", "json"])
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert code == 0, lines
    fractions = [line["progress"] for line in lines if "progress" in line]
    assert fractions == sorted(fractions) and fractions[-1] == 1
    return lines[-1]["result"]


def test_all_at_once(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = result(capsys, f"n.png --camera camera.json --unit mm --faces 3000 --distance 5 {ALL}")
    assert "at the camera" not in found["text"]
    assert found["outputs"] == ["h.png", "h.png.json", "c.exr", "ao.png", "r.png", "m.ply"]
    assert found["unit"] == "mm"
    truth = BALL.heights.values - BALL.heights.values.mean()
    heights = read_height("h.png").values
    assert np.abs(heights - truth).max() < 0.02
    assert found["height"]["black"] == pytest.approx(truth.min(), abs=0.02)
    assert found["height"]["white"] == pytest.approx(truth.max(), abs=0.02)
    mesh = read_mesh("m.ply")
    assert mesh.vertices[:, 2].max() == pytest.approx(truth.max() - 5, abs=0.02)
    assert mesh.vertices[:, 2].min() == pytest.approx(truth.min() - 5, abs=0.02)
    assert np.median(read_channel("c.exr")) == pytest.approx(2 / 3.5, rel=0.01)
    assert found["occlusion"]["mean"] > 0.99
    assert read_image("r.png").pixels.shape == (64, 72, 3)
    lines = found["text"].splitlines()
    assert [line.split(":")[0] for line in lines] == ["h.png", "c.exr", "ao.png", "r.png", "m.ply"]
    assert lines[0].startswith("h.png: black is -") and " mm, white " in lines[0]


def test_heights_may_be_called_after_a_mask(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert result(capsys, "n.png --height face_mask.exr")["outputs"] == ["face_mask.exr", "face_mask.exr.json"]


def test_a_lens_and_a_distance_give_the_size(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mean = float(NEAR.depth[NEAR.mask].mean())
    found = result(capsys, f"near.exr --camera near.json --distance {mean} --height h.exr --curvature c.exr")
    assert "height 0 is at the camera" in found["text"] and "midlevel -" in found["text"]
    heights = read_height("h.exr")
    assert np.abs(heights.values - NEAR.heights.values)[NEAR.mask].max() < 0.02
    assert np.median(read_channel("c.exr")[NEAR.mask]) == pytest.approx(2 / 2.6, rel=0.01)
    assert not found["notes"]
    focal = 36 * 100 / 72
    assert "counts as 1" in result(capsys, f"near.exr --focal {focal} --height g.exr")["notes"][0]
    assert np.abs(read_height("g.exr").values * mean - heights.values).max() < 1e-3


def test_pixels_are_the_unit_where_nothing_else_is_reported(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = result(capsys, "n.png --height h.exr")
    assert found["unit"] == "pixel"
    pixels = read_height("h.exr").values
    result(capsys, "n.png --pixel-size 0.25 --unit mm --height h.exr")
    assert read_height("h.exr").values == pytest.approx(0.25 * pixels, abs=1e-4)
    assert json.loads(Path("h.exr.json").read_text())["unit"] == "mm"


def test_a_mesh_without_a_face_costs_none_of_the_others(here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert (
        main(["integrate", *["n.png", "--mesh", "m.ply", "--faces", "1", "--height", "h.exr", "--curvature", "c.exr"]])
        == 2
    )
    assert "no face is left of the surface; allow more faces" in capfd.readouterr().err
    assert {"h.exr", "c.exr"} < set(listing(here)) and not Path("m.ply").exists()


def test_the_curvature_picture_states_its_range(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = result(capsys, "n.png --curvature c.png --curvature-range 0.1 --curvature-radius 4")
    assert found["curvature"]["range"] == 0.1
    assert "white is convex by 0.1 / pixel" in found["text"]
    expected = 0.5 + 0.5 * (2 / (3.5 * 16)) / 0.1
    assert np.median(read_channel("c.png")) == pytest.approx(expected, abs=0.002)


def test_blenders_world_is_turned_for_y_up_formats(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, up in (("--camera camera.json", "z"), ("--camera camera.json --up y", "y"), ("", "y")):
        assert result(capsys, f"n.png {words} --mesh m.obj --faces 500")["mesh"]["up"] == up


BAD: list[tuple[str, str]] = [
    ("n.png", "nothing is requested; give at least one of --height, --curvature, --occlusion, --relit, --mesh"),
    ("flat.png --height h.png", "flat.png is not a normal map"),
    ("n_##.png --height h.png", "matches several normal maps; integrate them one by one"),
    ("inwards.png --height h.png", "inwards.png is not in camera space: many of its normals point away from the"),
    ("n.png --uvs mesh.npz", "name their file with --height"),
    ("n.png --uvs mesh.npz --height h.exr --focal 50", "--focal goes with a photo's normals"),
    ("n.png --uvs mesh.npz --height mesh.npz", ".npz is not a supported image format"),
    ("n.png --uvs mesh.npz --base gone.obj --height h.exr", "mesh file gone.obj does not exist"),
    ("n.png --uvs mesh.npz --height n.png", "would overwrite n.png"),
    ("n.png --height h.png --space object", "--space goes with --uvs, which is not given"),
    ("n.png --curvature c.png --height-bits 32", "--height-bits goes with --height, which is not given"),
    ("n.png --height h.png --height-bits 8", "heights in 8 bits show steps"),
    ("n.png --height small.png", "would overwrite small.png.json, which this program did not make"),
    ("n.png --height oak.png", "would overwrite oak.png.mask.png, which this program did not make"),
    ("n.png --height h.png --occlusion h.png.mask.png", "the result would overwrite h.png.mask.png"),
    ("thin.png --height h.png --mesh m.ply", "thin.png: the surface is nowhere two pixels wide and high"),
    ("n_<UDIM>.png --height h.png", "n_<UDIM>.png stands for several textures; name one, with a"),
    ("n.png --mesh m.ply --open 91", "between 0 and 90 degrees on, not 91"),
    ("n.png --relit r.exr", "a relit picture is for the screen; use .png or .tif"),
    ("n.png --relit r.png --light nan,nan", "--light nan,nan is not known"),
    ("n.png --height h.png --relit r.png --albedo flat.png", "the albedo is 8 x 8 but the normal map is 72 x 64"),
    ("n.png --height h.png --camera small.json", "n.png: the camera is 8 x 8 but the photo is 72 x 64"),
    ("n.png --height h.png --focal 50 --pixel-size 1", "--camera and --focal define the same camera; give one"),
    ("n.png --height h.png --pixel-size nan", "--pixel-size nan cannot be used"),
    ("n.png --mesh m.ply --distance nan", "cannot be used; give a number above 0"),
    ("n.png --height h.png --distance 3", "--distance goes with --camera, --focal or --mesh; give one, or leave it"),
]


@pytest.mark.parametrize(("words", "said"), BAD, ids=[words for words, _ in BAD])
def test_bad_input(here: Path, capfd: pytest.CaptureFixture[str], words: str, said: str) -> None:
    write_file(here / "flat.png", np.full((8, 8, 3), 0.1), "uint8")
    half = np.where(np.arange(16) < 8, 1, -1)[:, None, None] * (0, 0, 0.5) + 0.5
    write_file(here / "inwards.png", np.broadcast_to(half, (16, 16, 3)), "uint16")
    write_file(here / "thin.png", np.broadcast_to((0.5, 0.5, 1.0), (1, 30, 3)), "uint16")
    write_mesh(here / "mesh.npz", cube_sphere(2))
    (here / "oak.png.mask.png").write_bytes(b"somebody's own")
    for name in ("small.json", "small.png.json"):
        write_camera(here / name, orthographic(8, 8))
    before = {name: (here / name).read_bytes() for name in listing(here)}
    assert main(["integrate", *words.split()]) == 2
    [line] = capfd.readouterr().err.splitlines()
    assert line.startswith("mpsnet: ") and said in line
    assert {name: (here / name).read_bytes() for name in listing(here)} == before


@pytest.mark.parametrize("lens", ["", "--focal 35"], ids=["from afar", "from near"])
def test_a_small_object_is_the_same_with_the_photo_around_it(here: Path, lens: str) -> None:
    """Where curvature is made too, the whole map is held."""
    vectors, mask = np.zeros((150, 170, 3), np.float32), np.zeros((150, 170), bool)
    vectors[37:101, 70:142], mask[37:101, 70:142] = NEAR.normals.vectors, NEAR.normals.mask
    write_normals("large.exr", NormalMap(vectors, mask))
    for name, more in (("part", ""), ("whole", "--curvature c.png")):
        words = f"integrate large.exr {lens} --height {name}_h.exr --occlusion {name}_o.exr {more}"
        assert main(words.split()) == 0
    for kind in "ho":
        part, whole = (read_channel(f"{name}_{kind}.exr") for name in ("part", "whole"))
        assert part.shape == mask.shape and np.ptp(whole) > 0
        np.testing.assert_allclose(part, whole, atol=2e-5 * np.ptp(whole) + 1e-6)
