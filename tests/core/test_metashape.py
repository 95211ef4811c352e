"""Metashape's cameras as it exports them, written by hand, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from metashape_files import CALIBRATION, CAMERAS, LOCAL, POSITION, SENSOR, cameras_file
from photogrammetry_scene import POINTS, TURN, Array, refusal, seen

from mpsnet_core.scene.photogrammetry import read_cameras

CALIBRATION |= {"k1": -0.1, "k2": 0.06, "k3": -0.02, "k4": 0.004, "p1": 0.003, "p2": -0.002}

# A quarter turn about z, twice as large, and moved.
SIMILARITY = """<transform>
      <rotation locked="true">0 -1 0 1 0 0 0 0 1</rotation>
      <translation locked="true">10 20 30</translation>
      <scale locked="true">2</scale>
    </transform>"""


def documented(points: Array, calibration: dict[str, float] = CALIBRATION) -> Array:
    """Points (N, 3) of the chunk to pixels, after the manual's appendix on frame cameras."""
    c = {name: 0.0 for name in CALIBRATION} | calibration
    # The camera's transform takes camera to chunk: its columns are the camera's right, down and forward.
    x, y, z = ((points - POSITION) @ TURN).T
    x, y = x / z, y / z
    r = np.hypot(x, y)
    radial = 1 + c["k1"] * r**2 + c["k2"] * r**4 + c["k3"] * r**6 + c["k4"] * r**8
    xd = x * radial + (c["p1"] * (r**2 + 2 * x**2) + 2 * c["p2"] * x * y)
    yd = y * radial + (c["p2"] * (r**2 + 2 * y**2) + 2 * c["p1"] * x * y)
    u = 640 * 0.5 + c["cx"] + xd * c["f"] + xd * c["b1"] + yd * c["b2"]
    v = 480 * 0.5 + c["cy"] + yd * c["f"]
    return np.stack([u, v], axis=-1)


def test_points_land_where_the_manual_says_and_other_photos_are_left_out(tmp_path: Path) -> None:
    photos = read_cameras(cameras_file(tmp_path))
    assert [posed.photo for posed in photos] == ["DSC_0001.JPG", "DSC_0002"]
    for posed in photos:
        in_front = POINTS[(POINTS - POSITION) @ TURN[:, 2] > 0.5]
        np.testing.assert_allclose(seen(posed, in_front), documented(in_front), atol=1e-9)


def test_what_is_zero_may_be_left_out(tmp_path: Path) -> None:
    (posed, _) = read_cameras(cameras_file(tmp_path, calibration={"f": 520.0, "cx": 4.5}))
    assert posed.lens.is_identity
    np.testing.assert_allclose(seen(posed), documented(POINTS, {"f": 520.0, "cx": 4.5}), atol=1e-9)


@pytest.mark.parametrize(
    ("component", "rest"),
    [
        ("", SIMILARITY + LOCAL),
        ('component_id="0"', SIMILARITY),
        (
            'component_id="0"',
            f'<components next_id="1" active_id="0"><component id="0" label="Component 1">{SIMILARITY}'
            "<region><center>0 0 0</center></region></component></components>",
        ),
    ],
    ids=["chunk", "chunk, for a component that has none", "component"],
)
def test_cameras_stand_in_the_world_of_the_meshes(tmp_path: Path, component: str, rest: str) -> None:
    photos = read_cameras(cameras_file(tmp_path, component=component, rest=rest))
    x, y, z = POINTS.T
    world = np.stack([10 - 2 * y, 20 + 2 * x, 30 + 2 * z], axis=-1)
    for posed in photos:
        np.testing.assert_allclose(seen(posed, world), documented(POINTS), atol=1e-9)


def test_geographic_coordinates_are_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    read_cameras(cameras_file(tmp_path))
    assert not caplog.records
    read_cameras(cameras_file(tmp_path, rest='<reference>GEOGCS["WGS 84"]</reference>'))
    assert "export both in local coordinates" in caplog.text


def test_a_byte_order_mark_is_no_harm(tmp_path: Path) -> None:
    file = cameras_file(tmp_path)
    file.write_bytes(b"\xef\xbb\xbf" + file.read_bytes())
    assert len(read_cameras(file)) == 2


def without(calibration: dict[str, float], *names: str) -> dict[str, float]:
    return {name: value for name, value in calibration.items() if name not in names}


MIRRORED = "-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
SCALED = "1.1 0 0 0 0 1.1 0 0 0 0 1.1 0 0 0 0 1"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"kind": "fisheye"}, "photo 'DSC_0002': its sensor is of type 'fisheye'"),
        ({"sensor": '<sensors><sensor id="0" label="Nikon"/></sensors>'}, "sensor 'Nikon' has no calibration"),
        ({"sensor": SENSOR.replace('width="640"', f'width="{"9" * 400}"')}, "its sensor's width must be"),
        ({"calibration": without(CALIBRATION, "f")}, "lacks the focal length f;"),
        ({"calibration": CALIBRATION | {"f": "nan"}}, "its sensor's f must be a finite number"),
        ({"calibration": CALIBRATION | {"f": 1e-320, "b1": 0}}, "focal in x and in y must be"),
        ({"calibration": CALIBRATION | {"p3": 0.1}}, "distortion p3"),
        ({"transform": "nan" + MIRRORED[2:]}, "its transform must be 16 finite numbers"),
        ({"transform": MIRRORED}, "a mirroring"),
        ({"transform": SCALED}, "the rotation of the camera is not"),
        ({"rest": SIMILARITY.replace("0 -1 0 1", "0 -1 0 2")}, "the rotation of the chunk is not"),
        ({"rest": SIMILARITY.replace(">2<", ">0<")}, "the chunk's scale is 0"),
        ({"rest": SIMILARITY.replace(">2<", ">1e308<")}, "photo 'DSC_0002': the camera's world_from_camera must be"),
        ({"rest": f"<transform>{MIRRORED}</transform>"}, "older than 1.2"),
        ({"cameras": CAMERAS.replace("transform>", "reference>")}, "holds no photo with a pose"),
        ({"rest": "</chunk><chunk>"}, "it holds 2 chunks"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, changes: dict[str, str], said: str) -> None:
    message = refusal(lambda: read_cameras(cameras_file(tmp_path, **changes)))  # type: ignore[arg-type]
    assert said in message
    assert str(tmp_path / "cameras.xml") in message


BOMB = """<?xml version="1.0"?>
<!DOCTYPE document [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>
<document><chunk>&b;</chunk></document>
"""


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (BOMB.encode(), "cameras.xml: it has a document type"),
        (BOMB.encode("utf-16"), "it is not UTF-8 text"),
        (b"\x89PNG\r\n", "it is not UTF-8 text"),
        (b"<document>" + b"<a>" * 100_000, "it is not valid XML"),
    ],
)
def test_what_is_no_file_of_cameras_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    (tmp_path / "cameras.xml").write_bytes(content)
    assert said in refusal(lambda: read_cameras(tmp_path / "cameras.xml"))
