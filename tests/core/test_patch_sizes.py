"""Table 1 in small: ten tiny networks, trained and measured, stopped and gone on with."""

from pathlib import Path

import pytest

pytest.importorskip("torch")

from mpsnet_core.errors import Cancelled
from mpsnet_core.learning.evaluation.operations import EvaluatePatchSizes
from mpsnet_core.learning.evaluation.published import TABLE_1
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.make import make_sample

pytestmark = pytest.mark.long


def test_a_stopped_evaluation_goes_on(tmp_path: Path) -> None:
    samples = tmp_path / "samples"
    samples.mkdir()
    for number in range(2):
        make_sample(SampleJob("synthesis", 2, shapes=("blobs",), size=32), number, samples / f"sample_{number:06d}.exr")
    runs, report = tmp_path / "runs", tmp_path / "report.html"
    test = EvaluatePatchSizes(
        samples=samples, validation=samples, runs=runs, width=0.06, steps=2, patches=90, output=report
    )

    def stop(fraction: float, message: str) -> None:
        if len(list(runs.iterdir())) == 4:
            raise Cancelled

    with pytest.raises(Cancelled):
        test.run(stop)
    done = {path: path.read_bytes() for path in runs.iterdir() if path.is_file()}
    assert 3 <= len(done) < 10
    answer = test.run()
    rows = {(row["input"], row["patch"]): row for row in answer.rows}
    assert set(rows) == {(words, side) for words, errors in TABLE_1.items() for side in errors}
    assert all(0 < row["mae_deg"] < row["highest_deg"] <= 180 for row in rows.values())
    assert all(row["patches"] == 90 for row in rows.values())
    assert "<svg" in report.read_text(encoding="utf-8")
