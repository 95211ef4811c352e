"""The surfaces of objects, with modifiers and instances, as points in world space, and a sphere around them."""

from collections.abc import Iterable, Iterator
from hashlib import sha256
from typing import Any

import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from mpsnet_core.errors import GeometryError, InputError

from ..appearance.modifiers import DISPLACE, SMOOTHNESS, SUBDIVISION

_STAMPED = 500  # vertices and corners

# Types of objects that evaluate to a mesh.
SURFACES = {"MESH", "CURVE", "SURFACE", "META", "FONT"}


def values_of(elements: Any, name: str, width: int, kind: type = np.float32) -> NDArray[Any]:
    """(N, width) the values of that name of a mesh's elements."""
    values: NDArray[Any] = np.empty(len(elements) * width, kind)
    elements.foreach_get(name, values)
    return values.reshape(-1, width)


def middle_of(obj: Any) -> Vector:
    """The centre of an object's bounding box, in world space. The origin of a scan may be far from its surface."""
    return obj.matrix_world @ (sum(map(Vector, obj.bound_box), Vector()) / 8)


def box_of(obj: Any) -> NDArray[np.float64]:
    """(2, 3) the lowest and the highest coordinates of an object's bounding box in world space."""
    corners = np.array([obj.matrix_world @ Vector(corner) for corner in obj.bound_box])
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def world_scale(obj: Any) -> float:
    """An object's scale in world space; the mean of a non-uniform one. Raises InputError if it is 0."""
    scale: float = abs(obj.matrix_world.to_3x3().determinant()) ** (1 / 3)
    if scale < 1e-9:
        raise GeometryError(f'"{obj.name}" is scaled to nothing in one direction; give it a scale above 0')
    return scale


def mesh_stamp(obj: Any) -> str:
    """A text that changes with a mesh object's shape, its UVs, or its modifiers: of a sample, as panels need it."""
    mesh = obj.data
    values = [len(mesh.vertices), len(mesh.polygons)]
    layer = next((one for one in mesh.uv_layers if one.active_render), None)
    for elements, name in ((mesh.vertices, "co"), (layer.uv if layer else (), "vector")):
        step = -(-len(elements) // _STAMPED) or 1
        values += [value for number in range(0, len(elements), step) for value in getattr(elements[number], name)]
    own = (SUBDIVISION, DISPLACE, SMOOTHNESS)
    shapes = [one.type for one in obj.modifiers if one.show_render and one.name not in own]
    return " ".join([sha256(np.array(values, np.float32).tobytes()).hexdigest()[:12], *shapes])


def bounding_sphere(depsgraph: Any, objects: Iterable[Any]) -> tuple[Vector, float]:
    """Centre and radius, in world space, of a sphere around the objects' surfaces with modifiers and instances.

    Raises InputError if none of them has a surface.
    """
    return sphere_around(surface_points(depsgraph, objects), Matrix.Identity(3))


def surface_points(depsgraph: Any, objects: Iterable[Any]) -> NDArray[np.float64]:
    """(N, 3) points of all the objects' surfaces, in world space. Raises InputError if there are none."""
    clouds = [points for _, points in surfaces(depsgraph, objects)]
    if not clouds:
        raise InputError("no selected object has a surface; select a mesh")
    return np.concatenate(clouds)


def sphere_around(points: NDArray[np.float64], axes: Matrix) -> tuple[Vector, float]:
    """Centre of the points' bounding box along the axes (columns), and their largest distance from it."""
    turned = points @ np.array(axes)
    centre = np.array(axes) @ (turned.min(axis=0) + turned.max(axis=0)) / 2
    radius = float(np.linalg.norm(points - centre, axis=1).max())
    if radius == 0:
        raise InputError("the selected object is a single point; select a mesh with a surface")
    return Vector(centre), radius


def surfaces(depsgraph: Any, objects: Iterable[Any]) -> Iterator[tuple[Any, NDArray[np.float64]]]:
    """The surfaces of objects with modifiers and instances: the object, and its points (N, 3) in world space."""
    wanted = set(objects)
    for instance in depsgraph.object_instances:
        owner = (instance.parent or instance.object).original
        if owner not in wanted or instance.object.type not in SURFACES:
            continue
        mesh = instance.object.to_mesh()
        points = values_of(mesh.vertices, "co", 3).astype(np.float64) if mesh is not None else ()
        instance.object.to_mesh_clear()
        if len(points):
            matrix = np.array(instance.matrix_world)
            yield owner, points @ matrix[:3, :3].T + matrix[:3, 3]
