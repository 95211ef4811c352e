"""Points in front of a camera, and where its photo shows them by the formats' own documents."""

from collections.abc import Callable

import numpy as np
import pytest

from mpsnet_core.errors import InputError
from mpsnet_core.scene.photogrammetry.posed_photo import PosedPhoto, photo_points

Array = np.ndarray

# About the world's origin; the cameras of these tests stand a few units away.
POINTS = np.random.default_rng(5).uniform(-1.5, 1.5, (40, 3))

# A unit quaternion (w, x, y, z), and the rotation it is: each column is where an axis goes.
QUATERNION = (0.8, 0.2, -0.4, 0.4)
TURN = np.array([[0.36, -0.8, -0.48], [0.48, 0.6, -0.64], [0.8, 0.0, 0.6]])


def seen(posed: PosedPhoto, points: Array = POINTS) -> Array:
    """(N, 2) pixels of the photo in which our camera and lens see points (N, 3) of the world."""
    x, y, w = posed.camera.projection_rows() @ np.c_[points, np.ones(len(points))].T
    assert (w > 0).all()
    return photo_points(np.stack([x / w, y / w], axis=-1), posed.camera, posed.lens)


def opencv(x: Array, y: Array, k: dict[str, float]) -> tuple[Array, Array]:
    """OpenCV's distortion, as its documentation writes it."""
    get = lambda name: k.get(name, 0.0)  # noqa: E731
    r2 = x**2 + y**2
    radial = (1 + get("k1") * r2 + get("k2") * r2**2 + get("k3") * r2**3) / (
        1 + get("k4") * r2 + get("k5") * r2**2 + get("k6") * r2**3
    )
    return (
        x * radial + 2 * get("p1") * x * y + get("p2") * (r2 + 2 * x**2),
        y * radial + get("p1") * (r2 + 2 * y**2) + 2 * get("p2") * x * y,
    )


def refusal(act: Callable[[], object]) -> str:
    """The one sentence that `act` is refused with."""
    with pytest.raises(InputError) as caught:
        act()
    message = str(caught.value)
    assert "\n" not in message
    assert not message.endswith(".")
    return message
