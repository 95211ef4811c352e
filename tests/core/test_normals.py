"""Normal maps: encodings by hand, files back and forth, and angles where the usual formula fails."""

from pathlib import Path

import numpy as np
import pytest
from bad_input import SPHERE, gets_one_clear_sentence
from synthetic import Sphere, degrees_between, write_file

from mpsnet_core import GeometryError, angular_error, write_image
from mpsnet_core.scene.normal_encoding import encode, read_vectors
from mpsnet_core.scene.normal_map import NormalMap, read_normals, stating_the_error, write_normals

ROOT = np.sqrt(0.5)


@pytest.mark.parametrize(
    ("vector", "convention", "colour"),
    [
        ([0, 0, 1], "opengl", [0.5, 0.5, 1]),
        ([0, 1, 0], "opengl", [0.5, 1, 0.5]),
        ([0, 1, 0], "directx", [0.5, 0, 0.5]),
        ([-ROOT, 0, ROOT], "directx", [0.5 - ROOT / 2, 0.5, 0.5 + ROOT / 2]),
    ],
)
def test_colours_are_half_plus_half_the_vector(vector: list[float], convention: str, colour: list[float], tmp_path):
    assert encode(np.array(vector), convention) == pytest.approx(colour)
    write_image(tmp_path / "n.exr", np.tile(colour, (2, 2, 1)))
    assert read_vectors(tmp_path / "n.exr", convention)[0] == pytest.approx(np.tile(vector, (2, 2, 1)), abs=1e-6)


@pytest.mark.parametrize("angle", [0, 1e-6, 1e-3, 30, 90, 179.9999, 180])
def test_the_angle_is_exact_near_zero_and_near_180(angle: float) -> None:
    a, b = np.array([0, 0, 1.0]), np.array([np.sin(np.radians(angle)), 0, np.cos(np.radians(angle))])
    assert angular_error(a, b) == pytest.approx(angle, rel=1e-6, abs=1e-9)


def test_outside_the_mask_there_is_nothing(sphere: Sphere) -> None:
    normals = NormalMap(np.ones((*sphere.mask.shape, 3)), sphere.mask, np.full(sphere.mask.shape, 7.0))
    assert (normals.vectors[~sphere.mask] == 0).all() and (normals.confidence[~sphere.mask] == 0).all()
    assert normals.vectors[sphere.mask] == pytest.approx(3**-0.5)
    assert (normals.confidence[sphere.mask] == 1).all()


@pytest.mark.parametrize("spoilt", [np.nan, np.inf])
def test_what_is_not_finite_inside_the_mask_is_refused(spoilt: float) -> None:
    vectors, confidence, mask = np.ones((4, 4, 3)), np.ones((4, 4)), np.ones((4, 4), bool)
    with pytest.raises(GeometryError, match="not finite"):
        NormalMap(vectors, mask, np.where(np.eye(4) > 0, np.nan, confidence))
    vectors[1, 2, 0] = spoilt
    with pytest.raises(GeometryError, match="not finite"):
        NormalMap(vectors, mask)
    mask[1, 2] = False
    assert np.isfinite(NormalMap(vectors, mask).vectors).all()


# Rounding an n-bit colour turns a vector by at most sqrt(3) / (2^n - 1) radians.
@pytest.mark.parametrize("convention", ["opengl", "directx"])
@pytest.mark.parametrize(
    ("name", "bits", "degrees"),
    [("n.png", 16, 0.0016), ("n.png", 8, 0.4), ("n.tif", 16, 0.0016), ("n.exr", 32, 1e-4), ("n.exr", 16, 0.06)],
)
def test_files_give_the_normals_back(tmp_path, sphere, name: str, bits: int, degrees: float, convention: str) -> None:
    write_normals(tmp_path / name, NormalMap(sphere.normals, sphere.mask), convention=convention, bits=bits)
    back = read_normals(tmp_path / name, convention=convention)
    np.testing.assert_array_equal(back.mask, sphere.mask)
    assert degrees_between(back.vectors, sphere.normals)[sphere.mask].max() <= degrees


@pytest.mark.parametrize("background", [0.0, 0.5, (0.0, 0.7, 0.2), np.nan])
def test_a_foreign_map_without_alpha_is_masked_by_unit_length(tmp_path, sphere, background: float | tuple[float, ...]):
    normals, mask = np.pad(sphere.normals, [(40, 40), (40, 40), (0, 0)]), np.pad(sphere.mask, 40)
    colours = np.where(mask[..., None], 0.5 + 0.5 * normals, background)
    back = read_normals(write_file(tmp_path / "n.tif", colours, "half"))
    np.testing.assert_array_equal(back.mask, mask)
    assert degrees_between(back.vectors, normals)[mask].max() < 0.4


def test_a_confidence_map_is_read_beside_the_normals(tmp_path: Path) -> None:
    mask = np.ones((2, 2), bool)
    confidence = np.array([[0, 0.25], [0.5, 1]], np.float32)
    normals = NormalMap(np.broadcast_to([0.0, 0.0, 1.0], (2, 2, 3)), mask, confidence)
    write_normals(tmp_path / "n.png", normals, description=stating_the_error(normals))
    write_image(tmp_path / "c.png", normals.confidence)
    read = read_normals(tmp_path / "n.png", confidence=tmp_path / "c.png")
    assert read.confidence == pytest.approx(confidence, abs=1e-4)
    expected = np.sqrt(np.mean((1 - confidence) ** 2))
    assert read_normals(tmp_path / "n.png").confidence == pytest.approx(np.full((2, 2), 1 - expected), abs=1e-4)
    write_normals(tmp_path / "sure.png", NormalMap(normals.vectors, mask))
    assert (read_normals(tmp_path / "sure.png").confidence == 1).all()


test_a_bad_normal_map_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        (lambda b: read_normals(b.photo("photo.png", 0.5 + 0 * SPHERE.image, "uint8")), "photo.png is not a normal"),
        ("a photo", lambda b: read_normals(b.photo("photo.png", SPHERE.image, "uint8")), "not a normal map"),
        (
            "empty alpha",
            lambda b: read_normals(b.photo("n.png", np.dstack([SPHERE.image, 0 * SPHERE.mask]), "uint8")),
            "n.png holds no normals: its mask is empty; estimate them again",
        ),
        ("shapes that differ", lambda b: NormalMap(SPHERE.normals, SPHERE.mask[:8]), "normals of shape (16, 16, 3) do"),
        (lambda b: NormalMap(SPHERE.normals, SPHERE.mask, np.ones((4, 4))), "confidence of shape (4, 4) does not fit"),
    ]
)
