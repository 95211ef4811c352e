"""Albedo from a second photo under white light, where it is known: spheres of two colours, and plates in shadow."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bad_input import SPHERE, gets_one_clear_sentence
from sphere_sample import sphere_sample
from synthetic import CROSSTALK, Sphere, shaded_sphere, write_file

from mpsnet_core import Camera, Capture, NormalMap, albedo_from_white, read_albedo, read_capture, write_albedo
from mpsnet_core.estimate.distant_lights import convert_to_distant_view
from mpsnet_core.scene.rig import LightRig, direction_from_angles, near_rig, write_rig

OCHRE, TEAL = np.array([0.7, 0.42, 0.15]), np.array([0.1, 0.35, 0.4])
TILTED = LightRig(direction_from_angles([25.0, 35.0, 45.0], [80.0, 215.0, 330.0]))


class Painted:
    """A matt sphere, its left half ochre and its right half teal, under coloured and under white light.

    strengths: of the three coloured lights. shadow: (H, W, 3) what of each light arrives, 1 unless given; for the
    photo under white light too.
    """

    def __init__(
        self,
        rig: LightRig = TILTED,
        strengths: Sequence[float] = (1, 1, 1),
        shadow: np.ndarray | None = None,
        size: int = 64,
    ) -> None:
        sphere = shaded_sphere(size)
        right = np.broadcast_to(np.arange(size) >= size // 2, (size, size))
        self.albedo = np.where(right[..., None], TEAL, OCHRE) * sphere.mask[..., None]
        cosines = np.maximum(sphere.normals @ rig.directions.T, 0)
        lit = cosines * (1 if shadow is None else shadow)
        self.white = (self.albedo * lit.sum(axis=-1, keepdims=True)).astype(np.float32)
        self.image = (self.albedo * (lit * strengths @ rig.mixing.T)).astype(np.float32)
        self.reached = sphere.mask & (cosines > 0).all(axis=-1)
        self.capture = Capture(self.image, sphere.mask, rig, white=0.3 * self.white)
        self.normals = NormalMap(sphere.normals, sphere.mask)

    def errors(self, found: np.ndarray, where: np.ndarray) -> np.ndarray:
        """By how much, as a share, the albedo found departs from the true one, which is known up to one factor."""
        scale = np.median(found[where] / self.albedo[where])
        return np.abs(found[where] / (scale * self.albedo[where]) - 1)


def test_the_albedo_of_a_sphere_of_two_colours_is_exact_by_the_true_normals() -> None:
    painted = Painted(strengths=(1.0, 0.4, 1.7))
    found = albedo_from_white(painted.capture, painted.normals)
    assert painted.errors(found, painted.reached).max() < 0.02
    assert found.dtype == np.float32 and not found[~painted.capture.mask].any()


@pytest.mark.parametrize("gains", [(1, 1, 1), (0.5, 1.0, 2.0)], ids=str)
def test_colours_channels_that_overlap_are_not_taken_for_shadows(gains: tuple[float, ...]) -> None:
    """Whatever the white balance of the white photo is, which tints the albedo."""
    painted = Painted(LightRig(TILTED.directions, np.array(CROSSTALK)))
    capture = replace(painted.capture, white=painted.capture.white * np.float32(gains))
    found = albedo_from_white(capture, painted.normals) / gains
    assert painted.errors(found, painted.reached).max() < 0.02


def test_a_shadow_of_one_light_is_seen_in_the_coloured_photo_and_not_left_in_the_albedo() -> None:
    shadow = np.ones((64, 64, 3))
    shadow[20:36, :, 0] = 0  # of the first light, a band across the sphere
    shadow[40:44, 10:50, 2] = 0
    painted = Painted(shadow=shadow, strengths=(0.7, 1.0, 1.2))
    found = albedo_from_white(painted.capture, painted.normals)
    cosines = painted.normals.vectors @ painted.capture.rig.directions.T
    errors = painted.errors(found, painted.capture.mask & (cosines > 0.15).all(axis=-1))
    assert errors.max() < 0.02


def test_normals_that_are_ten_degrees_wrong_make_no_shadows() -> None:
    """Else the albedo would jump where such a shadow begins: it is the photo by the shading of all three lights."""
    painted = Painted()
    bent = NormalMap(painted.normals.vectors + np.array([0.15, -0.1, 0]), painted.capture.mask)
    found = albedo_from_white(painted.capture, bent)
    cosines = bent.vectors @ painted.capture.rig.directions.T
    where = painted.capture.mask & (cosines > 0.4).all(axis=-1)
    scale = found[where] * cosines[where].sum(axis=-1, keepdims=True) / painted.white[where]
    assert scale.max() < 1.001 * scale.min()


def test_a_highlight_of_one_light_is_not_taken_for_a_shadow_of_the_others() -> None:
    """It stays in the albedo, as bright as it is, and does not come out several times as bright."""
    painted = Painted()
    shine = np.zeros((64, 64))
    shine[30:34, 20:24] = 20
    image = painted.image + shine[..., None] * [1, 0, 0]
    capture = replace(painted.capture, image=image, white=painted.white + shine[..., None])
    found = albedo_from_white(capture, painted.normals)
    cosines = (painted.normals.vectors @ capture.rig.directions.T).sum(axis=-1)[..., None]
    by_all, dull = capture.white / np.maximum(cosines, 0.01), painted.reached & (shine == 0)
    scale = np.median(by_all[dull] / found[dull])
    np.testing.assert_allclose(scale * found[shine > 0], by_all[shine > 0], rtol=0.01)


def test_the_white_photo_may_have_been_lit_from_one_other_side() -> None:
    painted = Painted()
    light = direction_from_angles(20, 300)
    cosine = np.maximum(painted.normals.vectors @ light, 0)[..., None]
    capture = replace(painted.capture, white=painted.albedo * cosine, white_light=light)
    found = albedo_from_white(capture, painted.normals)
    assert painted.errors(found, painted.capture.mask & (cosine[..., 0] > 0.15)).max() < 0.02


def test_near_lights_are_near_for_the_white_photo_too() -> None:
    """A grey plate half a metre away: each light falls off across it, and the albedo does not."""
    rows, columns = np.mgrid[:48, :48]
    points = np.stack([(columns - 23.5) / 100, (23.5 - rows) / 100, np.full((48, 48), -0.5)], axis=-1)
    lamps = np.array([[0.3, 0.1, 0], [-0.2, 0.3, 0], [0, -0.3, -0.1]])
    towards = lamps[:, None, None] - points
    reach = np.linalg.norm(lamps - [0, 0, -0.5], axis=1)
    light = (reach**2 * (towards[..., 2] / np.linalg.norm(towards, axis=-1) ** 3).transpose(1, 2, 0)).astype(np.float32)
    white = light.sum(axis=-1)
    rig = near_rig(lamps, [0.0, 0.0, -0.5])
    camera = Camera("perspective", 48, 48, (50, 50), (24, 24), np.eye(4))
    mask = np.ones((48, 48), bool)
    capture = Capture(
        light, mask, rig, camera, depth=np.full((48, 48), 0.5), white=np.repeat(white[..., None], 3, axis=-1)
    )
    facing = NormalMap(np.broadcast_to([0, 0, 1.0], (48, 48, 3)), mask)
    found = albedo_from_white(capture, facing)
    assert white.max() > 1.3 * white.min() and found.max() < 1.02 * found.min()
    np.testing.assert_array_equal(convert_to_distant_view(capture).white, capture.white)


def test_the_albedo_is_as_bright_whatever_the_exposure() -> None:
    painted = Painted()
    once, twice = (
        albedo_from_white(replace(painted.capture, white=factor * painted.white), painted.normals)
        for factor in (0.01, 2.0)
    )
    np.testing.assert_allclose(once, twice, rtol=1e-4, atol=1e-6)
    assert np.percentile(once[painted.reached].max(axis=-1), 99) == pytest.approx(0.9, rel=0.01)


def test_what_is_clipped_does_not_set_the_scale() -> None:
    painted = Painted()
    spoilt = painted.white.copy()
    spoilt[28:36, 20:30] = 5
    clipped = spoilt == 5
    found = albedo_from_white(replace(painted.capture, white=spoilt, white_clipped=clipped), painted.normals)
    assert found[painted.reached & ~clipped.any(axis=-1)].max() == pytest.approx(0.9, rel=0.02)


@pytest.mark.parametrize(("name", "bits"), [("a.png", None), ("a.tif", None), ("a.tif", 32), ("a.exr", None)])
def test_an_albedo_is_read_as_it_was_written(tmp_path: Path, name: str, bits: int | None) -> None:
    painted = Painted()
    write_albedo(tmp_path / name, painted.albedo, painted.capture.mask, bits=bits)
    found = read_albedo(tmp_path / name)
    assert np.isnan(found[~painted.capture.mask]).all()
    np.testing.assert_allclose(found[painted.capture.mask], painted.albedo[painted.capture.mask], atol=1e-4)


# --- the photo --------------------------------------------------------------------------------------------------------


def test_three_photos_of_one_white_light_each_are_added(tmp_path: Path, photo_file: Path, sphere: Sphere) -> None:
    lights = [0.2 * np.roll(sphere.image, number, axis=-1) for number in range(3)]
    files = [write_file(tmp_path / f"white_{number}.exr", light, "float") for number, light in enumerate(lights)]
    for given in (files, [tmp_path / "white_#.exr"]):
        capture = read_capture(photo_file, sphere.rig, white=given)
        np.testing.assert_allclose(capture.white, sum(lights), rtol=1e-6)


def test_what_is_clipped_in_any_of_the_white_photos_is_known(tmp_path: Path, photo_file: Path, sphere: Sphere) -> None:
    values = np.full((2, 64, 64, 3), 0.4)
    values[0, 5, 6, 1] = values[1, 50, 7, 2] = 1
    files = [write_file(tmp_path / f"{number}.png", one, "uint8") for number, one in enumerate(values)]
    capture = read_capture(photo_file, sphere.rig, white=files)
    assert capture.white_clipped is not None
    assert np.argwhere(capture.white_clipped).tolist() == [[5, 6, 1], [50, 7, 2]]


# --- the command line -------------------------------------------------------------------------------------------------


def test_estimate_writes_the_albedo_beside_the_normals(tmp_path: Path, mpsnet) -> None:
    """The white photo is the sum of a sample's three pictures under white lights, the coloured one has one of each."""
    sample = sphere_sample(48, left=OCHRE, right=TEAL)
    write_rig(tmp_path / "rig.json", LightRig(sample.recipe.light_directions))
    mask = write_file(tmp_path / "mask.png", sample.mask, "uint8")
    photo = write_file(tmp_path / "photo.exr", np.stack([sample.lights[k, ..., k] for k in range(3)], axis=-1), "float")
    white = [write_file(tmp_path / f"white_{k}.exr", sample.lights[k], "float") for k in range(3)]
    normals, albedo = tmp_path / "normals.png", tmp_path / "albedo.exr"
    command = ["estimate", photo, "--rig", tmp_path / "rig.json", "--mask", mask, "--model", "lambertian"]
    command += [part for file in white for part in ("--white", file)]
    done = mpsnet(*command, "-o", normals, "--albedo", albedo, "--progress", "json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1])["result"]["albedo"] == str(albedo)
    found = read_albedo(albedo)
    left, right = found[20:28, 14:20].mean(axis=(0, 1)), found[20:28, 30:34].mean(axis=(0, 1))
    np.testing.assert_allclose([left / OCHRE, right / TEAL], (left / OCHRE).mean(), rtol=0.01)


test_a_bad_white_photo_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("of another size", lambda b: b.estimate(white=b.photo("white.exr", SPHERE.image[:8])), "white.exr: the white"),
        ("black", lambda b: b.estimate(white=b.photo("white.exr", 0 * SPHERE.image)), "white.exr: the white photo is"),
        ("that is the photo", lambda b: b.estimate(white=b.photo()), "photo.exr: the white photo is the photo itself"),
        (
            "of several photos",
            lambda b: b.estimate(b.photo("a.exr"), b.photo("b.exr"), output="out", white=b.photo("white.exr")),
            "--white is a second photo of a single photo's pose; leave it out, or give one photo",
        ),
        ("albedo without one", lambda b: b.estimate(albedo=b / "a.png"), "--albedo is made from a photo under white"),
        (lambda b: albedo_from_white(SPHERE.capture(), NormalMap(SPHERE.normals, SPHERE.mask)), "the albedo is made"),
        ("albedo over it", lambda b: b.estimate(white=b.photo("white.exr"), albedo=b / "white.exr"), "would overwrite"),
        (
            "light from nowhere",
            lambda b: b.estimate(**{"white": b.photo("w.exr"), "albedo": b / "a.png", "white-light": "left"}),
            "--white-light left is not known; give slant (0 to 90) and tilt in degrees, as 45,135",
        ),
    ]
)
