"""Packed samples: what training reads of a folder, and what becomes of damage, additions and other processes."""

import logging
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from sphere_sample import RED, sphere_sample
from synthetic import listing

from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.learning.training.packed import MARGIN, PackedSamples
from mpsnet_core.synthesis.job import sample_path
from mpsnet_core.synthesis.sample import write_sample

pytestmark = pytest.mark.long


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in range(3):
        write_sample(sample_path(tmp_path, number), sphere_sample(24 + 8 * number, right=RED, number=number))
    return tmp_path


@pytest.fixture
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


def sizes(samples: PackedSamples) -> list[int]:
    return [samples[index].mask.shape[0] for index in range(len(samples))]


def test_a_sample_comes_back_cut_to_its_object(folder: Path) -> None:
    for _ in range(2):  # packed, then read from the file
        packed = PackedSamples([folder])[2]
        sample = sphere_sample(40, right=RED)
        rows = np.flatnonzero(sample.mask.any(axis=1))
        box = np.s_[max(rows.min() - MARGIN, 0) : rows.max() + MARGIN + 1]
        np.testing.assert_array_equal(packed.mask, sample.mask[box, box])
        lights = packed.lights.reshape(3, 3, *packed.mask.shape).permute(0, 2, 3, 1).numpy()
        inside = packed.mask.numpy()
        np.testing.assert_allclose(lights[:, inside], sample.lights[:, box, box][:, inside], rtol=2**-10, atol=1e-6)
        normals = packed.normals.permute(1, 2, 0).numpy()[inside]
        np.testing.assert_allclose(normals, sample.normals[box, box][inside], rtol=2**-10, atol=1e-6)
        assert not lights[:, ~inside].any() and not packed.normals[:, ~packed.mask].any()
        np.testing.assert_array_equal(packed.lit, (sample.lit >= 0.5)[:, box, box] & inside)
        np.testing.assert_array_equal(packed.directions, sample.recipe.light_directions)


def test_damaged_and_dark_samples_are_named_and_left_out(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    sample_path(folder, 1).write_bytes(sample_path(folder, 1).read_bytes()[:-1000])
    dark = sphere_sample(16, number=3)
    write_sample(sample_path(folder, 3), replace(dark, lights=0 * dark.lights))
    with pytest.raises(InputError, match=r"sample_000001.exr is damaged.* --skip-damaged"):
        PackedSamples([folder])
    with caplog.at_level(logging.WARNING):
        samples = PackedSamples([folder], skip_damaged=True)
    assert [path.name for path in samples.left_out] == ["sample_000001.exr", "sample_000003.exr"]
    assert ["sample_000001" in caplog.messages[0], "sample_000003" in caplog.messages[1]] == [True, True]
    assert samples.names == [f"{folder.name}/0", f"{folder.name}/2"]


def test_what_is_added_removed_or_made_anew_is_found(folder: Path, cache: Path) -> None:
    def found() -> list[int]:
        return sizes(PackedSamples([folder], cache=cache))

    assert found() == [24, 32, 40]
    write_sample(sample_path(folder, 5), sphere_sample(16))
    sample_path(folder, 1).unlink()
    assert found() == [24, 40, 16]
    write_sample(sample_path(folder, 0), sphere_sample(48))
    assert found() == [48, 40, 16]
    write_sample(sample_path(folder, 0), sphere_sample(20))
    os.utime(sample_path(folder, 0), (1, 1))  # as a copy that keeps its time
    assert found() == [20, 40, 16]
    assert len(list(cache.iterdir())) == 4  # what was packed of sample 1 stays, that of others is replaced


@pytest.mark.parametrize("left", [1, 50, 5000, -1])
def test_a_packed_file_that_was_cut_short_is_named(folder: Path, cache: Path, left: int) -> None:
    samples = PackedSamples([folder], cache=cache)
    [packed] = cache.glob("sample_000001*")
    packed.write_bytes(packed.read_bytes()[:left])
    with pytest.raises(InputError, match=rf"{packed.name} is damaged; delete it"):
        samples[1]


def test_who_stops_packing_goes_on_later(folder: Path, cache: Path) -> None:
    def stop(fraction: float, message: str) -> None:
        if message == "packing sample 3 of 3":
            raise Cancelled

    with pytest.raises(Cancelled):
        PackedSamples([folder], stop, cache=cache)
    packed = {path: path.stat().st_ino for path in cache.iterdir()}
    assert len(packed) == 2 and len(PackedSamples([folder], cache=cache)) == 3
    assert {path: path.stat().st_ino for path in packed} == packed  # not packed again


def test_two_processes_that_pack_at_once_read_the_same(folder: Path, cache: Path) -> None:
    for number in range(3, 12):
        write_sample(sample_path(folder, number), sphere_sample(64, number=number))
    script = (
        "import sys\nfrom mpsnet_core.learning.training.packed import PackedSamples\n"
        "s = PackedSamples([sys.argv[1]], cache=sys.argv[2])\n"
        "print(len(s), float(sum(p.lights.float().sum() for p in (s[k] for k in range(len(s))))))"
    )
    both = [
        subprocess.Popen([sys.executable, "-c", script, str(folder), str(cache)], stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    answers = [process.communicate(timeout=120)[0] for process in both]
    assert answers[0] == answers[1] and answers[0].startswith("12 ")


def test_what_cannot_be_packed_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the folder of samples .*none does not exist; check the path"):
        PackedSamples([tmp_path / "none"])
    with pytest.raises(InputError, match=r"there is no whole sample in .*; make some with mpsnet synthesize"):
        PackedSamples([tmp_path])


def test_nothing_is_written_beside_the_samples(folder: Path) -> None:
    before = listing(folder)
    folder.chmod(0o500)
    samples = PackedSamples([folder])
    assert len(samples) == 3 and listing(folder) == before
    [cache] = {path.parent for path in samples._packed}
    del samples
    assert not cache.exists()
