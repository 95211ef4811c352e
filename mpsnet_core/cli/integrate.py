"""The verb integrate: a normal map to heights, meshes, curvature, ambient occlusion and relit pictures."""

import argparse
import logging
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpsnet_core.cli.arguments import Help, Verbs
from mpsnet_core.cli.height_products import PRODUCTS, Surface
from mpsnet_core.cli.on_uvs import add_on_uvs, integrate_on_uvs
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.defaults import CURVATURE_RADIUS, FACES
from mpsnet_core.errors import InputError, check_choice
from mpsnet_core.progress import Progress, part

log = logging.getLogger(__name__)

# Options that go with a photo's normal map only.
_OF_PHOTOS = ("camera", "focal", "pixel_size", "distance", "method", "mesh", "curvature", "occlusion", "relit")
# Options that mean nothing without another one.
_NEEDED = {
    "height_bits": "height",
    **dict.fromkeys(("faces", "open", "up"), "mesh"),
    **dict.fromkeys(("curvature_radius", "curvature_range"), "curvature"),
    "occlusion_reach": "occlusion",
    **dict.fromkeys(("light", "albedo", "turntable"), "relit"),
    **dict.fromkeys(("space", "base", "scale", "mean", "margin"), "uvs"),
}

if TYPE_CHECKING:
    from mpsnet_core.scene.camera import Camera
    from mpsnet_core.scene.normal_map import NormalMap


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    parser = verbs.add_parser(
        "integrate", parents=[common], formatter_class=Help, help="normal map to heights, a mesh, curvature and more"
    )
    parser.add_argument(
        "normals", help="normal map in camera space, as `mpsnet estimate` writes it; or with --uvs a texture"
    )
    parser.add_argument("--convention", default="opengl", help="of the normal map: opengl (green up) or directx")
    place = parser.add_argument_group("what the photo was taken with")
    place.add_argument("--camera", help="camera file")
    place.add_argument("--focal", type=float, metavar="MM", help="in its place the lens, in mm on a 36 mm sensor")
    place.add_argument(
        "--pixel-size", type=float, metavar="S", help="in its place the size of a pixel, seen from afar; 1 unless given"
    )
    place.add_argument(
        "--distance",
        type=float,
        help="mean distance from the camera: of a perspective one it tells the scale (1 unless given), "
        "of an orthographic one where the mesh stands",
    )
    place.add_argument("--unit", help="what the unit of all these is called: mm, m, ...")
    parser.add_argument(
        "--method",
        default="fast",
        help="fast: one smooth surface; bilateral: breaks where one thing stands before another",
    )
    _add_outputs(parser.add_argument_group("what to make, at least one of them"))
    add_on_uvs(parser.add_argument_group("heights on a mesh's UVs, from the normal texture that was baked onto them"))
    parser.set_defaults(verb=partial(_integrate, parser))


def _add_outputs(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--height",
        metavar="FILE",
        help=".exr, float heights; or .png or .tif, 16 bits from black to white. FILE.json says what they mean",
    )
    group.add_argument("--height-bits", type=int, metavar="BITS", help="32 for float heights in .tif")
    group.add_argument("--mesh", metavar="FILE", help=".ply, .glb or .obj, with the photo's UVs")
    group.add_argument(
        "--faces", type=int, default=FACES, help="of the mesh, at most so many, small ones where it bends"
    )
    group.add_argument(
        "--open", type=float, metavar="ANGLE", help="leave out faces this steep or more to the line of sight, as 85"
    )
    group.add_argument(
        "--up",
        choices=("y", "z"),
        help="what points up in the camera's world, for .glb and .obj; z with --camera, y without, unless given",
    )
    group.add_argument(
        "--curvature", metavar="FILE", help="edges bright and creases dark; .exr: sum of both curvatures, 1 / unit"
    )
    group.add_argument(
        "--curvature-radius", type=int, default=CURVATURE_RADIUS, metavar="PIXELS", help="the broadest shapes it shows"
    )
    group.add_argument("--curvature-range", type=float, metavar="C", help="the curvature, per unit, that is white")
    group.add_argument("--occlusion", metavar="FILE", help="ambient occlusion: white where all light comes in")
    group.add_argument(
        "--occlusion-reach", type=int, metavar="PIXELS", help="how far it looks; everywhere unless given"
    )
    group.add_argument("--relit", metavar="FILE", help="picture under a white light; shaded by --occlusion where made")
    group.add_argument("--light", default="45,135", metavar="SLANT,TILT", help="where that light is, in degrees")
    group.add_argument("--albedo", metavar="PHOTO", help="the surface's colour in it; light grey unless given")
    group.add_argument(
        "--turntable",
        type=int,
        metavar="N",
        help="the light goes around in N steps: one picture of all, or frames where FILE has ####",
    )


def _check_together(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Raises InputError where an option is given that the others make meaningless."""
    given = {
        name: "--" + name.replace("_", "-")
        for name, value in vars(options).items()
        if value != parser.get_default(name)
    }
    for name in _OF_PHOTOS if options.uvs else ():
        if name in given:
            raise InputError(f"{given[name]} goes with a photo's normals, not with --uvs; leave it out")
    for name, needed in _NEEDED.items():
        if name in given and not getattr(options, needed):
            raise InputError(f"{given[name]} goes with --{needed}, which is not given; leave it out, or give both")


def _integrate(parser: argparse.ArgumentParser, options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.bake.texture_names import check_one_texture
    from mpsnet_core.io.files import written_together
    from mpsnet_core.io.frames import check_apart, is_several
    from mpsnet_core.relief.integration.integrate import METHODS
    from mpsnet_core.relief.surface_mesh import NoFaceError, check_has_faces
    from mpsnet_core.scene.normal_map import OUTWARDS_SHARE, check_convention, read_normals

    check_convention(options.convention)
    _check_together(parser, options)
    if options.uvs:
        return integrate_on_uvs(options, reporter)
    for file in (options.normals, options.height or ""):
        check_one_texture(file)
    check_choice("method", options.method, METHODS)
    asked = {name: product for name, product in PRODUCTS.items() if getattr(options, name)}
    if not asked:
        wanted = ", ".join(f"--{name}" for name in PRODUCTS)
        raise InputError(f"nothing is asked for; give at least one of {wanted} with a file")
    if is_several(options.normals):
        raise InputError(f"{options.normals} means several normal maps; integrate them one by one")
    taken = [file for file in (options.normals, options.camera, options.albedo) if file]
    for product in asked.values():
        files = product.files(options)
        check_apart(taken, files)
        taken += files
    reporter.progress(0.0, f"reading {Path(options.normals).name}")
    normals = read_normals(options.normals, convention=options.convention)
    if (normals.vectors[normals.mask, 2] >= 0).mean() < OUTWARDS_SHARE:
        raise InputError(
            f"{options.normals} is not in camera space: many of its normals point away from the camera; give a photo's "
            "normals, or for a texture its mesh with --uvs"
        )
    if options.mesh:
        try:
            check_has_faces(normals.mask)
        except InputError as error:
            raise InputError(f"{options.normals}: {error}") from None
    surface = _requested_surface(options, normals, part(reporter.progress, 0.05, 0.75))
    result: dict[str, Any] = {"outputs": [], "unit": surface.unit}
    lines, no_mesh = [], None
    with written_together():
        for number, (name, product) in enumerate(asked.items()):
            output = Path(getattr(options, name))
            first, last = (0.75 + 0.25 * (number + end) / len(asked) for end in (0, 1))
            try:
                made = product.make(options, surface, part(reporter.progress, first, last))
            except NoFaceError as error:  # only known now, and shall cost none of the others
                no_mesh = error
                continue
            result["outputs"] += map(str, made.files)
            result[name] = made.facts
            lines.append(f"{output}: {made.words}")
    if no_mesh is not None:
        raise no_mesh
    reporter.progress(1.0, "done")
    return {**result, "text": "\n".join(lines)}


def _requested_surface(options: argparse.Namespace, normals: "NormalMap", progress: Progress) -> Surface:
    """What the outputs that are asked for are made of, and no more."""
    from mpsnet_core.io.images import read_image
    from mpsnet_core.relief.height_map import pixel_camera
    from mpsnet_core.relief.integration.integrate import integrate
    from mpsnet_core.relief.occlusion import ambient_occlusion
    from mpsnet_core.relief.sizes import check_size

    given = _parse_camera(options, normals)
    camera = given or pixel_camera(*normals.mask.shape)
    if options.distance is not None and not 0 < options.distance < float("inf"):
        raise InputError(f"--distance {options.distance:g} is none; the distance must be a number above 0")
    albedo = read_image(options.albedo).pixels if options.relit and options.albedo else None
    if albedo is not None:
        check_size("albedo", albedo.shape, normals)
    heights = occlusion = None
    bent = options.curvature and camera.projection == "perspective"
    if options.height or options.mesh or options.occlusion or bent:
        if camera.projection == "perspective" and options.distance is None:
            log.info("--distance is not given: the mean distance from the camera counts as 1")
        to_occlusion = 0.5 if options.occlusion else 1.0
        heights = integrate(
            normals,
            camera,
            method=options.method,
            distance=options.distance if camera.projection == "perspective" else None,
            progress=part(progress, 0.0, to_occlusion),
        )
        if options.occlusion:
            occlusion = ambient_occlusion(
                heights, normals, reach=options.occlusion_reach, progress=part(progress, to_occlusion, 1.0)
            )
    return Surface(normals, camera, options.unit or ("unit" if given else "pixel"), heights, occlusion, albedo)


def _parse_camera(options: argparse.Namespace, normals: "NormalMap") -> "Camera | None":
    """The camera that the options tell, None where they tell none."""
    import numpy as np

    from mpsnet_core.scene.camera import Camera, camera_of_lens, read_camera

    given = [name for name in ("camera", "focal", "pixel_size") if getattr(options, name) is not None]
    if len(given) > 1:
        names = " and ".join("--" + name.replace("_", "-") for name in given)
        raise InputError(f"{names} tell the same; give one of them")
    height, width = normals.mask.shape
    if options.camera:
        camera = read_camera(options.camera)
        if (camera.height, camera.width) != (height, width):
            raise InputError(
                f"camera {options.camera} is {camera.width} x {camera.height} but {options.normals} is "
                f"{width} x {height}; give the camera that the photo was taken with"
            )
        return camera
    if options.focal is not None:
        return camera_of_lens(options.focal, width, height)
    if options.pixel_size is not None:
        if not (np.isfinite(options.pixel_size) and options.pixel_size > 0):
            raise InputError(f"--pixel-size {options.pixel_size:g} is no size; give a number above 0")
        return Camera("orthographic", width, height, np.full(2, 1 / options.pixel_size))
    return None
