"""The scene's own objects as subjects of samples: snapshots as a render sees them, scaled to radius 1."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from mpsnet_core.errors import FileError, GeometryError, InputError
from mpsnet_core.io.files import existing_file
from mpsnet_core.synthesis.scene_description import SceneDescription

from ...errors import operator_report
from ...photo.studio import refuse_glow
from ...scene.mesh_file import as_rendered


@dataclass(frozen=True)
class SceneObjects:
    """Snapshots of objects and instances in a common space: centred, with a bounding sphere of radius 1."""

    meshes: list[tuple[Any, Matrix]]
    """Each with the matrix to that space."""
    vertices: NDArray[np.float64]
    """(V, 3) of all meshes together."""
    triangles: NDArray[np.int32]
    """(T, 3) of all meshes together."""


def open_objects(path: Path, names: Sequence[str]) -> SceneObjects:
    """Open a .blend file and take snapshots of the named objects at its current frame.

    They include modifiers, but no hair and no volumes. Their materials' displacement becomes bump, and the materials'
    pass indices are numbered from 0.

    Raises InputError if the file or an object is missing, has no surface, or glows.
    """
    path = existing_file(path, "scene")
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        reason = operator_report(error)
        raise FileError(f"{path} cannot be opened ({reason}); make the samples in a new folder") from None
    objects = bpy.context.scene.objects
    missing = [name for name in names if name not in objects]
    if missing:
        raise InputError(f'{path} has no object "{missing[0]}"; make the samples in a new folder')
    wanted = [objects[name] for name in names]
    owners, meshes = set(), []
    with ExitStack() as stack:
        for obj in wanted:
            stack.enter_context(as_rendered(obj))
        depsgraph = bpy.context.evaluated_depsgraph_get()
        for instance in depsgraph.object_instances:
            owner = (instance.parent or instance.object).original
            if owner not in wanted or instance.object.type != "MESH":
                continue  # text and curves yield separate mesh instances
            refuse_glow(instance.object, owner.name)
            mesh = bpy.data.meshes.new_from_object(instance.object, preserve_all_data_layers=True, depsgraph=depsgraph)
            if not mesh.polygons:
                bpy.data.meshes.remove(mesh)
                continue
            for number, slot in enumerate(instance.object.material_slots):
                if slot.link == "OBJECT" and number < len(mesh.materials):
                    mesh.materials[number] = slot.material and slot.material.original
            if not mesh.materials:
                mesh.materials.append(None)
            owners.add(owner)
            meshes.append((mesh, instance.matrix_world.copy()))
    for obj in wanted:
        if obj not in owners:
            raise GeometryError(
                f'"{obj.name}" in {path} has no surface or is hidden in viewports; make the samples in a new folder'
            )
    return _at_unit_size(meshes)


def _at_unit_size(meshes: list[tuple[Any, Matrix]]) -> SceneObjects:
    clouds, triangles, count = [], [], 0
    for mesh, matrix in meshes:
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        world = np.array(matrix)
        clouds.append(points.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3])
        mesh.calc_loop_triangles()
        corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("vertices", corners)
        triangles.append(corners.reshape(-1, 3) + count)
        count += len(mesh.vertices)
    vertices = np.concatenate(clouds)
    used = vertices[np.unique(np.concatenate(triangles))]
    middle = (used.min(axis=0) + used.max(axis=0)) / 2
    radius = float(np.linalg.norm(used - middle, axis=1).max())
    if radius == 0:
        raise GeometryError("the chosen objects are a single point; choose some with a surface")
    to_unit = Matrix.Scale(1 / radius, 4) @ Matrix.Translation(-middle)
    _number_materials(mesh for mesh, _ in meshes)
    return SceneObjects(
        [(mesh, to_unit @ matrix) for mesh, matrix in meshes], (vertices - middle) / radius, np.concatenate(triangles)
    )


def _number_materials(meshes: Any) -> None:
    plain = None
    used = []
    for mesh in meshes:
        for slot, material in enumerate(mesh.materials):
            if material is None:
                plain = plain or bpy.data.materials.new("MPS Plain")
                mesh.materials[slot] = material = plain
            used.append(material)
    for number, material in enumerate(dict.fromkeys(used)):
        material.pass_index = number
        material.displacement_method = "BUMP"


def add_objects(
    scene: Any, recipe: SceneDescription, objects: SceneObjects
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Add the rotated objects to the scene. Returns their triangles in world space."""
    turn = bpy.data.objects.new("MPS Turn", None)
    turn.matrix_world = Matrix(recipe.rotation).to_4x4()
    scene.collection.objects.link(turn)
    for mesh, matrix in objects.meshes:
        obj = bpy.data.objects.new("MPS Sample", mesh)
        obj.parent, obj.matrix_parent_inverse = turn, matrix  # a parent's matrix may shear, an object's own may not
        scene.collection.objects.link(obj)
    return objects.vertices @ recipe.rotation.T, objects.triangles
