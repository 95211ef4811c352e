"""A skinned mesh that Blender wrote into a GLB is read where it stood in Blender."""

import bpy
import numpy as np

from mpsnet_core.scene.mesh import read_mesh


def distinct(points: np.ndarray) -> np.ndarray:
    return np.unique(np.round(points, 3), axis=0)


def test_a_mesh_with_an_armature_stands_where_it_stood(scene, tmp_path, caplog):
    bpy.ops.mesh.primitive_cube_add(location=(1, 2, 3), rotation=(0.3, 0.1, 0.2))
    cube, bones = bpy.context.object, bpy.data.armatures.new("Rig")
    rig = bpy.data.objects.new("Rig", bones)
    scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for name, head, tail in (("low", (0, 0, 0), (0, 0.3, 1)), ("high", (0, 0.3, 1), (1, 0, 2))):
        bone = bones.edit_bones.new(name)
        bone.head, bone.tail = head, tail
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.location, rig.rotation_euler, rig.scale = (0.5, -2, 1), (0.5, 0.2, 0.1), (1.5, 1.5, 1.5)
    cube.parent = rig
    cube.modifiers.new("Armature", "ARMATURE").object = rig
    for name, vertices in (("low", [0, 1, 2, 3]), ("high", [4, 5, 6, 7])):
        cube.vertex_groups.new(name=name).add(vertices, 1, "REPLACE")
    bpy.context.view_layer.update()
    shown = cube.evaluated_get(bpy.context.evaluated_depsgraph_get())
    true = np.array([shown.matrix_world @ vertex.co for vertex in shown.data.vertices])

    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "rig.glb"))
    found = read_mesh(tmp_path / "rig.glb").world_vertices[:, [0, 2, 1]] * (1, -1, 1)  # glTF's y points up
    np.testing.assert_allclose(distinct(found), distinct(true), atol=2e-3)
    assert not [message for message in caplog.messages if "posed" in message]
