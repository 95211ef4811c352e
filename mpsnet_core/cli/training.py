"""Verbs train and quantize: from samples to a model, and to its int8 twin. They need PyTorch (extra ``train``)."""

import argparse
import logging
from pathlib import Path
from typing import Any

from mpsnet_core.cli.arguments import Help, Verbs
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.errors import InputError, check_choice
from mpsnet_core.estimate.registry import find_network, registered_models
from mpsnet_core.io.files import makeable_folder, writable_path
from mpsnet_core.io.frames import check_apart

log = logging.getLogger(__name__)


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    parser = verbs.add_parser(
        "train", parents=[common], formatter_class=Help, help="train a network on samples and export it to ONNX"
    )
    parser.add_argument(
        "--recipe",
        required=True,
        help="a network's name, mpsnet-published, or a .toml file of your own",
    )
    parser.add_argument("--samples", action="append", required=True, metavar="DIR", help="to train on; may be repeated")
    parser.add_argument(
        "--validation", action="append", default=[], metavar="DIR", help="held-out samples; may be repeated"
    )
    parser.add_argument("--checkpoint", metavar="FILE", help="written on the way (default: beside the output)")
    parser.add_argument("--resume", metavar="FILE", help="a checkpoint to go on from, or a network to train further")
    parser.add_argument("--logs", metavar="DIR", help="for TensorBoard")
    parser.add_argument("--stop-after", type=int, default=0, metavar="STEPS", help="to go on later; 0: at the end")
    parser.add_argument("--minutes", type=float, default=0.0, help="to go on later, by the clock; 0: at the end")
    parser.add_argument(
        "--anneal",
        type=int,
        default=0,
        metavar="STEPS",
        help="from the checkpoint to resume, which stays: lower the learning rate to nothing over so many steps",
    )
    add_removed_options(parser)
    parser.add_argument("--threads", type=int, default=0, help="of the processor, 0 for all cores")
    parser.add_argument("--precision", default="auto", help="auto, float32 or bfloat16")
    parser.add_argument("-o", "--output", required=True, metavar="MODEL", help="the .onnx file")
    parser.set_defaults(verb=_train)

    parser = verbs.add_parser(
        "quantize", parents=[common], formatter_class=Help, help="make a model's int8 twin: smaller and quicker"
    )
    parser.add_argument("model", metavar="MODEL", help="a shipped model's name, or an .onnx file of ours")
    parser.add_argument(
        "--samples", action="append", required=True, metavar="DIR", help="to calibrate on; may be repeated"
    )
    parser.add_argument("--count", type=int, default=64, help="photographs of the samples")
    parser.add_argument("-o", "--output", required=True, metavar="MODEL", help="the .onnx file")
    parser.set_defaults(verb=_quantize)


def _train(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.learning.training.export import export_onnx
    from mpsnet_core.learning.training.loop import PRECISIONS, Places, train
    from mpsnet_core.learning.training.recipe import read_recipe

    output = _model_path(options.output)
    check_choice("precision", options.precision, PRECISIONS)
    note_removed_options(options)
    for name in ("threads", "stop_after", "anneal"):
        if getattr(options, name) < 0:
            raise InputError(f"--{name.replace('_', '-')} cannot be {getattr(options, name)}; choose 0 or more")
    if not 0 <= options.minutes < 1e6:
        raise InputError(f"--minutes cannot be {options.minutes:g}; choose a number from 0 to a million")
    if options.threads:
        import torch

        torch.set_num_threads(options.threads)
    checkpoint = Path(options.checkpoint) if options.checkpoint else output.with_suffix(".checkpoint")
    places = Places(
        checkpoint=writable_path(checkpoint),
        resume=_resumed(options.resume) if options.resume else None,
        logs=makeable_folder(options.logs, "logs") if options.logs else None,
    )
    check_apart([checkpoint, *([places.resume] if places.resume else [])], [output])
    trained = train(
        read_recipe(options.recipe),
        [Path(folder) for folder in options.samples],
        [Path(folder) for folder in options.validation],
        places=places,
        precision=options.precision,
        stop_after=options.stop_after,
        anneal=options.anneal,
        minutes=options.minutes,
        progress=reporter.progress,
    )
    if trained.rank:  # of several processes one writes
        return {"step": trained.step}
    if trained.step < trained.recipe.steps and not options.anneal:
        text = f"stopped after {trained.step} of {trained.recipe.steps} steps; go on with --resume {places.checkpoint}"
        return {"checkpoint": str(places.checkpoint), "step": trained.step, "text": text}
    export_onnx(trained, output)
    figures = "" if trained.figures is None else f": {trained.figures} on held-out samples"
    return {
        "model": str(output),
        "step": trained.step,
        "mae_deg": trained.figures and round(trained.figures.mae_deg, 4),
        "text": f"wrote {output}{figures}",
    }


def add_removed_options(parser: argparse.ArgumentParser) -> None:
    """What scripts may still give: options of the processes that made examples."""
    parser.add_argument("--workers", help=argparse.SUPPRESS)
    parser.add_argument("--keep", action="store_true", help=argparse.SUPPRESS)


def note_removed_options(options: argparse.Namespace) -> None:
    """Tell who gives them that they do nothing any more."""
    if options.workers is not None or options.keep:
        log.info("--workers and --keep do nothing any more: examples are made where the network learns")


def _quantize(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.learning.training.quantize import quantise

    output = _model_path(options.output)
    model = find_network(options.model).path
    check_apart([model], [output])
    twin = quantise(
        model,
        [Path(folder) for folder in options.samples],
        output,
        count=options.count,
        progress=reporter.progress,
    )
    return {
        "model": str(output),
        "mae_deg": round(twin.mae_deg, 4),
        "mae_deg_of_model": round(twin.model_mae_deg, 4),
        "text": f"wrote {output}: {twin.mae_deg:.2f}° on the samples, the model itself {twin.model_mae_deg:.2f}°",
    }


def _resumed(name: str) -> Path:
    """A shipped network's file by its name, or the path as it is."""
    shipped = {entry.name: entry.file for entry in registered_models()}
    return shipped.get(name) or Path(name)


def _model_path(path: str) -> Path:
    """Where a model can be written; InputError where not."""
    output = writable_path(path)
    if output.suffix.lower() != ".onnx":
        raise InputError(f"cannot write {output}: models are written as .onnx; change the suffix")
    return output
