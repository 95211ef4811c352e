"""How the command line takes its arguments."""

import argparse
from typing import TYPE_CHECKING, Any, Literal, NoReturn

from mpsnet_core.defaults import MARGIN, TEXTURE_SIZE
from mpsnet_core.errors import InputError

if TYPE_CHECKING:
    from mpsnet_core.bake.settings import Baking
    from mpsnet_core.capture.correction import Correction
    from mpsnet_core.estimate import Estimator


class Help(argparse.ArgumentDefaultsHelpFormatter):
    """Says an option's default, where it has one that says something."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        silent_default = action.default in (None, argparse.SUPPRESS, False, "")
        return action.help if silent_default else super()._get_help_string(action)


class Parser(argparse.ArgumentParser):
    """Bad arguments are bad input: one sentence instead of argparse's usage text."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}; see {self.prog} --help")

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        # argparse before Python 3.13 loses the value of --open=-- and then stumbles over it.
        if action.option_strings and arg_strings == ["--"]:
            raise argparse.ArgumentError(action, "expected a value, not --")
        return super()._get_values(action, arg_strings)


# What `add_subparsers` gives: the place where verbs are added.
Verbs = argparse._SubParsersAction


def add_texture(parser: argparse.ArgumentParser) -> None:
    """What texture is baked: its size, space, convention, samples, padding and bits; the rest by
    :func:`textures.settle`."""
    parser.add_argument("--size", type=int, default=TEXTURE_SIZE, help="side of the texture in texels")
    parser.add_argument("--space", default="tangent", help="tangent (MikkTSpace) or object")
    parser.add_argument("--convention", help="of the texture: opengl (green up; unless given) or directx")
    parser.add_argument(
        "--samples", type=int, default=1, metavar="N", help="1, 2 or 4: N x N points a texel, against jagged edges"
    )
    parser.add_argument(
        "--padding", default="nearest", help="beyond the UV islands: nearest, push-pull (fills the texture) or none"
    )
    parser.add_argument(
        "--margin",
        type=int,
        help=f"texels that the islands' borders are grown by, with nearest; {MARGIN} unless given",
    )
    parser.add_argument(
        "--bits",
        type=int,
        help="bits a channel: 8 or 16 (PNG, TIFF), 16 or 32 (EXR); 16 for PNG and TIFF, 32 for EXR unless given",
    )


def parse_baking(options: argparse.Namespace, feather: float) -> "Baking":
    """How options of :func:`add_texture`, and --strength, ask for textures to be baked.

    Raises InputError where one is out of range, or a margin is given that the padding does not use.
    """
    from mpsnet_core.bake.settings import Baking

    if options.margin is not None and options.padding in ("push-pull", "none"):
        raise InputError(f"--margin goes with --padding nearest, not with {options.padding}; leave it out")
    return Baking(
        size=options.size,
        space=options.space,
        margin=MARGIN if options.margin is None else options.margin,
        padding=options.padding,
        samples=options.samples,
        feather=feather,
        strength=options.strength,
    )


def add_meshes(parser: argparse.ArgumentParser) -> None:
    """The meshes that are baked onto, a list of one or more."""
    parser.add_argument(
        "--mesh",
        required=True,
        action="append",
        help="mesh with UVs: .obj, .ply, .glb, or the add-on's .npz; may be repeated: the meshes hide one another",
    )


def add_level(parser: argparse.ArgumentParser, default: str | None) -> None:
    """The option --level, read by :func:`level_scale`."""
    parser.add_argument(
        "--level",
        default=default,
        metavar="on|off|SCALE",
        help="take from the mesh what is larger than SCALE (a share of its size; on: 0.03), and detail from the photos"
        + ("" if default else " (off unless given; on with --onto)"),
    )


def level_scale(text: str) -> float:
    """The levelling's scale that --level means, 0 for none. Raises InputError where it means none of them."""
    from mpsnet_core.bake.low_frequency_correction import LEVEL_SCALE, MAX_SCALE, MIN_SCALE

    if text in ("on", "off"):
        return LEVEL_SCALE if text == "on" else 0.0
    try:
        scale = float(text)
    except ValueError:
        scale = 0.0
    if not MIN_SCALE <= scale <= MAX_SCALE:
        raise InputError(f"--level {text} is not known; give on, off, or a scale from {MIN_SCALE:g} to {MAX_SCALE:g}")
    return scale


def add_reading(parser: argparse.ArgumentParser) -> None:
    """How a photo is read: its encoding and layer, dark frame and flat field."""
    parser.add_argument("--encoding", default="auto", help="auto, linear or srgb: how the photo's values are meant")
    parser.add_argument("--layer", help="layer of a multi-layer EXR")
    parser.add_argument(
        "--dark", help="photo(s) with the three lights off, to take off: a file, or a folder or pattern to average"
    )
    parser.add_argument(
        "--flat",
        help="photo(s) of an even white card in the object's place, to divide by: as --dark; not with near lights",
    )
    parser.add_argument(
        "--flat-smooth", type=int, default=0, metavar="PIXELS", help="leave out the card's grain, finer than so many"
    )


def add_network(parser: argparse.ArgumentParser, model: str = "multiscale") -> None:
    """Which model estimates the normals, and how networks run. model: what is said to be taken unless told."""
    parser.add_argument("--model", help=f"a name of `mpsnet models` or an .onnx file; {model} unless given")
    parser.add_argument(
        "--provider", default="cpu", choices=("cpu", "cuda", "directml", "coreml"), help="what runs networks"
    )
    parser.add_argument("--threads", type=int, default=0, help="CPU threads for networks, 0 for all")
    parser.add_argument("--tile", type=int, help="tile side in pixels for networks (default: 448)")


def parse_estimator(
    options: argparse.Namespace, model: str | None = None, passes: Literal[1, 3] | None = None
) -> "Estimator":
    """The estimator that options of :func:`add_network` ask for.

    model: where they name none; the default model. passes: as :class:`mpsnet_core.estimate.Estimator` takes them.
    """
    from mpsnet_core.estimate import Estimator
    from mpsnet_core.estimate.registry import DEFAULT_MODEL, DEFAULT_TILE

    return Estimator(
        options.model or model or DEFAULT_MODEL,
        passes=passes,
        provider=options.provider,
        threads=options.threads,
        tile=DEFAULT_TILE if options.tile is None else options.tile,
    )


def parse_correction(options: argparse.Namespace) -> "Correction | None":
    """Dark frame and flat field as :func:`add_reading` takes them, None where neither is given.

    Raises InputError as `read_correction` does, and where the flat field to smooth is lacking.
    """
    from mpsnet_core.capture.correction import read_correction

    if options.flat_smooth and options.flat is None:
        raise InputError("--flat-smooth smooths the flat field; give --flat, or leave it out")
    if options.dark is None and options.flat is None:
        return None
    return read_correction(
        options.dark, options.flat, encoding=options.encoding, layer=options.layer, smooth=options.flat_smooth
    )
