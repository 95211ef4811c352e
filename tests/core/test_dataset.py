"""The dataset of samples: the same examples for whoever reads them, physics that survives turning, and broken files."""

import hashlib
import logging
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sphere_sample import RED, sphere_sample
from synthetic import degrees_between, shaded_sphere

from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.estimate.lambertian import lambertian_normals
from mpsnet_core.synthesis.job import sample_path
from mpsnet_core.synthesis.photographs.capture_model import CaptureModel
from mpsnet_core.synthesis.photographs.dataset import Example, SampleDataset
from mpsnet_core.synthesis.sample import write_sample

SIZE = 48


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four samples: a white sphere, and three of two colours."""
    folder = tmp_path_factory.mktemp("samples")
    write_sample(sample_path(folder, 0), sphere_sample(SIZE))
    for number in (1, 2, 3):
        write_sample(
            sample_path(folder, number), sphere_sample(SIZE, left=(0.3 * number,) * 3, right=RED, number=number)
        )
    return folder


def same(one: Example, other: Example) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def test_an_example_has_what_a_network_needs(folder: Path) -> None:
    dataset = SampleDataset(folder)
    assert len(dataset) == len(list(dataset)) == 4
    for example in dataset:
        photo, initial_normals, light_directions, mask, truth = example
        for array in (photo, initial_normals, truth):
            assert (array.shape, array.dtype) == ((SIZE, SIZE, 3), np.float32)
            assert np.isfinite(array).all()
            assert min(array.strides) > 0, "PyTorch takes no arrays that run backwards"
        assert (light_directions.shape, light_directions.dtype) == ((3, 3), np.float32)
        assert (mask.shape, mask.dtype) == ((SIZE, SIZE), np.bool_)
        np.testing.assert_allclose(np.linalg.norm(light_directions, axis=1), 1, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(initial_normals[mask], axis=1), 1, atol=1e-5)
        assert not photo[~mask].any() and not initial_normals[~mask].any()
        assert photo[mask].mean() == pytest.approx(1, abs=1e-4)
        length = np.linalg.norm(truth, axis=-1)
        assert np.all((np.abs(length - 1) < 1e-6) | (length == 0))
        assert (length[mask] > 0).mean() > 0.8


def test_an_ideal_capture_of_a_white_sphere_is_solved_by_equation_2(folder: Path) -> None:
    example = SampleDataset(folder, capture_model=CaptureModel.ideal(), augment=False).example(0)
    sample = sphere_sample(SIZE)
    np.testing.assert_allclose(example.truth, sample.normals, atol=1e-6)
    np.testing.assert_allclose(example.light_directions, sample.recipe.light_directions, atol=1e-6)
    lit = (sample.lit > 0).all(axis=0) & sample.mask
    assert degrees_between(example.initial_normals, sample.normals)[lit].max() < 0.1  # light is stored as half floats


def test_initial_normals_are_the_estimator_s(folder: Path) -> None:
    dataset = SampleDataset(folder, seed=5)
    for index in range(4):
        capture, truth = dataset.capture(index, 2)
        example = dataset.example(index, 2)
        np.testing.assert_allclose(example.initial_normals, lambertian_normals(capture).vectors, atol=1e-6)
        np.testing.assert_array_equal(example.truth, truth)
        np.testing.assert_array_equal(example.mask, capture.mask)


def test_turned_and_mirrored_pictures_are_of_turned_and_mirrored_spheres(folder: Path) -> None:
    """A sphere looks the same however it is turned: its normals point to where the pixel is, whatever was done."""
    dataset = SampleDataset(folder, capture_model=CaptureModel.ideal())
    sphere, sample = shaded_sphere(SIZE), sphere_sample(SIZE)
    seen = set()
    for epoch in range(60):
        example = dataset.example(0, epoch)
        np.testing.assert_allclose(example.truth, sphere.normals, atol=1e-6)
        # The light falls on it from where the directions say.
        shading = np.maximum(sphere.normals @ example.light_directions.T, 0)
        lit = (shading > 0.01).all(axis=-1)
        assert degrees_between(example.initial_normals, sphere.normals)[lit].max() < 0.1
        expected = shading / shading[sphere.mask].mean()
        np.testing.assert_allclose(example.photo, expected, atol=2e-3)
        # Heights above the picture's plane stay; so do the angles between lights.
        cosines = np.sort(sample.recipe.light_directions[:, 2])
        np.testing.assert_allclose(np.sort(example.light_directions[:, 2]), cosines, atol=1e-6)
        seen.add(tuple(np.round(example.light_directions.ravel(), 3)))
    # Four turns, mirrored or not, six orders: 48 ways, of which sixty throws meet about 34.
    assert len(seen) > 25


def test_colours_turn_with_the_picture(folder: Path) -> None:
    """The second sample is red on its right half: wherever that half went, normals are as if photographed there."""
    dataset = SampleDataset(folder, capture_model=CaptureModel.ideal())
    sides = set()
    for epoch in range(40):
        example = dataset.example(1, epoch)
        shading = np.maximum(shaded_sphere(SIZE).normals @ example.light_directions.T, 0)
        ratio = np.divide(example.photo, shading, out=np.zeros_like(shading), where=shading > 0.05)
        redness = ratio[..., 0] / np.maximum(ratio[..., 2], 1e-6)
        red = (redness > 3) & (shading > 0.05).all(axis=-1)
        y, x = np.argwhere(red).mean(axis=0) - (SIZE - 1) / 2
        sides.add("right" if x > abs(y) else "left" if -x > abs(y) else "bottom" if y > 0 else "top")
    assert sides == {"left", "right", "top", "bottom"}


def test_examples_depend_on_seed_epoch_and_index_alone(folder: Path) -> None:
    first, again = SampleDataset(folder, seed=7), SampleDataset([folder], seed=7)
    backwards = [again.example(index, 1) for index in (3, 2, 1, 0)][::-1]
    assert all(same(first.example(index, 1), backwards[index]) for index in range(4))
    again.set_epoch(1)
    assert same(again[2], first.example(2, 1))
    copied = pickle.loads(pickle.dumps(again))
    assert same(copied[3], again[3])
    assert not same(first.example(2, 0), first.example(2, 1))
    assert not same(first.example(2, 0), SampleDataset(folder, seed=8).example(2, 0))


def test_another_process_reads_the_same_bytes(folder: Path) -> None:
    script = (
        "import hashlib, sys; from mpsnet_core.synthesis.photographs.dataset import SampleDataset;"
        "d = SampleDataset(sys.argv[1], seed=9);"
        "print(*[hashlib.sha256(b''.join(a.tobytes() for a in d.example(i, 4))).hexdigest() for i in (3, 0, 2, 1)])"
    )
    done = subprocess.run([sys.executable, "-c", script, str(folder)], capture_output=True, text=True, timeout=60)
    dataset = SampleDataset(folder, seed=9)
    here = [hashlib.sha256(b"".join(a.tobytes() for a in dataset.example(i, 4))).hexdigest() for i in (3, 0, 2, 1)]
    assert done.stdout.split() == here, done.stderr


# Weighed sums of photo, initial normals and directions, and the number of the mask's pixels, of examples 0 to 3 of seed
# 11 as Python 3.11 with NumPy 1.26 has them; the weights tell pixels and channels apart.
FINGERPRINTS = [
    [3.84283, 1.43307, -1.10425, 1892],
    [-4.66310, 5.27145, -0.91612, 1356],
    [-2.15633, 1.15999, 1.10963, 1892],
    [3.11783, 4.74646, -0.89056, 2016],
]


def test_examples_are_the_same_under_every_python(folder: Path) -> None:
    dataset = SampleDataset(folder, seed=11)
    found = []
    for index in range(4):
        example = dataset.example(index, 1)
        weights = np.cos(np.arange(SIZE * SIZE * 3)).reshape(SIZE, SIZE, 3)
        photo, initial = ((array * weights).sum(dtype=float) for array in (example.photo, example.initial_normals))
        found.append(
            [photo, initial, float((example.light_directions * weights[0, :3]).sum()), int(example.mask.sum())]
        )
    np.testing.assert_allclose(found, FINGERPRINTS, rtol=0, atol=2e-3)


def test_a_crop_shows_the_object_as_it_is_there(folder: Path) -> None:
    dataset = SampleDataset(folder, capture_model=CaptureModel.ideal(), crop=16, augment=False)
    whole = sphere_sample(SIZE)
    corners = set()
    for epoch in range(30):
        example = dataset.example(0, epoch)
        assert example.truth.shape == (16, 16, 3) and example.mask.any()
        windows = np.lib.stride_tricks.sliding_window_view(whole.normals, (16, 16), axis=(0, 1))
        match = np.abs(windows - example.truth.transpose(2, 0, 1)).max(axis=(2, 3, 4)) < 1e-6
        assert match.sum() == 1
        corners.add(tuple(np.argwhere(match)[0]))
    assert len(corners) > 20
    with pytest.raises(InputError, match="48 x 48, smaller than the crop of 64; take a smaller crop"):
        SampleDataset(folder, crop=64)


@pytest.fixture
def spoilt(folder: Path, tmp_path: Path) -> Path:
    """The four samples, of which the second is cut short, and after them text and a sample damaged within."""
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    cut, damaged = sample_path(tmp_path, 1), sample_path(tmp_path, 5)
    damaged.write_bytes(cut.read_bytes())
    cut.write_bytes(cut.read_bytes()[:-1000])
    sample_path(tmp_path, 4).write_text("no picture")
    data = bytearray(damaged.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 200] = bytes(200)
    damaged.write_bytes(data)
    (tmp_path / ".sample_000006.77.unfinished.exr").write_bytes(b"half")
    return tmp_path


def test_broken_files_are_told_once_left_out_and_counted(
    folder: Path, spoilt: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        dataset = SampleDataset(spoilt, seed=3)
    assert [path.name for path, _ in dataset.broken] == ["sample_000001.exr", "sample_000004.exr"]
    assert [path.name for path in dataset.paths] == [f"sample_00000{n}.exr" for n in (0, 2, 3, 5)]
    assert len(dataset) == 4
    caplog.clear()
    examples = [dataset.example(index, epoch) for epoch in (0, 1) for index in range(4)]
    assert [path.name for path, _ in dataset.broken][2:] == ["sample_000005.exr"]
    assert [message.count("sample_000005.exr") for message in caplog.messages] == [1]
    for path, sentence in dataset.broken:
        assert str(path) in sentence and "make it again" in sentence
    # The next whole sample stands in, here the first, with the photograph drawn for the place it stands in.
    fresh = SampleDataset(spoilt, seed=3)
    assert same(examples[7], fresh.example(3, 1))
    assert same(examples[2], fresh.example(2, 0))
    assert not same(examples[3], examples[0])


def test_what_cannot_be_a_dataset_is_told(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the folder of samples .*none does not exist; check the path"):
        SampleDataset(tmp_path / "none")
    with pytest.raises(InputError, match=r"there are no samples in .*; make some with mpsnet synthesize"):
        SampleDataset(tmp_path)
    sample_path(tmp_path, 0).write_text("no picture")
    with pytest.raises(InputError, match=r"none of the 1 samples in .* is whole; make them again"):
        SampleDataset(tmp_path)
    with pytest.raises(InputError, match=r"the dataset's crop cannot be -8; choose 0 or more"):
        SampleDataset(folder, crop=-8)
    with pytest.raises(InputError, match=r"the dataset's seed cannot be -1; choose 0 or more"):
        SampleDataset(folder, seed=-1)
    dataset = SampleDataset(folder)
    for index in (-1, 4):
        with pytest.raises(IndexError):
            dataset[index]


def test_samples_without_light_are_passed_over(folder: Path, tmp_path: Path) -> None:
    dark = sphere_sample(SIZE)
    write_sample(sample_path(tmp_path, 0), replace(dark, lights=0 * dark.lights))
    with pytest.raises(InputError, match=r"none of the 1 samples in .* can be used"):
        SampleDataset(tmp_path).example(0)
    write_sample(sample_path(tmp_path, 1), dark)
    dataset = SampleDataset(tmp_path)
    assert dataset.example(0).mask.any()
    assert dataset.broken == [], "the file is whole"


def test_folders_are_read_one_after_the_other(folder: Path, tmp_path: Path) -> None:
    write_sample(sample_path(tmp_path, 0), sphere_sample(SIZE))
    dataset = SampleDataset([tmp_path, folder])
    assert [path.parent for path in dataset.paths] == [tmp_path] + 4 * [folder]


def test_looking_through_the_samples_tells_how_far_and_can_be_stopped(folder: Path) -> None:
    told: list[float] = []
    SampleDataset(folder, progress=lambda fraction, message: told.append(fraction))
    assert told == sorted(told) and told[-1] == 1.0

    def stop(fraction: float, message: str) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        SampleDataset(folder, progress=stop)


def test_a_data_loader_takes_it(folder: Path) -> None:
    data = pytest.importorskip("torch.utils.data")
    dataset = SampleDataset(folder, seed=4)
    # Not forked, as Linux would: other libraries' threads may hold a lock at that moment.
    batches = list(data.DataLoader(dataset, batch_size=2, num_workers=2, multiprocessing_context="spawn"))
    assert [tuple(batch.photo.shape) for batch in batches] == 2 * [(2, SIZE, SIZE, 3)]
    np.testing.assert_array_equal(batches[1].truth[0].numpy(), dataset[2].truth)
