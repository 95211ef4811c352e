"""The verb integrate with --uvs: a normal texture to heights on the same mesh's UVs."""

import argparse
import logging
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.defaults import MARGIN
from mpsnet_core.errors import InputError
from mpsnet_core.progress import part

log = logging.getLogger(__name__)

# The share of the surface where normals that fit it may contradict one another: a photo's around eyes and nostrils are
# some hundredths.
DOUBTFUL = 0.3


def add_on_uvs(group: argparse._ArgumentGroup) -> None:
    """The options that go with --uvs alone."""
    group.add_argument(
        "--uvs",
        metavar="MESH",
        help="the mesh with UVs that the texture was baked onto; needs --height; <UDIM> in both names for UDIM tiles",
    )
    group.add_argument("--space", default="tangent", help="of the texture: tangent (MikkTSpace) or object")
    group.add_argument("--base", metavar="MESH", help="what is to be displaced, where that is the same mesh subdivided")
    group.add_argument(
        "--scale",
        type=float,
        default=0.0,
        help="leave bumps wider than this share of the mesh's size to the mesh; 0 keeps all",
    )
    group.add_argument("--mean", type=float, help="of the heights; unless given, the surface stays where it is")
    group.add_argument("--margin", type=int, default=MARGIN, help="texels that the islands' borders are grown by")


def integrate_on_uvs(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    """Write the heights that the options ask for, and give what is told of them, as plain data.

    Raises InputError where a file cannot be read or written, a number is out of range, or the texture does not fit the
    mesh.
    """
    import numpy as np

    from mpsnet_core.bake.texture_names import texture_files
    from mpsnet_core.bake.texture_sets import sheets
    from mpsnet_core.io.files import written_together
    from mpsnet_core.relief.displacement.displacement import displacement
    from mpsnet_core.relief.displacement.udim import tiles_of
    from mpsnet_core.relief.height_files import write_height
    from mpsnet_core.scene.mesh import read_mesh
    from mpsnet_core.scene.normal_map import read_normals

    tiled = _tiled(options)
    reporter.progress(0.0, "reading the mesh")
    mesh = read_mesh(options.uvs)
    base = read_mesh(options.base) if options.base else None
    chosen = sheets([mesh], tiles=tiled)
    textures, outputs = ([Path(name)] for name in (options.normals, options.height))
    if tiled:
        textures, outputs = (texture_files(name, chosen) for name in (options.normals, options.height))
    files = _checked_outputs(options, textures, outputs)
    tiles = tiles_of(chosen)
    reporter.progress(0.05, f"reading {Path(options.normals).name}")
    vectors = tiles.joined(read_normals(texture, convention=options.convention).vectors for texture in textures)
    found = displacement(
        vectors,
        tiles.mesh(mesh) if tiled else mesh,
        space=options.space,
        base=tiles.mesh(base) if tiled and base else base,
        scale=options.scale,
        mean=options.mean,
        margin=options.margin,
        progress=part(reporter.progress, 0.1, 0.9),
    )
    reporter.progress(0.9, f"writing {Path(options.height).name}")
    unit = options.unit or "unit"
    ends = float(found.values.min()), float(found.values.max())
    with written_together():
        for output, values in zip(outputs, tiles.parted(found.values), strict=True):
            heights = replace(found, values=values).as_height_map()
            scale = write_height(output, heights, bits=options.height_bits, unit=unit, on_uvs=True, ends=ends)
    inside = found.values[found.covered]
    lowest, highest = float(inside.min()), float(inside.max())
    across = float(np.linalg.norm(np.ptp(mesh.world_vertices, axis=0)))
    told = []
    if highest - lowest > across:
        told.append(f"the heights span {highest - lowest:.3g} {unit}, and the whole mesh {across:.3g}")
    if found.contradicted > DOUBTFUL:
        told.append(f"the normals contradict one another on {found.contradicted:.0%} of the surface, which stays flat")
    if told:
        log.warning(
            "%s; check that the texture was baked onto this mesh, in %s space and %s",
            "; ".join(told),
            options.space,
            options.convention,
        )
    return {
        "outputs": [str(file) for file in files],
        "tiles": [sheet.tile for sheet in chosen if sheet.tile],
        "unit": unit,
        "height": {
            "lowest": lowest,
            "highest": highest,
            "black": scale.black,
            "white": scale.white,
            "strength": scale.strength,
            "midlevel": scale.midlevel,
            "seam_step": found.seam_step,
        },
        "text": f"{options.height}: heights from {lowest:.4g} to {highest:.4g} {unit}; {scale}; "
        f"Blender's Displace: strength {scale.strength:.6g}, midlevel {scale.midlevel:.6g}",
    }


def _tiled(options: argparse.Namespace) -> bool:
    """Whether texture and heights are of UDIM tiles. Raises InputError where no heights are asked for, or one is."""
    from mpsnet_core.bake.texture_names import check_one_texture, split_by

    if not options.height:
        raise InputError("--uvs makes heights; name their file with --height")
    tiled = ["tile" in split_by(name) for name in (options.normals, options.height)]
    if tiled[0] != tiled[1]:
        has, lacks = (options.normals, options.height) if tiled[0] else (options.height, options.normals)
        raise InputError(f"{has} means a file for each UDIM tile, and {lacks} one for all; put <UDIM> into both names")
    if not tiled[0]:
        for name in (options.normals, options.height):
            check_one_texture(name)
    return tiled[0]


def _checked_outputs(options: argparse.Namespace, textures: Sequence[Path], outputs: Sequence[Path]) -> list[Path]:
    """The heights' files and their scales. Raises InputError where they cannot be written."""
    from mpsnet_core.io.frames import check_apart
    from mpsnet_core.relief.height_files import height_files

    files = []
    for output in outputs:
        written = height_files(output, options.height_bits)
        check_apart([*textures, *(file for file in (options.uvs, options.base) if file)], written)
        files += written[:2]
    return files
