"""Rigs: angles and directions, rig files, and what is kept of them. Refusals are in test_bad_input."""

import json
from pathlib import Path

import numpy as np
import pytest
from synthetic import CROSSTALK

from mpsnet_core.scene.rig import LightRig, direction_from_angles, published_rig, read_rig, write_rig

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
    rig = LightRig(direction_from_angles([12.5, 40, 71], [0, 133.7, 359]), np.array(CROSSTALK))
    write_rig(tmp_path / "rig.json", rig)
    back = read_rig(tmp_path / "rig.json")
    np.testing.assert_allclose(back.directions, rig.directions, atol=1e-12)
    np.testing.assert_array_equal(back.mixing, rig.mixing)


def test_a_rig_file_may_give_directions_or_angles_and_leave_out_the_mixing(tmp_path: Path) -> None:
    lights = [{"direction": [0, 1, 1]}, {"slant": 45, "tilt": 210}, {"slant": 45.0, "tilt": -30.0}]
    (tmp_path / "rig.json").write_text(json.dumps({"format": "mpsnet-rig", "version": 1, "lights": lights}))
    rig = read_rig(tmp_path / "rig.json")
    assert rig.slants == pytest.approx([45, 45, 45])
    assert rig.tilts == pytest.approx([90, 210, 330])
    np.testing.assert_array_equal(rig.mixing, np.eye(3))


def test_lp_files_are_read(tmp_path: Path) -> None:
    (tmp_path / "three.lp").write_text("3\nIMG 1.jpg 0 0.5 0.866\n\nb -0.433 -0.25 0.866\nc 0.433 -0.25 0.866\n")
    assert read_rig(tmp_path / "three.lp").slants == pytest.approx([30, 30, 30], abs=0.01)
    assert read_rig(tmp_path / "three.lp").tilts == pytest.approx([90, 210, 330], abs=0.01)


def test_lights_as_near_as_a_degree_to_the_axis_still_make_a_rig() -> None:
    assert published_rig(slant=1.0).slants == pytest.approx([1, 1, 1])


def test_a_file_that_notepad_wrote_is_read(tmp_path: Path) -> None:
    write_rig(tmp_path / "rig.json", published_rig())
    marked = tmp_path / "marked.json"
    marked.write_text((tmp_path / "rig.json").read_text(encoding="utf-8"), encoding="utf-8-sig")
    assert np.array_equal(read_rig(marked).directions, read_rig(tmp_path / "rig.json").directions)
