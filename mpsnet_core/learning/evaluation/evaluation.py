"""Tests of models: the interface of a test, and how tests are run and reported."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from typing import Any

from mpsnet_core.estimate.registry import BASELINES
from mpsnet_core.io.files import write_json, write_transaction
from mpsnet_core.io.text_table import table_of_means, text_table
from mpsnet_core.learning.evaluation import Measured
from mpsnet_core.learning.evaluation.measure import (
    GROUPS,
    Calibration,
    Case,
    ConfidencePool,
    Result,
    Row,
    chosen_models,
    measure,
)
from mpsnet_core.learning.evaluation.report import Curve, line_chart, open_report
from mpsnet_core.progress import Progress


class Evaluation(ABC):
    """A test: its photos, and the report of its results. Its constructor takes the operation, of
    :mod:`mpsnet_core.learning.evaluation.operations`.

    title: of the report. cases: functions that each make one photo. always: models that are always measured.
    """

    title: str
    cases: Sequence[Callable[[], Case]]
    always: tuple[str, ...] = ()

    def rows(self, results: Sequence[Result]) -> list[Row]:
        """Rows for the results of one case, one per model. Called for the cases in their order."""
        return [result.row() for result in results]

    @abstractmethod
    def table(self, rows: Sequence[Row]) -> str:
        """All rows as text."""

    def published(self, rows: Sequence[Row]) -> list[dict[str, Any]]:
        """The paper's results as ``--json`` writes them, to compare with these rows."""
        return []

    def charts(self, rows: Sequence[Row]) -> list[str]:
        """SVG elements for the report."""
        return []

    def notes(self, rows: Sequence[Row]) -> list[str]:
        """Notes below the table, one sentence each."""
        return []

    def skipped(self) -> list[str]:
        """Sentences on data that is missing, called at the end."""
        return []


def evaluate(
    evaluation: Evaluation, models: Sequence[str], *, json: str | None, report: str | None, progress: Progress
) -> Measured:
    """Run a test.

    models: names or files, "all" for every model that `mpsnet models` lists. json: file for all results but the text.
    report: HTML file.

    Raises InputError if a model, a case's data or an output path is unusable.
    """
    rows: list[Row] = []
    pool = ConfidencePool()
    with open_report(report) if report else nullcontext() as page:
        # One case at a time: all photos, estimates and true normals together take gigabytes.
        for results in measure(evaluation.cases, chosen_models([*evaluation.always, *models]), progress):
            rows += evaluation.rows(results)
            for result in results:
                scored = result.case.scored
                name = _shown_name(result.model, result.case.labels)
                confidence, error = result.estimate.confidence[scored], result.error[scored]
                pool.add(name, confidence, error, predicts_error=result.model not in BASELINES)
            if page:
                page.add(results)
        calibrations = pool.calibration()
        named = [row.labelled(model=_shown_name(row.labels["model"], row.labels)) for row in rows]
        errors = "mean angular error in degrees\n" + evaluation.table(named)
        table = "\n\n".join([errors, *_confidence_table(calibrations)])
        skipped = evaluation.skipped()
        notes = [*evaluation.notes(rows), *skipped]
        measured = Measured(
            rows=[row.to_json() for row in rows],
            published=evaluation.published(rows),
            confidence=[calibration.to_json() for calibration in calibrations],
            skipped=skipped,
            text="\n".join([table, *notes]),
        )
        with write_transaction():
            if json:
                write_json(json, measured.metrics())
            if page:
                charts = [*evaluation.charts(rows), *_calibration_chart(calibrations)]
                page.write(evaluation.title, table, notes, charts)
    return measured


def table_of_errors(rows: Sequence[Row], lines: Sequence[str], column: str, key: str = "mae_deg") -> str:
    """Means of one metric: a line for each combination of the labels `lines`, a column for each value of `column`.

    See :func:`mpsnet_core.io.text_table.table_of_means`.
    """
    return table_of_means(lines, [(row.line(*lines), str(row.labels[column]), row.figure(key)) for row in rows])


def table_of_measures(rows: Sequence[Row], lines: Sequence[str], measures: Mapping[str, str], column: str) -> str:
    """Means of several metrics, a line for each; see :func:`table_of_errors`. measures: keys of the metrics by their
    names in the table."""
    cells = [
        ((*row.line(*lines), name), str(row.labels[column]), row.figure(key))
        for row in rows
        for name, key in measures.items()
    ]
    return table_of_means([*lines, "measure"], cells)


def _shown_name(model: str, labels: Mapping[str, Any]) -> str:
    """A model's name in tables, with the white photo if there is one."""
    return f"{model} + white photo" if labels.get("photos", 1) > 1 else model


def _confidence_table(confidence: Sequence[Calibration]) -> list[str]:
    if not confidence:
        return []
    header = ["model", "rank correlation", "", *(str(number + 1) for number in range(GROUPS))]
    lines = [line for calibration in confidence for line in calibration.lines()]
    return ["confidence against error: tenths of the pixels, the most trusted first\n" + text_table(header, lines, 3)]


def _calibration_chart(confidence: Sequence[Calibration]) -> list[str]:
    curves = [Curve(one.model, one.expected_deg, one.error_deg) for one in confidence if one.expected_deg]
    if not curves:
        return []
    title = "Calibration: tenths of the pixels by confidence"
    return [line_chart(title, curves, "expected error in degrees", "mean error in degrees", diagonal=True)]
