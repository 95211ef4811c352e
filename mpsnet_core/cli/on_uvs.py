"""The verb integrate with --uvs: a normal texture to heights on the same mesh's UVs."""

import argparse
import logging
from pathlib import Path
from typing import Any

from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.defaults import MARGIN
from mpsnet_core.errors import InputError
from mpsnet_core.progress import part

log = logging.getLogger(__name__)


def add_on_uvs(group: argparse._ArgumentGroup) -> None:
    """The options that go with --uvs alone."""
    group.add_argument(
        "--uvs", metavar="MESH", help="the mesh that the texture was baked onto; makes --height on its UVs"
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

    from mpsnet_core.frames import check_apart
    from mpsnet_core.heights.height_files import height_files, write_height
    from mpsnet_core.heights.on_uvs import displacement
    from mpsnet_core.normals import read_normals
    from mpsnet_core.surface.mesh import read_mesh

    if not options.height:
        raise InputError("--uvs makes heights; name their file with --height")
    files = height_files(options.height, options.height_bits)
    check_apart([file for file in (options.normals, options.uvs, options.base) if file], files)
    reporter.progress(0.0, "reading the mesh")
    mesh = read_mesh(options.uvs)
    base = read_mesh(options.base) if options.base else None
    reporter.progress(0.05, f"reading {Path(options.normals).name}")
    texture = read_normals(options.normals, convention=options.convention)
    found = displacement(
        texture.vectors,
        mesh,
        space=options.space,
        base=base,
        scale=options.scale,
        mean=options.mean,
        margin=options.margin,
        progress=part(reporter.progress, 0.1, 0.9),
    )
    reporter.progress(0.9, f"writing {Path(options.height).name}")
    unit = options.unit or "unit"
    scale = write_height(options.height, found.as_height_map(), bits=options.height_bits, unit=unit, on_uvs=True)
    inside = found.values[found.covered]
    lowest, highest = float(inside.min()), float(inside.max())
    across = float(np.linalg.norm(np.ptp(mesh.world_vertices, axis=0)))
    if highest - lowest > across:
        log.warning(
            "the heights span %.3g %s, and the whole mesh %.3g; check that the texture was baked onto this mesh, in %s "
            "space and %s",
            highest - lowest,
            unit,
            across,
            options.space,
            options.convention,
        )
    return {
        "outputs": [str(file) for file in files[:2]],
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
