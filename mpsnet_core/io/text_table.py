"""Plain-text tables, for the terminal and for reports."""

from collections.abc import Iterable, Sequence
from itertools import chain

import numpy as np


def text_table(header: Sequence[str], lines: Sequence[Sequence[str]], left: int) -> str:
    """The lines below their header; the first `left` columns are left-aligned, the others right-aligned.

    >>> print(text_table(["model", "error"], [["lambertian", "9.50"], ["dense", "12.25"]], 1))
    model       error
    lambertian   9.50
    dense       12.25
    """
    table = [header, *lines]
    widths = [max(len(line[column]) for line in table) for column in range(len(header))]
    sides = [str.ljust] * left + [str.rjust] * (len(header) - left)
    rows = ([put(cell, width) for put, cell, width in zip(sides, line, widths, strict=True)] for line in table)
    return "\n".join("  ".join(row).rstrip() for row in rows)


def table_of_means(header: Sequence[str], values: Iterable[tuple[tuple[str, ...], str, float | None]]) -> str:
    """A table of means. Each value comes with its line (a cell for each of `header`) and its column.

    The last column is the mean over all values of the line. None is ignored.
    """
    columns: dict[str, None] = {}
    lines: dict[tuple[str, ...], dict[str, list[float]]] = {}
    for line, column, value in values:
        columns[column] = None
        cells = lines.setdefault(line, {})
        if value is not None:
            cells.setdefault(column, []).append(value)
    rows = [
        [*line, *(mean_cell(cells.get(name, [])) for name in columns), mean_cell([*chain(*cells.values())])]
        for line, cells in lines.items()
    ]
    return text_table([*header, *columns, "mean"], rows, len(header))


def mean_cell(values: Sequence[float]) -> str:
    """The mean of values with two decimals, "-" if there are none."""
    return f"{np.mean(values):.2f}" if len(values) else "-"
