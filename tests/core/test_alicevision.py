"""AliceVision scenes written by hand in the several versions of its files, and what is refused."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from alicevision_files import CENTRE, COEFFICIENTS, SIZE, TYPES, WORDS, scene, write
from photogrammetry_scene import POINTS, TURN, Array, opencv, refusal, seen

from mpsnet_core.scene.photogrammetry import read_cameras


def documented(points: Array, coefficients: int = 0) -> Array:
    """World points (N, 3) to pixels as AliceVision's Pinhole does: R (X - C), bent, scaled, from the image's middle."""
    x, y, z = ((points - CENTRE) @ TURN.T).T
    names = ("k1", "k2", "k3", "p1", "p2")[:coefficients]
    x, y = opencv(x / z, y / z, dict(zip(names, COEFFICIENTS, strict=False)))
    return np.stack([1000 * x - 26 + SIZE[0] / 2, 2000 * y + 16 + SIZE[1] / 2], axis=-1)


IN_FRONT = POINTS[(POINTS - CENTRE) @ TURN[2] > 0.5]


@pytest.mark.parametrize("version", WORDS)
def test_points_land_where_every_version_says(tmp_path: Path, version: str) -> None:
    photos = read_cameras(write(tmp_path, scene(version)))
    assert [posed.photo for posed in photos] == ["/photos/a.jpg", "/photos/b.jpg"]
    # Since 1.2.3 its meshes have y and z the other way round than its poses.
    world = IN_FRONT if version in ("1.2.0", "1.2.1", "1.2.2") else IN_FRONT * (1, -1, -1)
    for posed in photos:
        assert posed.lens.is_identity
        # Its pixel (0, 0) is the middle of the first one, ours is the corner.
        np.testing.assert_allclose(seen(posed, world), documented(IN_FRONT) + 0.5, atol=1e-6)


def test_the_first_versions_have_one_focal_length(tmp_path: Path) -> None:
    data = scene("1.0.0", pxFocalLength="1000", principalPoint=["2020", "1040"])
    posed = read_cameras(write(tmp_path, data))[0]
    np.testing.assert_array_equal(posed.camera.focal, [1000, 1000])
    np.testing.assert_array_equal(posed.camera.centre, [2020.5, 1040.5])


@pytest.mark.parametrize("version", ["1.2.2", "1.2.14"])
@pytest.mark.parametrize("kind", TYPES)
def test_lenses_bend_as_alicevision_bends(tmp_path: Path, kind: str, version: str) -> None:
    posed = read_cameras(write(tmp_path, scene(version, kind), "scene.json"))[0]
    world = IN_FRONT if version == "1.2.2" else IN_FRONT * (1, -1, -1)
    expected = documented(IN_FRONT, TYPES[kind][1]) + 0.5
    np.testing.assert_allclose(seen(posed, world), expected, atol=1e-6)


def test_numbers_may_be_numbers(tmp_path: Path) -> None:
    plain = scene()
    plain["intrinsics"][0] |= {"width": 4092, "focalLength": 8.7976539589442808, "principalPoint": [-26, 16]}
    plain["version"] = [1, 2, 8]
    one, other = read_cameras(write(tmp_path, scene()))[0], read_cameras(write(tmp_path, plain, "b.sfm"))[0]
    np.testing.assert_allclose(seen(one, IN_FRONT * (1, -1, -1)), seen(other, IN_FRONT * (1, -1, -1)))


def changed(*path: str | int, to: Any) -> dict[str, Any]:
    """The good scene with one value changed, or taken out where `to` is None."""
    data = copy.deepcopy(scene())
    part: Any = data
    for key in path[:-1]:
        part = part[key]
    if to is None:
        del part[path[-1]]
    else:
        part[path[-1]] = to
    return data


ROTATION = ("poses", 0, "pose", "transform", "rotation")
LENS = ("intrinsics", 0)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ([], "it is not an AliceVision scene"),
        ({"format": "mpsnet-camera", "version": 1}, "it is not an AliceVision scene"),
        (changed("version", to=["1", "2"]), "\"version\" is ['1', '2'], not three whole numbers"),
        (changed("version", to=["2", "0", "0"]), "it is of version 2.0.0"),
        (changed("views", to=[3]), '"views" is not a list of objects'),
        (changed("intrinsics", to=""), "photo '/photos/b.jpg': its intrinsic 5 is not in the scene"),
        (changed("views", 0, "path", to=None), 'its "path" is not text'),
        (changed("views", 0, "isPoseIndependant", to="false"), "several cameras mounted together"),
        (changed(*LENS, "distortionType", to="fisheye4"), "camera type 'fisheye4' is not supported"),
        (changed(*LENS, "type", to="equidistant"), "camera type 'equidistant' is not supported"),
        (changed(*LENS, "distortionType", to="radialk3"), '"distortionParams" must be 3 numbers, not 1'),
        (changed(*LENS, "width", to="1e99"), "the camera's width"),
        (changed(*LENS, "focalLength", to="-1"), "focal in x and in y must be"),
        (changed(*LENS, "sensorWidth", to="0"), '"sensorWidth" and "pixelRatio" must be above 0'),
        (changed(*LENS, "principalPoint", to=[10**400, 1]), '"principalPoint" is missing or not a finite'),
        (changed(*ROTATION, to=["1"] * 8), '"rotation" must be 9 numbers, not 8'),
        (changed(*ROTATION, to=["1"] * 9), "the rotation of its pose is not"),
        (changed(*ROTATION, to=["-1", "0", "0", "0", "1", "0", "0", "0", "1"]), "a mirroring"),
        (changed("poses", 0, "pose", "transform", "center", to=["inf", "0", "0"]), '"center" is missing'),
        (scene("1.2.9", focalLength="8", pixelRatio="2", principalPoint=["0", "0"]), "square pixels only"),
    ],
)
def test_bad_scenes_are_refused(tmp_path: Path, data: object, said: str) -> None:
    message = refusal(lambda: read_cameras(write(tmp_path, data)))
    assert said in message
    assert str(tmp_path / "cameras.sfm") in message
