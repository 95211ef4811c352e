"""A photo whose file does not say how its values are meant: told by its shading, and left at sRGB where it is not."""

from itertools import combinations
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from synthetic import Sphere, shaded_sphere

from mpsnet_core import Check, LightRig, read_capture, read_correction, read_image, read_mask, write_rig
from mpsnet_core.capture.transfer import CLOSE, DECIDED, evidence_for_linear
from mpsnet_core.io.image import linear_to_srgb, srgb_to_linear
from mpsnet_core.io.image_encoding import Encoding

pytestmark = pytest.mark.accuracy

PAINTS = {
    "matt": lambda x, y: np.ones(3),
    "of one colour": lambda x, y: np.array([0.9, 0.6, 0.4]),
    "painted": lambda x, y: (0.5 + 0.3 * np.sin(7 * x + 5 * y))[..., None],
    "painted in colours": lambda x, y: np.dstack([0.5 + 0.3 * np.sin(5 * x), 0.5 + 0.3 * np.cos(4 * y), 0.5 + 0.2 * x]),
}


DEVELOPED = {True: lambda pixels: pixels, False: linear_to_srgb}


def written(path: Path, pixels: np.ndarray, space: str = "unknown") -> Path:
    """Eight bits, without a word about their curve unless given."""
    source = oiio.ImageBuf(np.rint(np.clip(pixels, 0, 1) * 255).astype(np.uint8))
    source.specmod()["oiio:ColorSpace"] = space
    assert source.write(str(path))
    return path


@pytest.fixture(scope="module")
def sphere() -> Sphere:
    return shaded_sphere(160)


@pytest.mark.parametrize("paint", PAINTS)
@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_the_shading_shows_linear_values_and_many_colours_leave_srgb(
    tmp_path: Path, sphere: Sphere, caplog: pytest.LogCaptureFixture, paint: str, linear: bool, suffix: str
) -> None:
    x, y = np.meshgrid(np.linspace(-1, 1, 160), np.linspace(1, -1, 160))
    pixels = np.clip(sphere.image * PAINTS[paint](x, y), 0, 1)
    photo = written(tmp_path / f"photo.{suffix}", DEVELOPED[linear](pixels))
    capture = read_capture(photo, sphere.rig, mask="threshold:0.02")
    taken_as_linear = linear and paint != "painted in colours"
    assert ("READ AS LINEAR" in caplog.text and "--encoding srgb" in caplog.text) == taken_as_linear
    truth = pixels if taken_as_linear or not linear else srgb_to_linear(pixels)
    assert np.abs(capture.image - truth)[capture.mask].max() < 0.02


@pytest.mark.parametrize("space", ["unknown", "sRGB"])
@pytest.mark.parametrize("encoding", ["auto", "srgb"])
def test_what_the_user_or_the_file_says_is_not_doubted(tmp_path, sphere, caplog, space: str, encoding: Encoding):
    photo = written(tmp_path / "photo.png", sphere.image, space)
    read_capture(photo, sphere.rig, mask="threshold:0.02", encoding=encoding)
    assert ("READ AS LINEAR" in caplog.text) == (space == "unknown" and encoding == "auto")


@pytest.mark.parametrize("mask", ["alpha-or-auto", "none", "threshold:0.3"])
def test_the_mask_is_as_for_linear_values_and_reported_once(tmp_path, sphere, caplog, mask: str) -> None:
    photo = written(tmp_path / "photo.png", sphere.image)
    caplog.set_level("INFO")
    capture = read_capture(photo, sphere.rig, mask=mask)
    assert "READ AS LINEAR" in caplog.text
    assert caplog.text.count("the mask covers") == (mask == "alpha-or-auto")
    as_told = read_capture(photo, sphere.rig, mask=mask, encoding="linear")
    np.testing.assert_array_equal(capture.mask, as_told.mask)
    np.testing.assert_allclose(capture.image, as_told.image, atol=1e-6)


def test_a_white_photo_is_taken_as_the_photo_is(tmp_path: Path, sphere: Sphere) -> None:
    photo = written(tmp_path / "photo.png", sphere.image)
    grey = sphere.image.mean(axis=-1, keepdims=True) * np.ones(3)
    white = written(tmp_path / "white.png", grey)
    capture = read_capture(photo, sphere.rig, mask="threshold:0.02", white=white)
    assert capture.white is not None
    assert np.abs(capture.white - grey)[capture.mask].max() < 0.02


def test_with_a_dark_frame_that_was_read_as_srgb_there_is_only_a_warning(tmp_path, sphere, caplog) -> None:
    photo = written(tmp_path / "photo.png", sphere.image)
    correction = read_correction(written(tmp_path / "dark.png", 0 * sphere.image))
    capture = read_capture(photo, sphere.rig, mask="threshold:0.02", correction=correction)
    assert "MAY BE LINEAR" in caplog.text
    assert np.abs(capture.image - srgb_to_linear(sphere.image))[capture.mask].max() < 0.02


def test_a_check_says_what_the_shading_shows(tmp_path: Path, sphere: Sphere) -> None:
    write_rig(tmp_path / "rig.json", sphere.rig)
    rig, mask = str(tmp_path / "rig.json"), "threshold:0.02"
    for linear, encoding, level in ((True, "auto", "bad"), (False, "auto", "good"), (True, "linear", None)):
        photo = written(tmp_path / "photo.png", DEVELOPED[linear](sphere.image))
        found = {
            one.item: one.level for one in Check(image=str(photo), rig=rig, mask=mask, encoding=encoding).run().findings
        }
        assert found.get("encoding") == level


@pytest.mark.parametrize("name", ["ball", "cat"])
def test_photographs_are_taken_as_what_they_are_or_left_at_srgb(diligent: Path, name: str) -> None:
    """DiLiGenT's, which are glossy and throw shadows: none of sRGB is taken as linear, most others are doubted."""
    folder = diligent / f"{name}PNG"
    mask = read_mask(folder / "mask.png")
    decided = {True: [], False: []}
    names = ("001", "022", "041", "048", "096")
    strengths = np.loadtxt(folder / "light_intensities.txt").mean(axis=1)
    photos = {one: read_image(folder / f"{one}.png", encoding="linear").pixels.mean(axis=-1) for one in names}
    for three in combinations(names, 3):
        lights = [int(number) - 1 for number in three]
        directions = np.loadtxt(folder / "light_directions.txt")[lights]
        if abs(np.linalg.det(directions)) < 0.05:
            continue
        image = np.stack([photos[number] for number in three], -1) / strengths[lights]
        image = np.clip(image / np.percentile(image[mask], 98), 0, 1)
        for linear, reached in decided.items():
            stored = np.rint(DEVELOPED[linear](image) * 255) / 255
            reached.append(evidence_for_linear(srgb_to_linear(stored).astype(np.float32), mask, LightRig(directions)))
    print(f"{name}: linear {np.round(decided[True], 2)}, sRGB {np.round(decided[False], 2)}")
    assert max(decided[False]) < DECIDED
    assert np.median(decided[False]) < CLOSE < np.median(decided[True])
