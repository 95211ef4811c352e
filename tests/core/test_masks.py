"""Masks that are found, against scenes whose object is known."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from synthetic import shaded_sphere, write_file

from mpsnet_core import InputError, published_rig, read_capture, read_correction, read_image, read_mask
from mpsnet_core.capture.masks import MaskNotes, auto_mask, background_mask, find_mask, threshold_mask
from mpsnet_core.io.image import Image

SIDE = 200


def overlap(mask: np.ndarray, truth: np.ndarray) -> float:
    """Intersection over union."""
    return float((mask & truth).sum() / (mask | truth).sum())


def noisy(light: np.ndarray, seed: int = 1, well: float = 8000) -> np.ndarray:
    """A photo of `light` with a sensor's shot noise and read noise, in 12 bits."""
    rng = np.random.default_rng(seed)
    deviation = np.sqrt(light / well + 0.0005**2)
    return (np.rint(np.clip(light + deviation * rng.normal(size=light.shape), 0, 1) * 4095) / 4095).astype(np.float32)


def ball(side: int = SIDE, radius: float = 0.6, albedo: float = 0.7) -> tuple[np.ndarray, np.ndarray]:
    """A matt ball in the middle of a picture under the three lights, and its mask."""
    inner = round(side * radius)
    sphere = shaded_sphere(inner, albedo=[albedo] * 3)
    image, mask = np.zeros((side, side, 3)), np.zeros((side, side), bool)
    place = slice((side - inner) // 2, (side - inner) // 2 + inner)
    image[place, place], mask[place, place] = sphere.image, sphere.mask
    return image, mask


def wall(side: int = SIDE, level: float = 0.2) -> np.ndarray:
    """A plain wall under three near lights: each channel falls off from another place."""
    y, x = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side), indexing="ij")
    places = [(0, 0.8), (-0.7, -0.4), (0.7, -0.4)]
    return level * np.stack([1 / (1 + 0.3 * ((x - a) ** 2 + (y - b) ** 2)) for a, b in places], axis=-1)


def before(scene: np.ndarray, background: np.ndarray, mask: np.ndarray) -> np.ndarray:
    return np.where(mask[..., None], scene, background)


@pytest.mark.parametrize("level", [0, 0.003, 0.05, 0.2, 0.5], ids=lambda level: f"{level}")
@pytest.mark.parametrize("exposure", [1.0, 0.1])
def test_a_ball_before_a_plain_background(level: float, exposure: float) -> None:
    image, mask = ball()
    assert overlap(auto_mask(noisy(exposure * before(image, wall(level=level), mask))), mask) > 0.97


def test_lights_of_unlike_strength() -> None:
    image, mask = ball()
    photo = noisy(before(image, wall(level=0.01), mask) * [1, 0.3, 0.05])
    assert overlap(auto_mask(photo), mask) > 0.97


def test_a_background_of_two_things() -> None:
    """A dark wall above a table: the border shows both, and neither is the object."""
    image, mask = ball()
    background = wall(level=0.002)
    background[150:] *= 4
    assert overlap(auto_mask(noisy(before(image, background, mask))), mask) > 0.95


def test_a_shadow_inside_the_object_is_the_object() -> None:
    image, mask = ball()
    y, x = np.mgrid[:SIDE, :SIDE]
    image[(x - 110) ** 2 + (y - 90) ** 2 < 120] = 0.0005
    image[60:64, 40:90] = 0.0005  # a groove from the ball's inside to its rim
    assert overlap(auto_mask(noisy(before(image, wall(level=0.001), mask))), mask) > 0.97


@pytest.mark.parametrize(("level", "open_"), [(0.2, True), (0.0005, False)])
def test_a_hole_that_shows_a_light_background_stays_open(level: float, open_: bool) -> None:
    """Behind a dark hole there may be the object's shadow as well; a light one is what it looks like."""
    image, mask = ball()
    y, x = np.mgrid[:SIDE, :SIDE]
    hole = (x - 110) ** 2 + (y - 90) ** 2 < 120
    found = auto_mask(noisy(before(image, wall(level=level), mask & ~hole)))
    assert found[hole].mean() == pytest.approx(0 if open_ else 1, abs=0.1)
    assert overlap(found | hole, mask) > 0.97


def test_specks_of_dust_are_left_out_and_parts_are_kept() -> None:
    image, mask = ball(radius=0.4)
    image[20:40, 20:60], mask[20:40, 20:60] = 0.3, True
    photo = before(image, wall(level=0.002), mask)
    photo[170:173, 150:152] = 0.5
    assert overlap(auto_mask(noisy(photo)), mask) > 0.97
    assert not auto_mask(noisy(photo))[165:180, 145:160].any()


def test_a_bust_that_reaches_the_lower_border_is_found_with_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    image, mask = ball()
    image[150:, 60:140] = 0.3
    mask[150:, 60:140] = True
    assert overlap(auto_mask(noisy(before(image, wall(level=0.002), mask))), mask) > 0.97
    assert "the mask meets 10% of the photo's border" in caplog.text


@pytest.mark.parametrize("size", [1.0, 1.05])
def test_a_ball_that_meets_every_side_of_a_dark_photo(size: float, caplog: pytest.LogCaptureFixture) -> None:
    """It covers more than a fifth of the border, but less than half."""
    inner = slice(round(SIDE * (size - 1) / 2), round(SIDE * (size + 1) / 2))
    image, mask = (values[inner, inner] for values in ball(round(SIDE * size), 1.0))
    assert overlap(auto_mask(noisy(before(image, wall(level=0.0005), mask))), mask) > 0.97
    assert "of the photo's border" in caplog.text


def test_a_border_that_is_not_plain_is_reported_of(caplog: pytest.LogCaptureFixture) -> None:
    image, mask = ball()
    background = wall(level=0.01)
    background[:, 150:] = wall(level=0.2)[:, 150:]
    assert overlap(auto_mask(noisy(before(image, background, mask))), mask) < 0.9
    assert "border is not plain" in caplog.text


@pytest.mark.parametrize("factor", [2.5, 4.1])
@pytest.mark.long
def test_a_large_photo_has_its_outline_at_full_size(factor: float) -> None:
    """Photos above the working size are judged pixel by pixel along the outline: it is right to a pixel or two."""
    side = round(factor * 512)
    image, mask = ball(side)
    found = auto_mask(noisy(before(image, wall(side, level=0.003), mask)))
    circumference = np.pi * 0.6 * side
    assert (found ^ mask).sum() < 1.5 * circumference
    assert found.shape == mask.shape


def test_odd_sizes_and_values_that_are_not_finite() -> None:
    image, mask = ball(1500)
    photo = noisy(before(image, wall(1500, level=0.003), mask))[:1333, :1177]
    photo[5, 5], photo[700, 700] = np.nan, np.inf
    assert overlap(auto_mask(photo), mask[:1333, :1177]) > 0.98


def test_a_threshold_counts_from_the_brightest_pixels_not_from_one_hot_one() -> None:
    pixels = np.zeros((100, 100, 3), np.float32)
    pixels[20:60, 20:60, 1] = 0.4
    pixels[30, 30, 0] = 0.021
    pixels[0, 0] = 1000
    pixels[5, 5] = 0.019
    mask = threshold_mask(pixels, 0.05)
    assert mask[20:60, 20:60].all() and mask[0, 0]
    assert mask.sum() == 40 * 40 + 1


class TestBackground:
    def scene(self) -> np.ndarray:
        """A room with a pattern that has the object's own brightnesses."""
        rng = np.random.default_rng(3)
        return wall(level=1) * np.kron(0.05 + 0.5 * rng.random((20, 20)), np.ones((10, 10)))[..., None]

    @pytest.mark.parametrize("exposure", [1.0, 0.8, 1.15])
    def test_the_object_is_what_differs(self, exposure: float) -> None:
        image, mask = ball()
        photo, empty = noisy(before(image, self.scene(), mask), 1), noisy(exposure * self.scene(), 2)
        assert overlap(background_mask(photo, empty), mask) > 0.97

    def test_a_capture_takes_it_with_the_photos_own_correction(self, tmp_path: Path) -> None:
        image, mask = ball()
        scene = self.scene()
        field = 1 - 0.6 * np.linspace(0, 1, SIDE)[:, None, None] * np.ones((SIDE, 3))
        files = {}
        for name, light in {"photo": before(image, scene, mask), "empty": scene, "flat": 0.8 * np.ones(3)}.items():
            files[name] = write_file(tmp_path / f"{name}.png", noisy(light * field), "uint16")
        capture = read_capture(
            files["photo"],
            published_rig(),
            mask=f"background:{files['empty']}",
            encoding="linear",
            correction=read_correction(flat=files["flat"], encoding="linear"),
        )
        assert overlap(capture.mask, mask) > 0.97
        middle = capture.image[mask] / image[mask].clip(0.05)
        assert np.median(middle[image[mask] > 0.1]) == pytest.approx(field[67:133].mean(), rel=0.02)


@pytest.mark.parametrize(("thing", "lights"), [("owl", (0, 4, 8)), ("owl", (3, 7, 11)), ("cat", (1, 5, 9))])
def test_photographs_of_things_on_black_cloth(captures: Path, thing: str, lights: tuple[int, int, int]) -> None:
    """Photographs under one white light each as the channels of one."""
    files = [captures / thing / f"{thing}.{light}.png" for light in lights]
    photo = np.stack([read_image(file).pixels.mean(axis=-1) for file in files], axis=-1)
    assert overlap(auto_mask(photo), read_mask(captures / thing / f"{thing}.mask.png")) > 0.95


def test_what_hardly_differs_is_reported_of(caplog: pytest.LogCaptureFixture) -> None:
    image, mask = ball(albedo=0.2)
    found = auto_mask(noisy(before(image, wall(level=0.15), mask), well=300))
    assert 0.3 < overlap(found, mask) < 0.9
    assert "hardly differ" in caplog.text


def test_large_holes_are_reported_of(caplog: pytest.LogCaptureFixture) -> None:
    """A relief whose ground looks like the table has holes there that are none."""
    image, mask = ball()
    y, x = np.mgrid[:SIDE, :SIDE]
    hole = (x - 100) ** 2 + (y - 100) ** 2 < 20**2
    found = auto_mask(noisy(before(image, wall(level=0.2), mask & ~hole)))
    assert f"holes of {100 * (hole & ~found).sum() / found.sum():.0f}% of its area" in caplog.text


@pytest.mark.parametrize(("radius", "word"), [(0.08, "small"), (0.98, "large")])
def test_masks_of_an_unlikely_size_are_reported_of(radius: float, word: str, caplog: pytest.LogCaptureFixture) -> None:
    image, mask = ball(radius=radius)
    if word == "large":
        mask[9:-9, 9:-9] = True
        image[mask] = image[mask].clip(0.1)
    auto_mask(noisy(before(image, wall(level=0.001), mask)))
    assert f"the mask is {word} for an object" in caplog.text


class TestCommand:
    @pytest.fixture
    def photo(self, tmp_path: Path) -> tuple[Path, np.ndarray]:
        image, mask = ball()
        light = noisy(before(image, wall(level=0.003), mask))
        return write_file(tmp_path / "photo.exr", light, "half"), mask

    def test_mask_and_overlay(self, tmp_path: Path, mpsnet, photo: tuple[Path, np.ndarray]) -> None:
        out, overlay = tmp_path / "mask.png", tmp_path / "overlay.png"
        done = mpsnet("mask", photo[0], "-o", out, "--overlay", overlay, "--progress", "json")
        assert (done.returncode, done.stderr) == (0, "")
        result = json.loads(done.stdout.splitlines()[-1])["result"]
        mask = read_mask(out)
        assert overlap(mask, photo[1]) > 0.97
        assert (result["output"], result["overlay"]) == (str(out), str(overlay))
        assert result["share"] == pytest.approx(mask.mean(), abs=1e-4)
        assert any("the mask covers" in note for note in result["notes"])
        drawn = oiio.ImageBuf(str(overlay)).get_pixels(oiio.FLOAT)
        colourless = np.ptp(drawn, axis=-1) < 0.01
        assert drawn.shape == (SIDE, SIDE, 3) and colourless[0].all()
        outline = (drawn[..., 0] > 0.95) & (np.abs(drawn[..., 1] - 0.55) < 0.02) & (drawn[..., 2] < 0.15)
        assert outline.sum() > 300 and not outline[mask].any()


@pytest.mark.parametrize("light", [np.zeros((50, 60, 3)), np.full((90, 80, 3), 0.3)], ids=["black", "grey"])
def test_a_photo_without_an_object(light: np.ndarray) -> None:
    with pytest.raises(InputError, match="no object stands out from the background; give a mask file"):
        auto_mask(noisy(light))


WHOLE = "no object stands out clearly from a background: the whole photo is assumed to be the object"


@pytest.mark.parametrize("level", [0.0, 0.1], ids=["black", "grey"])
def test_unless_chosen_the_mask_is_alpha_then_what_stands_out(level: float, caplog: pytest.LogCaptureFixture) -> None:
    image, mask = ball(radius=0.3)
    photo = Image(noisy(before(image, np.full(image.shape, level), mask)), None, 1.0)
    alpha = np.zeros(mask.shape, np.float32)
    alpha[:50] = 1
    assert overlap(find_mask(photo), mask) > 0.97
    assert np.array_equal(find_mask(replace(photo, alpha=alpha)), alpha > 0)
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


def cloth() -> np.ndarray:
    x, y = np.meshgrid(np.arange(200), np.arange(160))
    return 0.4 + 0.2 * np.sin(x[..., None] / [3, 4, 5]) * np.sin(y[..., None] / 4)


def relief() -> np.ndarray:
    """A soft dome that fills the photo, brighter in the middle than at its border, as an object would be."""
    y, x = np.meshgrid(np.linspace(-1, 1, 160), np.linspace(-1, 1, 200), indexing="ij")
    normals = np.stack([0.5 * x, -0.5 * y, np.ones_like(x)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return 0.7 * np.maximum(normals @ published_rig().directions.T, 0)


@pytest.mark.parametrize("notes", ["all", "none"])
@pytest.mark.parametrize("surface", [cloth, relief, lambda: np.full((90, 80, 3), 0.3)], ids=["cloth", "relief", "grey"])
def test_a_surface_that_fills_the_photo_is_the_whole_photo(surface: Callable[[], np.ndarray], notes: MaskNotes, caplog):
    assert find_mask(Image(noisy(surface()), None, 1.0), notes=notes).all()
    assert [record.message.split(";")[0] for record in caplog.records] == [WHOLE] * (notes == "all")
