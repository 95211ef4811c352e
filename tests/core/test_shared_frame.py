"""Photos between which the camera did not move share its sensor's frame, whatever orientation their files state."""

import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from synthetic import write_file

from mpsnet_core import as_channels, published_rig, read_capture, read_correction, read_image, superpose
from mpsnet_core.calibrate.photos import BallPhotos
from mpsnet_core.capture.decode import corrected

RNG = np.random.default_rng(5)
# What the sensor sees: not square, and without symmetry.
PHOTO, OTHER, LEVEL = (np.float32(scale) * RNG.uniform(0.3, 1, (24, 36, 3)) for scale in (0.8, 0.7, 0.1))
LEVEL[4:9, 20:30] *= 2


class Shots:
    """Files with the sensor's pixels as they are, and the orientation that each states."""

    def __init__(self, folder: Path, first: int, second: int) -> None:
        self._folder, self._first, self._second = folder, first, second

    def first(self, values: np.ndarray = PHOTO) -> Path:
        return write_file(self._folder / "first.tif", values, "float", Orientation=self._first)

    def second(self, values: np.ndarray) -> Path:
        return write_file(self._folder / "second.tif", values, "float", Orientation=self._second)


def channels(shots: Shots) -> np.ndarray:
    return as_channels([shots.first(), shots.second(OTHER), shots.first()], encoding="linear").pixels


def added_up(shots: Shots) -> np.ndarray:
    return superpose([shots.first(), shots.second(OTHER)], encoding="linear").pixels


def dark(shots: Shots) -> np.ndarray:
    return corrected(read_image(shots.first()), read_correction(shots.second(LEVEL), encoding="linear")).pixels


def flat(shots: Shots) -> np.ndarray:
    return corrected(read_image(shots.first()), read_correction(flat=shots.second(LEVEL), encoding="linear")).pixels


def dark_of_a_flat(shots: Shots) -> np.ndarray:
    both = read_correction(shots.second(LEVEL / 4), shots.first(PHOTO), encoding="linear")
    return corrected(read_image(shots.first()), both).pixels


def white(shots: Shots) -> np.ndarray:
    capture = read_capture(shots.first(), published_rig(), mask="none", encoding="linear", white=shots.second(OTHER))
    assert capture.white is not None
    return capture.white


def background(shots: Shots) -> np.ndarray:
    empty = PHOTO.copy()
    empty[8:16, 6:20] *= 0.05
    choice = f"background:{shots.second(empty)}"
    return read_capture(shots.first(), published_rig(), mask=choice, encoding="linear").mask[..., None]


def one_light_each(shots: Shots) -> np.ndarray:
    return [*BallPhotos([shots.first(), shots.second(OTHER)]).read()][1].pixels


UPRIGHT: dict[int, Callable[[np.ndarray], np.ndarray]] = {
    1: lambda stored: stored,
    3: lambda stored: stored[::-1, ::-1],
    6: lambda stored: np.rot90(stored, -1),
    8: lambda stored: np.rot90(stored),
}


@pytest.mark.parametrize(
    "together", [channels, added_up, dark, flat, dark_of_a_flat, white, background, one_light_each]
)
@pytest.mark.parametrize(("first", "second"), [(1, 3), (1, 6), (6, 8), (3, 1), (8, 1)])
def test_the_first_ones_orientation_is_that_of_all(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, together: Callable[[Shots], np.ndarray], first: int, second: int
) -> None:
    caplog.set_level(logging.INFO)
    expected = together(Shots(tmp_path, 1, 1))
    assert "orientation" not in caplog.text
    found = together(Shots(tmp_path, first, second))
    np.testing.assert_allclose(found, UPRIGHT[first](expected), rtol=1e-6)
    assert ("orientation" in caplog.text) == (together not in (dark, flat))


def test_an_image_that_a_program_has_turned_is_not_turned_again(tmp_path: Path) -> None:
    """It has no tag any more, but the shape of the others as shown."""
    shots = Shots(tmp_path, 6, 1)
    turned = UPRIGHT[6](OTHER)
    found = as_channels([shots.first(), shots.second(turned), shots.first()], encoding="linear").pixels
    np.testing.assert_allclose(found[..., 1], turned.mean(axis=-1), rtol=1e-5)
