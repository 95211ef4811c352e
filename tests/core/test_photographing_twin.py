"""Photographs made on the device against those of the NumPy capture model, its twin."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from sphere_sample import RED, sphere_sample

from mpsnet_core.synthesis.photographs import capture_model as twin
from mpsnet_core.synthesis.photographs.capture_model import CaptureDraw, CaptureModel
from mpsnet_core.synthesis.photographs.jpeg import jpeg_losses as twin_s_jpeg
from mpsnet_core.training import photographing as device
from mpsnet_core.training.jpeg import jpeg_losses

CPU = torch.device("cpu")
SAMPLE = sphere_sample(96, right=RED)


def draw(seed: int, **changes: Any) -> CaptureDraw:
    model = replace(CaptureModel(), exact=0.0, mosaic=0.0)
    return replace(model.draw(np.random.Generator(np.random.PCG64(seed))), **changes)


def both(of: CaptureDraw) -> tuple[np.ndarray, np.ndarray]:
    """The photograph (3, H, W) of the twin, and of the device with the twin's exposure."""
    lights = SAMPLE.lights * SAMPLE.mask[None, ..., None]
    theirs = twin.photograph(lights, SAMPLE.mask, SAMPLE.recipe.light_directions, of).image.transpose(2, 0, 1)
    planes = torch.zeros(1, 13, 96, 96)
    channels = torch.from_numpy(np.ascontiguousarray(lights.transpose(0, 3, 1, 2))).reshape(9, -1)
    planes[0, :6] = (device._weights(of, CPU) @ channels).reshape(6, 96, 96)
    planes[0, 12] = torch.from_numpy(SAMPLE.mask).float()
    bright = np.quantile(
        twin._blurred(twin._mixed(lights, of), of.blur).max(axis=0)[SAMPLE.mask], 1 - of.highlights, method="higher"
    )
    exposure = torch.full((1, 2), float(of.exposure / bright))
    photo, _, _ = device._seen(
        planes, planes[:, 12:] > 0, device._Draws.of([of], CPU), exposure, torch.zeros(1), torch.Generator()
    )
    return theirs, photo[0].numpy()


def test_a_blurred_picture_is_the_twin_s() -> None:
    for seed in range(4):
        theirs, ours = both(draw(seed, bits=0, read_noise=0.0, full_well=np.inf, jpeg_quality=0))
        np.testing.assert_allclose(ours, theirs, atol=1e-5)


@pytest.mark.parametrize("srgb", [False, True])
@pytest.mark.parametrize("bits", [8, 12])
def test_levels_are_the_twin_s(bits: int, srgb: bool) -> None:
    theirs, ours = both(draw(3, bits=bits, srgb=srgb, read_noise=0.0, full_well=np.inf, jpeg_quality=0, exposure=1.1))
    assert (np.abs(ours - theirs) > 1e-6).mean() < 0.002
    assert ((ours == 1) == (theirs == 1)).mean() > 0.9999 and (ours == 1).any()


@pytest.mark.parametrize("halved", [False, True])
@pytest.mark.parametrize("quality", [60, 90])
def test_jpeg_is_the_twin_s(quality: int, halved: bool) -> None:
    levels = np.rint(255 * both(draw(5, bits=0))[0].clip(0, 1) ** 0.45).astype(np.float64)
    theirs = twin_s_jpeg(levels.transpose(1, 2, 0), quality, halved_chroma=halved).transpose(2, 0, 1)
    ours = jpeg_losses(torch.from_numpy(levels).float()[None], torch.tensor([float(quality)]), torch.tensor([halved]))[
        0
    ].numpy()
    # Halves, which are common among whole numbers, fall to either side, and take their block with them.
    assert (np.abs(ours - theirs) > 1).mean() < 0.05
    assert np.abs(ours - levels).mean() == pytest.approx(np.abs(theirs - levels).mean(), rel=0.002)


def test_noise_is_as_strong_as_the_twin_s() -> None:
    of = draw(7, bits=0, full_well=3000.0, read_noise=10.0, jpeg_quality=0)
    quiet = both(replace(of, full_well=np.inf, read_noise=0.0))[0]
    theirs, ours = (photo - quiet for photo in both(of))
    for low, high in ((0, 0.05), (0.1, 0.3), (0.3, 0.6)):
        level = (quiet >= low) & (quiet < high) & SAMPLE.mask
        assert level.sum() > 1000
        assert ours[level].std() == pytest.approx(theirs[level].std(), rel=0.07)
        assert abs(ours[level].mean() - theirs[level].mean()) < 4 * theirs[level].std() / level.sum() ** 0.5


def test_masks_are_the_twin_s() -> None:
    mask = torch.from_numpy(SAMPLE.mask)[None, None]
    for pixels in (-3, -2, -1, 0, 1, 2):
        ours = device._grown(mask, torch.tensor([pixels]))[0, 0].numpy()
        np.testing.assert_array_equal(ours, twin._grown(SAMPLE.mask, pixels))


def test_unmixing_is_the_rig_s() -> None:
    of = draw(9)
    photo = both(of)[0]
    ours = device._unmixed(torch.from_numpy(photo)[None], torch.tensor(of.known_mixing[None]))[0].numpy()
    theirs = twin.LightRig(SAMPLE.recipe.light_directions, of.known_mixing).unmixed(photo.transpose(1, 2, 0))
    np.testing.assert_allclose(ours.transpose(1, 2, 0), theirs, atol=1e-5)
