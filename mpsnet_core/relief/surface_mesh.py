"""Adaptive triangulation of a height field: few triangles where it is flat, many where it bends, and no cracks.

Right-triangulated irregular networks: Evans, Kirkpatrick and Townsend, Right-Triangulated Irregular Networks,
Algorithmica 30 (2001). A triangle is split at the midpoint of its longest side, always together with its neighbour
there. The error of not splitting is computed for each midpoint beforehand, and is at least that of all finer midpoints
within: the triangles of any tolerance fit together without cracks.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F32, F64, I32, Bools, Floats
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.defaults import FACES, MAX_FACES
from mpsnet_core.errors import FileError, GeometryError, SettingsError
from mpsnet_core.io.files import atomic_write, writable_path
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.progress import Progress, silent
from mpsnet_core.relief.height_map import HeightMap, check_size, parallel_heights, pixel_size
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import triangle_normals
from mpsnet_core.scene.normal_map import NormalMap

# The largest triangles are halves of squares with this many pixels on a side.
LARGEST = 256
# An outline error of one pixel counts as much as a surface error of this many.
OUTLINE_WEIGHT = 0.5

T = TypeVar("T", bound=np.generic)
# The search for a tolerance stops at this fraction of the requested triangles, or after this many rounds.
NEAR_ENOUGH, ROUNDS = 0.97, 20


def adaptive_triangles(values: F32, mask: Bools, pixel: float, most: int, progress: Progress = silent) -> I32:
    """(T, 3) pixel indices (row * W + column) of at most `most` triangles that approximate heights `values` (H, W).

    Their corners lie in the mask, (H, W) bool, and are counter-clockwise in the image. There are none if `most` is too
    small even for the largest triangles, or the mask too small for one. pixel: size of a pixel, in the unit of the
    values.
    """
    height, width = mask.shape
    side = 1 << (min(LARGEST, max(height, width) - 1).bit_length() - 1) if mask.size > 1 else 1
    # Pad to whole squares: pixels and triangle corners beyond the image's border are clamped to it.
    padding = [(0, -(length - 1) % side) for length in (height, width)]
    mask = np.pad(mask, padding, mode="edge")
    progress(0.0, "triangles")
    errors = _errors(np.pad(values, padding, mode="edge"), mask, pixel, side)
    progress(0.4, "triangles")
    ordered = np.sort(errors[errors > 0])[::-1]
    # n splits give about 2 n triangles, minus those outside the mask.
    best = np.empty((0, 3), np.int32)
    enough, too_many, tried = -1, len(ordered) + 1, min(most // 2, len(ordered))
    for turn in range(ROUNDS):
        progress(0.4 + 0.6 * turn / ROUNDS, "triangles")
        tolerance = float(ordered[tried]) if tried < len(ordered) else 0.0
        found = _leaves(errors, mask, tolerance, side, (height, width))
        if len(found) <= most:
            enough, best = tried, found
        else:
            too_many = tried
        if too_many - enough <= 1 or len(best) >= NEAR_ENOUGH * most:
            break
        unbounded = too_many > len(ordered)
        tried = min(tried + max(1, most - len(found)), len(ordered)) if unbounded else (enough + too_many) // 2
    return best


def _errors(values: F32, mask: Bools, pixel: float, side: int) -> F32:
    """(H, W) error, in the unit of the values, of not splitting the longest side that has its midpoint there."""
    errors = np.zeros(mask.shape, np.float32)
    step = 1
    while step < side:
        outline = np.float32(OUTLINE_WEIGHT * pixel * step)
        for turned in (np.transpose, np.asarray):
            _along_rows(turned(errors), turned(values), turned(mask), outline, step)
        _across_squares(errors, values, mask, outline, step)
        step *= 2
    return errors


def _along_rows(errors: F32, values: F32, mask: Bools, outline: np.float32, step: int) -> None:
    """Fill in the errors at the midpoints of sides along rows, which reach `step` pixels to the left and right."""
    rows, middle = slice(0, None, 2 * step), slice(step, None, 2 * step)
    threes = (middle, slice(0, -step, 2 * step), slice(2 * step, None, 2 * step))
    own = _deviation([values[rows, place] for place in threes], [mask[rows, place] for place in threes], outline)
    if step > 1:
        # Include finer midpoints: the centres of the four squares of `step` pixels around this one.
        squares = errors[step // 2 :: step, step // 2 :: step]
        beside = np.pad(np.maximum(squares[:, ::2], squares[:, 1::2]), ((1, 1), (0, 0)))
        own = np.maximum(own, np.maximum(beside[::2], beside[1::2]))
    errors[rows, middle] = own


def _across_squares(errors: F32, values: F32, mask: Bools, outline: np.float32, step: int) -> None:
    """Fill in the errors at the midpoints of diagonals, in squares of 2 `step` pixels. Diagonals alternate."""
    first, middle, last = slice(0, -step, 2 * step), slice(step, None, 2 * step), slice(2 * step, None, 2 * step)
    falling = np.indices(errors[middle, middle].shape).sum(axis=0) % 2 == 0

    def threes(field: NDArray[T]) -> list[NDArray[T]]:
        one = np.where(falling, field[first, first], field[first, last])
        other = np.where(falling, field[last, last], field[last, first])
        return [field[middle, middle], one, other]

    own = _deviation(threes(values), threes(mask), outline)
    level, upright = errors[:: 2 * step, middle], errors[middle, :: 2 * step]
    for sides in (level[:-1], level[1:], upright[:, :-1], upright[:, 1:]):
        own = np.maximum(own, sides)
    errors[middle, middle] = own


def _deviation(values: list[F32], inside: list[Bools], outline: np.float32) -> F32:
    """Distance of midpoints from the line between the ends; `outline` where the mask's edge runs between the three.

    values, inside: of the midpoints, of one end and of the other.
    """
    middle, one, other = values
    off = np.abs(middle - (one + other) / 2)
    count = sum(part.astype(np.int8) for part in inside)
    return np.where(count == 3, off, np.where(count == 0, np.float32(0), outline))


def _leaves(errors: F32, mask: Bools, tolerance: float, side: int, picture: tuple[int, int]) -> I32:
    """(T, 3) corners, as pixel indices of the image, of the triangles in the mask that need not be split."""
    height, width = mask.shape
    rows, columns = np.mgrid[0 : height - 1 : side, 0 : width - 1 : side].reshape(2, -1)
    top_left = rows * width + columns
    top_right, bottom_left, bottom_right = top_left + side, top_left + side * width, top_left + side * (width + 1)
    falling = (rows + columns) // side % 2 == 0
    lower = [bottom_right, top_left, bottom_left], [bottom_left, top_right, top_left]
    upper = [top_left, bottom_right, top_right], [top_right, bottom_left, bottom_right]
    halves = [np.where(falling, np.stack(one), np.stack(other)) for one, other in (lower, upper)]
    # The two ends of the longest side, and the opposite corner.
    one, other, corner = np.concatenate(halves, axis=1)
    flat, inside = errors.ravel(), mask.ravel()
    leaves = []
    for _ in range(2 * (side.bit_length() - 1)):
        middle = (one + other) // 2
        split = flat[middle] > tolerance
        leaves.append(np.stack([one, other, corner])[:, ~split])
        one, other, corner, middle = one[split], other[split], corner[split], middle[split]
        one, other, corner = np.concatenate([[corner, one, middle], [other, corner, middle]], axis=1)
    triangles = np.concatenate([*leaves, np.stack([one, other, corner])], axis=1)
    rows, columns = np.divmod(triangles[:, inside[triangles].all(axis=0)], width)
    rows, columns = np.minimum(rows, picture[0] - 1), np.minimum(columns, picture[1] - 1)
    (y, x), (other_y, other_x) = ((line[1] - line[0], line[2] - line[0]) for line in (rows, columns))
    spread = y * other_x != x * other_y
    return (rows * picture[1] + columns)[:, spread].T.astype(np.int32)


# ----------------------------------------------------------------------------------------------------------------------
# A height map as a mesh, with the photo as UV space, and its files.


Up = Literal["y", "z"]
MESH_SUFFIXES = (".ply", ".glb", ".obj")
# A mesh further from the origin than this many times its size is written with more digits: float32 has seven.
FAR = 100


class NoFaceError(GeometryError):
    """No triangle is left of a surface."""


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """A surface in world space."""

    vertices: F64
    """(V, 3) float64. Positions in world space, in the camera's unit."""
    triangles: I32
    """(T, 3) int32. Vertex indices, counter-clockwise seen from the camera."""
    normals: F32
    """(V, 3) float32. Unit normals in world space, for smooth shading."""
    uvs: F32
    """(V, 2) float32. Positions in the photo: (0, 0) is its lower left corner, (1, 1) its upper right one."""


@takes_files
def surface_mesh(
    heights: HeightMap,
    normals: NormalMap,
    *,
    faces: int = FACES,
    open_from: float | None = None,
    progress: Progress = silent,
) -> SurfaceMesh:
    """The surface as at most `faces` triangles, small where it bends and large where it is flat.

    Parameters
    ----------
    heights : HeightMap
        The surface. Each vertex is the point of a pixel.
    normals : NormalMap
        Normals in camera space, of the same size.
    faces : int
        Maximum number of triangles.
    open_from : float, optional
        Angle in degrees between line of sight and normal above which triangles are removed, which leaves depth
        discontinuities open.
    progress : Progress

    Returns
    -------
    SurfaceMesh

    Raises
    ------
    SettingsError
        If an option is out of range.
    GeometryError
        If the sizes differ, or no triangle remains (NoFaceError).

    Examples
    --------
    >>> from mpsnet_core.scene.camera import pixel_camera
    >>> mask = np.ones((5, 5), bool)
    >>> flat = HeightMap(np.zeros((5, 5)), mask, pixel_camera(5, 5))
    >>> surface_mesh(flat, NormalMap(np.broadcast_to([0, 0, 1], (5, 5, 3)), mask)).triangles.shape
    (2, 3)
    """
    check_size("height map", heights.mask.shape, normals)
    check_surface_mesh(faces, open_from)
    check_has_faces(heights.mask)
    camera = heights.camera
    corners = adaptive_triangles(parallel_heights(heights), heights.mask, pixel_size(heights), faces, progress)
    pixels, triangles = _numbered(corners)
    rows, columns = np.divmod(pixels, camera.width)
    points, rays = _points(heights, rows, columns)
    if open_from is not None:
        triangles = triangles[_angles(points[triangles], rays[triangles[:, 0]]) < open_from]
    if not len(triangles):
        raise NoFaceError("no face is left of the surface; allow more faces, or leave fewer steps open")
    used, triangles = _numbered(triangles)
    rows, columns = rows[used], columns[used]
    vectors = (normals.vectors[rows, columns] @ camera.rotation.T).astype(np.float32)
    return SurfaceMesh(points[used], triangles, vectors, _uvs(camera, rows, columns))


def _numbered(triangles: I32) -> tuple[I32, I32]:
    """(V,) the distinct indices in triangles (T, 3), and the triangles as indices into these."""
    used, places = np.unique(triangles, return_inverse=True)
    return used, places.reshape(-1, 3).astype(np.int32)


def _points(heights: HeightMap, rows: I32, columns: I32) -> tuple[F64, F64]:
    """(V, 3) the pixels' points in world space, and (V, 3) unit directions of their rays."""
    origins, rays = heights.camera.rays(np.stack([columns, rows], axis=-1) + 0.5)
    along = rays @ -heights.camera.rotation[:, 2]
    return origins - rays * (heights.values[rows, columns] / along)[:, None], rays


def _uvs(camera: Camera, rows: I32, columns: I32) -> F32:
    centres = np.stack([columns, camera.height - 1 - rows], axis=-1) + 0.5
    return (centres / [camera.width, camera.height]).astype(np.float32)


def _angles(corners: F64, rays: F64) -> F64:
    """(T,) degrees between the normals of triangles (T, 3, 3) and the lines of sight, unit rays (T, 3)."""
    normals = triangle_normals(corners)
    lengths = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    return np.degrees(np.arccos(np.clip(-dot(normals, rays) / lengths, -1, 1)))


def check_surface_mesh(faces: int, open_from: float | None) -> None:
    """Raise SettingsError if an option of :func:`surface_mesh` is out of range."""
    if not 1 <= faces <= MAX_FACES:
        raise SettingsError(f"a mesh of {faces} faces cannot be made; choose 1 to {MAX_FACES}")
    if open_from is not None and not 0 < open_from <= 90:
        raise SettingsError(f"steps are left open from an angle between 0 and 90 degrees on, not {open_from:g}")


def check_has_faces(mask: Bools) -> None:
    """Raise GeometryError if no triangle of neighbouring pixels is within the mask, (H, W)."""
    ones = mask.astype(np.int8)
    if not (ones[:-1, :-1] + ones[:-1, 1:] + ones[1:, :-1] + ones[1:, 1:] >= 3).any():
        raise GeometryError("the surface is nowhere two pixels wide and high, so it has no face; leave the mesh out")


def writable_mesh(path: AnyPath) -> Path:
    """`path` as a Path. Raises FileError if no mesh can be written there."""
    path = writable_path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        kind = path.suffix or "no suffix"
        raise FileError(f"cannot write {path}: {kind} is not a supported mesh format; use {', '.join(MESH_SUFFIXES)}")
    return path


@takes_files
def write_surface_mesh(path: AnyPath, mesh: SurfaceMesh, *, up: Up = "z") -> None:
    """Write a mesh with normals and UVs atomically as PLY, GLB or OBJ.

    Parameters
    ----------
    path : str or PathLike
        The file, whose name is the object's name, too.
    mesh : SurfaceMesh
        The surface.
    up : {"z", "y"}
        Axis that points up in the world. GLB and OBJ are y up by convention: for "z", as in Blender, (x, y, z) is
        written as (x, z, -y), which Blender's importers revert. PLY keeps the axes.

    Raises
    ------
    FileError
        If the suffix is unknown, or the file cannot be written.
    SettingsError
        If `up` is another axis.
    """
    path = writable_mesh(path)
    if up not in ("y", "z"):
        raise SettingsError(f'the axis that points up is "y" or "z", not {up!r}')
    vertices, normals = mesh.vertices, mesh.normals
    if up == "z" and path.suffix.lower() != ".ply":
        vertices, normals = (values[:, [0, 2, 1]] * np.array([1, 1, -1]) for values in (vertices, normals))
    write = {".obj": _write_obj, ".ply": _write_ply, ".glb": _write_glb}[path.suffix.lower()]
    with atomic_write(path) as unfinished:
        write(unfinished, path.stem, vertices, normals, mesh)


def _is_far(vertices: Floats) -> bool:
    """Whether float32 is too coarse for the positions, as with survey coordinates."""
    return bool(np.abs(vertices).max() > FAR * np.ptp(vertices, axis=0).max())


def _write_obj(path: Path, name: str, vertices: Floats, normals: Floats, mesh: SurfaceMesh) -> None:
    """Write OBJ without trimesh, whose 8 decimals are too few for small units, and which names a missing material."""
    corners = np.repeat(mesh.triangles + 1, 3, axis=1)
    position = " ".join(["%.15g" if _is_far(vertices) else "%.9g"] * 3)
    blocks = ((f"v {position}", vertices), ("vt %.7g %.7g", mesh.uvs), ("vn %.5g %.5g %.5g", normals))
    with path.open("w", encoding="ascii") as file:
        for form, values in (*blocks, ("f" + " %d/%d/%d" * 3, corners)):
            np.savetxt(file, values, form)


def _write_ply(path: Path, name: str, vertices: Floats, normals: Floats, mesh: SurfaceMesh) -> None:
    """Write PLY without trimesh, which writes positions as float32."""
    kind, size = ("double", "<f8") if _is_far(vertices) else ("float", "<f4")
    others = [(part, "float", "<f4") for part in ("nx", "ny", "nz", "s", "t")]
    columns = [*((axis, kind, size) for axis in "xyz"), *others]
    points = np.empty(len(vertices), [(column, size) for column, _, size in columns])
    for (column, *_), values in zip(columns, np.concatenate([vertices, normals, mesh.uvs], axis=1).T, strict=True):
        points[column] = values
    faces = np.empty(len(mesh.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.triangles
    lines = [
        *("ply", "format binary_little_endian 1.0", f"element vertex {len(points)}"),
        *(f"property {kind} {column}" for column, kind, _ in columns),
        *(f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""),
    ]
    path.write_bytes("\n".join(lines).encode() + points.tobytes() + faces.tobytes())


def _write_glb(path: Path, name: str, vertices: Floats, normals: Floats, mesh: SurfaceMesh) -> None:
    """Write GLB. name: of the object in the file. If it is far from the origin, its node is placed there."""
    import trimesh as untyped  # slow to import

    trimesh: Any = untyped
    place = np.eye(4)
    if _is_far(vertices):
        place[:3, 3] = np.round((vertices.min(axis=0) + vertices.max(axis=0)) / 2)
    material = trimesh.visual.material.PBRMaterial(name="Surface", metallicFactor=0.0, roughnessFactor=0.8)
    made = trimesh.Trimesh(
        vertices - place[:3, 3],
        mesh.triangles,
        vertex_normals=normals,
        visual=trimesh.visual.TextureVisuals(uv=mesh.uvs, material=material),
        process=False,
    )
    scene = trimesh.Scene()
    scene.add_geometry(made, node_name=name, geom_name=name, transform=place)
    path.write_bytes(trimesh.exchange.gltf.export_glb(scene, include_normals=True))
