"""Options of the verbs that bake: presets, and detail on top of what the object has."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from mpsnet_core.errors import InputError
from mpsnet_core.files import made_folder

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def add_preset(parser: argparse.ArgumentParser) -> None:
    """The option --preset, settled by :func:`settle`."""
    parser.add_argument(
        "--preset",
        metavar="NAME",
        help="blender, unreal, unity, godot or gltf: convention, bits, file format and, in a folder, the file's name; "
        "options that are given as well win",
    )


def add_detail(parser: argparse.ArgumentParser) -> None:
    """What is made of the photos' detail: its strength, and a normal map that it goes on top of."""
    parser.add_argument(
        "--strength", type=float, default=1.0, help="of what the photos add to the mesh's own normals: 0 to 2"
    )
    parser.add_argument(
        "--onto", metavar="MAP", help="the object's present normal map (tangent space, same UVs), to add detail to"
    )
    parser.add_argument("--onto-convention", default="opengl", help="of the present map: opengl (green up) or directx")


def settle(options: argparse.Namespace, *, sequence: bool = False) -> None:
    """Fill in what was not given: from the preset where there is one. An output folder becomes the preset's file in it.

    sequence: the output is a folder of frames, which have names of their own.

    Raises InputError where the preset is not known, does not fit the output's ending, or the detail cannot be had.
    """
    from mpsnet_core.normals import check_convention
    from mpsnet_core.surface.bake import check_strength
    from mpsnet_core.surface.onto import check_onto
    from mpsnet_core.surface.presets import preset_named, preset_output

    check_strength(options.strength)
    check_convention(options.onto_convention)
    if options.onto:
        check_onto(options.space)
    if options.level is None:
        # What is large in the present map is in the photo as well, and shall not be added to it.
        options.level = "on" if options.onto else "off"
    ending = getattr(options, "format", None)
    if options.preset:
        preset = preset_named(options.preset)
        if options.convention is None:
            options.convention = preset.convention
        if not sequence:
            suffix = f".{ending.lstrip('.')}" if ending else None
            target = preset_output(preset, options.output, Path(options.mesh[0]).stem, suffix)
            if options.output.endswith(("/", "\\")):
                made_folder(target.parent, "texture")
            options.output = str(target)
        ending = ending or preset.suffix
        # Bits go with the preset's own format.
        if options.bits is None and f".{ending.lstrip('.')}" == preset.suffix:
            options.bits = preset.bits
    if options.convention is None:
        options.convention = "opengl"
    if "format" in options:
        options.format = ending or "png"


def asked_present_map(options: argparse.Namespace, file: Path | None) -> "NDArray[np.float32] | None":
    """The normal map of --onto, None where there is none. Raises InputError where it cannot be read."""
    from mpsnet_core.surface.onto import read_present_map

    if file is None:
        return None
    try:
        return read_present_map(file, convention=options.onto_convention)
    except InputError as error:
        raise InputError(f"--onto: {error}") from None
