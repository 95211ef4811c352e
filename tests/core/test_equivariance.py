"""Turning the whole scene, photo and lights, turns the answer of a network that sees it in the canonical frame.

Exactly so where the object's box is a whole number of the network's grains on every scale: what is filled up, is filled
up at the bottom and at the right of the camera's picture.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from networks import sees_all
from synthetic import degrees_between

from mpsnet_core import Capture, NormalMap, estimate_normals
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.scene.rig import LightRig, direction_from_angles

MIXING = np.array([[0.9, 0.08, 0.02], [0.1, 0.85, 0.1], [0.02, 0.15, 0.8]])
QUARTER = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
MIRROR = np.diag([-1.0, 1, 1])
# A pyramid begins at a quarter of this size, 66 x 68 pixels, which is a whole number of the network's grains of 2.
BOX = 264, 272


def scene(first_tilt: float = 75.0) -> Capture:
    """A wavy ellipse with a hole under white light and under three, away from the middle of an oblong picture."""
    y, x = np.mgrid[: BOX[0] + 12, : BOX[1] + 21]
    y, x = (BOX[0] - 1) / 2 + 5 - y, x - (BOX[1] - 1) / 2 - 4
    mask = (2 * y / BOX[0]) ** 2 + (2 * x / BOX[1]) ** 2 < 1
    assert (mask.any(axis=1).sum(), mask.any(axis=0).sum()) == BOX
    mask &= np.hypot(x - 30, y + 20) > 15
    waves = [np.sin(x / 15.0 + 0.7) * np.cos(y / 21.0), np.cos(x / 18.0 - y / 27.0), np.sin(y / 13.5 + x / 33.0)]
    image = np.stack([1.0 + 0.4 * wave for wave in waves], axis=-1) * np.exp(-((x - 27) ** 2) / 8100)[..., None]
    white = np.stack([1.0 + 0.3 * np.sin(x / number + y / 40) for number in (17, 23, 29)], axis=-1)
    rig = LightRig(direction_from_angles([25, 35, 45], [first_tilt, 210.0, 320.0]), MIXING)
    return Capture(image, mask, rig, white=white, white_clipped=white > 1.28)


def moved(capture: Capture, move: Any, matrix: np.ndarray) -> Capture:
    """The capture with its pixels moved, and its lights' directions by `matrix`."""
    pictures = {name: move(getattr(capture, name)) for name in ("image", "mask", "white", "white_clipped")}
    return replace(capture, **pictures, rig=LightRig(capture.rig.directions @ matrix.T, capture.rig.mixing))


def check_that_the_answer_moves_too(model: Path, capture: Capture, passes: int, move: Any, matrix: np.ndarray) -> None:
    network = OnnxModel(model, passes=passes)
    answer, before = network(moved(capture, move, matrix)), network(capture)
    np.testing.assert_allclose(answer.vectors, move(before.vectors) @ matrix.T, rtol=0, atol=1e-4)
    np.testing.assert_allclose(answer.confidence, move(before.confidence), rtol=0, atol=1e-4)
    assert np.ptp(answer.vectors[answer.mask, :2], axis=0).min() > 0.2 and np.ptp(answer.confidence[answer.mask]) > 0.05


@pytest.mark.parametrize("kind", ["dense", "pyramid"])
@pytest.mark.parametrize(("passes", "first_tilt"), [(1, 90.0), (1, 75.0), (3, 75.0)])
def test_a_quarter_turn_turns_the_answer(tmp_path: Path, kind: str, passes: int, first_tilt: float) -> None:
    check_that_the_answer_moves_too(
        sees_all(tmp_path / "n.onnx", kind=kind, magnified=2.0 if kind == "pyramid" else 1.0),
        scene(first_tilt),
        passes,
        np.rot90,
        QUARTER,
    )


@pytest.mark.parametrize("kind", ["dense", "pyramid"])
@pytest.mark.parametrize("passes", [2, 6])
def test_a_mirror_image_mirrors_the_answer_where_the_network_sees_both(tmp_path: Path, kind: str, passes: int) -> None:
    check_that_the_answer_moves_too(sees_all(tmp_path / "n.onnx", kind=kind), scene(), passes, np.fliplr, MIRROR)


def in_another_order(capture: Capture, order: list[int]) -> Capture:
    """The same scene and camera, its lights, and with them the camera's channels, counted in another order."""
    rig = LightRig(capture.rig.directions[order], capture.rig.mixing[np.ix_(order, order)])
    clipped = capture.white_clipped[..., order] if capture.white_clipped is not None else None
    assert capture.white is not None
    return replace(
        capture, image=capture.image[..., order], rig=rig, white=capture.white[..., order], white_clipped=clipped
    )


@pytest.mark.parametrize("order", [[1, 2, 0], [1, 0, 2]])
def test_the_order_of_the_lights_does_not_matter(tmp_path: Path, order: list[int]) -> None:
    model, capture = sees_all(tmp_path / "n.onnx"), scene()
    plain, other = estimate_normals(capture, model), estimate_normals(in_another_order(capture, order), model)
    np.testing.assert_allclose(other.vectors, plain.vectors, rtol=0, atol=1e-4)


def test_in_the_cameras_frame_it_does_not_turn(tmp_path: Path) -> None:
    """The network itself knows nothing of turns; what the tests above see is the frame's doing."""
    model, capture = sees_all(tmp_path / "n.onnx", frame="camera"), scene()
    answer: NormalMap = estimate_normals(moved(capture, np.rot90, QUARTER), model)
    expected = np.rot90(estimate_normals(capture, model).vectors) @ QUARTER.T
    assert degrees_between(answer.vectors, expected)[answer.mask].mean() > 3
