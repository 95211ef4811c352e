"""An object's mesh as the core's mesh file: as a render sees it, with Blender's own normals.

It is read at once, so later changes to the object do not matter, and written in slices, between which the window stays
responsive.
"""

import zipfile
from collections.abc import Generator, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from mpsnet_core.errors import GeometryError
from mpsnet_core.scene.mesh import Mesh, join_meshes

from ..appearance.modifiers import DISPLACE, SMOOTHNESS, SUBDIVISION, find_modifier
from .objects import temporarily
from .surfaces import SURFACES, values_of, world_scale

# Settings of modifiers for the viewport, and their counterparts for renders.
_SHOWN_AND_RENDERED = (
    ("show_viewport", "show_render"),
    ("levels", "render_levels"),
    ("steps", "render_steps"),
    ("viewport_resolution", "resolution"),
)
MAX_TRIANGLES = 4_000_000  # limit of what is read while the window waits

_ROWS_A_SLICE = 100_000

# Long work whose steps are short enough not to block the window; close() ends it early. It yields whether the next step
# is a long one, before which the window is redrawn.
Slices = Generator[bool, None, None]


@dataclass(frozen=True)
class BegunMesh:
    """A mesh file that is being written."""

    uv_map: str
    """Name of the UV map, "" for none."""
    used: frozenset[str]
    """The materials that faces have, by their names in the file, see :func:`slot_labels`."""
    slices: Slices
    """The remaining work; the file exists after the last one."""

    def whole(self) -> "BegunMesh":
        """Finish all slices, and return it."""
        for _ in self.slices:
            pass
        return self


def begin_mesh(path: Path, obj: Any, depsgraph: Any, uv_map: str | None, turn: Matrix | None = None) -> BegunMesh:
    """Start writing an object as the render sees it, with modifiers applied, as the core's mesh file.

    The corner normals are Blender's own. uv_map: "" for the one that is active for rendering, None if only the shape is
    needed. turn: rotation from Blender's world to that of the cameras, if they differ.

    Raises InputError if the object is no mesh, has no faces, lacks the UV map, is scaled to nothing or is disabled in
    viewports.
    """
    if obj.type == "EMPTY" and obj.instance_collection is not None:
        raise GeometryError(
            f'"{obj.name}" is an instance of the collection "{obj.instance_collection.name}"; choose an object of it '
            "that is in the scene itself, or make the instance real (Object > Apply)"
        )
    if obj.type != "MESH":
        raise GeometryError(f'"{obj.name}" is not a mesh but {obj.type.lower()}; convert it to a mesh first')
    if obj.mode == "SCULPT" and any(modifier.type == "MULTIRES" for modifier in obj.modifiers):
        raise GeometryError(f'"{obj.name}" is being sculpted with Multiresolution; leave Sculpt Mode first')
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    if obj.mode == "EDIT" or bpy.app.background:  # scripts may not tag their changes; tagging causes a redraw
        obj.data.update_tag()
    with temporarily((depsgraph.scene.render, "use_simplify", False), *as_rendered(obj)):
        depsgraph.update()
        evaluated = obj.evaluated_get(depsgraph)
        if not evaluated.is_evaluated:
            raise GeometryError(
                f'"{obj.name}" is disabled in viewports or excluded from the view layer; enable it first'
            )
        world_scale(obj)  # raises if it is 0
        # Adding a mesh to bpy.data would redraw the viewports.
        mesh = evaluated.to_mesh(preserve_all_data_layers=True, depsgraph=depsgraph)
        try:
            if not mesh.polygons:
                raise GeometryError(_lacking(obj, "no faces", "choose an object with a surface", obj.data.polygons))
            if uv_map is not None:
                uv_map = _uv_map(obj, mesh, uv_map)
            polygons = values_of(mesh.loop_triangle_polygons, "value", 1, np.int32).ravel()
            names = _material_arrays(mesh, obj, polygons)
            vertices, of_corner, normals, corners = _shape(mesh)
            if uv_map is None:
                uvs, in_uvs = np.array([[0, 0], [1, 0], [0, 1]], np.float32), np.zeros_like(corners) + np.arange(3)
            else:
                uvs, in_uvs = values_of(mesh.uv_layers[uv_map].uv, "vector", 2), corners
        finally:
            evaluated.to_mesh_clear()
    arrays: dict[str, _Array] = {
        "world_from_object": np.array(turn @ obj.matrix_world if turn else obj.matrix_world, dtype=np.float64),
        "triangle_polygon": polygons,
        **names,
        "vertices": vertices,
        "triangles": (of_corner, corners),
        "corner_normals": (normals, corners),
        "uvs": (uvs, in_uvs),
    }
    used = names["materials"][np.unique(names["triangle_material"][0])]
    return BegunMesh(uv_map or "", frozenset(used.tolist()), _written(path, arrays))


def write_surfaces(path: Path, depsgraph: Any, objects: Iterable[Any]) -> None:
    """Write the surfaces of objects, with modifiers and instances as in the viewport, as one mesh in world space.

    Only their shape is written. Raises InputError if they have none, or too many triangles to be written while a window
    waits.
    """
    wanted, meshes, count = set(objects), [], 0
    for instance in depsgraph.object_instances:
        evaluated = instance.object
        if (instance.parent or evaluated).original not in wanted or evaluated.type not in SURFACES:
            continue
        if evaluated.original.hide_render:  # in an instanced collection
            continue
        mesh = evaluated.to_mesh()
        if mesh is None or not mesh.polygons:
            evaluated.to_mesh_clear()
            continue
        vertices, of_corner, normals, corners = _shape(mesh)
        evaluated.to_mesh_clear()
        count += len(corners)
        if count > MAX_TRIANGLES:
            raise GeometryError(f"the scene has more than {MAX_TRIANGLES:,} triangles; hide what need not be seen")
        uvs = np.zeros((len(corners), 3, 2), np.float32)
        pose = np.array(instance.matrix_world, np.float64)
        meshes.append(Mesh(vertices, of_corner[corners], normals[corners], uvs, world_from_object=pose))
    if not meshes:
        raise GeometryError("no object of the photo has a surface; show the object, also in renders")
    joined = join_meshes(meshes)
    names = ("world_from_object", "vertices", "triangles", "corner_normals", "uvs")
    for _ in _written(path, {name: getattr(joined, name) for name in names}):
        pass


# An array to write, or a pair of values and indices, whose gather is written.
_Array = NDArray[Any] | tuple[NDArray[Any], NDArray[np.integer[Any]]]


def _written(path: Path, arrays: Mapping[str, _Array]) -> Slices:
    """Write arrays as a mesh file like ``np.savez``, some rows at a time."""
    head = {"format": np.array("mpsnet-mesh"), "version": np.array(1)}
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in {**head, **arrays}.items():
            values, rows = array if isinstance(array, tuple) else (array, None)
            whole = np.atleast_1d(values) if rows is None else rows
            shape = values.shape if rows is None else (*rows.shape, *values.shape[1:])
            described = {"descr": np.lib.format.dtype_to_descr(values.dtype), "fortran_order": False, "shape": shape}
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array_header_1_0(file, described)
                for start in range(0, len(whole), _ROWS_A_SLICE):
                    part = whole[start : start + _ROWS_A_SLICE]
                    file.write((part if rows is None else values[part]).tobytes())
                    yield False


def as_rendered(obj: Any) -> list[tuple[Any, str, Any]]:
    """The render settings of an object's modifiers as those of the viewport, for :func:`.temporarily`.

    The add-on's own displacement is off.
    """
    own = [find_modifier(obj, name) for name in (SMOOTHNESS, SUBDIVISION, DISPLACE)]
    settings: list[tuple[Any, str, Any]] = []
    for modifier in obj.modifiers:
        if modifier in own:
            settings.append((modifier, "show_viewport", False))
            continue
        for shown, rendered in _SHOWN_AND_RENDERED:
            if hasattr(modifier, shown) and hasattr(modifier, rendered):
                settings.append((modifier, shown, getattr(modifier, rendered)))
    return settings


def slot_labels(obj: Any) -> list[str]:
    """For each of an object's material slots, the name of its material for the core; at least one.

    For a material that has yet to be created, its future name.
    """
    return [_label(slot.material, obj) for slot in obj.material_slots] or [_label(None, obj)]


def _material_arrays(mesh: Any, obj: Any, polygons: NDArray[np.int32]) -> dict[str, Any]:
    """The arrays of object and material names for the core's mesh file, from an evaluated mesh.

    polygons: (T,) polygon of each triangle. Arrays per triangle are pairs or views, for :func:`_written`.
    """
    by_object = {number: slot.material for number, slot in enumerate(obj.material_slots) if slot.link == "OBJECT"}
    labels = [_label(by_object.get(number, one), obj) for number, one in enumerate(mesh.materials)]
    labels = labels or [_label(None, obj)]
    of_polygon = np.zeros(len(mesh.polygons), np.int32)
    if "material_index" in mesh.attributes:  # much faster than the triangles' own
        of_polygon = values_of(mesh.attributes["material_index"].data, "value", 1, np.int32).ravel()
    names = list(dict.fromkeys(labels))
    slots = np.array([names.index(label) for label in labels], np.int32)
    of_polygon = np.minimum(of_polygon, len(slots) - 1)  # as Blender clamps indices beyond the last slot
    return {
        "materials": np.array(names, str),
        "triangle_material": (slots[of_polygon], polygons),
        "objects": np.array([obj.name], str),
        "triangle_object": np.broadcast_to(np.int32(0), polygons.shape),
    }


def _label(material: Any, obj: Any) -> str:
    # Linked materials may have the same name as one of this file.
    return material.name_full if material else f"MPS {obj.name}"


def _lacking(obj: Any, what: str, mend: str, before: Any) -> str:
    """A sentence on what an object lacks in a render. before: the same of the object without its modifiers."""
    if before:
        return f'the modifiers of "{obj.name}" leave {what}; Geometry Nodes need Realize Instances and a UV map'
    return f'"{obj.name}" has {what}; {mend}'


def _uv_map(obj: Any, mesh: Any, name: str) -> str:
    if not mesh.uv_layers:
        raise GeometryError(_lacking(obj, "no UV map", "unwrap it first", obj.data.uv_layers))
    if not name:
        return next((layer.name for layer in mesh.uv_layers if layer.active_render), mesh.uv_layers[0].name)
    if name not in mesh.uv_layers:
        there = ", ".join(f'"{layer.name}"' for layer in mesh.uv_layers)
        raise GeometryError(f'"{obj.name}" has no UV map "{name}"; choose {there}')
    return name


def _shape(mesh: Any) -> tuple[NDArray[Any], ...]:
    """A mesh's vertices (V, 3), its corners' vertices (C,) and normals (C, 3), and its triangles' corners (T, 3)."""
    return (
        values_of(mesh.attributes["position"].data, "vector", 3),
        values_of(mesh.attributes[".corner_vert"].data, "value", 1, np.int32).ravel(),
        values_of(mesh.corner_normals, "vector", 3),
        values_of(mesh.loop_triangles, "loops", 3, np.int32),
    )
