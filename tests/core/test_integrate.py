"""Heights from normals: surfaces known in every pixel, masks of all kinds, and least squares by brute force."""

from collections.abc import Callable

import numpy as np
import pytest
from height_shapes import Surface, off, plane, saddle, spheres, square_camera

from mpsnet_core import Camera, InputError, NormalMap
from mpsnet_core.arrays.mask_regions import labelled
from mpsnet_core.relief.integration.integrate import LOOSE, METHODS, MIN_FACING, Method, integrate

# Its axis does not meet the picture's middle, and its pixels are not square.
WIDE = Camera("perspective", 64, 101, [70.0, 55.0], [25.0, 60.0])


def found(surface: Surface, method: Method, **settings: float) -> np.ndarray:
    return integrate(surface.normals, surface.camera, method=method, **settings).values


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "camera",
    [
        square_camera(64),
        Camera("orthographic", 33, 70, [20.0, 31.0], [3.0, 90.0]),
        Camera("orthographic", 7, 1, [1.0, 1.0]),
        Camera("orthographic", 1, 9, [1.0, 1.0]),
    ],
    ids=["square", "oblong pixels", "one row", "one column"],
)
def test_a_ramp_is_exact(camera: Camera, method: Method) -> None:
    ramp = plane(camera, (0.3, -0.5, 0.8))
    heights = found(ramp, method)
    assert np.abs(heights - (ramp.z - ramp.z.mean())).max() < 1e-4 / camera.focal.min()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("surface", "most"),
    [
        (saddle(square_camera(128)), 0.005),
        (saddle(Camera("orthographic", 128, 91, [64.0, 40.0])), 0.01),
        (spheres(square_camera(255), (0, 0, 0, 1.0), rim=0.3), 0.1),
    ],
    ids=["saddle", "saddle of oblong pixels", "cap of a sphere, up to 72 degrees"],
)
def test_curved_surfaces_are_right_to_a_part_of_a_pixel(surface: Surface, most: float, method: Method) -> None:
    away = off(found(surface, method), surface.z, surface.mask) * surface.camera.focal[0]
    assert away.max() < most


def test_a_whole_ball_is_right_up_to_its_outline() -> None:
    """Where normals are nearly level: the outline's pixels may be off by a few pixels, and pull nothing with them."""
    ball = spheres(square_camera(200), (0, 0, 0, 0.9))
    away = np.abs(found(ball, "fast") * 100 - (ball.z - ball.z[ball.mask].mean()) * 100)
    assert away[ball.mask].mean() < 0.05
    assert away[spheres(ball.camera, (0, 0, 0, 0.9), rim=0.3).mask].max() < 0.1


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("surface", "most"),
    [
        (plane(WIDE, (0.3, -0.4, 0.8), -5.0), 2e-4),
        (spheres(WIDE, (0.1, 0.2, -4, 1.5), rim=0.2), 0.003),
        (spheres(Camera("perspective", 96, 96, [500.0, 480.0]), (0.0, 0.1, -30.0, 2.0), rim=0.2), 1e-3),
    ],
    ids=["plane", "ball before a wide lens", "ball before a long lens"],
)
def test_perspective_depths_have_the_right_ratios(surface: Surface, most: float, method: Method) -> None:
    mean = -surface.z[surface.mask].mean()
    heights = found(surface, method, distance=mean)
    ratio = heights[surface.mask] / surface.z[surface.mask]
    assert np.abs(ratio - 1).mean() < most
    assert np.allclose(found(surface, method)[surface.mask] * mean, heights[surface.mask], rtol=1e-5)


def holes(size: int) -> np.ndarray:
    mask = np.ones((size, size), bool)
    mask[5:20, 8:11] = mask[30, 2:40] = mask[-9, -9] = False
    return mask


def sprinkled(size: int) -> np.ndarray:
    """Some hundred pieces, many of one pixel or touching at corners only."""
    return np.random.default_rng(2).random((size, size)) < 0.55


def spiral(size: int) -> np.ndarray:
    """A path one pixel wide, with a pixel's gap between its windings."""
    mask = np.zeros((size, size), bool)
    row, column, step = 0, 0, np.array([0, 1])
    for length in [size - 1] * 3 + [n for n in range(size - 3, 0, -2) for _ in (0, 1)]:
        for _ in range(length):
            mask[row, column] = True
            row, column = np.array([row, column]) + step
        step = np.array([step[1], -step[0]])
    return mask


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("shape", "most"), [(holes, 0.02), (sprinkled, 0.02), (spiral, 0.25)])
def test_every_piece_of_a_mask_is_right(shape: Callable[[int], np.ndarray], most: float, method: Method) -> None:
    """Each about its own mean, in pixels; those of one pixel are at 0."""
    surface = saddle(square_camera(48)).masked(shape(48))
    labels, sizes = labelled(surface.mask)
    heights = found(surface, method)
    for piece in range(1, len(sizes)):
        truth = surface.z[labels == piece]
        assert np.abs(heights[labels == piece] - (truth - truth.mean())).max() * 24 < most
    assert (heights[~surface.mask] == 0).all()


def test_pieces_before_a_lens_have_the_distance_as_their_mean() -> None:
    ball = spheres(WIDE, (0.1, 0.2, -4, 1.5))
    mask = ball.mask.copy()
    mask[50] = mask[:, 30] = False
    mask[50, 30] = True
    labels, sizes = labelled(mask)
    heights = found(ball.masked(mask), "fast", distance=2.5)
    assert len(sizes) == 6 and sizes.min() == 1
    assert [heights[labels == piece].mean() for piece in range(1, 6)] == pytest.approx([-2.5] * 5, rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("turned", [(0, 0, -1), (1, 0, 0), (0.6, 0, -0.8)])
def test_normals_that_no_camera_sees_spoil_nothing_else(turned: tuple[float, float, float], method: Method) -> None:
    """One pixel in fifty looks away or sideways; the others are right to a fifth of a pixel."""
    surface = saddle(square_camera(64))
    bad = np.random.default_rng(0).random(surface.mask.shape) < 0.02
    vectors = np.where(bad[..., None], turned, surface.normals.vectors)
    heights = integrate(NormalMap(vectors, surface.mask), surface.camera, method=method).values
    assert off(heights, surface.z, ~bad).max() * 32 < 0.2


def brute_force(normals: NormalMap) -> np.ndarray:
    """The fast method's equations for a camera of pixels, one at a time, by a dense solver in float64."""
    mask, number = normals.mask, np.cumsum(normals.mask).reshape(normals.mask.shape) - 1
    n_x, n_y, n_z = np.moveaxis(normals.vectors.astype(float), -1, 0)
    facing = np.maximum(n_z, MIN_FACING)
    height, width = mask.shape
    rows: list[np.ndarray] = []
    aims: list[float] = []

    def inside(*pixels: tuple[int, int]) -> bool:
        return all(0 <= r < height and 0 <= c < width and mask[r, c] for r, c in pixels)

    def change(one: tuple[int, int], other: tuple[int, int]) -> float:
        """Of height, from one pixel to the next on its right or below, as both ask for it."""
        asked = -n_x if one[0] == other[0] else n_y
        return (facing[one] * asked[one] + facing[other] * asked[other]) / (facing[one] ** 2 + facing[other] ** 2)

    def loose(r: int, c: int) -> float:
        """By how much the loop with (r, c) as its upper left pixel does not close."""
        corners = (r, c), (r, c + 1), (r + 1, c), (r + 1, c + 1)
        if not inside(*corners):
            return 0.0
        a, b, d, e = corners
        return abs(change(a, b) + change(b, e) - change(d, e) - change(a, d))

    for r, c in np.argwhere(mask):
        for other, asked, loops in (((r, c + 1), -n_x, ((r - 1, c), (r, c))), ((r + 1, c), n_y, ((r, c - 1), (r, c)))):
            if not inside(other):
                continue
            trust = min(1 / (1 + (loose(*loop) / float(LOOSE)) ** 2) for loop in loops)
            for pixel in ((r, c), other):
                row = np.zeros(mask.sum())
                row[number[other]], row[number[r, c]] = facing[pixel], -facing[pixel]
                rows.append(row * np.sqrt(trust))
                aims.append(asked[pixel] * np.sqrt(trust))
    solution = np.zeros(mask.shape)
    # Of all solutions the shortest, in which every piece's mean is 0.
    solution[mask] = np.linalg.lstsq(np.array(rows), np.array(aims), rcond=1e-9)[0]
    return solution


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_it_is_the_least_squares_solution(seed: int) -> None:
    """Of normals at random, which are no surface's, in a mask at random."""
    rng = np.random.default_rng(seed)
    vectors = rng.normal(size=(11, 14, 3)) * 0.3 + (0, 0, 1)
    normals = NormalMap(vectors, rng.random((11, 14)) < 0.85)
    assert np.abs(integrate(normals).values - brute_force(normals)).max() < 2e-3


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"camera": square_camera(8)}, "the camera is 8 x 8 but the normal map is 9 x 6; they must be"),
        ({"method": "slow"}, "method 'slow' is not known; choose fast or bilateral"),
        ({"distance": 0.0}, "the distance must be a number above 0, not 0.0"),
        ({"distance": np.nan}, "the distance must be a number above 0, not nan"),
        ({"distance": 2.0}, "an orthographic camera sees no distance; leave it out"),
    ],
)
def test_what_does_not_fit_is_reported(settings: dict, said: str) -> None:
    normals = NormalMap(np.ones((6, 9, 3)), np.ones((6, 9), bool))
    with pytest.raises(InputError, match=said):
        integrate(normals, **settings)


def strip(size: int, wide: int) -> np.ndarray:
    """Rows of so many pixels, each joined to the next at one end: far away where hanging together is concerned."""
    mask = np.zeros((size, size), bool)
    for number, row in enumerate(range(0, size - wide, wide + 1)):
        mask[row : row + wide] = True
        mask[row + wide, slice(0, 3) if number % 2 else slice(size - 3, size)] = True
    return mask


def test_a_long_strip_is_right(caplog: pytest.LogCaptureFixture) -> None:
    """To half a pixel, and so nothing is said; the iterations that many photos need are too few for it."""
    surface = saddle(square_camera(256)).masked(strip(256, 3))
    with caplog.at_level("INFO"):
        heights, truth = found(surface, "fast")[surface.mask], surface.z[surface.mask]
    assert np.abs(heights - (truth - truth.mean())).max() * 128 < 0.5
    assert not caplog.messages


def test_heights_that_are_off_are_reported(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """As the solver leaves them where it ends too early."""
    for name in ("MAX_ITERATIONS", "MIN_ITERATIONS"):
        monkeypatch.setattr(f"mpsnet_core.relief.integration.poisson.{name}", 10)
    surface = saddle(square_camera(128))
    with caplog.at_level("INFO"):
        found(surface, "fast")
        assert not caplog.messages
        found(surface.masked(strip(128, 3)), "fast")
    assert "use a mask without these strips, or a smaller image" in " ".join(caplog.messages)
