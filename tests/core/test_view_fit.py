"""Views of a bumpy ball that fit its mesh are silent, and those by a wrong camera, axis or unit are not."""

from dataclasses import replace
from functools import cache

import bumpy_ball
import numpy as np
import pytest
from surface_shapes import upright

from mpsnet_core import Camera, Mesh, NormalMap, View
from mpsnet_core.arrays.resampling import gaussian
from mpsnet_core.bake.view_agreement import warn_of_misfit
from mpsnet_core.scene.rays import RayScene

SIDE = 160
FROM_Y_UP = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
VIEWS = [(40, 15), (160, -20), (-80, 50)]


def looking(longitude: float, latitude: float, lens: float = 1.7, distance: float = 6.0) -> Camera:
    """A camera that looks at the origin; degrees."""
    longitude, latitude = np.radians([longitude, latitude])
    flat = np.cos(latitude)
    pose = np.eye(4)
    pose[:3, :3] = upright((flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)))
    pose[:3, 3] = distance * pose[:3, 2]
    return Camera("perspective", SIDE, SIDE, np.full(2, lens * SIDE), None, pose)


@cache
def seen(camera: tuple[float, ...]) -> View:
    """A view whose normals are 12 degrees off, as of a model, in large patches."""
    photo = bumpy_ball.photo(looking(*camera))
    rng = np.random.default_rng(1)
    errors = np.stack([gaussian(rng.normal(size=photo.mask.shape), 15, (0, 1)) for _ in range(3)], axis=-1)
    errors *= np.radians(12) / np.sqrt(2) / errors.std()
    return View(photo.camera, NormalMap((photo.normals + errors).astype(np.float32), photo.mask))


@cache
def mesh(rows: int) -> Mesh:
    return bumpy_ball.mesh(rows)


def said(view: View, shape: Mesh, caplog: pytest.LogCaptureFixture) -> str:
    caplog.clear()
    warn_of_misfit("a", view, shape, RayScene.of(shape))
    return caplog.text


def within(view: View, mask: np.ndarray) -> View:
    return replace(view, normals=NormalMap(view.normals.vectors, view.normals.mask & mask))


@pytest.mark.parametrize("place", VIEWS)
@pytest.mark.parametrize("rows", [60, 8])
def test_views_that_fit_are_silent(place: tuple[float, float], rows: int, caplog: pytest.LogCaptureFixture) -> None:
    """Also of a mesh of 240 triangles, of a part of the mesh, and where the mask is a part of it."""
    whole, close = seen(place), seen((*place, 5.0))
    left, middle = np.zeros((2, SIDE, SIDE), bool)
    left[:, : SIDE // 2] = middle[SIDE // 2 - 12 : SIDE // 2 + 12, SIDE // 2 - 20 :] = True
    everywhere = replace(whole, normals=NormalMap(_filled(whole), np.ones((SIDE, SIDE), bool)))
    turned = replace(whole, camera=replace(whole.camera, world_from_camera=_nudged(whole.camera)))
    for view in (whole, close, within(whole, left), within(whole, middle), within(close, left), everywhere, turned):
        assert not said(view, mesh(rows), caplog)


def _filled(view: View) -> np.ndarray:
    return np.where(view.normals.mask[..., None], view.normals.vectors, np.float32([0, 0, 1]))


def _nudged(camera: Camera) -> np.ndarray:
    """The pose, turned by two degrees about the object."""
    c, s = np.cos(np.radians(2)), np.sin(np.radians(2))
    turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return turn @ camera.world_from_camera


@pytest.mark.parametrize("place", VIEWS)
def test_a_wrong_axis_or_unit_is_named(place: tuple[float, float], caplog: pytest.LogCaptureFixture) -> None:
    view, shape = seen(place), mesh(30)
    for turn, words in ((FROM_Y_UP.T, "(--up y)"), (FROM_Y_UP, "(--up z)")):
        assert words in said(view, replace(shape, vertices=shape.vertices @ turn.T), caplog)
    for unit, words in ((0.01, "100 times as long"), (25.4, "0.03937 times"), (1000, "0.001 times as long")):
        found = said(view, replace(shape, vertices=unit * shape.vertices), caplog)
        assert words in found or unit > 1  # a camera within the mesh may see nothing that tells
        assert "does not fit" in found


@pytest.mark.parametrize("turned", [90, 180])
@pytest.mark.parametrize("place", VIEWS)
def test_another_camera_than_the_photos_is_said(place: tuple[float, float], turned: float, caplog) -> None:
    view = replace(seen(place), camera=looking(place[0] + turned, place[1]))
    assert "check that camera, photo and mesh belong together" in said(view, mesh(30), caplog)
