"""Camera raw: files written by hand from the DNG specification, and what of them must come through unchanged."""

import sys
from pathlib import Path

import numpy as np
import pytest
from dng import BAYER, X_TRANS, filled_in, mosaic, write_dng
from synthetic import degrees_between, shaded_sphere

from mpsnet_core import InputError, estimate_normals, published_rig, read_capture
from mpsnet_core.io.frames import expand_images
from mpsnet_core.io.image_encoding import Encoding
from mpsnet_core.io.image_reading import read_image, read_size

pytest.importorskip("rawpy")

BLACK, WHITE = 512, 16383
STEP = 1 / (WHITE - BLACK)
COLOUR = (0.2, 0.5, 0.8)


def counted(image: np.ndarray) -> np.ndarray:
    """What a 14-bit sensor counts, 1 being its end."""
    return np.rint(np.clip(BLACK + image * (WHITE - BLACK), 0, WHITE))


def flat(height: int = 48, width: int = 60) -> np.ndarray:
    return np.broadcast_to(COLOUR, (height, width, 3))


def smooth(height: int = 48, width: int = 60) -> np.ndarray:
    """Three slow waves that have nothing to do with one another; second derivatives up to 0.4 (2 pi / 30)²."""
    y, x = np.mgrid[:height, :width] * (2 * np.pi / 30)
    return np.stack([0.5 + 0.4 * np.sin(x), 0.5 + 0.4 * np.cos(y), 0.5 + 0.4 * np.sin(x / 2 + y / 2)], axis=-1)


@pytest.mark.parametrize(
    "told",
    [
        {},
        {"neutral": (0.4, 1, 0.6)},
        {"matrix": (0.9, -0.3, 0.1, -0.2, 1.1, 0.1, 0, 0.2, 0.6)},
        {"baseline_exposure": 1.5},
    ],
    ids=["nothing", "white balance", "colour matrix", "exposure"],
)
@pytest.mark.parametrize("pattern", [BAYER, "GBRG", X_TRANS])
def test_flat_colours_come_through_whatever_the_file_says(tmp_path, told: dict[str, tuple[float, ...]], pattern: str):
    path = write_dng(
        tmp_path / "a.dng", counted(mosaic(flat(), pattern)), pattern=pattern, black=BLACK, white=WHITE, **told
    )
    image = read_image(path)
    # LibRaw's bilinear weights of X-Trans are whole numbers of 256ths that do not always add up to one.
    np.testing.assert_allclose(image.pixels, flat(), atol=STEP, rtol=0 if len(pattern) == 4 else 0.005)
    assert image.pixels.dtype == np.float32 and image.alpha is None
    assert image.clip == np.inf and image.clipped is not None and not image.clipped.any()
    assert image.exposure_time is None


def test_the_black_level_of_each_site_is_taken_off(tmp_path: Path) -> None:
    black = np.array([[512, 600], [480, 700]])
    sites = mosaic(flat()) * 10000 + np.tile(black, (24, 30))
    image = read_image(write_dng(tmp_path / "a.dng", np.rint(sites), black=black.ravel(), white=WHITE))
    scale = image.pixels[0, 0] / COLOUR  # which of four black levels the range counts from is LibRaw's choice
    np.testing.assert_allclose(scale, 10000 / (WHITE - 512), rtol=0.02)
    np.testing.assert_allclose(image.pixels, flat() * scale[0], atol=STEP)


def test_an_image_with_all_channels_at_every_pixel(tmp_path: Path) -> None:
    pixels = smooth()
    pixels[10, 20, 1] = 1
    image = read_image(write_dng(tmp_path / "a.dng", counted(pixels), black=BLACK, white=WHITE))
    np.testing.assert_allclose(image.pixels, pixels, atol=STEP)
    assert image.clipped is not None and np.argwhere(image.clipped).tolist() == [[10, 20, 1]]


@pytest.mark.parametrize("pattern", [BAYER, X_TRANS])
def test_every_value_that_a_clipped_site_went_into_is_known(tmp_path: Path, pattern: str) -> None:
    """Twin files that differ in the clipped sites alone: where they differ after reading, it must be known."""
    y, x = np.mgrid[:48, :60]
    sites = mosaic(smooth() * 0.9, pattern)
    over = ((x - 30) ** 2 + (y - 20) ** 2 < 50) | ((x * 7 + y * 13) % 97 == 0)
    read = []
    for value in (1.0, 0.995):
        values = counted(np.where(over, value, sites))
        read.append(read_image(write_dng(tmp_path / "a.dng", values, pattern=pattern, black=BLACK, white=WHITE)))
    differ = read[0].pixels != read[1].pixels
    clipped = read[0].saturated
    assert differ.sum() > 300 and clipped[differ].all()
    near = np.lib.stride_tricks.sliding_window_view(np.pad(over, 1), (3, 3)).any(axis=(2, 3))
    assert near.mean() < 0.3 and not clipped[~near].any()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_photo_stands_upright_once(tmp_path: Path, orientation: int) -> None:
    """By the table of TIFF 6.0: where the stored row 0 and column 0 are in the picture."""
    pixels = smooth()
    pixels[:8, :8] = 1
    path = tmp_path / "a.dng"
    image = read_image(write_dng(path, counted(mosaic(pixels)), black=BLACK, white=WHITE, orientation=orientation))
    upright = {
        1: lambda stored: stored,
        2: lambda stored: stored[:, ::-1],
        3: lambda stored: stored[::-1, ::-1],
        4: lambda stored: stored[::-1],
        5: lambda stored: stored.swapaxes(0, 1),
        6: lambda stored: np.rot90(stored, -1),
        7: lambda stored: stored[::-1, ::-1].swapaxes(0, 1),
        8: lambda stored: np.rot90(stored, 1),
    }[orientation]
    expected = upright(pixels)
    assert image.pixels.shape == expected.shape
    assert np.abs(image.pixels - expected).mean() < 0.02
    assert image.clipped is not None
    assert image.clipped[upright((pixels == 1).all(axis=-1))].all() and image.clipped.mean() < 0.05


@pytest.mark.parametrize("orientation", [1, 6, 3])
def test_the_recommended_crop_is_read_as_the_cameras_own_jpeg_shows_it(tmp_path: Path, orientation: int) -> None:
    values = counted(mosaic(smooth()))
    whole, cut = (
        write_dng(tmp_path / name, values, black=BLACK, white=WHITE, orientation=orientation, crop=crop)
        for name, crop in (("whole.dng", None), ("cut.dng", (4, 6, 40, 36)))
    )
    expected = {1: np.s_[6:42, 4:44], 3: np.s_[6:42, 16:56], 6: np.s_[4:44, 6:42]}[orientation]
    np.testing.assert_array_equal(read_image(cut).pixels, read_image(whole).pixels[expected])
    assert [read_size(file) for file in (whole, cut)] == [read_image(file).pixels.shape[:2] for file in (whole, cut)]


def test_a_crop_that_lies_outside_is_no_crop(tmp_path: Path) -> None:
    path = write_dng(tmp_path / "a.dng", counted(mosaic(smooth())), black=BLACK, white=WHITE, crop=(30, 6, 40, 36))
    assert read_image(path).pixels.shape == (48, 60, 3)


def rippled(side: int = 128, period: float = 9, light: float = 1) -> tuple[np.ndarray, np.ndarray]:
    """A ball with ripples in its normals under three lights, what each site sees by averaging 3 x 3; and its mask."""
    sphere = shaded_sphere(3 * side)
    wave = 2 * np.pi / (3 * period)
    y, x = np.mgrid[: 3 * side, : 3 * side] * wave
    ripples = 0.18 * np.stack([np.cos(x + 0.3 * y), np.cos(0.9 * y - 0.4 * x), 0 * x], axis=-1)
    normals = sphere.normals + ripples
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    image = np.maximum(normals @ sphere.rig.directions.T, 0) * sphere.mask[..., None] * 0.8 * light
    means = image.reshape(side, 3, side, 3, 3).mean(axis=(1, 3))
    lit = (image > 0.02).reshape(side, 3, side, 3, 3).all(axis=(1, 3, 4))
    inner = np.lib.stride_tricks.sliding_window_view(np.pad(lit, 3), (7, 7)).all(axis=(2, 3))
    return means, inner


def test_relief_is_nearer_to_the_truth_than_by_methods_for_photos_under_white_light(tmp_path: Path) -> None:
    image, inner = rippled()
    rig = published_rig()
    truth = image @ np.linalg.inv(rig.directions).T
    path = write_dng(tmp_path / "a.dng", counted(mosaic(image)), black=BLACK, white=WHITE)
    ours = estimate_normals(read_capture(path, rig, mask="none"), "lambertian").vectors
    errors = {"ours": degrees_between(ours, truth)[inner].mean()}
    for name in ("AHD", "DCB", "VNG", "PPG"):
        errors[name] = degrees_between(filled_in(path, name) @ np.linalg.inv(rig.directions).T, truth)[inner].mean()
    assert errors["ours"] < 1.3
    assert all(errors["ours"] < 0.85 * error for name, error in errors.items() if name != "ours"), errors


def test_no_light_leaks_into_a_channel_that_it_did_not_reach(tmp_path: Path) -> None:
    image, _ = rippled()
    image[..., 1:] = 0
    pixels = read_image(write_dng(tmp_path / "a.dng", counted(mosaic(image)), black=BLACK, white=WHITE)).pixels
    assert pixels[..., 0].max() > 0.5 and not pixels[..., 1:].any()


def test_the_exposure_time_is_read(tmp_path: Path) -> None:
    path = write_dng(tmp_path / "a.dng", counted(mosaic(flat())), black=BLACK, white=WHITE, exposure_time=0.25)
    assert read_image(path).exposure_time == pytest.approx(0.25)


def test_folders_and_patterns_mean_raw_files_and_not_their_jpegs(tmp_path: Path) -> None:
    for name in ("b.CR3", "b.JPG", "a.nef", "a.HEIC", "c.jpg", "d.png", "d.dng", "e.xmp"):
        (tmp_path / name).touch()
    assert [file.name for file in expand_images([tmp_path])] == ["a.nef", "b.CR3", "c.jpg", "d.dng", "d.png"]
    assert [file.name for file in expand_images([tmp_path / "b.*"])] == ["b.CR3"]
    assert [file.name for file in expand_images([tmp_path / "b.JPG"])] == ["b.JPG"]


class TestBadInput:
    @pytest.fixture
    def good(self, tmp_path: Path) -> Path:
        return write_dng(tmp_path / "photo.dng", counted(mosaic(smooth())), black=BLACK, white=WHITE)

    def refused(self, path: Path, *words: str, encoding: Encoding = "auto", layer: str | None = None) -> None:
        with pytest.raises(InputError) as caught:
            read_image(path, encoding=encoding, layer=layer)
        sentence = str(caught.value)
        assert all(word in sentence for word in words), sentence
        assert "\n" not in sentence and len(sentence.replace(str(path), "")) < 300

    @pytest.mark.parametrize("share", [0.0, 0.002, 0.02, 0.5, 0.9])
    def test_cut_short(self, good: Path, share: float, capfd: pytest.CaptureFixture[str]) -> None:
        good.write_bytes(good.read_bytes()[: int(share * good.stat().st_size)])
        self.refused(good, "photo.dng cannot be read as camera raw", "convert it to a linear TIFF")
        assert capfd.readouterr() == ("", "")

    def test_proraw_in_jpeg_xl(self, tmp_path: Path) -> None:
        self.refused(write_dng(tmp_path / "p.dng", np.zeros((32, 32)), compression=52546), "JPEG XL", "Most Compatible")

    def test_a_header_that_claims_any_size(self, tmp_path: Path) -> None:
        path = write_dng(tmp_path / "huge.dng", np.zeros((32, 32)), size=(60000, 60000))
        self.refused(path, "huge.dng claims to be 60000 x 60000", "400 megapixels")

    @pytest.mark.parametrize("pattern", ["GMCY", "RGBW", "RRRR"])
    def test_a_sensor_without_red_green_and_blue_alone(self, tmp_path: Path, pattern: str) -> None:
        path = write_dng(tmp_path / "odd.dng", np.zeros((48, 60)), pattern=pattern)
        self.refused(path, "odd.dng is from a sensor that sees", "red, green and blue are needed", "another camera")

    def test_srgb(self, good: Path) -> None:
        self.refused(good, "photo.dng is a camera raw file, which is linear, not sRGB", encoding="srgb")

    def test_rawpy_is_not_installed(self, good: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "rawpy", None)
        self.refused(good, "photo.dng", "pip install '.[raw]' in a copy of the repository")
