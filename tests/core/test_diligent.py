"""DiLiGenT: how captures are multiplexed, and the published numbers on its photographs."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from bad_input import cut, gets_one_clear_sentence
from conftest import Mpsnet
from synthetic import degrees_between, diligent_object, mat_file

from mpsnet_core.learning.evaluation.diligent import PROTOCOLS, read_diligent, read_truth
from mpsnet_core.learning.evaluation.matfile import read_mat_array
from mpsnet_core.learning.evaluation.measure import Row, measure
from mpsnet_core.learning.evaluation.operations import EvaluateDiligent
from mpsnet_core.learning.evaluation.published import PUBLISHED_LIGHTS

COLOURED = (0.3, 0.2, 0.1)
# Each capture channel's colour: the photographs' three channels weighted, of a surface that is COLOURED.
CHANNELS = {
    "separated": [0.3, 0.2, 0.1],
    "published": [
        0.3 * 5 / 9 + 0.2 * 2 / 9 + 0.1 * 2 / 9,
        0.3 * 2 / 9 + 0.2 * 5 / 9 + 0.1 * 2 / 9,
        0.3 * 2 / 9 + 0.2 * 2 / 9 + 0.1 * 5 / 9,
    ],
    "white": [0.2, 0.2, 0.2],
}


@pytest.mark.parametrize("protocol", CHANNELS)
def test_a_capture_is_multiplexed_by_its_protocol(tmp_path: Path, protocol: str) -> None:
    sphere = diligent_object(tmp_path, "ball", COLOURED)
    capture = read_diligent(tmp_path / "ballPNG", (2, 3, 1), protocol)
    np.testing.assert_allclose(capture.rig.directions, sphere.rig.directions[[1, 2, 0]], atol=1e-9)
    np.testing.assert_array_equal(capture.mask, sphere.mask)
    shading = np.maximum(np.stack([sphere.normals @ sphere.rig.directions[k] for k in (1, 2, 0)], axis=-1), 0)
    np.testing.assert_allclose(capture.image, shading * CHANNELS[protocol], atol=3e-5)
    assert capture.white is None


@pytest.mark.parametrize("protocol", CHANNELS)
def test_the_white_photo_has_all_three_lights_and_the_same_channels(tmp_path: Path, protocol: str) -> None:
    sphere = diligent_object(tmp_path, "ball", COLOURED)
    test = EvaluateDiligent(folder=tmp_path, lights="2,3,1", protocol=protocol, white=True).evaluation()
    (alone,), (beside,) = measure(test.cases, ["lambertian"])
    total = sum(np.maximum(sphere.normals @ sphere.rig.directions[k], 0) for k in (0, 1, 2))
    np.testing.assert_allclose(beside.case.capture.white, total[..., None] * CHANNELS[protocol], atol=1e-4)
    np.testing.assert_array_equal(alone.case.capture.image, beside.case.capture.image)
    assert [result.row().labels["photos"] for result in (alone, beside)] == [1, 2]
    assert beside.case.title == f"{alone.case.title}, with a white photo"


def test_a_grey_sphere_is_exact_and_a_coloured_one_only_when_white(tmp_path: Path) -> None:
    sphere = diligent_object(tmp_path, "ball")
    diligent_object(tmp_path, "cow", COLOURED)
    test = EvaluateDiligent(folder=tmp_path, lights="1,2,3").evaluation()
    results = {
        (result.case.labels["object"], result.case.labels["protocol"]): result
        for (result,) in measure(test.cases, ["lambertian"])
    }
    assert len(results) == 6
    for result in results.values():
        error = degrees_between(result.estimate.vectors, sphere.normals)[sphere.mask]
        assert result.mae_deg == pytest.approx(error.mean(), abs=1e-4)
        assert result.row().mae_deg == pytest.approx(error.mean(), abs=1e-4)
        assert result.row().errors["median_deg"] == pytest.approx(np.median(error), abs=1e-4)
    lit = {key: degrees_between(r.estimate.vectors, sphere.normals)[sphere.lit].mean() for key, r in results.items()}
    assert max(lit["ball", protocol] for protocol in CHANNELS) < 0.02
    assert lit["cow", "white"] < 0.02 < 5 < lit["cow", "published"] < lit["cow", "separated"]
    assert test.skipped() == ["absent, skipped: bear, buddha, cat, goblet, harvest, pot1, pot2, reading"]


def test_only_the_objects_asked_for_are_measured(tmp_path: Path) -> None:
    for name in ("ball", "cow"):
        diligent_object(tmp_path, name)
    test = EvaluateDiligent(folder=tmp_path, object=["cow", "cat"], lights="1,2,3", protocol="white").evaluation()
    assert [case().labels["object"] for case in test.cases] == ["cow"]
    assert test.skipped() == ["absent, skipped: cat"]


def row(name: str, lights: tuple[int, ...], protocol: str, error: float) -> Row:
    labels = {"object": name, "lights": list(lights), "protocol": protocol, "model": "ours"}
    return Row(labels, 1, {"mae_deg": error})


def test_the_paper_stands_beside_what_was_measured_by_its_own_protocol(tmp_path: Path) -> None:
    """Figures as the paper prints them (table 2, figure 8), of the objects and triples measured alone."""
    diligent_object(tmp_path, "ball")
    triples = PUBLISHED_LIGHTS[:2]
    assert triples == ((48, 1, 96), (8, 41, 89))
    test = EvaluateDiligent(folder=tmp_path, lights=["48,1,96", "8,41,89"]).evaluation()
    errors = {"ball": (4.0, 5.0), "goblet": (10.0, 12.0)}
    rows = [
        row(name, triple, protocol, error)
        for protocol in PROTOCOLS
        for name, pair in errors.items()
        for triple, error in zip(triples, pair, strict=True)
    ]
    lines = [line.split() for line in test.table(rows).splitlines()]
    assert lines[0] == ["protocol", "model", "lights", "ball", "goblet", "mean"]
    ours = [
        ["ours", "48,1,96", "4.00", "10.00", "7.00"],
        ["ours", "8,41,89", "5.00", "12.00", "8.50"],
        ["ours", "mean", "of", "2", "4.50", "11.00", "7.75"],
    ]
    for protocol in PROTOCOLS:
        assert [line[1:] for line in lines if line[:2] == [protocol, "ours"]] == ours
    assert [line for line in lines if "paper:" in line] == [
        ["published", "paper:", *line]
        for line in (
            ["MPS-Net", "48,1,96", "5.39", "11.43", "8.41"],
            ["MPS-Net", "8,41,89", "5.35", "12.07", "8.71"],
            ["MPS-Net", "mean", "of", "2", "5.37", "11.75", "8.56"],
            ["MPS-Net", "figure", "8", "-", "11.43", "11.43"],
            ["PS-FCN", "figure", "8", "-", "13.92", "13.92"],
            ["Demultiplexer", "figure", "8", "-", "12.46", "12.46"],
            ["baseline", "figure", "8", "-", "15.80", "15.80"],
        )
    ]
    assert test.published([r for r in rows if r.labels["protocol"] != "published"]) == []


PUBLISHED = {
    "ball": {"separated": 17.26, "published": 9.33, "white": 6.33},
    "cat": {"separated": 12.88, "published": 11.33, "white": 11.01},
}


def test_the_baseline_on_the_photographs(diligent: Path, tmp_path: Path, mpsnet: Mpsnet) -> None:
    out = tmp_path / "rows.json"
    done = mpsnet("evaluate", "diligent", diligent, "--model", "lambertian", "--lights", "48,1,96", "--json", out)
    assert (done.returncode, done.stderr) == (0, "")
    data = json.loads(out.read_text())
    assert list(data) == ["rows", "published", "confidence", "skipped"]
    labels, figures = ["object", "lights", "protocol", "photos", "model", "magnify"], ["mae_deg", "median_deg"]
    ranks = ["confidence_rank_correlation", "confidence_decile_deg"]
    assert list(data["rows"][0]) == [*labels, *figures, "bright_facing_mae_deg", *ranks]
    assert list(data["published"][0]) == ["object", "lights", "model", "mae_deg", "source", "protocol"]
    assert list(data["confidence"][0]) == ["model", "rank_correlation", "error_deg"]
    found: dict[str, dict[str, float]] = {name: {} for name in PUBLISHED}
    for row in data["rows"]:
        assert (row["model"], row["lights"]) == ("lambertian", [48, 1, 96])
        found[row["object"]][row["protocol"]] = row["mae_deg"]
    for name, errors in PUBLISHED.items():
        assert found[name] == pytest.approx(errors, abs=0.05)
    for absent in ("bear", "buddha", "cow", "goblet", "harvest", "pot1", "pot2", "reading"):
        assert absent in data["skipped"][0] and absent in done.stdout
    assert "9.33" in done.stdout and "11.33" in done.stdout


def test_true_normals_are_in_camera_space(diligent: Path) -> None:
    """DiLiGenT's ball: its right side looks right, its top up, its middle at the camera."""
    truth = read_truth(diligent / "ballPNG")
    assert truth.shape == (512, 612, 3)
    inside = np.linalg.norm(read_mat_array(diligent / "ballPNG" / "Normal_gt.mat", "Normal_gt"), axis=-1) > 0.5
    rows, columns = np.nonzero(inside)
    right, top = np.argmax(columns), np.argmin(rows)
    assert truth[rows[right], columns[right], 0] > 0.9
    assert truth[rows[top], columns[top], 1] > 0.9
    assert truth[round(rows.mean()), round(columns.mean())] == pytest.approx([0, 0, 1], abs=0.05)


@pytest.mark.parametrize("compressed", [False, True])
def test_an_array_of_a_matlab_file_is_found_by_name(tmp_path: Path, compressed: bool) -> None:
    arrays = {"first": np.arange(6.0).reshape(2, 3), "Normal_gt": np.random.default_rng(0).random((3, 4, 3))}
    path = mat_file(tmp_path / "a.mat", compressed, **arrays)
    for name, values in arrays.items():
        np.testing.assert_array_equal(read_mat_array(path, name), values)


test_a_bad_diligent_folder_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("no such folder", lambda b: b.run("evaluate", "diligent", b / "nowhere"), "has none of DiLiGenT's"),
        ("a folder without objects", lambda b: b.run("evaluate", "diligent", b.folder), "has none of DiLiGenT's"),
        ("a light out of range", lambda b: b.evaluate("--lights", "1,2,97"), "ballPNG has lights 1 to 4, not 97"),
        ("light 0", lambda b: read_diligent(b.diligent() / "ballPNG", (0, 1, 2), "white"), "ballPNG has lights 1 to 4"),
        ("lights in words", lambda b: b.evaluate("--lights", "red,green,blue"), "--lights red,green,blue is not three"),
        ("two lights", lambda b: b.evaluate("--lights", "1,2"), "--lights 1,2 is not three numbers"),
        ("twice the same light", lambda b: b.evaluate("--lights", "1,2,1"), "ballPNG…(1, 2, 1)…one plane"),
        ("unknown protocol", lambda b: b.evaluate("--protocol", "mixed"), "protocol 'mixed' is not known"),
        ("report of another kind", lambda b: b.evaluate("-o", b / "report.pdf"), "report.pdf…written as .html"),
        ("rows in no folder", lambda b: b.evaluate("--json", b / "no" / "rows.json"), "no/rows.json…does not exist"),
        (
            "light table missing",
            lambda b: read_diligent(b.diligent(light_directions="") / "ballPNG", (1, 2, 3), "white"),
            "light_directions.txt does not exist",
        ),
        (
            "light table in words",
            lambda b: read_diligent(b.diligent(light_directions="a b c\n") / "ballPNG", (1, 2, 3), "white"),
            "light_directions.txt is not a table of numbers",
        ),
        (
            "light table empty",
            lambda b: read_diligent(b.diligent(light_intensities="\n") / "ballPNG", (1, 2, 3), "white"),
            "light_intensities.txt must hold three numbers a line",
        ),
        (
            "intensity 0",
            lambda b: read_diligent(b.diligent(light_intensities="0 1 1\n" * 4) / "ballPNG", (1, 2, 3), "white"),
            "light_intensities.txt…above 0",
        ),
        (lambda b: read_diligent(b.diligent(filenames="x.png " * 4) / "ballPNG", (1, 2, 3), "white"), "x.png does not"),
        (
            "a photograph's name in no encoding",
            lambda b: (
                (b.diligent() / "ballPNG" / "filenames.txt").write_bytes(b"\xff.png " * 4),
                read_diligent(b / "pmsData" / "ballPNG", (1, 2, 3), "white"),
            ),
            "xff.png does not exist",
        ),
        ("truth missing", lambda b: read_truth(b.diligent(Normal_gt="") / "ballPNG"), "Normal_gt.mat does not exist"),
        ("truth broken", lambda b: read_truth(cut(b.diligent() / "ballPNG" / "Normal_gt.mat").parent), "is damaged"),
        (lambda b: read_truth(b.diligent(Normal_gt="MATLAB 4" * 40) / "ballPNG"), "Normal_gt.mat is not a"),
        (
            "truth under another name",
            lambda b: read_truth(mat_file(b / "Normal_gt.mat", normals=np.zeros((2, 2, 3))).parent),
            "Normal_gt.mat holds no numeric array called 'Normal_gt'",
        ),
        (lambda b: read_truth(mat_file(b / "Normal_gt.mat", Normal_gt=np.zeros((2, 2))).parent), "Normal_gt has shape"),
        (
            "truth of another size",
            lambda b: (
                mat_file(b.diligent() / "ballPNG" / "Normal_gt.mat", Normal_gt=np.zeros((2, 2, 3))),
                b.run("evaluate", "diligent", b / "pmsData", "--lights", "1,2,3"),
            ),
            "ballPNG…truth is (2, 2, 3), the photos (64, 64, 3)",
        ),
        (
            "truth with an empty header",
            lambda b: read_truth(
                b.bytes("Normal_gt.mat", bytes(124) + b"\x00\x01IM" + struct.pack("<IIII", 14, 8, 6, 0)).parent
            ),
            "Normal_gt.mat is damaged",
        ),
        ("unknown object", lambda b: b.evaluate("--object", "teapot"), "object 'teapot' is not known"),
        ("none of the objects asked for", lambda b: b.evaluate("--object", "cat"), "pmsData has none of DiLiGenT's"),
    ]
)
