"""Mesh: triangles with UVs, shading normals and tangents for every corner; mesh files."""

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

from mpsnet_core.arrays.unit_vectors import SHORTEST, dot, normalised
from mpsnet_core.errors import FormatError, GeometryError
from mpsnet_core.io.files import existing_file, located
from mpsnet_core.io.mesh_import import read_scene
from mpsnet_core.io.npz import read_arrays
from mpsnet_core.io.ply import NO_LENGTHS, NOTHING, read_ply
from mpsnet_core.scene.mesh_labels import Labels, labels_of_runs
from mpsnet_core.scene.mikktspace import mikktspace_tangents

log = logging.getLogger(__name__)

MESH_FORMAT = "mpsnet-mesh"
MESH_VERSION = 1
MAX_MESH_BYTES = 4 << 30
# In any unit: products of three such lengths stay finite.
MOST = 1e12
# No modeller's faces have more corners, and cutting ears takes their square in time.
MAX_CORNERS = 4096
# Pairs of corners that cutting ears looks at together: few enough to stay in a core's cache.
CORNERS_AT_ONCE = 1 << 15
# Scales that differ by less than this share stretch nothing.
SAME_SCALE = 1e-4
# The names of a PLY file's UVs, by MeshLab, others and Blender; the last that is there counts.
PLY_UVS = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh; everything but `world_from_object` is in object space.

    Parameters
    ----------
    vertices : (V, 3) float64 array
        Those that no triangle has are left out: a stray one far away would count for the mesh's size.
    triangles : (T, 3) int32 array
        Vertex indices, counter-clockwise seen from outside.
    corner_normals : (T, 3, 3) float32 array
        Unit shading normals.
    uvs : (T, 3, 2) float32 array
        v up; one unit square is the texture.
    given_tangents : (T, 3, 4) float32 array, optional
        What :attr:`tangents` returns; MikkTSpace's by default.
    world_from_object : (4, 4) float64 array, optional
        Affine, may be scaled; the identity by default.
    materials, objects : Labels, optional
        Each triangle's material and object.
    polygons : (T,) int32 array, optional
        The polygon of each triangle, for the tangents of quads: see :func:`.mikktspace.mikktspace_tangents`.

    Raises
    ------
    GeometryError
        If shapes do not agree, a number is not finite, or the object is scaled to nothing.

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
        """(3, 3) what normals in object space, as rows, are multiplied by to be in world space, not of unit length.

        Normals are carried by the inverse transpose; a row times a matrix transposes once more.
        """
        return np.linalg.inv(self.world_from_object[:3, :3])

    @property
    def is_mirrored(self) -> bool:
        """Whether triangles are clockwise seen from outside, in world space."""
        return bool(np.linalg.det(self.world_from_object[:3, :3]) < 0)


def _check_finite(name: str, values: NDArray[Any]) -> None:
    if not np.isfinite(values).all():
        raise GeometryError(f"the mesh's {name} hold a value that is not finite; repair the mesh")
    if name != "uvs" and (np.abs(values) > MOST).any():
        raise GeometryError(f"the mesh's {name} hold a value beyond {MOST:g}; repair the mesh")


def _scales(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3,) by how much a pose stretches what it places, the most first."""
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

    Polygons become triangles, and all of the file's objects and materials one mesh that is labelled with their
    names. Shading normals are the file's own, else smooth ones, across UV seams too. The axes stay the file's: cameras
    must be in the same world.

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
        If it is damaged, or none of these formats.
    GeometryError
        If the mesh has no faces or no UVs, or cannot be a :class:`Mesh`.
    """
    path = existing_file(path, "mesh file")
    if path.stat().st_size > MAX_MESH_BYTES:
        raise FormatError(f"mesh file {path} is larger than 4 GiB; reduce the mesh first")
    readers = {".npz": _read_npz, ".obj": _read_obj, ".ply": _read_ply, ".glb": _read_glb}
    with located(f"mesh file {path}"):
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


# The .npz arrays of labels: names, and each triangle's index into them.
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
    """OBJ by hand: trimesh splits vertices at seams and loses the UVs of files with quads or several materials."""
    values: dict[str, list[list[float]]] = {"v": [], "vt": [], "vn": []}
    width = {"v": 3, "vt": 2, "vn": 3}
    corners: list[tuple[int, ...]] = []
    sizes: list[int] = []
    # By OBJ's keywords, the first face that each name applies to.
    named: dict[str, list[tuple[int, str]]] = {"usemtl": [], "o": []}
    # A backslash joins a line with the next one, but for a comment, which may end with a Windows folder.
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
            elif key in named:  # a name may hold a #, as 3ds Max's do
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
    v, vt, vn = np.moveaxis(of_corners[_triangulated(vertices[of_corners[:, 0]], counts_of)], 2, 0)
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
    """An OBJ's text: UTF-8, also with the mark that Windows programs begin it with, or as older programs write it."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        return path.read_text(encoding="latin-1")


def _labels_from(starts: list[tuple[int, str]], triangles: NDArray[np.int64]) -> Labels | None:
    """Labels from the first face of each name, by the faces' numbers of triangles; None where there are no names."""
    if not starts:
        return None
    runs = pairwise([(0, ""), *starts, (len(triangles), "")])
    return labels_of_runs((name, int(triangles[start:stop].sum())) for (start, name), (stop, _) in runs)


def _triangulated(places: NDArray[np.float64], sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """(T, 3) the corners of polygons' triangles, those of one polygon in a row.

    places: (C, 3) of the corners, polygon after polygon. sizes: (F,) their numbers. A polygon with a corner that turns
    inwards loses ear after ear, so that its notches stay open; any other becomes a fan.
    """
    ends = np.cumsum(sizes)
    starts, polygon = ends - sizes, np.repeat(np.arange(len(sizes)), sizes)
    is_second = np.ones(len(places), bool)
    is_second[starts] = is_second[ends - 1] = False
    second = np.flatnonzero(is_second)
    triangles: NDArray[np.int64] = np.stack([starts[polygon[second]], second, second + 1], axis=1)

    ahead, behind = np.arange(len(places)) + 1, np.arange(len(places)) - 1
    ahead[ends - 1], behind[starts] = starts, ends - 1
    around = places - places[starts][polygon]
    normals = np.add.reduceat(np.cross(around, around[ahead]), starts)
    turns = np.cross(places - places[behind], places[ahead] - places)
    inwards = dot(turns, normals[polygon])
    notched = np.unique(polygon[inwards < 0])
    for number in notched:
        start, end = starts[number], ends[number]
        first = start - 2 * number  # each polygon before it has two triangles fewer than corners
        triangles[first : first + sizes[number] - 2] = start + _ears(around[start:end], normals[number])
    return triangles


def _ears(places: NDArray[np.float64], normal: NDArray[np.float64]) -> NDArray[np.int64]:
    """(N - 2, 3) triangles of one polygon (N, 3), seen along its normal.

    Corners that turn outwards, with no other corner between them and their neighbours, are cut off, of two beside each
    other one. Where there is none, as in a polygon that crosses itself, the rest becomes a fan.
    """
    along = int(np.argmax(np.abs(normal)))
    flat = places[:, [(along + 1) % 3, (along + 2) % 3]] * [1, np.sign(normal[along])]

    def doubled_area(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> NDArray[np.float64]:
        (x, y), (to_x, to_y) = np.moveaxis(b - a, -1, 0), np.moveaxis(c - a, -1, 0)
        area: NDArray[np.float64] = x * to_y - y * to_x
        return area

    def is_free(triangles: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(E,) whether no other corner (O, 2) is in a triangle (E, 3, 2)."""
        behind, ear, ahead = np.moveaxis(triangles[:, None], 2, 0)
        within = np.ones((len(triangles), len(others)), bool)
        for a, b in ((behind, ear), (ear, ahead), (ahead, behind)):
            within &= doubled_area(a, b, others) >= 0
            within &= (others != a).any(axis=-1)  # a corner may be there twice, where a seam leads to a hole
        free: NDArray[np.bool_] = ~within.any(axis=1)
        return free

    left, triangles = np.arange(len(flat)), []
    is_ear, changed = np.zeros(len(flat), bool), left  # a cut changes what the two corners beside it are, and no other
    while len(left) > 3:
        around = np.stack([np.roll(left, 1), left, np.roll(left, -1)], axis=1)
        outwards = doubled_area(*np.moveaxis(flat[around], 1, 0)) > 0
        others = flat[left[~outwards]]  # in a triangle is one of these, or none
        is_ear[changed] = False
        maybe = np.searchsorted(left, changed)
        maybe = maybe[outwards[maybe]]
        for some in np.array_split(maybe, 1 + len(maybe) * len(others) // CORNERS_AT_ONCE):
            is_ear[left[some]] = is_free(flat[around[some]], others)
        cut: list[int] = []
        for place in map(int, np.flatnonzero(is_ear[left])):
            if not cut or (place - cut[-1] > 1 and place - cut[0] < len(left) - 1):
                cut.append(place)
        if not cut:
            break
        cut = cut[: len(left) - 3]
        triangles += np.sort(around[cut], axis=1).tolist()
        changed = np.setdiff1d(around[cut][:, [0, 2]], left[cut])
        left = np.delete(left, cut)
    triangles += [[int(left[0]), *map(int, pair)] for pair in pairwise(left[1:])]
    return np.array(sorted(triangles))


def _obj_corner(word: str, counts: list[int]) -> tuple[int, ...]:
    """Indices from 0 of vertex, UV and normal in "5/7/2", -1 for those not given; negative ones count from the end."""
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
    """PLY by hand: trimesh reads no binary file whose faces differ in their number of corners, and splits quads."""
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
    order = _triangulated(vertices[corners], sizes)
    triangles = corners[order]
    normals = vertex.columns(("nx", "ny", "nz"))
    given = np.full((*triangles.shape, 3), np.nan) if normals is None else normals[triangles]
    # A file of one UV for each vertex has several at one place; for smooth normals they count as one.
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
    # Joined here and not by trimesh, which packs the textures of several materials anew and moves the UVs.
    starts = np.cumsum([0] + [len(part[0]) for part in parts[:-1]])
    triangles = np.concatenate([part[1] + start for part, start in zip(parts, starts, strict=True)])
    vertices, normals, uvs = (np.concatenate([part[index] for part in parts]) for index in (0, 2, 3))
    _check_finite("vertices", vertices)
    # glTF splits vertices where UVs part; for smooth normals those at one place count as one.
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
    """(4, 4) from what the parts of a GLB are read in to the world: the world itself, or the first stretched part's
    own axes, as normals in tangent space are those of a mesh before its node stretches it."""
    for pose in poses:
        _check_pose(pose)
    return next((pose for pose in poses if not _keeps_angles(pose)), np.eye(4))


def _keeps_angles(pose: NDArray[np.float64]) -> bool:
    scales = _scales(pose)
    return bool(scales[-1] > (1 - SAME_SCALE) * scales[0])


def _object_name(graph: Any, node: str, part: Any) -> str:
    """The name of the file's node; trimesh splits a node by materials into child nodes called NAME_1a2b3c.

    A child of the file may be called so too, as a door's door_handle.
    """
    parent = graph.transforms.parents.get(node)
    is_split = parent and part.metadata.get("from_gltf_primitive", True)
    return parent if is_split and re.fullmatch(re.escape(parent) + "_[0-9A-Za-z]{6}", node) else node


def _material_name(part: Any) -> str:
    return str(getattr(getattr(getattr(part, "visual", None), "material", None), "name", None) or "")


def _placed(part: Any, pose: NDArray[np.float64], shape_only: bool) -> tuple[NDArray[Any], ...]:
    """Vertices, triangles, normals (NaN where the file has none) and UVs of one of trimesh's meshes in the scene."""
    faces = np.asarray(getattr(part, "faces", np.empty((0, 3))), np.int32)
    vertices = np.asarray(part.vertices, np.float64)
    _check_numbers(faces, len(vertices))
    uvs = getattr(part.visual, "uv", None) if len(faces) else np.empty((len(vertices), 2))
    if shape_only:
        uvs = np.zeros((len(vertices), 2))
    if uvs is None or len(uvs) != len(vertices):
        # trimesh drops the UVs of glTF without a material.
        raise _without_uvs("it has no material (without one, the UVs of a glTF file are not read) or")
    normals: NDArray[Any] = np.full_like(vertices, np.nan)
    # trimesh computes vertex normals on demand; its cache holds them beforehand only where the file gave them.
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
    """(T, 3, 3) unit normals, smooth ones where a file has none (NaN) or one of no length, as of faces of no area."""
    given = np.linalg.norm(normals, axis=-1, keepdims=True) > SHORTEST
    unit: NDArray[Any] = normalised(np.where(given, normals, smooth_corner_normals(vertices, triangles)))
    return unit


def triangle_normals(corners: NDArray[Any]) -> NDArray[Any]:
    """(T, 3) normals of triangles (T, 3, 3), towards who sees them counter-clockwise; as long as twice the area."""
    normals: NDArray[Any] = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals


def smooth_corner_normals(vertices: NDArray[np.float64], triangles: NDArray[np.int32]) -> NDArray[np.float64]:
    """(T, 3, 3) smooth normals, as Blender's: for each vertex the normals of its faces, weighted by their angles."""
    corners = vertices[triangles]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    across = np.linalg.norm(np.cross(ahead, behind), axis=-1)
    angles = np.arctan2(across, dot(ahead, behind))
    weighted = (normalised(triangle_normals(corners))[:, None] * angles[..., None]).reshape(-1, 3)
    summed = np.stack([np.bincount(triangles.ravel(), weighted[:, axis], len(vertices)) for axis in range(3)], axis=-1)
    normals: NDArray[np.float64] = normalised(summed)[triangles]
    return normals
