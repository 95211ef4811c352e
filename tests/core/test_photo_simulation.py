"""Simulated photos in batches: on every scale, in every frame, what is seen is what there is."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from ideal_capture import IDEAL
from sphere_sample import sphere_sample
from torch import Tensor
from torch.nn import functional

from mpsnet_core.estimate.features import PhotoCrop, feature_map
from mpsnet_core.learning.training.inputs import feature_tensor
from mpsnet_core.learning.training.loss import angle_between
from mpsnet_core.learning.training.packed import PackedSamples
from mpsnet_core.learning.training.photo_simulation import WINDOW, Frames, PhotoSimulator, Scale
from mpsnet_core.synthesis.capture_model import CaptureModel
from mpsnet_core.synthesis.job import sample_path
from mpsnet_core.synthesis.sample import write_sample

pytestmark = pytest.mark.long

EVERY_SCALE = (0.0, 0.0, 0.0, 0.0, 1.0)  # four scales behind the first


@pytest.fixture(scope="module")
def spheres(tmp_path_factory: pytest.TempPathFactory) -> PackedSamples:
    """White matt spheres, of 64 and of 200 pixels."""
    folder = tmp_path_factory.mktemp("spheres")
    for number, size in enumerate((200, 64)):
        write_sample(sample_path(folder, number), sphere_sample(size, number=number))
    return PackedSamples([folder])


@pytest.fixture(scope="module")
def painted(tmp_path_factory: pytest.TempPathFactory) -> PackedSamples:
    """A matt sphere of which one half is red and the other blue."""
    folder = tmp_path_factory.mktemp("painted")
    write_sample(sample_path(folder, 0), sphere_sample(96, left=(0.7, 0.1, 0.1), right=(0.1, 0.2, 0.8)))
    return PackedSamples([folder])


def inside(mask: Tensor) -> Tensor:
    """(N, H, W) where the mask (N, C, H, W) is whole three pixels around."""
    return -functional.max_pool2d(-functional.pad(mask, (3,) * 4), 7, 1).amax(dim=1) > 0


def equal(ones: list[Scale], others: list[Scale]) -> bool:
    return len(ones) == len(others) and all(
        torch.equal(one.maps["photo"], other.maps["photo"]) and torch.equal(one.truth, other.truth)
        for one, other in zip(ones, others, strict=True)
    )


@pytest.mark.parametrize("frames", ["canonical", "any", "camera"])
@pytest.mark.parametrize("finer", [EVERY_SCALE, ()])
def test_equation_2_finds_the_truth_on_every_scale_in_every_frame(
    spheres: PackedSamples, finer: tuple[float, ...], frames: Frames
) -> None:
    simulator = PhotoSimulator(spheres, IDEAL, finer=finer, frames=frames)
    senses = set()
    for step in range(6):
        scales = simulator.batch(step, 4)
        assert len(scales) == max(len(finer), 1)
        for scale in scales:
            found = feature_tensor("initial_normals", scale.maps)
            # Where shadow begins is between two pixels.
            lit = inside(scale.lit * scale.maps["mask"]) & (scale.maps["photo"].amin(dim=1) > 0.1)
            assert lit.any()
            assert float(torch.rad2deg(angle_between(found, scale.truth))[lit].max()) < 1
            senses |= set(torch.linalg.det(scale.maps["lights"].reshape(-1, 3, 3)).sign().tolist())
    own = {float(np.sign(np.linalg.det(sample.directions))) for sample in spheres}
    # Canonical lights run counter-clockwise.
    assert senses == {"canonical": {1.0}, "any": {1.0, -1.0}, "camera": own}[frames]


def test_a_finer_window_shows_what_the_coarser_one_shows_there(spheres: PackedSamples) -> None:
    scales = PhotoSimulator(spheres, IDEAL, finer=EVERY_SCALE).batch(0, 4)
    half = WINDOW // 2
    for coarse, fine in itertools.pairwise(scales):
        means = functional.avg_pool2d(fine.maps["photo"], 2)
        whole = inside(functional.avg_pool2d(fine.maps["mask"], 2) * functional.avg_pool2d(fine.lit, 2) - 0.99)
        assert whole.any()
        for number, (top, left) in enumerate(fine.places):
            assert int(fine.examples[number]) == int(coarse.examples[number])
            there = coarse.maps["photo"][number, :, top : top + half, left : left + half]
            off = (means[number] - there).abs().amax(dim=0)[whole[number]]
            assert not len(off) or float(off.max()) < 0.04  # of a mean of 1


def test_a_batch_depends_on_seed_and_step_alone(spheres: PackedSamples) -> None:
    simulator = PhotoSimulator(spheres, seed=4)
    first = simulator.batch(3, 4)
    simulator.batch(9, 2)
    assert equal(first, simulator.batch(3, 4)) and equal(first, PhotoSimulator(spheres, seed=4).batch(3, 4))
    assert not equal(first, PhotoSimulator(spheres, seed=5).batch(3, 4)) and not equal(first, simulator.batch(4, 4))


def test_hard_samples_are_seen_more_often_in_proportion_to_their_errors(spheres: PackedSamples) -> None:
    simulator = PhotoSimulator(spheres, hard_share=0.25, window=16)
    wanted = 0.1 + 0.2 * np.arange(len(spheres))
    for step in range(8):
        scales = simulator.batch(step, 2)
        owners = torch.cat([scale.examples for scale in scales])
        simulator.record_errors(scales, torch.tensor(wanted)[torch.tensor(simulator._drawn)[owners]])
    np.testing.assert_allclose(simulator.errors, wanted)
    drawn = np.array([simulator._index(number) for number in range(4 * 3000)]).reshape(-1, 4)
    np.testing.assert_array_equal(np.bincount(drawn[:, :3].ravel()), 9000 / len(spheres))  # in turn
    np.testing.assert_allclose(np.bincount(drawn[:, 3]) / 3000, wanted / wanted.sum(), atol=0.03)


def test_a_window_is_cut_from_the_whole_photograph(spheres: PackedSamples) -> None:
    corners = set()
    for step in range(8):
        (whole,), (cut,) = (PhotoSimulator(spheres, window=window, finer=()).batch(step, 2) for window in (0, 32))
        assert whole.weights.shape[1:] == (208, 208), "a multiple of JPEG's blocks"
        assert cut.truth.shape == (2, 3, 32, 32) and (cut.weights.sum(dim=(1, 2)) > 0).all()
        assert torch.equal(whole.maps["lights"], cut.maps["lights"])
        for one, part, weights in zip(whole.truth, cut.truth, cut.weights, strict=True):
            # A window that is the same has the same normal there.
            y, x = torch.nonzero(weights)[0].tolist()
            there = one[:, y : y + one.shape[1] - 31, x : x + one.shape[2] - 31]
            alike = torch.nonzero((there == part[:, y, x, None, None]).all(dim=0)).tolist()
            match = [(top, left) for top, left in alike if torch.equal(one[:, top : top + 32, left : left + 32], part)]
            assert len(match) == 1
            corners.add(match[0])
            assert weights[8:24, 8:24].any(), "its middle half holds some of the object"
    assert len(corners) > 12


def test_maps_are_those_that_estimates_are_made_from(spheres: PackedSamples) -> None:
    (scale,) = PhotoSimulator(spheres, finer=()).batch(1, 2)
    for number in range(2):
        maps = {name: values[number : number + 1] for name, values in scale.maps.items()}
        light = maps["photo"][0].permute(1, 2, 0).numpy()
        directions = maps["lights"].reshape(3, 3).double().numpy()
        seen = PhotoCrop(
            light, maps["mask"][0, 0].numpy() > 0, directions, maps["channel_means"].flatten().double().numpy()
        )
        for name in ("photo", "grey_world", "initial_normals", "initial_normals_grey_world", "lights", "channel_means"):
            np.testing.assert_allclose(
                feature_tensor(name, maps)[0].numpy(), feature_map(name, seen), atol=2e-5, err_msg=name
            )


def test_examples_that_have_a_white_photo_are_painted_grey(painted: PackedSamples) -> None:
    """The others are as they would be without; those that have one are painted grey, and equation 2 is exact there."""
    model = replace(IDEAL, colour_overlap=(0.4, 0.4), white_strengths=(1.0, 1.0))
    plain, white = (PhotoSimulator(painted, replace(model, white=share), finer=EVERY_SCALE) for share in (0.0, 0.5))
    seen: dict[bool, list[float]] = {False: [], True: []}
    for step in range(3):
        for without, scale in zip(plain.batch(step, 2), white.batch(step, 2), strict=True):
            given = scale.maps["given"][:, 1, 0, 0] > 0
            assert torch.equal(without.maps["photo"][~given], scale.maps["photo"][~given])
            off = torch.rad2deg(angle_between(feature_tensor("initial_normals", scale.maps), scale.truth))
            lit = inside(scale.lit * scale.maps["mask"]) & (scale.maps["photo"].amin(dim=1) > 0.1)
            for number, has_white in enumerate(given.tolist()):
                seen[has_white] += off[number][lit[number]].tolist()
    assert np.mean(seen[True]) < 1 < 5 < np.mean(seen[False])


def test_a_white_photo_that_says_nothing_is_not_said_to_be_given(painted: PackedSamples) -> None:
    """As in an estimate: here every pixel of it is clipped."""
    model = replace(IDEAL, white=1.0, exposure=(50.0, 50.0), bits=(8,))
    given = PhotoSimulator(painted, model).batch(0, 2)[0].maps["given"][:, 1]
    assert (given == 0).all()


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU is here")
@pytest.mark.parametrize("finer", [EVERY_SCALE, ()])
def test_a_gpu_takes_the_same_photographs(spheres: PackedSamples, finer: tuple[float, ...]) -> None:
    """But for the noise, which every device draws by a generator of its own, and values at the edge of a step."""
    model = replace(CaptureModel(), full_well=(np.inf, np.inf), read_noise=(0.0, 0.0))
    here, there = (
        PhotoSimulator(spheres, model, finer=finer, device=torch.device(name)).batch(1, 4) for name in ("cpu", "cuda")
    )
    for one, other in zip(here, there, strict=True):
        off = (one.maps["photo"] - other.maps["photo"].cpu()).abs()
        assert float((off > 1e-3).float().mean()) < 0.02 and float(off.mean()) < 1e-2
        torch.testing.assert_close(one.truth, other.truth.cpu(), atol=1e-4, rtol=0)
