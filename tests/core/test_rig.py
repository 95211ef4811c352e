"""Rigs: angles and directions, rig files, what is kept of them, and what is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bad_input import NAN, Bench, gets_one_clear_sentence, loop
from synthetic import CROSSTALK

from mpsnet_core.scene.rig import (
    LightRig,
    direction_from_angles,
    published_rig,
    read_rig,
    read_world_lights,
    write_rig,
)

HALF, ROOT = 0.5, np.sqrt(3) / 2


def test_published_rig_has_slant_30_and_tilts_120_apart_with_red_on_top() -> None:
    rig = published_rig()
    assert rig.slants == pytest.approx([30, 30, 30])
    assert rig.tilts == pytest.approx([90, 210, 330])
    assert rig.directions[0] == pytest.approx([0, HALF, ROOT])


@pytest.mark.parametrize(
    ("slant", "tilt", "direction"),
    [
        (0, 77, [0, 0, 1]),
        (90, 0, [1, 0, 0]),
        (90, 90, [0, 1, 0]),
        (30, 180, [-HALF, 0, ROOT]),
        (60, -90, [0, -ROOT, HALF]),
    ],
)
def test_slant_is_from_z_and_tilt_from_x_towards_y(slant: float, tilt: float, direction: list[float]) -> None:
    assert direction_from_angles(slant, tilt) == pytest.approx(direction, abs=1e-12)


def test_directions_are_normalised_and_cannot_be_changed() -> None:
    rig = LightRig(np.array([[2.0, 0, 1], [0, 3, 1], [0, 0, 4]]))
    assert np.linalg.norm(rig.directions, axis=1) == pytest.approx([1, 1, 1])
    with pytest.raises(ValueError, match="read-only"):
        rig.directions[0, 0] = 1


def test_a_rig_file_gives_the_rig_back(tmp_path: Path) -> None:
    for exact in (False, True):
        rig = LightRig(
            direction_from_angles([12.5, 40, 71], [0, 133.7, 359]), np.array(CROSSTALK), is_ground_truth=exact
        )
        write_rig(tmp_path / "rig.json", rig)
        back = read_rig(tmp_path / "rig.json")
        np.testing.assert_allclose(back.directions, rig.directions, atol=1e-12)
        np.testing.assert_array_equal(back.mixing, rig.mixing)
        assert back.is_ground_truth is exact


def test_a_rig_file_may_give_directions_or_angles_and_leave_out_the_mixing(tmp_path: Path) -> None:
    lights = [{"direction": [0, 1, 1]}, {"slant": 45, "tilt": 210}, {"slant": 45.0, "tilt": -30.0}]
    (tmp_path / "rig.json").write_text(json.dumps({"format": "mpsnet-rig", "version": 1, "lights": lights}))
    rig = read_rig(tmp_path / "rig.json")
    assert rig.slants == pytest.approx([45, 45, 45])
    assert rig.tilts == pytest.approx([90, 210, 330])
    np.testing.assert_array_equal(rig.mixing, np.eye(3))


@pytest.mark.parametrize("second", ["b -0.433 -0.25 0.866", "b -0,433 -0,25 0,866", "2 -.433 -25e-2 0,866"])
def test_lp_files_are_read(tmp_path: Path, second: str) -> None:
    (tmp_path / "three.lp").write_text(f"\ufeff3\nIMG 1.jpg 0 0.5 0.866\n\n{second}\nc 0.433 -0.25 0.866\n")
    assert read_rig(tmp_path / "three.lp").slants == pytest.approx([30, 30, 30], abs=0.01)
    assert read_rig(tmp_path / "three.lp").tilts == pytest.approx([90, 210, 330], abs=0.01)


def test_lights_as_near_as_a_degree_to_the_axis_still_make_a_rig() -> None:
    assert published_rig(slant=1.0).slants == pytest.approx([1, 1, 1])


def test_a_file_that_notepad_wrote_is_read(tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.json", published_rig())
    marked = tmp_path / "marked.json"
    marked.write_text((tmp_path / "rig.json").read_text(encoding="utf-8"), encoding="utf-8-sig")
    assert np.array_equal(read_rig(marked).directions, read_rig(tmp_path / "rig.json").directions)


def lights(b: Bench, **changes: Any) -> Path:
    """A rig file with its second light changed; None takes a key out."""
    light = {"slant": 30, "tilt": 210, **changes}
    good = [{"slant": 30, "tilt": tilt} for tilt in (90, 330)]
    light = {key: value for key, value in light.items() if value is not None}
    return b.rig(lights=[good[0], light, good[1]])


test_a_bad_rig_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        (lambda b: read_rig(b.rig(mixing=(1e-300 * np.eye(3)).tolist())), "mixing matrix is of the size 1e-300"),
        ("direction too long to be measured", lambda b: LightRig(1e200 * np.eye(3) + 1), "a number beyond 1e+12"),
        ("a link to itself", lambda b: read_rig(loop(b / "rig.json")), "rig.json does not exist; check the path"),
        (lambda b: read_rig(b.rig(**{"\x1b[2Jmixing": 1})), 'has "\\x1b[2Jmixing", which no mpsnet-rig file has'),
        ("a text of a hundred thousand letters", lambda b: read_rig(b.rig(format="m" * 100_000)), "rig.json is not a"),
        ("behind", lambda b: read_rig(lights(b, slant=120)), "second light is behind the object…z towards the camera"),
        ("coplanar", lambda b: LightRig([[0, 0.5, 1], [0, -0.5, 1], [0, 0, 1]]), "move one light"),
        ("twice the same light", lambda b: read_rig(lights(b, tilt=90)), "rig.json…(nearly) in one plane"),
        ("direction not finite", lambda b: LightRig([[0, NAN, 1], [1, 0, 1], [0, 0, 1]]), "light directions"),
        ("angle beyond all numbers", lambda b: read_rig(lights(b, slant=10**400)), "second light…2 finite numbers"),
        ("direction and angles", lambda b: read_rig(lights(b, direction=[0, 0, 1])), "second light needs either…or"),
        ("an angle in words", lambda b: read_rig(lights(b, slant="steep")), "rig.json…second light…2 finite numbers"),
        ("an angle as text", lambda b: read_rig(lights(b, slant="30")), "rig.json…second light…2 finite numbers"),
        (lambda b: read_rig(b.rig(mixing=[[1, 1, 0], [1, 1, 0], [0, 0, 1]])), "mixing matrix cannot be inverted"),
        (lambda b: read_rig(b.rig(mixing=[[10**400, 0, 0], [0, 1, 0], [0, 0, 1]])), "rig.json…mixing matrix"),
        ("a name too long for the system", lambda b: read_rig(b / ("x" * 300)), "xxx cannot be opened…check the path"),
        ("not JSON", lambda b: read_rig(b.text("rig.json", '{"format": "mpsnet-rig",')), "not valid JSON"),
        ("not text", lambda b: read_rig(b.bytes("rig.json", b"\xff\xfe\x00")), "rig.json is not a text file"),
        ("JSON too deep", lambda b: read_rig(b.text("rig.json", "[" * 100_000)), "rig.json is not valid JSON"),
        ("a misspelled key", lambda b: read_rig(b.rig(mixng=[])), "may have lights, mixing"),
        ("a newer version", lambda b: read_rig(b.rig(version=2)), "rig.json is version 2…reads up to 1; update it"),
        ("not a small file", lambda b: read_rig(b.text("rig.json", " " * (1 << 21))), "rig.json is larger than 1 MiB"),
        (".lp with four lights", lambda b: read_rig(b.text("r.lp", "4\n" + "a 0 0 1\n" * 4)), "holds 4 lights, a rig"),
        (".lp with a wrong count", lambda b: read_rig(b.text("r.lp", "3\n" + "a 0 0 1\n" * 2)), "states 3 lights but"),
        *(
            (
                f".lp with a line {line}",
                lambda b, line=line: read_rig(b.text("r.lp", f"3\na 0 0 1\n\n{line}\n")),
                "line 4 is",
            )
            for line in ("b 0 0 1 0.8", "b 0,0,1", "b; 0; 0; 1", "b 0. 0, 1,0,0", "b 0 0 nan", "b 0 0")
        ),
        (".lp with a count of too many digits", lambda b: read_rig(b.text("r.lp", "3" * 5000)), "not an .lp file"),
        (
            "lights in the world that look the same to the camera",
            lambda b: read_world_lights(b.rig(lights=[{"direction": [0, 0, 1]}] * 3, mixing=np.ones((3, 3)).tolist())),
            "rig.json…mixing matrix cannot be inverted",
        ),
        (".lp that is something else", lambda b: read_rig(b.text("r.lp", "hello\nworld")), "r.lp…not an .lp file"),
    ]
)


def test_the_rig_that_is_spoilt_above_is_good_before(tmp_path: Path) -> None:
    assert read_rig(lights(Bench(tmp_path))).tilts == pytest.approx([90, 210, 330])
