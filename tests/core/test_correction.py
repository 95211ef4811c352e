"""Dark frames and flat fields: a photo with a known dark signal and fall-off must come out as if it had neither."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import Sphere, degrees_between, shaded_sphere, write_file

from mpsnet_core import InputError, near_rig, read_image, read_normals, write_rig
from mpsnet_core.capture.decode import Correction, corrected, read_correction

SIDE = 64


def fall_off() -> np.ndarray:
    """(SIDE, SIDE, 3) what a lens and three near lights make of even white, 1 in the middle of each channel."""
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE - 0.5
    tilts = np.stack([1 + 0.6 * y, 1 - 0.5 * x, 1 + 0.5 * x], axis=-1)
    field = tilts * (1 - 0.8 * (x**2 + y**2))[..., None]
    third = SIDE // 3
    return field / field[third:-third, third:-third].mean(axis=(0, 1))


def dark_signal() -> np.ndarray:
    """(SIDE, SIDE, 3) glow at one side, another level in each channel."""
    glow = np.broadcast_to(np.linspace(0.01, 0.06, SIDE)[None, :, None], (SIDE, SIDE, 3))
    return glow * [1, 0.5, 0.8]


class Shots:
    """Files of what a camera with fall-off and dark signal shows, in 16 bits, linear."""

    def __init__(self, folder: Path, sphere: Sphere) -> None:
        self.folder = folder
        self.photo = self.write("photo.tif", 0.8 * sphere.image * fall_off() + dark_signal())
        self.dark = self.write("dark.tif", dark_signal())
        self.flat = self.write("flat.tif", 0.6 * np.array([1, 0.8, 0.5]) * fall_off() + dark_signal())

    def write(self, name: str, values: Any, kind: str = "uint16", **attributes: Any) -> Path:
        values = np.broadcast_to(values, (SIDE, SIDE, 3))
        return write_file(self.folder / name, values, kind, oiio__ColorSpace="linear", **attributes)

    def corrected(self, dark: Path | None = None, flat: Path | None = None, **options: Any) -> np.ndarray:
        image = read_image(self.photo, encoding="linear")
        return corrected(image, read_correction(dark, flat, encoding="linear", **options)).pixels


@pytest.fixture
def shots(tmp_path: Path, sphere: Sphere) -> Shots:
    return Shots(tmp_path, sphere)


def test_dark_frame_and_flat_field_leave_the_scene_alone(shots: Shots, sphere: Sphere) -> None:
    np.testing.assert_allclose(shots.corrected(shots.dark, shots.flat), 0.8 * sphere.image, atol=3e-4)


def test_unequal_lights_stay_unequal(tmp_path: Path, sphere: Sphere) -> None:
    """A flat field evens out each channel over the picture, not the channels with one another."""
    shots = Shots(tmp_path, sphere)
    dim = shots.write("photo.tif", 0.8 * sphere.image * fall_off() * [1, 0.5, 0.25])
    image = corrected(
        read_image(dim, encoding="linear"),
        read_correction(flat=shots.write("f.tif", 0.6 * fall_off()), encoding="linear"),
    )
    np.testing.assert_allclose(image.pixels, 0.8 * sphere.image * [1, 0.5, 0.25], atol=3e-4)


def test_several_frames_are_averaged(shots: Shots, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    (tmp_path / "darks").mkdir()
    for number in range(16):
        noisy = dark_signal() + 0.004 * rng.normal(size=(SIDE, SIDE, 3))
        shots.write(f"darks/{number:02d}.tif", noisy)
    for given in (tmp_path / "darks", tmp_path / "darks" / "##.tif"):
        dark = read_correction(given, encoding="linear").dark
        assert dark is not None
        assert np.std(dark - dark_signal()) == pytest.approx(0.001, rel=0.1)


def test_a_smooth_flat_field_leaves_the_cards_grain_out(shots: Shots) -> None:
    rng = np.random.default_rng(1)
    grain = 1 + 0.05 * rng.normal(size=(SIDE, SIDE, 1))
    flat = shots.write("flat.tif", 0.6 * fall_off() * grain)
    errors = []
    for smooth in (0, 8):
        gain = read_correction(flat=flat, encoding="linear", smooth=smooth).gain
        assert gain is not None
        errors.append(np.abs(gain * fall_off() - 1)[4:-4, 4:-4].mean())
    assert errors[0] > 0.035 and errors[1] < 0.012


def test_what_was_clipped_stays_known(shots: Shots, sphere: Sphere) -> None:
    """After dark frame and flat field no value tells any more that it was clipped, at the rim it is far from 1."""
    light = 1.6 * sphere.image * fall_off() + dark_signal()
    photo = read_image(shots.write("photo.tif", np.minimum(light, 1)), encoding="linear")
    image = corrected(photo, read_correction(shots.dark, shots.flat, encoding="linear"))
    assert image.clip == np.inf
    np.testing.assert_array_equal(image.saturated, light >= 0.99)
    assert 100 < image.saturated.sum() < 6000


def test_a_hot_and_a_dead_pixel_count_as_clipped(shots: Shots) -> None:
    dark, flat = dark_signal(), 0.6 * fall_off() + dark_signal()
    dark[10, 20, 1] = 1
    flat[30, 40, 2] = 0
    correction = read_correction(shots.write("dark.tif", dark), shots.write("flat.tif", flat), encoding="linear")
    image = corrected(read_image(shots.photo, encoding="linear"), correction)
    # The hot site is dark in what remains of the flat field too.
    assert np.argwhere(image.saturated).tolist() == [[10, 20, 1], [30, 40, 2]]
    assert np.isfinite(image.pixels).all()


def test_float_files_do_not_saturate(shots: Shots) -> None:
    photo = shots.write("photo.exr", 5 * fall_off() + dark_signal(), "float")
    image = corrected(read_image(photo), read_correction(shots.dark, shots.flat, encoding="linear"))
    assert not image.saturated.any() and image.pixels.max() == pytest.approx(5, rel=0.01)


@pytest.mark.parametrize(("times", "told"), [((0.2, 0.2), False), ((0.2, 1.0), True), ((None, 1.0), False)])
def test_another_exposure_of_the_dark_frame_is_reported(
    shots: Shots, caplog: pytest.LogCaptureFixture, times: tuple[float | None, float | None], told: bool
) -> None:
    paths = []
    for name, values, time in zip("pd", (0.5, 0.01), times, strict=True):
        paths.append(shots.write(f"{name}.jpg", values, "uint8", **({"ExposureTime": time} if time else {})))
    with caplog.at_level("INFO"):
        corrected(read_image(paths[0]), read_correction(paths[1]))
    assert ("exposed for 1 s, the photo for 0.2 s" in caplog.text) is told


def test_the_command_line_corrects(shots: Shots, tmp_path: Path, mpsnet, rig_file: Path) -> None:
    sphere = shaded_sphere()
    found = {}
    for name, options in {"with": ["--dark", shots.dark, "--flat", shots.flat], "without": []}.items():
        out = tmp_path / f"{name}.exr"
        command = ["estimate", shots.photo, "--rig", rig_file, "--model", "lambertian", "--encoding", "linear"]
        done = mpsnet(*command, "--mask", "none", *options, "-o", out, "--progress", "json")
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout.splitlines()[-1])["result"]["outputs"] == [str(out)]
        found[name] = degrees_between(read_normals(out).vectors, sphere.normals)[sphere.lit].mean()
    assert found["with"] < 0.1 and found["without"] > 3


def read(**given: Any) -> Correction:
    return read_correction(**given, encoding="linear")


def on_the_photo(shots: Shots, **given: Any) -> Any:
    return corrected(read_image(shots.photo, encoding="linear"), read(**given))


def frames_of_different_sizes(shots: Shots) -> Correction:
    (shots.folder / "frames").mkdir()
    for number in (1, 2):
        write_file(shots.folder / "frames" / f"{number}.png", np.zeros((8, 8 * number, 3)), "uint8")
    return read(dark=shots.folder / "frames")


def another_size(shots: Shots, which: str) -> Any:
    small = write_file(shots.folder / "small.tif", np.full((32, 40, 3), 0.3), "uint16")
    return on_the_photo(shots, **{which: small})


def a_card_that_does_not_fill_the_picture(shots: Shots) -> Correction:
    return read(flat=shots.write("flat.tif", 0.5 * fall_off() * (np.arange(SIDE) >= 9)[:, None]))


@pytest.mark.parametrize(
    ("correct", "words"),
    [
        (frames_of_different_sizes, "2.png is 16 x 8 but .*same camera"),
        (lambda shots: another_size(shots, "dark"), "dark .*is 40 x 32 but the photo is 64 x 64"),
        (lambda shots: another_size(shots, "flat"), "flat .*is 40 x 32 but the photo is 64 x 64"),
        (lambda shots: read(flat=shots.write("f.tif", np.minimum(1.1 * fall_off(), 1))), "f.tif is overexposed; use a"),
        (lambda shots: read(dark=shots.write("d.tif", 1)), "d.tif is no dark frame"),
        (lambda shots: read(flat=shots.write("f.tif", fall_off() * [0.5, 0, 0.5])), "black in .* its green channel"),
        (a_card_that_does_not_fill_the_picture, "14.1% of the flat field .*fill the picture"),
        (lambda shots: on_the_photo(shots, dark=shots.photo), "as bright as the photo"),
    ],
)
def test_bad_frames_get_one_sentence(shots: Shots, correct: Callable[[Shots], Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        correct(shots)
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


@pytest.mark.parametrize("several", [False, True], ids=["one photo", "frames"])
def test_near_lights_whose_fall_off_is_reported_twice(shots: Shots, mpsnet, rig_file, several: bool) -> None:
    write_rig(rig_file, near_rig([[0, 3, -1], [3, 0, -1], [-3, -3, -1]], [0, 0, -5]))
    photos = [shots.photo, shots.write("photo2.tif", 0.5)][: 1 + several]
    command = ["estimate", *photos, "--rig", rig_file, "--focal", "50", "--model", "lambertian"]
    command += ["--encoding", "linear", "--dark", shots.dark, "-o", shots.folder / "out"]
    done = mpsnet(*command, "--flat", shots.flat)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "leave the flat field out, or give the lights as directions" in done.stderr
    assert mpsnet(*command).returncode == 0
