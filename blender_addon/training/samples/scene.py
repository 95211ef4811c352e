"""A recipe as a separate Blender scene: the object, the camera, and three white suns in light groups.

The object is a generated shape or, scaled to radius 1, what a render sees of objects of a .blend file.

Each Cycles sample picks one of the lights at random. The Sobol sequence distributes every four samples evenly among
four lights, but not among three. A fourth, almost black sun therefore removes the noise of that choice: on a matt
sphere with 64 samples, the error of equation 2's normals is 0.17° instead of 2.3°.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from mpsnet_core.errors import GeometryError, InputError
from mpsnet_core.io.files import existing_file
from mpsnet_core.scene.camera import FULL_FRAME, Camera
from mpsnet_core.synthesis.cycles import LIGHT_GROUPS
from mpsnet_core.synthesis.scene_description import SceneDescription
from mpsnet_core.synthesis.shapes import Shape

from ...errors import operator_errors
from ...photo.studio import refuse_glow
from ...scene.mesh_file import as_rendered
from ...scene.objects import temporarily
from ...scene.surfaces import values_of
from .materials import PART, build_material

_ALL_BUT_BLACK = 1e-6  # Cycles skips black lights
_KINDS = ("scenes", "worlds", "objects", "meshes", "cameras", "lights", "materials", "node_groups", "images")


@contextmanager
def sample_scene(recipe: SceneDescription) -> Iterator[Any]:
    """A scene with the recipe's camera and lights alone. It is removed at the end, with everything added to it."""
    before = {data for kind in _KINDS for data in getattr(bpy.data, kind)}
    scene = bpy.data.scenes.new("MPS Sample")
    try:
        scene.view_layers[0].name = "ViewLayer"
        scene.camera = _add_camera(scene, recipe.camera)
        for name, direction, size in zip(LIGHT_GROUPS, recipe.light_directions, recipe.light_sizes, strict=True):
            scene.view_layers[0].lightgroups.add(name=name)
            _add_sun(scene, direction, math.pi, size).lightgroup = name
        _add_sun(scene, np.array([0, 0, -1]), _ALL_BUT_BLACK)
        yield scene
    finally:
        bpy.data.batch_remove([data for kind in _KINDS for data in getattr(bpy.data, kind) if data not in before])


def _add_camera(scene: Any, camera: Camera) -> Any:
    """The inverse of :func:`blender_addon.scene.camera.scene_camera`, for cameras with non-square pixels, too."""
    data = bpy.data.cameras.new("MPS Camera")
    data.sensor_fit, data.sensor_width = "HORIZONTAL", FULL_FRAME
    (fx, fy), width = camera.focal, camera.width
    if camera.projection == "orthographic":
        data.type, data.ortho_scale = "ORTHO", width / fx
    else:
        data.type, data.lens = "PERSP", fx * FULL_FRAME / width
    data.shift_x = (width / 2 - camera.centre[0]) / width
    data.shift_y = (camera.centre[1] - camera.height / 2) / width * fx / fy
    distance = camera.world_from_camera[2, 3]
    data.clip_start, data.clip_end = max(distance - 1.5, 0.01), distance + 10
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, camera.height, 100
    render.pixel_aspect_x, render.pixel_aspect_y = max(1.0, fy / fx), max(1.0, fx / fy)
    obj = bpy.data.objects.new("MPS Camera", data)
    obj.matrix_world = Matrix(camera.world_from_camera)
    scene.collection.objects.link(obj)
    return obj


def _add_sun(scene: Any, direction: NDArray[np.float64], irradiance: float, size: float = 0.0) -> Any:
    """A white sun with an angular diameter of `size` degrees."""
    data = bpy.data.lights.new("MPS Sun", "SUN")
    data.energy, data.angle = irradiance, math.radians(size)
    light = bpy.data.objects.new("MPS Sun", data)
    light.rotation_mode = "QUATERNION"
    light.rotation_quaternion = Vector(direction).to_track_quat("Z", "Y")
    scene.collection.objects.link(light)
    return light


def add_shape(scene: Any, recipe: SceneDescription, shape: Shape) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Add the rotated shape with the recipe's materials to the scene. Returns its triangles in world space."""
    mesh = _mesh(shape)
    mesh.materials.append(build_material(recipe))
    obj = bpy.data.objects.new("MPS Sample", mesh)
    obj.matrix_world = Matrix(recipe.rotation).to_4x4()
    scene.collection.objects.link(obj)
    return shape.vertices @ recipe.rotation.T, shape.triangles


def _mesh(shape: Shape) -> Any:
    """The shape as a mesh with one shading normal per vertex: vertices are split where normals differ.

    Cycles shades by vertex normals, and not all versions split a mesh's vertices by its corner normals.
    """
    normals = shape.corner_normals.reshape(-1, 3).astype(np.float32)
    corners = shape.triangles.reshape(-1)
    steps = np.rint(normals * 2**14).astype(np.int64) + 2**15
    key = ((corners.astype(np.int64) * 2**16 + steps[:, 0]) ^ (steps[:, 1] << 40)) * 0x9E3779B1 + steps[:, 2]
    _, first, split = np.unique(key, return_index=True, return_inverse=True)
    mesh = bpy.data.meshes.new("MPS Sample")
    mesh.vertices.add(len(first))
    mesh.vertices.foreach_set("co", shape.vertices[corners[first]].astype(np.float32).ravel())
    mesh.loops.add(len(corners))
    mesh.loops.foreach_set("vertex_index", split.ravel().astype(np.int32))
    mesh.polygons.add(len(shape.triangles))
    mesh.polygons.foreach_set("loop_start", np.arange(0, len(corners), 3, dtype=np.int32))
    mesh.attributes.new(PART, "INT", "FACE").data.foreach_set("value", shape.parts.astype(np.int32))
    mesh.update(calc_edges=True)
    mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", normals[first].ravel())
    return mesh


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
    with operator_errors(f"{path} cannot be opened", "make the samples in a new folder"):
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
    objects = bpy.context.scene.objects
    missing = [name for name in names if name not in objects]
    if missing:
        raise InputError(f'{path} has no object "{missing[0]}"; make the samples in a new folder')
    wanted = [objects[name] for name in names]
    owners, meshes = set(), []
    with ExitStack() as stack:
        for obj in wanted:
            stack.enter_context(temporarily(*as_rendered(obj)))
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
        world = np.array(matrix)
        clouds.append(values_of(mesh.vertices, "co", 3) @ world[:3, :3].T + world[:3, 3])
        mesh.calc_loop_triangles()
        triangles.append(values_of(mesh.loop_triangles, "vertices", 3, np.int32) + count)
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
