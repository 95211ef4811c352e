"""The focal length that a photo's EXIF data state, and what they may be that is of no use."""

import logging
import math
from pathlib import Path

import pytest
from exif import write_jpeg

from mpsnet_core.io.focal_length import stated_focal

# Of a sensor of 23.4 x 15.6 mm with 6,000 x 4,000 pixels.
SENSOR = {
    "FocalPlaneXResolution": 6000 / 2.34,
    "FocalPlaneResolutionUnit": 3,
    "PixelXDimension": 6000,
    "PixelYDimension": 4000,
}


@pytest.mark.parametrize(
    ("size", "values", "focal"),
    [
        ((60, 40), {"FocalLengthIn35mmFilm": 50}, 50),
        ((40, 60), {"FocalLengthIn35mmFilm": 50, "FocalLength": 33}, 50),
        # 26 mm of a phone are by the diagonal: half of it is seen at atan(21.63 / 26) from the axis.
        ((80, 60), {"FocalLengthIn35mmFilm": 26}, 18 / (0.8 * math.hypot(36, 24) / 2 / 26)),
        ((60, 40), {"FocalLength": 35, **SENSOR}, 35 * 36 / 23.4),
        ((40, 60), {"FocalLength": 35, **SENSOR}, 35 * 36 / 23.4),
        ((60, 40), {"FocalLengthIn35mmFilm": 0, "FocalLength": 35, **SENSOR}, 35 * 36 / 23.4),
        (
            (60, 40),
            {"FocalLength": 35, **SENSOR, "FocalPlaneXResolution": 6000 / 23.4 * 25.4, "FocalPlaneResolutionUnit": 2},
            35 * 36 / 23.4,
        ),
        ((60, 40), {"FocalLength": 35}, None),
        ((60, 40), {"FocalLengthIn35mmFilm": 0}, None),
        ((60, 40), {"FocalLength": 35, **SENSOR, "FocalPlaneXResolution": 3}, None),  # a sensor of 20 m
        ((60, 40), {"FocalLength": 35, **SENSOR, "FocalPlaneResolutionUnit": 9}, None),
    ],
)
def test_the_focal_length_along_the_longer_side(
    tmp_path: Path, size: tuple[int, int], values: dict[str, float], focal: float | None
) -> None:
    found = stated_focal(write_jpeg(tmp_path / "a.jpg", size, values))
    assert found == (None if focal is None else pytest.approx(focal, rel=1e-3))


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"FocalLengthIn35mmFilm": 1}, "a.jpg states a lens of 1 mm (EXIF), which no camera has; it is not used"),
        ({"FocalLengthIn35mmFilm": 50, "PixelXDimension": 4000, "PixelYDimension": 6000, "FocalLength": 33}, ""),
        ({"FocalLengthIn35mmFilm": 50, "PixelXDimension": 4000, "PixelYDimension": 4000}, "a.jpg was cropped from"),
    ],
)
def test_what_no_lens_has_and_a_cropped_photos_lens_are_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, values: dict[str, float], sentence: str
) -> None:
    with caplog.at_level(logging.INFO):
        found = stated_focal(write_jpeg(tmp_path / "a.jpg", (60, 40), values))
    assert (found is None) == bool(sentence)
    assert sentence in caplog.text


def test_a_file_without_exif_data_states_none(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"no image")
    assert stated_focal(tmp_path / "a.jpg") is None
    assert stated_focal(tmp_path / "none.jpg") is None
