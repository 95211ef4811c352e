"""Tables for the terminal and one self-contained HTML page with pictures."""

import base64
import html
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.evaluation.diligent import Result
from mpsnet_core.evaluation.pictures import colour_scale, cropped, error_picture, normals_picture, photo_picture, sheet
from mpsnet_core.files import writable_path, written_whole
from mpsnet_core.images import write_image
from mpsnet_core.normals import NormalMap, angular_error

HIGHEST_ERROR = 45.0


def text_table(rows: Sequence[dict[str, Any]]) -> str:
    """The mean angular errors in degrees, a line for each model, lights and protocol, a column for each object."""
    objects = list(dict.fromkeys(str(row["object"]) for row in rows))
    lines: dict[tuple[str, str, str], dict[str, float]] = {}
    for row in rows:
        lights = ",".join(map(str, row["lights"]))
        key = (str(row["model"]), lights, str(row["protocol"]))
        lines.setdefault(key, {})[str(row["object"])] = row["mae_deg"]
    table = [["model", "lights", "protocol", *objects, "mean"]]
    for key, errors in lines.items():
        known = [errors[name] for name in objects if name in errors]
        cells = [f"{errors[name]:.2f}" if name in errors else "-" for name in objects]
        table.append([*key, *cells, f"{np.mean(known):.2f}"])
    widths = [max(len(line[column]) for line in table) for column in range(len(table[0]))]
    return "\n".join(
        "  ".join(
            cell.ljust(w) if c < 3 else cell.rjust(w) for c, (cell, w) in enumerate(zip(line, widths, strict=True))
        )
        for line in table
    )


def comparison(
    photo: NDArray[np.float32], estimate: NormalMap, truth: NDArray[np.float32], highest: float = HIGHEST_ERROR
) -> list[tuple[str, NDArray[np.float32]]]:
    """Tiles for :func:`mpsnet_core.evaluation.pictures.sheet`: photo, estimate, truth, error and its scale."""
    error = angular_error(estimate.vectors, truth)
    pictures = cropped(
        [
            photo_picture(photo, estimate.mask),
            normals_picture(estimate),
            normals_picture(NormalMap(truth, estimate.mask)),
            error_picture(error, estimate.mask, highest),
        ],
        estimate.mask,
    )
    titles = ["photo", "estimate", "truth", f"error, mean {error[estimate.mask].mean():.2f}°"]
    return [*zip(titles, pictures, strict=True), ("degrees", colour_scale(highest, 320))]


def report_path(path: str | os.PathLike[str]) -> Path:
    """`path` as a Path, or InputError where no report can be put there; asked before long work starts."""
    path = writable_path(path)
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"cannot write {path}: reports are written as .html; change the suffix")
    return path


def html_figure(result: Result) -> str:
    """A result's row of pictures as HTML, its pictures inside."""
    title = f"{result.object}, lights {result.lights}, {result.protocol}, {result.model}: {result.mae_deg:.2f}°"
    picture = sheet(comparison(result.capture.image, result.estimate, result.truth), columns=5)
    return f"<h2>{html.escape(title)}</h2><img alt='{html.escape(title)}' src='{_data_url(picture)}'>"


def write_html_report(
    path: str | os.PathLike[str], rows: Sequence[dict[str, Any]], figures: Sequence[str], notes: Sequence[str]
) -> None:
    """One HTML page: the table of `rows`, then the results' figures. Whole or not at all."""
    path = report_path(path)
    parts = [
        "<!doctype html><html lang='en'><meta charset='utf-8'><title>MPS-Net evaluation</title>",
        "<style>body{background:#222;color:#eee;font:15px sans-serif;margin:2em}pre{font-size:14px}"
        "img{max-width:100%}</style><h1>Mean angular error in degrees</h1>",
        f"<pre>{html.escape(text_table(rows))}</pre>",
        *(f"<p>{html.escape(note)}</p>" for note in notes),
        *figures,
    ]
    with written_whole(path) as unfinished:
        unfinished.write_text("\n".join(parts) + "</html>\n", encoding="utf-8")


def _data_url(picture: NDArray[np.float32]) -> str:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "picture.png"
        write_image(file, picture, bits=8, color_space="sRGB")
        return "data:image/png;base64," + base64.b64encode(file.read_bytes()).decode("ascii")
