"""Meshes of triangles with UVs, shading normals and tangents at every corner; mesh files."""

import logging
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import compress, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.polygon_triangulation import triangulated
from mpsnet_core.arrays.unit_vectors import SHORTEST, dot, normalised
from mpsnet_core.errors import FormatError, GeometryError
from mpsnet_core.io.files import existing_file, prefix_errors
from mpsnet_core.io.mesh_import import read_scene
from mpsnet_core.io.npz import read_arrays
from mpsnet_core.io.ply import NO_LENGTHS, NOTHING, read_ply
from mpsnet_core.scene.mesh_labels import Labels, labels_of_runs
from mpsnet_core.scene.mikktspace import mikktspace_tangents

log = logging.getLogger(__name__)

MESH_FORMAT = "mpsnet-mesh"
MESH_VERSION = 1
MAX_MESH_BYTES = 4 << 30
# Largest coordinate, in any unit: products of three such lengths stay finite.
MAX_VALUE = 1e12
# Faces made by people have fewer corners; ear clipping takes quadratic time.
MAX_CORNERS = 4096
# Relative tolerance within which the scales of a pose count as equal.
SAME_SCALE = 1e-4
# The names of UVs in PLY files by MeshLab, others and Blender. The last pair that exists applies.
PLY_UVS = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh. All its data is in object space, except `world_from_object`.

    Parameters
    ----------
    vertices : (V, 3) float64 array
        Unused vertices are dropped: a stray one far away would falsify the mesh's size.
    triangles : (T, 3) int32 array
        Vertex indices, counter-clockwise seen from outside.
    corner_normals : (T, 3, 3) float32 array
        Unit shading normals.
    uvs : (T, 3, 2) float32 array
        With v up. A texture covers one unit square.
    given_tangents : (T, 3, 4) float32 array, optional
        The value of :attr:`tangents`; by default it is computed by MikkTSpace.
    world_from_object : (4, 4) float64 array, optional
        Affine transform, scaling included; the identity by default.
    materials, objects : Labels, optional
        Each triangle's material and object.
    polygons : (T,) int32 array, optional
        The polygon of each triangle, for the tangents of quads: see :func:`.mikktspace.mikktspace_tangents`.

    Raises
    ------
    GeometryError
        If shapes do not agree, a value is not finite, or the object's scale is zero.

    Examples
    --------
    >>> vertices = np.array([[0, 0, 0], [2, 0, 0], [0, 2, 0.0]])
    >>> normals, uvs = np.tile([0, 0, 1], (1, 3, 1)), np.array([[[0, 0], [1, 0], [0, 1]]])
    >>> Mesh(vertices, np.array([[0, 1, 2]]), normals, uvs).tangents[0, 0].tolist()
    [1.0, 0.0, 0.0, 1.0]
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    corner_normals: NDArray[np.float32]
    uvs: NDArray[np.float32]
    given_tangents: NDArray[np.float32] | None = None
    world_from_object: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))
    materials: Labels | None = None
    objects: Labels | None = None
    polygons: NDArray[np.int32] | None = None

    def __post_init__(self) -> None:
        count, points = len(np.atleast_1d(self.triangles)), len(np.atleast_1d(self.vertices))
        if count == 0 or points == 0:
            raise GeometryError("the mesh has no faces; choose an object with a surface")
        shapes: dict[str, tuple[int, ...]] = {
            "vertices": (points, 3),
            "triangles": (count, 3),
            "corner_normals": (count, 3, 3),
            "uvs": (count, 3, 2),
            "world_from_object": (4, 4),
        }
        if self.given_tangents is not None:
            shapes["given_tangents"] = (count, 3, 4)
        if self.polygons is not None:
            shapes["polygons"] = (count,)
        kinds = {"triangles": np.int32, "polygons": np.int32, "vertices": np.float64, "world_from_object": np.float64}
        for name, shape in shapes.items():
            try:
                value = np.asarray(getattr(self, name), dtype=kinds.get(name, np.float32))
            except (TypeError, ValueError, OverflowError):
                raise GeometryError(f"the mesh's {name} are not numbers; export it again") from None
            if value.shape != shape:
                raise GeometryError(f"the mesh's {name} have shape {value.shape}, expected {shape}; export it again")
            _check_finite(name, value)
            object.__setattr__(self, name, value)
        _check_numbers(self.triangles, points)
        used = np.zeros(points, bool)
        used[self.triangles] = True
        if not used.all():
            number = np.cumsum(used, dtype=np.int32) - 1
            object.__setattr__(self, "vertices", self.vertices[used])
            object.__setattr__(self, "triangles", number[self.triangles].astype(np.int32))
        _check_pose(self.world_from_object)
        for what, labels in (("materials", self.materials), ("objects", self.objects)):
            if labels is not None and len(labels) != count:
                raise GeometryError(f"the mesh has {count} triangles, but {what} for {len(labels)}; export it again")

    @cached_property
    def tangents(self) -> NDArray[np.float32]:
        """(T, 3, 4) unit tangent T of every corner, then the sign s of its bitangent B = s N x T."""
        if self.given_tangents is not None:
            return self.given_tangents
        return mikktspace_tangents(self.vertices[self.triangles], self.corner_normals, self.uvs, self.polygons)

    @cached_property
    def world_vertices(self) -> NDArray[np.float64]:
        """(V, 3) vertices in world space."""
        placed: NDArray[np.float64] = self.vertices @ self.world_from_object[:3, :3].T + self.world_from_object[:3, 3]
        return placed

    @cached_property
    def world_areas(self) -> NDArray[np.float64]:
        """(T,) areas of the triangles in world space."""
        areas: NDArray[np.float64] = np.linalg.norm(triangle_normals(self.world_vertices[self.triangles]), axis=1) / 2
        return areas

    @cached_property
    def normals_to_world(self) -> NDArray[np.float64]:
        """(3, 3) matrix to multiply row normals in object space by for world space. It does not keep unit length.

        Normals transform by the inverse transpose; for row vectors, that is the inverse.
        """
        return np.linalg.inv(self.world_from_object[:3, :3])

    @property
    def is_mirrored(self) -> bool:
        """Whether triangles are clockwise in world space, seen from outside."""
        return bool(np.linalg.det(self.world_from_object[:3, :3]) < 0)


def _check_finite(name: str, values: NDArray[Any]) -> None:
    if not np.isfinite(values).all():
        raise GeometryError(f"the mesh's {name} hold a value that is not finite; repair the mesh")
    if name != "uvs" and (np.abs(values) > MAX_VALUE).any():
        raise GeometryError(f"the mesh's {name} hold a value beyond {MAX_VALUE:g}; repair the mesh")


def _scales(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) scale factors (singular values) of a pose, largest first."""
    scales: NDArray[np.float64] = np.linalg.svd(pose[:3, :3], compute_uv=False)
    return scales


def _check_pose(world_from_object: NDArray[np.float64]) -> None:
    scales = _scales(world_from_object)
    if scales[-1] <= 1e-9 * scales[0]:
        raise GeometryError("the object is scaled to nothing in one direction; give it a scale above 0")


def _check_numbers(triangles: NDArray[Any], count: int) -> None:
    if triangles.size and not 0 <= triangles.min() <= triangles.max() < count:
        raise GeometryError("the mesh's triangles name vertices that it does not have; export it again")


def read_mesh(path: str | os.PathLike[str], *, shape_only: bool = False) -> Mesh:
    """Read a mesh with UVs: OBJ, PLY, GLB, or the ``.npz`` that the add-on writes.

    Polygons are triangulated. All objects and materials of the file become one mesh, labelled with their names. Shading
    normals are those of the file or, if it has none, smooth, even across UV seams. The axes are the file's: cameras
    must be in the same world space.

    Parameters
    ----------
    path : path-like
    shape_only : bool, optional
        Ignore UVs, which are then not required.

    Raises
    ------
    FileError
        If the file is missing.
    FormatError
        If it is damaged, or not in one of these formats.
    GeometryError
        If the mesh has no faces or no UVs, or is no valid :class:`Mesh`.
    """
    path = existing_file(path, "mesh file")
    if path.stat().st_size > MAX_MESH_BYTES:
        raise FormatError(f"mesh file {path} is larger than 4 GiB; reduce the mesh first")
    readers = {".npz": _read_npz, ".obj": _read_obj, ".ply": _read_ply, ".glb": _read_glb}
    with prefix_errors(f"mesh file {path}"):
        reader = readers.get(path.suffix.lower())
        if reader is None:
            raise FormatError(f"{path.suffix or 'no suffix'} is not a supported mesh format; use OBJ, PLY, GLB or npz")
        mesh = reader(path, shape_only)
    if not shape_only and _is_inside_out(mesh):
        log.warning(
            "mesh file %s: most of its faces point the opposite way from its normals, as in a PLY of a "
            "mirrored object, which would bake an inverted green channel; apply the object's scale or flip the "
            "faces, and export it again",
            path,
        )
    return mesh


def _is_inside_out(mesh: Mesh) -> bool:
    outwards = np.einsum("ti,tci->t", triangle_normals(mesh.vertices[mesh.triangles]), mesh.corner_normals)
    return np.count_nonzero(outwards < 0) > len(outwards) / 2


# The .npz arrays of labels: the names, and each triangle's index into them.
_LABEL_KEYS = {"materials": "triangle_material", "objects": "triangle_object"}


def _labels_of_arrays(arrays: dict[str, NDArray[Any]]) -> dict[str, Labels]:
    found = {}
    for names, numbers in _LABEL_KEYS.items():
        if (names in arrays) != (numbers in arrays):
            raise FormatError(f'it has only one of "{names}" and "{numbers}"; export it again')
        if names in arrays:
            if arrays[names].dtype.kind != "U" or arrays[names].ndim != 1:
                raise FormatError(f'its "{names}" are not names; export it again')
            found[names] = Labels(tuple(arrays[names].tolist()), arrays[numbers])
    return found


def _read_npz(path: Path, shape_only: bool) -> Mesh:
    arrays = read_arrays(path, MAX_MESH_BYTES)
    if str(arrays.get("format")) != MESH_FORMAT:
        raise FormatError(f"it is not a {MESH_FORMAT} file; export it with the add-on")
    if not np.array_equal(arrays.get("version", 0), MESH_VERSION):
        raise FormatError(
            f"it is version {arrays.get('version')}, this program reads version {MESH_VERSION}; update it"
        )
    missing = [name for name in ("vertices", "triangles", "corner_normals", "uvs") if name not in arrays]
    if missing:
        raise FormatError(f'it lacks "{missing[0]}"; export it again')
    return Mesh(
        arrays["vertices"],
        arrays["triangles"],
        arrays["corner_normals"],
        _no_uvs(len(np.atleast_1d(arrays["triangles"]))) if shape_only else arrays["uvs"],
        arrays.get("tangents"),
        arrays.get("world_from_object", np.eye(4)),
        **_labels_of_arrays(arrays),
        polygons=arrays.get("triangle_polygon"),
    )


def _read_obj(path: Path, shape_only: bool) -> Mesh:
    """Read OBJ without trimesh, which splits vertices at seams and loses UVs of files with quads or many materials."""
    values: dict[str, list[list[float]]] = {"v": [], "vt": [], "vn": []}
    width = {"v": 3, "vt": 2, "vn": 3}
    corners: list[tuple[int, ...]] = []
    sizes: list[int] = []
    # By OBJ keyword, the names with the first face that each applies to.
    named: dict[str, list[tuple[int, str]]] = {"usemtl": [], "o": []}
    # A backslash continues a line, except a comment, which may end with a Windows path.
    joined = re.sub(r"^([^#\n]*)\\\n", r"\1 ", _text_of(path), flags=re.MULTILINE)
    for number, line in enumerate(joined.split("\n"), 1):
        key, *words = line.partition("#")[0].split() or [""]
        try:
            if key in values:
                row = [float(word) for word in words[: width[key]]]
                if len(row) < width[key]:
                    raise ValueError
                values[key].append(row)
            elif key == "f":
                if len(words) > MAX_CORNERS:
                    raise FormatError(
                        f"line {number} is a face of {len(words)} corners, more than {MAX_CORNERS}; triangulate it"
                    )
                counts = [len(values[kind]) for kind in ("v", "vt", "vn")]
                face = [_obj_corner(word, counts) for word in words]
                if len(face) > 2:
                    corners += face
                    sizes.append(len(face))
            elif key in named:  # names may contain a #, as those of 3ds Max do
                named[key].append((len(sizes), line.strip().removeprefix(key).strip()))
        except FormatError:
            raise
        except ValueError:
            raise FormatError(f"line {number} cannot be read ({line.strip()[:60]!r}); export it again") from None
    if not corners:
        raise GeometryError("it has no faces; choose a mesh with a surface")
    vertices = np.array(values["v"])
    _check_finite("vertices", vertices)
    of_corners, counts_of = np.array(corners), np.array(sizes)
    v, vt, vn = np.moveaxis(of_corners[triangulated(vertices[of_corners[:, 0]], counts_of)], 2, 0)
    if (vt < 0).any() and not shape_only:
        raise _without_uvs("its faces have" if (vt < 0).all() else "some of its faces have")
    normals = np.full((*v.shape, 3), np.nan)
    normals[vn >= 0] = np.array(values["vn"]).reshape(-1, 3)[vn[vn >= 0]]
    return Mesh(
        vertices,
        v,
        _else_smooth(normals, vertices, v),
        _no_uvs(len(v)) if shape_only else np.array(values["vt"])[vt],
        materials=_labels_from(named["usemtl"], counts_of - 2),
        objects=_labels_from(named["o"], counts_of - 2),
        polygons=np.repeat(np.arange(len(sizes)), counts_of - 2),
    )


def _text_of(path: Path) -> str:
    """The text of an OBJ file: UTF-8, with or without a byte order mark, or the encoding of older programs."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        return path.read_text(encoding="latin-1")


def _labels_from(starts: list[tuple[int, str]], triangles: NDArray[np.int64]) -> Labels | None:
    """Labels from the first face of each name and (F,) the faces' triangle counts; None if there are no names."""
    if not starts:
        return None
    runs = pairwise([(0, ""), *starts, (len(triangles), "")])
    return labels_of_runs((name, int(triangles[start:stop].sum())) for (start, name), (stop, _) in runs)


def _obj_corner(word: str, counts: list[int]) -> tuple[int, ...]:
    """Zero-based indices of vertex, UV and normal in "5/7/2", -1 if not given. Negative ones count from the end."""
    given = [int(part) if part else 0 for part in word.split("/")]
    numbers = [-1, -1, -1]
    for place, (number, count) in enumerate(zip(given, counts, strict=False)):
        if not -count <= number <= count:
            raise ValueError
        if number:
            numbers[place] = number - 1 if number > 0 else count + number
    if len(given) > 3 or numbers[0] < 0:
        raise ValueError
    return tuple(numbers)


def _read_ply(path: Path, shape_only: bool) -> Mesh:
    """Read PLY without trimesh, which cannot read binary files with faces of different sizes, and splits quads."""
    found = read_ply(path)
    vertex, face = (found.get(name, NOTHING) for name in ("vertex", "face"))
    vertices = vertex.columns("xyz")
    if vertices is None:
        raise FormatError("it has no vertices with x, y and z; export it again")
    name = "vertex_index" if "vertex_index" in face.lengths else "vertex_indices"
    sizes = face.lengths.get(name, NO_LENGTHS)
    if not (sizes > 2).any():
        raise GeometryError("it has no faces; choose a mesh with a surface")
    if sizes.max() > MAX_CORNERS:
        raise FormatError(f"it has a face of {sizes.max()} corners, more than {MAX_CORNERS}; triangulate it")
    _check_finite("vertices", vertices)
    is_face = np.repeat(sizes > 2, sizes)
    _check_numbers(face.numbers[name], len(vertices))
    corners: NDArray[Any] = face.numbers[name][is_face].astype(np.int64)
    uvs: NDArray[Any] | None = None
    if np.array_equal(face.lengths.get("texcoord", NO_LENGTHS), 2 * sizes):
        uvs = face.numbers["texcoord"].reshape(-1, 2)[is_face]
    for names in PLY_UVS if uvs is None else ():
        of_vertices = vertex.columns(names)
        uvs = of_vertices[corners] if of_vertices is not None else uvs
    if uvs is None and not shape_only:
        raise _without_uvs("it has")
    sizes = sizes[sizes > 2]
    order = triangulated(vertices[corners], sizes)
    triangles = corners[order]
    normals = vertex.columns(("nx", "ny", "nz"))
    given = np.full((*triangles.shape, 3), np.nan) if normals is None else normals[triangles]
    # Files with one UV per vertex split vertices at seams; merge them for smooth normals.
    places, place = np.unique(vertices, axis=0, return_inverse=True)
    return Mesh(
        vertices,
        triangles,
        _else_smooth(given, places, place.reshape(-1)[triangles]),
        _no_uvs(len(triangles)) if uvs is None or shape_only else uvs[order],
        polygons=np.repeat(np.arange(len(sizes)), sizes - 2),
    )


def _read_glb(path: Path, shape_only: bool) -> Mesh:
    with read_scene(path) as scene:
        nodes = list(scene.graph.nodes_geometry)
        placed = [scene.graph[node] for node in nodes]
        is_surface = [len(getattr(scene.geometry[name], "faces", ())) > 0 for _, name in placed]
        frame = _frame([pose for pose, _ in compress(placed, is_surface)])
        placed = [(np.linalg.inv(frame) @ pose, name) for pose, name in placed]
        if not (shape_only or all(_keeps_angles(pose) for pose, _ in compress(placed, is_surface))):
            log.warning(
                "mesh file %s: its objects are stretched in several ways, and textures in tangent space fit only some "
                "of them; apply their scale (in Blender: Object > Apply > Scale) and export it again",
                path,
            )
        parts = [_placed(scene.geometry[name], pose, shape_only) for pose, name in placed]
        objects = [
            _object_name(scene.graph, node, scene.geometry[name]) for node, (_, name) in zip(nodes, placed, strict=True)
        ]
        materials = [_material_name(scene.geometry[name]) for _, name in placed]
    counts = [len(part[1]) for part in parts]
    parts = [part for part in parts if len(part[1])]
    if not parts:
        raise GeometryError("it has no faces; choose a mesh with a surface")
    # Joined here and not by trimesh, which repacks the textures of several materials and moves their UVs.
    starts = np.cumsum([0] + [len(part[0]) for part in parts[:-1]])
    triangles = np.concatenate([part[1] + start for part, start in zip(parts, starts, strict=True)])
    vertices, normals, uvs = (np.concatenate([part[index] for part in parts]) for index in (0, 2, 3))
    _check_finite("vertices", vertices)
    # glTF splits vertices at UV seams; merge them for smooth normals.
    places, place = np.unique(vertices, axis=0, return_inverse=True)
    return Mesh(
        vertices,
        triangles,
        _else_smooth(normals[triangles], places, place.reshape(-1)[triangles]),
        _no_uvs(len(triangles)) if shape_only else uvs[triangles],
        world_from_object=frame,
        materials=labels_of_runs(zip(materials, counts, strict=True)) if any(materials) else None,
        objects=labels_of_runs(zip(objects, counts, strict=True)),
    )


def _frame(poses: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """(4, 4) transform to world space from the space that the parts of a GLB are read in.

    That is world space itself, or the own space of the first part that its node scales non-uniformly: tangent-space
    normals refer to the mesh before it is stretched.
    """
    for pose in poses:
        _check_pose(pose)
    return next((pose for pose in poses if not _keeps_angles(pose)), np.eye(4))


def _keeps_angles(pose: NDArray[np.float64]) -> bool:
    scales = _scales(pose)
    return bool(scales[-1] > (1 - SAME_SCALE) * scales[0])


def _object_name(graph: Any, node: str, part: Any) -> str:
    """The name of the file's node. trimesh splits a node by materials into child nodes named NAME_1a2b3c.

    A child node of the file may have such a name, too: door_handle of door.
    """
    parent = graph.transforms.parents.get(node)
    is_split = parent and part.metadata.get("from_gltf_primitive", True)
    return parent if is_split and re.fullmatch(re.escape(parent) + "_[0-9A-Za-z]{6}", node) else node


def _material_name(part: Any) -> str:
    return str(getattr(getattr(getattr(part, "visual", None), "material", None), "name", None) or "")


def _placed(part: Any, pose: NDArray[np.float64], shape_only: bool) -> tuple[NDArray[Any], ...]:
    """Vertices, triangles, normals (NaN if the file has none) and UVs of a trimesh mesh, transformed by `pose`."""
    faces = np.asarray(getattr(part, "faces", np.empty((0, 3))), np.int32)
    vertices = np.asarray(part.vertices, np.float64)
    _check_numbers(faces, len(vertices))
    uvs = getattr(part.visual, "uv", None) if len(faces) else np.empty((len(vertices), 2))
    if shape_only:
        uvs = np.zeros((len(vertices), 2))
    if uvs is None or len(uvs) != len(vertices):
        raise _without_uvs("it has")
    normals: NDArray[Any] = np.full_like(vertices, np.nan)
    # trimesh computes vertex normals on demand; they are in its cache already only if the file has them.
    if "vertex_normals" in part._cache:
        normals = np.asarray(part.vertex_normals) @ np.linalg.inv(pose[:3, :3])
    if np.linalg.det(pose[:3, :3]) < 0:
        faces = faces[:, ::-1]
    return vertices @ pose[:3, :3].T + pose[:3, 3], faces, normals, np.asarray(uvs)


def _no_uvs(count: int) -> NDArray[np.float32]:
    """(T, 3, 2) placeholder UVs: each triangle covers half of the texture."""
    return np.broadcast_to(np.array([[0, 0], [1, 0], [0, 1]], np.float32), (count, 3, 2))


def _without_uvs(who: str) -> GeometryError:
    return GeometryError(f"{who} no UVs; unwrap it in Blender (UV > Smart UV Project) and export it with UVs")


def _else_smooth(normals: NDArray[np.float64], vertices: NDArray[np.float64], triangles: NDArray[Any]) -> NDArray[Any]:
    """(T, 3, 3) unit normals, smooth ones where the file has none (NaN) or a zero one, as for faces without area."""
    given = np.linalg.norm(normals, axis=-1, keepdims=True) > SHORTEST
    unit: NDArray[Any] = normalised(np.where(given, normals, smooth_corner_normals(vertices, triangles)))
    return unit


def triangle_normals(corners: NDArray[Any]) -> NDArray[Any]:
    """(T, 3) normals of counter-clockwise triangles (T, 3, 3). Their length is twice the area."""
    normals: NDArray[Any] = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals


def smooth_corner_normals(vertices: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.float64]:
    """(T, 3, 3) smooth normals like Blender's: the mean of the face normals at a vertex, weighted by corner angles."""
    corners = vertices[triangles]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(ahead, behind), axis=-1)
    angles = np.arctan2(across, dot(ahead, behind))
    weighted = (normalised(triangle_normals(corners))[:, None] * angles[..., None]).reshape(-1, 3)
    summed = np.stack([np.bincount(triangles.ravel(), weighted[:, axis], len(vertices)) for axis in range(3)], axis=-1)
    normals: NDArray[np.float64] = normalised(summed)[triangles]
    return normals
