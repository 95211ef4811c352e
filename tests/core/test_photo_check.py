"""Each item of `mpsnet check` speaks where its cause is put into a good photo of a sphere, and nowhere else."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from bad_input import gets_one_clear_sentence, with_pixel
from synthetic import shaded_sphere, write_file

from mpsnet_core import Check, LightRig, published_rig, write_rig
from mpsnet_core.capture.photo_check import Finding, check_photo
from mpsnet_core.io.image import Image
from mpsnet_core.scene.rig import direction_from_angles

NOISE = 0.002


def photo(
    *,
    rig: LightRig | None = None,
    gain: float | np.ndarray = 1.0,
    blur: float = 0.0,
    noise: float = NOISE,
    albedo: tuple[float, float, float] = (0.8, 0.8, 0.8),
    size: int = 320,
) -> tuple[np.ndarray, np.ndarray]:
    """A sphere before a dark background as a camera of 12 bits takes it, linear, and its mask."""
    sphere = shaded_sphere(size, rig, albedo)
    margin = size // 4
    mask = np.pad(sphere.mask, margin)
    image = blurred(np.pad(sphere.image, ((margin, margin), (margin, margin), (0, 0))) * gain, blur)
    image = image + np.random.default_rng(1).normal(0, noise, image.shape)
    return np.clip(np.round(image * 4095) / 4095, 0, 1), mask


def blurred(image: np.ndarray, sigma: float) -> np.ndarray:
    """By a Gaussian, in the frequency domain."""
    if not sigma:
        return image
    y, x = (np.fft.fftfreq(length) for length in image.shape[:2])
    transfer = np.exp(-2 * (np.pi * sigma) ** 2 * (y[:, None] ** 2 + x**2))
    return np.fft.ifft2(np.fft.fft2(image, axes=(0, 1)) * transfer[..., None], axes=(0, 1)).real


def checked(
    image: np.ndarray, mask: np.ndarray, rig: LightRig | None = None, clip: float = 1.0
) -> Mapping[str, Finding]:
    found = check_photo(Image(image.astype(np.float32), None, clip), mask, rig or published_rig())
    return {one.item: one for one in found}


def rig_at(slants: list[float], tilts: list[float]) -> LightRig:
    return LightRig(direction_from_angles(slants, tilts))


Case = Callable[[], tuple[np.ndarray, np.ndarray, LightRig | None]]
MIXED = LightRig(published_rig().directions, np.full((3, 3), 0.8) + 0.2 * np.eye(3))
LOW, NARROW = rig_at([30, 30, 72], [90, 210, 330]), rig_at([9, 9, 9], [90, 210, 330])
PAIR, LINE = rig_at([30, 30, 30], [0, 14, 180]), rig_at([40, 6, 40], [0, 90, 180])
ALIKE = np.repeat(photo()[0][..., :1], 3, axis=-1)
CASES: dict[str, tuple[Case, str, str, str]] = {
    "dark": (lambda: (*photo(gain=0.1), None), "exposure", "watch", "expose about 9 times as long"),
    "darker": (lambda: (*photo(gain=0.03), None), "exposure", "bad", "of full scale; expose"),
    "no blue light": (lambda: (*photo(gain=np.array([1, 1, 0.01])), None), "exposure", "bad", "make the blue light"),
    "noise": (lambda: (*photo(noise=0.08, gain=0.7), None), "exposure", "watch", "expose longer, at a lower ISO"),
    "clipped": (lambda: (*photo(gain=np.array([1.3, 1, 1])), None), "clipping", "bad", "or dim the red light"),
    "a little clipped": (lambda: (*photo(gain=np.array([1, 1.258, 1])), None), "clipping", "watch", "green"),
    "white light": (lambda: (ALIKE, photo()[1], None), "channels", "bad", "as under white light"),
    "two lights alike": (lambda: (photo()[0][..., [0, 1, 1]], photo()[1], None), "channels", "bad", "green and blue"),
    "crosstalk": (lambda: (*photo(rig=MIXED, gain=0.4), MIXED), "channels", "watch", "amplifies noise 13 times"),
    "two lights close": (lambda: (*photo(rig=PAIR), PAIR), "lights", "bad", "red and the green light stand only 7°"),
    "close to the camera": (lambda: (*photo(rig=NARROW), NARROW), "lights", "watch", "light stand only 16° apart"),
    "in one line": (lambda: (*photo(rig=LINE), LINE), "lights", "bad", "in one line"),
    "a low light": (lambda: (*photo(rig=LOW), LOW), "lights", "watch", "the blue light stands 72°"),
    "out of focus": (lambda: (*photo(blur=3.0), None), "focus", "watch", "blurred by 3."),
    "far out of focus": (lambda: (*photo(blur=9.0), None), "focus", "bad", "focus on it"),
}
# What else a cause brings along.
ALSO = {"in one line": {"channels"}, "close to the camera": {"channels"}, "two lights close": {"channels"}}


def test_a_good_photo_is_good() -> None:
    found = checked(*photo())
    assert {one.level for one in found.values()} == {"good"}
    assert list(found) == ["exposure", "clipping", "channels", "lights", "rig", "reach", "focus"]
    # By the sphere's own normals.
    sphere = shaded_sphere(320)
    assert found["reach"].figures["all_lights"] == pytest.approx(sphere.lit.sum() / sphere.mask.sum(), abs=0.03)
    assert np.all(np.abs(np.array(found["exposure"].figures["noise"]) / NOISE - 0.8) < 0.2)


@pytest.mark.parametrize("name", CASES)
def test_a_cause_is_named_and_nothing_else(name: str) -> None:
    case, item, level, words = CASES[name]
    image, mask, rig = case()
    found = checked(image, mask, rig)
    assert (found[item].level, words in found[item].sentence) == (level, True), found[item]
    others = {one.item for one in found.values() if one.level != "good"} - {item} - ALSO.get(name, set())
    assert not others, [found[other] for other in others]


def test_what_shadows_hide_is_reported_with_the_light_to_move() -> None:
    """Half of a plate in the shadow of one light, a quarter in that of another."""
    image = np.full((200, 200, 3), 0.5) * np.random.default_rng(1).uniform(0.6, 1, (200, 200, 3))
    image[:, :100, 1] = 0.002
    image[:, 150:, 2] = 0.002
    found = checked(image, np.ones((200, 200), bool))["reach"]
    assert (found.level, found.figures["all_lights"]) == ("bad", 0.25)
    assert "25% of the object, the green one 50%; move the green light" in found.sentence


def test_a_light_whose_channel_is_black_is_said_to_reach_nothing_and_the_others_are_compared() -> None:
    found = checked(*photo(gain=np.array([1, 1, 0]), noise=0))
    assert found["exposure"].level == "bad"
    assert "all lights but the blue one, too dark to tell, reach" in found["reach"].sentence
    assert "the channels show different lights" in found["channels"].sentence


@pytest.mark.parametrize("sigma, level", [(0.0, "good"), (2.5, "watch")])
def test_the_focus_of_paint_is_judged_where_there_is_no_outline(sigma: float, level: str) -> None:
    """Printed squares that fill the picture."""
    squares = 0.3 + 0.4 * np.kron(np.random.default_rng(1).random((20, 20)) > 0.5, np.ones((20, 20)))
    image = blurred(squares[..., None] * [1, 0.8, 0.6], sigma)
    assert checked(image, np.ones(squares.shape, bool))["focus"].level == level


def test_large_photos_and_files_without_an_upper_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A float file may hold any values; one that a converter clipped at 1 shows it."""
    monkeypatch.setattr("mpsnet_core.capture.photo_check.PIXELS", 160_000)
    image, mask = photo(size=400)
    assert {one.level for one in checked(image * 1e-3, mask, clip=np.inf).values()} == {"good"}
    found = checked(np.minimum(image * 1.4, 1), mask, clip=np.inf)
    assert found["clipping"].level == "bad"


def test_the_command_writes_a_line_and_a_sentence_an_item(tmp_path: Path, mpsnet) -> None:
    image, mask = photo(gain=0.03)
    write_file(tmp_path / "photo.png", image, "uint16")
    write_file(tmp_path / "mask.png", mask, "uint8")
    write_rig(tmp_path / "rig.json", published_rig())
    options = ["--rig", tmp_path / "rig.json", "--mask", tmp_path / "mask.png", "--encoding", "linear"]
    done = mpsnet("check", tmp_path / "photo.png", *options, "--json", tmp_path / "found.json")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split()[0] for line in lines[:8]] == ["bad", *["good"] * 4, "watch", *["good"] * 2]
    assert "the rig does not state how the lights' colours mix" in lines[5]
    found = json.loads((tmp_path / "found.json").read_text())
    assert found["level"] == "bad" and found["findings"][0]["sentence"] in lines[0]
    rig = json.loads((tmp_path / "rig.json").read_text())
    (tmp_path / "rig.json").write_text(json.dumps({**rig, "mixing": np.eye(3).tolist()}))
    told = Check(image=tmp_path / "photo.png", rig=tmp_path / "rig.json", mask=tmp_path / "mask.png").run()
    assert "mixing" not in [one.item for one in told.findings]
    without = Check(image=tmp_path / "photo.png", mask=tmp_path / "mask.png").run()
    assert "lights" not in [one.item for one in without.findings]


test_bad_input_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("no such rig", lambda b: b.run("check", b.photo(), "--rig", b / "none.json"), "none.json…"),
        ("the answer over the photo", lambda b: b.run("check", b.photo(), "--json", b.photo()), "overwrite"),
        (lambda b: b.run("check", b.photo(), "--mask", b.photo("mask.png", np.ones((8, 8)), "uint8")), "the mask is 8"),
        (lambda b: b.run("check", b.photo(pixels=with_pixel(np.nan)), "--mask", "none"), "not finite inside the mask"),
        (
            "a mask file of nothing, to look at",
            lambda b: b.run(
                "mask", b.photo(), "--mask", b.photo("0.png", np.zeros((16, 16)), "uint8"), "-o", b / "m.png"
            ),
            "photo.exr: the mask is empty; choose another mask or threshold",
        ),
        (
            "a mask of nothing",
            lambda b: b.run("check", b.photo(), "--mask", b.photo("mask.png", np.zeros((16, 16)), "uint8")),
            "the mask is empty; choose another mask or threshold",
        ),
    ]
)
