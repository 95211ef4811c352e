"""Lights by mirror balls: against photographs that are traced ray by ray, with lamps whose places are known."""

from collections.abc import Sequence

import numpy as np
import pytest
from external_data import external_data
from mirror_ball import CROSSTALK, Scene, around, developed, grey_photograph, lamps_around, photograph, taken
from synthetic import degrees_between

from mpsnet_core import InputError, read_image, read_mask
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.calibrate.ball import ball_from_mask, fit_ball
from mpsnet_core.calibrate.circles import find_balls
from mpsnet_core.calibrate.highlights import Highlight, find_coloured_highlights, find_highlight
from mpsnet_core.calibrate.lights import LightsFound, Sighting, find_lights
from mpsnet_core.io.image import Image
from mpsnet_core.scene.camera import Camera, pixel_camera

pytestmark = pytest.mark.accuracy

FAR = 1e6
MIDDLE = (20.3, -11.7, 0.0)
ANGLES = [(30, 90), (35, 205), (25, 335)]
FACING = np.array([around(*angle) for angle in ANGLES])


def afar(angles: Sequence[tuple[float, float]] = ANGLES, degrees: float = 5.0, radius: float = 97.4) -> Scene:
    """A ball before an orthographic camera, under lamps at infinity."""
    return Scene([(MIDDLE, radius)], lamps_around(MIDDLE, FAR, degrees, angles))


def pinhole(scene: Scene) -> Camera:
    return Camera("perspective", *scene.size, np.full(2, scene.focal))


def lights_of(image: np.ndarray, camera: Camera, *, count: int = 1, radius: float = 1.0) -> LightsFound:
    balls = find_balls(image, camera, count=count, radius=radius)
    return find_lights([Sighting(ball, find_coloured_highlights(taken(image), ball)) for ball in balls])


@pytest.mark.parametrize("seed", range(2))
def test_a_ball_in_much_noise_is_found(clean: np.ndarray, seed: int) -> None:
    """The noise is three times as strong as the outline, pixel by pixel; edges of noise fit many circles."""
    circle = find_balls(developed(clean, 0.3, 65535, seed), pixel_camera(400, 300))[0].circle
    assert (circle.x, circle.y, circle.radius) == pytest.approx((220.3, 161.7, 97.4), abs=0.5)


@pytest.fixture(scope="module")
def clean() -> np.ndarray:
    return photograph(afar(), noise=0, levels=None)


@pytest.mark.parametrize("seed", range(2))
def test_a_lamp_in_noise_is_no_ball(seed: int) -> None:
    room = np.full((300, 400, 3), 0.1)
    room[150:158, 200:208] = 0.9
    with pytest.raises(InputError, match="no ball was found"):
        find_balls(developed(room, 0.1, None, seed), pixel_camera(400, 300))


def test_a_circle_in_the_balls_place_that_may_be_the_ball_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    x, y = np.meshgrid(np.arange(240) + 0.5, np.arange(200) + 0.5)
    ball, window, lamp = (np.hypot(x - a, y - b) < r for a, b, r in [(120, 100, 80), (110, 108, 55), (105, 105, 4)])
    image = np.float32(0.1 + 0.05 * ball + 0.9 * lamp)
    camera = pixel_camera(240, 200)
    assert find_balls(np.dstack([image] * 3), camera)[0].circle.radius == pytest.approx(80, abs=0.5)
    assert "may be" not in caplog.text
    find_balls(np.dstack([image + np.float32(0.05 * window)] * 3), camera)
    assert "the ball may be the circle 120,100,80 or 110,108,55" in caplog.text


@pytest.mark.parametrize(
    "options",
    [{"levels": 255}, {"levels": None}, {"white_lamp": (np.array(MIDDLE) + FAR * around(40, 20), 6e4, 0.8)}],
    ids=["8 bits", "floats", "a white lamp in the mirror, which is no light"],
)
def test_a_ball_is_found_to_a_part_of_a_pixel_and_directions_afar(options: dict, caplog) -> None:
    scene = afar()
    found = lights_of(photograph(scene, **options), pixel_camera(*scene.size))
    circle = found.sightings[0].ball.circle
    assert (circle.x, circle.y, circle.radius) == pytest.approx((220.3, 161.7, 97.4), abs=0.15)
    assert "as on a matt one" not in caplog.text
    assert degrees_between(found.directions, FACING).max() < 0.5
    assert found.positions is None
    assert (degrees_between(found.directions, FACING) < 3 * found.uncertainties).all()
    assert (found.uncertainties < 1).all()


def test_what_a_lens_that_nobody_gave_does_is_within_the_uncertainty() -> None:
    """Balls anywhere before lenses of 24 to 200 mm, taken as far away: two in three within one deviation."""
    random = np.random.default_rng(5)
    width, height = 600, 400
    off, told, known = [], [], []
    for focal in np.exp(random.uniform(np.log(24), np.log(200), 150)) / 36 * width:
        size = random.uniform(40, 150)
        axis = np.append(random.uniform(size, np.array([width, height]) - size) - (width / 2, height / 2), -focal)
        middle = axis / np.linalg.norm(axis) * np.sqrt(1 + (focal / size) ** 2)
        lights = np.array([around(random.uniform(10, 50), turn) for turn in random.uniform(0, 360, 3)])
        # Where a ball of radius 1 mirrors each: its normal halves the angle between the light and the way back.
        places = np.repeat(middle[None], 3, axis=0)
        for _ in range(60):
            places = middle + normalised(lights - normalised(places))
        spots = places[:, :2] / -places[:, 2:] * (focal, -focal) + (width / 2, height / 2)
        turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)[:, None]
        ahead = normalised(middle)
        right = normalised(np.cross(ahead, [0.0, 1.0, 0.0]))
        sine = 1 / np.linalg.norm(middle)
        rim = np.sqrt(1 - sine**2) * ahead + sine * (np.cos(turn) * right + np.sin(turn) * np.cross(right, ahead))
        outline = rim[:, :2] / -rim[:, 2:] * (focal, -focal) + (width / 2, height / 2)
        ball = fit_ball(outline, pixel_camera(width, height))
        seen = tuple(Highlight(x, y, 2.0, 0.05, False, 0.0, (1.0, 1.0, 1.0)) for x, y in spots)
        found = find_lights([Sighting(ball, seen, lens_known=False)])
        off.append(degrees_between(found.directions, lights))
        told.append(found.uncertainties)
        known.append(find_lights([Sighting(ball, seen)]).uncertainties)
    share = np.ravel(off) / np.ravel(told)
    print(f"within 1, 2, 3 deviations: {(share < 1).mean():.0%}, {(share < 2).mean():.0%}, {(share < 3).mean():.1%}")
    assert 0.63 < (share < 1).mean() < 0.78
    assert (share < 2).mean() > 0.95
    assert np.mean(known) < 0.3 * np.mean(told), "what is added is the lens's"


@pytest.mark.parametrize("middle, radius", [((0.12, -0.08, -1.0), 0.14), ((0.22, -0.12, -1.0), 0.10)])
def test_directions_in_perspective(middle: Sequence[float], radius: float) -> None:
    """At the photo's side, even across its border, where a ball's outline is an ellipse and the view is oblique."""
    scene = Scene([(middle, radius)], lamps_around(middle, FAR, 5, ANGLES), focal=700)
    image = photograph(scene, fine=3)
    found = lights_of(image, pinhole(scene), radius=radius)
    assert degrees_between(found.directions, FACING).max() < 0.5
    assert found.sightings[0].ball.centre == pytest.approx(middle, abs=0.003)
    # Taken as far away, the same photo misleads by the angle at which the ball is seen.
    assert degrees_between(lights_of(image, pixel_camera(*scene.size)).directions, FACING).min() > 4


def near_scene(distance: float = 0.8) -> tuple[Scene, np.ndarray]:
    """Two balls, and lamps so far from the middle between them."""
    left, right = (-0.17, -0.02, -0.9), (0.16, -0.03, -0.85)
    middle = (np.array(left) + right) / 2
    lamps = lamps_around(middle, distance)
    return Scene([(left, 0.1), (right, 0.1)], lamps, (450, 300), 675), np.array([place for place, _ in lamps])


def test_two_balls_give_positions() -> None:
    scene, places = near_scene()
    found = lights_of(photograph(scene), pinhole(scene), count=2, radius=0.1)
    assert found.positions is not None and found.position_uncertainties is not None and found.gaps is not None
    off = np.linalg.norm(found.positions - places, axis=1)
    assert (off < 0.02 * 0.8).all()
    assert (off < 3 * found.position_uncertainties).all()
    assert (found.gaps < found.position_uncertainties).all()
    assert degrees_between(found.directions, places - found.target).max() < 0.5


def lights_of_two_photos(scene: Scene, radius: float, moved: Sequence[float] = (0.0, 0.0, 0.0)) -> LightsFound:
    """Of each ball alone, the lamps moved in between."""
    sightings = []
    for number, ball in enumerate(scene.balls):
        lamps = [(place + number * np.array(moved), size) for place, size in scene.lamps]
        image = photograph(Scene([ball], lamps, scene.size, scene.focal))
        seen = find_balls(image, pinhole(scene), radius=radius)[0]
        sightings.append(Sighting(seen, find_coloured_highlights(taken(image), seen)))
    return find_lights(sightings)


def test_two_photos_of_one_ball_give_the_same_positions_in_the_balls_unit() -> None:
    scene, places = near_scene()
    found = lights_of_two_photos(scene, 100.0)
    assert found.positions is not None
    assert np.linalg.norm(found.positions - 1000 * places, axis=1).max() < 0.02 * 800


def test_lights_far_from_two_balls_keep_their_directions(caplog: pytest.LogCaptureFixture) -> None:
    scene, _ = near_scene(100.0)
    caplog.set_level("INFO")
    found = lights_of(photograph(scene), pinhole(scene), count=2, radius=0.1)
    assert found.positions is None
    assert degrees_between(found.directions, FACING).max() < 0.5
    assert "nearly parallel" in caplog.text


def test_rays_that_miss_each_other_are_reported(caplog: pytest.LogCaptureFixture) -> None:
    lights_of_two_photos(near_scene()[0], 0.1, moved=(0.0, 0.2, 0.1))
    assert "miss each other" in caplog.text


TOUCHING = [(30, 90), (30, 101), (24, 95)]
OVERLAPPING = [(30, 90), (30, 99), (25.5, 95)]


@pytest.mark.parametrize(
    "angles, options",
    [
        (ANGLES, {"brightness": 2.0}),  # clipped, but for the crosstalk
        (ANGLES, {"brightness": 2.0, "fine": 1}),  # so sharp that no pixel at their rims is darker
        (ANGLES, {"brightness": 0.7, "colours": CROSSTALK * [1, 0.3, 0.15]}),  # red in the blue outshines blue
        (ANGLES, {"brightness": 0.8, "colours": CROSSTALK[[2, 0, 1]][:, [2, 0, 1]], "levels": 255}),
        (TOUCHING, {"brightness": 0.8}),
        (TOUCHING, {"brightness": 2.0}),
        (OVERLAPPING, {"brightness": 0.7}),
    ],
)
def test_three_colours_in_one_photo(angles: Sequence[tuple[float, float]], options: dict) -> None:
    scene = afar(angles, degrees=6.0)
    found = lights_of(photograph(scene, **options), pixel_camera(*scene.size))
    truth = np.array([around(*angle) for angle in angles])
    assert degrees_between(found.directions, truth).max() < 1
    assert {spot.clipped for spot in found.sightings[0].highlights} == {options["brightness"] > 1}


def test_clipped_highlights_that_overlap_are_known_to_be_unsure() -> None:
    scene = afar(OVERLAPPING, degrees=6.0)
    found = lights_of(photograph(scene, brightness=2.0), pixel_camera(*scene.size))
    truth = np.array([around(*angle) for angle in OVERLAPPING])
    assert (degrees_between(found.directions, truth) < 3 * found.uncertainties).all()
    assert found.uncertainties.max() > 1


def test_clipping_that_the_photo_shows_by_itself() -> None:
    """Camera raw says of each channel where it is at its end; white balance then takes the ends apart."""
    scene = afar(degrees=6.0)
    image = photograph(scene, brightness=2.0)
    gains = np.array([1.9, 1.0, 1.4], np.float32)
    ball = find_balls(image, pixel_camera(*scene.size))[0]
    told = Image(image * gains, None, np.inf, clipped=image >= 1)
    found = find_lights([Sighting(ball, find_coloured_highlights(told, ball))])
    assert degrees_between(found.directions, FACING).max() < 0.7
    assert all(spot.clipped for spot in found.sightings[0].highlights)


def test_a_matt_ball_in_place_of_the_mirror_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    scene = afar()
    lights_of(grey_photograph(scene, CROSSTALK, FACING), pixel_camera(*scene.size))
    assert caplog.text.count("as on a matt one") == 3


def test_a_fourth_light_that_is_as_bright_is_reported(caplog: pytest.LogCaptureFixture) -> None:
    fourth = (np.array(MIDDLE) + FAR * around(50, 150), FAR * np.tan(np.radians(2.5)))
    scene = Scene([(MIDDLE, 97.4)], [*afar().lamps, fourth])
    colours = np.concatenate([CROSSTALK, 0.9 * CROSSTALK[:, :1]], axis=1)
    lights_of(photograph(scene, colours=colours), pixel_camera(*scene.size))
    assert "light 1: another spot on the ball" in caplog.text and "light 2" not in caplog.text


def test_one_photo_a_light_of_any_number_of_white_lights() -> None:
    angles = [(10 + 8 * k, 70 * k) for k in range(7)]
    scene = afar(angles, degrees=6.0)
    white = np.ones((3, 7))
    photos = [photograph(scene, white, on=[k], brightness=3.0, seed=k) for k in range(7)]
    ball = find_balls(np.mean(photos, axis=0), pixel_camera(*scene.size))[0]
    found = find_lights([Sighting(ball, tuple(find_highlight(taken(photo), ball) for photo in photos))])
    truth = np.array([around(*angle) for angle in angles])
    assert degrees_between(found.directions, truth).max() < 0.5


def test_lights_of_one_colour_cannot_be_told_apart() -> None:
    scene = afar()
    image = photograph(scene, np.ones((3, 3)))
    ball = find_balls(image, pixel_camera(*scene.size))[0]
    with pytest.raises(InputError, match=r"do not differ in colour.*each light alone"):
        find_coloured_highlights(taken(image), ball)
    blown = photograph(scene, brightness=20.0)
    with pytest.raises(InputError, match=r"do not differ in colour.*expose so that they do not clip"):
        find_coloured_highlights(taken(blown), ball)


def test_a_mask_that_also_holds_the_stand() -> None:
    x, y = np.meshgrid(np.arange(200) + 0.5, np.arange(200) + 0.5)
    mask = (np.hypot(x - 97.3, y - 88.8) < 70.6) | ((np.abs(x - 97) < 15) & (y > 88))
    circle = ball_from_mask(mask, pixel_camera(200, 200)).circle
    assert (circle.x, circle.y, circle.radius) == pytest.approx((97.3, 88.8, 70.6), abs=0.2)
    with pytest.raises(InputError, match="shows no ball"):
        ball_from_mask(np.zeros((50, 50), bool), pixel_camera(50, 50))


# --- photographs ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def chrome() -> tuple[list[np.ndarray], np.ndarray]:
    """Photographs of a mirror ball under twelve lights, one each, and its mask."""
    folder = external_data("captures/chrome")
    photos = [read_image(folder / f"chrome.{k}.png").pixels for k in range(12)]
    return photos, read_mask(folder / "chrome.mask.png")


@pytest.mark.parametrize("by_mask", [True, False])
def test_a_mirror_ball_under_the_found_lights_shines_where_the_photographs_do(
    chrome: tuple[list[np.ndarray], np.ndarray], by_mask: bool
) -> None:
    photos, mask = chrome
    height, width = mask.shape
    camera = pixel_camera(width, height)
    ball = ball_from_mask(mask, camera) if by_mask else find_balls(np.mean(photos, axis=0), camera)[0]
    found = find_lights([Sighting(ball, tuple(find_highlight(taken(photo), ball) for photo in photos))])
    assert len(found.directions) == 12
    assert (found.directions[:, 2] > 0).all()
    circle = ball.circle
    middle = (circle.x - width / 2, height / 2 - circle.y, 0.0)
    for photo, direction in zip(photos, found.directions, strict=True):
        lamp = (np.array(middle) + FAR * direction, FAR * np.tan(np.radians(3)))
        drawn = photograph(Scene([(middle, circle.radius)], [lamp], (width, height)), np.ones((3, 1)), room=0)
        rows, columns = np.nonzero(drawn.max(axis=-1) > 0.4)
        bright_rows, bright_columns = np.nonzero(photo.max(axis=-1) > 0.9)
        apart = np.hypot(rows.mean() - bright_rows.mean(), columns.mean() - bright_columns.mean())
        assert apart < 1
