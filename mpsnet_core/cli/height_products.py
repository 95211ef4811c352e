"""What the verb integrate makes: for each output where it goes, how it is made, and what is told of it."""

import argparse
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpsnet_core.errors import InputError
from mpsnet_core.progress import Progress
from mpsnet_core.scene.rig import slant_and_tilt

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mpsnet_core.relief.height_map import HeightMap
    from mpsnet_core.scene.camera import Camera
    from mpsnet_core.scene.normal_map import NormalMap


@dataclass(frozen=True)
class Surface:
    """What the outputs are made of, None where no output needs it. unit: what the camera's unit is called."""

    normals: "NormalMap"
    camera: "Camera"
    unit: str
    heights: "HeightMap | None"
    occlusion: "NDArray[np.float32] | None"
    albedo: "NDArray[np.float32] | None"


@dataclass(frozen=True)
class Made:
    """Files that were written, and what is told of them: in words, and as JSON."""

    files: list[Path]
    words: str
    facts: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Product:
    """files: where an output goes; raises InputError where it cannot. make: makes and writes it."""

    files: Callable[[argparse.Namespace], list[Path]]
    make: Callable[[argparse.Namespace, Surface, Progress], Made]


# --- height -----------------------------------------------------------------------------------------------------------


def _height_files(options: argparse.Namespace) -> list[Path]:
    from mpsnet_core.relief.height_files import height_files

    return height_files(options.height, options.height_bits)


def _height(options: argparse.Namespace, surface: Surface, progress: Progress) -> Made:
    from mpsnet_core.relief.height_files import write_height
    from mpsnet_core.relief.height_names import height_names

    heights = surface.heights
    assert heights is not None
    progress(0.0, f"writing {Path(options.height).name}")
    scale = write_height(options.height, heights, bits=options.height_bits, unit=surface.unit)
    inside = heights.values[heights.mask]
    facts = {
        "lowest": float(inside.min()),
        "highest": float(inside.max()),
        "black": scale.black,
        "white": scale.white,
        "strength": scale.strength,
        "midlevel": scale.midlevel,
    }
    from_camera = "; height 0 is at the camera" if heights.camera.projection == "perspective" else ""
    words = f"{scale}{from_camera}; Blender's Displace: strength {scale.strength:.6g}, midlevel {scale.midlevel:.6g}"
    files = height_names(options.height)
    return Made(files[:2] if heights.mask.all() else files, words, facts)


# --- mesh -------------------------------------------------------------------------------------------------------------


def _mesh_files(options: argparse.Namespace) -> list[Path]:
    from mpsnet_core.relief.surface_mesh import check_surface_mesh, writable_mesh

    check_surface_mesh(options.faces, options.open)
    return [writable_mesh(options.mesh)]


def _mesh(options: argparse.Namespace, surface: Surface, progress: Progress) -> Made:
    from mpsnet_core.relief.surface_mesh import Up, surface_mesh, write_surface_mesh

    assert surface.heights is not None
    heights = surface.heights
    if surface.camera.projection == "orthographic" and options.distance is not None:
        heights = replace(heights, values=heights.values - options.distance)
    mesh = surface_mesh(heights, surface.normals, faces=options.faces, open_from=options.open, progress=progress)
    progress(0.9, f"writing {Path(options.mesh).name}")
    up: Up = options.up or ("z" if options.camera else "y")
    write_surface_mesh(options.mesh, mesh, up=up)
    facts = {"vertices": len(mesh.vertices), "faces": len(mesh.triangles), "up": up}
    count = "1 face" if facts["faces"] == 1 else f"{facts['faces']} faces"
    return Made([Path(options.mesh)], f"{count}, in {surface.unit}", facts)


# --- curvature --------------------------------------------------------------------------------------------------------


def _curvature_files(options: argparse.Namespace) -> list[Path]:
    from mpsnet_core.relief.curvature import check_curvature

    check_curvature(options.curvature_radius, options.curvature_range)
    return _image(options.curvature)


def _curvature(options: argparse.Namespace, surface: Surface, progress: Progress) -> Made:
    from mpsnet_core.io.images import write_image
    from mpsnet_core.relief.curvature import curvature, curvature_picture, curvature_range

    output, normals, unit = Path(options.curvature), surface.normals, surface.unit
    depth = None if surface.heights is None else -surface.heights.values
    values = curvature(normals, surface.camera, depth, radius=options.curvature_radius, progress=progress)
    limit = options.curvature_range or curvature_range(values, normals.mask)
    if output.suffix.lower() == ".exr":
        words = f"the sum of both curvatures in 1 / {unit}, above 0 where convex"
        write_image(output, values, description=words)
    else:
        words = f"flat is 0.5, white is convex by {limit:.6g} / {unit} (the sum of both curvatures), black concave"
        write_image(output, curvature_picture(values, limit), bits=16, description=words)
    return Made([output], words, {"range": limit})


# --- ambient occlusion ------------------------------------------------------------------------------------------------


def _occlusion_files(options: argparse.Namespace) -> list[Path]:
    from mpsnet_core.relief.occlusion import check_reach

    check_reach(options.occlusion_reach)
    return _image(options.occlusion)


def _occlusion(options: argparse.Namespace, surface: Surface, progress: Progress) -> Made:
    from mpsnet_core.io.images import write_image

    assert surface.occlusion is not None
    write_image(options.occlusion, surface.occlusion)
    mean = float(surface.occlusion[surface.normals.mask].mean())
    return Made([Path(options.occlusion)], f"on the mean {mean:.1%} of the light comes in", {"mean": round(mean, 4)})


# --- relit ------------------------------------------------------------------------------------------------------------


def _relit_files(options: argparse.Namespace) -> list[Path]:
    """One picture, or a frame for each light of a turntable where the name has a run of #."""
    from mpsnet_core.relief.relight import turntable_tilts

    tilts = turntable_tilts(options.turntable, 0) if options.turntable is not None else [0.0]
    output = Path(options.relit)
    slant_and_tilt("--light", options.light)
    if output.suffix.lower() == ".exr":
        raise InputError(f"cannot write {output}: a relit picture is for the screen; use .png or .tif")
    if "#" not in output.name:
        return _image(output)
    if options.turntable is None:
        raise InputError(f"{output} stands for frames, and there is one light; give --turntable, or a name without #")
    head, run, tail = re.split("(#+)", output.name, maxsplit=1)
    names = [f"{head}{number:0{len(run)}d}{tail}" for number in range(1, len(tilts) + 1)]
    return [file for name in names for file in _image(output.with_name(name))]


def _relit(options: argparse.Namespace, surface: Surface, progress: Progress) -> Made:
    from mpsnet_core.io.images import write_image
    from mpsnet_core.relief.relight import relit, turntable_sheet, turntable_tilts
    from mpsnet_core.scene.rig import direction_from_angles

    slant, tilt = slant_and_tilt("--light", options.light)
    shown = {"occlusion": surface.occlusion, "albedo": surface.albedo}
    files = _relit_files(options)
    tilts = [tilt] if options.turntable is None else turntable_tilts(options.turntable, tilt)
    if len(tilts) > 1 and len(files) == 1:
        progress(0.0, f"making {files[0].name}")
        write_image(files[0], turntable_sheet(surface.normals, slant, tilts, **shown), bits=8, color_space="sRGB")
    else:
        for number, (file, angle) in enumerate(zip(files, tilts, strict=True)):
            progress(number / len(files), f"making {file.name}")
            picture = relit(surface.normals, direction_from_angles(slant, angle), **shown)
            write_image(file, picture, bits=8, color_space="sRGB")
    around = f"{len(tilts)} lights around from" if len(tilts) > 1 else "a white light at"
    return Made(files, f"{around} slant {slant:g}°, tilt {tilt:g}°", {"tilts": tilts})


def _image(path: str | Path) -> list[Path]:
    from mpsnet_core.io.files import writable_path
    from mpsnet_core.io.images import checked_bits

    path = writable_path(path)
    checked_bits(path)
    return [path]


# In the order in which they are made; each is asked for by the option of its name.
PRODUCTS = {
    "height": Product(_height_files, _height),
    "curvature": Product(_curvature_files, _curvature),
    "occlusion": Product(_occlusion_files, _occlusion),
    "relit": Product(_relit_files, _relit),
    "mesh": Product(_mesh_files, _mesh),
}
