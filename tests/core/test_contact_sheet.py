"""Samples and photos as a picture, and a folder of samples in numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from bad_input import cut, gets_one_clear_sentence
from sphere_sample import RED, sphere_sample
from stand_in import COMMAND
from synthetic import write_file

from mpsnet_core.synthesis.contact_sheet import (
    LIT_COLOURS,
    MATERIAL_COLOURS,
    TILE_HEIGHT,
    folder_samples,
    sample_row,
    sheet_of_samples,
    summarise,
)
from mpsnet_core.synthesis.farm.run import make_samples
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.sample import Sample, write_sample

# What stands above, below and between the tiles.
ROW = TILE_HEIGHT + 40


@pytest.fixture(scope="module")
def sample() -> Sample:
    return sphere_sample(right=RED)


@pytest.fixture
def folder(tmp_path: Path, sample: Sample) -> Path:
    """Samples 0 to 5, of which 1 was cut short and 2 is a photo; in 3 and 4 no light reaches the upper half."""
    folder = tmp_path / "samples"
    folder.mkdir()
    lit = sample.lit.copy()
    lit[:, : lit.shape[1] // 2] = 0
    for number in (0, 1, 3, 4, 5):
        shown = replace(sample, lit=lit, renderer="Cycles") if number in (3, 4) else sample
        write_sample(folder / f"sample_{number:06d}.exr", shown)
    cut = folder / "sample_000001.exr"
    cut.write_bytes(cut.read_bytes()[:-2000])
    write_file(folder / "sample_000002.exr", sample.lights[0], "half")
    (folder / ".sample_000006.77.unfinished.exr").write_bytes(b"half")
    return folder


def pixels(path: Path) -> np.ndarray:
    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT))


def test_a_samples_tiles_show_what_it_holds(sample: Sample) -> None:
    tiles = dict(sample_row("sample_000012", sample))
    assert list(tiles) == ["000012 blobs", "light 2", "light 3", "photo", "normals", "lights reaching", "materials"]
    lights = [tiles["000012 blobs"], tiles["light 2"], tiles["light 3"]]
    for channel, light in enumerate(lights):
        np.testing.assert_array_equal(tiles["photo"][..., channel], light[..., channel])
    inside = sample.alpha > 0.5
    # One exposure for the three: where one is brighter than another in the sample, it is not darker in the picture.
    a, b = (sample.lights[k][inside].mean(axis=-1) for k in (0, 1))
    shown_a, shown_b = (lights[k][inside].mean(axis=-1) for k in (0, 1))
    assert (shown_a >= shown_b)[a > b].all() and (shown_a > shown_b).sum() > 0.3 * len(a)
    np.testing.assert_allclose(tiles["normals"][inside], 0.5 + 0.5 * sample.normals[inside], atol=1e-6)
    for number in range(4):
        reached = inside & (sample.lit.sum(axis=0) == number)
        np.testing.assert_allclose(tiles["lights reaching"][reached], np.tile(LIT_COLOURS[number], (reached.sum(), 1)))
    for number in range(2):
        made_of = sample.material == number
        np.testing.assert_allclose(
            tiles["materials"][made_of], np.tile(MATERIAL_COLOURS[number], (made_of.sum(), 1)), atol=1e-6
        )
    outside = {name: tiles[name][~inside] for name in ("normals", "lights reaching", "materials")}
    assert all(np.ptp(values) == 0 for values in outside.values())


def test_a_broken_file_gives_its_row_to_the_next_whole_one(folder: Path) -> None:
    files = folder_samples(folder)
    rows = [sheet_of_samples(files, count) for count in (1, 2, 3, 4, 8)]
    assert [round(row.shape[0] / ROW) for row in rows if row is not None] == [1, 2, 3, 4, 4]
    assert sheet_of_samples(files[1:3]) is None


def test_a_folder_in_numbers(folder: Path, sample: Sample) -> None:
    summary = summarise(folder_samples(folder))
    assert (summary.samples, summary.renderers) == (4, {"a test": 2, "Cycles": 2})
    assert len(summary.skipped) == 2
    assert "sample_000001.exr" in summary.skipped[0] and "sample_000002.exr is no sample" in summary.skipped[1]
    count = np.bincount(sample.lit.sum(axis=0).astype(int)[sample.mask], minlength=4)
    upper = sample.mask.copy()
    upper[len(upper) // 2 :] = False
    dark = np.bincount(np.where(upper, 0, sample.lit.sum(axis=0)).astype(int)[sample.mask], minlength=4)
    np.testing.assert_allclose(summary.mean_shares, (count + dark) / 2 / sample.mask.sum(), atol=1e-6)
    assert summary.samples_with == tuple(
        2 * int(a >= 0.01 * sample.mask.sum()) + 2 * int(b >= 0.01 * sample.mask.sum())
        for a, b in zip(count, dark, strict=True)
    )
    assert str(summary).startswith("4 sample(s), 2 by Cycles, 2 by a test\npixels reached by three lights ")


def test_the_contact_sheet_shows_the_samples_that_there_are(tmp_path: Path, sample: Sample) -> None:
    """Whoever made them: samples that changed without a word, a sheet that was drawn before they did."""
    sheet = tmp_path / "contact_sheet.png"
    write_sample(tmp_path / "template.exr", sample)
    make_samples(tmp_path, SampleJob("synthesis", 3), COMMAND, processes=1)
    first, drawn = pixels(sheet), sheet.stat().st_mtime_ns
    make_samples(tmp_path, SampleJob("synthesis", 3), COMMAND, processes=1)
    assert sheet.stat().st_mtime_ns == drawn
    write_sample(tmp_path / "sample_000001.exr", replace(sample, lit=0 * sample.lit))
    make_samples(tmp_path, SampleJob("synthesis", 3), COMMAND, processes=1)
    row = first.shape[0] // 3 + 1
    changed = (pixels(sheet) != first).any(axis=(1, 2))
    assert changed[row : 2 * row].any() and not changed[: row - 40].any()
    write_sample(tmp_path / "sample_000003.exr", sample)  # as another run that was killed left it
    make_samples(tmp_path, SampleJob("synthesis", 4), COMMAND, processes=1)
    assert round(pixels(sheet).shape[0] / ROW) == 4
    whole = sheet.read_bytes()
    sheet.write_bytes(whole[:-100])
    make_samples(tmp_path, SampleJob("synthesis", 4), COMMAND, processes=1)
    assert sheet.read_bytes() == whole


test_a_bad_show_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("show a rig", lambda b: b.run("show", b.rig()), "rig.json cannot be read as an image"),
        ("show a cut photo", lambda b: b.run("show", cut(b.photo("a.png", kind="uint8"))), "a.png is damaged or cut"),
        (lambda b: (write_sample(b / "s.exr", sphere_sample(16)), b.run("show", cut(b / "s.exr"))), "s.exr is damaged"),
    ]
)
