"""The mixing matrix by grey balls and cards: against photographs that are traced with a matrix that is known."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from mirror_ball import CROSSTALK, Scene, around, developed, grey_photograph, taken
from synthetic import degrees_between

from mpsnet_core import InputError, LightRig, near_rig, read_image, read_mask
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.calibrate.ball import Ball, Circle, ball_from_circle, ball_from_mask
from mpsnet_core.calibrate.circles import find_balls
from mpsnet_core.calibrate.mixing import lambertian_error, mixing_from_ball, mixing_from_ball_by_light, mixing_from_card
from mpsnet_core.io.image import linear_to_srgb, srgb_to_linear
from mpsnet_core.scene.camera import Camera, pixel_camera

pytestmark = pytest.mark.accuracy

ANGLES = [(30, 90), (35, 205), (25, 335)]
FACING = np.array([around(*angle) for angle in ANGLES])
RIG = LightRig(FACING)
# Crosstalk of 30%, and lights and channels of different strength.
MIXING = CROSSTALK * np.array([1.0, 0.8, 0.6]) * np.array([[0.7], [1.0], [0.8]])
MIXING = MIXING / MIXING.max()
SCENE = Scene([((2.15, -3.1, 0.0), 55.0)], [], (150, 150))
CAMERA = pixel_camera(150, 150)
TRUE_CIRCLE = Circle(77.15, 78.1, 55.0)


def drawn(circle: Circle = TRUE_CIRCLE) -> Ball:
    return ball_from_circle(circle, CAMERA)


@pytest.mark.parametrize(
    ("circle", "options"),
    [
        (Circle(77.9, 77.5, 55.75), {"ambient": 0.05}),
        (Circle(76.4, 78.7, 54.0), {"noise": 0.01}),
        (Circle(76.4, 78.7, 54.0), {"levels": 255}),
    ],
)
def test_a_grey_ball_determines_the_matrix_though_its_circle_is_slightly_wrong(circle: Circle, options: dict) -> None:
    found = mixing_from_ball(taken(grey_photograph(SCENE, MIXING, FACING, **options)), drawn(circle), RIG)
    assert np.abs(found.mixing - MIXING).max() < 0.01
    assert found.mixing.max() == 1
    assert found.determined
    assert found.ambient == pytest.approx(options.get("ambient", 0), abs=0.02)
    assert found.residual < 0.04
    assert found.ball is not None
    corrected, near = found.ball.circle, 0.25 if "noise" in options else 0.1
    assert (corrected.x, corrected.y, corrected.radius) == pytest.approx((77.15, 78.1, 55), abs=near)


def test_a_ball_that_is_found_and_one_in_perspective() -> None:
    image = grey_photograph(SCENE, MIXING, FACING)
    found = mixing_from_ball(taken(image), find_balls(image, CAMERA, mirror=False)[0], RIG)
    assert np.abs(found.mixing - MIXING).max() < 0.01
    scene = Scene([((0.1, -0.1, -1.0), 0.15)], [], (200, 150), 350)
    image = grey_photograph(scene, MIXING, FACING)
    camera = Camera("perspective", 200, 150, (350.0, 350.0))
    found = mixing_from_ball(taken(image), find_balls(image, camera, mirror=False)[0], RIG)
    assert np.abs(found.mixing - MIXING).max() < 0.01


@pytest.mark.parametrize("turned", [0.0, 10.0])
def test_equation_2_errs_on_the_ball_as_far_as_the_rig_is_turned(turned: float) -> None:
    angle = np.radians(turned)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    photo = taken(grey_photograph(SCENE, MIXING, FACING, noise=0, levels=None))
    found = lambertian_error([photo], drawn(), LightRig(FACING @ turn.T, MIXING))
    x, y = np.meshgrid(*[np.linspace(-1, 1, 401)] * 2)
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)[x**2 + y**2 < 0.95**2]
    reached = normals[(normals @ (FACING @ turn.T).T > 0.1).all(axis=1)]
    assert found == pytest.approx(degrees_between(reached @ turn.T, reached).mean(), abs=0.3)


def test_gloss_stains_and_clipping_are_left_out() -> None:
    """A sharp highlight of each light on the matt ball, a dark stain, and an exposure that clips a part of it."""
    image = grey_photograph(SCENE, MIXING, FACING, albedo=0.75, noise=0, levels=None)
    x, y = SCENE.pixels()
    across, up = x - 77.15, 78.1 - y
    normal = np.stack([across, up, np.sqrt(np.clip(55**2 - across**2 - up**2, 0, None))], -1)
    gloss = np.clip(normal @ normalised(FACING + np.array([0, 0, 1])).T / 55, 0, None) ** 300
    image = image + 0.6 * gloss @ MIXING.T
    image[np.hypot(x - 60, y - 95) < 7] *= 0.5
    photo = developed(image * 1.1, 0.003, 4095)
    assert (photo >= 1).any(axis=-1).mean() > 0.03
    found = mixing_from_ball(taken(photo), drawn(), RIG)
    assert np.abs(found.mixing - MIXING).max() < 0.01
    assert 0.005 < found.left_out < 0.15


def test_lights_that_stand_near() -> None:
    """Brightness falls with the square of the distance; the matrix holds at the target."""
    middle = np.array([0.05, -0.02, -1.0])
    scene = Scene([(middle, 0.2)], [], (150, 150), 275)
    places = middle + 0.7 * FACING

    def matt(points: np.ndarray, _aims: np.ndarray, normals: np.ndarray) -> np.ndarray:
        away = places - points[:, None]
        distance = np.linalg.norm(away, axis=-1)
        return 0.4 * np.clip(np.einsum("nki,ni->nk", away, normals), 0, None) * 0.7**2 / distance**3 @ MIXING.T

    image = developed(scene.drawn(0.0, matt), 0.003, 65535)
    camera = Camera("perspective", 150, 150, (275.0, 275.0))
    ball = find_balls(image, camera, radius=0.2, mirror=False)[0]
    found = mixing_from_ball(taken(image), ball, near_rig(places, middle))
    assert np.abs(found.mixing - MIXING).max() < 0.01
    with pytest.raises(InputError, match=r"to see perspective"):
        mixing_from_ball(taken(image), drawn(), near_rig(places, middle))
    with pytest.raises(InputError, match=r"to see perspective"):
        mixing_from_ball_by_light([taken(image)] * 3, drawn(), near_rig(places, middle))


def by_light(albedo: float = 0.5, ambient: float = 0.0) -> list[np.ndarray]:
    """The grey ball under each light alone, all at one exposure."""
    alone = [MIXING * np.eye(3)[light] for light in range(3)]
    return [
        grey_photograph(SCENE, mixing, FACING, albedo=albedo, ambient=ambient, seed=k) for k, mixing in enumerate(alone)
    ]


@pytest.mark.parametrize("ambient", [0.0, 0.05])
def test_a_ball_under_one_light_at_a_time(caplog: pytest.LogCaptureFixture, ambient: float) -> None:
    caplog.set_level("INFO")
    found = mixing_from_ball_by_light([taken(photo) for photo in by_light(ambient=ambient)], drawn(), RIG)
    assert np.abs(found.mixing - MIXING).max() < 0.01
    assert found.ambient == pytest.approx(ambient, abs=0.005)
    assert ("[room-light]" in caplog.text) == (ambient > 0)


@pytest.mark.parametrize("normal", [(0, 0, 1), (0.2, -0.3, 1)])
def test_a_card_under_one_light_at_a_time(normal: Sequence[float]) -> None:
    facing = np.array(normal) / np.linalg.norm(normal)
    mask = np.zeros((60, 80), bool)
    mask[10:50, 10:70] = True
    photos = []
    for light in range(3):
        colour = 0.5 * MIXING[:, light] * (FACING[light] @ facing)
        photos.append(developed(np.where(mask[..., None], colour, 0.9), 0.01, 65535, seed=light))
        photos[-1][20:23, 20:30] *= 0.3  # a pencil stroke
    found = mixing_from_card([taken(photo) for photo in photos], mask, RIG, normal)
    assert np.abs(found.mixing - MIXING).max() < 0.01
    assert found.ball is None


def glossy_photograph(directions: np.ndarray, mixing: np.ndarray, rough: float) -> np.ndarray:
    """A grey ball that is not quite matt, over a pale table, in an 8-bit sRGB photo whose brightest parts clip."""

    def glossy(_places: np.ndarray, _aims: np.ndarray, normals: np.ndarray) -> np.ndarray:
        half = normalised(directions + np.array([0, 0, 1]))
        facing = normals @ directions.T
        gloss = 0.25 * np.clip(normals @ half.T, 0, None) ** (2 / rough**4)
        table = 0.05 * np.clip(0.5 - 0.5 * normals[:, 1:2], 0, 1) * directions[:, 2]
        return (np.clip(facing, 0, 1) ** 0.92 + gloss * (facing > 0) + table) @ mixing.T

    image = SCENE.drawn(0.0, glossy, 2)
    image = image / np.percentile(image[image.sum(-1) > 0], 98)
    return srgb_to_linear(np.rint(linear_to_srgb(image) * 255) / 255).astype(np.float32)


@pytest.mark.parametrize("rough", [0.3, 0.5])
def test_a_real_ball_determines_the_matrix_to_a_tenth(rough: float) -> None:
    """Gloss, light thrown back, lights 2° off, eight bits and clipping at once."""
    off = np.radians(2) * np.array([[0.6, 0.8, 0.0], [-1.0, 0.0, 0.0], [0.3, -0.9, 0.3]])
    photo = taken(glossy_photograph(normalised(FACING + off), MIXING, rough))
    found = mixing_from_ball(photo, drawn(Circle(77.5, 77.85, 55.25)), RIG)
    assert found.determined
    assert np.abs(found.mixing - MIXING).max() < 0.1


def test_lights_by_the_camera_tell_their_strengths_alone(caplog: pytest.LogCaptureFixture) -> None:
    """No edge of a shadow is seen, which would say whose light it is."""
    directions = np.array([around(*angle) for angle in ((12, 0), (15, 70), (10, 140))])
    strengths = np.diag([0.7, 1.0, 0.5])
    found = mixing_from_ball(taken(glossy_photograph(directions, strengths, 0.5)), drawn(), LightRig(directions))
    assert not found.determined
    assert np.array_equal(found.mixing != 0, np.eye(3, dtype=bool))
    assert np.abs(found.mixing - strengths).max() < 0.1
    assert "strengths alone" in caplog.text


@pytest.mark.parametrize(
    "triple",
    [
        ("001", "048", "096"),
        # What is left out of the model is 0.1 to 0.2 wrong there, which parts of the ball tell.
        ("027", "072", "078"),
        ("001", "048", "073"),
    ],
)
def test_a_photographed_ball_determines_the_matrix_or_that_it_does_not(diligent: Path, triple: Sequence[str]) -> None:
    """One-shots of DiLiGenT's ball, which is glossy, with crosstalk that we know, in eight bits."""
    folder = diligent / "ballPNG"
    lights = [int(name) - 1 for name in triple]
    strengths = np.loadtxt(folder / "light_intensities.txt")[lights].mean(axis=1)
    photos = [read_image(folder / f"{name}.png", encoding="linear").pixels.mean(axis=-1) for name in triple]
    image = np.stack(photos, axis=-1) / strengths @ MIXING.T
    mask = read_mask(folder / "mask.png")
    image = np.clip(image / np.percentile(image[mask], 99), 0, 1)
    photo = taken(srgb_to_linear(np.rint(linear_to_srgb(image) * 255) / 255).astype(np.float32))
    ball = ball_from_mask(mask, pixel_camera(mask.shape[1], mask.shape[0]))
    found = mixing_from_ball(photo, ball, LightRig(np.loadtxt(folder / "light_directions.txt")[lights]))
    assert not found.determined or np.abs(found.mixing - MIXING).max() < 0.1


@pytest.mark.parametrize("directions", [FACING * [-1, 1, 1], FACING[[1, 2, 0]]])
def test_lights_that_stand_elsewhere_are_refused(directions: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"does the rig belong to this photo"):
        mixing_from_ball(taken(grey_photograph(SCENE, MIXING, FACING)), drawn(), LightRig(directions))


def test_a_photo_of_something_else_is_refused() -> None:
    x, y = np.meshgrid(np.arange(150), np.arange(150))
    weave = 0.5 + 0.4 * np.stack([np.sin(x / 9), np.sin(y / 7), np.sin((x + y) / 11)], -1)
    with pytest.raises(InputError, match=r"no mixing matrix explains the photo"):
        mixing_from_ball(taken(weave.astype(np.float32)), drawn(), RIG)


def test_bad_photos() -> None:
    image = grey_photograph(SCENE, MIXING, FACING)
    with pytest.raises(InputError, match=r"black.*lights on"):
        mixing_from_ball(taken(np.zeros_like(image)), drawn(), RIG)
    with pytest.raises(InputError, match=r"fewer than 200 pixels .* usable"):
        mixing_from_ball(taken(np.ones_like(image)), drawn(), RIG)
    with pytest.raises(InputError, match=r"fewer than 200 pixels .*circle"):
        mixing_from_ball(taken(image), drawn(Circle(900, 900, 20)), RIG)
