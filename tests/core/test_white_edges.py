"""A white photo of another scene is noticed by its edges, under any lamp; smooth objects and noise prove nothing."""

from functools import cache

import numpy as np
import pytest
from painted_sphere import Painted

from mpsnet_core.capture.capture import Capture, doubts, shows_another_scene
from mpsnet_core.scene.rig import direction_from_angles, published_rig

RNG = np.random.default_rng(4)


@cache
def bumps(seed: int, size: int = 200) -> np.ndarray:
    """(H, W, 3) normals of a relief of random facets, whose edges are creases."""
    rng = np.random.default_rng(seed)
    centres = rng.uniform(0, size, (150, 2))
    nearest = ((np.indices((size, size)).transpose(1, 2, 0)[:, :, None] - centres) ** 2).sum(axis=-1).argmin(axis=-1)
    slopes = rng.normal(0, 0.5, (150, 2))[nearest]
    normals = np.concatenate([slopes, np.ones((size, size, 1))], axis=-1)
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def lit(normals: np.ndarray, *directions: np.ndarray, noise: float = 0.01) -> np.ndarray:
    clean = np.stack([np.maximum(normals @ one, 0) for one in directions], axis=-1)
    return np.maximum(clean + noise * RNG.normal(size=clean.shape), 0)


@pytest.mark.parametrize("lamp", ["rig", "other"])
@pytest.mark.parametrize("scene", ["same", "another", "shifted", "mirrored"])
def test_edges_tell_whether_it_is_the_same_scene(lamp: str, scene: str) -> None:
    rig, normals = published_rig(), bumps(1)
    shown = {
        "same": normals,
        "another": bumps(2),
        "shifted": np.roll(normals, 7, axis=1),
        "mirrored": normals[:, ::-1],
    }[scene]
    lights = rig.directions if lamp == "rig" else [direction_from_angles(25, 70)]
    white = lit(shown, *lights).sum(axis=-1, keepdims=True) * np.ones(3)
    mask = np.ones(normals.shape[:2], bool)
    capture = Capture(lit(normals, *rig.directions), mask, rig, white=white, white_light=lights[0])
    assert any(kind == "white misfit" for _, kind, _ in doubts(capture)) == (scene != "same")


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.05])
def test_a_smooth_object_proves_nothing(noise: float) -> None:
    sphere = Painted(size=300).sphere
    photo = lit(sphere.normals, *published_rig().directions, noise=noise)
    white = photo.sum(axis=-1, keepdims=True) + noise * RNG.normal(size=photo.shape)
    assert not shows_another_scene(photo, np.maximum(white, 0), sphere.mask)


def test_an_object_of_few_pixels_proves_nothing() -> None:
    mask = np.zeros((40, 40), bool)
    mask[3:9, 4:8] = True
    photo = RNG.random((40, 40, 3))
    assert not shows_another_scene(photo, RNG.random((40, 40, 3)), mask)
