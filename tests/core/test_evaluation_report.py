"""The table, the pictures and the page of an evaluation."""

import base64
import re
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from synthetic import diligent_object, listing

from mpsnet_core.learning.evaluation.measure import measure
from mpsnet_core.learning.evaluation.operations import EvaluateDiligent
from mpsnet_core.learning.evaluation.report import HIGHEST_ERROR, TILE_HEIGHT, case_picture, open_report
from mpsnet_core.scene.pictures import GAP, TITLE_HEIGHT, error_picture

pytest.importorskip("scipy")


def test_a_case_is_shown_with_each_model_on_one_scale(tmp_path: Path) -> None:
    diligent_object(tmp_path, "ball", (0.4, 0.3, 0.2))
    test = EvaluateDiligent(folder=tmp_path, lights="1,2,3", protocol="separated").evaluation()
    (results,) = measure(test.cases, ["lambertian"] * 2)
    picture = case_picture(results)
    height = 2 * (TILE_HEIGHT + TITLE_HEIGHT + GAP) + GAP
    assert picture.shape[0] == height and picture.shape[1] > 3 * TILE_HEIGHT + 90
    # The sphere's middle in each column: photo and both models' normals above, truth and errors below.
    middles = [GAP + TILE_HEIGHT // 2 + number * (TILE_HEIGHT + GAP) for number in range(3)]
    top, below = (GAP + TITLE_HEIGHT + TILE_HEIGHT // 2 + row * (TILE_HEIGHT + TITLE_HEIGHT + GAP) for row in (0, 1))
    assert picture[below, middles[0]] == pytest.approx([0.5, 0.5, 1], abs=0.03)
    error = results[0].error[32, 32]
    expected = error_picture(np.full((1, 1), float(error)), np.ones((1, 1), bool), HIGHEST_ERROR)[0, 0]
    assert 10 < error < HIGHEST_ERROR
    for middle in middles[1:]:
        assert picture[top, middle] == pytest.approx(0.5 + 0.5 * results[0].estimate.vectors[32, 32], abs=0.03)
        assert picture[below, middle] == pytest.approx(expected, abs=0.05)


def test_the_page_shows_table_notes_charts_and_pictures(tmp_path: Path) -> None:
    diligent_object(tmp_path / "data", "ball")
    test = EvaluateDiligent(folder=tmp_path / "data", lights="1,2,3", protocol=["white", "separated"]).evaluation()
    with open_report(tmp_path / "report.html") as report:
        for results in measure(test.cases, ["lambertian", "lambertian-grey-world"]):
            report.add(results)
            assert listing(tmp_path) == ["data"]
        report.write("<title>", "a < b", ["absent, skipped: <none>"], ["<svg></svg>"])
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert listing(tmp_path) == ["data", "report.html"]
    assert all(words in page for words in ("&lt;title&gt;", "a &lt; b", "absent, skipped: &lt;none&gt;", "<svg></svg>"))
    assert re.findall("<h2>(.*)</h2>", page) == ["ball, 1-2-3, white", "ball, 1-2-3, separated"]
    pictures = re.findall(r"data:image/png;base64,([^']+)'", page)
    assert len(pictures) == 2
    (tmp_path / "picture.png").write_bytes(base64.b64decode(pictures[1]))
    pixels = oiio.ImageBuf(str(tmp_path / "picture.png")).get_pixels(oiio.FLOAT)
    np.testing.assert_allclose(pixels, case_picture(results), atol=0.5 / 255 + 1e-6)
