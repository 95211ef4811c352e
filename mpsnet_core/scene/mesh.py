"""Labels: the material or the object of each of a mesh's triangles."""

import itertools
import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.polygon_triangulation import triangulated
from mpsnet_core.arrays.types import F32, F64, I32, I64
from mpsnet_core.arrays.unit_vectors import SHORTEST, dot, normalised
from mpsnet_core.errors import FormatError, GeometryError
from mpsnet_core.io.files import existing_file, prefix_errors
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.gltf import Part, read_gltf
from mpsnet_core.io.npz import read_arrays
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.polygons import MAX_CORNERS, SUFFIXES, Polygons, checked_indices, read_obj, read_ply, read_shape
from mpsnet_core.scene.mikktspace import mikktspace_tangents


@dataclass(frozen=True, eq=False)
class Labels:
    """A name for each of T triangles.

    Raises
    ------
    GeometryError
        If a name occurs twice or an index is out of range.

    Examples
    --------
    >>> labels = Labels(("glaze", "clay"), np.array([0, 0, 1]))
    >>> [labels.names[number] for number in labels.number]
    ['glaze', 'glaze', 'clay']
    """

    names: tuple[str, ...]
    """Distinct names."""
    number: I32
    """(T,) int32. Each triangle's index into `names`."""

    def __post_init__(self) -> None:
        number = np.asarray(self.number)
        if number.ndim != 1 or number.dtype.kind not in "iu":
            raise GeometryError("labels need one whole number for each triangle; export the mesh again")
        if len(number) and not (number.min() >= 0 and number.max() < len(self.names)):
            raise GeometryError(f"labels are numbered up to {number.max()}, of {len(self.names)} names; export again")
        if len(set(self.names)) < len(self.names):
            raise GeometryError("two labels have the same name; export the mesh again")
        object.__setattr__(self, "names", tuple(map(str, self.names)))
        object.__setattr__(self, "number", number.astype(np.int32))

    def __len__(self) -> int:
        return len(self.number)


def labels_of_runs(runs: Iterable[tuple[str, int]]) -> Labels:
    """Labels from run lengths: names with a number of triangles each. Names may repeat."""
    names: dict[str, int] = {}
    numbers, counts = [], []
    for name, count in runs:
        if count:
            numbers.append(names.setdefault(name, len(names)))
            counts.append(count)
    return Labels(tuple(names), np.repeat(np.array(numbers, np.int32), counts))


# ----------------------------------------------------------------------------------------------------------------------
# Meshes of triangles with UVs, shading normals and tangents at every corner; mesh files.


log = logging.getLogger(__name__)

MESH_FORMAT = "mpsnet-mesh"
MESH_VERSION = 1
MAX_MESH_BYTES = 4 << 30
# Largest coordinate, in any unit: products of three such lengths stay finite.
MAX_VALUE = 1e12
# Relative tolerance within which the scales of a pose count as equal.
SAME_SCALE = 1e-4
Up = Literal["z", "y"]
# The rotation of Blender's OBJ and glTF importers for files with y up.
_FROM_Y_UP = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh. All its data is in object space, except `world_from_object`.

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

    vertices: F64
    """(V, 3) float64. Positions. Unused vertices are dropped: a stray one far away would distort the mesh's size."""
    triangles: I32
    """(T, 3) int32. Vertex indices, counter-clockwise seen from outside."""
    corner_normals: F32
    """(T, 3, 3) float32. Unit shading normals."""
    uvs: F32
    """(T, 3, 2) float32. UV coordinates, v up. A texture covers one unit square."""
    given_tangents: F32 | None = None
    """(T, 3, 4) float32. The value of :attr:`tangents`; by default it is computed by MikkTSpace."""
    world_from_object: F64 = field(default_factory=lambda: np.eye(4))
    """(4, 4) float64. Affine transform, scaling included; the identity by default."""
    materials: Labels | None = None
    """Each triangle's material."""
    objects: Labels | None = None
    """Each triangle's object."""
    polygons: I32 | None = None
    """(T,) int32. The polygon of each triangle, for the tangents of quads: see
    :func:`.mikktspace.mikktspace_tangents`."""

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
                with np.errstate(over="ignore"):  # what is too large is not finite
                    value = np.asarray(getattr(self, name), dtype=kinds.get(name, np.float32))
            except (TypeError, ValueError, OverflowError):
                raise GeometryError(f"the mesh's {name} are not numbers; export it again") from None
            if value.shape != shape:
                raise GeometryError(f"the mesh's {name} have shape {value.shape}, expected {shape}; export it again")
            _check_finite(name, value)
            object.__setattr__(self, name, value)
        checked_indices(self.triangles, points)
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
    def tangents(self) -> F32:
        """(T, 3, 4) unit tangent T of every corner, then the sign s of its bitangent B = s N x T."""
        if self.given_tangents is not None:
            return self.given_tangents
        return mikktspace_tangents(self.vertices[self.triangles], self.corner_normals, self.uvs, self.polygons)

    @cached_property
    def world_vertices(self) -> F64:
        """(V, 3) vertices in world space."""
        return self.vertices @ self.world_from_object[:3, :3].T + self.world_from_object[:3, 3]

    @cached_property
    def world_areas(self) -> F64:
        """(T,) areas of the triangles in world space."""
        return np.linalg.norm(triangle_normals(self.world_vertices[self.triangles]), axis=1) / 2

    @cached_property
    def outwards(self) -> F32:
        """(T, 3) unit normals of the triangles' outsides in world space: what a camera sees of them depends on these.

        Shading normals only tell the outside of the whole mesh: they may point anywhere, as on foliage.
        """
        normals = triangle_normals(self.world_vertices[self.triangles])
        if self.is_mirrored != self.is_inside_out:
            normals = -normals
        return normalised(normals).astype(np.float32)

    @cached_property
    def is_inside_out(self) -> bool:
        """Whether most triangles are clockwise, seen from where their shading normals point."""
        outwards = np.einsum("ti,tci->t", triangle_normals(self.vertices[self.triangles]), self.corner_normals)
        return bool(np.count_nonzero(outwards < 0) > len(outwards) / 2)

    @cached_property
    def normals_to_world(self) -> F64:
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


def _scales(pose: F64) -> F64:
    """(3,) scale factors (singular values) of a pose, largest first."""
    return np.linalg.svd(pose[:3, :3], compute_uv=False)


def _check_pose(world_from_object: F64) -> None:
    scales = _scales(world_from_object)
    if scales[-1] <= 1e-9 * scales[0]:
        raise GeometryError("the object is scaled to nothing in one direction; give it a scale above 0")


def read_mesh(path: AnyPath, *, shape_only: bool = False, up: Up = "z", unit: float = 1.0) -> Mesh:
    """Read a mesh with UVs: OBJ, PLY, GLB, or the ``.npz`` that the add-on writes.

    Polygons are triangulated. All objects and materials of the file become one mesh, labelled with their names. Shading
    normals are those of the file. Where it has none, they are as in Blender after its import: faces are flat, except
    those of an OBJ file's smoothing groups.

    Parameters
    ----------
    path : path-like
    shape_only : bool, optional
        Ignore UVs, which are then not required. STL and OFF are read, too.
    up : {"z", "y"}, optional
        Which axis of the file points up. Files with y up are turned to z up in world space, as Blender's importers do.
        By default the axes are the file's: cameras must be in the same world space.
    unit : float, optional
        Length of the file's unit in world space.

    Raises
    ------
    FileError
        If the file is missing.
    FormatError
        If it is damaged, or not in one of these formats.
    GeometryError
        If the mesh has no faces or no UVs, or is not a valid :class:`Mesh`.
    """
    path = existing_file(path, "mesh file")
    if path.stat().st_size > MAX_MESH_BYTES:
        raise FormatError(f"mesh file {path} is larger than 4 GiB; reduce the mesh first")
    with prefix_errors(f"mesh file {path}"):
        suffix = path.suffix.lower()
        if suffix in _POLYGON_READERS:
            mesh = _of_polygons(_POLYGON_READERS[suffix](path), shape_only)
        elif suffix in (".npz", ".glb", ".gltf"):
            mesh = _read_npz(path, shape_only) if suffix == ".npz" else _read_glb(path, shape_only)
        else:
            raise FormatError(f"{path.suffix or 'no suffix'} is not a supported mesh format; use OBJ, PLY, GLB or npz")
        if up != "z" or unit != 1:
            mesh = replace(mesh, world_from_object=world_from_file(up, unit) @ mesh.world_from_object)
    if not shape_only and mesh.is_inside_out:
        log.warning(
            "mesh file %s: most of its faces point the opposite way from its normals, as in a PLY of a "
            "mirrored object, which would bake an inverted green channel; apply the object's scale or "
            "flip the faces, and export it again",
            path,
        )
    return mesh


def world_from_file(up: Up, unit: float) -> F64:
    """(4, 4) transform to world space from that of a file with this axis up, whose unit has this length."""
    return np.diag([unit, unit, unit, 1.0]) @ (_FROM_Y_UP if up == "y" else np.eye(4))


_POLYGON_READERS: dict[str, Callable[[Path], Polygons]] = {".obj": read_obj, ".ply": read_ply}
_POLYGON_READERS |= dict.fromkeys(SUFFIXES, read_shape)

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
        raise FormatError(f"it is version {arrays.get('version')}, this program reads {MESH_VERSION}; update it")
    needed = ("vertices", "triangles", "corner_normals", "uvs")
    missing = [name for name in needed if name not in arrays]
    if missing:
        raise FormatError(f'it lacks "{missing[0]}"; export it again')
    vertices, triangles, normals, uvs = (arrays[name] for name in needed)
    uvs = _no_uvs(len(np.atleast_1d(triangles))) if shape_only else uvs
    tangents, pose = arrays.get("tangents"), arrays.get("world_from_object", np.eye(4))
    labels, polygons = _labels_of_arrays(arrays), arrays.get("triangle_polygon")
    return Mesh(vertices, triangles, normals, uvs, tangents, pose, **labels, polygons=polygons)


def _of_polygons(found: Polygons, shape_only: bool, world_from_object: F64 | None = None) -> Mesh:
    """Triangulate and shade what a file says. Polygons of fewer than three corners are left out."""
    found = _faces_of(found)
    if not len(found.sizes):
        raise GeometryError("it has no faces; choose a mesh with a surface")
    if found.sizes.max() > MAX_CORNERS:
        raise FormatError(f"it has a face of {found.sizes.max()} corners, more than {MAX_CORNERS}; triangulate it")
    _check_finite("vertices", found.vertices)
    order = triangulated(found.vertices[found.corners], found.sizes)
    uvs: NDArray[Any] = _no_uvs(len(order))
    if not shape_only:
        without = np.array(True) if found.uvs is None else np.isnan(found.uvs).any(axis=1)
        if found.uvs is None or without.any():
            who = "it has" if without.all() else "some of its faces have"
            raise GeometryError(f"{who} no UVs; unwrap it in Blender (UV > Smart UV Project) and export it with UVs")
        uvs = found.uvs[order]
    counts, pose = found.sizes - 2, np.eye(4) if world_from_object is None else world_from_object
    materials, objects = (_labels(runs, counts) for runs in (found.materials, found.objects))
    polygons = np.repeat(np.arange(len(counts)), counts)
    triangles, normals = found.corners[order].astype(np.int32), _shaded(found)[order]
    mesh = Mesh(found.vertices, triangles, normals, uvs, None, pose, materials, objects, polygons)
    if found.tangents is None or shape_only:
        return mesh
    given = found.tangents[order]
    return replace(mesh, given_tangents=np.where(np.isnan(given), mesh.tangents, given))


def _faces_of(found: Polygons) -> Polygons:
    """The polygons of three corners and more."""
    is_face = found.sizes > 2
    if is_face.all():
        return found
    of_corners, of_faces = np.repeat(is_face, found.sizes), ("sizes", "smoothing")
    kept: dict[str, Any] = {}
    for name in ("corners", "uvs", "normals", "tangents", *of_faces):
        values = getattr(found, name)
        kept[name] = None if values is None else values[is_face if name in of_faces else of_corners]
    for name in ("materials", "objects"):
        runs = getattr(found, name)
        kept[name] = None if runs is None else _counted(runs, is_face)
    return replace(found, **kept)


def _counted(runs: Sequence[tuple[str, int]], numbers: NDArray[Any]) -> list[tuple[str, int]]:
    """Runs of polygons as sums of a number of each, (F,)."""
    ends = np.cumsum([count for _, count in runs])
    summed = np.concatenate([[0], np.cumsum(numbers)])[np.concatenate([[0], ends])]
    return [(name, int(count)) for (name, _), count in zip(runs, np.diff(summed), strict=True)]


def _labels(runs: Sequence[tuple[str, int]] | None, triangles: I64) -> Labels | None:
    """Labels of triangles from names with the number of polygons of each. triangles: (F,) how many each polygon has."""
    return None if runs is None else labels_of_runs(_counted(runs, triangles))


def _read_glb(path: Path, shape_only: bool) -> Mesh:
    parts = [part for part in read_gltf(path) if len(part.triangles)]
    if not parts:
        raise GeometryError("it has no faces; choose a mesh with a surface")
    frame = _frame([part.pose for part in parts])
    poses = [np.linalg.inv(frame) @ part.pose for part in parts]
    if not (shape_only or all(map(_keeps_angles, poses))):
        log.warning(
            "mesh file %s: its objects are stretched in several ways, and textures in tangent space fit "
            "only some of them; apply their scale (in Blender: Object > Apply > Scale) and export it "
            "again",
            path,
        )
    with np.errstate(all="ignore"):  # what is not finite is refused later
        placed = [_placed(part, pose) for part, pose in zip(parts, poses, strict=True)]
    starts = np.cumsum([0] + [len(part.vertices) for part in placed[:-1]])
    corners = np.concatenate([part.triangles.ravel() + start for part, start in zip(placed, starts, strict=True)])
    counts = [len(part.triangles) for part in placed]

    def joined(name: str, width: int) -> F64:
        values = [(getattr(part, name), np.full((len(part.vertices), width), np.nan)) for part in placed]
        return np.concatenate([none if given is None else given for given, none in values])[corners]

    vertices, sizes = np.concatenate([part.vertices for part in placed]), np.full(sum(counts), 3)
    tangents = joined("tangents", 4) if any(part.tangents is not None for part in placed) else None
    smooth = np.repeat([0 if part.normals is None else number for number, part in enumerate(placed, 1)], counts)
    materials = [(part.material, len(part.triangles)) for part in placed]
    objects = [(part.name, len(part.triangles)) for part in placed]
    named = any(name for name, _ in materials)
    shading = joined("uvs", 2), joined("normals", 3), tangents, smooth
    found = Polygons(vertices, corners, sizes, *shading, materials if named else None, objects)
    if found.tangents is not None and found.uvs is not None and _are_mirrored(found.tangents, found.uvs):
        log.warning(
            "mesh file %s: the handedness of most of its tangents contradicts its UVs; the texture fits "
            "these tangents and not those that programs such as Blender compute",
            path,
        )
    return _of_polygons(found, shape_only, frame)


def _are_mirrored(tangents: F64, uvs: F64) -> bool:
    """Whether the signs of most tangents of triangles, one for each corner, contradict the UVs'."""
    a, b, c = np.moveaxis(uvs.reshape(-1, 3, 2), 1, 0)
    (u1, v1), (u2, v2) = (b - a).T, (c - a).T
    signs = np.sign(u1 * v2 - v1 * u2) * tangents[::3, 3]
    return bool(np.count_nonzero(signs < 0) > np.count_nonzero(signs > 0))


def _frame(poses: Sequence[F64]) -> F64:
    """(4, 4) transform to world space from the space that the parts of a GLB are read in.

    That is world space itself, or the own space of the first part that its node scales non-uniformly: tangent-space
    normals refer to the mesh before it is stretched.
    """
    for pose in poses:
        _check_pose(pose)
    return next((pose for pose in poses if not _keeps_angles(pose)), np.eye(4))


def _keeps_angles(pose: F64) -> bool:
    scales = _scales(pose)
    return bool(scales[-1] > (1 - SAME_SCALE) * scales[0])


def _placed(part: Part, pose: F64) -> Part:
    """A part transformed by `pose`."""
    vertices, triangles, normals, tangents = part.vertices, part.triangles, part.normals, part.tangents
    checked_indices(triangles, len(vertices))
    turn, mirrored = pose[:3, :3], np.linalg.det(pose[:3, :3]) < 0
    if mirrored:
        triangles = triangles[:, ::-1]
    if normals is not None:
        normals = normals @ np.linalg.inv(turn)
    if tangents is not None:
        along = tangents[:, :3] @ turn.T
        sign = np.sign(tangents[:, 3:]) * (-1 if mirrored else 1)
        tangents = np.concatenate([along / np.linalg.norm(along, axis=1, keepdims=True), sign], axis=1)
    vertices = vertices @ turn.T + pose[:3, 3]
    return replace(part, vertices=vertices, triangles=triangles, normals=normals, tangents=tangents)


def _no_uvs(count: int) -> F32:
    """(T, 3, 2) placeholder UVs: each triangle covers half of the texture."""
    return np.broadcast_to(np.array([[0, 0], [1, 0], [0, 1]], np.float32), (count, 3, 2))


def _shaded(found: Polygons) -> F32:
    """(C, 3) unit normals: those of the file or, where it has none or a zero one, by its smoothing groups."""
    normals = np.full((len(found.corners), 3), np.nan) if found.normals is None else found.normals
    with np.errstate(over="ignore"):
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
    given = (length > SHORTEST) & (length < np.inf)
    if not given.all():
        polygon = np.repeat(np.arange(len(found.sizes)), found.sizes)
        group = 0 * polygon if found.smoothing is None else found.smoothing[polygon]
        shared = np.where(group > 0, group * len(found.vertices) + found.corners, -1 - polygon)
        normals = np.where(given, normals, shared_normals(found.vertices[found.corners], shared, found.sizes))
    return normalised(normals).astype(np.float32)


def triangle_normals(corners: NDArray[Any]) -> NDArray[Any]:
    """(T, 3) normals of counter-clockwise triangles (T, 3, 3). Their length is twice the area."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def shared_normals(corners: F64, shared: NDArray[np.integer[Any]], sizes: I64 | None = None) -> F64:
    """(..., 3) normals like Blender's: the mean of the polygons' normals, weighted by the corners' angles.

    Parameters
    ----------
    corners : (..., 3) array
        The corners of polygons, one after the other.
    shared : (...) array of int
        Corners of the same number share one normal: those at one vertex for smooth shading, of one polygon for flat.
    sizes : (F,) array of int, optional
        Number of corners of each polygon; by default all are triangles.
    """
    places, number = corners.reshape(-1, 3), np.unique(shared, return_inverse=True)[1].reshape(-1)
    sizes = np.full(len(places) // 3, 3) if sizes is None else sizes
    ends = np.cumsum(sizes)
    starts = ends - sizes
    next_one, last_one = np.arange(len(places)) + 1, np.arange(len(places)) - 1
    next_one[ends - 1], last_one[starts] = starts, ends - 1
    around = places - np.repeat(places[starts], sizes, axis=0)
    faces = normalised(np.add.reduceat(np.cross(around, around[next_one]), starts))
    ahead, behind = places[next_one] - places, places[last_one] - places
    angles = np.arctan2(np.linalg.norm(np.cross(ahead, behind), axis=-1), dot(ahead, behind))
    weighted = np.repeat(faces, sizes, axis=0) * angles[:, None]
    summed = np.stack([np.bincount(number, weighted[:, axis]) for axis in range(3)], axis=-1)
    return normalised(summed)[number].reshape(corners.shape)


# ----------------------------------------------------------------------------------------------------------------------
# Several meshes joined for occlusion and world positions, where only their shape matters.


T = TypeVar("T", bound=np.generic)


@takes_files
def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Join meshes into one in world space, with their triangles in order.

    Parameters
    ----------
    meshes : sequence of Mesh
        A single mesh is returned unchanged. Of several, labels and given tangents are dropped.

    Raises
    ------
    GeometryError
        If the joined arrays are not a valid :class:`Mesh`.
    """
    if len(meshes) == 1:
        return meshes[0]
    starts = itertools.accumulate((len(mesh.vertices) for mesh in meshes[:-1]), initial=0)
    normals = [normalised(mesh.corner_normals @ mesh.normals_to_world.astype(np.float32)) for mesh in meshes]
    triangles = [_outwards(mesh, mesh.triangles) + start for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh(
        np.concatenate([mesh.world_vertices for mesh in meshes]),
        np.concatenate(triangles),
        np.concatenate(list(map(_outwards, meshes, normals))),
        np.concatenate([_outwards(mesh, mesh.uvs) for mesh in meshes]),
    )


def _outwards(mesh: Mesh, at_corners: NDArray[T]) -> NDArray[T]:
    """Corner values (T, 3, ...) in counter-clockwise order in world space: reversed for a mirrored object."""
    return at_corners[:, ::-1] if mesh.is_mirrored else at_corners
