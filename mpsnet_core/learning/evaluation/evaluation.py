"""Evaluation: a test of models, and the one way in which every test is run and told."""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from typing import Any

from mpsnet_core.io.files import writable_path, write_json, written_together
from mpsnet_core.io.text_table import text_table
from mpsnet_core.learning.evaluation.charts import Curve, line_chart
from mpsnet_core.learning.evaluation.confidence import GROUPS, ConfidencePool, calibration_lines
from mpsnet_core.learning.evaluation.magnify import magnified_name
from mpsnet_core.learning.evaluation.measure import Case, Result, chosen_models, measure
from mpsnet_core.learning.evaluation.report import open_report
from mpsnet_core.progress import Progress, silent


class Evaluation(ABC):
    """A test: which photos, and how the results are told.

    title: of the page. cases: each makes one photo when it is called. always: models that are measured even where they
    are not asked for.
    """

    title: str
    cases: Sequence[Callable[[], Case]]
    always: tuple[str, ...] = ()

    def rows(self, results: Sequence[Result]) -> list[dict[str, Any]]:
        """One case's results, one for each model, as rows. Called for the cases in their order."""
        return [result.row() for result in results]

    @abstractmethod
    def table(self, rows: Sequence[dict[str, Any]]) -> str:
        """All rows as text."""

    def published(self, rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        """What the paper found, to stand beside these rows."""
        return []

    def charts(self, rows: Sequence[dict[str, Any]]) -> list[str]:
        """SVG elements for the page."""
        return []

    def notes(self, rows: Sequence[dict[str, Any]]) -> list[str]:
        """What a reader of the table must know, a sentence each."""
        return []

    def skipped(self) -> list[str]:
        """What was to be measured and is not there; asked once all is done."""
        return []


def evaluate(
    evaluation: Evaluation,
    models: Sequence[str],
    *,
    json: str | os.PathLike[str] | None = None,
    report: str | os.PathLike[str] | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Run a test and tell it: "rows", "published", "confidence", "skipped" (plain data), and "text" for the terminal.

    models: names or files, "all" for the whole shelf. json: a file for all but the text. report: an HTML page.

    Raises InputError where a model, a case's data or the place for a file is not usable.
    """
    if json:
        writable_path(json)
    rows: list[dict[str, Any]] = []
    pool = ConfidencePool()
    with open_report(report) if report else nullcontext() as page:
        # One case at a time: what results hold (photo, normals, truth) would add up to gigabytes.
        for results in measure(evaluation.cases, chosen_models([*evaluation.always, *models]), progress):
            rows += evaluation.rows(results)
            for result in results:
                scored = result.case.scored
                name = magnified_name(result.model, result.case.magnify)
                pool.add(name, result.estimate.confidence[scored], result.error[scored])
            if page:
                page.add(results)
        confidence = pool.calibration()
        told = {
            "rows": rows,
            "published": evaluation.published(rows),
            "confidence": confidence,
            "skipped": evaluation.skipped(),
        }
        named = [{**row, "model": magnified_name(row["model"], row["magnify"])} for row in rows]
        table = "\n\n".join(
            ["mean angular error in degrees\n" + evaluation.table(named), *_confidence_table(confidence)]
        )
        notes = [*evaluation.notes(rows), *evaluation.skipped()]
        with written_together():
            if json:
                write_json(json, told)
            if page:
                page.write(evaluation.title, table, notes, [*evaluation.charts(rows), *_calibration_chart(confidence)])
    return {**told, "text": "\n".join([table, *notes])}


def _confidence_table(confidence: Sequence[dict[str, Any]]) -> list[str]:
    if not confidence:
        return []
    header = ["model", "rank correlation", "", *(str(number + 1) for number in range(GROUPS))]
    lines = [line for row in confidence for line in calibration_lines(row)]
    return ["confidence against error: tenths of the pixels, the most trusted first\n" + text_table(header, lines, 3)]


def _calibration_chart(confidence: Sequence[dict[str, Any]]) -> list[str]:
    curves = [Curve(row["model"], row["expected_deg"], row["error_deg"]) for row in confidence if "expected_deg" in row]
    if not curves:
        return []
    title = "Calibration: tenths of the pixels by confidence"
    return [line_chart(title, curves, "expected error in degrees", "mean error in degrees", diagonal=True)]
