"""Table 1 of the MPS-Net paper: the effect of patch size and initial normals.

Ten networks are trained alike, one for each patch side (1 to 9) with and without initial normals, and measured on the
same patches of held-out samples.
"""

import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from mpsnet_core.io.files import ensure_folder, writable_path, write_json, write_transaction
from mpsnet_core.io.text_table import text_table
from mpsnet_core.learning.evaluation import Measured
from mpsnet_core.learning.evaluation.operations import EvaluatePatchSizes
from mpsnet_core.learning.evaluation.published import TABLE_1
from mpsnet_core.learning.evaluation.report import Curve, line_chart, open_report
from mpsnet_core.learning.training.loop import VALIDATION_SEED, TrainingPaths, train
from mpsnet_core.learning.training.packed import PackedSamples
from mpsnet_core.learning.training.photo_simulation import PhotoSimulator, views_of
from mpsnet_core.learning.training.recipe import TrainingConfig, capture_model, read_recipe
from mpsnet_core.learning.training.validation import Metrics, validate
from mpsnet_core.progress import Progress, part, silent

SIDES = (1, 3, 5, 7, 9)
INPUTS = {"image": False, "image and initial normals": True}


@dataclass(frozen=True)
class PatchRow:
    """One network, as ``--json`` writes it: its error, and how it was trained and measured."""

    input: str
    """What the network sees of each pixel."""
    patch: int
    """Side of its patches in pixels."""
    mae_deg: float
    """Mean angular error in degrees."""
    highest_deg: float
    """Largest angular error in degrees."""
    minutes: float
    """Training time in minutes."""
    width: float
    """The network's width."""
    steps: int
    """Number of training steps."""
    patches: int
    """Number of held-out patches that it was measured on."""


def patch_size_recipe(side: int, normals: bool, width: float, steps: int) -> TrainingConfig:
    """Training of one of the ten networks, which differ in side and normals only. Photographs are like the paper's, but
    the optimiser is Muon: with AdamW these short trainings end at about the same error for all sides."""
    warm_up = min(100, math.ceil(steps / 10))
    return replace(
        read_recipe("mpsnet"),
        name=f"patch-{side}{'-normals' if normals else ''}",
        title=f"MPS-Net, patches of {side} x {side}",
        options={"width": width, "patch": side, "normals": normals},
        steps=steps,
        warm_up=warm_up,
        decay=steps - warm_up,
        ema=0.99,
    )


# Folder of the packed samples within that of the runs.
PACKED = "packed"


def evaluate_patch_sizes(options: EvaluatePatchSizes, progress: Progress = silent) -> Measured:
    """Train and measure the ten networks.

    The number of patches to measure on is rounded up to the same number per held-out sample.

    Raises InputError if samples, validation or runs are unusable, and Cancelled if `progress` does.
    """
    if options.json:
        writable_path(options.json)
    runs = ensure_folder(options.runs, "runs")
    samples, width, steps = list(map(Path, options.samples)), options.width, options.steps
    held_out = PackedSamples(options.validation, cache=runs / PACKED)  # fail before hours of training
    a_picture = math.ceil(options.patches / len(held_out))
    rows = []
    variants = [(name, normals, side) for name, normals in INPUTS.items() for side in SIDES]
    with open_report(options.output) if options.output else nullcontext() as page:
        for number, (name, normals, side) in enumerate(variants):
            recipe = patch_size_recipe(side, normals, width, steps)
            share = part(progress, number / len(variants), (number + 1) / len(variants))
            found, seconds = _validated(recipe, samples, held_out, runs, a_picture, share)
            errors = round(found.mae_deg, 4), round(found.highest_deg, 2)
            patches_measured = a_picture * len(held_out)
            rows.append(PatchRow(name, side, *errors, round(seconds / 60, 1), width, steps, patches_measured))
        published = [
            {"input": name, "patch": side, "mae_deg": error, "source": "Table 1"}
            for name, errors in TABLE_1.items()
            for side, error in errors.items()
        ]
        table = _table(rows)
        measured = Measured(rows=[asdict(row) for row in rows], published=published, text=table)
        with write_transaction():
            if options.json:
                write_json(options.json, measured.metrics())
            if page:
                page.write("Patch sizes", table, [], [_chart(rows)])
    return measured


def _validated(
    recipe: TrainingConfig, samples: list[Path], held_out: PackedSamples, runs: Path, a_picture: int, progress: Progress
) -> tuple[Metrics, float]:
    """Train one network, or resume its training, and measure it. Also returns the training time in seconds."""
    checkpoint = runs / f"{recipe.name}.checkpoint"
    progress(0.0, recipe.title)
    paths = TrainingPaths(checkpoint, checkpoint if checkpoint.exists() else None, cache=runs / PACKED)
    trained = train(recipe, samples, [], paths=paths, progress=progress)
    model, views = capture_model(recipe.capture), views_of(trained.network, recipe.augment)
    simulator = PhotoSimulator(held_out, model, seed=VALIDATION_SEED, window=0, shuffled=False, **views)
    return validate(trained.network, simulator, a_picture), trained.seconds


def _chart(rows: Sequence[PatchRow]) -> str:
    curves = [
        Curve(f"{source}{name}", list(errors), list(errors.values()))
        for source, errors_of in (("", _by_input(rows)), ("paper: ", TABLE_1))
        for name, errors in errors_of.items()
    ]
    return line_chart("Patch sizes", curves, "side of a patch", "mean error in degrees")


def _by_input(rows: Sequence[PatchRow], largest: bool = False) -> dict[str, dict[int, float]]:
    return {
        name: {row.patch: row.highest_deg if largest else row.mae_deg for row in rows if row.input == name}
        for name in INPUTS
    }


def _table(rows: Sequence[PatchRow]) -> str:
    measures = {"mean": _by_input(rows), "largest": _by_input(rows, largest=True), "paper: mean": TABLE_1}
    lines = [
        [name, measure, *(f"{errors[name][side]:.2f}" for side in SIDES)]
        for name in INPUTS
        for measure, errors in measures.items()
    ]
    title = f"angular error in degrees over {rows[0].patches} patches, by the side of a patch\n"
    return title + text_table(["input", "", *map(str, SIDES)], lines, 2)
