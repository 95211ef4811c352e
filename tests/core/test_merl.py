"""MERL tables against the reflectance that they were filled with."""

from pathlib import Path

import numpy as np
import pytest
from directions import Array, angles_by_rotation, hemisphere, up

from mpsnet_core.errors import InputError
from mpsnet_core.synthesis.reflectance import MerlTable, load_reflectance
from mpsnet_core.synthesis.reflectance.hemisphere import rusinkiewicz_angles
from mpsnet_core.synthesis.reflectance.measured import read_merl
from mpsnet_core.synthesis.scene_description import Material

BINS = (90, 90, 180)
SCALE = np.array([1.0, 1.15, 1.66]) / 1500
COLOUR = np.array([0.2, 0.5, 0.1])


def gloss(theta_half: Array, theta_difference: Array, phi_difference: Array) -> Array:
    """A smooth reflectance (..., 3) with a highlight, a Fresnel rise and, for the test's sake, a swing by azimuth."""
    lobe = np.exp(-((theta_half / 0.25) ** 2)) * (0.3 + 0.7 * (1 - np.cos(theta_difference)) ** 3)
    swing = 1 + 0.3 * np.cos(2 * phi_difference) * np.sin(theta_half) * np.sin(theta_difference)
    return (COLOUR + 2 * lobe[..., None]) * swing[..., None]


def bin_centres() -> tuple[Array, Array, Array]:
    half = ((np.arange(BINS[0]) + 0.5) / BINS[0]) ** 2 * np.pi / 2
    difference = (np.arange(BINS[1]) + 0.5) / BINS[1] * np.pi / 2
    azimuth = (np.arange(BINS[2]) + 0.5) / BINS[2] * np.pi
    return np.meshgrid(half, difference, azimuth, indexing="ij")


def write_merl(path: Path, values: Array) -> None:
    with path.open("wb") as file:
        np.array(BINS, "<i4").tofile(file)
        (values / SCALE).transpose(3, 0, 1, 2).astype("<f8").tofile(file)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with gloss.binary, whose samples below the surface are negative as in the database."""
    folder = tmp_path_factory.mktemp("merl")
    theta_half, theta_difference, phi_difference = bin_centres()
    values = gloss(theta_half, theta_difference, phi_difference)
    tilt = np.sin(theta_half) * np.sin(theta_difference) * np.abs(np.cos(phi_difference))
    values[np.cos(theta_half) * np.cos(theta_difference) <= tilt] = -1
    write_merl(folder / "gloss.binary", values)
    return folder


@pytest.fixture(scope="module")
def table(folder: Path) -> MerlTable:
    return read_merl(folder / "gloss.binary")


def test_angles_are_those_of_turning_the_half_vector_into_the_pole() -> None:
    lights, views = hemisphere(2000, 1), hemisphere(2000, 2)
    expected = angles_by_rotation(lights, views)
    found = rusinkiewicz_angles(up(2000), lights, views)
    assert np.allclose(found[0], expected[0], atol=1e-6)
    assert np.allclose(found[1], expected[1], atol=1e-6)
    assert np.abs(np.angle(np.exp(1j * (found[2] - expected[2])))).max() < 1e-6


def test_angles_hold_in_single_precision_near_the_poles() -> None:
    """Half angles of 1e-4 rad and difference angles of 1e-3 rad, which arc cosines of floats cannot tell from 0."""
    tilt, spread = 1e-4, 1e-3
    half = np.array([[np.sin(tilt), 0, np.cos(tilt)]])
    apart = np.array([[0, np.sin(spread), 0]])
    lights, views = half * np.cos(spread) + apart, half * np.cos(spread) - apart
    found = rusinkiewicz_angles(*(vectors.astype(np.float32) for vectors in (up(1), lights, views)))
    assert found[0] == pytest.approx(tilt, rel=2e-3)
    assert found[1] == pytest.approx(spread, rel=1e-3)
    assert found[2] == pytest.approx(np.pi / 2, abs=1e-2)


def test_lookup_gives_the_reflectance_that_the_table_was_made_of(table: MerlTable) -> None:
    """Between the bins the error is that of linear interpolation in bins of up to 2 degrees."""
    lights, views = hemisphere(20000, 3, 0.1), hemisphere(20000, 4, 0.1)
    expected = gloss(*angles_by_rotation(lights, views))
    error = np.abs(table(up(20000), lights, views) - expected) / expected
    assert error.max() < 0.01
    assert error.mean() < 0.0005


def test_samples_are_scaled_by_channel(tmp_path: Path) -> None:
    with (tmp_path / "flat.binary").open("wb") as file:
        np.array(BINS, "<i4").tofile(file)
        np.full(3 * np.prod(BINS), 1500.0, "<f8").tofile(file)
    found = read_merl(tmp_path / "flat.binary")(up(10), hemisphere(10, 6), hemisphere(10, 7))
    assert np.allclose(found, [1.0, 1.15, 1.66])


def test_directions_that_were_not_measured_are_sound(table: MerlTable) -> None:
    """Grazing pairs lie between measured and unmeasured samples; the latter must not pull them towards -1."""
    rng = np.random.Generator(np.random.PCG64(12))
    lights, views = hemisphere(5000, 13), hemisphere(5000, 14)
    lights[:, 2] = views[:, 2] = 1e-4 + 0.02 * rng.random(5000)
    lights /= np.linalg.norm(lights, axis=1, keepdims=True)
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    found, expected = table(up(5000), lights, views), gloss(*angles_by_rotation(lights, views))
    assert (found > 0.5 * expected).all() and (found < 1.5 * expected).all()


@pytest.mark.parametrize("vector", [[0, 0, -1], [1, 0, 0], [0, 0, 0], [np.nan, 0, 1]])
def test_nothing_is_reflected_from_or_to_below_the_surface(table: MerlTable, vector: list[float]) -> None:
    other, normal = hemisphere(1, 15), up(1)
    vectors = np.array([vector], float)
    assert (table(normal, vectors, other) == 0).all()
    assert (table(normal, other, vectors) == 0).all()


def test_paint_and_tint_multiply_the_reflectance(folder: Path, table: MerlTable) -> None:
    lights, views = hemisphere(100, 16), hemisphere(100, 17)
    paint = np.tile([0.5, 1.0, 2.0], (100, 1))
    plain = table(up(100), lights, views)
    assert np.allclose(table(up(100), lights, views, paint), plain * [0.5, 1, 2])
    tinted = load_reflectance(Material("merl", "gloss.binary", (0.5, 1.0, 0.25)), str(folder))
    assert np.allclose(tinted(up(100), lights, views, paint), plain * [0.25, 1, 0.5])


def test_other_files_are_refused(folder: Path, tmp_path: Path) -> None:
    size = (folder / "gloss.binary").stat().st_size
    other = tmp_path / "other.binary"
    with pytest.raises(InputError, match="does not exist"):
        read_merl(other)
    other.write_bytes(b"short")
    with pytest.raises(InputError, match="has 5 bytes"):
        read_merl(other)
    for header, message in (((90, 180, 90), "begins with"), (BINS, "no measured sample")):
        with other.open("wb") as file:
            np.array(header, "<i4").tofile(file)
            np.full((size - 12) // 8, -1.0, "<f8").tofile(file)
        with pytest.raises(InputError, match=message):
            read_merl(other)
    with pytest.raises(InputError, match="name where measured materials are"):
        load_reflectance(Material("merl", "gloss.binary"), "")
