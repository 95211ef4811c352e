"""The verb evaluate: how good the models are."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mpsnet_core.cli.arguments import Help, Verbs
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.cli.training import add_removed_options, note_removed_options
from mpsnet_core.errors import InputError


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    parser = verbs.add_parser("evaluate", help="measure models against known normals")
    tests = parser.add_subparsers(metavar="TEST", required=True)
    told = _common_options(common)
    _add_diligent(_test(tests, told, "diligent", _diligent, "the DiLiGenT photographs, multiplexed"))
    _add_materials(_test(tests, told, "materials", _materials, "one blob under each measured material"))
    _add_rendered(_test(tests, told, "rendered", _rendered, "meshes from files, of one and of several materials"))
    _add_statues(_test(tests, told, "statues", _statues, "matt grey meshes with cast shadows; fine relief kept"))
    _add_synthetic(_test(tests, told, "colour", _colour, "one blob in many colours: their edges, their influence"))
    _add_samples(_test(tests, told, "samples", _samples, "held-out samples, photographed (needs PyTorch)"))
    sizes = tests.add_parser(
        "patch-sizes", parents=[common], formatter_class=Help, help="train MPS-Net with patches of five sizes (table 1)"
    )
    _add_patch_sizes(sizes)


def _common_options(common: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """Options of every test: which models, and where the answer goes."""
    told = argparse.ArgumentParser(add_help=False, parents=[common])
    told.add_argument(
        "--model",
        action="append",
        metavar="MODEL",
        help="name, file, or all; repeatable; the default model unless given",
    )
    told.add_argument("--json", metavar="FILE", help="write the rows as JSON")
    told.add_argument("-o", "--output", metavar="REPORT", help="write an HTML report with pictures")
    return told


def _test(
    tests: Verbs, told: argparse.ArgumentParser, name: str, make: Callable[[argparse.Namespace], Any], words: str
) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = tests.add_parser(name, parents=[told], formatter_class=Help, help=words)
    parser.set_defaults(verb=_evaluate, make=make)
    return parser


def _evaluate(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.estimate.registry import DEFAULT_MODEL
    from mpsnet_core.io.files import writable_path
    from mpsnet_core.io.html_page import page_path
    from mpsnet_core.learning.evaluation.evaluation import evaluate

    # Asked first, as a test's data may take a while to look through.
    if options.json:
        writable_path(options.json)
    if options.output:
        page_path(options.output)
    return evaluate(
        options.make(options),
        options.model or [DEFAULT_MODEL],
        json=options.json,
        report=options.output,
        progress=reporter.progress,
    )


def _add_protocol(parser: argparse.ArgumentParser, unless: str) -> None:
    parser.add_argument(
        "--protocol",
        action="append",
        help=f"how a channel weighs colours: separated, published or white; repeatable; {unless} unless given",
    )


def _add_magnify(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--magnify",
        action="append",
        type=int,
        metavar="N",
        help="magnify the photographs N times before the estimate; repeatable; 1 unless given",
    )


def _add_synthetic(parser: argparse.ArgumentParser) -> None:
    _add_protocol(parser, "published")
    parser.add_argument("--size", type=int, default=256, help="side of a picture in pixels")


# --- the tests --------------------------------------------------------------------------------------------------------


def _add_diligent(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", help="DiLiGenT's pmsData folder; objects that are absent are named and skipped")
    parser.add_argument("--object", action="append", metavar="NAME", help="repeatable; all ten unless given")
    parser.add_argument("--lights", action="append", metavar="A,B,C", help="lights giving R, G, B; repeatable")
    _add_protocol(parser, "all three")
    _add_magnify(parser)


def _diligent(options: argparse.Namespace) -> Any:
    from mpsnet_core.learning.evaluation.diligent import OBJECTS, PROTOCOLS, Diligent
    from mpsnet_core.learning.evaluation.published import PUBLISHED_LIGHTS

    return Diligent(
        options.folder,
        objects=options.object or OBJECTS,
        lights=[_triple(text) for text in options.lights] if options.lights else PUBLISHED_LIGHTS,
        protocols=options.protocol or tuple(PROTOCOLS),
        magnify=options.magnify or (1,),
    )


def _triple(text: str) -> tuple[int, int, int]:
    try:
        first, second, third = (int(number) for number in text.split(","))
    except ValueError:
        raise InputError(f"--lights {text} is not three numbers; write them like 48,1,96") from None
    return first, second, third


def _add_materials(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--merl", required=True, metavar="PATH", help="a folder of MERL .binary files, or .npz of fits")
    _add_synthetic(parser)


def _materials(options: argparse.Namespace) -> Any:
    from mpsnet_core.learning.evaluation.materials import Materials

    return Materials(options.merl, **_synthetic(options))


def _add_rendered(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("mesh", nargs="+", help="mesh files, or folders of them")
    parser.add_argument("--merl", default="", metavar="PATH", help="measured materials in place of principled ones")
    parser.add_argument("--views", type=int, default=2, help="of each mesh, from all around")
    _add_synthetic(parser)


def _rendered(options: argparse.Namespace) -> Any:
    from mpsnet_core.learning.evaluation.rendered import Rendered

    return Rendered(options.mesh, merl=options.merl, views=options.views, **_synthetic(options))


def _add_statues(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("mesh", nargs="+", help="mesh files, or folders of them")
    parser.add_argument("--views", type=int, default=2, help="of each mesh, from all around")
    parser.add_argument("--slant", type=float, default=30.0, metavar="DEGREES", help="of the three lights")
    parser.add_argument(
        "--tilt",
        action="append",
        type=float,
        metavar="DEGREES",
        help="of the first light, the others 120° apart; repeatable; 90, 107 and 131 unless given",
    )
    parser.add_argument("--bounces", type=int, default=0, help="of light between surfaces: 0 to 3")
    parser.add_argument("--size", type=int, default=640, help="side of a picture in pixels")
    _add_magnify(parser)


def _statues(options: argparse.Namespace) -> Any:
    from mpsnet_core.learning.evaluation.statues import TILTS, Statues

    return Statues(
        options.mesh,
        views=options.views,
        slant=options.slant,
        tilts=options.tilt or TILTS,
        bounces=options.bounces,
        magnify=options.magnify or (1,),
        size=options.size,
    )


def _colour(options: argparse.Namespace) -> Any:
    from mpsnet_core.learning.evaluation.colour import ColourChanges

    return ColourChanges(**_synthetic(options))


def _synthetic(options: argparse.Namespace) -> dict[str, Any]:
    return {"protocols": options.protocol or ("published",), "size": options.size}


def _add_samples(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", nargs="+", help="folders of samples that training does not see")
    parser.add_argument("--count", type=int, default=0, help="how many, evenly spread; 0 for all")
    parser.add_argument("--white", action="store_true", help="measure each once more with a white photo beside it")
    _add_magnify(parser)


def _samples(options: argparse.Namespace) -> Any:
    from mpsnet_core.learning.evaluation.samples import Samples

    return Samples(options.folder, count=options.count, magnify=options.magnify or (1,), white=options.white)


# --- patch sizes: the only test that trains ---------------------------------------------------------------------------


def _add_patch_sizes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--samples", action="append", required=True, metavar="DIR", help="to train on; repeatable")
    parser.add_argument("--validation", action="append", required=True, metavar="DIR", help="held out; repeatable")
    parser.add_argument(
        "--runs", required=True, metavar="DIR", help="for checkpoints; a cancelled run goes on from them"
    )
    parser.add_argument("--width", type=float, default=0.125, help="factor of the published numbers of maps")
    parser.add_argument("--steps", type=int, default=600, help="of each of the ten trainings, of 500 patches")
    parser.add_argument("--patches", type=int, default=500_000, help="to measure on")
    add_removed_options(parser)
    parser.add_argument("--json", metavar="FILE", help="write the rows as JSON")
    parser.add_argument("-o", "--output", metavar="REPORT", help="write an HTML report with a chart")
    parser.set_defaults(verb=_evaluate_patch_sizes)


def _evaluate_patch_sizes(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.learning.evaluation.patch_sizes import evaluate_patch_sizes

    note_removed_options(options)
    return evaluate_patch_sizes(
        [Path(folder) for folder in options.samples],
        [Path(folder) for folder in options.validation],
        options.runs,
        width=options.width,
        steps=options.steps,
        patches=options.patches,
        json=options.json,
        report=options.output,
        progress=reporter.progress,
    )
