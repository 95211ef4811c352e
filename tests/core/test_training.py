"""The training room: patches, loss, and a loop that stops and goes on as if it had not."""

import itertools
import math
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from small_networks import SMALL, recipe_data
from sphere_sample import sphere_sample
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from torch import Tensor, nn

from mpsnet_core.cli import _stop
from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.learning.training.checkpoint import read_checkpoint
from mpsnet_core.learning.training.export import export_onnx
from mpsnet_core.learning.training.fine_tune import fit_lit_layer
from mpsnet_core.learning.training.inputs import Batch, sample_patches
from mpsnet_core.learning.training.loop import LOGGED_EVERY, Trained, TrainingPaths, learning_rate, train
from mpsnet_core.learning.training.loss import angle_between, loss_of
from mpsnet_core.learning.training.networks import build_network
from mpsnet_core.learning.training.networks.network import IntermediateOutputs, Prediction
from mpsnet_core.learning.training.recipe import TrainingConfig, recipe_from_data
from mpsnet_core.synthesis.job import SampleJob, sample_path
from mpsnet_core.synthesis.make import make_sample
from mpsnet_core.synthesis.sample import write_sample

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three samples of the synthesis and a sphere."""
    folder = tmp_path_factory.mktemp("samples")
    job = SampleJob("synthesis", 3, seed=5, size=40)
    for number in range(3):
        make_sample(job, number, sample_path(folder, number))
    write_sample(sample_path(folder, 3), sphere_sample(48, number=3))
    return folder


@pytest.fixture(scope="module")
def ball(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ball")
    write_sample(sample_path(folder, 0), sphere_sample(32))
    return folder


def recipe(network: str, **changes: Any) -> TrainingConfig:
    return recipe_from_data(recipe_data(network, **changes))


def run(of: TrainingConfig, samples: Path, checkpoint: Path, **options: Any) -> Trained:
    paths = TrainingPaths(checkpoint, options.pop("resume", None), options.pop("logs", None))
    return train(of, [samples], options.pop("validation", []), paths=paths, **options)


def assert_same(one: Path, other: Path) -> None:
    """Two checkpoints that agree to the bit in all but the time they took."""

    def walk(a: Any, b: Any) -> None:
        if isinstance(a, Tensor):
            assert torch.equal(a.nan_to_num(-1), b.nan_to_num(-1))
        elif isinstance(a, dict):
            assert a.keys() == b.keys()
            for key in a:
                walk(a[key], b[key])
        elif isinstance(a, list):
            for x, y in zip(a, b, strict=True):
                walk(x, y)
        else:
            assert a == b

    walk(*(read_checkpoint(path)._replace(seconds=0.0)._asdict() for path in (one, other)))


# The loss


def test_the_angle_is_the_arc_cosine_s() -> None:
    random = np.random.default_rng(0)
    a, b = (vectors / np.linalg.norm(vectors, axis=1, keepdims=True) for vectors in random.normal(size=(2, 500, 3)))
    b[:100] = a[:100] + random.normal(size=(100, 3)) * 1e-3  # small angles
    b[:100] /= np.linalg.norm(b[:100], axis=1, keepdims=True)
    found = angle_between(torch.from_numpy(a).float(), torch.from_numpy(b).float()).numpy()
    np.testing.assert_allclose(found, np.arccos((a * b).sum(axis=1)), atol=2e-6)


def test_the_angle_s_slope_is_finite_where_vectors_meet_and_oppose() -> None:
    up = torch.tensor([[0.0, 0.0, 1.0]])
    for sign, angle in ((1, 0), (-1, math.pi)):
        vector = up.clone().requires_grad_()
        found = angle_between(vector, sign * up)
        found.sum().backward()
        assert float(found.detach()) == pytest.approx(angle, abs=1e-5)
        assert vector.grad is not None and vector.grad.isfinite().all()


def test_the_expected_error_is_learned_as_the_mean_and_teaches_the_normals_nothing() -> None:
    random = torch.Generator().manual_seed(0)
    normals, truth = (nn.functional.normalize(torch.randn(4, 3, 5, 5, generator=random)) for _ in range(2))
    weights = (torch.rand(4, 5, 5, generator=random) > 0.3).float()
    mean = float(angle_between(normals, truth)[weights > 0].mean())
    expected = torch.full((4, 1, 5, 5), mean, requires_grad=True)
    normals.requires_grad_()
    loss = loss_of(Prediction(normals, expected), truth, weights, error_weight=0.7)
    assert float(loss.angle) == pytest.approx(mean)
    assert loss.total.item() == pytest.approx(mean + 0.7 * float(loss.expected))
    loss.total.backward()
    assert expected.grad is not None and float(expected.grad.sum()) == pytest.approx(0, abs=1e-6), "least at the mean"
    assert not expected.grad[:, 0][weights == 0].any()
    gradient, normals.grad = normals.grad, None
    loss_of(Prediction(normals), truth, weights, error_weight=0.7).total.backward()
    assert torch.equal(gradient, normals.grad)


def test_equation_2_inside_learns_where_all_lights_reach_and_is_trusted_where_it_is_better() -> None:
    random = torch.Generator().manual_seed(0)
    formula, own, truth = (nn.functional.normalize(torch.randn(2, 3, 5, 5, generator=random)) for _ in range(3))
    lit = (torch.rand(2, 3, 5, 5, generator=random) > 0.3).float()
    trust = torch.zeros(2, 1, 5, 5)
    for values in (formula, own, trust):
        values.requires_grad_()
    prediction = Prediction(
        own.detach(), torch.zeros(2, 1, 5, 5), IntermediateOutputs(torch.zeros_like(lit), formula, own, trust)
    )
    loss_of(prediction, truth, torch.ones(2, 5, 5), error_weight=1.0, lit=lit).total.backward()
    assert formula.grad is not None and trust.grad is not None and own.grad is None
    assert torch.equal(formula.grad.abs().sum(dim=1) > 0, lit.all(dim=1))
    nearer = nn.functional.normalize(formula.detach() - 0.01 * formula.grad)
    assert (angle_between(nearer, truth) <= angle_between(formula, truth) + 1e-6).all()
    better = angle_between(formula, truth) < angle_between(own, truth)
    assert torch.equal(trust.grad[:, 0] < 0, better), "a lower loss for more trust"


# Patches


def test_patches_are_cut_around_pixels_that_count() -> None:
    network, random = build_network("mpsnet", {"width": 0.02}), torch.Generator().manual_seed(0)
    photo, normals, truth = torch.rand((3, 3, 3, 9, 12), generator=random)
    weights = (torch.rand((3, 9, 12), generator=random) < 0.3).float()
    weights[1] = 0  # nothing counts there
    batch = Batch((photo, normals), truth, weights)
    patches = sample_patches(batch, network, 30, random)
    assert patches.truth.shape == (60, 3) and patches.inputs[0].shape == (60, 3, 5, 5) and patches.weights.all()
    for number in range(60):
        picture = (0, 2)[number // 30]
        ((y, x),) = np.argwhere((truth[picture] == patches.truth[number, :, None, None]).all(dim=0).numpy())
        assert weights[picture, y, x] == 1
        for whole, patch in zip(batch.inputs, patches.inputs, strict=True):
            padded = np.pad(whole[picture].numpy(), [(0, 0), (2, 2), (2, 2)])
            np.testing.assert_array_equal(patch[number].numpy(), padded[:, y : y + 5, x : x + 5])


# The loop


def test_the_learning_rate_rises_stays_and_falls_to_nothing() -> None:
    of = recipe("psfcn", steps=1000, warm_up=100, decay=200, learning_rate=0.5)
    rates = np.array([learning_rate(of, step) for step in range(1000)])
    np.testing.assert_allclose(rates[:100], 0.5 * np.arange(1, 101) / 100)
    np.testing.assert_allclose(rates[100:800], 0.5)
    np.testing.assert_allclose(rates[800:], 0.5 * np.arange(200, 0, -1) / 200)


@pytest.mark.parametrize(("network", "least"), [("mpsnet", 0.7), ("psfcn", 0.7)])
def test_training_lowers_the_error_on_what_is_seen_again_and_again(network: str, least: float, ball: Path, tmp_path):
    of = recipe(network, steps=60, learning_rate=5e-3, ema=0.9)
    options = {"validation": [ball]}
    before = run(of, ball, tmp_path / "c", stop_after=1, **options).metrics
    after = run(of, ball, tmp_path / "d", logs=tmp_path / "logs", **options).metrics
    assert before is not None and after is not None
    assert after.mae_deg < least * before.mae_deg
    (log,) = (tmp_path / "logs").iterdir()
    for scalar in (b"training/angle_deg", b"training/learning_rate", b"validation/mae_deg"):
        assert scalar in log.read_bytes()


def test_annealing_leaves_the_checkpoint_and_ends_with_a_rate_of_zero(samples: Path, tmp_path: Path) -> None:
    of, checkpoint = recipe("multiscale", steps=100), tmp_path / "c"
    run(of, samples, checkpoint, stop_after=2)
    before = checkpoint.read_bytes()
    logs = tmp_path / "logs"
    ended = run(of, samples, checkpoint, resume=checkpoint, anneal=LOGGED_EVERY - 2, logs=logs)
    assert ended.step == LOGGED_EVERY
    assert checkpoint.read_bytes() == before
    (log,) = EventAccumulator(str(logs)).Reload().Scalars("training/learning_rate")
    assert log.value == pytest.approx(of.learning_rate / (LOGGED_EVERY - 2)), "of the last step, whose next has none"
    with pytest.raises(InputError, match="there is nothing to anneal; name a checkpoint to resume from"):
        run(of, samples, tmp_path / "d", anneal=3)
    for early in ({"stop_after": 4}, {"minutes": 0.1}):
        with pytest.raises(InputError, match="an anneal runs to its end; leave out --stop-after and --minutes"):
            run(of, samples, checkpoint, resume=checkpoint, anneal=3, **early)


@pytest.mark.parametrize("network", ["multiscale", "mpsnet"])
def test_an_exported_network_goes_on_at_its_step(network: str, samples: Path, tmp_path: Path) -> None:
    """With its weights and a new optimiser; the record keeps what was before."""
    exported, checkpoint = tmp_path / "model.onnx", tmp_path / "c"
    export_onnx(run(recipe(network, steps=4), samples, tmp_path / "first"), exported)
    further = recipe(network, steps=6)
    # A step moves the statistics of batch norms, and so the answers: by 0.026 here, half floats by 0.0003.
    held = replace(further, learning_rate=1e-8, frozen_norms=True)
    still = run(held, samples, tmp_path / "still", resume=exported, stop_after=5)
    seen = [torch.rand(2, 3, 5, 5)] * 2
    if network == "multiscale":
        rig = torch.cat([torch.eye(3).reshape(1, 9), torch.ones(1, 6)], dim=1).reshape(1, 15, 1, 1)
        seen = [torch.rand(2, 8, 32, 32), rig.repeat(2, 1, 1, 1)]
    given = dict(zip(still.network.inputs, (values.numpy() for values in seen), strict=True))
    answer = still.network.eval()(*seen).normals.detach().numpy()
    np.testing.assert_allclose(answer, OnnxModel(exported).session.run(None, given)[0], atol=1e-4)
    first = run(further, samples, checkpoint, resume=exported, stop_after=5)
    assert (first.step, first.continues) == (5, OnnxModel(exported).record)
    last = run(further, samples, checkpoint, resume=checkpoint)
    assert (last.step, last.continues) == (6, first.continues)
    export_onnx(last, tmp_path / "further.onnx")
    record = OnnxModel(tmp_path / "further.onnx").record
    assert record is not None and record["continues"]["steps"] == 4
    before = checkpoint.read_bytes()
    with pytest.raises(InputError, match="of an earlier run; continue it with --resume"):
        run(further, samples, checkpoint, resume=exported)
    assert checkpoint.read_bytes() == before
    with pytest.raises(InputError, match=r"model\.onnx has had 4 steps, which --stop-after counts"):
        run(further, samples, tmp_path / "none", resume=exported, stop_after=4)
    with pytest.raises(InputError, match="has had 4 steps of 4; give more"):
        run(recipe(network, steps=4), samples, tmp_path / "again", resume=exported)


def test_a_network_to_be_fine_tuned_knows_which_lights_reach() -> None:
    """Where its own maps tell it: half of the pixels fit the layer, the others are told by it."""
    torch.manual_seed(2)
    network = build_network("multiscale", SMALL["multiscale"])
    rig = torch.cat([torch.eye(3).reshape(1, 9), torch.ones(1, 6)], dim=1).reshape(1, 15, 1, 1)
    inputs = (torch.rand(2, 8, 32, 32), rig.repeat(2, 1, 1, 1))
    maps = []
    network.joined.register_forward_hook(lambda _, __, answer: maps.append(answer.detach()))
    network.eval()(*inputs)
    told = torch.einsum("kc,nchw->nkhw", torch.randn(3, maps[0].shape[1]), maps[0])
    lit = (told > told.median()).float()
    weights = (torch.arange(32) % 2).expand(2, 32, 32)
    fit_lit_layer(network, Batch(inputs, torch.zeros(2, 3, 32, 32), weights, lit))
    found = network.lit(maps[0]) > 0
    others = weights[:, None].expand(lit.shape) == 0
    assert float((found == (lit > 0.5))[others].float().mean()) > 0.97


def test_frozen_norms_keep_their_means_and_variances(samples: Path, tmp_path: Path) -> None:
    exported = tmp_path / "model.onnx"
    export_onnx(run(recipe("multiscale", steps=4), samples, tmp_path / "first"), exported)
    of = recipe("multiscale", steps=7, frozen_norms=True)
    begun = run(of, samples, tmp_path / "c", resume=exported, stop_after=5).network.state_dict()
    ended = run(of, samples, tmp_path / "c", resume=tmp_path / "c").network.state_dict()
    running = [name for name in begun if "running" in name]
    assert running and all(torch.equal(begun[name], ended[name]) for name in running)
    assert not torch.equal(begun["answer.weight"], ended["answer.weight"])
    with pytest.raises(InputError, match="frozen_norms is for a network that is trained further"):
        run(of, samples, tmp_path / "d")


@pytest.mark.parametrize(("network", "hard_share"), [("mpsnet", 0), ("multiscale", 0), ("multiscale", 0.5)])
def test_a_resumed_run_ends_with_the_same_bits(network: str, hard_share: float, samples: Path, tmp_path: Path) -> None:
    of, whole, halves = recipe(network, hard_share=float(hard_share)), tmp_path / "whole", tmp_path / "halves"
    straight = run(of, samples, whole)
    half = run(of, samples, halves, stop_after=3)
    assert (half.step, straight.step) == (3, 6)
    resumed = run(of, samples, halves, resume=halves)
    assert_same(whole, halves)
    weights = [trained.network.state_dict() for trained in (straight, resumed, half)]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])
    assert not all(torch.equal(weights[0][name], weights[2][name]) for name in weights[0])


def test_a_run_goes_on_with_other_samples_and_says_so(ball: Path, samples: Path, tmp_path, caplog) -> None:
    of, checkpoint = recipe("demultiplexer", crop=16), tmp_path / "c"
    run(of, ball, checkpoint, stop_after=3)
    run(of, ball, checkpoint, resume=checkpoint, stop_after=4)
    assert not caplog.messages
    other = replace(of, samples=("their command",))
    assert run(other, samples, checkpoint, resume=checkpoint).step == 6
    assert caplog.messages == [f"checkpoint {checkpoint} was trained on other samples before"]


def interrupted(of: TrainingConfig, samples: Path, checkpoint: Path, stop: Callable[..., Any]) -> None:
    with pytest.raises((Cancelled, KeyboardInterrupt)):
        run(of, samples, checkpoint, progress=stop)


def test_a_cancelled_run_leaves_a_checkpoint_to_go_on_from(ball: Path, tmp_path: Path) -> None:
    of, whole, parts = recipe("demultiplexer", steps=LOGGED_EVERY + 3, batch=1, crop=16), tmp_path / "w", tmp_path / "p"

    def stop(fraction: float, message: str) -> None:
        if message.startswith("packing"):
            return
        assert fraction == LOGGED_EVERY / of.steps and message.startswith(f"step {LOGGED_EVERY}, ")
        raise Cancelled

    interrupted(of, ball, parts, stop)
    assert read_checkpoint(parts).step == LOGGED_EVERY
    run(of, ball, parts, resume=parts)
    run(of, ball, whole)
    assert_same(whole, parts)


def test_who_interrupts_within_a_step_waits_for_its_end(samples: Path, tmp_path: Path) -> None:
    """A batch norm's means are new when a step is half done, its weights are not: it could not be gone on from."""
    of, whole, parts = recipe("multiscale"), tmp_path / "whole", tmp_path / "parts"
    forwards = itertools.count(1)

    def interrupt(module: nn.Module, given: Any, out: Any) -> None:
        if isinstance(module, nn.BatchNorm2d) and module.training and next(forwards) == 40:
            signal.raise_signal(signal.SIGINT)

    hook = nn.modules.module.register_module_forward_hook(interrupt)
    before = signal.signal(signal.SIGINT, _stop)
    try:
        with pytest.raises(KeyboardInterrupt):
            run(of, samples, parts)
    finally:
        signal.signal(signal.SIGINT, before)
        hook.remove()
    assert 1 < read_checkpoint(parts).step < 6
    run(of, samples, parts, resume=parts)
    run(of, samples, whole)
    assert_same(whole, parts)


def test_the_mean_of_the_weights_is_what_becomes_the_model(ball: Path, tmp_path: Path) -> None:
    def network_of(ema: float) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
        checkpoint = tmp_path / f"{ema}.checkpoint"
        trained = run(recipe("demultiplexer", steps=3, crop=16, ema=ema), ball, checkpoint)
        return trained.network.state_dict(), read_checkpoint(checkpoint).weights

    for ema, same_bits in ((0.0, True), (0.9, False)):
        mean, last = network_of(ema)
        assert all(torch.equal(mean[name], last[name]) for name in mean) == same_bits
