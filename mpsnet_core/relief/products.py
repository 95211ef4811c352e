"""Products of a photo's normal map: heights, a mesh, curvature, ambient occlusion and relit images, and their files."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F32
from mpsnet_core.errors import FileError, SettingsError
from mpsnet_core.io.files import check_no_overwrite, prefix_errors, writable_image, write_transaction
from mpsnet_core.io.frames import is_folder_or_pattern
from mpsnet_core.io.image_reading import read_image
from mpsnet_core.io.image_writing import write_image, write_picture
from mpsnet_core.io.marks import made
from mpsnet_core.operation import Result
from mpsnet_core.progress import Progress, part
from mpsnet_core.relief import surface_mesh
from mpsnet_core.relief.curvature import check_curvature, curvature, curvature_picture, curvature_range
from mpsnet_core.relief.height_files import HeightFacts, height_files, write_height
from mpsnet_core.relief.height_map import HeightMap, check_size
from mpsnet_core.relief.integration.integrate import grained_box, integrate
from mpsnet_core.relief.occlusion import ambient_occlusion, check_reach
from mpsnet_core.relief.operations import Integrate
from mpsnet_core.relief.relight import relit
from mpsnet_core.scene.camera import Camera, camera_for, pixel_camera
from mpsnet_core.scene.normal_directions import check_directions
from mpsnet_core.scene.normal_map import NormalMap, read_normals
from mpsnet_core.scene.rig import direction_from_angles, slant_and_tilt
from mpsnet_core.scene.texture_names import check_one_texture

log = logging.getLogger(__name__)

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True)
class Surface:
    """Inputs of the products, None where no requested product needs them."""

    normals: NormalMap | None
    """Normals of the whole photo."""
    camera: Camera
    """The photo's camera."""
    unit: str
    """Name of the camera's unit."""
    heights: HeightMap | None
    """Heights in that unit."""
    occlusion: F32 | None
    """(H, W) float32. Fraction of ambient light that reaches each pixel."""
    albedo: F32 | None
    """(H, W, 3) float32. Linear colour of the surface without light and shadow."""


@dataclass(frozen=True)
class CurvatureFacts:
    """Facts of a curvature image."""

    range: float
    """The curvature that is white, in 1 over the unit."""


@dataclass(frozen=True)
class OcclusionFacts:
    """Facts of an occlusion image."""

    mean: float
    """Mean fraction of ambient light that reaches the surface."""


@dataclass(frozen=True)
class MeshFacts:
    """Facts of a mesh."""

    vertices: int
    """Number of vertices."""
    faces: int
    """Number of faces."""
    up: surface_mesh.Up
    """The axis that points up."""


@dataclass(frozen=True)
class SurfaceMade(Result):
    """The products of a photo's normals."""

    outputs: list[str]
    """The files."""
    unit: str
    """Name of the unit of all values."""
    height: HeightFacts | None = None
    """Facts of the heights; None if they were not requested."""
    curvature: CurvatureFacts | None = None
    """Facts of the curvature image; None if it was not requested."""
    occlusion: OcclusionFacts | None = None
    """Facts of the occlusion image; None if it was not requested."""
    mesh: MeshFacts | None = None
    """Facts of the mesh; None if it was not requested."""


# A product's description and its facts, if it has any.
Made: TypeAlias = tuple[str, HeightFacts | CurvatureFacts | OcclusionFacts | MeshFacts | None]


def make_products(options: Integrate, progress: Progress) -> SurfaceMade:
    """Write the requested products, all of them or none. Raises InputError if one cannot be made or written."""
    products = _product_files(options)
    progress(0.0, f"reading {Path(options.normals).name}")
    surface = _surface(options, part(progress, 0.05, 0.75))
    outputs: list[Path] = []
    facts: dict[str, Any] = {}
    lines, no_mesh = [], None
    with write_transaction():
        for number, (name, files) in enumerate(products.items()):
            first, last = (0.75 + 0.25 * (number + end) / len(products) for end in (0, 1))
            try:
                words, fact = _WRITERS[name](options, surface, files, part(progress, first, last))
            except surface_mesh.NoFaceError as error:  # not known before; the other products are kept
                no_mesh = error
                continue
            if fact:
                facts[name] = fact
            outputs += files
            lines.append(f"{getattr(options, name)}: {words}")
    if no_mesh is not None:
        raise no_mesh
    progress(1.0, "done")
    return SurfaceMade(list(map(str, outputs)), surface.unit, **facts, text="\n".join(lines))


def _product_files(options: Integrate) -> dict[str, list[Path]]:
    """The files of each requested product, by option. Raises InputError if there is none, or one cannot be written."""
    for name in (options.normals, options.height or ""):
        check_one_texture(name)
    requested = {name: Path(file) for name in _WRITERS if (file := getattr(options, name))}
    if not requested:
        wanted = ", ".join(f"--{name}" for name in _WRITERS)
        raise SettingsError(f"nothing is requested; give at least one of {wanted} with a file")
    if is_folder_or_pattern(options.normals):
        raise SettingsError(f"{options.normals} matches several normal maps; integrate them one by one")
    taken = [Path(file) for file in (options.normals, options.camera, options.albedo) if file]
    found = {}
    for name, path in requested.items():
        found[name] = _checked_files(options, name, path)
        check_no_overwrite(taken, found[name])
        taken += found[name]
    return found


def _checked_files(options: Integrate, name: str, path: Path) -> list[Path]:
    """The files of a product. Raises InputError if it cannot be made or written."""
    if name == "height":
        return height_files(path, options.height_bits)
    if name == "mesh":
        surface_mesh.check_surface_mesh(options.faces, options.open)
        return [surface_mesh.writable_mesh(path)]
    if name == "relit":
        slant_and_tilt("--light", options.light)
        if path.suffix.lower() == ".exr":
            raise FileError(f"cannot write {path}: a relit picture is for the screen; use .png or .tif")
    if name == "curvature":
        check_curvature(options.curvature_radius, options.curvature_range)
    else:
        check_reach(options.occlusion_reach)
    return [writable_image(path)]


# --- inputs -----------------------------------------------------------------------------------------------------------


def _read_normals(options: Integrate) -> NormalMap:
    normals = read_normals(options.normals, convention=options.convention)
    check_directions(normals, options.normals)
    if options.mesh:
        with prefix_errors(options.normals):
            surface_mesh.check_has_faces(normals.mask)
    return normals


def _surface(options: Integrate, progress: Progress) -> Surface:
    """The inputs that the requested products need."""
    normals = _read_normals(options)
    height, width = normals.mask.shape
    given = _camera(options, height, width)
    camera = given or pixel_camera(width, height)
    perspective = camera.projection == "perspective"
    if options.distance is not None and not 0 < options.distance < np.inf:
        raise SettingsError(f"--distance {options.distance:g} cannot be used; give a number above 0")
    if options.distance is not None and not (options.camera or options.focal or options.mesh):
        raise SettingsError("--distance goes with --camera, --focal or --mesh; give one, or leave it out")
    albedo = read_image(options.albedo).pixels if options.relit and options.albedo else None
    if albedo is not None:
        check_size("albedo", albedo.shape, normals)
    kept = normals if options.curvature or options.relit or options.mesh else None
    heights = occlusion = None
    if options.height or options.mesh or options.occlusion or (options.curvature and perspective):
        if perspective and options.distance is None:
            log.info("--distance is not given: the mean distance from the camera counts as 1 [no-distance]")
        to_occlusion = 0.5 if options.occlusion else 1.0
        box = grained_box(normals.mask) if kept is None else (slice(0, height), slice(0, width))
        if kept is None:
            normals = _cropped(normals, box)  # the rest is released: a large photo's takes much memory
        inner = camera.cropped(box[1].start, box[0].start, *normals.mask.shape[::-1])
        step = part(progress, 0.0, to_occlusion)
        distance = options.distance if perspective else None
        heights = integrate(normals, inner, method=options.method, distance=distance, progress=step)
        if options.occlusion:
            step = part(progress, to_occlusion, 1.0)
            occlusion = ambient_occlusion(heights, normals, reach=options.occlusion_reach, progress=step)
            occlusion = _placed(occlusion, box, (height, width), 1)
        del normals
        values = _placed(heights.values, box, (height, width), 0)
        heights = HeightMap(values, _placed(heights.mask, box, (height, width), 0), camera)
    return Surface(kept, camera, options.unit or ("unit" if given else "pixel"), heights, occlusion, albedo)


def _camera(options: Integrate, height: int, width: int) -> Camera | None:
    """The camera of a photo of that size, None if the options define none."""
    lens, pixel_size = options.lens(), options.pixel_size
    if pixel_size is None or lens is not None:
        if pixel_size is not None:
            raise SettingsError("--pixel-size, --camera and --focal define the same camera; give one of them")
        with prefix_errors(options.normals):
            return camera_for(lens, width, height)
    if not 0 < pixel_size < np.inf:
        raise SettingsError(f"--pixel-size {pixel_size:g} cannot be used; give a number above 0")
    return Camera("orthographic", width, height, np.full(2, 1 / pixel_size))


def _cropped(normals: NormalMap, box: tuple[slice, slice]) -> NormalMap:
    """A copy of a part of the normals. Their confidence is the mask, which takes no memory of its own."""
    mask = normals.mask[box].copy()
    return NormalMap(normals.vectors[box].copy(), mask, mask, in_place=True)  # type: ignore[arg-type]


def _placed(values: NDArray[T], box: tuple[slice, slice], shape: tuple[int, int], outside: float) -> NDArray[T]:
    """The values of a part of an image of `shape`, and `outside` around it."""
    whole = np.full(shape, outside, values.dtype)
    whole[box] = values
    return whole


# --- outputs: each writes a product to its files ----------------------------------------------------------------------


def _write_height(options: Integrate, surface: Surface, files: list[Path], progress: Progress) -> Made:
    heights = surface.heights
    assert heights is not None
    progress(0.0, f"writing {files[0].name}")
    scale = write_height(files[0], heights, bits=options.height_bits, unit=surface.unit)
    if heights.mask.all():
        del files[2:]  # no mask is written
    inside = heights.values[heights.mask]
    from_camera = "; height 0 is at the camera" if heights.camera.projection == "perspective" else ""
    words = f"{scale}{from_camera}; {scale.displace_words}"
    return words, scale.facts(float(inside.min()), float(inside.max()))


def _write_curvature(options: Integrate, surface: Surface, files: list[Path], progress: Progress) -> Made:
    (path,), normals, unit = files, surface.normals, surface.unit
    assert normals is not None
    depth = None if surface.heights is None else -surface.heights.values
    values = curvature(normals, surface.camera, depth, radius=options.curvature_radius, progress=progress)
    limit = options.curvature_range or curvature_range(values, normals.mask)
    if path.suffix.lower() == ".exr":
        words = f"the sum of both curvatures in 1 / {unit}, above 0 where convex"
        write_image(path, values, description=f"{made('curvature')}: {words}")
    else:
        words = f"flat is 0.5, white is convex by {limit:.6g} / {unit} (the sum of both curvatures), black concave"
        told = f"{made('curvature map')}: {words}"
        write_image(path, curvature_picture(values, limit), bits=16, description=told)
    return words, CurvatureFacts(limit)


def _write_occlusion(options: Integrate, surface: Surface, files: list[Path], progress: Progress) -> Made:
    assert surface.occlusion is not None and surface.heights is not None
    write_image(files[0], surface.occlusion, description=made("ambient occlusion"))
    mean = float(surface.occlusion[surface.heights.mask].mean())
    return f"on the mean {mean:.1%} of the light comes in", OcclusionFacts(round(mean, 4))


def _write_relit(options: Integrate, surface: Surface, files: list[Path], progress: Progress) -> Made:
    slant, tilt = slant_and_tilt("--light", options.light)
    assert surface.normals is not None
    progress(0.0, f"making {files[0].name}")
    direction = direction_from_angles(slant, tilt)
    write_picture(files[0], relit(surface.normals, direction, occlusion=surface.occlusion, albedo=surface.albedo))
    return f"a white light at slant {slant:g}°, tilt {tilt:g}°", None


def _write_mesh(options: Integrate, surface: Surface, files: list[Path], progress: Progress) -> Made:
    heights, normals = surface.heights, surface.normals
    assert heights is not None and normals is not None
    if surface.camera.projection == "orthographic" and options.distance is not None:
        heights = replace(heights, values=heights.values - options.distance)
    mesh = surface_mesh.surface_mesh(heights, normals, faces=options.faces, open_from=options.open, progress=progress)
    progress(0.9, f"writing {files[0].name}")
    up: surface_mesh.Up = options.up or ("z" if options.camera else "y")
    surface_mesh.write_surface_mesh(files[0], mesh, up=up)
    facts = MeshFacts(len(mesh.vertices), len(mesh.triangles), up)
    return f"{'1 face' if facts.faces == 1 else f'{facts.faces} faces'}, in {surface.unit}", facts


_WRITERS = {"height": _write_height, "curvature": _write_curvature, "occlusion": _write_occlusion}
_WRITERS |= {"relit": _write_relit, "mesh": _write_mesh}
