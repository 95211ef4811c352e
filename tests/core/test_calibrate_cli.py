"""The verb calibrate: rigs that it writes, pictures that it draws, and what it says of bad input."""

import contextlib
import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from ball_scene import CIRCLE, MIDDLE, SCENE
from mirror_ball import CROSSTALK, Scene, around, grey_photograph, lamps_around, photograph
from synthetic import degrees_between, listing, write_file

from mpsnet_core import Camera, read_image, write_camera
from mpsnet_core.cli import main
from mpsnet_core.scene.rig import LightRig, read_rig, write_lp, write_rig

ANGLES = [(30, 90), (35, 205), (25, 335)]
FACING = np.array([around(*angle) for angle in ANGLES])
LEFT, RIGHT = (-0.17, -0.02, -0.9), (0.16, -0.03, -0.85)
BETWEEN = (np.array(LEFT) + RIGHT) / 2
PAIR = Scene([(LEFT, 0.1), (RIGHT, 0.1)], lamps_around(BETWEEN, 0.8), (450, 300), 675)
MATT = Scene([(MIDDLE, 70.0)], [], (240, 200))


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with photos of mirror balls and grey balls, a rig, a camera and masks."""
    folder = tmp_path_factory.mktemp("photos")
    write_file(folder / "ball.exr", photograph(SCENE), "float")
    white = np.ones((3, 3))
    for light in range(3):
        write_file(folder / f"only{light}.png", photograph(SCENE, white, on=[light]) ** (1 / 2.2), "uint8")
        mixing = CROSSTALK * np.eye(3)[light]
        write_file(folder / f"grey{light}.exr", grey_photograph(MATT, mixing, FACING), "float")
    write_file(folder / "pair.exr", photograph(PAIR), "float")
    write_file(folder / "grey.exr", grey_photograph(MATT, CROSSTALK, FACING), "float")
    write_camera(folder / "camera.json", Camera("perspective", 450, 300, np.array([675.0, 675.0])))
    write_rig(folder / "rig.json", LightRig(FACING))
    x, y = np.meshgrid(np.arange(240) + 0.5, np.arange(200) + 0.5)
    write_file(folder / "mask.png", (np.hypot(x - 130, y - 105) < 70) * 1.0, "uint8")
    write_file(folder / "small.png", np.ones((20, 20)), "uint8")
    write_file(folder / "flat.exr", np.full((200, 240, 3), 0.3), "float")
    write_file(folder / "black.exr", np.zeros((200, 240, 3)), "float")
    write_file(folder / "other.exr", np.zeros((50, 60, 3)), "float")
    (folder / "text.txt").write_text("no photo")
    return folder


def result_of(stdout: str) -> dict[str, Any]:
    return json.loads(stdout.splitlines()[-1])["result"]


def picture(path: Path) -> np.ndarray:
    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT))


def test_words_are_drawn_wherever_the_environment_looks_for_another_openimageio(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, elsewhere = (tmp_path / name for name in ("here.png", "elsewhere.png"))
    # To look for the ball takes longer than all else.
    command = ["calibrate", "lights", str(photos / "ball.exr"), "--circle", CIRCLE, "-o", str(tmp_path / "rig.json")]
    monkeypatch.delenv("OpenImageIO_ROOT", raising=False)
    assert main([*command, "--overlay", str(here)]) == 0
    environment = {**os.environ, "OpenImageIO_ROOT": str(tmp_path)}
    module = [sys.executable, "-m", "mpsnet_core"]
    subprocess.run([*module, *command, "--overlay", elsewhere], env=environment, check=True)
    np.testing.assert_array_equal(picture(elsewhere), picture(here))


def test_one_photo_becomes_a_rig(mpsnet, photos: Path, tmp_path: Path) -> None:
    rig, overlay, told = tmp_path / "rig.json", tmp_path / "overlay.png", tmp_path / "told.json"
    command = ["calibrate", "lights", photos / "ball.exr", "--overlay", overlay, "--json", told, "-o", rig]
    done = mpsnet(*command, "--progress", "json")
    assert (done.returncode, done.stderr) == (0, "")
    assert listing(tmp_path) == ["overlay.png", "rig.json", "told.json"]
    assert degrees_between(read_rig(rig).directions, FACING).max() < 0.7
    result = result_of(done.stdout)
    assert json.loads(told.read_text()).items() <= result.items()
    assert [light["name"] for light in result["lights"]] == ["red", "green", "blue"]
    for light, (slant, tilt) in zip(result["lights"], ANGLES, strict=True):
        assert (light["slant"], light["tilt"]) == pytest.approx((slant, tilt), abs=1)
        assert 1 < light["uncertainty"] < 4, "no lens was told"
        assert light["highlights"][0]["rival"] < 0.2 and not light["highlights"][0]["clipped"]
    assert result["balls"][0]["circle"] == pytest.approx([130, 105, 70], abs=0.3)
    assert result["overlay"] == str(overlay)
    drawn = picture(overlay)
    # Yellow outline, and the three lights' colours.
    red, green, blue = drawn[..., 0], drawn[..., 1], drawn[..., 2]
    assert ((red > 0.9) & (green > 0.75) & (blue < 0.4)).sum() > 300
    assert ((red > 0.9) & (green < 0.5)).any() and ((green > 0.8) & (red < 0.5)).any()
    assert ((blue > 0.9) & (red < 0.5)).any()


@pytest.mark.parametrize("where", [[], ["--mask", "mask.png"], ["--circle", CIRCLE]])
def test_a_photo_for_each_light(photos: Path, tmp_path: Path, where: list[str]) -> None:
    given = [str(photos / option) if option.endswith(".png") else option for option in where]
    files = [str(photos / f"only{light}.png") for light in range(3)]
    assert main(["calibrate", "lights", *files, "--per-light", *given, "-o", str(tmp_path / "rig.json")]) == 0
    assert degrees_between(read_rig(tmp_path / "rig.json").directions, FACING).max() < 1


def test_any_number_of_lights_goes_into_an_lp_file(photos: Path, tmp_path: Path) -> None:
    files = [str(photos / f"only{light}.png") for light in (0, 1)]
    overlay = tmp_path / "overlay.png"
    command = ["calibrate", "lights", *files, "--per-light", "--overlay", str(overlay)]
    assert main([*command, "-o", str(tmp_path / "lights.lp")]) == 0
    lines = (tmp_path / "lights.lp").read_text().splitlines()
    assert lines[0] == "2" and [line.split()[0] for line in lines[1:]] == ["only0", "only1"]
    assert degrees_between(np.array([line.split()[1:] for line in lines[1:]], float), FACING[:2]).max() < 1
    assert picture(overlay).std() > 0.01


def test_lights_are_reported_by_their_photos_in_the_order_of_their_numbers(photos: Path, tmp_path, capsys) -> None:
    """As a shell gives them: ball.10 before ball.2, and the mask among them."""
    for number, light in {1: 0, 2: 1, 10: 2, 11: 0}.items():
        (tmp_path / f"ball.{number}.png").write_bytes((photos / f"only{light}.png").read_bytes())
    (tmp_path / "ball.mask.png").write_bytes((photos / "mask.png").read_bytes())
    files = sorted(map(str, tmp_path.glob("ball.*.png")))
    command = ["calibrate", "lights", *files, "--per-light", "--lights", "1,2,3"]
    assert main([*command, "-o", str(tmp_path / "rig.json")]) == 0
    said = capsys.readouterr()
    table = said.out.splitlines()[1:4]
    assert [line.partition(" (")[2].partition(")")[0] for line in table] == ["ball.1.png", "ball.2.png", "ball.10.png"]
    assert "ball.mask.png is left out" in said.err
    assert degrees_between(read_rig(tmp_path / "rig.json").directions, FACING).max() < 1


@pytest.mark.parametrize("numbers", [(10, 11, 9), (11, 9, 10)])
def test_three_photos_are_red_green_and_blue_as_they_are_given_to_calibrate_and_superpose(
    photos: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], numbers: tuple[int, int, int]
) -> None:
    """So both agree, also where a shell sorts them, which is the first order; both say which is which."""
    lights = [number - 9 for number in numbers]
    for light in range(3):
        (tmp_path / f"w_{light + 9}.png").write_bytes((photos / f"only{light}.png").read_bytes())
    names = [f"w_{number}.png" for number in numbers]
    files = [str(tmp_path / name) for name in names]
    rig, photo = tmp_path / "rig.json", tmp_path / "photo.exr"
    assert main(["calibrate", "lights", *files, "--per-light", "-o", str(rig)]) == 0
    calibrated = capsys.readouterr()
    assert main(["superpose", "--channels", *files, "-o", str(photo)]) == 0
    superposed = capsys.readouterr()
    assert degrees_between(read_rig(rig).directions, FACING[lights]).max() < 1
    alone = [read_image(file).pixels.mean(axis=-1) for file in files]
    np.testing.assert_allclose(read_image(photo).pixels, np.stack(alone, axis=-1), atol=1e-3)
    assert [line.partition(" (")[2].partition(")")[0] for line in calibrated.out.splitlines()[1:4]] == names
    assert superposed.out == f"{photo}: red is {names[0]}, green {names[1]}, blue {names[2]}\n"
    warned = "the order in which a shell sorts them; for another order name the photos one by one"
    assert [warned in said.err for said in (calibrated, superposed)] == [numbers == (10, 11, 9)] * 2


def test_three_lights_of_an_lp_file_become_a_rig(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lights, rig = tmp_path / "lights.lp", tmp_path / "rig.json"
    write_lp(lights, [[0.1, 0.2, 0.9], *FACING[::-1]], ["none", "b", "g", "r"])
    assert main(["calibrate", "lights", str(lights), "--lights", "4,3,2", "-o", str(rig)]) == 0
    assert degrees_between(read_rig(rig).directions, FACING).max() < 1e-3
    assert "red (r): slant" in capsys.readouterr().out
    assert main(["calibrate", "lights", str(lights), "-o", str(rig)]) == 2
    assert "choose --lights 1,2,3 (1 none, 2 b, 3 g, 4 r)" in capsys.readouterr().err


@pytest.mark.parametrize("lens", [["--focal", "54"], ["--camera", "camera.json"]])
def test_two_balls_give_a_rig_with_positions(photos: Path, tmp_path: Path, lens: list[str]) -> None:
    given = [str(photos / option) if option.endswith(".json") else option for option in lens]
    rig = tmp_path / "rig.json"
    command = ["calibrate", "lights", str(photos / "pair.exr"), "--balls", "2", "--radius", "0.1", *given]
    assert main([*command, "-o", str(rig), "--overlay", str(tmp_path / "overlay.png")]) == 0
    near = read_rig(rig).near
    assert near is not None
    assert np.linalg.norm(near.positions - [place for place, _ in PAIR.lamps], axis=1).max() < 0.02 * 0.8
    assert near.target == pytest.approx(BETWEEN, abs=0.005)
    assert picture(tmp_path / "overlay.png").shape[1] > 1000
    if lens[0] == "--focal":
        assert main([*command, "--distant", "-o", str(rig)]) == 0
        assert read_rig(rig).near is None


def test_the_mixing_goes_into_the_rig(mpsnet, photos: Path, tmp_path: Path) -> None:
    rig, overlay = tmp_path / "rig.json", tmp_path / "overlay.png"
    write_rig(rig, replace(read_rig(photos / "rig.json"), is_ground_truth=True))
    command = ["calibrate", "mixing", photos / "grey.exr", "--rig", rig, "--overlay", overlay, "-o", rig]
    done = mpsnet(*command, "--progress", "json")
    assert (done.returncode, done.stderr) == (0, "")
    found = read_rig(rig)
    assert np.abs(found.mixing - CROSSTALK).max() < 0.01 and not found.is_ground_truth
    assert degrees_between(found.directions, FACING).max() < 1e-6
    result = result_of(done.stdout)
    assert result["mixing"] == found.mixing.tolist()
    assert result["residual"] < 0.02 and result["left_out"] < 0.1
    assert result["equation_2_error"] < 1
    assert picture(overlay).std() > 0.01


def test_the_rooms_light_is_taken_off(photos: Path, tmp_path: Path) -> None:
    """A dark frame of a room that is brighter than the lamps' crosstalk."""
    room = np.linspace(0.05, 0.3, 240)[None, :, None] * np.array([1.0, 0.6, 0.2])
    lit = grey_photograph(MATT, CROSSTALK, FACING, levels=None) + room
    write_file(tmp_path / "lit.exr", lit, "float")
    write_file(tmp_path / "dark.exr", np.broadcast_to(room, lit.shape), "float")
    command = ["calibrate", "mixing", str(tmp_path / "lit.exr"), "--dark", str(tmp_path / "dark.exr")]
    command += ["--circle", CIRCLE, "--rig", str(photos / "rig.json")]
    assert main([*command, "-o", str(tmp_path / "rig.json")]) == 0
    assert np.abs(read_rig(tmp_path / "rig.json").mixing - CROSSTALK).max() < 0.01


def test_a_camera_without_colours_calibrates_both_ways(photos: Path, tmp_path: Path) -> None:
    """As photos under three white lights are: `superpose` makes a channel of each, so no light mixes into another's."""
    colour = [str(photos / f"only{light}.png") for light in range(3)]
    mirror, grey = [str(tmp_path / f"only{light}.png") for light in range(3)], []
    for light, (with_colours, without) in enumerate(zip(colour, mirror, strict=True)):
        write_file(Path(without), read_image(with_colours, encoding="linear").pixels[..., 0], "uint8")
        pixels = read_image(photos / f"grey{light}.exr").pixels[..., light]
        grey.append(str(write_file(tmp_path / f"grey{light}.exr", pixels, "float")))
    found = []
    for files in (colour, mirror):
        where = ["--circle", CIRCLE, "-o", str(tmp_path / "found.json")]
        assert main(["calibrate", "lights", "--per-light", *files, *where]) == 0
        found.append(read_rig(tmp_path / "found.json").directions)
    np.testing.assert_allclose(found[1], found[0], atol=0.01)
    mixed = str(tmp_path / "mixed.json")
    assert main(["calibrate", "mixing", *grey, "--rig", str(photos / "rig.json"), "--circle", CIRCLE, "-o", mixed]) == 0
    mixing = read_rig(mixed).mixing
    assert np.count_nonzero(mixing) == 3 and (np.diag(mixing) > 0.2).all()


@pytest.mark.parametrize("card", [False, True])
def test_the_mixing_by_a_photo_for_each_light(photos: Path, tmp_path: Path, card: bool) -> None:
    files = [str(photos / f"grey{light}.exr") for light in range(3)]
    where = ["--card", "--circle", "130,105,9"] if card else []  # the ball's front is as flat as a card
    command = ["calibrate", "mixing", *files, "--rig", str(photos / "rig.json"), *where]
    assert main([*command, "-o", str(tmp_path / "rig.json")]) == 0
    mixing = read_rig(tmp_path / "rig.json").mixing
    assert np.abs(mixing - CROSSTALK).max() < (0.03 if card else 0.01)


def test_a_photo_of_one_light_that_was_exposed_for_longer_gets_a_warning(photos: Path, tmp_path, capsys) -> None:
    """The mixing would say that its light is brighter."""
    files = []
    for light, seconds in enumerate((0.1, 0.1, 0.2)):
        pixels = read_image(photos / f"grey{light}.exr").pixels
        files.append(write_file(tmp_path / f"grey{light}.tif", pixels, "float", ExposureTime=seconds))
    command = ["calibrate", "mixing", *map(str, files), "--rig", str(photos / "rig.json"), "--circle", CIRCLE]
    assert main([*command, "-o", str(tmp_path / "rig.json")]) == 0
    told = capsys.readouterr().err
    assert f"{files[2]} was exposed for 0.2 s" in told and told.count("exposed for") == 1


# --- bad input --------------------------------------------------------------------------------------------------------

ONLY = ["only0.png", "only1.png", "only2.png"]
BALL_CASES: dict[str, tuple[list[str], str]] = {
    "no photo": (["none.png"], "none.png does not exist … check the path"),
    "not an image": (["text.txt"], "text.txt cannot be read as an image"),
    "no ball": (["flat.exr"], "no ball was found … circle by hand"),
    "no highlight": (["flat.exr", "--circle", CIRCLE], "flat.exr … no highlight … lights on"),
    "white lights in one photo": (["only0.png"], "do not differ in colour … each light alone"),
    "circle larger than the photo": (["ball.exr", "--circle", "130,105,1000"], "more than the photo"),
    "circle beside the photo": (["ball.exr", "--circle", "900,60,40"], "outside the photo"),
    "circle of two numbers": (["ball.exr", "--circle", "1,2"], "--circle 1,2 … three numbers"),
    "circle without radius": (["ball.exr", "--circle", "9,9,0"], "radius above 0"),
    "circle and mask": (["ball.exr", "--circle", CIRCLE, "--mask", "mask.png"], "give one of them"),
    "mask of another size": (["ball.exr", "--mask", "small.png"], "small.png is 20 x 20 … 240 x 200"),
    "camera and focal": (
        ["ball.exr", "--camera", "camera.json", "--focal", "50"],
        "--camera and --focal … give one of them",
    ),
    "more balls than there are": (["ball.exr", "--balls", "2"], "only 1 of 2 balls"),
    "places of one photo": (["ball.exr", "--places", "2"], "add --per-light"),
    "two lights in a rig": ([*ONLY[:2], "--per-light"], "2 light(s) where a rig has three … .lp"),
    "a light that is not there": ([*ONLY, "--per-light", "--lights", "1,2,4"], "numbers from 1 to 3"),
    "photos of two sizes": (["only0.png", "other.exr", "only1.png", "--per-light"], "other.exr is 60 x 50 … 240 x 200"),
    "output over a photo": (["ball.exr", "-o", "ball.exr"], "would overwrite"),
    "overlay of no format": (["ball.exr", "--overlay", "overlay.gif"], "overlay.gif … not a supported image format"),
    "dark frame of another size": (["ball.exr", "--dark", "other.exr"], "dark frame is 60 x 50 … photo is 240 x 200"),
}
GREY = [f"grey{light}.exr" for light in range(3)]
MIXING_CASES: dict[str, tuple[list[str], str]] = {
    "two photos": ([*GREY[:2]], "2 photo(s) … one photo of a grey ball, or three"),
    "one photo of a card": (["grey.exr", "--card", "--circle", CIRCLE], "card takes three photos"),
    "a card in photos of different sizes": (
        ["grey0.exr", "grey1.exr", "other.exr", "--card", "--mask", "mask.png"],
        "take both with the same camera",
    ),
    "a card in the dark": (["black.exr"] * 3 + ["--card", "--mask", "mask.png"], "black … lights on"),
    "a card that faces away": (
        [*GREY, "--card", "--mask", "mask.png", "--normal", "0,-1,0"],
        "does not reach the card",
    ),
    "a ball's normal": (["grey.exr", "--normal", "0,0,1"], "--normal is for a card"),
    "a black ball": (["black.exr", "--circle", CIRCLE], "black … lights on"),
}


@pytest.fixture
def said(photos: Path, tmp_path: Path) -> Callable[[str, list[str]], str]:
    """Runs a calibration in this process, which must fail and leave nothing, and gives its one sentence."""

    def run(verb: str, options: list[str]) -> str:
        options = [str(photos / word) if (photos / word).is_file() else word for word in options]
        for name in ("rig_out.json", "overlay.gif", "o.png"):
            options = [str(tmp_path / name) if word == name else word for word in options]
        command = ["calibrate", verb, *options]
        if verb == "mixing" and "--rig" not in options:
            command += ["--rig", str(photos / "rig.json")]
        if "-o" not in options:
            command += ["-o", str(tmp_path / "rig_out.json")]
        before = {file: file.read_bytes() for file in photos.iterdir()}
        stderr = io.StringIO()
        with contextlib.redirect_stderr(stderr):
            assert main(command) == 2
        assert {file: file.read_bytes() for file in photos.iterdir()} == before
        assert listing(tmp_path) == []
        lines = stderr.getvalue().splitlines()
        assert len(lines) == 1, lines
        return lines[0]

    return run


CASES = [("lights", *case) for case in BALL_CASES.items()] + [("mixing", *case) for case in MIXING_CASES.items()]


@pytest.mark.parametrize("verb, name, case", CASES, ids=[f"{verb}: {name}" for verb, name, _ in CASES])
def test_bad_input_gets_one_sentence(
    said: Callable[[str, list[str]], str], verb: str, name: str, case: tuple[list[str], str]
) -> None:
    options, words = case
    sentence = said(verb, options)
    assert re.search(".*".join(re.escape(part.strip()) for part in words.split("…")), sentence), sentence


def test_a_mixing_that_is_written_over_is_reported(photos: Path, tmp_path: Path) -> None:
    rig = tmp_path / "rig.json"
    write_rig(rig, LightRig(FACING, CROSSTALK))
    for told in (True, False):
        with contextlib.redirect_stderr(io.StringIO()) as said:
            assert main(["calibrate", "lights", str(photos / "ball.exr"), "--circle", CIRCLE, "-o", str(rig)]) == 0
        assert ("the mixing that rig.json held was of its old lights" in said.getvalue()) == told


def test_a_ball_without_highlights_is_shown_all_the_same(photos: Path, tmp_path: Path) -> None:
    overlay = tmp_path / "overlay.png"
    command = ["calibrate", "lights", str(photos / "flat.exr"), "--circle", CIRCLE, "--overlay", str(overlay)]
    with contextlib.redirect_stderr(io.StringIO()) as told:
        assert main([*command, "-o", str(tmp_path / "rig.json")]) == 2
    (line,) = told.getvalue().splitlines()
    assert line.endswith("overlay.png shows the ball that was found")
    assert picture(overlay).shape[2] == 3
    assert not (tmp_path / "rig.json").exists()
