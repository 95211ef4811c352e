"""The test on samples, and how well the default network knows its own errors on them."""

import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from bad_input import gets_one_clear_sentence
from sphere_sample import RED, sphere_sample
from synthetic import degrees_between

from mpsnet_core.arrays.statistics import rank_correlation
from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.estimate.estimator import estimate_normals, lambertian_normals
from mpsnet_core.learning.evaluation.measure import measure
from mpsnet_core.learning.evaluation.operations import EvaluateSamples
from mpsnet_core.learning.evaluation.pixel_kinds import PIXEL_KINDS, share
from mpsnet_core.synthesis.job import SampleJob, sample_path
from mpsnet_core.synthesis.make import make_sample
from mpsnet_core.synthesis.sample import write_sample


@pytest.fixture
def samples(tmp_path: Path) -> Path:
    folder = tmp_path / "samples"
    folder.mkdir()
    for number in range(4):
        write_sample(sample_path(folder, number), sphere_sample(48, right=RED, number=number))
    return folder


def test_samples_are_photographed_the_same_every_time(samples: Path) -> None:
    first, again = (list(measure(EvaluateSamples(folder=samples).evaluation().cases, ["lambertian"])) for _ in range(2))
    assert len(first) == 4
    for (one,), (other,) in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.case.capture.image, other.case.capture.image)
        error = degrees_between(lambertian_normals(one.case.capture).vectors, one.case.truth)[one.case.scored]
        assert one.mae_deg == pytest.approx(error.mean(), abs=1e-3)
        assert one.row().labels["shape"] == "blobs"
    assert len({result.case.capture.image.sum() for (result,) in first}) == 4


def test_a_white_photo_stands_beside_the_same_photo(samples: Path) -> None:
    test = EvaluateSamples(folder=samples, count=1, white=True).evaluation()
    (alone,), (beside,) = measure(test.cases, ["lambertian"])
    assert (alone.row().labels["photos"], beside.row().labels["photos"]) == (1, 2)
    assert alone.case.capture.white is None and beside.case.capture.white is not None
    np.testing.assert_array_equal(alone.case.truth, beside.case.truth)
    # The same camera, lights and exposure; the noise alone is drawn anew.
    inside = alone.case.scored
    one, two = (case.capture.image[inside].mean(axis=0) for case in (alone.case, beside.case))
    assert two == pytest.approx(one, rel=0.05)


def test_the_command_line_counts_samples_and_what_was_left_out(samples: Path, tmp_path: Path, mpsnet) -> None:
    (samples / "sample_000001.exr").write_bytes((samples / "sample_000001.exr").read_bytes()[:3000])
    out, page = tmp_path / "rows.json", tmp_path / "report.html"
    done = mpsnet("evaluate", "samples", samples, "--count", "2", "--model", "all", "--json", out, "-o", page)
    assert done.returncode == 0, done.stderr
    data = json.loads(out.read_text())
    names = {row["model"] for row in data["rows"]}
    assert {"lambertian", "lambertian-grey-world"} <= names
    assert len(data["rows"]) == 2 * len(names)
    assert "sample_000001" in data["skipped"][0] and "sample_000001" in done.stdout
    assert {row["object"] for row in data["rows"]} == {"sample_000000", "sample_000002"}
    assert page.read_text(encoding="utf-8").count("<img") == 2


def test_errors_by_kind_of_pixel_add_up(samples: Path) -> None:
    test = EvaluateSamples(folder=samples, count=2, by=tuple(PIXEL_KINDS)).evaluation()
    for results in measure(test.cases, ["lambertian"]):
        (row,), case = test.rows(results), results[0].case
        for kind in PIXEL_KINDS:
            parts = [name.removesuffix("_share") for name in row.further if name.startswith(f"{kind}: ")]
            summed = sum(row.further[share(part)] * row.errors.get(f"{part}_deg", 0.0) for part in parts)
            assert summed == pytest.approx(row.mae_deg, abs=0.02), kind
        # A sphere is convex and open to the sky all over.
        assert row.further[share("curvature: convex")] > 0.9 and row.further[share("sky: open")] > 0.9
        slant = np.degrees(np.arccos(case.truth[case.scored][:, 2]))
        assert row.further[share("slant: to 30°")] == pytest.approx((slant < 30).mean(), abs=1e-3)


def test_confidence_ranks_the_errors(tmp_path: Path) -> None:
    """On photographs with noise, crosstalk and errors of the rig, pooled, as a bake would weigh them."""
    job = SampleJob("synthesis", count=12, seed=20_261_120, size=96)
    for number in range(job.count):
        make_sample(job, number, tmp_path / f"sample_{number:06d}.exr")
    expected, errors = [], []
    for case in (make() for make in EvaluateSamples(folder=tmp_path).evaluation().cases):
        normals = estimate_normals(case.capture)
        expected.append(90 * (1 - normals.confidence[case.scored]))
        errors.append(angular_error(normals.vectors, case.truth)[case.scored])
    expected_all, errors_all = np.concatenate(expected), np.concatenate(errors)
    rank = rank_correlation(expected_all, errors_all)
    assert rank is not None and rank > 0.4
    tenths = [errors_all[part].mean() for part in np.array_split(np.argsort(expected_all), 10)]
    assert (np.diff(tenths) > 0).all()
    assert abs(expected_all.mean() - errors_all.mean()) < 0.25 * errors_all.mean()


test_bad_samples_get_one_clear_sentence = gets_one_clear_sentence(
    [
        ("no such samples to measure on", lambda b: b.run("evaluate", "samples", b / "no"), "no does not exist"),
        (lambda b: b.run("evaluate", "samples", b.folder), "there is no whole sample in…mpsnet synthesize"),
    ]
)
