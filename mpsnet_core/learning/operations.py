"""The operation train: from samples to a network.

It is not in :mod:`mpsnet_core.learning.training`, which cannot be imported without PyTorch (extra ``train``).
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from mpsnet_core.errors import FileError
from mpsnet_core.estimate.registry import registered_models
from mpsnet_core.operation import Operation, Result, option, optional, output_option
from mpsnet_core.progress import Progress, silent

if TYPE_CHECKING:
    from mpsnet_core.learning.training.loop import TrainingPaths


_OF_TRAINING = ("precision", "stop_after", "anneal", "minutes")


@dataclass(frozen=True)
class NetworkTrained(Result):
    """The result of a training run."""

    step: int
    """Number of steps done."""
    model: str | None = None
    """The network's file, if the training is complete."""
    checkpoint: str | None = None
    """The file to resume from, if the training is not complete."""
    mae_deg: float | None = None
    """Mean angular error in degrees on held-out samples, if there are any."""


@dataclass(frozen=True)
class Train(Operation):
    """Train a network on samples and export it to ONNX."""

    command: ClassVar[str] = "train"

    recipe: str = option(help="recipe: a name, such as multiscale or multiscale-fine-tune, or your own .toml file")
    samples: tuple[str, ...] = option(metavar="DIR", help="folder of samples to train on")
    validation: tuple[str, ...] = option(
        default=(), metavar="DIR", help="folder of held-out samples, to measure the network on at the end"
    )
    checkpoint: str | None = output_option(
        "checkpoint to write during training, for --resume", unset="beside the output"
    )
    resume: str | None = optional(
        "checkpoint to resume from, or network to train further: a name or .onnx file", metavar="FILE"
    )
    cache: str | None = output_option(
        "folder for the samples in a form that reads fast, which other runs may share and which you may delete",
        metavar="DIR",
        unset="beside the output: NAME.packed",
        path="folder",
    )
    skip_damaged: bool = option(default=False, help="leave damaged samples out, and name them")
    logs: str | None = output_option("folder of logs for TensorBoard", metavar="DIR")
    stop_after: int = option(
        default=0,
        low=0,
        metavar="STEPS",
        help="stop after this many steps, including those before --resume, and leave a checkpoint; 0: at the "
        "recipe's end",
    )
    minutes: float = option(
        default=0.0,
        low=0,
        high=1e6,
        help="stop after this many minutes, and leave a checkpoint; 0: at the recipe's end",
    )
    anneal: int = option(
        default=0,
        low=0,
        metavar="STEPS",
        help="finish the training that --resume names: lower its learning rate to zero over this many steps; the "
        "checkpoint is kept",
    )
    threads: int = option(default=0, low=0, high=1024, help="CPU threads, 0 for all cores")
    precision: Literal["auto", "float32", "bfloat16"] = option(
        default="auto",
        choices={"auto": "bfloat16 where the CPU or GPU supports it", "float32": "", "bfloat16": ""},
        help="number format that the layers compute in",
    )
    output: str = option(metavar="MODEL", help="the .onnx file", provenance="none")

    def run(self, progress: Progress = silent) -> NetworkTrained:
        """Train to the recipe's end and write the network, or stop earlier and leave a checkpoint."""
        from mpsnet_core.learning.training.export import export_onnx
        from mpsnet_core.learning.training.loop import train
        from mpsnet_core.learning.training.recipe import read_recipe

        output = _model_path(self.output)
        paths = self._paths(output)
        with _threads(self.threads):
            samples, validation = ([*map(Path, folders)] for folders in (self.samples, self.validation))
            options: dict[str, Any] = {name: getattr(self, name) for name in _OF_TRAINING}
            trained = train(read_recipe(self.recipe), samples, validation, paths=paths, **options, progress=progress)
        step, steps = trained.step, trained.recipe.steps
        if step < steps and not self.anneal:
            text = f"stopped after {step} of {steps} steps; go on with --resume {paths.checkpoint}"
            text += ", and finish it with --anneal STEPS"
            return NetworkTrained(step, checkpoint=str(paths.checkpoint), text=text)
        export_onnx(trained, output)
        metrics = "" if trained.metrics is None else f": {trained.metrics} on held-out samples"
        mae_deg = None if trained.metrics is None else round(trained.metrics.mae_deg, 4)
        return NetworkTrained(step, model=str(output), mae_deg=mae_deg, text=f"wrote {output}{metrics}")

    def _paths(self, output: Path) -> "TrainingPaths":
        from mpsnet_core.io.files import check_no_overwrite, creatable_folder, writable_path
        from mpsnet_core.learning.training.loop import TrainingPaths

        checkpoint = Path(self.checkpoint) if self.checkpoint else output.with_suffix(".checkpoint")
        paths = TrainingPaths(
            checkpoint=writable_path(checkpoint),
            resume=_resumed(self.resume) if self.resume else None,
            logs=creatable_folder(self.logs, "logs") if self.logs else None,
            cache=creatable_folder(self.cache or output.with_suffix(".packed"), "packed samples"),
            overwrite=self.overwrite,
            skip_damaged=self.skip_damaged,
        )
        check_no_overwrite([checkpoint, *([paths.resume] if paths.resume else [])], [output])
        return paths


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Set PyTorch's number of threads within the block; 0 leaves it as it is."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(count or before)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _resumed(name: str) -> Path:
    """A shipped network's file by its name, or the path as it is."""
    shipped = {entry.name: entry.file for entry in registered_models()}
    return shipped.get(name) or Path(name)


def _model_path(path: str) -> Path:
    """The path as a file that can be written. Raises InputError if it cannot."""
    from mpsnet_core.io.files import writable_path

    output = writable_path(path)
    if output.suffix.lower() != ".onnx":
        raise FileError(f"cannot write {output}: models are written as .onnx; change the suffix")
    return output
