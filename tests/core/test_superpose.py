"""Three photos under one white light each become the channels of one photo."""

from pathlib import Path

import numpy as np
import pytest
from synthetic import Sphere, degrees_between, write_file

from mpsnet_core import as_channels, estimate_normals, read_capture, read_image
from mpsnet_core.cli import main
from mpsnet_core.io.image import linear_to_srgb

PAINT = np.array([[0.9, 0.2, 0.1], [0.2, 0.4, 0.8]])


@pytest.fixture
def photos(tmp_path: Path, sphere: Sphere) -> list[str]:
    """The sphere, one half of it orange and the other blue, under each light alone, turned white."""
    shading = np.maximum(sphere.normals @ sphere.rig.directions.T, 0)
    paint = PAINT[(np.arange(64) // 32)[None, :].repeat(64, axis=0)]
    return [
        str(write_file(tmp_path / f"w{k}.png", linear_to_srgb(shading[..., k, None] * paint), "uint16"))
        for k in range(3)
    ]


@pytest.mark.parametrize("name", ["photo.png", "photo.exr"])
def test_equation_2_is_exact_on_the_photo_that_is_made(photos: list[str], sphere: Sphere, name: str) -> None:
    output = Path(photos[0]).with_name(name)
    assert main(["superpose", "--channels", *photos, "-o", str(output)]) == 0
    capture = read_capture(output, sphere.rig, mask="none")
    found = estimate_normals(capture, "lambertian")
    assert degrees_between(found.vectors, sphere.normals)[sphere.lit].max() < 0.3


def test_photos_of_one_channel_are_taken(tmp_path: Path) -> None:
    values = [0.2, 0.4, 0.6]
    files = [write_file(tmp_path / f"{k}.exr", np.full((4, 5), v), "float") for k, v in enumerate(values)]
    np.testing.assert_allclose(as_channels(files).pixels, np.broadcast_to(values, (4, 5, 3)), rtol=1e-6)


def test_the_white_photo_is_the_sum_which_shows_the_colours(photos: list[str], sphere: Sphere, tmp_path: Path) -> None:
    output, white = tmp_path / "photo.exr", tmp_path / "white.exr"
    assert main(["superpose", "--channels", *photos, "--white", str(white), "-o", str(output)]) == 0
    pixels = read_image(white).pixels[sphere.lit]
    columns = np.broadcast_to(np.arange(64) // 32, (64, 64))[sphere.lit]
    expected = PAINT[columns] / PAINT[columns].max(axis=-1, keepdims=True)
    np.testing.assert_allclose(pixels / pixels.max(axis=-1, keepdims=True), expected, atol=2e-3)
    grey = [str(write_file(tmp_path / f"{k}.exr", np.full((4, 5), 0.25), "float")) for k in range(3)]
    assert main(["superpose", "--channels", *grey, "--white", str(white), "-o", str(output), "--overwrite"]) == 0
    np.testing.assert_allclose(read_image(white).pixels, np.full((4, 5, 3), 0.75), rtol=1e-6)
    assert main(["superpose", *photos, "--white", str(white), "-o", str(output)]) == 2


def test_what_is_clipped_in_one_colour_is_clipped_in_the_channel(tmp_path: Path) -> None:
    values = np.full((4, 5, 3), 0.3)
    values[1, 2, 0] = 1
    files = [write_file(tmp_path / f"{k}.png", values, "uint8") for k in range(3)]
    output = tmp_path / "photo.png"
    assert main(["superpose", "--channels", *map(str, files), "-o", str(output)]) == 0
    spoilt = read_image(output).saturated
    assert spoilt[1, 2].all() and spoilt.sum() == 3


@pytest.mark.parametrize("more", [[], ["--channels", "--white", "white.exr"]])
def test_what_the_sum_does_not_show_any_more_gets_a_warning(tmp_path, capsys, monkeypatch, more: list[str]) -> None:
    monkeypatch.chdir(tmp_path)
    values = np.full((10, 10, 3), 0.5)
    files = [write_file(tmp_path / f"{k}.jpg", values, "uint8", ExposureTime=0.1) for k in range(2)]
    values[2] = 1
    files.append(write_file(tmp_path / "2.tif", values, "uint8", ExposureTime=0.2))
    assert main(["superpose", *map(str, files), "-o", "sum.exr", *more]) == 0
    told = capsys.readouterr().err
    assert f"10.0% of {files[2]} is saturated" in told and told.count("saturated") == 1
    assert f"{files[2]} was exposed for 0.2 s, {files[0]} for 0.1 s" in told and told.count("exposed for") == 1


def test_the_sum_of_white_photos_is_reported_by_its_channels(tmp_path, sphere, rig_file, capsys) -> None:
    grey = np.maximum(sphere.normals @ sphere.rig.directions.T, 0).sum(axis=-1, keepdims=True) / 3
    photo = write_file(tmp_path / "sum.exr", grey * [1.0, 0.9, 0.8], "float")
    command = ["estimate", str(photo), "--rig", str(rig_file), "--model", "lambertian", "-o", str(tmp_path / "n.png")]
    assert main(command) == 0
    assert "looks like a photo under white light" in capsys.readouterr().err
