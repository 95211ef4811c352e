"""The tests on what is synthesised: materials, rendered meshes and colours."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from bad_input import gets_one_clear_sentence
from synthetic import degrees_between, matt_fits

from mpsnet_core.learning.evaluation.colour import CHANGE, COLOURINGS, NEAR, near_colour_edges, surface_colours
from mpsnet_core.learning.evaluation.operations import EvaluateColour, EvaluateMaterials, EvaluateRendered
from mpsnet_core.learning.evaluation.scenes import HELD_OUT_SEED, held_out_blob, published_view
from mpsnet_core.synthesis.random_sampling import generator, new_seed
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.scene_description import Material
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes import build_shape

pytestmark = pytest.mark.accuracy

SIZE = 64


def errors(rows: Sequence[dict[str, Any]], *keys: str) -> dict[Any, float]:
    return {tuple(row[key] for key in keys): row["mae_deg"] for row in rows}


def test_no_job_draws_the_held_out_shapes() -> None:
    assert all(new_seed(generator(seed)) < HELD_OUT_SEED for seed in range(500))


def test_materials_are_reported_apart_by_what_the_baseline_cannot_know(tmp_path: Path) -> None:
    """Equation 2 is right about matt grey under any protocol, and about matt colour once that is averaged away."""
    colours = {"grey": (0.3, 0.3, 0.3), "red": (0.6, 0.1, 0.1), "rust-felt": (0.4, 0.25, 0.2)}
    fits = matt_fits(tmp_path / "fits.npz", **colours)
    told = EvaluateMaterials(
        merl=fits,
        protocol=["separated", "white"],
        size=SIZE,
        model="lambertian-grey-world",
        output=tmp_path / "report.html",
    ).run()
    assert {row["model"] for row in told.rows} == {"lambertian", "lambertian-grey-world"}
    found = errors([row for row in told.rows if row["model"] == "lambertian"], "material", "protocol")
    assert found["grey", "separated"] == pytest.approx(found["grey", "white"], abs=1e-3)
    assert found["red", "white"] == pytest.approx(found["grey", "white"], abs=0.3)
    assert 3 * found["grey", "separated"] < found["rust-felt", "separated"] < found["red", "separated"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 2 and page.count("<img") == 6
    # The curve of the baseline rises: it is what the materials are sorted by.
    first = page[page.index("<svg") : page.index("</svg>")]
    titles = [part.partition(":")[0] for part in first.split("<title>")[1:]]
    assert titles[:3] == ["grey", "rust-felt", "red"]
    separated, by_class = (
        line.split()[2:] for line in told.text.splitlines() if line.startswith("separated  lambertian ")
    )
    mean, held_out, _, largest, worst = separated
    own = [found[name, "separated"] for name in colours]
    assert [float(value) for value in (mean, held_out, largest)] == pytest.approx(
        [np.mean(own), own[0], own[1]], abs=0.01
    )
    assert worst == "red"
    # Grey and red have no class, rust is a fabric.
    assert [float(value) for value in by_class] == pytest.approx([np.mean(own[:2]), own[2], np.mean(own)], abs=0.01)


def test_meshes_are_shown_upright_from_around_in_one_and_in_several_materials(tmp_path: Path) -> None:
    """A tall cylinder stands on end; a ball's true normals are a ball's."""
    (tmp_path / "meshes").mkdir()
    ball = trimesh.creation.icosphere(subdivisions=5)
    ball.export(tmp_path / "meshes" / "ball.ply")
    pole = trimesh.creation.box(extents=(1, 4, 1))  # files have y up
    pole.export(tmp_path / "meshes" / "pole.ply")
    test = EvaluateRendered(mesh=tmp_path / "meshes", views=2, size=SIZE).evaluation()
    cases = {
        (case.labels["object"], case.labels["view"], case.labels["materials"]): case
        for case in (make() for make in test.cases)
    }
    assert sorted(cases) == [(o, v, m) for o in ("ball", "pole") for v in (1, 2) for m in ("one", "several")]
    for view in (1, 2):
        mask = cases["pole", view, "one"].capture.mask
        assert mask.any(axis=1).sum() > 1.5 * mask.any(axis=0).sum()
        several, one = (cases["ball", view, kind] for kind in ("several", "one"))
        np.testing.assert_array_equal(several.truth, one.truth)
        assert not np.allclose(several.capture.image, one.capture.image, atol=0.05)
    case = cases["ball", 1, "one"]
    rows, columns = np.nonzero(case.scored)
    # Of a ball seen orthographically a pixel's place is its normal; it fills the picture but for a margin of 2%.
    x, y = (columns + 0.5 - SIZE / 2) * 2.04 / SIZE, -(rows + 0.5 - SIZE / 2) * 2.04 / SIZE
    inside = np.hypot(x, y) < 0.9
    sphere = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)
    assert degrees_between(case.truth[rows, columns], sphere)[inside].max() < 0.5
    assert np.hypot(x, y).max() > 0.95


def test_measured_materials_are_the_held_out_ones(tmp_path: Path) -> None:
    """Of six materials every fifth, the first and the sixth, is measured on: the photos are grey and red, not green."""
    shown = dict.fromkeys("bcde", (0.05, 0.6, 0.05))
    fits = matt_fits(tmp_path / "fits.npz", a=(0.4, 0.4, 0.4), **shown, f=(0.6, 0.05, 0.05))
    trimesh.creation.icosphere(subdivisions=4).export(tmp_path / "ball.ply")
    given = EvaluateRendered(mesh=tmp_path / "ball.ply", merl=fits, views=1, protocol="separated", size=SIZE)
    one, several = (make().capture.image for make in given.evaluation().cases)
    # The middle faces the camera, equally far from all three lights.
    for photo in (one, several):
        red, green, _ = photo[SIZE // 2 - 2 : SIZE // 2 + 2, SIZE // 2 - 2 : SIZE // 2 + 2].mean(axis=(0, 1))
        assert green < 1.1 * red


def test_colours_may_have_a_white_photo_which_takes_them_away() -> None:
    """Divided by it, the blob in many colours is nearly as the white one: both shine alike, but one paint is dark."""
    cases = [make() for make in EvaluateColour(size=SIZE, white=True).evaluation().cases]
    kinds = {(case.labels["colouring"], case.labels["photos"]): case.capture for case in cases}
    plain, painted = kinds["white", 2], kinds["hard cells", 2]
    assert kinds["white", 1].white is None and plain.white is not None and painted.white is not None
    lit = plain.mask & (plain.white > 0.05).all(axis=-1)
    divided = np.abs(painted.image[lit] / painted.white[lit] - plain.image[lit] / plain.white[lit]).mean()
    assert divided < 0.1 * np.abs(painted.image[lit] - plain.image[lit]).mean()


def test_what_is_near_a_change_of_colour() -> None:
    colours = np.full((20, 30, 3), 0.5, np.float32)
    colours[:, 15:] *= 1 + 2 * CHANGE
    colours[10:] *= 1 + CHANGE / 2  # too faint a change
    near = near_colour_edges(colours)
    np.testing.assert_array_equal(near[5], (np.arange(30) >= 14 - NEAR) & (np.arange(30) <= 15 + NEAR))
    np.testing.assert_array_equal(near, np.broadcast_to(near[5], near.shape))
    colours[:, 15:] = np.nan
    assert not near_colour_edges(colours).any(), "where the surface ends its colour does not change"
    spot = np.zeros((15, 15, 3), np.float32)
    spot[7, 7] = 1
    down, right = np.mgrid[-7:8, -7:8]
    beside = np.min([(down - a) ** 2 + (right - b) ** 2 for a, b in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))], axis=0)
    np.testing.assert_array_equal(near_colour_edges(spot), beside <= NEAR**2)


def test_colours_of_the_surface_are_those_that_are_rendered() -> None:
    colours, pattern = COLOURINGS["hard cells"]
    materials = tuple(Material(base_color=colour) for colour in colours)
    recipe = published_view(held_out_blob(), materials, SIZE, pattern=pattern)
    blob = build_shape(held_out_blob())
    sample = synthesise(recipe, blob, [load_reflectance(material) for material in materials])
    found = surface_colours(recipe, blob)
    np.testing.assert_array_equal(np.isfinite(found[..., 0]), sample.alpha > 0)
    np.testing.assert_allclose(found[sample.mask], np.array(colours)[sample.material[sample.mask]], atol=1e-6)
    assert len(np.unique(sample.material[sample.mask])) >= 5


def test_a_change_of_colour_alone_moves_the_baseline_unless_colours_are_averaged() -> None:
    models = ["lambertian", "lambertian-grey-world"]
    told = EvaluateColour(protocol=["separated", "white"], size=SIZE, model=models).run()
    rows = {(r["colouring"], r["protocol"], r["model"]): r for r in told.rows}
    assert len(rows) == 2 * 2 * len(COLOURINGS)
    for model in models:
        for protocol in ("separated", "white"):
            assert "moved_deg" not in rows["white", protocol, model]
            assert "near_edges_deg" not in rows["white", protocol, model]
            assert rows["hard cells", protocol, model]["near_edges_deg"] > 0
    moved = {key: row["moved_deg"] for key, row in rows.items() if "moved_deg" in row}
    # Gloss is white on every colour, so that a little remains.
    assert moved["red", "white", "lambertian"] < 3 < 30 < moved["red", "separated", "lambertian"]
    assert moved["red", "separated", "lambertian-grey-world"] < 10
    assert moved["hard cells", "white", "lambertian"] < 5 < moved["hard cells", "separated", "lambertian"]
    line = next(x for x in told.text.splitlines() if x.startswith("separated  lambertian ") and "moved" in x)
    assert f"{moved['red', 'separated', 'lambertian']:.2f}" in line.split()


test_a_bad_evaluation_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        (lambda b: b.run("evaluate", "materials"), "--merl; see mpsnet evaluate materials"),
        (lambda b: b.run("evaluate", "materials", "--merl", b.folder), "holds no .binary files"),
        ("a folder without meshes", lambda b: b.run("evaluate", "rendered", b.folder), "holds no meshes; put .glb"),
        (
            "a mesh without faces",
            lambda b: b.run("evaluate", "rendered", b.text("a.obj", "v 0 0 0\n"), "--model", "lambertian"),
            "mesh file…a.obj…has no faces",
        ),
        (lambda b: b.run("evaluate", "colour", "-o", b / "report.pdf"), "report.pdf…written as .html"),
    ]
)
