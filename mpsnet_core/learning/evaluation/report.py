"""The report of an evaluation: a self-contained HTML page with table, charts and images."""

import html
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.io.files import atomic_write
from mpsnet_core.io.html_page import HEAD, data_url, page_path
from mpsnet_core.learning.evaluation.measure import Result
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.pictures import BACKGROUND, colour_scale, contact_sheet, cropped, error_picture, photo_picture

HIGHEST_ERROR = 45.0  # degrees; one scale for all models and cases
TILE_HEIGHT = 176
LONGEST_TITLE = 21  # characters above a tile


@dataclass(frozen=True)
class Report:
    """An HTML page. Its images are collected on disk, not in memory. See :func:`open_report`."""

    path: Path
    """The page's file."""
    figures: TextIO
    """Temporary file that collects the HTML of the images."""

    def add(self, results: Sequence[Result]) -> None:
        """Add the images of one case: photo and true normals, and each model's normals and errors."""
        title = html.escape(results[0].case.title, quote=True)
        picture = data_url(case_picture(results))
        self.figures.write(f"<h2>{title}</h2>\n<img alt='{title}' loading='lazy' src='{picture}'>\n")

    def write(self, title: str, table: str, notes: Sequence[str], charts: Sequence[str]) -> None:
        """Write the page: title, table, notes, SVG charts, and the images of all cases."""
        self.figures.seek(0)
        with atomic_write(self.path) as unfinished, unfinished.open("w", encoding="utf-8") as page:
            page.write(HEAD.format(title=html.escape(title)))
            page.write(f"<pre>{html.escape(table)}</pre>\n")
            page.writelines(f"<p>{html.escape(note)}</p>\n" for note in notes)
            page.writelines(f"{chart}\n" for chart in charts)
            shutil.copyfileobj(self.figures, page, 1 << 20)
            page.write("</html>\n")


@contextmanager
def open_report(path: str | os.PathLike[str]) -> Iterator[Report]:
    """A report to add cases to. :meth:`Report.write` writes it to `path` atomically.

    Raises InputError if no report can be written there.
    """
    path = page_path(path)
    with tempfile.TemporaryFile("w+", encoding="utf-8") as figures:
        yield Report(path, figures)


def case_picture(results: Sequence[Result]) -> NDArray[np.float32]:
    """(H, W, 3) display values: photo and each model's normals; below, true normals, errors and the colour scale."""
    case = results[0].case
    pictures = [
        photo_picture(case.capture.image, case.capture.mask),
        *(result.estimate.picture() for result in results),
        NormalMap(case.truth, case.scored).picture(),
        *(error_picture(result.error.astype(np.float64), case.scored, HIGHEST_ERROR) for result in results),
    ]
    tiles = [_at_least_square(picture) for picture in cropped(pictures, case.capture.mask)]
    count = len(results)
    names = [result.model[-LONGEST_TITLE:] for result in results]
    errors = [f"{result.mae_deg:.2f}°" for result in results]
    empty = np.full((TILE_HEIGHT, 1, 3), BACKGROUND, np.float32)
    return contact_sheet(
        [
            *zip(["photo", *names], tiles[: count + 1], strict=True),
            ("", empty),
            *zip(["truth", *errors], tiles[count + 1 :], strict=True),
            ("degrees", colour_scale(HIGHEST_ERROR, TILE_HEIGHT)),
        ],
        count + 2,
        TILE_HEIGHT,
    )


def _at_least_square(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """The image padded at its sides, to make room for its title."""
    missing = max(picture.shape[0] - picture.shape[1], 0)
    return np.pad(picture, [(0, 0), (missing // 2, missing - missing // 2), (0, 0)], constant_values=BACKGROUND)
