"""The training loop: learning rate schedule, running mean of the weights, checkpoints that resume bit-exactly."""

import hashlib
import logging
import math
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.tensorboard import SummaryWriter

from mpsnet_core.errors import FileError, FormatError, InputError, SettingsError
from mpsnet_core.io.files import existing_file
from mpsnet_core.learning.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from mpsnet_core.learning.training.fine_tune import fit_lit_layer, load_exported_weights, read_exported
from mpsnet_core.learning.training.inputs import Batch, concatenate_scales, inputs_with_previous_scale, sample_patches
from mpsnet_core.learning.training.loss import Loss, loss_of
from mpsnet_core.learning.training.muon import Muon
from mpsnet_core.learning.training.networks import Network, build_network
from mpsnet_core.learning.training.packed import PackedSamples
from mpsnet_core.learning.training.photo_simulation import PhotoSimulator, Scale, views_of
from mpsnet_core.learning.training.recipe import TrainingConfig, capture_model
from mpsnet_core.learning.training.validation import Metrics, validate
from mpsnet_core.progress import Progress, silent, uninterrupted
from mpsnet_core.synthesis.job import JOB_FILE

log = logging.getLogger(__name__)

Precision = Literal["auto", "float32", "bfloat16"]
LOGGED_EVERY = 50  # steps
SAVED_EVERY = 300  # seconds
VALIDATIONS = 8  # evenly spaced over the recipe's steps, plus one at the end
VALIDATION_SEED = 1  # of the held-out samples' photographs
VALIDATION_CROP = 128
MUON_MAPS = 32  # Muon is used if both sides of a weight matrix have at least this length
# What PyTorch raises if a checkpoint's states do not fit.
_MISFIT = (AssertionError, AttributeError, LookupError, RuntimeError, TypeError, ValueError)
NORM_EXAMPLES = 64  # photographs to restore batch norms and the layer `lit` from, which exported files lack


@dataclass(frozen=True)
class Trained:
    """The result of a run."""

    network: Network
    """The network with the running mean of its weights, on the CPU."""
    recipe: TrainingConfig
    """How it was trained."""
    step: int
    """Number of steps done."""
    seconds: float
    """Training time in seconds."""
    metrics: Metrics | None
    """Metrics of the last validation, if there was one."""
    samples: int
    """Number of training samples."""
    fingerprint: str
    """Fingerprint of the samples' names and jobs."""
    hardware: str
    """The hardware that it was trained on."""
    precision: str
    """Precision of the layers: "float32" or "bfloat16"."""
    continues: dict[str, Any] | None = None
    """Training record of the exported network that it started from, None for random initial weights."""


@dataclass(frozen=True)
class TrainingPaths:
    """Files of a run."""

    checkpoint: Path | None = None
    """File of the checkpoint, written regularly and at the end, None for nowhere."""
    resume: Path | None = None
    """A checkpoint to resume from, or the .onnx file of a network to fine-tune."""
    logs: Path | None = None
    """Folder for TensorBoard."""
    cache: Path | None = None
    """Folder for the packed samples, None for a temporary one."""
    overwrite: bool = False
    """Whether the checkpoint may replace that of another run."""
    skip_damaged: bool = False
    """Whether damaged samples are left out."""


def train(
    recipe: TrainingConfig,
    samples: list[Path],
    validation: list[Path],
    *,
    paths: TrainingPaths | None = None,
    precision: Precision = "auto",
    stop_after: int = 0,
    anneal: int = 0,
    minutes: float = 0.0,
    progress: Progress = silent,
) -> Trained:
    """Train the recipe's network on the samples in some folders.

    Parameters
    ----------
    recipe
        Network, optimiser and schedule.
    samples, validation
        Folders of training samples and of held-out samples; no validation if there are none.
    paths
        Files to write and to resume from.
    precision
        Of the layers. "auto" is bfloat16 if the processor or GPU supports it.
    stop_after
        Stop after this many steps in all, to resume later; 0 for the recipe's end.
    anneal
        From the resumed checkpoint, lower the learning rate to zero over this many steps, and end. The checkpoint is
        left unchanged.
    minutes
        As `stop_after`, in minutes of this run.
    progress
        Called with the share done, 0 to 1, and a message.

    Raises
    ------
    InputError
        If options, samples or checkpoint cannot be used.
    Cancelled
        If `progress` raises it. The checkpoint is written first.

    Notes
    -----
    A resumed run ends with the same weights, bit for bit, as an uninterrupted one, on the same machine with the same
    number of threads.
    """
    paths = paths or TrainingPaths()
    if anneal and (stop_after or minutes):
        raise SettingsError("an anneal runs to its end; leave out --stop-after and --minutes, or --anneal")
    _check_paths(paths, anneal)
    run = _Run(recipe, samples, validation, paths, precision, progress)
    run.begin(paths.resume)
    end = run.begin_anneal(anneal, paths) if anneal else run.end(stop_after, paths)
    metrics = _learn(run, replace(paths, checkpoint=None) if anneal else paths, end, 60 * minutes, progress)
    return run.trained(metrics)


def _learn(run: "_Run", paths: TrainingPaths, end: int, seconds: float, progress: Progress) -> Metrics | None:
    """Train until step `end`, or for `seconds`. Returns the metrics of the last validation."""
    writer = None if paths.logs is None else SummaryWriter(str(paths.logs))
    between = run.recipe.steps // VALIDATIONS or 1
    metrics, begun, before, started = None, run.step, run.seconds, time.monotonic()
    saved = started
    try:
        while run.step < end:
            scales = run.simulator.batch(run.step, run.recipe.batch)
            loss = run.advance(scales)
            run.seconds = before + time.monotonic() - started
            if run.step % LOGGED_EVERY == 0:
                angle = math.degrees(float(loss.angle))
                progress((run.step - begun) / (end - begun), f"step {run.step}, {angle:.1f}°")
                if writer is not None:
                    writer.add_scalar("training/angle_deg", angle, run.step)
                    writer.add_scalar("training/expected_error", float(loss.expected), run.step)
                    writer.add_scalar("training/learning_rate", run.rate(run.step - 1), run.step)
            if run.held_out and (run.step % between == 0 or run.step == end):
                metrics = validate(run.mean(), run.held_out)
                log.info("step %d: %s on held-out samples", run.step, metrics)
                if writer is not None:
                    writer.add_scalar("validation/mae_deg", metrics.mae_deg, run.step)
            if time.monotonic() - saved > SAVED_EVERY:
                run.save(paths.checkpoint)
                saved = time.monotonic()
            if 0 < seconds < time.monotonic() - started:
                break
    finally:
        run.save(paths.checkpoint)
        if writer is not None:
            writer.close()
    if metrics is None and run.held_out:  # resumed at the recipe's end, for example
        metrics = validate(run.mean(), run.held_out)
    return metrics


def _check_paths(paths: TrainingPaths, anneal: int) -> None:
    """Raise InputError if there is nothing to resume from, or the run would overwrite another run's checkpoint."""
    checkpoint, resume = paths.checkpoint, paths.resume
    if resume is not None:  # fail before the samples are packed, which takes minutes
        existing_file(resume, "model" if resume.suffix.lower() == ".onnx" else "checkpoint")
    if anneal and resume is None:
        raise SettingsError("there is nothing to anneal; name a checkpoint to resume from")
    if anneal or checkpoint is None or not checkpoint.exists() or paths.overwrite:
        return
    if resume is None or not resume.exists() or not checkpoint.samefile(resume):
        raise FileError(f"{checkpoint} is of an earlier run; continue it with --resume, or replace it with --overwrite")


def _check_fit(recipe: TrainingConfig, network: Network) -> None:
    """Raise SettingsError if the recipe's crop or patches do not suit the network."""
    if network.kind != "patch":
        least = 2 * network.multiple  # batch norm needs two pixels on the coarsest scale
        if recipe.crop < least or recipe.crop % network.multiple:
            wanted = f"choose a multiple of {network.multiple} from {least}"
            raise SettingsError(f"{recipe.network} cannot be trained on a crop of {recipe.crop}; {wanted}")
        if recipe.patches:
            raise SettingsError(f"network {recipe.network} does not see patches; leave them out of the recipe")
    elif recipe.gradient_weight:
        raise SettingsError(f"network {recipe.network} sees patches, not gradients; leave out gradient_weight")
    elif recipe.hard_share:
        raise SettingsError(f"network {recipe.network} sees patches of many samples at once; leave out hard_share")
    elif not recipe.patches:
        raise SettingsError(f"network {recipe.network} sees patches; say in the recipe how many from each picture")
    elif 0 < recipe.crop < max(2, network.patch):
        raise SettingsError(f"a crop of {recipe.crop} holds no patch; choose 0, which is the whole picture, or more")


def learning_rate(recipe: TrainingConfig, step: int) -> float:
    """Learning rate of step `step`, 0 to steps - 1: linear warm-up, constant, linear decay to zero."""
    if step < recipe.warm_up:
        return recipe.learning_rate * (step + 1) / recipe.warm_up
    left = (recipe.steps - step) / recipe.decay if recipe.decay else 1.0
    return recipe.learning_rate * min(1.0, left)


class _Run:
    """The state of a run, which checkpoints store."""

    def __init__(
        self,
        recipe: TrainingConfig,
        samples: list[Path],
        validation: list[Path],
        paths: TrainingPaths,
        precision: Precision,
        progress: Progress,
    ) -> None:
        self.recipe = recipe
        self.device = device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        torch.manual_seed(recipe.seed)
        self.network = network = build_network(recipe.network, dict(recipe.options)).to(device)
        _check_fit(recipe, network)
        nn.utils.convert_conv2d_weight_memory_format(network, torch.channels_last)
        model, views = capture_model(recipe.capture), views_of(network, recipe.augment)
        simulator: Callable[..., PhotoSimulator] = partial(PhotoSimulator, model=model, device=device, **views)
        read = partial(PackedSamples, progress=progress, cache=paths.cache, skip_damaged=paths.skip_damaged)
        packed = read(samples)
        self.simulator = simulator(packed, seed=recipe.seed, window=recipe.crop, hard_share=recipe.hard_share)
        self.held_out: PhotoSimulator | None = None
        if validation:
            held_out = read(validation)
            self.held_out = simulator(held_out, seed=VALIDATION_SEED, window=VALIDATION_CROP, shuffled=False)
        self.fingerprint = _fingerprint(samples, packed.names)
        self.precision = resolved_precision(precision, device)
        torch.backends.cudnn.deterministic = True
        self.step, self.seconds = 0, 0.0
        self.continues: dict[str, Any] | None = None
        self.whole = True  # False within a step
        self.unproven: Path | None = None  # the resumed checkpoint, until a step was taken
        self.anneal: tuple[int, int] | None = None  # its first step, and number of steps
        self.optimisers = _optimisers(recipe, network, self.precision)
        self.mean_weights = self._weights()

    def end(self, stop_after: int, paths: TrainingPaths) -> int:
        """The step to end at: the recipe's last one, or an earlier one."""
        if 0 < stop_after <= self.step:
            raise SettingsError(f"{paths.resume} has had {self.step} steps, which --stop-after counts; give it more")
        return min(self.recipe.steps, stop_after or self.recipe.steps)

    def begin_anneal(self, steps: int, paths: TrainingPaths) -> int:
        """Lower the learning rate to zero over this many steps from here on. Returns the step that it ends at."""
        if learning_rate(self.recipe, self.step) <= 0:
            raise SettingsError(f"the learning rate of {paths.resume} is zero already; anneal from before its decay")
        self.anneal = (self.step, steps)
        return self.step + steps

    def rate(self, step: int) -> float:
        """The learning rate of a step."""
        if self.anneal is None:
            return learning_rate(self.recipe, step)
        begun, over = self.anneal
        return learning_rate(self.recipe, begun) * (1 - (step - begun) / over)

    @uninterrupted  # half a step cannot be resumed
    def advance(self, scales: list[Scale]) -> Loss:
        """Take one step of the optimisers. Raises FormatError if their states in the resumed checkpoint do not fit."""
        try:
            loss = self._advanced(scales)
        except _MISFIT as error:
            if self.unproven is None or isinstance(error, InputError):
                raise
            raise self._misfit(self.unproven, error) from None
        self.unproven = None
        return loss

    def _advanced(self, scales: list[Scale]) -> Loss:
        recipe, seed = self.recipe, _hashed_seed(self.recipe.seed, self.step, 0)
        self.whole = False
        # Dropout depends on the step alone: a resumed run draws the same.
        torch.manual_seed(seed)
        autocast = torch.autocast(self.device.type, torch.bfloat16, enabled=self.precision == "bfloat16")
        self.network.eval()
        with autocast:
            batch = self._batch(scales, seed)
        for optimiser in self.optimisers:
            for group in optimiser.param_groups:
                group["lr"] = self.rate(self.step)
            optimiser.zero_grad(set_to_none=True)
        self.network.train()
        if recipe.frozen_norms:
            for layer in self.network.modules():
                if isinstance(layer, nn.BatchNorm2d):
                    layer.eval()
        with autocast:
            prediction = self.network(*batch.inputs)
        loss = loss_of(prediction, batch.truth, batch.weights, recipe.error_weight, recipe.gradient_weight, batch.lit)
        torch.autograd.backward(loss.total)
        gradients = nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        for what, value in (("loss", loss.total), ("gradients", gradients)):
            if not torch.isfinite(value):
                raise SettingsError(f"{what} of step {self.step} not finite; lower the learning rate or use float32")
        for optimiser in self.optimisers:
            optimiser.step()
        if recipe.hard_share:
            self.simulator.record_errors(scales, loss.angles)
        self.step += 1
        self._update_mean_weights()
        self.whole = True
        return loss

    @torch.no_grad()
    def _batch(self, scales: list[Scale], seed: int) -> Batch:
        batch = concatenate_scales(scales, inputs_with_previous_scale(self.network, scales))
        if self.network.kind != "patch":
            return batch
        return sample_patches(batch, self.network, self.recipe.patches, torch.Generator().manual_seed(seed))

    @torch.no_grad()
    def _update_mean_weights(self) -> None:
        """Update the running mean of the weights."""
        # Forget early weights faster: after ten steps, a mean over 1000 would still be the initial weights.
        decay = min(self.recipe.ema, (1 + self.step) / (10 + self.step))
        for name, value in self.network.state_dict().items():
            if value.dtype.is_floating_point:
                self.mean_weights[name].lerp_(value, 1 - decay)
            else:
                self.mean_weights[name].copy_(value)

    def _weights(self) -> dict[str, Tensor]:
        return {name: value.detach().clone() for name, value in self.network.state_dict().items()}

    def mean(self) -> Network:
        """A new network with the running mean of the weights."""
        network = build_network(self.recipe.network, dict(self.recipe.options)).to(self.device)
        network.load_state_dict(self.mean_weights)
        return network.eval()

    def save(self, path: Path | None) -> None:
        """Write the checkpoint, unless a step failed midway: half a step cannot be resumed."""
        if path is None or not self.whole:
            return
        weights, states = self.network.state_dict(), [optimiser.state_dict() for optimiser in self.optimisers]
        errors = torch.from_numpy(self.simulator.errors.copy()) if self.recipe.hard_share else torch.empty(0)
        facts = self.seconds, self.fingerprint, self.precision, errors, self.continues
        write_checkpoint(path, Checkpoint(self.recipe, self.step, weights, self.mean_weights, states, *facts))

    def trained(self, metrics: Metrics | None) -> Trained:
        """The result of the run, with the metrics of the last validation."""
        of_samples = len(self.simulator.samples), self.fingerprint
        facts = *of_samples, _hardware(self.device), self.precision, self.continues
        return Trained(self.mean().cpu(), self.recipe, self.step, self.seconds, metrics, *facts)

    def begin(self, path: Path | None) -> None:
        """Start from a checkpoint or an exported network, if one is given."""
        if path is None and self.recipe.frozen_norms:
            raise SettingsError("frozen_norms is for a network that is trained further; name it with --resume")
        if path is not None and path.suffix.lower() == ".onnx":
            self.fine_tune(path)
        elif path is not None:
            self.resume(path)

    def resume(self, path: Path) -> None:
        found = read_checkpoint(path)
        # The commands that made the samples do not affect the training.
        if replace(found.recipe, samples=self.recipe.samples) != self.recipe:
            raise SettingsError(f"checkpoint {path} is of another recipe; resume with the one it began with")
        if found.samples != self.fingerprint:  # more samples were made, for example; only their order starts over
            log.warning("checkpoint %s was trained on other samples before", path)
        if found.precision != self.precision:
            raise SettingsError(f"checkpoint {path} began with --precision {found.precision}; resume with that")
        try:
            self.network.load_state_dict(found.weights)
            self.mean_weights = {name: value.to(self.device) for name, value in found.mean_weights.items()}
            self.mean()
            for optimiser, state in zip(self.optimisers, found.optimisers, strict=True):
                optimiser.load_state_dict(state)
        except _MISFIT as error:
            raise self._misfit(path, error) from None
        if found.samples == self.fingerprint and len(found.errors) == len(self.simulator.errors):
            self.simulator.errors = found.errors.numpy().astype(np.float64)
        self.unproven = path
        self.step, self.seconds, self.continues = found.step, found.seconds, found.continues

    def _misfit(self, path: Path, error: Exception) -> FormatError:
        reason = " ".join(str(error).split())[:200]
        return FormatError(f"checkpoint {path} does not fit the network: {reason}; resume from another")

    def fine_tune(self, path: Path) -> None:
        exported = read_exported(path)
        if exported.step >= self.recipe.steps:
            raise SettingsError(f"model {path} has had {exported.step} steps of {self.recipe.steps}; give more")
        self.network.eval()
        batch = self._batch(self.simulator.batch(0, NORM_EXAMPLES), 0)
        load_exported_weights(self.network, exported, batch.inputs)
        fit_lit_layer(self.network, batch)
        self.mean_weights = self._weights()
        self.step, self.continues = exported.step, exported.record


def _optimisers(recipe: TrainingConfig, network: Network, precision: str) -> list[torch.optim.Optimizer]:
    single, matrices, rest = [], [], []
    for value in network.parameters():
        if value.ndim <= 1:
            single.append(value)
        # Muon trains the inner layers. First and last layers, which have few maps, use AdamW, as do biases and norms.
        elif recipe.optimiser == "muon" and min(value.flatten(1).shape) >= MUON_MAPS:
            matrices.append(value)
        else:
            rest.append(value)
    groups = [{"params": rest, "weight_decay": recipe.weight_decay}, {"params": single, "weight_decay": 0.0}]
    optimisers: list[torch.optim.Optimizer] = [torch.optim.AdamW(groups, lr=recipe.learning_rate)]
    if matrices:
        dtype = torch.bfloat16 if precision == "bfloat16" else torch.float32
        optimisers.append(Muon(matrices, lr=recipe.learning_rate, weight_decay=recipe.weight_decay, dtype=dtype))
    return optimisers


def _fingerprint(folders: list[Path], names: list[str]) -> str:
    """Hash of the samples' names and of each folder's job file."""
    digest = hashlib.sha256("\n".join(names).encode())
    for folder in folders:
        if (folder / JOB_FILE).is_file():
            digest.update((folder / JOB_FILE).read_bytes())
    return digest.hexdigest()[:16]


def _hashed_seed(*key: int) -> int:
    return int.from_bytes(hashlib.sha256(repr(key).encode()).digest()[:7], "big")


def resolved_precision(precision: Precision, device: torch.device) -> str:
    """The precision of layers: "auto" is bfloat16 where the hardware computes in it."""
    if precision != "auto":
        return precision
    if device.type == "cuda":
        return "bfloat16" if torch.cuda.is_bf16_supported(including_emulation=False) else "float32"
    # Without hardware support bfloat16 is slower than float32.
    quick = getattr(torch.cpu, "_is_avx512_bf16_supported", lambda: False)()
    return "bfloat16" if quick else "float32"


def _hardware(device: torch.device) -> str:
    """The hardware, for the training record."""
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    threads, instructions = torch.get_num_threads(), torch.backends.cpu.get_cpu_capability()
    return f"{threads} CPU thread{'s' * (threads > 1)}, {platform.machine()} with {instructions}"
