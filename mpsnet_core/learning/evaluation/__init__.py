"""Evaluation of models: data sets with known normals, tables and reports."""

from dataclasses import dataclass
from typing import Any

from mpsnet_core.operation import Result


@dataclass(frozen=True)
class Measured(Result):
    """The result of a test, as plain data."""

    rows: list[dict[str, Any]]
    """Measurements."""
    published: list[dict[str, Any]]
    """Results of the paper."""
    confidence: list[dict[str, Any]] | None = None
    """How well the models' confidence predicts their error."""
    skipped: list[str] | None = None
    """Sentences on missing data."""
