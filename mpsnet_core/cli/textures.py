"""Options of the verbs that bake: presets, and detail on top of what the object has."""

import argparse
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mpsnet_core.errors import InputError
from mpsnet_core.io.files import ensure_folder

if TYPE_CHECKING:
    from mpsnet_core.bake.base_detail_removal import BaseMap


log = logging.getLogger(__name__)


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
        "--onto",
        metavar="MAP",
        help="the object's present normal map (tangent space, same UVs), to add detail to; with <UDIM>, <MATERIAL> or "
        "<OBJECT> in its name as in the output's, or a .json file that lists several",
    )
    parser.add_argument("--onto-convention", default="opengl", help="of the present map: opengl (green up) or directx")
    parser.add_argument(
        "--onto-shown",
        default="auto",
        metavar="auto|yes|no",
        help="whether the photos show the present map's relief as well, which is then not added again",
    )


def settle(options: argparse.Namespace, *, sequence: bool = False) -> None:
    """Fill in what was not given: from the preset where there is one. An output folder becomes the preset's file in it.

    sequence: the output is a folder of frames, which have names of their own.

    Raises InputError where the preset is not known, what is asked for does not fit the output's ending, the detail
    cannot be had, or a folder is given for what several meshes share, which no preset has a name for.
    """
    from mpsnet_core.bake.base_detail_removal import check_shown
    from mpsnet_core.bake.detail_blending import check_blending
    from mpsnet_core.bake.presets import preset_named, preset_output
    from mpsnet_core.scene.normal_map import check_convention

    check_convention(options.onto_convention)
    check_shown(options.onto_shown)
    if options.onto:
        check_blending(options.space)
    elif options.onto_convention != "opengl" or options.onto_shown != "auto":
        raise InputError("--onto-convention and --onto-shown tell of the map of --onto; give it, or leave them out")
    if options.level is None:
        # What is large in the present map is in the photo as well, and shall not be added to it.
        options.level = "on" if options.onto else "off"
    ending = (getattr(options, "format", None) or "").lstrip(".").lower()
    if options.preset:
        preset = preset_named(options.preset)
        if options.convention is None:
            options.convention = preset.convention
        if not sequence:
            if len(options.mesh) > 1 and (Path(options.output).is_dir() or options.output.endswith(("/", "\\"))):
                raise InputError(
                    f"a preset names a texture after its mesh, and {len(options.mesh)} share this one; give its file "
                    f"with --output, as {options.output.rstrip('/')}/{preset.stem('name')}{preset.suffix}"
                )
            suffix = f".{ending}" if ending else None
            target = preset_output(preset, options.output, Path(options.mesh[0]).stem, suffix)
            if options.output.endswith(("/", "\\")):
                ensure_folder(target.parent, "texture")
            options.output = str(target)
        ending = ending or preset.suffix.lstrip(".")
        # Bits go with the preset's own format.
        if options.bits is None and f".{ending}" == preset.suffix:
            options.bits = preset.bits
    elif ending and not sequence and Path(options.output).suffix.lower() != f".{ending}":
        raise InputError(f"--format {ending} is not what {options.output} ends in; change one, or leave --format out")
    if options.convention is None:
        options.convention = "opengl"
    if "format" in options:
        options.format = ending or "png"


def parse_base_map(options: argparse.Namespace) -> "BaseMap | None":
    """The one normal map that --onto means, None where it is not given.

    Raises InputError where it stands for several, or cannot be read.
    """
    from mpsnet_core.bake.base_detail_removal import BaseMap
    from mpsnet_core.bake.detail_blending import read_base_map
    from mpsnet_core.bake.texture_names import check_one_texture

    if options.onto is None:
        return None
    check_one_texture(options.onto)
    if Path(options.onto).suffix.lower() == ".json":
        raise InputError(f"{options.onto} lists present maps for several textures; name the one image to go on top of")
    return BaseMap(read_base_map(options.onto, convention=options.onto_convention), options.onto_shown)


def note_base_shares(shares: Sequence[Sequence[float]]) -> None:
    """Tell of views that show the present maps' relief. shares: for each view, what of each map was taken out of it."""
    taken = [share for of_view in shares for share in of_view if share]
    if taken:
        share, views = sum(taken) / len(taken), f"{sum(map(any, shares))} of {len(shares)} view(s)"
        log.info("%s show %.0f%% of the present map's relief, which is not added to it again", views, 100 * share)
