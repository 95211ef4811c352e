"""An object's mesh as the core's mesh file: as a render sees it, with Blender's own normals and tangents."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from mpsnet_core.errors import InputError

from .textures import material_arrays

# What a modifier shows in the viewport, and what in a render.
_SHOWN_AND_RENDERED = (
    ("show_viewport", "show_render"),
    ("levels", "render_levels"),
    ("steps", "render_steps"),
    ("viewport_resolution", "resolution"),
)
# What `mps.displace` gives an object. Textures are baked onto the object without them, and heights are of that.
SUBDIVISION, DISPLACE = "MPS Subdivision", "MPS Displace"


def write_mesh(path: Path, obj: Any, depsgraph: Any, uv_map: str | None, turn: Matrix | None = None) -> str:
    """Write an object as the render sees it, modifiers applied, as the core's mesh file; give the UV map's name.

    Normals and tangents of each corner are Blender's own. uv_map: "" for the one that is active for rendering, None
    where only the shape counts. turn: brings Blender's world into that of the cameras, where they differ.

    Raises InputError where the object is no mesh, has no faces, lacks the UV map or is disabled in viewports.
    """
    if obj.type != "MESH":
        raise InputError(f'"{obj.name}" is not a mesh but {obj.type.lower()}; convert it to a mesh first')
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    obj.data.update_tag()
    with as_rendered(obj):
        depsgraph.update()
        evaluated = obj.evaluated_get(depsgraph)
        if not evaluated.is_evaluated:
            raise InputError(f'"{obj.name}" is disabled in viewports or excluded from the view layer; enable it first')
        mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=depsgraph)
    try:
        if uv_map is not None:
            uv_map = _uv_map(obj, mesh, uv_map)
        if not mesh.polygons:
            raise InputError(f'"{obj.name}" has no faces; choose an object with a surface')
        corners = _read(mesh.loop_triangles, "loops", 3, np.int32)
        normals = _read(mesh.corner_normals, "vector", 3)[corners]
        names = material_arrays(mesh, obj)
        triangles = _read(mesh.loop_triangles, "vertices", 3, np.int32)
        vertices = _read(mesh.vertices, "co", 3)
        layout: dict[str, NDArray[Any]] = {}
        if uv_map is None:
            layout["uvs"] = np.tile(np.array([[0, 0], [1, 0], [0, 1]], np.float32), (len(triangles), 1, 1))
        else:
            layout["uvs"] = _read(mesh.uv_layers[uv_map].uv, "vector", 2)[corners]
            if _read(mesh.polygons, "loop_total", 1, np.int32).max() > 4:
                layout["tangents"] = _tangents_of_triangles(vertices, triangles, normals, layout["uvs"])
            else:
                mesh.calc_tangents(uvmap=uv_map)
                layout["tangents"] = _tangents(mesh)[corners]
        np.savez(
            path,
            format=np.array("mpsnet-mesh"),
            version=np.array(1),
            vertices=vertices,
            triangles=triangles,
            corner_normals=normals,
            world_from_object=np.array(turn @ obj.matrix_world if turn else obj.matrix_world, dtype=np.float64),
            **layout,
            **names,
        )
    finally:
        bpy.data.meshes.remove(mesh)
    return uv_map or ""


def used_materials(path: Path) -> frozenset[str]:
    """The names of the materials that the faces of a mesh file have, see :func:`.textures.slot_labels`."""
    with np.load(path) as mesh:
        return frozenset(mesh["materials"][np.unique(mesh["triangle_material"])].tolist())


@contextmanager
def as_rendered(obj: Any) -> Iterator[None]:
    """Within, the object's modifiers show in the viewport, and so in the dependency graph, what a render shows; without
    the displacement that the add-on made."""
    kept = []
    try:
        for modifier in obj.modifiers:
            if modifier.name in (SUBDIVISION, DISPLACE):
                kept.append((modifier, "show_viewport", modifier.show_viewport))
                modifier.show_viewport = False
                continue
            for shown, rendered in _SHOWN_AND_RENDERED:
                if hasattr(modifier, shown) and hasattr(modifier, rendered):
                    kept.append((modifier, shown, getattr(modifier, shown)))
                    setattr(modifier, shown, getattr(modifier, rendered))
        yield
    finally:
        for modifier, shown, value in kept:
            setattr(modifier, shown, value)


def _uv_map(obj: Any, mesh: Any, name: str) -> str:
    if not mesh.uv_layers:
        raise InputError(f'"{obj.name}" has no UV map; unwrap it first')
    if not name:
        return next((layer.name for layer in mesh.uv_layers if layer.active_render), mesh.uv_layers[0].name)
    if name not in mesh.uv_layers:
        there = ", ".join(f'"{layer.name}"' for layer in mesh.uv_layers)
        raise InputError(f'"{obj.name}" has no UV map "{name}"; choose {there}')
    return name


def _read(elements: Any, attribute: str, width: int, kind: type = np.float32) -> NDArray[Any]:
    values: NDArray[Any] = np.empty(len(elements) * width, kind)
    elements.foreach_get(attribute, values)
    return values.reshape(-1, width)


def _tangents(mesh: Any) -> NDArray[np.float32]:
    """(loops, 4): tangent and bitangent sign, once ``calc_tangents`` has run."""
    return np.hstack([_read(mesh.loops, "tangent", 3), _read(mesh.loops, "bitangent_sign", 1)])


def _tangents_of_triangles(
    vertices: NDArray[Any], triangles: NDArray[Any], normals: NDArray[Any], uvs: NDArray[Any]
) -> NDArray[np.float32]:
    """(T, 3, 4): Blender has no tangents for faces with five sides and more, so they come from a triangulated copy."""
    mesh = bpy.data.meshes.new("MPS Triangles")
    try:
        mesh.from_pydata(vertices.tolist(), [], triangles.tolist())
        layer = mesh.uv_layers.new(name="UVMap")
        layer.uv.foreach_set("vector", uvs.ravel())
        mesh.normals_split_custom_set(normals.reshape(-1, 3).tolist())
        mesh.calc_tangents(uvmap="UVMap")
        return _tangents(mesh).reshape(-1, 3, 4)
    finally:
        bpy.data.meshes.remove(mesh)
