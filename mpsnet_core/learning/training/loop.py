"""The training loop: warm-up, constant rate, decay; a running mean of the weights; checkpoints that resume bit-exactly.

Started by ``torchrun``, it shares every step's batch between the processes.
"""

import hashlib
import logging
import math
import os
import platform
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel
from torch.utils.tensorboard import SummaryWriter

from mpsnet_core.errors import InputError
from mpsnet_core.learning.training.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from mpsnet_core.learning.training.fine_tune import read_exported, take_weights
from mpsnet_core.learning.training.inputs import joined, patches_of, with_previous
from mpsnet_core.learning.training.loss import Loss, loss_of
from mpsnet_core.learning.training.muon import Muon
from mpsnet_core.learning.training.networks import Network, build_network
from mpsnet_core.learning.training.packed import PackedSamples
from mpsnet_core.learning.training.photographing import Photographer, Scale
from mpsnet_core.learning.training.recipe import TrainingRecipe
from mpsnet_core.learning.training.signals import held_signals
from mpsnet_core.learning.training.validation import Figures, validate
from mpsnet_core.progress import Progress, silent
from mpsnet_core.synthesis.job import JOB_FILE

log = logging.getLogger(__name__)

Precision = Literal["auto", "float32", "bfloat16"]
LOGGED_EVERY = 50  # steps
VALIDATION_SEED = 1  # of its photographs
VALIDATION_CROP = 128
MUON_MAPS = 32  # the least of a weight matrix's two sides for Muon
NORM_EXAMPLES = 64  # from which a network that is trained further has its batch norms' means


@dataclass(frozen=True)
class Trained:
    """What a run gave. network: with the running mean of its weights, on the CPU. figures: of the last validation.
    samples: how many it was trained on; fingerprint: of their names and jobs, which a resumed run's must share.
    continues: the record of the exported network whose weights it began with, None where they were drawn.
    rank: this process' number where there are several; the others' networks are not kept, but for number 0's."""

    network: Network
    recipe: TrainingRecipe
    step: int
    seconds: float
    figures: Figures | None
    samples: int
    fingerprint: str
    hardware: str
    precision: str
    continues: dict[str, Any] | None = None
    rank: int = 0


@dataclass(frozen=True)
class Places:
    """Where a run's files are. checkpoint: written now and then and at the end, None for nowhere; resume: one to go on
    from, or the .onnx file of a network, whose weights are trained further; logs: folder for TensorBoard."""

    checkpoint: Path | None = None
    resume: Path | None = None
    logs: Path | None = None


def train(
    recipe: TrainingRecipe,
    samples: list[Path],
    validation: list[Path],
    *,
    places: Places | None = None,
    precision: Precision = "auto",
    stop_after: int = 0,
    anneal: int = 0,
    minutes: float = 0.0,
    minutes_between_checkpoints: float = 5.0,
    validations: int = 8,
    progress: Progress = silent,
) -> Trained:
    """Train the recipe's network on the samples in some folders.

    validation: folders of samples that are held out; none for no validation. precision: of the layers; "auto" is
    bfloat16 where the processor or GPU computes with it. stop_after: steps, when to stop before the recipe's end (0: at
    its end), to go on later. anneal: from the checkpoint that is resumed, let the learning rate fall to nothing over so
    many steps, and end; the checkpoint stays as it is, to go on from. minutes: as stop_after, by the clock.
    validations: how many, evenly over the run, the last at its end.

    A run that was resumed from a checkpoint gives the same weights, bit for bit, as one that was never stopped, on the
    same machine with the same number of threads. Of several processes the first that is asked to stop ends the others,
    and the last checkpoint stands.

    Raises InputError where the checkpoint is of another recipe, and Cancelled where `progress` does; the checkpoint is
    written then, too.
    """
    places = places or Places()
    with _processes() as (rank, processes):
        if recipe.batch % processes:
            raise InputError(f"a batch of {recipe.batch} cannot be shared by {processes} processes; mend the recipe")
        device = torch.device("cuda", rank % torch.cuda.device_count()) if torch.cuda.is_available() else _CPU
        torch.manual_seed(recipe.seed)
        network = build_network(recipe.network, dict(recipe.options)).to(device)
        _check_fit(recipe, network)
        nn.utils.convert_conv2d_weight_memory_format(network, torch.channels_last)
        packed = PackedSamples(samples, recipe.kinds, progress)
        photographer = Photographer.of(network, packed, seed=recipe.seed, window=recipe.crop, device=device)
        held_out = None
        if validation:
            packed_too = PackedSamples(validation, (), progress)
            held_out = Photographer.of(
                network, packed_too, seed=VALIDATION_SEED, window=VALIDATION_CROP, shuffled=False, device=device
            )
        run = _Run(recipe, network, device, precision, _fingerprint(samples, packed.names))
        if anneal and places.resume is None:
            raise InputError("there is nothing to anneal; name a checkpoint to resume from")
        if not anneal:
            _check_earlier(places)
        if places.resume is not None and places.resume.suffix.lower() == ".onnx":
            run.fine_tune(places.resume, photographer)
        elif places.resume is not None:
            run.resume(places.resume)
        end = min(recipe.steps, stop_after or recipe.steps)
        if anneal:
            places = replace(places, checkpoint=None)
            run.anneal, end = (run.step, anneal), run.step + anneal
        writer = SummaryWriter(str(places.logs)) if places.logs is not None and rank == 0 else None
        model = network if processes == 1 else DistributedDataParallel(network)
        figures, saved, started, before = None, time.monotonic(), time.monotonic(), run.seconds
        told = recipe.steps // max(validations, 1) or 1
        try:
            while run.step < end:
                scales = photographer.batch(run.step * processes + rank, recipe.batch // processes)
                with held_signals():
                    try:
                        loss = run.advance(model, scales, rank)
                    except RuntimeError as error:
                        if processes == 1:
                            raise
                        reason = " ".join(str(error).split())[:200]
                        raise InputError(
                            f"another of the {processes} processes ended ({reason}); go on from the last checkpoint"
                        ) from None
                run.seconds = before + time.monotonic() - started
                if run.step % LOGGED_EVERY == 0 and rank == 0:
                    progress(run.step / recipe.steps, f"step {run.step}, {math.degrees(float(loss.angle)):.1f}°")
                    if writer is not None:
                        writer.add_scalar("training/angle_deg", math.degrees(float(loss.angle)), run.step)
                        writer.add_scalar("training/expected_error", float(loss.expected), run.step)
                        writer.add_scalar("training/learning_rate", run.rate(run.step - 1), run.step)
                if held_out and rank == 0 and (run.step % told == 0 or run.step == end):
                    figures = validate(run.mean(), held_out)
                    log.info("step %d: %s on held-out samples", run.step, figures)
                    if writer is not None:
                        writer.add_scalar("validation/mae_deg", figures.mae_deg, run.step)
                if time.monotonic() - saved > 60 * minutes_between_checkpoints:
                    run.save(places.checkpoint, rank)
                    saved = time.monotonic()
                if minutes and _agreed(time.monotonic() - started > 60 * minutes, processes, device):
                    break
        finally:
            run.save(places.checkpoint, rank)
            if writer is not None:
                writer.close()
        hardware = _hardware(device)
        hardware = hardware if processes == 1 else f"{processes} x {hardware}"
        if figures is None and held_out and rank == 0:  # resumed at the recipe's end
            figures = validate(run.mean(), held_out)
        return Trained(
            run.mean().cpu(),
            recipe,
            run.step,
            run.seconds,
            figures,
            len(packed),
            run.samples,
            hardware,
            run.precision,
            run.continues,
            rank,
        )


_CPU = torch.device("cpu")


def _check_earlier(places: Places) -> None:
    """Raise InputError where this run would write over the checkpoint of another."""
    checkpoint, resume = places.checkpoint, places.resume
    if checkpoint is None or not checkpoint.exists():
        return
    if resume is None or not resume.exists() or not checkpoint.samefile(resume):
        raise InputError(f"{checkpoint} is of an earlier run; go on from it with --resume, or remove it to begin anew")


def _check_fit(recipe: TrainingRecipe, network: Network) -> None:
    """Raise InputError where the pictures that a step sees are none that the network takes."""
    if network.kind != "patch":
        least = 2 * network.multiple  # batch norm needs two pixels on the coarsest scale
        if recipe.crop < least or recipe.crop % network.multiple:
            raise InputError(
                f"network {recipe.network} cannot be trained on a crop of {recipe.crop}; "
                f"choose a multiple of {network.multiple} from {least}"
            )
        if recipe.patches:
            raise InputError(f"network {recipe.network} does not see patches; leave them out of the recipe")
    elif not recipe.patches:
        raise InputError(f"network {recipe.network} sees patches; say in the recipe how many from each picture")
    elif 0 < recipe.crop < max(2, network.patch):
        raise InputError(f"a crop of {recipe.crop} holds no patch; choose 0, which is the whole picture, or more")


def learning_rate(recipe: TrainingRecipe, step: int) -> float:
    """Of step `step`, 0 to steps - 1: a straight rise, then constant, then a straight fall to nothing."""
    if step < recipe.warm_up:
        return recipe.learning_rate * (step + 1) / recipe.warm_up
    left = (recipe.steps - step) / recipe.decay if recipe.decay else 1.0
    return recipe.learning_rate * min(1.0, left)


class _Run:
    """A run's moving parts: what a checkpoint keeps."""

    def __init__(
        self,
        recipe: TrainingRecipe,
        network: Network,
        device: torch.device,
        precision: Precision,
        samples: str,
    ) -> None:
        self.recipe, self.network, self.device, self.samples = recipe, network, device, samples
        self.precision = _computed(precision, device)
        torch.backends.cudnn.deterministic = True
        self.step, self.seconds = 0, 0.0
        self.continues: dict[str, Any] | None = None
        self.whole = True  # False within a step
        decayed = [value for value in network.parameters() if value.ndim > 1]
        others = [value for value in network.parameters() if value.ndim <= 1]
        self.anneal: tuple[int, int] | None = None  # the step at which it begins, and over how many
        # Muon is for the layers between; what sees and says directions, of few maps, is AdamW's as single numbers are.
        inner = [value for value in decayed if recipe.optimiser == "muon" and min(value.flatten(1).shape) >= MUON_MAPS]
        rest = [value for value in decayed if all(value is not other for other in inner)]
        self.optimisers: list[torch.optim.Optimizer] = [
            torch.optim.AdamW(
                [{"params": rest, "weight_decay": recipe.weight_decay}, {"params": others, "weight_decay": 0.0}],
                lr=recipe.learning_rate,
            )
        ]
        if inner:
            self.optimisers.append(Muon(inner, lr=recipe.learning_rate, weight_decay=recipe.weight_decay))
        self.mean_weights = {name: value.detach().clone() for name, value in network.state_dict().items()}

    def rate(self, step: int) -> float:
        """The learning rate of a step."""
        if self.anneal is None:
            return learning_rate(self.recipe, step)
        begun, over = self.anneal
        return learning_rate(self.recipe, begun) * (1 - (step - begun) / over)

    def advance(self, model: nn.Module, scales: list[Scale], rank: int) -> Loss:
        recipe, seed = self.recipe, _seed(self.recipe.seed, self.step, rank)
        self.whole = False
        # What dropout and permutation draw depends on the step alone, so that a resumed run draws the same.
        torch.manual_seed(seed)
        autocast = torch.autocast(self.device.type, torch.bfloat16, enabled=self.precision == "bfloat16")
        self.network.eval()
        with autocast:
            batch = joined(scales, with_previous(self.network, self.network.inputs, scales))
        if self.network.kind == "patch":
            batch = patches_of(batch, self.network, recipe.patches, torch.Generator().manual_seed(seed))
        for optimiser in self.optimisers:
            for group in optimiser.param_groups:
                group["lr"] = self.rate(self.step)
            optimiser.zero_grad(set_to_none=True)
        model.train()
        with autocast:
            prediction = model(*(channels_last(values) for values in batch.inputs))
        loss = loss_of(prediction, batch.truth, batch.weights, recipe.error_weight, recipe.gradient_weight, batch.lit)
        loss.total.backward()
        gradients = nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        for what, value in (("loss", loss.total), ("gradients", gradients)):
            if not torch.isfinite(value):
                raise InputError(
                    f"{what} of step {self.step} not finite; begin anew with a lower learning rate, or with "
                    "--precision float32"
                )
        for optimiser in self.optimisers:
            optimiser.step()
        self.step += 1
        self._follow()
        self.whole = True
        return loss

    @torch.no_grad()
    def _follow(self) -> None:
        # Early weights are forgotten faster: a mean over 1000 steps says nothing after ten.
        decay = min(self.recipe.ema, (1 + self.step) / (10 + self.step))
        for name, value in self.network.state_dict().items():
            if value.dtype.is_floating_point:
                self.mean_weights[name].lerp_(value, 1 - decay)
            else:
                self.mean_weights[name].copy_(value)

    def mean(self) -> Network:
        """A network of its own with the running mean of the weights."""
        network = build_network(self.recipe.network, dict(self.recipe.options)).to(self.device)
        network.load_state_dict(self.mean_weights)
        return network.eval()

    def save(self, path: Path | None, rank: int) -> None:
        # After a step that failed the checkpoint before stands: half a step could not be gone on from.
        if path is not None and rank == 0 and self.whole:
            write_checkpoint(
                path,
                Checkpoint(
                    self.recipe,
                    self.step,
                    self.network.state_dict(),
                    self.mean_weights,
                    [optimiser.state_dict() for optimiser in self.optimisers],
                    self.seconds,
                    self.samples,
                    self.precision,
                    False,
                    self.continues,
                ),
            )

    def resume(self, path: Path) -> None:
        found = read_checkpoint(path)
        # The commands that its samples were made with change nothing in the training.
        if replace(found.recipe, samples=self.recipe.samples) != self.recipe:
            raise InputError(f"checkpoint {path} is of another recipe; resume with the one it began with")
        if found.samples != self.samples:  # as where more were made: what was learned holds, the order begins anew
            log.warning("checkpoint %s was trained on other samples before", path)
        if found.precision != self.precision:
            raise InputError(
                f"checkpoint {path} began with --precision {found.precision}, not {self.precision}; resume with that"
            )
        try:
            self.network.load_state_dict(found.weights)
            self.mean_weights = {name: value.to(self.device) for name, value in found.mean_weights.items()}
            for optimiser, state in zip(self.optimisers, found.optimisers, strict=True):
                optimiser.load_state_dict(state)
        except (RuntimeError, ValueError, KeyError) as error:
            reason = " ".join(str(error).split())[:200]
            raise InputError(f"checkpoint {path} does not fit the network: {reason}; resume from another") from None
        self.step, self.seconds, self.continues = found.step, found.seconds, found.continues

    def fine_tune(self, path: Path, photographer: Photographer) -> None:
        exported = read_exported(path)
        if exported.step >= self.recipe.steps:
            raise InputError(
                f"model {path} has had {exported.step} steps already, the recipe has {self.recipe.steps}; give it more"
            )
        self.network.eval()
        scales = photographer.batch(0, NORM_EXAMPLES)
        batch = joined(scales, with_previous(self.network, self.network.inputs, scales))
        if self.network.kind == "patch":
            batch = patches_of(batch, self.network, self.recipe.patches, torch.Generator().manual_seed(0))
        take_weights(self.network, exported, batch.inputs)
        self.mean_weights = {name: value.detach().clone() for name, value in self.network.state_dict().items()}
        self.step, self.continues = exported.step, exported.record


def _fingerprint(folders: list[Path], names: list[str]) -> str:
    """Of the samples' names, and of what each folder says they were drawn from."""
    digest = hashlib.sha256("\n".join(names).encode())
    for folder in folders:
        if (folder / JOB_FILE).is_file():
            digest.update((folder / JOB_FILE).read_bytes())
    return digest.hexdigest()[:16]


def _seed(*key: int) -> int:
    return int.from_bytes(hashlib.sha256(repr(key).encode()).digest()[:7], "big")


def channels_last(values: Tensor) -> Tensor:
    """The order in memory in which convolutions of few channels are quicker."""
    return values.contiguous(memory_format=torch.channels_last)


def _hardware(device: torch.device) -> str:
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    threads = torch.get_num_threads()
    instructions = torch.backends.cpu.get_cpu_capability()
    return f"{threads} CPU thread{'s' * (threads > 1)}, {platform.machine()} with {instructions}"


def _computed(precision: Precision, device: torch.device) -> str:
    if precision != "auto":
        return precision
    if device.type == "cuda":
        return "bfloat16" if torch.cuda.is_bf16_supported(including_emulation=False) else "float32"
    # Without its own instructions bfloat16 is slower than float32.
    quick = getattr(torch.cpu, "_is_avx512_bf16_supported", lambda: False)()
    return "bfloat16" if quick else "float32"


def _agreed(stop: bool, processes: int, device: torch.device) -> bool:
    """Whether the first of several processes stops: all do after the same step, or the others would wait for ever."""
    if processes == 1:
        return stop
    said = torch.tensor(float(stop), device=device)
    torch.distributed.broadcast(said, 0)
    return bool(said)


@contextmanager
def _processes() -> Iterator[tuple[int, int]]:
    """This process' number and how many there are, as torchrun tells."""
    environment: dict[str, Any] = dict(os.environ)
    processes = int(environment.get("WORLD_SIZE", "1"))
    if processes == 1:
        yield 0, 1
        return
    torch.distributed.init_process_group("nccl" if torch.cuda.is_available() else "gloo")
    try:
        yield int(environment["RANK"]), processes
    finally:
        torch.distributed.destroy_process_group()
