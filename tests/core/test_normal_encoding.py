"""Numbers of normal maps: which level is zero, and how z is stored. All files are encoded here, by hand."""

import logging
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from bumpy_sphere import unit
from synthetic import degrees_between, write_file

from mpsnet_core import FormatError, read_base_map, read_normals
from mpsnet_core.scene.normal_encoding import read_vectors, write_vectors

SIDE = 128
FLAT = np.array([0, 0, 1.0])
# Signed numbers as bytes. In the last three green is inverted after rounding, as image editors do for DirectX.
BYTES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "128": lambda n: np.rint(128 + 127 * n),
    "127.5, rounded": lambda n: np.floor(128 + 127.5 * n).clip(0, 255),
    "127.5, cut": lambda n: np.floor(127.5 + 127.5 * n),
    "128, inverted": lambda n: np.abs(np.rint(128 + 127 * n * [1, -1, 1]) - [0, 255, 0]),
    "127.5, rounded, inverted": lambda n: np.abs(np.floor(128 + 127.5 * n * [1, -1, 1]).clip(0, 255) - [0, 255, 0]),
}


def relief(steepness: float, lean: float = 0.0) -> np.ndarray:
    """(S, S, 3) a seamless relief of waves, or with `lean` one that only rises; its steepest slopes."""
    x, y = np.meshgrid(*[2 * np.pi * (np.arange(SIDE) + 0.5) / SIDE] * 2)
    p, q = np.cos(3 * x + np.sin(y)), np.sin(2 * y)
    return unit(np.dstack([-steepness * (p + lean), -steepness * (q - lean), np.ones_like(p)]))


def domes() -> np.ndarray:
    """(S, S, 3) half spheres on a flat ground."""
    x, y = np.meshgrid(*[4 * ((np.arange(SIDE) + 0.5) / SIDE) % 1 * 2 - 1] * 2)
    inside = x**2 + y**2 < 0.5
    return np.where(inside[..., None], np.dstack([x, -y, np.sqrt(np.maximum(1 - x**2 - y**2, 0.1))]), FLAT)


SURFACES = {
    "gentle": relief(0.05),
    "waves": relief(0.4),
    "steep": relief(1.5),
    "rising": relief(0.3, 1.2),
    "domes": domes(),
    "flat": np.tile(FLAT, (SIDE, SIDE, 1)),
}


def written(path: Path, levels: np.ndarray, kind: str = "uint8") -> Path:
    """Levels of a byte, as 8 bits, or as what other programs make of 8 bits."""
    if kind == "upper byte":
        return write_file(path, levels * 256 / 65535, "uint16", oiio__UnassociatedAlpha=1)
    return write_file(path, levels / 255, kind, oiio__UnassociatedAlpha=1)


@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize("encoded", BYTES)
def test_no_convention_of_bytes_makes_a_surface_lean(surface: str, encoded: str, tmp_path: Path) -> None:
    """A wrong zero turns all normals by 0.22 degrees or more. Of one rising surface it cannot be known."""
    truth = SURFACES[surface]
    found, _ = read_vectors(written(tmp_path / "n.png", BYTES[encoded](truth)))
    lean = np.degrees(np.arctan2((unit(found) - truth).mean(axis=(0, 1))[:2], 1))
    if (surface, encoded) != ("rising", "128, inverted"):
        assert np.abs(lean).max() < 0.02
    assert degrees_between(found, truth).max() < 0.75


@pytest.mark.parametrize("name", ["n.png", "n.tif"])
def test_a_flat_area_is_byte_128_even_with_noise(name: str, tmp_path: Path) -> None:
    noise = 0.002 * np.random.default_rng(0).normal(size=(64, 64, 2)).clip(-1.5, 1.5)
    vectors = unit(np.dstack([noise, np.ones((64, 64))]))
    for convention in ("opengl", "directx"):
        write_vectors(tmp_path / name, vectors, convention=convention, bits=8)
        assert (oiio.ImageBuf(str(tmp_path / name)).get_pixels(oiio.UINT8) == (128, 128, 255)).all()
    write_vectors(tmp_path / name, np.tile(FLAT, (4, 4, 1)), bits=16)
    assert (oiio.ImageBuf(str(tmp_path / name)).get_pixels(oiio.UINT16) == (32768, 32768, 65535)).all()


@pytest.mark.parametrize("kind", ["uint16", "upper byte", "half", "float"])
def test_bytes_stay_bytes_in_files_of_more_bits(kind: str, tmp_path: Path) -> None:
    path = tmp_path / ("n.exr" if kind in ("half", "float") else "n.png")
    for encoded in ("128", "127.5, rounded"):
        found, _ = read_vectors(written(path, BYTES[encoded](SURFACES["domes"]), kind))
        assert degrees_between(found[0, 0], FLAT) < 0.001
        assert np.abs((unit(found) - SURFACES["domes"]).mean(axis=(0, 1))[:2]).max() < 2e-4


def two_channels() -> Iterator[tuple[str, Callable[[np.ndarray], np.ndarray]]]:
    """Files without z, of floats or bytes: their name, and from a map's bytes what the file holds."""
    for blue in (0, 127, 128, 255):
        yield f"blue {blue}.png", lambda n, b=blue: np.dstack([n[..., :2], np.full_like(n[..., 0], b)])
    yield "green twice.png", lambda n: n[..., [0, 1, 1]]
    yield "grey and alpha.png", lambda n: n[..., :2]
    yield "two channels.tif", lambda n: n[..., :2]
    yield "white, alpha.png", lambda n: np.dstack([0 * n[..., 0] + 255, n[..., 1], 0 * n[..., 0] + 255, n[..., 0]])
    yield "black, alpha.png", lambda n: np.dstack([0 * n[..., 0], n[..., 1], 0 * n[..., 0], n[..., 0]])
    yield "grey, alpha.png", lambda n: np.dstack([*[n[..., 1]] * 3, n[..., 0]])


@pytest.mark.parametrize("surface", ["gentle", "waves", "steep", "domes"])
@pytest.mark.parametrize(("name", "held"), [*two_channels()], ids=lambda given: given if isinstance(given, str) else "")
def test_z_is_made_where_a_file_has_none(
    name: str, held: Callable[[np.ndarray], np.ndarray], surface: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    found, alpha = read_vectors(written(tmp_path / name, held(BYTES["128"](SURFACES[surface]))))
    assert degrees_between(found, SURFACES[surface]).max() < 0.9
    assert alpha is None
    assert "z is made" in caplog.text or (name, surface) == ("blue 255.png", "gentle")
    assert degrees_between(read_base_map(tmp_path / name), SURFACES[surface]).max() < 0.9


@pytest.mark.parametrize("other", [lambda x, y: 0.5 + 0.4 * np.cos(x / 9), lambda x, y: np.full_like(x, 0.3)])
def test_an_alpha_of_other_data_hides_nothing(other: Callable[[np.ndarray, np.ndarray], np.ndarray], tmp_path, caplog):
    """Game engines keep heights or gloss there."""
    caplog.set_level(logging.INFO)
    colours = BYTES["128"](SURFACES["waves"])
    y, x = np.mgrid[: len(colours), : len(colours)].astype(float)
    written(tmp_path / "n.png", np.dstack([colours, np.rint(255 * other(x, y))]))
    assert read_normals(tmp_path / "n.png").mask.all()
    assert "alpha is not a mask" in caplog.text
    disc = np.clip(30 - np.hypot(x - 30, y - 30), 0, 1)
    written(tmp_path / "n.png", np.dstack([colours, np.rint(255 * disc)]))
    assert (read_normals(tmp_path / "n.png").mask == (np.rint(255 * disc) > 127)).all()


def test_floats_of_either_kind_are_read(tmp_path: Path) -> None:
    for surface in ("gentle", "steep"):
        for values in (SURFACES[surface], 0.5 + 0.5 * SURFACES[surface]):
            found, _ = read_vectors(write_file(tmp_path / "n.exr", values, "float"))
            assert degrees_between(found, SURFACES[surface]).max() < 0.01


def test_blue_may_hold_z_from_0_to_1(tmp_path: Path) -> None:
    truth = SURFACES["steep"]
    colours = np.dstack([0.5 + 0.5 * truth[..., :2], truth[..., 2]])
    assert degrees_between(read_vectors(write_file(tmp_path / "n.png", colours, "uint16"))[0], truth).max() < 0.01


def test_averages_of_normals_are_not_taken_for_something_else(tmp_path: Path) -> None:
    """As in a reduced map, which nobody normalised."""
    truth = relief(0.5) + 0.4 * np.random.default_rng(0).normal(size=(SIDE, SIDE, 1)) * [1, 1, 0]
    short = unit(truth).reshape(SIDE // 2, 2, SIDE // 2, 2, 3).mean(axis=(1, 3))
    assert np.linalg.norm(short, axis=-1).mean() < 0.93
    found, _ = read_vectors(write_file(tmp_path / "n.png", 0.5 + 0.5 * short, "uint16"))
    assert degrees_between(found, short).max() < 0.01


@pytest.mark.parametrize("alpha", [False, True])
def test_a_photo_does_not_become_a_normal_map(alpha: bool, tmp_path: Path) -> None:
    """Grey and in colour; on black, with a mask in alpha."""
    y, x = np.indices((64, 64)) / 64
    light, inside = 0.1 + 0.8 * x, np.hypot(x - 0.5, y - 0.5) < 0.4
    for colours in ([light] * 3, [light, 0.8 * light**2, 0.5 * light]):
        picture = np.dstack([*colours, np.ones_like(x)]) * inside[..., None]
        path = write_file(tmp_path / "p.png", picture[..., : 4 if alpha else 3], "uint8", oiio__UnassociatedAlpha=1)
        with pytest.raises(FormatError, match="not a normal map"):
            read_base_map(path)
