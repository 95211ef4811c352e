"""A height map as a mesh, with the photo's own UVs, and its files."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.defaults import FACES, MAX_FACES
from mpsnet_core.errors import FileError, GeometryError, SettingsError
from mpsnet_core.io.files import writable_path, written_whole
from mpsnet_core.progress import Progress, silent
from mpsnet_core.relief.adaptive_triangles import adaptive_triangles
from mpsnet_core.relief.height_map import HeightMap
from mpsnet_core.relief.parallel_projection import parallel_heights, pixel_size
from mpsnet_core.relief.sizes import check_size
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import triangle_normals
from mpsnet_core.scene.normal_map import NormalMap

Floats = NDArray[np.floating[Any]]
Up = Literal["y", "z"]
MESH_SUFFIXES = (".ply", ".glb", ".obj")
# How many times a mesh's size from the origin it is written in more digits: floats of 32 bits have seven.
FAR = 100


class NoFaceError(GeometryError):
    """No triangle is left of a surface."""


@dataclass(frozen=True, eq=False)
class SurfaceMesh:
    """A surface in the camera's world.

    Attributes
    ----------
    vertices : (V, 3) float64 array
        Positions in the world, in the camera's unit.
    triangles : (T, 3) int32 array
        Vertex numbers, counter-clockwise seen from the camera.
    normals : (V, 3) float32 array
        Unit normals in the world, for smooth shading.
    uvs : (V, 2) float32 array
        Positions in the photo: (0, 0) is its lower left corner, (1, 1) its upper right one.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    normals: NDArray[np.float32]
    uvs: NDArray[np.float32]


def surface_mesh(
    heights: HeightMap,
    normals: NormalMap,
    *,
    faces: int = FACES,
    open_from: float | None = None,
    progress: Progress = silent,
) -> SurfaceMesh:
    """The surface as at most `faces` triangles, small ones where it bends and large ones where it does not.

    Parameters
    ----------
    heights : HeightMap
        The surface; each vertex is the point of a pixel.
    normals : NormalMap
        In camera space, of the same size.
    faces : int
        Most triangles.
    open_from : float, optional
        Degrees between line of sight and normal from which on triangles are removed: depth discontinuities stay open.
    progress : Progress

    Returns
    -------
    SurfaceMesh

    Raises
    ------
    SettingsError
        Where an option is out of range.
    GeometryError
        Where the sizes differ, or no triangle is left (NoFaceError).

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
    return SurfaceMesh(
        points[used],
        triangles,
        (normals.vectors[rows[used], columns[used]] @ camera.rotation.T).astype(np.float32),
        _uvs(camera, rows[used], columns[used]),
    )


def _numbered(triangles: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """(V,) the numbers that triangles (T, 3) use, and the triangles by their places among these."""
    used, places = np.unique(triangles, return_inverse=True)
    return used, places.reshape(-1, 3).astype(np.int32)


def _points(
    heights: HeightMap, rows: NDArray[np.int32], columns: NDArray[np.int32]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(V, 3) the pixels' points in the world, and (V, 3) their unit rays."""
    origins, rays = heights.camera.rays(np.stack([columns, rows], axis=-1) + 0.5)
    along = rays @ -heights.camera.rotation[:, 2]
    return origins - rays * (heights.values[rows, columns] / along)[:, None], rays


def _uvs(camera: Camera, rows: NDArray[np.int32], columns: NDArray[np.int32]) -> NDArray[np.float32]:
    centres = np.stack([columns, camera.height - 1 - rows], axis=-1) + 0.5
    uvs: NDArray[np.float32] = (centres / [camera.width, camera.height]).astype(np.float32)
    return uvs


def _angles(corners: NDArray[np.float64], rays: NDArray[np.float64]) -> NDArray[np.float64]:
    """(T,) degrees between the normals of triangles (T, 3, 3) and the lines of sight, of unit rays (T, 3)."""
    normals = triangle_normals(corners)
    lengths = np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    angles: NDArray[np.float64] = np.degrees(np.arccos(np.clip(-dot(normals, rays) / lengths, -1, 1)))
    return angles


def check_surface_mesh(faces: int, open_from: float | None) -> None:
    """Raises SettingsError where :func:`surface_mesh` would make none with these options."""
    if not 1 <= faces <= MAX_FACES:
        raise SettingsError(f"a mesh of {faces} faces cannot be made; choose 1 to {MAX_FACES}")
    if open_from is not None and not 0 < open_from <= 90:
        raise SettingsError(f"steps are left open from an angle between 0 and 90 degrees on, not {open_from:g}")


def check_has_faces(mask: NDArray[np.bool_]) -> None:
    """Raises GeometryError where no triangle of neighbouring pixels is within the mask, (H, W)."""
    ones = mask.astype(np.int8)
    if not (ones[:-1, :-1] + ones[:-1, 1:] + ones[1:, :-1] + ones[1:, 1:] >= 3).any():
        raise GeometryError("the surface is nowhere two pixels wide and high, so it has no face; leave the mesh out")


def writable_mesh(path: str | os.PathLike[str]) -> Path:
    """`path` as a Path, or FileError where no mesh can be written there."""
    path = writable_path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        kind = path.suffix or "no suffix"
        raise FileError(f"cannot write {path}: {kind} is not a supported mesh format; use {', '.join(MESH_SUFFIXES)}")
    return path


def write_surface_mesh(path: str | os.PathLike[str], mesh: SurfaceMesh, *, up: Up = "z") -> None:
    """Write a mesh with normals and UVs as PLY, GLB or OBJ, whole or not at all.

    Parameters
    ----------
    path : str or PathLike
        The file; the object is called as it is.
    mesh : SurfaceMesh
        The surface.
    up : {"z", "y"}
        Axis that points up in the world. GLB and OBJ are y up by convention: for "z", as in Blender, (x, y, z) is
        written as (x, z, -y), which Blender's importers revert. PLY keeps the axes.

    Raises
    ------
    FileError
        Where the suffix is another, or the file cannot be written.
    SettingsError
        Where `up` is another axis.
    """
    path = writable_mesh(path)
    if up not in ("y", "z"):
        raise SettingsError(f'the axis that points up is "y" or "z", not {up!r}')
    vertices, normals = mesh.vertices, mesh.normals
    if up == "z" and path.suffix.lower() != ".ply":
        vertices, normals = (values[:, [0, 2, 1]] * np.array([1, 1, -1]) for values in (vertices, normals))
    write = {".obj": _write_obj, ".ply": _write_ply, ".glb": _write_glb}[path.suffix.lower()]
    with written_whole(path) as unfinished:
        write(unfinished, path.stem, vertices, normals, mesh)


def _is_far(vertices: Floats) -> bool:
    """Whether floats of 32 bits are too coarse for positions, as in the coordinates of a survey."""
    return bool(np.abs(vertices).max() > FAR * np.ptp(vertices, axis=0).max())


def _write_obj(path: Path, name: str, vertices: Floats, normals: Floats, mesh: SurfaceMesh) -> None:
    """By hand: trimesh writes 8 decimals, too few for small units, and names a material file that is not there."""
    corners = np.repeat(mesh.triangles + 1, 3, axis=1)
    position = " ".join(["%.15g" if _is_far(vertices) else "%.9g"] * 3)
    blocks = (
        (f"v {position}", vertices),
        ("vt %.7g %.7g", mesh.uvs),
        ("vn %.5g %.5g %.5g", normals),
    )
    with path.open("w", encoding="ascii") as file:
        for form, values in (*blocks, ("f" + " %d/%d/%d" * 3, corners)):
            np.savetxt(file, values, form)


def _write_ply(path: Path, name: str, vertices: Floats, normals: Floats, mesh: SurfaceMesh) -> None:
    """By hand: trimesh writes positions as floats of 32 bits."""
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
    """name: what the object in the file is called. Where it is far from the origin, its node is placed there."""
    import trimesh as untyped  # takes a while to load

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
