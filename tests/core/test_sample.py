"""Samples on disk: what is written comes back, and whatever is not a whole sample is named in one sentence."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from sphere_sample import RED, sphere_sample
from synthetic import listing, write_file

from mpsnet_core.errors import InputError
from mpsnet_core.synthesis.sample import Sample, read_sample, read_sample_data, write_sample
from mpsnet_core.synthesis.scene_description import Bump, Dirt, Paint, Pattern

ARRAYS = ("lights", "normals", "depth", "alpha", "material", "lit")


@pytest.fixture(scope="module")
def sample() -> Sample:
    sample = sphere_sample(right=RED)
    recipe = replace(
        sample.recipe,
        pattern=Pattern("stripes", 3.3, 0.25, 0.1, (0.6, 0.8, 0.0), 5),
        paint=Paint(0.4, 0.3, 2.0, 6),
        dirt=Dirt(0.1, (0.3, 0.2, 0.1), 4.0, 7),
        bump=Bump(0.01, 30.0, 8),
    )
    # Half of a pixel at the sphere's edge, and light that half floats do not hold exactly.
    alpha = np.where(sample.normals[..., 2] > 0.2, sample.alpha, 0.5 * sample.alpha)
    return replace(sample, recipe=recipe, alpha=alpha, lights=sample.lights * np.float32(np.pi))


@pytest.fixture
def file(tmp_path: Path, sample: Sample) -> Path:
    path = tmp_path / "sample_000000.exr"
    write_sample(path, sample)
    return path


def one_sentence(error: InputError, path: Path) -> str:
    """The error's words, after a look that they are one line and name the file."""
    words = str(error)
    assert "\n" not in words and str(path) in words, words
    return words


@contextmanager
def rewritten(path: Path) -> Iterator[tuple[dict[str, np.ndarray], dict[str, Any]]]:
    """The file's channels by name and its description, to be changed; then written back by OpenImageIO."""
    source = oiio.ImageInput.open(str(path))
    spec, values = source.spec(), source.read_image(oiio.FLOAT)
    source.close()
    channels = {name: values[..., number].copy() for number, name in enumerate(spec.channelnames)}
    extra: dict[str, Any] = {"mpsnet:sample": spec.getattribute("mpsnet:sample")}
    yield channels, extra
    planes = np.ascontiguousarray(np.stack(list(channels.values()), axis=-1))
    changed = oiio.ImageSpec(planes.shape[1], planes.shape[0], planes.shape[2], "float")
    changed.channelnames = tuple(channels)
    for name, value in extra.items():
        changed.attribute(name, value)
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), changed) and target.write_image(planes) and target.close()


def test_a_sample_comes_back(file: Path, sample: Sample) -> None:
    back = read_sample(file)
    for name in ARRAYS:
        expected = getattr(sample, name)
        found = getattr(back, name)
        assert found.dtype == (np.int32 if name == "material" else np.float32), name
        # Half floats have 11 bits of mantissa; only light and lit are stored so.
        np.testing.assert_allclose(found, expected, rtol=2**-11 if name == "lights" else 1e-6, atol=1e-7, err_msg=name)
    assert back.recipe.data() == sample.recipe.data()
    assert back.recipe.camera.projection == "perspective" and back.renderer == "a test"
    assert back.lit_fractions == pytest.approx(sample.lit_fractions)


def test_a_file_of_another_python_is_read_the_same() -> None:
    """The file beside this one is sphere_sample(16, right=RED), written under Python 3.13, NumPy 2 and OIIO 3.2."""
    back, sample = read_sample(Path(__file__).with_name("sample_version_1.exr")), sphere_sample(16, right=RED)
    for name in ARRAYS:
        rtol = 2**-11 if name == "lights" else 1e-6
        np.testing.assert_allclose(getattr(back, name), getattr(sample, name), rtol=rtol, atol=1e-7, err_msg=name)
    assert back.recipe.data() == sample.recipe.data()


def test_layers_are_named_as_other_programs_expect_them(file: Path, sample: Sample) -> None:
    source = oiio.ImageInput.open(str(file))
    spec, values = source.spec(), source.read_image(oiio.FLOAT)
    source.close()
    for k in range(3):
        for c, letter in enumerate("RGB"):
            stored = values[..., spec.channelnames.index(f"light{k + 1}.{letter}")]
            np.testing.assert_allclose(stored, sample.lights[k, :, :, c], rtol=2**-11)
    np.testing.assert_array_equal(values[..., spec.channelnames.index("normal.Y")], sample.normals[..., 1])
    assert json.loads(spec.getattribute("mpsnet:sample"))["recipe"]["number"] == sample.recipe.number


def test_the_same_sample_is_the_same_file(tmp_path: Path, file: Path, sample: Sample) -> None:
    stored = file.read_bytes()
    again = tmp_path / "again.exr"
    os.utime(file, (0, 0))
    write_sample(again, sample)
    assert again.read_bytes() == stored
    # A file of another minute is the same too: it holds no date but one that never changes.
    assert read_date(again) == "1970:01:01 00:00:00"
    assert listing(tmp_path) == ["again.exr", "sample_000000.exr"]


def read_date(path: Path) -> str:
    source = oiio.ImageInput.open(str(path))
    date = source.spec().getattribute("DateTime")
    source.close()
    return str(date)


def test_the_description_is_read_without_the_picture(file: Path, sample: Sample) -> None:
    data = read_sample_data(file)
    assert data["recipe"] == json.loads(json.dumps(sample.recipe.data()))
    assert (data["version"], data["renderer"]) == (1, "a test")
    assert data["lit_fractions"] == pytest.approx(sample.lit_fractions)


def test_normals_come_back_of_unit_length(file: Path) -> None:
    with rewritten(file) as (channels, _):
        for c in "XYZ":
            channels[f"normal.{c}"] = np.float16(channels[f"normal.{c}"]).astype(np.float32)
    back = read_sample(file)
    np.testing.assert_allclose(np.linalg.norm(back.normals[back.alpha > 0], axis=-1), 1, atol=1e-6)
    assert not back.normals[back.alpha == 0].any()


def test_wherever_a_file_is_cut_it_is_reported(tmp_path: Path, file: Path, capfd: pytest.CaptureFixture[str]) -> None:
    whole = file.read_bytes()
    rng = np.random.Generator(np.random.PCG64(20))
    cut = tmp_path / "cut.exr"
    for end in (0, 1, len(whole) - 1, *rng.integers(2, len(whole) - 1, 20)):
        cut.write_bytes(whole[: int(end)])
        for read in (read_sample, read_sample_data):
            with pytest.raises(InputError, match="make it again") as caught:
                read(cut)
            one_sentence(caught.value, cut)
    assert capfd.readouterr() == ("", ""), "OpenEXR's own words are not printed"


def test_flipped_bytes_never_pass_as_another_picture(tmp_path, file: Path, capfd) -> None:
    whole, sample = file.read_bytes(), read_sample(file)
    rng = np.random.Generator(np.random.PCG64(21))
    spoilt = tmp_path / "spoilt.exr"
    told = 0
    for place in rng.integers(0, len(whole), 40):
        data = bytearray(whole)
        data[place] ^= 0x5A
        spoilt.write_bytes(data)
        try:
            back = read_sample(spoilt)
        except InputError as error:
            one_sentence(error, spoilt)
            told += 1
        else:
            for name in ARRAYS:
                np.testing.assert_array_equal(getattr(back, name), getattr(sample, name))
    assert told > 30
    assert capfd.readouterr() == ("", "")


def drop_channel(channels: dict[str, np.ndarray], extra: dict[str, Any]) -> None:
    del channels["lit2.V"]


def drop_description(channels: dict[str, np.ndarray], extra: dict[str, Any]) -> None:
    del extra["mpsnet:sample"]


def break_description(channels: dict[str, np.ndarray], extra: dict[str, Any]) -> None:
    extra["mpsnet:sample"] = extra["mpsnet:sample"][:-40]


def description(**changes: Any) -> Callable[[dict[str, np.ndarray], dict[str, Any]], None]:
    def change(channels: dict[str, np.ndarray], extra: dict[str, Any]) -> None:
        extra["mpsnet:sample"] = json.dumps({**json.loads(extra["mpsnet:sample"]), **changes})

    return change


def recipe(**changes: Any) -> Callable[[dict[str, np.ndarray], dict[str, Any]], None]:
    def change(channels: dict[str, np.ndarray], extra: dict[str, Any]) -> None:
        data = json.loads(extra["mpsnet:sample"])
        extra["mpsnet:sample"] = json.dumps({**data, "recipe": {**data["recipe"], **changes}})

    return change


def channel(name: str, value: float) -> Callable[[dict[str, np.ndarray], dict[str, Any]], None]:
    def change(channels: dict[str, np.ndarray], extra: dict[str, Any]) -> None:
        channels[name][24, 24] = value

    return change


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (drop_channel, "no sample: it lacks a sample's layers"),
        (drop_description, "no sample: it has no description"),
        (break_description, "its description cannot be read"),
        (description(version=99), "version 99, above 1"),
        (description(lit_fractions=[0, 0, 2, 0]), "its description cannot be read"),
        (recipe(materials=[{"gloss": 1}]), "recipe is not known to this program"),
        (recipe(light_directions=[[0, 0, 1]] * 3), "lie .nearly. in one plane"),
        (recipe(light_directions=[[1, 0, 1], [0, 1, 1], [-1, 0, 1]]), "its recipe does not fit it"),
        (recipe(rotation=[[float("nan")] * 3] * 3), "its recipe does not fit it"),
        (channel("light2.G", np.nan), "values that are not finite"),
        (channel("alpha.A", 1.5), "an alpha outside 0 to 1"),
        (channel("lit3.V", -0.5), "shares of light outside 0 to 1"),
        (channel("material.V", 0.5), "materials that are no numbers"),
        (channel("normal.Z", 3.0), "normals that are not of unit length"),
    ],
)
def test_what_is_not_a_sample_is_reported(
    file: Path, change: Callable[[dict[str, np.ndarray], dict[str, Any]], None], words: str
) -> None:
    with rewritten(file) as (channels, extra):
        change(channels, extra)
    with pytest.raises(InputError, match=words) as caught:
        read_sample(file)
    one_sentence(caught.value, file)


def test_other_files_are_reported(tmp_path: Path, sample: Sample) -> None:
    photo = write_file(tmp_path / "photo.exr", np.zeros((4, 4, 3)), "half")
    disguised = write_file(tmp_path / "photo.png", np.zeros((4, 4, 3)), "uint8").rename(tmp_path / "png.exr")
    text = tmp_path / "text.exr"
    text.write_text("not a picture")
    huge = tmp_path / "huge.exr"
    huge.write_bytes(huge_header(sample, tmp_path))
    for path, words in (
        (tmp_path / "none.exr", "does not exist"),
        (photo, "no sample: it lacks a sample's layers"),
        (disguised, "no sample"),
        (text, "not a sample, or its header is cut short"),
        (huge, "10000 x 48, more than 8192 pixels a side"),
    ):
        for read in (read_sample, read_sample_data):
            with pytest.raises(InputError, match=words) as caught:
                read(path)
            one_sentence(caught.value, path)


def huge_header(sample: Sample, folder: Path) -> bytes:
    """A whole sample's bytes whose header says that it is ten thousand pixels wide."""
    write_sample(folder / "small.exr", sample)
    data = (folder / "small.exr").read_bytes()
    box = np.array([0, 0, 47, 47], "<i4").tobytes()
    assert data.count(box) == 2  # data window and display window
    return data.replace(box, np.array([0, 0, 9_999, 47], "<i4").tobytes())


def test_a_picture_that_is_not_finite_is_not_written(tmp_path: Path, sample: Sample) -> None:
    lights = sample.lights.copy()
    lights[1, 2, 3] = np.nan
    with pytest.raises(InputError, match="not finite; render it again"):
        write_sample(tmp_path / "s.exr", replace(sample, lights=lights))
    assert listing(tmp_path) == []


def test_light_brighter_than_half_floats_is_held_at_their_end(tmp_path: Path, sample: Sample) -> None:
    write_sample(tmp_path / "s.exr", replace(sample, lights=sample.lights * np.float32(1e6)))
    assert read_sample(tmp_path / "s.exr").lights.max() == 65504
