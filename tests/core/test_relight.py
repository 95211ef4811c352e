"""Relit pictures: Lambert's law on a ball, written as sRGB."""

import numpy as np
import pytest
from height_shapes import ball, orthographic

from mpsnet_core import InputError
from mpsnet_core.relief.relight import AMBIENT, relit

BALL = ball(orthographic(300, 80, 30), (0, 0, 0), 1.2)


def linear(srgb: np.ndarray) -> np.ndarray:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def test_a_ball_shades_as_lambert_says() -> None:
    light = np.array([0.6, 0, 0.8])
    picture = relit(BALL.normals, 7 * light)
    assert (picture[..., 3] == BALL.mask).all() and (picture[~BALL.mask] == 0).all()
    cosine = np.maximum(BALL.normals.vectors @ light, 0)
    expected = 0.8 * ((1 - AMBIENT) * cosine + AMBIENT)
    for channel in range(3):
        assert linear(picture[..., channel])[BALL.mask] == pytest.approx(expected[BALL.mask], abs=1e-5)


def test_occlusion_darkens_the_ambient_light_alone_and_albedo_colours_all() -> None:
    light = np.array([1.0, 0, 0])
    dark = relit(BALL.normals, light, occlusion=np.zeros(BALL.mask.shape))
    away = BALL.mask & (BALL.normals.vectors[..., 0] < 0)
    assert (dark[away, :3] == 0).all()
    red = np.broadcast_to([0.5, 0.25, 0.0], (*BALL.mask.shape, 3))
    picture = linear(relit(BALL.normals, light, albedo=red)[BALL.mask, :3])
    assert (picture[:, 2] == 0).all() and picture[:, 0] == pytest.approx(2 * picture[:, 1], abs=1e-5)


@pytest.mark.parametrize("direction", [(0, 0, 0), (1, 0), (np.nan, 0, 1)])
def test_a_light_has_a_direction(direction: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="a light's direction is three finite numbers"):
        relit(BALL.normals, direction)
