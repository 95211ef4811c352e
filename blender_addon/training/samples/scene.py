"""A recipe as a separate Blender scene: the object, the camera, and three white suns in light groups.

Each Cycles sample picks one of the lights at random. The Sobol sequence distributes every four samples evenly among
four lights, but not among three. A fourth, almost black sun therefore removes the noise of that choice: on a matt
sphere with 64 samples, the error of equation 2's normals is 0.17° instead of 2.3°.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from mpsnet_core.scene.camera import FULL_FRAME, Camera
from mpsnet_core.synthesis.cycles import LIGHT_GROUPS
from mpsnet_core.synthesis.scene_description import SceneDescription
from mpsnet_core.synthesis.shapes import Shape

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
