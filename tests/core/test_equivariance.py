"""Turning the whole scene, photo and lights, turns the answer of a network that sees it in the canonical frame."""

from pathlib import Path

import numpy as np
import pytest
from networks import card, conv, random_weights, write_model
from onnx import helper
from synthetic import degrees_between

from mpsnet_core.capture import Capture
from mpsnet_core.estimate import estimate_normals
from mpsnet_core.normals import NormalMap
from mpsnet_core.rig import LightRig, direction_from_angles

MIXING = np.array([[0.9, 0.08, 0.02], [0.1, 0.85, 0.1], [0.02, 0.15, 0.8]])


def rotation(degrees: float) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def rig(tilts=(75.0, 210.0, 320.0)) -> LightRig:
    return LightRig(direction_from_angles([25, 35, 45], tilts), MIXING)


def scene(turn: float, lights: LightRig, size: int = 96, radius: float = 38) -> Capture:
    """A wavy disc, its light and its lights turned by `turn` degrees: formulas, sampled anew on the turned pixels."""
    y, x = np.mgrid[:size, :size]
    x, y = x - (size - 1) / 2, (size - 1) / 2 - y
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    x, y = c * x + s * y, c * y - s * x  # where the pixel was before the turn
    mask = np.hypot(x, y * 1.15) < radius
    waves = [np.sin(x / 5.0 + 0.7) * np.cos(y / 7.0), np.cos(x / 6.0 - y / 9.0), np.sin(y / 4.5 + x / 11.0)]
    image = np.stack([1.0 + 0.4 * wave for wave in waves], axis=-1) * np.exp(-((x - 9) ** 2) / 900)[..., None]
    return Capture(image, mask, LightRig(lights.directions @ rotation(turn).T, lights.mixing))


def network(path: Path, passes: int = 1) -> Path:
    """Random weights, pooled once; it sees everything that the networks on the shelf see."""
    weights = random_weights(7, a=(8, 7, 5, 5), l=(8, 9, 1, 1), b=(8, 8, 3, 3), c=(3, 8, 3, 3), d=(1, 8, 1, 1))
    weights |= {"s": np.float32([1, 1, 2, 2]), "tilted": np.float32([[[[0]], [[0]], [[4]]]])}
    nodes = [
        conv("pixels", "p", "a", pads=[2] * 4),
        conv("lights", "q", "l"),
        helper.make_node("Add", ["p", "q"], ["h"]),
        helper.make_node("Tanh", ["h"], ["t"]),
        helper.make_node("AveragePool", ["t"], ["u"], kernel_shape=[2, 2], strides=[2, 2]),
        conv("u", "v", "b", pads=[1] * 4),
        helper.make_node("Resize", ["v", "", "s"], ["w"], mode="linear", coordinate_transformation_mode="half_pixel"),
        helper.make_node("Add", ["t", "w"], ["r"]),
        conv("r", "n", "c", pads=[1] * 4),
        helper.make_node("Add", ["n", "tilted"], ["normals"]),
        conv("r", "e", "d"),
        helper.make_node("Sigmoid", ["e"], ["confidence"]),
    ]
    seen = {"pixels": ("grey_world", "initial_normals_grey_world", "mask"), "lights": ("lights",)}
    return write_model(
        path,
        nodes,
        weights,
        card(inputs=seen, halo=8, multiple=2, frame="canonical", passes=passes),
        inputs={"pixels": ("n", 7, "h", "w"), "lights": ("n", 9, 1, 1)},
        outputs={"normals": ("n", 3, "h", "w"), "confidence": ("n", 1, "h", "w")},
    )


def turned_by_quarter(normals: NormalMap) -> tuple[np.ndarray, np.ndarray]:
    """The map turned by 90°, pixels and vectors."""
    vectors = np.rot90(normals.vectors)
    return np.stack([-vectors[..., 1], vectors[..., 0], vectors[..., 2]], axis=-1), np.rot90(normals.confidence)


@pytest.mark.parametrize("first_tilt", [90.0, 75.0], ids=["not resampled", "resampled"])
@pytest.mark.parametrize("passes", [1, 3])
def test_a_quarter_turn_turns_the_answer(tmp_path: Path, passes: int, first_tilt: float) -> None:
    model, lights = network(tmp_path / "n.onnx", passes), rig((first_tilt, 210.0, 320.0))
    straight = scene(0, lights)
    # An oblong picture: rows and columns must not be mistaken for each other.
    straight = Capture(straight.image[8:-4], straight.mask[8:-4], lights)
    quarter = rotation(90).round()
    turned = Capture(np.rot90(straight.image), np.rot90(straight.mask), LightRig(lights.directions @ quarter.T, MIXING))
    answer = estimate_normals(turned, model)
    vectors, confidence = turned_by_quarter(estimate_normals(straight, model))
    np.testing.assert_allclose(answer.vectors, vectors, rtol=0, atol=1e-5)
    np.testing.assert_allclose(answer.confidence, confidence, rtol=0, atol=1e-5)
    assert np.ptp(answer.vectors[answer.mask], axis=0).min() > 0.2 and np.ptp(confidence[answer.mask]) > 0.2


def test_in_the_cameras_frame_it_does_not(tmp_path: Path) -> None:
    """The network itself knows nothing of turns; what the tests above see is the frame's doing."""
    model = network(tmp_path / "n.onnx")
    exact = scene(0, rig((90.0, 210.0, 320.0)))
    without_lights = Capture(np.rot90(exact.image), np.rot90(exact.mask), exact.rig)
    vectors, _ = turned_by_quarter(estimate_normals(exact, model))
    assert degrees_between(estimate_normals(without_lights, model).vectors, vectors)[np.rot90(exact.mask)].mean() > 3


@pytest.mark.parametrize("first_tilt", [90.0, 75.0], ids=["not resampled", "resampled"])
def test_tiled_and_untiled_agree(tmp_path: Path, first_tilt: float) -> None:
    model, capture = network(tmp_path / "n.onnx", 3), scene(20, rig((first_tilt, 210.0, 320.0)), size=170, radius=80)
    tiled, untiled = (estimate_normals(capture, model, tile=tile) for tile in (64, 1024))
    np.testing.assert_allclose(tiled.vectors, untiled.vectors, rtol=0, atol=1e-4)
    np.testing.assert_allclose(tiled.confidence, untiled.confidence, rtol=0, atol=1e-4)


@pytest.mark.parametrize("passes", [1, 3])
def test_any_turn_turns_the_answer(tmp_path: Path, passes: int) -> None:
    """Both pictures are drawn by formulas; ours is turned back at places known by geometry, away from the edge."""
    model, lights, turn = network(tmp_path / "n.onnx", passes), rig(), 37.0
    straight, turned = (estimate_normals(scene(angle, lights), model) for angle in (0.0, turn))
    size = straight.mask.shape[0]
    rows, columns = np.mgrid[:size, :size]
    x, y = columns - (size - 1) / 2, (size - 1) / 2 - rows
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    column, row = c * x - s * y + (size - 1) / 2, (size - 1) / 2 - (s * x + c * y)
    inside = np.hypot(x, 1.15 * y) < 30
    row, column = row[inside], column[inside]
    i, j = np.floor(row).astype(int), np.floor(column).astype(int)
    p, q = (row - i)[:, None], (column - j)[:, None]
    v = turned.vectors
    bilinear = (1 - p) * ((1 - q) * v[i, j] + q * v[i, j + 1]) + p * ((1 - q) * v[i + 1, j] + q * v[i + 1, j + 1])
    error = degrees_between(bilinear @ rotation(turn), straight.vectors[inside])
    assert error.mean() < 0.5
    half_a_pixel_off = degrees_between(straight.vectors[:, 1:], straight.vectors[:, :-1])[inside[:, 1:]].mean() / 2
    assert error.mean() < half_a_pixel_off / 4
