"""The result of a test."""

from dataclasses import dataclass
from typing import Any

from mpsnet_core.operation import Result


@dataclass(frozen=True)
class Measured(Result):
    """The result of a test, as plain data.

    rows: measurements. published: results of the paper. confidence: how well the models' confidence predicts their
    error. skipped: sentences on missing data.
    """

    rows: list[dict[str, Any]]
    published: list[dict[str, Any]]
    confidence: list[dict[str, Any]] | None = None
    skipped: list[str] | None = None
