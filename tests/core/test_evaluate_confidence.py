"""Confidence against error: ranks, tenths and calibration."""

from pathlib import Path

import numpy as np
import pytest
from networks import card, conv, write_model
from synthetic import degrees_between, diligent_object

from mpsnet_core.arrays.statistics import rank_correlation
from mpsnet_core.learning.evaluation.measure import ConfidencePool, error_by_confidence
from mpsnet_core.learning.evaluation.operations import EvaluateDiligent


def test_ranks_correlate_as_spearman_says() -> None:
    """1 - 6 Σd² / (n (n² - 1)) where no two values are the same."""
    random = np.random.default_rng(0)
    ranks = random.permutation(50)
    d = ranks - np.arange(50)
    expected = 1 - 6 * (d**2).sum() / (50 * (50**2 - 1))
    assert rank_correlation(np.exp(np.arange(50) / 9), ranks**3) == pytest.approx(expected, abs=1e-12)
    assert rank_correlation(np.arange(50), -np.arange(50)) == pytest.approx(-1)


def test_what_is_constant_says_nothing() -> None:
    assert rank_correlation(np.ones(20), np.arange(20)) is None
    assert rank_correlation(np.arange(20), np.ones(20)) is None
    assert rank_correlation(np.arange(5), np.arange(5)) is None


def test_tenths_go_from_the_most_trusted_to_the_least() -> None:
    confidence = np.random.default_rng(1).permutation(200) / 200
    means = error_by_confidence(confidence, 90 * (1 - confidence))
    order = np.sort(90 * (1 - confidence)).reshape(10, 20).mean(axis=1)
    np.testing.assert_allclose(means, order)
    halves = error_by_confidence(np.repeat([1.0, 0.5], 50), np.arange(100.0))
    np.testing.assert_allclose(halves, np.repeat([24.5, 74.5], 5))


def test_photos_are_pooled() -> None:
    """Within each photo confidence says nothing; over both together it does."""
    pool = ConfidencePool()
    for level, error in ((0.9, 5.0), (0.5, 50.0)):
        pool.add("net", np.full(100, level, np.float32), np.full(100, error, np.float32))
    pool.add("certain", np.ones(100, np.float32), np.arange(100, dtype=np.float32))
    falling = np.linspace(1, 0, 100, dtype=np.float32)
    pool.add("baseline", falling, 1 - falling, predicts_error=False)
    row, baseline = pool.calibration()
    assert baseline.expected_deg is None
    assert (row.model, row.rank_correlation) == ("net", pytest.approx(1))
    assert row.error_deg == pytest.approx([5] * 5 + [50] * 5)
    assert row.expected_deg == pytest.approx([9] * 5 + [45] * 5, abs=1e-3)


def test_a_networks_confidence_is_reported(tmp_path: Path) -> None:
    """A network that trusts what faces the camera: on a coloured sphere, rows and page say how far that holds."""
    pytest.importorskip("scipy")
    diligent_object(tmp_path / "pmsData", "ball", (0.4, 0.3, 0.2))
    weights = {"w": np.eye(3, dtype=np.float32)[..., None, None], "z": np.float32([0, 0, 1]).reshape(1, 3, 1, 1)}
    outputs = {"normals": ("n", 3, None, None), "confidence": ("n", 1, None, None)}
    nodes = [conv("x", "normals", "w"), conv("x", "confidence", "z")]
    model = write_model(tmp_path / "faces.onnx", nodes, weights, card(), outputs=outputs)
    test = EvaluateDiligent(
        folder=tmp_path / "pmsData", lights="1,2,3", protocol="separated", model=model, output=tmp_path / "report.html"
    )
    told = test.run()
    (row,), (calibration,) = told.rows, told.confidence
    case = test.evaluation().cases[0]()
    light = np.linalg.solve(case.capture.rig.directions, case.capture.image[case.scored].T).T
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    error = degrees_between(light, case.truth[case.scored])
    order = np.argsort(-light[:, 2], kind="stable")
    assert row["confidence_rank_correlation"] == pytest.approx(rank_correlation(-light[:, 2], error), abs=1e-3)
    tenths = [error[part].mean() for part in np.array_split(order, 10)]
    assert row["confidence_decile_deg"] == pytest.approx(tenths, abs=0.3)
    assert calibration["error_deg"] == pytest.approx(tenths, abs=0.3)
    expected = [90 * (1 - light[part, 2]).mean() for part in np.array_split(order, 10)]
    assert calibration["expected_deg"] == pytest.approx(expected, abs=0.1)
    assert "Calibration" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"{calibration['rank_correlation']:.2f}" in told.text
