"""The report of an evaluation: a self-contained HTML page with table, charts and images."""

import html
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from mpsnet_core.arrays.types import F32
from mpsnet_core.io.files import atomic_write
from mpsnet_core.io.html_page import HEAD, data_url, page_path
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.learning.evaluation.measure import Result
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.pictures import BACKGROUND, colour_scale, contact_sheet, cropped, error_picture, photo_picture

# --- line charts as SVG, for HTML pages -------------------------------------------------------------------------------


WIDTH, HEIGHT = 900, 380
LEFT, RIGHT, TOP, BOTTOM = 60, 210, 34, 46
# Okabe and Ito's palette, which is safe for colour-blind readers, adapted to a dark background.
COLOURS = ("#e69f00", "#56b4e9", "#009e73", "#f0e442", "#d55e00", "#cc79a7", "#b3b3b3", "#3d8bd4")


class Curve(NamedTuple):
    """A line of a chart."""

    name: str
    """Name in the legend."""
    x: Sequence[float]
    """x of its points."""
    y: Sequence[float]
    """y of its points."""
    words: Sequence[str] = ()
    """Tooltips of its points, if any."""


def line_chart(title: str, curves: Sequence[Curve], x_label: str, y_label: str, diagonal: bool = False) -> str:
    """The curves as an SVG element, with both axes from 0. diagonal: also draw the line y = x."""
    x_ticks, y_ticks = (_ticks(max(map(max, axis))) for axis in ([c.x for c in curves], [c.y for c in curves]))
    if diagonal:
        x_ticks = y_ticks = max(x_ticks, y_ticks, key=lambda ticks: ticks[-1])

    def place(x: float, y: float) -> tuple[float, float]:
        across = LEFT + (WIDTH - LEFT - RIGHT) * x / x_ticks[-1]
        return round(across, 1), round(HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * y / y_ticks[-1], 1)

    (left, bottom), (right, top) = place(0, 0), place(x_ticks[-1], y_ticks[-1])
    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH} {HEIGHT}' width='{WIDTH}' height='{HEIGHT}' "
        "font-family='sans-serif' font-size='13' fill='#eee'>",
        f"<rect width='{WIDTH}' height='{HEIGHT}' fill='#222'/>",
        _text(left, 20, title, size=15),
        _text((left + right) / 2, HEIGHT - 10, x_label, "middle"),
        f"<text transform='translate(16 {(top + bottom) / 2}) rotate(-90)' text-anchor='middle'>"
        f"{html.escape(y_label)}</text>",
    ]
    for tick in y_ticks:
        _, y = place(0, tick)
        parts += [_line((left, y), (right, y), "#444"), _text(left - 6, y + 4, f"{tick:g}", "end")]
    for tick in x_ticks:
        x, _ = place(tick, 0)
        parts += [_line((x, bottom), (x, bottom + 4), "#888"), _text(x, bottom + 18, f"{tick:g}", "middle")]
    if diagonal:
        parts.append(_line((left, bottom), (right, top), "#888", dashed=True))
    for number, curve in enumerate(curves):
        colour = COLOURS[number % len(COLOURS)]
        points = [place(x, y) for x, y in zip(curve.x, curve.y, strict=True)]
        path = " ".join(f"{x},{y}" for x, y in points)
        parts.append(f"<polyline points='{path}' fill='none' stroke='{colour}' stroke-width='2'/>")
        parts += [
            f"<circle cx='{x}' cy='{y}' r='2.5' fill='{colour}'><title>{html.escape(words)}</title></circle>"
            for (x, y), words in zip(points, curve.words, strict=False)
        ]
        height = TOP + 12 + 20 * number
        parts.append(f"<rect x='{right + 16}' y='{height - 9}' width='18' height='4' fill='{colour}'/>")
        parts.append(_text(right + 40, height, curve.name))
    return "\n".join([*parts, "</svg>"])


def _ticks(highest: float) -> list[float]:
    """Four to nine round numbers, from 0 to at least `highest`."""
    highest = max(highest, 1e-9)
    step = 10.0 ** np.floor(np.log10(highest / 4))
    step *= next(factor for factor in (1, 2, 5, 10) if highest / (step * factor) <= 8)
    return [float(step * number) for number in range(int(np.ceil(highest / step - 1e-9)) + 1)]


def _text(x: float, y: float, words: str, anchor: str = "start", size: int = 13) -> str:
    return f"<text x='{x}' y='{y}' text-anchor='{anchor}' font-size='{size}'>{html.escape(words)}</text>"


def _line(start: tuple[float, float], end: tuple[float, float], colour: str, dashed: bool = False) -> str:
    dashes = " stroke-dasharray='5 4'" if dashed else ""
    return f"<line x1='{start[0]}' y1='{start[1]}' x2='{end[0]}' y2='{end[1]}' stroke='{colour}'{dashes}/>"


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
def open_report(path: AnyPath) -> Iterator[Report]:
    """A report to add cases to. :meth:`Report.write` writes it to `path` atomically.

    Raises InputError if no report can be written there.
    """
    path = page_path(path)
    with tempfile.TemporaryFile("w+", encoding="utf-8") as figures:
        yield Report(path, figures)


def case_picture(results: Sequence[Result]) -> F32:
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
    titles = ["photo", *(result.model[-LONGEST_TITLE:] for result in results)]
    titles += ["truth", *(f"{result.mae_deg:.2f}°" for result in results)]
    titled = list(zip(titles, tiles, strict=True))
    titled.insert(count + 1, ("", np.full((TILE_HEIGHT, 1, 3), BACKGROUND, np.float32)))
    titled.append(("degrees", colour_scale(HIGHEST_ERROR, TILE_HEIGHT)))
    return contact_sheet(titled, count + 2, TILE_HEIGHT)


def _at_least_square(picture: F32) -> F32:
    """The image padded at its sides, to make room for its title."""
    missing = max(picture.shape[0] - picture.shape[1], 0)
    return np.pad(picture, [(0, 0), (missing // 2, missing - missing // 2), (0, 0)], constant_values=BACKGROUND)
