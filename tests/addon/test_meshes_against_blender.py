"""Mesh files stand and are shaded as in Blender after its own importers read them."""

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from mpsnet_core.scene.mesh import read_mesh

# A roof of two quads whose ridge is a seam of the UVs, and a third quad, bent, beside it.
PLACES = "v -1 -1 -0.6\nv 0 -1 0\nv 1 -1 -0.6\nv -1 1 -0.6\nv 0 1 0\nv 1 1 -0.6\nv 2 -1 -0.6\nv 2 1 0.3\n"
UVS = "vt 0 0\nvt 0.4 0\nvt 0.4 1\nvt 0 1\nvt 0.5 0\nvt 0.9 0\nvt 0.9 1\nvt 0.5 1\n"
NORMALS = "vn 0 0 1\nvn 0.6 0 0.8\nvn 0 0 0\n"
LEFT, RIGHT, BENT = "f 1/1 2/2 5/3 4/4", "f 2/5 3/6 6/7 5/8", "f 3/1 7/2 8/3 6/4"
GIVEN = "f 1/1/1 2/2/1 5/3/1 4/4/1"
OBJ = {
    "nothing said": [LEFT, RIGHT, BENT],
    "off": ["s off", LEFT, "s 0", RIGHT, BENT],
    "one": ["s 1", LEFT, RIGHT, BENT],
    "two": ["s 2", LEFT, "g a", RIGHT, "usemtl b", BENT],
    "mixed": ["s 1", LEFT, RIGHT, "s off", BENT],
    "later": [LEFT, "s 1", RIGHT, BENT],
    "no number": ["s on", LEFT, "s", RIGHT, "s null", BENT],
    "negative": ["s -1", LEFT, RIGHT, BENT],
    "objects": ["s 1", "o a", LEFT, RIGHT, "o b", "s 3", BENT],
    "objects apart": ["o a", "s 1", LEFT, "o b", "s 1", RIGHT, BENT],
    "normals": ["s off", NORMALS + GIVEN, "f 2/5/2 3/6/2 6/7/2 5/8/1", BENT],
    "some normals": ["s off", NORMALS + GIVEN, RIGHT, BENT],
    "some objects' normals": ["o a", NORMALS + GIVEN, "o b", RIGHT, BENT],
    "normals of no length": [NORMALS + GIVEN.replace("/1 ", "/3 ")[:-1] + "3", RIGHT, BENT],
}


def corners_here(path: Path) -> np.ndarray:
    """(N, 6) positions and normals."""
    mesh = read_mesh(path)
    normals = mesh.corner_normals @ mesh.normals_to_world
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.concatenate([mesh.world_vertices[mesh.triangles], normals], axis=-1).reshape(-1, 6)


def corners_in_blender() -> np.ndarray:
    """The same of all objects in the scene."""
    found = []
    graph = bpy.context.evaluated_depsgraph_get()
    for instance in graph.object_instances:
        if instance.object.type != "MESH":
            continue
        mesh, pose = instance.object.data, np.array(instance.matrix_world)
        places, normals = np.empty((len(mesh.vertices), 3)), np.empty((len(mesh.loops), 3))
        vertices = np.empty(len(mesh.loops), int)
        mesh.vertices.foreach_get("co", places.ravel())
        mesh.corner_normals.foreach_get("vector", normals.ravel())
        mesh.loops.foreach_get("vertex_index", vertices)
        normals = normals @ np.linalg.inv(pose[:3, :3])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        found.append(np.concatenate([places[vertices] @ pose[:3, :3].T + pose[:3, 3], normals], axis=1))
    return np.concatenate(found)


def are_alike(own: np.ndarray, blenders: np.ndarray) -> None:
    """Each corner of one is a corner of the other. Blender stores normals in 16 bits."""
    apart = np.abs(own[:, None] - blenders).max(axis=-1)
    assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 5e-3


@pytest.mark.parametrize("name", OBJ)
def test_obj(scene, tmp_path, name):
    path = tmp_path / "mesh.obj"
    path.write_text(PLACES + UVS + "\n".join(OBJ[name]) + "\n")
    bpy.ops.wm.obj_import(filepath=str(path), forward_axis="Y", up_axis="Z")
    are_alike(corners_here(path), corners_in_blender())


def edited(path: Path, edit: Callable[[dict[str, Any]], None]) -> None:
    """Change the JSON part of a GLB file."""
    data = path.read_bytes()
    end = 20 + struct.unpack("<I", data[12:16])[0]
    header = json.loads(data[20:end])
    edit(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + data[end:]
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def drop_normals(of: list[int]) -> Callable[[dict[str, Any]], None]:
    def edit(header: dict[str, Any]) -> None:
        for number in of:
            del header["meshes"][number]["primitives"][0]["attributes"]["NORMAL"]

    return edit


@pytest.mark.parametrize(
    ("edit", "options"),
    [
        (drop_normals([]), {}),
        (drop_normals([0, 1]), {}),
        (drop_normals([1]), {}),
        (drop_normals([]), {"export_gpu_instances": True}),
        (drop_normals([]), {"export_tangents": True, "export_yup": False}),
    ],
    ids=["normals", "no normals", "some normals", "instances", "tangents"],
)
def test_glb(scene, tmp_path, edit, options):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=7, ring_count=5, location=(1, 2, 3), rotation=(0.3, 0.1, 0.2))
    bpy.ops.object.shade_smooth()
    ball = bpy.context.object
    for place in ((4, 0, 0), (0, 4, 1)):  # which share its mesh
        copy = ball.copy()
        copy.location, copy.scale = place, (1.5, 1.5, -1.5)
        scene.collection.objects.link(copy)
    bpy.ops.mesh.primitive_cone_add(vertices=5, location=(-3, 0, 0), scale=(1, 2, 0.5))
    path = tmp_path / "mesh.glb"
    bpy.ops.export_scene.gltf(filepath=str(path), **options)
    edited(path, edit)
    _imported_alone(scene, path)
    own = corners_here(path)
    are_alike(own[:, [0, 2, 1, 3, 5, 4]] * (1, -1, 1, 1, -1, 1), corners_in_blender())


def test_glb_with_shape_keys(scene, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    cube = bpy.context.object
    cube.shape_key_add(name="Basis")
    for name, value in (("up", 0.7), ("off", 0.0), ("side", 0.4)):
        key = cube.shape_key_add(name=name)
        key.value = value
        for point in key.data[:4]:
            point.co.x, point.co.z = point.co.x + len(name), point.co.z + 1
    path = tmp_path / "mesh.glb"
    bpy.ops.export_scene.gltf(filepath=str(path), export_morph_normal=False)
    _imported_alone(scene, path)
    own, blenders = corners_here(path)[:, [0, 2, 1]] * (1, -1, 1), corners_in_blender()[:, :3]
    are_alike(own, blenders)


def _imported_alone(scene: bpy.types.Scene, path: Path) -> None:
    for obj in list(scene.objects):
        bpy.data.objects.remove(obj)
    bpy.ops.import_scene.gltf(filepath=str(path))
