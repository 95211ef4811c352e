"""The table, the pictures and the page of an evaluation."""

import base64
import re
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from synthetic import Sphere, diligent_object, listing

from mpsnet_core.evaluation.diligent import evaluate_diligent
from mpsnet_core.evaluation.pictures import (
    BACKGROUND,
    GAP,
    TITLE_HEIGHT,
    colour_scale,
    cropped,
    error_picture,
    normals_picture,
    photo_picture,
    sheet,
)
from mpsnet_core.evaluation.report import html_figure, text_table, write_html_report
from mpsnet_core.normals import NormalMap


def row(name: str, lights: tuple[int, ...], mae: float) -> dict[str, object]:
    return {"object": name, "lights": list(lights), "protocol": "white", "model": "lambertian", "mae_deg": mae}


def test_the_table_has_a_line_for_each_triple_and_a_mean() -> None:
    rows = [row("ball", (48, 1, 96), 6.333), row("cat", (48, 1, 96), 11.001), row("cat", (8, 41, 89), 12.5)]
    assert [line.split() for line in text_table(rows).splitlines()] == [
        ["model", "lights", "protocol", "ball", "cat", "mean"],
        ["lambertian", "48,1,96", "white", "6.33", "11.00", "8.67"],
        ["lambertian", "8,41,89", "white", "-", "12.50", "12.50"],
    ]


# Matplotlib's inferno (Smith and van der Walt 2015) at 0, 1/4, 1/2 and 1.
INFERNO = [[0.0015, 0.0005, 0.0139], [0.3415, 0.0623, 0.4294], [0.7357, 0.2159, 0.3302], [0.9884, 0.9984, 0.6449]]


def test_errors_are_shown_in_inferno_up_to_the_highest() -> None:
    error = np.array([[0, 10, 20, 40, 90.0]])
    picture = error_picture(error, np.ones((1, 5), bool), 40)
    np.testing.assert_allclose(picture[0, :4], INFERNO, atol=1e-3)
    np.testing.assert_array_equal(picture[0, 4], picture[0, 3])
    outside = error_picture(error, np.zeros((1, 5), bool), 40)
    np.testing.assert_array_equal(outside, np.full((1, 5, 3), BACKGROUND, np.float32))


def test_the_scale_runs_like_the_picture() -> None:
    scale = colour_scale(45, 100)
    top_down = error_picture(np.linspace(45, 0, 100)[:, None], np.ones((100, 1), bool), 45)
    assert scale.shape == (100, 90, 3)
    np.testing.assert_allclose(scale[:, 10], top_down[:, 0], atol=1e-5)


def test_normals_and_photos_are_shown_on_a_dark_ground(sphere: Sphere) -> None:
    picture = normals_picture(NormalMap(sphere.normals, sphere.mask))
    assert (picture[~sphere.mask] == np.float32(BACKGROUND)).all()
    assert picture[32, 32] == pytest.approx([0.5, 0.5, 1], abs=0.02)
    photo = photo_picture(sphere.image * 50, sphere.mask)
    assert photo.max() == pytest.approx(1) and 0.5 < photo[sphere.mask].mean() < 0.95


def test_a_sheet_holds_every_tile_whole() -> None:
    tiles = [(name, np.full((20, width, 3), value, np.float32)) for name, width, value in
             [("a", 20, 0.3), ("b", 40, 0.5), ("c", 10, 0.7)]]  # fmt: skip
    picture = sheet(tiles, columns=2, tile_height=40)
    assert picture.shape == (2 * (40 + TITLE_HEIGHT + GAP) + GAP, 40 + 80 + 3 * GAP, 3)
    for value, area in ((0.3, 40 * 40), (0.5, 40 * 80), (0.7, 40 * 20)):
        assert (np.abs(picture - value) < 1e-3).all(axis=-1).sum() == pytest.approx(area, abs=20)


def test_pictures_are_cut_to_the_mask(sphere: Sphere) -> None:
    mask = np.zeros((50, 60), bool)
    mask[20:30, 5:40] = True
    (cut,) = cropped([np.dstack([mask] * 3).astype(np.float32)], mask, margin=8)
    assert cut.shape == (10 + 16, 5 + 35 + 8, 3)
    assert cut.sum() == 3 * mask.sum()


def test_the_page_shows_table_notes_and_pictures(tmp_path: Path) -> None:
    diligent_object(tmp_path / "data", "ball")
    results = list(evaluate_diligent(tmp_path / "data", lights=[(1, 2, 3)], protocols=["white", "separated"]))
    figures = [html_figure(result) for result in results]
    write_html_report(tmp_path / "report.html", [r.row() for r in results], figures, ["absent, skipped: <none>"])
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert listing(tmp_path) == ["data", "report.html"]
    assert "absent, skipped: &lt;none&gt;" in page
    assert all(f"{result.mae_deg:.2f}" in page for result in results)
    pictures = re.findall(r"data:image/png;base64,([^']+)'", page)
    assert len(pictures) == 2
    (tmp_path / "picture.png").write_bytes(base64.b64decode(pictures[0]))
    pixels = oiio.ImageBuf(str(tmp_path / "picture.png")).get_pixels(oiio.FLOAT)
    assert pixels.shape[1] > 4 * 320 and pixels.std() > 0.1
