"""DiLiGenT: how captures are multiplexed, and the published numbers on its photographs."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Mpsnet
from synthetic import degrees_between, diligent_object, mat_file

from mpsnet_core.evaluation.diligent import evaluate_diligent, read_diligent, read_truth
from mpsnet_core.evaluation.matfile import read_mat_array

COLOURED = (0.3, 0.2, 0.1)
# Each capture channel's colour: the photographs' three channels weighted, of a surface that is COLOURED.
CHANNELS = {
    "separated": [0.3, 0.2, 0.1],
    "published": [
        0.3 * 5 / 9 + 0.2 * 2 / 9 + 0.1 * 2 / 9,
        0.3 * 2 / 9 + 0.2 * 5 / 9 + 0.1 * 2 / 9,
        0.3 * 2 / 9 + 0.2 * 2 / 9 + 0.1 * 5 / 9,
    ],
    "white": [0.2, 0.2, 0.2],
}


@pytest.mark.parametrize("protocol", CHANNELS)
def test_a_capture_is_multiplexed_by_its_protocol(tmp_path: Path, protocol: str) -> None:
    sphere = diligent_object(tmp_path, "ball", COLOURED)
    capture = read_diligent(tmp_path / "ballPNG", (2, 3, 1), protocol)
    np.testing.assert_allclose(capture.rig.directions, sphere.rig.directions[[1, 2, 0]], atol=1e-9)
    np.testing.assert_array_equal(capture.mask, sphere.mask)
    shading = np.maximum(np.stack([sphere.normals @ sphere.rig.directions[k] for k in (1, 2, 0)], axis=-1), 0)
    np.testing.assert_allclose(capture.image, shading * CHANNELS[protocol], atol=3e-5)


def test_a_grey_sphere_is_exact_and_a_coloured_one_only_when_white(tmp_path: Path) -> None:
    sphere = diligent_object(tmp_path, "ball")
    diligent_object(tmp_path, "cow", COLOURED)
    skipped: list[str] = []
    results = {
        (r.object, r.protocol): r
        for r in evaluate_diligent(tmp_path, lights=[(1, 2, 3)], models=["lambertian"], skipped=skipped)
    }
    assert len(results) == 6
    for result in results.values():
        error = degrees_between(result.estimate.vectors, sphere.normals)[sphere.mask]
        assert result.mae_deg == pytest.approx(error.mean(), abs=1e-4)
        assert result.median_deg == pytest.approx(np.median(error), abs=1e-4)
    lit = {key: degrees_between(r.estimate.vectors, sphere.normals)[sphere.lit].mean() for key, r in results.items()}
    assert max(lit["ball", protocol] for protocol in CHANNELS) < 0.02
    assert lit["cow", "white"] < 0.02 < 5 < lit["cow", "published"] < lit["cow", "separated"]
    assert skipped == ["absent, skipped: bear, buddha, cat, goblet, harvest, pot1, pot2, reading"]


PUBLISHED = {
    "ball": {"separated": 17.26, "published": 9.33, "white": 6.33},
    "cat": {"separated": 12.88, "published": 11.33, "white": 11.01},
}


def test_the_baseline_on_the_photographs(diligent: Path, tmp_path: Path, mpsnet: Mpsnet) -> None:
    out = tmp_path / "rows.json"
    done = mpsnet("evaluate", "diligent", diligent, "--model", "lambertian", "--lights", "48,1,96", "--json", out)
    assert (done.returncode, done.stderr) == (0, "")
    data = json.loads(out.read_text())
    found: dict[str, dict[str, float]] = {name: {} for name in PUBLISHED}
    for row in data["rows"]:
        assert (row["model"], row["lights"]) == ("lambertian", [48, 1, 96])
        found[row["object"]][row["protocol"]] = row["mae_deg"]
    for name, errors in PUBLISHED.items():
        assert found[name] == pytest.approx(errors, abs=0.05)
    for absent in ("bear", "buddha", "cow", "goblet", "harvest", "pot1", "pot2", "reading"):
        assert absent in data["skipped"][0] and absent in done.stdout
    assert "9.33" in done.stdout and "11.33" in done.stdout


def test_true_normals_are_in_camera_space(diligent: Path) -> None:
    """DiLiGenT's ball: its right side looks right, its top up, its middle at the camera."""
    truth = read_truth(diligent / "ballPNG")
    assert truth.shape == (512, 612, 3)
    inside = np.linalg.norm(read_mat_array(diligent / "ballPNG" / "Normal_gt.mat", "Normal_gt"), axis=-1) > 0.5
    rows, columns = np.nonzero(inside)
    right, top = np.argmax(columns), np.argmin(rows)
    assert truth[rows[right], columns[right], 0] > 0.9
    assert truth[rows[top], columns[top], 1] > 0.9
    assert truth[round(rows.mean()), round(columns.mean())] == pytest.approx([0, 0, 1], abs=0.05)


@pytest.mark.parametrize("compressed", [False, True])
def test_an_array_of_a_matlab_file_is_found_by_name(tmp_path: Path, compressed: bool) -> None:
    arrays = {"first": np.arange(6.0).reshape(2, 3), "Normal_gt": np.random.default_rng(0).random((3, 4, 3))}
    path = mat_file(tmp_path / "a.mat", compressed, **arrays)
    for name, values in arrays.items():
        np.testing.assert_array_equal(read_mat_array(path, name), values)
