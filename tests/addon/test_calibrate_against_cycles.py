"""Calibration against Cycles: mirror balls and area lights in a scene, their places known from its objects."""

import bpy
import numpy as np
from mathutils import Matrix, Vector

from blender_addon.scene.camera import scene_camera
from mpsnet_core.calibrate.circles import find_balls
from mpsnet_core.calibrate.highlights import find_coloured_highlights
from mpsnet_core.calibrate.lights import Sighting, find_lights
from mpsnet_core.io.image_reading import read_image

from .rendering import principled, rendered

SIZE = (960, 560)
RADIUS = 0.1
LAMP = 0.06  # its diameter
RED, GREEN, BLUE = (1.0, 0.3, 0.3), (0.3, 1.0, 0.3), (0.3, 0.3, 1.0)


def mirror_ball(place: tuple[float, float, float], material: "bpy.types.Material") -> "bpy.types.Object":
    bpy.ops.mesh.primitive_uv_sphere_add(segments=256, ring_count=128, radius=RADIUS, location=place)
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


def lamp(scene: "bpy.types.Scene", place: Vector, target: Vector, colour: tuple[float, float, float]) -> None:
    data = bpy.data.lights.new("Lamp", "AREA")
    data.shape, data.size, data.color = "DISK", LAMP, colour
    data.energy = np.pi**2 * (LAMP / 2) ** 2  # a radiance of 1
    obj = bpy.data.objects.new("Lamp", data)
    obj.location = place
    obj.rotation_euler = (place - target).to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(obj)


def test_lights_by_two_mirror_balls(scene, tmp_path):
    steel = principled("Steel", (0.55,) * 3, Metallic=1.0, Roughness=0.03)
    balls = [mirror_ball(place, steel) for place in ((-0.18, 0.02, 0.1), (0.17, -0.03, 0.1))]
    bpy.ops.mesh.primitive_plane_add(size=4)
    bpy.context.object.data.materials.append(principled("Table", (0.3,) * 3, Roughness=0.9))
    scene.world = bpy.data.worlds.new("Room")
    scene.world.color = (0.05, 0.05, 0.05)
    target = Vector((0, 0, 0.1))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.lens = 56
    camera.matrix_world = Matrix.LocRotScale(
        Vector((0.1, -0.75, 0.75)), (Vector((0.1, -0.75, 0.75)) - target).to_track_quat("Z", "Y"), None
    )
    scene.collection.objects.link(camera)
    scene.camera = camera
    places = [Vector((0.1, 0.3, 0.9)), Vector((-0.7, -0.3, 0.6)), Vector((0.6, -0.5, 0.5))]
    for place, colour in zip(places, (RED, GREEN, BLUE), strict=True):
        lamp(scene, place, target, colour)
    rendered(tmp_path / "balls.exr", *SIZE, samples=12)

    seen_by = scene_camera(camera, scene, SIZE)
    image = read_image(tmp_path / "balls.exr")
    found_balls = find_balls(image.pixels, seen_by, count=2, radius=RADIUS)
    found = find_lights([Sighting(b, find_coloured_highlights(image, b)) for b in found_balls])
    to_camera = np.linalg.inv(np.array(camera.matrix_world))

    def in_camera(point: Vector) -> np.ndarray:
        return to_camera[:3, :3] @ np.array(point) + to_camera[:3, 3]

    for ball, obj in zip(found_balls, balls, strict=True):
        assert np.linalg.norm(ball.centre - in_camera(obj.location)) < 0.005
    assert found.positions is not None
    true_places = np.array([in_camera(place) for place in places])
    away = true_places - found.target
    distance = np.linalg.norm(away, axis=1)
    off = np.linalg.norm(found.positions - true_places, axis=1) / distance
    cosines = np.einsum("ki,ki->k", found.directions, away) / distance
    degrees = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    print(f"positions off by {off} of their distance, directions by {degrees} degrees")
    assert off.max() < 0.02
    assert degrees.max() < 0.5
