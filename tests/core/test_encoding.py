"""A photo whose file does not say that its values are linear: told where the shading tells it, and never otherwise."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from synthetic import Sphere, shaded_sphere

from mpsnet_core.capture import read_capture
from mpsnet_core.images import linear_to_srgb

PAINTS = {
    "matt": lambda x, y: np.ones(3),
    "of one colour": lambda x, y: np.array([0.9, 0.6, 0.4]),
    "painted": lambda x, y: (0.5 + 0.3 * np.sin(7 * x + 5 * y))[..., None],
    "painted in colours": lambda x, y: np.dstack([0.5 + 0.3 * np.sin(5 * x), 0.5 + 0.3 * np.cos(4 * y), 0.5 + 0.2 * x]),
}


def written(path: Path, pixels: np.ndarray) -> Path:
    """Eight bits, without a word about their curve."""
    source = oiio.ImageBuf(np.rint(np.clip(pixels, 0, 1) * 255).astype(np.uint8))
    source.specmod().erase_attribute("oiio:ColorSpace")
    assert source.write(str(path))
    return path


@pytest.fixture(scope="module")
def sphere() -> Sphere:
    return shaded_sphere(160)


@pytest.mark.parametrize("paint", PAINTS)
@pytest.mark.parametrize("linear", [True, False])
def test_linear_values_are_told_on_one_paint_and_srgb_never(
    tmp_path: Path, sphere: Sphere, caplog: pytest.LogCaptureFixture, paint: str, linear: bool
) -> None:
    x, y = np.meshgrid(np.linspace(-1, 1, 160), np.linspace(1, -1, 160))
    pixels = sphere.image * PAINTS[paint](x, y)
    photo = written(tmp_path / "photo.png", pixels if linear else linear_to_srgb(pixels))
    read_capture(photo, sphere.rig, mask="threshold:0.02")
    assert ("--encoding linear" in caplog.text) == (linear and not paint.startswith("painted"))


def test_what_the_user_said_is_not_doubted(tmp_path: Path, sphere: Sphere, caplog: pytest.LogCaptureFixture) -> None:
    photo = written(tmp_path / "photo.png", sphere.image)
    read_capture(photo, sphere.rig, mask="threshold:0.02", encoding="srgb")
    assert "--encoding linear" not in caplog.text
