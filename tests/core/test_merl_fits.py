"""Fits to MERL: the network against the same sums written out, and against other people's fits by another model."""

from pathlib import Path

import numpy as np
import pytest
from directions import Array, angles_by_rotation, hemisphere, up

from mpsnet_core.errors import InputError
from mpsnet_core.synthesis.reflectance import load_reflectance, material_names
from mpsnet_core.synthesis.reflectance.measured import read_fits
from mpsnet_core.synthesis.scene_description import Material

SHAPES = {"fc1": (6, 21), "b1": (21,), "fc2": (21, 21), "b2": (21,), "fc3": (21, 3), "b3": (3,)}


def networks(names: list[str]) -> dict[str, Array]:
    """Random networks with outputs about as large as reflectances."""
    rng = np.random.Generator(np.random.PCG64(0))
    layers = {key: 0.4 * rng.normal(size=(len(names), *shape)) for key, shape in SHAPES.items()}
    return {"names": np.array(names), **{key: layer.astype(np.float32) for key, layer in layers.items()}}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    np.savez(tmp_path / "fits.npz", **networks(["walnut", "brass"]))
    return tmp_path / "fits.npz"


def test_network_is_evaluated_as_published(file: Path) -> None:
    """One direction at a time, in double precision, from angles found by rotation."""
    lights, views = hemisphere(200, 1), hemisphere(200, 2)
    layers = networks(["walnut", "brass"])
    fc1, b1, fc2, b2, fc3, b3 = (layers[key][1].astype(float) for key in SHAPES)
    expected = []
    for theta_half, theta_difference, phi in np.stack(angles_by_rotation(lights, views), axis=1):
        phi = phi % np.pi  # the database holds half of the azimuths; the other half swaps light and viewer
        sine = np.sin(theta_difference)
        half = [np.sin(theta_half), 0.0, np.cos(theta_half)]
        difference = [sine * np.cos(phi), sine * np.sin(phi), np.cos(theta_difference)]
        first = np.maximum(np.array(half + difference) @ fc1 + b1, 0)
        second = np.maximum(first @ fc2 + b2, 0)
        expected.append(np.maximum(np.exp(second @ fc3 + b3) - 1, 0))
    assert 0.1 < np.mean(np.array(expected) > 0) < 1  # both kinds of output occur
    assert np.allclose(read_fits(file)["brass"](up(200), lights, views), expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("vector", [[0, 0, -1], [1, 0, 0], [0, 0, 0], [np.nan, 0, 1]])
def test_nothing_is_reflected_from_or_to_below_the_surface(file: Path, vector: list[float]) -> None:
    fit, vectors = read_fits(file)["brass"], np.array([vector], float)
    assert (fit(up(1), vectors, hemisphere(1, 8)) == 0).all()
    assert (fit(up(1), hemisphere(1, 8), vectors) == 0).all()


def test_materials_are_listed_and_loaded_by_name(file: Path) -> None:
    assert material_names(str(file)) == [("fit", "brass"), ("fit", "walnut")]
    lights, views = hemisphere(50, 9), hemisphere(50, 10)
    plain = read_fits(file)["walnut"](up(50), lights, views)
    tinted = load_reflectance(Material("fit", "walnut", (1.0, 0.5, 0.0)), str(file))
    assert np.allclose(tinted(up(50), lights, views, np.full((50, 3), 0.5)), plain * [0.5, 0.25, 0])
    with pytest.raises(InputError, match="has no material 'oak'"):
        load_reflectance(Material("fit", "oak"), str(file))
    with pytest.raises(InputError, match="does not exist"):
        material_names(str(file.with_name("other.npz")))
