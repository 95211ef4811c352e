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

from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.learning.training.packed import MARGIN, PACKED, PackedSamples
from mpsnet_core.synthesis.job import sample_path
from mpsnet_core.synthesis.sample import write_sample

pytestmark = pytest.mark.long


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in range(3):
        write_sample(sample_path(tmp_path, number), sphere_sample(24 + 8 * number, right=RED, number=number))
    return tmp_path


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


def test_samples_are_in_the_order_of_folders_and_numbers(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    other = tmp_path_factory.mktemp("other")
    write_sample(sample_path(other, 7), sphere_sample(16))
    samples = PackedSamples([other, folder])
    assert samples.names == [f"{other.name}/7"] + [f"{folder.name}/{number}" for number in range(3)]
    assert samples.paths == [sample_path(other, 7)] + [sample_path(folder, number) for number in range(3)]


def test_damaged_and_dark_samples_are_reported_once_and_left_out(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    sample_path(folder, 1).write_bytes(sample_path(folder, 1).read_bytes()[:-1000])
    dark = sphere_sample(16, number=3)
    write_sample(sample_path(folder, 3), replace(dark, lights=0 * dark.lights))
    for told in (2, 0):
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            samples = PackedSamples([folder])
        assert [path.name for path in samples.left_out] == ["sample_000001.exr", "sample_000003.exr"]
        assert [message.startswith("left out: sample") for message in caplog.messages] == [True] * told
        assert samples.names == [f"{folder.name}/0", f"{folder.name}/2"]


def test_what_is_added_removed_or_made_anew_is_found(folder: Path) -> None:
    assert sizes(PackedSamples([folder])) == [24, 32, 40]
    write_sample(sample_path(folder, 5), sphere_sample(16))
    sample_path(folder, 1).unlink()
    assert sizes(PackedSamples([folder])) == [24, 40, 16]
    write_sample(sample_path(folder, 0), sphere_sample(48))
    assert sizes(PackedSamples([folder])) == [48, 40, 16]
    write_sample(sample_path(folder, 0), sphere_sample(20))
    os.utime(sample_path(folder, 0), (1, 1))  # as a copy that keeps its time
    assert sizes(PackedSamples([folder])) == [20, 40, 16]


@pytest.mark.parametrize("left", [1, 50, 5000, -1])
def test_a_packed_file_that_was_cut_short_is_named(folder: Path, left: int) -> None:
    samples, packed = PackedSamples([folder]), folder / PACKED / "sample_000001.npy"
    packed.write_bytes(packed.read_bytes()[:left])
    with pytest.raises(InputError, match=r"sample_000001.npy is damaged; delete it, and the sample is packed again"):
        samples[1]


def test_who_stops_packing_goes_on_later(folder: Path) -> None:
    def stop(fraction: float, message: str) -> None:
        if message == "packing sample 3 of 3":
            raise Cancelled

    with pytest.raises(Cancelled):
        PackedSamples([folder], progress=stop)
    told: list[str] = []
    assert len(PackedSamples([folder], progress=lambda fraction, message: told.append(message))) == 3
    assert told == ["packing sample 3 of 3"]


def test_two_processes_that_pack_at_once_read_the_same(folder: Path) -> None:
    for number in range(3, 12):
        write_sample(sample_path(folder, number), sphere_sample(64, number=number))
    script = (
        "import sys; from mpsnet_core.learning.training.packed import PackedSamples; s = PackedSamples([sys.argv[1]]);"
        "print(len(s), float(sum(p.lights.float().sum() for p in (s[k] for k in range(len(s))))))"
    )
    both = [
        subprocess.Popen([sys.executable, "-c", script, str(folder)], stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    answers = [process.communicate(timeout=120)[0] for process in both]
    assert answers[0] == answers[1] and answers[0].startswith("12 ")


def test_what_cannot_be_packed_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the folder of samples .*none does not exist; check the path"):
        PackedSamples([tmp_path / "none"])
    with pytest.raises(InputError, match=r"there is no whole sample in .*; make some with mpsnet synthesize"):
        PackedSamples([tmp_path])


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written_to_is_reported(folder: Path) -> None:
    folder.chmod(0o500)
    with pytest.raises(InputError, match=r"cannot .*write|cannot be written"):
        PackedSamples([folder])
