"""The preview of the lights against a ball and a floor, whose light and shadows have equations."""

from pathlib import Path

import numpy as np
import pytest
from mesh_file import write_mesh
from surface_shapes import camera_looking, sphere_mesh

from mpsnet_core import Camera, Mesh, join_meshes, write_camera
from mpsnet_core.io.image import srgb_to_linear
from mpsnet_core.io.image_reading import read_data
from mpsnet_core.scene.light_preview import TOO_FEW, LitView, lit_view
from mpsnet_core.scene.operations import PreviewLights
from mpsnet_core.scene.rig import LightRig, direction_from_angles, near_rig, write_rig

SIZE = 64
PLACE = np.array([3.0, -2.0, 1.0])
RADIUS = 2.0
LIGHTS = direction_from_angles([60, 50, 40], [80, 200, 330])
MIXING = np.array([[0.9, 0.1, 0.0], [0.2, 0.8, 0.1], [0.0, 0.1, 1.0]])


def ball() -> Mesh:
    pose = np.diag([RADIUS, RADIUS, RADIUS, 1.0])
    pose[:3, 3] = PLACE
    return sphere_mesh(64, 32, world_from_object=pose)


def square(middle: np.ndarray, side: float, normal: int) -> Mesh:
    """A square that faces along the axis `normal`."""
    right, up = np.roll(np.eye(3), -normal, axis=0)[1:]
    corners = [middle + side * (x * right + y * up) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    normals = np.broadcast_to(np.cross(right, up), (2, 3, 3))
    return Mesh(np.array(corners), triangles, normals, np.zeros((2, 3, 2)))


def looking(projection: str) -> Camera:
    return camera_looking((0.3, -1, 0.5), projection, size=SIZE, distance=12, target=tuple(PLACE), reach=1.1 * RADIUS)


def on_the_ball(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """(H, W, 3) points and normals of the ball in camera space by its equation, NaN where it is missed."""
    row, column = np.mgrid[:SIZE, :SIZE].reshape(2, -1)
    origins, directions = camera.rays(np.stack([column, row], axis=1) + 0.5)
    along = ((PLACE - origins) * directions).sum(1)
    passing = np.linalg.norm(origins + along[:, None] * directions - PLACE, axis=1)
    with np.errstate(invalid="ignore"):
        points = origins + (along - np.sqrt(RADIUS**2 - passing**2))[:, None] * directions
    normals = (points - PLACE) / RADIUS @ camera.rotation
    return (
        ((points - camera.world_from_camera[:3, 3]) @ camera.rotation).reshape(SIZE, SIZE, 3),
        normals.reshape(SIZE, SIZE, 3),
    )


def check(view: LitView, normals: np.ndarray, arriving: np.ndarray) -> None:
    """arriving: (..., 3, 3) a row for each light, its direction times its brightness."""
    inside = normals[..., 2] > 0.2  # at the outline a ball of flat faces is seen elsewhere
    assert view.mask[inside].all() and inside.sum() > 0.5 * SIZE**2
    cosine = np.einsum("...ki,...i->...k", arriving, normals)
    sure = inside[..., None] & (np.abs(cosine) > 0.02)
    assert (view.reached == (cosine > 0))[sure].all()
    assert set(view.reached.sum(axis=-1)[inside]) >= {1, 2, 3}
    front = normals[..., 2] > 0.5
    assert np.abs(view.photo - np.maximum(cosine, 0) @ MIXING.T)[front].max() < 0.02
    assert np.abs(view.normals - normals)[front].max() < 0.02


@pytest.mark.parametrize("projection", ["orthographic", "perspective"])
def test_distant_lights_reach_what_faces_them_with_the_cosine(projection: str) -> None:
    camera = looking(projection)
    _, normals = on_the_ball(camera)
    check(lit_view(camera, LightRig(LIGHTS, MIXING), ball()), normals, LIGHTS)


def test_a_near_light_is_hidden_by_what_stands_before_it_alone() -> None:
    camera = looking("perspective")
    points, normals = on_the_ball(camera)
    middle = (PLACE - camera.world_from_camera[:3, 3]) @ camera.rotation
    rig = near_rig(middle + 8 * LIGHTS, middle, MIXING)
    assert rig.near is not None
    # A wall behind each light, of which none is between a light and the ball.
    walls = [square(PLACE + 40 * np.eye(3)[axis] * sign, 60, axis) for axis in range(3) for sign in (-1, 1)]
    check(lit_view(camera, rig, join_meshes([ball(), *walls])), normals, rig.near.lights_at(points))


def test_the_ball_casts_its_shadow_on_the_floor() -> None:
    height = PLACE[2] - 3 * RADIUS
    floor = square(np.array([*PLACE[:2], height]), 20, 2)
    camera = camera_looking((0, 0, 1), size=SIZE, distance=12, target=tuple(PLACE), reach=5 * RADIUS)
    view = lit_view(camera, LightRig(LIGHTS, MIXING), join_meshes([ball(), floor]))
    row, column = np.mgrid[:SIZE, :SIZE].reshape(2, -1)
    points, _ = camera.rays(np.stack([column, row], axis=1) + 0.5)
    seen = np.linalg.norm((points - PLACE)[:, :2], axis=1) > 1.02 * RADIUS  # past the ball
    points[:, 2] = height
    for number, light in enumerate(LIGHTS @ camera.rotation.T):
        along = (PLACE - points) @ light
        passing = np.linalg.norm(points + along[:, None] * light - PLACE, axis=1)
        sure = seen & (np.abs(passing - RADIUS) > 0.02 * RADIUS)
        assert (sure & (passing < RADIUS)).sum() > 20
        assert (view.reached[..., number].ravel() == (passing > RADIUS))[sure].all()


def test_the_picture_has_the_photo_left_and_how_many_lights_reach_right(tmp_path: Path) -> None:
    camera, rig = looking("orthographic"), LightRig(LIGHTS)
    write_mesh(tmp_path / "ball.npz", ball())
    write_rig(tmp_path / "rig.json", rig)
    write_camera(tmp_path / "camera.json", camera.resized(4 * SIZE, 2 * SIZE))
    files = {name: str(tmp_path / file) for name, file in (("mesh", "ball.npz"), ("rig", "rig.json"))}
    answers = [
        PreviewLights(**files, camera=str(tmp_path / "camera.json"), size=SIZE, output=str(tmp_path / name)).run()
        for name in ("preview.png", "preview.npy")
    ]
    view = lit_view(camera.resized(SIZE, SIZE // 2), rig, ball())
    picture = np.dstack(read_data(tmp_path / "preview.png"))
    assert picture.shape == (SIZE // 2, 2 * SIZE, 4)
    assert np.abs(picture - np.load(tmp_path / "preview.npy")).max() < 1 / 255
    left, right = picture[:, :SIZE], picture[:, SIZE:]
    assert (left[..., 3] == view.mask).all() and (right[..., 3] == view.mask).all()
    assert np.abs(srgb_to_linear(left[..., :3]) - view.photo).max() < 0.005
    count = view.reached.sum(axis=-1)
    for few, colour in enumerate(TOO_FEW):
        shown = right[view.mask & (count == few)][:, :3]
        assert len(shown) / view.mask.sum() == pytest.approx(answers[0].shares[few], abs=1e-4)
        assert not len(shown) or np.abs(shown - colour).max() < 1 / 255
    assert np.abs(2 * right[..., :3] - 1 - view.normals)[view.mask & (count == 3)].max() < 0.01
    assert answers[0].shares == answers[1].shares
