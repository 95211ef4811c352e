"""The capture model against what its numbers say: lines, counts, levels and angles measured on its photographs."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from ideal_capture import IDEAL
from sphere_sample import RED, sphere_sample
from synthetic import degrees_between, write_file

from mpsnet_core import Capture, Sample, published_rig, read_image
from mpsnet_core.estimate.estimator import lambertian_normals
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.learning.training.packed import Packed
from mpsnet_core.learning.training.photo_simulation import simulate_photo
from mpsnet_core.synthesis.capture_model import CaptureDraw, CaptureModel, turned

DIRECTIONS = published_rig().directions


@pytest.fixture(scope="module")
def white() -> Sample:
    return sphere_sample(96)


@pytest.fixture(scope="module")
def coloured() -> Sample:
    return sphere_sample(96, right=RED)


def generator(seed: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64(seed))


def ideal(**changes: Any) -> CaptureDraw:
    return replace(IDEAL.draw(generator(1)), **changes)


def taken(sample: Sample, draw: CaptureDraw) -> Capture:
    return shot(sample.lights, sample.mask, sample.recipe.light_directions, draw, sample.normals)


def flat(levels: np.ndarray, draw: CaptureDraw, mask: np.ndarray | None = None) -> Capture:
    """A photograph of a grey picture (H, W), each channel lit by its own light."""
    lights = np.broadcast_to(levels[None, ..., None], (3, *levels.shape, 3)).astype(np.float32)
    return shot(lights, np.ones(levels.shape, bool) if mask is None else mask, DIRECTIONS, draw)


def shot(
    lights: np.ndarray, mask: np.ndarray, directions: np.ndarray, draw: CaptureDraw, normals: np.ndarray | None = None
) -> Capture:
    """In single precision, where packed files have half floats."""
    height, width = mask.shape
    planes = (lights * mask[None, ..., None]).transpose(0, 3, 1, 2).reshape(9, height, width)
    truth = np.zeros((height, width, 3), np.float32) if normals is None else normals
    lit = torch.ones(3, height, width, dtype=torch.bool)
    packed = Packed(
        torch.from_numpy(planes),
        torch.from_numpy(np.ascontiguousarray(truth.transpose(2, 0, 1))),
        torch.from_numpy(mask),
        lit,
        directions,
    )
    return simulate_photo(packed, draw)[0]


def test_an_ideal_capture_gives_equation_2_its_exact_normals(white: Sample) -> None:
    capture = taken(white, IDEAL.draw(generator(5)))
    estimate = lambertian_normals(capture)
    lit = white.mask & (white.lit > 0).all(axis=0)
    assert lit.sum() > 3000
    assert degrees_between(estimate.vectors, white.normals)[lit].max() < 0.01
    np.testing.assert_array_equal(capture.mask, white.mask)
    np.testing.assert_allclose(capture.rig.directions, white.recipe.light_directions, atol=1e-12)
    assert capture.clip == np.inf


@pytest.mark.parametrize("hue", [0.0, 1.0])
def test_grain_varies_the_albedo_alike_under_all_lights(white: Sample, hue: float) -> None:
    """On a flat grey surface the photo is the grain itself: its amount, its size and its tint can be measured."""
    draw = ideal(grain=0.1, grain_size=8.0, grain_hue=hue, white=True, white_mixing=np.ones((3, 3)))
    capture = flat(np.ones((256, 256)), draw)
    grain = np.log(capture.image)
    np.testing.assert_allclose(grain.std(axis=(0, 1)), 0.1, rtol=0.02)
    between_channels = np.corrcoef(grain.reshape(-1, 3).T)[0, 1]
    assert between_channels > 0.999 if hue == 0 else abs(between_channels) < 0.15
    for shift, least, most in ((1, 0.9, 1.0), (8, -0.1, 0.4), (24, -0.2, 0.2)):
        beside = np.corrcoef(grain[:, shift:, 0].ravel(), grain[:, :-shift, 0].ravel())[0, 1]
        assert least < beside < most, shift
    assert capture.white is not None
    np.testing.assert_allclose(capture.white / capture.white.max(), capture.image / capture.image.max(), rtol=1e-4)
    # Equation 2 of one light's image over another's does not see a grain of one tint.
    lit = white.mask & (white.lit > 0).all(axis=0)
    error = degrees_between(lambertian_normals(taken(white, draw)).vectors, white.normals)[lit].max()
    assert error < 0.01 if hue == 0 else error > 3


def test_the_mixing_is_found_again_on_a_white_sphere(white: Sample) -> None:
    for seed in range(5):
        draw = ideal(mixing=CaptureModel().draw(generator(seed)).mixing)
        image = taken(white, draw).image[white.mask]
        found = np.linalg.lstsq(white.lights[:, white.mask, 0].T, image, rcond=None)[0].T
        np.testing.assert_allclose(found / found.sum(), draw.mixing / draw.mixing.sum(), rtol=1e-4)


def test_what_is_known_of_the_mixing_is_undone(white: Sample) -> None:
    model = replace(IDEAL, crosstalk=(0.3, 0.3), light_strengths=(0.7, 1.4), channel_gains=(0.6, 1.6))
    lit = white.mask & (white.lit > 0).all(axis=0)
    unknown = replace(model, exact=0.0, measured=0.0, unknown=1.0, bad_direction_error=(0.0, 0.0))
    errors = []
    for one in (model, unknown):
        draw = one.draw(generator(2))
        capture = taken(white, draw)
        errors.append(degrees_between(lambertian_normals(capture).vectors, white.normals)[lit].max())
        np.testing.assert_array_equal(capture.rig.mixing, draw.mixing if one is model else np.eye(3))
    assert errors[0] < 0.02
    assert errors[1] > 5


@pytest.mark.parametrize(("measured", "spread"), [(1.0, 0.02), (0.0, 0.06)])
def test_a_measured_mixing_is_off_by_its_error(measured: float, spread: float) -> None:
    model = replace(
        CaptureModel(),
        exact=0.0,
        measured=measured,
        unknown=0.0,
        mixing_error=(0.02, 0.02),
        bad_mixing_error=(0.06, 0.06),
    )
    draws = [model.draw(generator(seed)) for seed in range(200)]
    off = np.array([(draw.known_mixing - draw.mixing) / draw.mixing.max() for draw in draws])
    assert off.std() == pytest.approx(spread, rel=0.05)
    assert abs(off.mean()) < 0.1 * spread


@pytest.mark.long
def test_the_noise_s_variance_is_a_line_over_its_mean() -> None:
    full_well, read_noise, levels = 4000.0, 25.0, np.linspace(0, 1, 12)
    picture = np.repeat(levels, 400)[:, None] * np.ones((1, 50))
    image = flat(picture, ideal(full_well=full_well, read_noise=read_noise)).image
    groups = image.reshape(12, -1)
    slope, intercept = np.polyfit(groups.mean(axis=1), groups.var(axis=1), 1)
    np.testing.assert_allclose(groups.mean(axis=1), levels, atol=3e-4)
    # 60,000 values a level: a variance is known to 0.6%, the line's slope to about 0.7%.
    assert slope == pytest.approx(1 / full_well, rel=0.03)
    assert groups.var(axis=1)[0] == pytest.approx((read_noise / full_well) ** 2, rel=0.03)
    assert intercept == pytest.approx((read_noise / full_well) ** 2, rel=0.06)
    noise = (image - np.repeat(levels, 400)[:, None, None]).reshape(-1, 3)
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 0.01, "channels have noise of their own"


def test_what_the_full_well_cannot_hold_is_saturated() -> None:
    ramp = np.tile(np.linspace(0, 1, 1000), (4, 1))
    capture = flat(ramp, ideal(exposure=1.3, bits=16))
    assert capture.clip == 1.0
    assert capture.image.max() == 1.0
    # 1.3 is at 0.99 of the ramp: all beyond 0.99 / 1.3 of it is at the end.
    assert (capture.image == 1).mean() == pytest.approx(1 - 0.99 / 1.3, abs=0.002)
    assert (capture.saturated.mean()) == pytest.approx(1 - 0.99**2 / 1.3, abs=0.002)
    # A float picture clips nothing.
    assert flat(ramp, ideal(exposure=1.3)).image.max() == pytest.approx(1.3 / 0.99, rel=1e-3)


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_linear_values_are_rounded_to_levels(bits: int) -> None:
    # Exposed so that the ramp is not scaled: its value that one in a hundred exceed stays.
    image = flat(np.linspace(0, 1, 40_000).reshape(200, 200), ideal(bits=bits, exposure=0.99)).image.astype(float)
    top = 2**bits - 1
    levels = image * top
    assert np.abs(levels - np.rint(levels)).max() < 0.01
    assert len(np.unique(np.rint(levels))) == min(2**bits, 40_000)
    exact = np.linspace(0, 1, 40_000).reshape(200, 200, 1)
    assert np.abs(image - exact).max() <= 0.5 / top + 1e-6
    assert np.abs(image - exact).max() > 0.4 / top


@pytest.mark.parametrize(("bits", "kind"), [(8, "uint8"), (16, "uint16")])
def test_values_with_the_srgb_curve_are_those_of_a_png(tmp_path: Path, coloured: Sample, bits: int, kind: str) -> None:
    linear = taken(coloured, ideal(exposure=0.8)).image
    image = read_image(write_file(tmp_path / "photo.png", linear_to_srgb(linear), kind)).pixels
    ours = taken(coloured, ideal(exposure=0.8, bits=bits, srgb=True)).image
    # OpenImageIO rounds float32 values; a few in a thousand are on the other side of a half.
    assert (np.abs(ours - image) > 1e-6).mean() < (0.001 if bits == 8 else 0.02)
    assert np.abs(ours - image).max() < 2.5 / 2**bits


@pytest.mark.parametrize("sigma", [0.3, 0.8, 1.2, 2.5])
def test_a_blurred_edge_is_a_gaussian_s_integral(sigma: float) -> None:
    step = np.tile(np.arange(80) >= 40, (70, 1)).astype(float)
    for edge, profile in ((step, np.s_[35, :, 0]), (step.T, np.s_[:, 35, 1])):
        image = flat(edge, ideal(blur=sigma)).image.astype(float)
        spread = np.diff(image[profile])
        places = np.arange(len(spread)) + 0.5
        assert spread.sum() == pytest.approx(1, abs=1e-4)
        centre = (spread * places).sum()
        assert centre == pytest.approx(39.5, abs=1e-3)
        assert np.sqrt((spread * (places - centre) ** 2).sum()) == pytest.approx(sigma, rel=0.05)


def test_direction_errors_are_those_of_a_gaussian_across_each_light() -> None:
    sigma = 2.0
    model = replace(IDEAL, exact=0.0, measured=1.0, direction_error=(sigma, sigma))
    rng = generator(6)
    given = np.array([turned(DIRECTIONS, model.draw(rng).direction_errors) for _ in range(700)])
    angles = degrees_between(given, DIRECTIONS)
    # The length of a vector of two independent Gaussians is distributed after Rayleigh; 2,100 of them.
    assert angles.mean() == pytest.approx(sigma * np.sqrt(np.pi / 2), rel=0.04)
    assert np.median(angles) == pytest.approx(sigma * np.sqrt(2 * np.log(2)), rel=0.05)
    assert (angles > 2 * sigma).mean() == pytest.approx(np.exp(-2), abs=0.03)
    assert degrees_between(given.mean(axis=0), DIRECTIONS).max() < 0.3, "they are off to all sides"
    np.testing.assert_allclose(np.linalg.norm(given, axis=-1), 1, atol=1e-12)


@pytest.mark.parametrize("pixels", [-3, -1, 1, 2, 4])
def test_a_mask_is_off_by_its_error(pixels: int) -> None:
    y, x = np.mgrid[:120, :120] - 59.5
    disc = np.hypot(x, y) < 40
    mask = flat(np.ones((120, 120)), ideal(mask_error=pixels), disc).mask
    assert (mask >= disc).all() if pixels > 0 else (mask <= disc).all()
    assert np.sqrt(mask.sum() / np.pi) == pytest.approx(40 + pixels, abs=0.2 * abs(pixels))


def test_a_white_photo_shows_the_colours_of_the_same(coloured: Sample) -> None:
    draw = ideal(white=True, white_mixing=np.outer([1, 2, 1], [0.3, 1, 0.5]))
    capture = taken(coloured, draw)
    albedo = np.where((coloured.material == 1)[..., None], RED, 0.8) * coloured.mask[..., None]
    shading = np.maximum(coloured.normals @ coloured.recipe.light_directions.T, 0) @ [0.3, 1, 0.5]
    expected = albedo * [1, 2, 1] * shading[..., None]
    assert capture.white is not None
    np.testing.assert_allclose(capture.white / capture.white.max(), expected / expected.max(), atol=1e-6)
    assert capture.white[coloured.mask].max(axis=-1).mean() < 1


def test_a_mosaic_leaves_what_is_flat_and_mixes_neighbours_at_edges() -> None:
    edge = np.tile(np.where(np.arange(32) < 15, 0.2, 0.8), (32, 1))
    image, plain = (flat(edge, ideal(mosaic=mosaic)).image for mosaic in (True, False))
    inner = np.s_[2:-2, 2:-2]
    off = np.abs(image - plain)[inner].max(axis=(0, 2))
    assert off.argmax() in (12, 13) and not off[:10].max() > 1e-6 and not off[16:].max() > 1e-6
    for channel, rows, columns in ((0, 0, 0), (1, 0, 1), (1, 1, 0), (2, 1, 1)):
        seen = np.s_[rows::2, columns::2, channel]
        np.testing.assert_allclose(image[seen], plain[seen], atol=1e-6)
