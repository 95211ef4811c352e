"""Meshes of integrated surfaces as Blender's own importers read them: where the camera saw them, and turned to it."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from height_shapes import ball

from mpsnet_core import Camera, surface_mesh, write_height, write_surface_mesh

# A camera that stands 20 before the world's origin, looks along +y and is 30 up: its right is x, its up z.
POSE = np.array([[1, 0, 0, 10.0], [0, 0, -1, -20], [0, 1, 0, 30], [0, 0, 0, 1]])
CAMERA = Camera("perspective", 90, 80, (120.0, 120.0), None, POSE)
RADIUS = 1.4
BALL = ball(CAMERA, (0.3, 0.1, -6), RADIUS)
MIDDLE = POSE[:3, :3] @ (0.3, 0.1, -6) + POSE[:3, 3]


def read(path: Path) -> bpy.types.Object:
    """The one object of a mesh file, read with the importer's own settings."""
    if path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path))
    elif path.suffix == ".obj":
        bpy.ops.wm.obj_import(filepath=str(path))
    else:
        bpy.ops.wm.ply_import(filepath=str(path))
    [found] = [thing for thing in bpy.context.scene.objects if thing.type == "MESH"]
    bpy.context.view_layer.update()
    return found


@pytest.fixture(autouse=True)
def empty_scene():
    bpy.ops.wm.read_factory_settings(use_empty=True)


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".obj"])
def test_a_surface_stands_where_the_camera_saw_it(tmp_path, suffix):
    made = surface_mesh(BALL.heights, BALL.normals, faces=2000)
    write_surface_mesh(tmp_path / f"m{suffix}", made)
    thing = read(tmp_path / f"m{suffix}")
    assert thing.name == "m"
    world = np.array(thing.matrix_world)
    turn, data = world[:3, :3], thing.data
    points = np.array([vertex.co for vertex in data.vertices]) @ turn.T + world[:3, 3]
    assert np.linalg.norm(points - MIDDLE, axis=1) == pytest.approx(RADIUS, abs=1e-4)
    assert len(data.polygons) == len(made.triangles)
    # The faces turn to the camera, and shading is as smooth as the normals that were put in.
    facing = np.array([polygon.normal for polygon in data.polygons]) @ turn.T
    middles = np.array([polygon.center for polygon in data.polygons]) @ turn.T + world[:3, 3]
    assert ((facing * (POSE[:3, 3] - middles)).sum(axis=1) > 0).all()
    corners = np.array([loop.vertex_index for loop in data.loops])
    shading = np.array([normal.vector for normal in data.corner_normals]) @ turn.T
    assert shading == pytest.approx((points[corners] - MIDDLE) / RADIUS, abs=2e-3)
    # The photo's UVs: where the camera sees each corner.
    x, y, w = CAMERA.projection_rows() @ np.c_[points[corners], np.ones(len(corners))].T
    uvs = np.array([uv.vector for uv in data.uv_layers.active.uv])
    assert uvs == pytest.approx(np.stack([x / w / 90, 1 - y / w / 80], axis=-1), abs=1e-4)


def test_without_a_camera_it_stands_upright(tmp_path):
    """Of a camera in its own space the picture's up becomes Blender's, in the formats that know what up is."""
    relief = ball(Camera("orthographic", 60, 40, (10.0, 10.0)), (0, 0, 0), 5)
    flat = surface_mesh(relief.heights, relief.normals)
    write_surface_mesh(tmp_path / "m.glb", flat, up="y")
    thing = read(tmp_path / "m.glb")
    size = np.ptp([thing.matrix_world @ vertex.co for vertex in thing.data.vertices], axis=0)
    assert size[0] == pytest.approx(5.9, abs=1e-4) and size[2] == pytest.approx(3.9, abs=1e-4) and size[1] < 3
    assert max((thing.matrix_world @ vertex.co).y for vertex in thing.data.vertices) < 0  # it faces -y, the front


@pytest.mark.parametrize("name", ["h.png", "h.exr", "h.tif"])
def test_blender_reads_heights_as_they_are_meant_and_displaces_by_them(tmp_path, name):
    """The file as a Non-Color texture on a plane's Displace modifier, with the strength and midlevel that are told."""
    camera = Camera("orthographic", 64, 64, (20.0, 20.0))
    relief = ball(camera, (0, 0, -1.5), 2.0)
    scale = write_height(tmp_path / name, relief.heights)
    image = bpy.data.images.load(str(tmp_path / name))
    image.colorspace_settings.name = "Non-Color"
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=63, y_subdivisions=63, size=63 / 20)
    thing = bpy.context.object
    texture = bpy.data.textures.new("heights", "IMAGE")
    texture.image, texture.use_interpolation, texture.extension = image, False, "EXTEND"
    modifier = thing.modifiers.new("heights", "DISPLACE")
    modifier.texture, modifier.texture_coords, modifier.direction = texture, "UV", "Z"
    modifier.strength, modifier.mid_level = scale.strength, scale.midlevel
    # Each vertex looks up the middle of its own pixel.
    uvs = thing.data.uv_layers.active
    for loop in thing.data.loops:
        x, y, _ = thing.data.vertices[loop.vertex_index].co
        uvs.uv[loop.index].vector = (x * 20 / 64 + 0.5, y * 20 / 64 + 0.5)
    moved = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    heights = np.full((64, 64), np.nan)
    for vertex in moved.vertices:
        x, y, z = vertex.co
        heights[round(32 - y * 20 - 0.5), round(x * 20 + 32 - 0.5)] = z
    off = np.abs(heights - relief.heights.values)[relief.mask]
    assert off.max() < 1e-3 + scale.strength / 65535
    # Beyond the outline it goes on, and nothing falls down to black.
    edge = relief.heights.values[relief.mask].min()
    assert heights.min() > edge - 1e-3
