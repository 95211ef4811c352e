"""Plain-text tables, for the terminal and for reports."""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

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
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column < left else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in table
    )


def table_of_means(rows: Sequence[Mapping[str, Any]], lines: Sequence[str], column: str, value: str = "mae_deg") -> str:
    """Mean of `value` over the rows: a line for each combination of the keys `lines`, a column for each `column`.

    The last column is the mean over all rows of its line. Rows without the value do not count.
    """
    columns = list(dict.fromkeys(str(row[column]) for row in rows))
    grouped: dict[tuple[str, ...], dict[str, list[float]]] = {}
    for row in rows:
        cells = grouped.setdefault(tuple(str(row[key]) for key in lines), {})
        if row.get(value) is not None:
            cells.setdefault(str(row[column]), []).append(row[value])
    return text_table(
        [*lines, *columns, "mean"],
        [
            [*key, *(mean_cell(cells.get(name, [])) for name in columns), mean_cell([*chain(*cells.values())])]
            for key, cells in grouped.items()
        ],
        len(lines),
    )


def mean_cell(values: Sequence[float]) -> str:
    """Their mean with two decimals, "-" where there are none."""
    return f"{np.mean(values):.2f}" if len(values) else "-"
