"""The test on matt grey statues, how much fine relief is kept, and what magnified photographs cost."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from bad_input import gets_one_clear_sentence
from synthetic import diligent_object

from mpsnet_core.learning.evaluation.operations import EvaluateDiligent, EvaluateStatues
from mpsnet_core.learning.evaluation.statues import fine_relief

SIZE = 128
SIGMA = 6.0


@pytest.fixture(scope="module")
def bumpy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sphere with bumps that throw shadows, as a file."""
    ball = trimesh.creation.icosphere(subdivisions=5)
    x, y, z = ball.vertices.T
    ball.vertices *= (1 + 0.12 * np.sin(9 * x) * np.sin(9 * y) * np.sin(9 * z))[:, None]
    path = tmp_path_factory.mktemp("meshes") / "bumpy.ply"
    ball.export(path)
    return path


def ripples(amplitude: float, phase: float = 0.0) -> np.ndarray:
    """A plane with ripples 10 pixels long, on top of a bend as wide as the picture."""
    x = np.broadcast_to(np.arange(SIZE), (SIZE, SIZE))
    across = amplitude * np.sin(2 * np.pi * x / 10 + phase) + 0.3 * np.sin(np.pi * (x / SIZE - 0.5))
    return np.stack([across, np.zeros_like(across), np.sqrt(1 - across**2)], axis=-1).astype(np.float32)


def kept(estimate: np.ndarray, lit: np.ndarray | None = None) -> float:
    everywhere = np.ones((SIZE, SIZE), bool)
    found = fine_relief(estimate, ripples(0.2), everywhere, everywhere if lit is None else lit, SIGMA)
    assert found is not None
    return found


def test_fine_relief_is_the_share_of_the_detail_that_is_kept() -> None:
    truth = ripples(0.2)
    assert kept(truth) == pytest.approx(1)
    assert kept(ripples(0.1)) == pytest.approx(0.5, abs=0.01)
    assert kept(ripples(0.3)) == pytest.approx(1.5, abs=0.01)
    assert kept(ripples(0.0)) == pytest.approx(0, abs=0.01)
    assert kept(np.full_like(truth, (0, 0, 1))) == 0
    assert kept(ripples(0.2, phase=np.pi / 2)) == pytest.approx(0, abs=0.03), "detail in the wrong place"
    # A mean of 5 pixels leaves sin(5 π/10) / (5 sin(π/10)) of a wave of 10.
    blurred = np.mean([np.roll(truth, step, axis=1) for step in range(-2, 3)], axis=0)
    assert kept(blurred) == pytest.approx(0.647, abs=0.01)
    noise = np.random.default_rng(0).normal(scale=0.1, size=truth.shape)
    assert kept(truth + noise) == pytest.approx(1, abs=0.03)


def test_fine_relief_counts_where_all_lights_reach_and_the_object_is_all_around() -> None:
    truth, lit = ripples(0.2), np.ones((SIZE, SIZE), bool)
    lit[30:100, 60:100] = False  # where the plane is bent
    nonsense = np.array([0.7, 0.7, 0.1], np.float32)
    for share in (1.0, 0.5):
        wrong = np.where(lit[..., None], ripples(0.2 * share), nonsense)
        assert kept(wrong, lit) == pytest.approx(share, abs=0.01)
        assert abs(kept(wrong) - share) > 0.05
    outline = np.zeros((SIZE, SIZE), bool)
    outline[10:-10, 10:-10] = True
    beside = outline.copy()
    beside[12:-12, 12:-12] = False
    wrong = np.where(beside[..., None], nonsense, truth)
    assert fine_relief(wrong, truth, outline, outline & ~beside, SIGMA) == pytest.approx(1)
    assert fine_relief(truth, np.full_like(truth, (0, 0, 1)), outline, outline, SIGMA) is None


def test_equation_2_is_right_where_all_lights_reach_a_statue(bumpy: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    told = EvaluateStatues(mesh=bumpy.parent, tilt=[90, 101], size=SIZE, model="lambertian", output=report).run()
    assert [(row["view"], row["tilt"]) for row in told.rows] == [(1, 90), (1, 101), (2, 90), (2, 101)]
    for row in told.rows:
        assert (row["object"], row["model"]) == ("bumpy", "lambertian")
        assert row["lit_mae_deg"] < 0.5 and row["elsewhere_mae_deg"] > 5
        assert row["fine_relief"] == pytest.approx(1, abs=0.01)
    relief = next(line for line in told.text.splitlines() if line.startswith("lambertian") and "fine relief" in line)
    assert relief.split()[-2:] == ["1.00", "1.00"]


def test_the_lights_reach_a_ball_where_it_faces_them(tmp_path: Path) -> None:
    trimesh.creation.icosphere(subdivisions=6).export(tmp_path / "ball.ply")
    given = EvaluateStatues(mesh=tmp_path / "ball.ply", views=1, slant=40, tilt=[25], size=SIZE)
    case = given.evaluation().cases[0]()
    slant, tilts = np.radians(40), np.radians([25, 145, 265])
    lights = np.stack([np.sin(slant) * np.cos(tilts), np.sin(slant) * np.sin(tilts), np.full(3, np.cos(slant))], axis=1)
    np.testing.assert_allclose(case.capture.rig.directions, lights, atol=1e-9)
    facing = (case.truth @ lights.T).min(axis=-1)
    clear = case.scored & (np.abs(facing) > 0.05)
    np.testing.assert_array_equal(case.regions["lit_mae"][clear], facing[clear] > 0)


def test_statues_throw_shadows_and_their_light_bounces_when_asked(bumpy: Path) -> None:
    given = (EvaluateStatues(mesh=bumpy, views=1, tilt=[90], bounces=count, size=SIZE) for count in (0, 1))
    direct, bounced = (one.evaluation().cases[0]() for one in given)
    faces_all = (direct.truth @ direct.capture.rig.directions.T > 0.05).all(axis=-1)
    shadow = faces_all & direct.regions["elsewhere_mae"] & direct.scored
    assert shadow.sum() > 100
    assert direct.capture.image[shadow].min(axis=-1).max() == 0 < bounced.capture.image[shadow].min(axis=-1).max()


def test_diligent_is_scored_where_it_faces_all_lights(tmp_path: Path) -> None:
    pytest.importorskip("scipy")
    sphere = diligent_object(tmp_path, "ball")
    test = EvaluateDiligent(folder=tmp_path, lights="1,2,3", protocol="white", model="lambertian")
    (row,) = test.run().rows
    assert row["bright_facing_mae_deg"] < 0.02 and row["mae_deg"] > 1
    (region,) = test.evaluation().cases[0]().regions.values()
    brightest = np.percentile(sphere.image[sphere.mask], 99, axis=0)
    np.testing.assert_array_equal(region, sphere.lit & (sphere.image > 0.02 * brightest).all(axis=-1))


test_a_bad_evaluation_of_statues_gets_one_clear_sentence = gets_one_clear_sentence(
    [(lambda b: b.run("evaluate", "statues", b.text("a.obj", ""), "--slant", "95"), "the first light is behind the")]
)
