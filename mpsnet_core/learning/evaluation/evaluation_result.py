"""The result of every test."""

from dataclasses import dataclass
from typing import Any

from mpsnet_core.operation import Result


@dataclass(frozen=True)
class Measured(Result):
    """What a test came to, as plain data.

    rows: what was measured. published: what the paper found. confidence: how well the models' confidence predicts their
    error. skipped: what was to be measured and is not there.
    """

    rows: list[dict[str, Any]]
    published: list[dict[str, Any]]
    confidence: list[dict[str, Any]] | None = None
    skipped: list[str] | None = None
