"""Light from elsewhere, on a matt ball whose normals and light are known."""

from pathlib import Path

import numpy as np
import pytest
from synthetic import CROSSTALK, shaded_sphere, write_file

from mpsnet_core import Capture, LightRig, NormalMap, estimate_normals, published_rig, write_rig
from mpsnet_core.estimate.ambient_light import shadow_brightness, warn_of_ambient_light

RIG = LightRig(published_rig(45).directions)
BALL = shaded_sphere(200, RIG)
SURE = NormalMap(BALL.normals.astype(np.float32), BALL.mask, np.full(BALL.mask.shape, 0.98, np.float32))
PAINTED = np.where(np.arange(200)[:, None, None] < 120, [0.9, 0.6, 0.3], [0.2, 0.3, 0.7]).astype(np.float32)


def lit_by(ambient: float, colour: float | np.ndarray = 1.0) -> Capture:
    """The ball, of which each channel also shows this share of its light where the light does not reach."""
    return BALL.capture(image=((BALL.image + 0.8 * ambient) * colour).astype(np.float32))


@pytest.mark.parametrize("colour", [1.0, PAINTED], ids=["grey", "painted"])
@pytest.mark.parametrize("ambient", [0.0, 0.1, 0.3])
def test_shadows_are_as_bright_as_the_ambient_light(ambient: float, colour: float | np.ndarray) -> None:
    found = shadow_brightness(lit_by(ambient, colour), SURE)
    # Where it is lit, the ambient light is there too; and paint differs from place to place.
    assert found is not None and 0.5 * ambient <= found <= 1.4 * ambient + 1e-6


def test_crosstalk_that_the_rig_does_not_say_is_light_from_elsewhere_too(caplog: pytest.LogCaptureFixture) -> None:
    mixed = (BALL.image @ np.transpose(CROSSTALK)).astype(np.float32)
    warn_of_ambient_light(BALL.capture(image=mixed, rig=LightRig(RIG.directions, np.array(CROSSTALK))), SURE)
    assert not caplog.records
    warn_of_ambient_light(BALL.capture(image=mixed), SURE)
    assert "[room-light]" in caplog.text


def test_nothing_is_known_of_normals_that_are_unsure_or_face_the_lights() -> None:
    unsure = NormalMap(SURE.vectors, BALL.mask, np.full(BALL.mask.shape, 0.3, np.float32))
    assert shadow_brightness(lit_by(0.3), unsure) is None
    faces = BALL.normals[..., 2] > 0.8
    assert shadow_brightness(lit_by(0.3), NormalMap(SURE.vectors, faces, SURE.confidence)) is None


@pytest.mark.parametrize("ambient", [0.0, 0.05, 0.12, 0.15])
def test_the_outline_tells_where_normals_never_face_away(ambient: float, caplog: pytest.LogCaptureFixture) -> None:
    photo = lit_by(ambient)
    warn_of_ambient_light(photo, estimate_normals(photo, "lambertian"))
    assert ("[room-light]" in caplog.text) == (ambient > 0.1)


@pytest.mark.parametrize("steepest", [20, 45, 70])
def test_a_dome_whose_rim_the_lights_reach_is_not_in_ambient_light(steepest: float, caplog) -> None:
    """It has no attached shadows, as far as it is flat enough."""
    y, x = np.mgrid[-1:1:200j, -1:1:200j]
    x, y = (np.sin(np.radians(steepest)) / 0.95 * axis for axis in (x, -y))
    normals = np.stack([x, y, np.sqrt(np.clip(1 - x**2 - y**2, 0, 1))], axis=-1)
    light = np.maximum(normals @ RIG.directions.T, 0).astype(np.float32)
    photo = Capture(light, np.hypot(x, y) < np.sin(np.radians(steepest)), RIG)
    warn_of_ambient_light(photo, estimate_normals(photo, "lambertian"))
    assert not caplog.records


@pytest.mark.parametrize("ambient", [0.0, 0.2])
def test_estimate_warns(ambient: float, tmp_path: Path, mpsnet) -> None:
    photo = write_file(tmp_path / "photo.exr", lit_by(ambient).image, "float")
    mask = write_file(tmp_path / "mask.png", BALL.mask[..., None], "uint8")
    write_rig(tmp_path / "rig.json", RIG)
    options = ["--rig", tmp_path / "rig.json", "--mask", mask, "--passes", "1", "-o", tmp_path / "normals.png"]
    done = mpsnet("estimate", photo, *options)
    assert done.returncode == 0, done.stderr
    assert ("[room-light]" in done.stderr) == (ambient > 0)
