"""What is clicked in the viewport is the place on the mesh that it shows, by Blender's own cameras."""

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Matrix

from blender_addon.panels.photo import MPS_PT_align
from blender_addon.photo.places import mesh_point, seen_at
from mpsnet_core.io.image_writing import write_image

REGION = (640, 360)


@pytest.fixture(params=["PERSP", "ORTHO"])
def view(scene, request):
    """A monkey that is moved, turned and smoothed, a camera that sees it, and the matrix that Blender draws it with."""
    bpy.ops.mesh.primitive_monkey_add()
    monkey = bpy.context.object
    monkey.matrix_world = Matrix.LocRotScale((3, -1, 2), Euler((0.3, -0.2, 0.9)), (1.5, 0.7, 1.0))
    monkey.modifiers.new("Smooth", "SUBSURF").levels = 1
    camera = bpy.data.objects.new("Eye", bpy.data.cameras.new("Eye"))
    camera.data.type, camera.data.ortho_scale = request.param, 5
    camera.matrix_world = Matrix.Translation((3.5, -9, 4)) @ Euler((1.3, 0, 0.05)).to_matrix().to_4x4()
    scene.collection.objects.link(camera)
    scene.render.resolution_x, scene.render.resolution_y = REGION
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    return (
        monkey,
        camera,
        camera.calc_matrix_camera(depsgraph, x=REGION[0], y=REGION[1]) @ camera.matrix_world.inverted(),
    )


def test_a_click_finds_what_is_seen_there_and_it_is_drawn_where_it_was_clicked(view, scene):
    monkey, camera, matrix = view
    depsgraph = bpy.context.evaluated_depsgraph_get()
    evaluated = monkey.evaluated_get(depsgraph)
    front = hidden = 0
    straight = evaluated.matrix_world.to_3x3().inverted().transposed()
    evaluated.data.calc_loop_triangles()
    for face in evaluated.data.loop_triangles:
        world = evaluated.matrix_world @ face.center
        if abs((straight @ face.normal).normalized().dot((world - camera.matrix_world.translation).normalized())) < 0.1:
            continue  # on edge, where the smallest error misses it
        across, up, depth = world_to_camera_view(scene, camera, world)
        place = seen_at(world, matrix, REGION)
        np.testing.assert_allclose(place, (across * REGION[0], up * REGION[1]), atol=0.01)
        found = mesh_point(monkey, depsgraph, matrix, REGION, place)
        assert found is not None
        if (found - world).length < 1e-3:
            front += 1
            continue
        hidden += 1
        assert world_to_camera_view(scene, camera, found).z < depth + 1e-3
        np.testing.assert_allclose(seen_at(found, matrix, REGION), place, atol=0.02)
    assert front > 50 and hidden > 50
    assert mesh_point(monkey, depsgraph, matrix, REGION, (2, 2)) is None


def test_a_script_and_a_panel_with_too_few_points_are_reported_what_to_do(scene, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    write_image(tmp_path / "photo.exr", np.full((8, 8, 3), 0.5, np.float32))
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "photo.exr"))
    with pytest.raises(RuntimeError, match=r"a script adds them to scene\.mps\.photo\.image\.mps\.pairs"):
        bpy.ops.mps.pick_points()
    bpy.ops.mps.add_rig()
    assert MPS_PT_align.lacks(bpy.context) == ""
    for _ in range(3):
        scene.mps.photo.image.mps.pairs.add()
    assert MPS_PT_align.lacks(bpy.context).startswith("4 points are the least: pick 1 more")
