"""Meshes from files: read and repaired (merged, oriented, closed), with normals."""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.mask_regions import connected
from mpsnet_core.arrays.types import F32, F64, I32, I64
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.errors import FileError, FormatError, GeometryError
from mpsnet_core.io.files import existing_file
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.mesh import read_mesh, triangle_normals
from mpsnet_core.synthesis.shapes.shape import Shape, fitted

FORMATS = (".glb", ".gltf", ".obj", ".off", ".ply", ".stl")
MAX_BYTES = 256 << 20
MAX_FACES = 2_000_000
# Edges below this angle in degrees are shaded smooth, as in Blender's Shade Smooth by Angle.
CREASE = 40.0
# For a mesh of size 1: decimal places by which vertices are merged, and the area of degenerate faces.
_DIGITS, _NO_AREA = 6, 5e-15


def mesh_files(folder: AnyPath) -> list[str]:
    """List the mesh files in a folder.

    Parameters
    ----------
    folder
        A folder. Files with suffixes other than FORMATS are ignored.

    Returns
    -------
    list of str
        File names, sorted.

    Raises
    ------
    FileError
        If there is no such folder, or no mesh in it.
    """
    path = Path(folder)
    if not path.is_dir():
        raise FileError(f"the folder of meshes {path} does not exist; check the path")
    try:
        files = [one for one in path.iterdir() if one.suffix.lower() in FORMATS and one.is_file()]
        names = sorted(file.name for file in files if not file.name.startswith("."))
    except OSError as error:
        raise FileError(f"the folder of meshes {path} cannot be read ({error.strerror}); check it") from None
    if not names:
        raise FileError(f"the folder {path} holds no meshes; put {', '.join(FORMATS)} files into it")
    return names


@lru_cache(maxsize=32)
def load_mesh(path: str) -> Shape:
    """A mesh file as a shape of one part with z up. The file's up axis is y, the convention of these formats.

    Meshes are repaired: coincident vertices are merged, degenerate and duplicate faces removed, faces oriented
    consistently and outwards, holes filled. Normals are smooth up to a crease angle.

    Raises FileError if the file is missing, FormatError if it is too large or damaged, GeometryError if it has no
    faces.
    """
    file = existing_file(path, "mesh file")
    if file.suffix.lower() not in FORMATS:
        raise FormatError(f"mesh file {file} is not in a supported format; use {', '.join(FORMATS)}")
    if file.stat().st_size > MAX_BYTES:
        raise FormatError(f"mesh file {file} is larger than {MAX_BYTES >> 20} MiB; reduce the mesh first")
    mesh = read_mesh(file, shape_only=True)
    vertices, faces = mesh.world_vertices, mesh.triangles.astype(np.int64)
    if len(faces) > MAX_FACES:
        raise FormatError(f"mesh file {file} has {len(faces)} faces, more than {MAX_FACES}; reduce the mesh first")
    if not np.isfinite(vertices).all():
        raise FormatError(f"mesh file {file} holds a coordinate that is not finite; export it again")
    vertices, faces = merge_vertices(vertices, faces)
    if not len(faces):
        raise GeometryError(f"mesh file {file} has no faces with an area; choose a mesh with a surface")
    vertices, faces = fill_mesh_holes(*thicken_if_flat(vertices, orient_consistently(vertices, faces)))
    faces = orient_outward(vertices, faces)
    vertices = vertices @ np.array([(1.0, 0, 0), (0, 0, 1), (0, -1, 0)])
    triangles = faces.astype(np.int32)
    shape = fitted(Shape(vertices, triangles, creased_normals(vertices, triangles), np.zeros(len(triangles), np.int32)))
    for array in (shape.vertices, shape.triangles, shape.corner_normals, shape.parts):
        array.flags.writeable = False  # the shape is cached
    return shape


def merge_vertices(vertices: F64, faces: I64) -> tuple[F64, I64]:
    """Merge coincident vertices, and remove degenerate and duplicate faces."""
    import trimesh  # slow to import

    used = vertices[np.unique(faces)]
    size = float((used.max(axis=0) - used.min(axis=0)).max()) or 1.0
    mesh = trimesh.Trimesh((vertices - used.min(axis=0)) / size, faces, process=False)
    mesh.merge_vertices(digits_vertex=_DIGITS)
    mesh.update_faces(mesh.unique_faces() & (mesh.area_faces > _NO_AREA))
    mesh.remove_unreferenced_vertices()
    return np.array(mesh.vertices) * size, np.array(mesh.faces)


def orient_consistently(vertices: F64, faces: I64) -> I64:
    """Flip faces so that neighbours are oriented consistently."""
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(faces)), 3)
    key = np.sort(edges, axis=1) @ np.array([len(vertices), 1])
    order = np.argsort(key, kind="stable")
    new = np.flatnonzero(np.diff(key[order], prepend=-1))
    shared = new[np.diff(new, append=len(order)) == 2]  # edges with three or more faces are ambiguous
    one, two = order[shared], order[shared + 1]
    agree = edges[one, 0] != edges[two, 0]
    # Two nodes for each face, as it is and flipped, linked to those of its neighbours that agree with them.
    a, b, flipped = owner[one], owner[two], len(faces)
    same, other = np.where(agree, b, b + flipped), np.where(agree, b + flipped, b)
    patch = connected(2 * flipped, np.concatenate([a, a + flipped]), np.concatenate([same, other]))
    return np.where((patch[:flipped] > patch[flipped:])[:, None], faces[:, ::-1], faces)


def thicken_if_flat(vertices: F64, faces: I64) -> tuple[F64, I64]:
    """Thicken a flat mesh to a plate of 1/40 of its width; return any other mesh unchanged."""
    centred = vertices - vertices.mean(axis=0)
    _, extents, axes = np.linalg.svd(centred.T @ centred)
    if extents[2] > 1e-6 * extents[0]:
        return vertices, faces
    size = float((vertices.max(axis=0) - vertices.min(axis=0)).max())
    other = len(vertices)
    rim = _open_edges(vertices, faces)
    low = np.column_stack([rim[:, ::-1], rim[:, 0] + other])
    high = np.column_stack([rim[:, 0] + other, rim[:, 1] + other, rim[:, 1]])
    both = np.concatenate([vertices, vertices + size / 40 * axes[2]])
    return both, np.concatenate([faces, faces[:, ::-1] + other, low, high])


def fill_mesh_holes(vertices: F64, faces: I64) -> tuple[F64, I64]:
    """Fill every hole with a triangle fan around its centre."""
    onward: dict[int, list[int]] = {}
    for start, end in _open_edges(vertices, faces).tolist():
        onward.setdefault(end, []).append(start)
    points, fans = [vertices], [faces]
    count = len(vertices)
    for loop in _loops(onward):
        ring = np.array(loop)
        if len(ring) == 3:
            fans.append(ring[None])
        elif len(ring) > 3:
            points.append(vertices[ring].mean(axis=0, keepdims=True))
            fans.append(np.stack([ring, np.roll(ring, -1), np.full(len(ring), count)], axis=1))
            count += 1
    return np.concatenate(points), np.concatenate(fans)


def _loops(onward: dict[int, list[int]]) -> Iterator[list[int]]:
    """Simple loops of a directed graph. onward: successors of each vertex; consumed."""
    for start in list(onward):
        path, places = [start], {start: 0}
        while onward[path[-1]]:
            after = onward[path[-1]].pop()
            if after in places:
                loop = path[places[after] :]
                yield loop
                del path[places[after] :]
                for vertex in loop:
                    del places[vertex]
            places[after] = len(path)
            path.append(after)


def _open_edges(vertices: F64, faces: I64) -> I64:
    """(N, 2) boundary edges, which occur more often in one direction than in the other; they form loops."""
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    keys, index = np.unique(np.sort(edges, axis=1) @ np.array([len(vertices), 1]), return_inverse=True)
    net = np.bincount(index.reshape(-1), np.where(edges[:, 0] < edges[:, 1], 1, -1), len(keys)).astype(np.int64)
    low, high = keys // len(vertices), keys % len(vertices)
    forth = np.where((net > 0)[:, None], np.stack([low, high], axis=1), np.stack([high, low], axis=1))
    return np.repeat(forth, np.abs(net), axis=0)


def orient_outward(vertices: F64, faces: I64) -> I64:
    """Flip connected patches of faces with negative volume."""
    patch = connected(len(vertices), faces[:, :2].ravel(), faces[:, 1:].ravel())[faces[:, 0]]
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.bincount(patch, dot(a, np.cross(b, c)), len(vertices))
    return np.where((volume < 0)[patch][:, None], faces[:, ::-1], faces)


def creased_normals(vertices: F64, triangles: I32) -> F32:
    """(T, 3, 3) corner normals, from the faces at the vertex within the crease angle of the corner's own face."""
    area = triangle_normals(vertices[triangles])
    flat = normalised(area)
    order = np.argsort(triangles.ravel(), kind="stable")
    vertex = triangles.ravel()[order]
    start = np.searchsorted(vertex, vertex, side="left")
    count = np.searchsorted(vertex, vertex, side="right") - start
    owner = order // 3
    total = np.zeros((len(owner), 3))
    least = np.cos(np.radians(CREASE))
    corner = np.arange(len(owner))
    for step in range(int(count.max())):
        corner = corner[count[corner] > step]
        face, other = owner[corner], owner[start[corner] + step]
        smooth = dot(flat[face], flat[other]) >= least
        total[corner[smooth]] += area[other[smooth]]
    normals = np.empty((len(triangles) * 3, 3), np.float32)
    normals[order] = normalised(total)
    return normals.reshape(-1, 3, 3)
