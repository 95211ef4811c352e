"""DiLiGenT: how captures are multiplexed, and the published numbers on its photographs."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from bad_input import cut, gets_one_clear_sentence
from synthetic import degrees_between, diligent_object, mat_file

from mpsnet_core.io.image_reading import read_mask
from mpsnet_core.learning.evaluation.diligent import read_diligent, read_truth
from mpsnet_core.learning.evaluation.measure import measure
from mpsnet_core.learning.evaluation.operations import EvaluateDiligent

pytest.importorskip("scipy")

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


PUBLISHED = {
    "ball": {"separated": 17.26, "published": 9.33, "white": 6.33},
    "cat": {"separated": 12.88, "published": 11.33, "white": 11.01},
}


def test_the_baseline_on_the_photographs(diligent: Path, tmp_path: Path, mpsnet) -> None:
    out = tmp_path / "rows.json"
    done = mpsnet("evaluate", "diligent", diligent, "--model", "lambertian", "--lights", "48,1,96", "--json", out)
    assert (done.returncode, done.stderr) == (0, "")
    data = json.loads(out.read_text())
    found: dict[str, dict[str, float]] = {name: {} for name in PUBLISHED}
    for row in data["rows"]:
        assert (row["model"], row["lights"]) == ("lambertian", [48, 1, 96])
        found[row["object"]][row["protocol"]] = row["mae_deg"]
    for name, errors in PUBLISHED.items():
        assert found[name] == pytest.approx(errors, abs=0.05)
    assert "9.33" in done.stdout and "11.33" in done.stdout


def test_true_normals_are_in_camera_space(diligent: Path) -> None:
    """DiLiGenT's ball: its right side looks right, its top up, its middle at the camera."""
    truth = read_truth(diligent / "ballPNG")
    assert truth.shape == (512, 612, 3)
    rows, columns = np.nonzero(read_mask(diligent / "ballPNG" / "mask.png"))
    right, top = np.argmax(columns), np.argmin(rows)
    assert truth[rows[right], columns[right], 0] > 0.9
    assert truth[rows[top], columns[top], 1] > 0.9
    assert truth[round(rows.mean()), round(columns.mean())] == pytest.approx([0, 0, 1], abs=0.05)


test_a_bad_diligent_folder_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("a folder without objects", lambda b: b.run("evaluate", "diligent", b.folder), "has none of DiLiGenT's"),
        ("a light out of range", lambda b: b.evaluate("--lights", "1,2,97"), "ballPNG has lights 1 to 4, not 97"),
        ("twice the same light", lambda b: b.evaluate("--lights", "1,2,1"), "ballPNG…(1, 2, 1)…one plane"),
        (
            "light table in words",
            lambda b: read_diligent(b.diligent(light_directions="a b c\n") / "ballPNG", (1, 2, 3), "white"),
            "light_directions.txt is not a table of numbers",
        ),
        (
            "a photograph's name in no encoding",
            lambda b: (
                (b.diligent() / "ballPNG" / "filenames.txt").write_bytes(b"\xff.png " * 4),
                read_diligent(b / "pmsData" / "ballPNG", (1, 2, 3), "white"),
            ),
            "xff.png does not exist",
        ),
        ("truth broken", lambda b: read_truth(cut(b.diligent() / "ballPNG" / "Normal_gt.mat").parent), "is damaged"),
        (
            "truth under another name",
            lambda b: read_truth(mat_file(b / "Normal_gt.mat", normals=np.zeros((2, 2, 3))).parent),
            "holds no numbers called Normal_gt",
        ),
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
    ]
)
