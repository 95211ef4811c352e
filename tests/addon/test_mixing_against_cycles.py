"""The mixing matrix against Cycles: grey balls with gloss over a table that throws light back."""

import bpy
import numpy as np
import pytest
from mathutils import Vector

from mpsnet_core.calibrate.circles import find_balls
from mpsnet_core.calibrate.mixing import mixing_from_ball
from mpsnet_core.io.image import Image, linear_to_srgb, srgb_to_linear
from mpsnet_core.scene.camera import pixel_camera
from mpsnet_core.scene.rig import LightRig, direction_from_angles

from .rendering import principled, rendered

SIDE = 320
ANGLES = [(35, 100), (30, 215), (40, 325)]
# What the rig file says of the same lights.
TOLD = [(36.5, 97.5), (31.5, 218), (38.2, 326.5)]
MIXING = np.array([[1.0, 0.2, 0.1], [0.15, 0.8, 0.25], [0.05, 0.3, 0.7]])


@pytest.mark.parametrize(("colour", "roughness"), [(0.5, 0.9), (0.3, 0.5), (0.4, 0.3)])
def test_a_grey_ball_determines_the_matrix_to_a_tenth_or_that_it_does_not(scene, tmp_path, colour, roughness):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=128, ring_count=64, radius=1)
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(principled("Ball", (colour,) * 3, Roughness=roughness))
    bpy.ops.mesh.primitive_plane_add(size=8, location=(0, 0, -1.6))
    bpy.context.object.data.materials.append(principled("Table", (0.1,) * 3, Roughness=0.9))
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale = "ORTHO", 2.4
    camera.location = (0, 0, 6)
    scene.collection.objects.link(camera)
    scene.camera = camera
    for (slant, tilt), lamp_colour in zip(ANGLES, MIXING.T, strict=True):
        data = bpy.data.lights.new("Lamp", "SUN")
        data.energy, data.angle, data.color = 2.0, 0.02, lamp_colour
        lamp = bpy.data.objects.new("Lamp", data)
        lamp.rotation_euler = Vector(direction_from_angles(slant, tilt)).to_track_quat("Z", "Y").to_euler()
        scene.collection.objects.link(lamp)
    pixels = rendered(tmp_path / "ball.exr", SIDE, SIDE, samples=48)[..., :3]
    pixels = pixels / np.percentile(pixels, 99.5)
    pixels = srgb_to_linear(np.rint(linear_to_srgb(pixels) * 255) / 255).astype(np.float32)
    ball = find_balls(pixels, pixel_camera(SIDE, SIDE), mirror=False)[0]
    found = mixing_from_ball(Image(pixels, None, 1.0), ball, LightRig(direction_from_angles(*np.transpose(TOLD))))
    print(f"off by {np.abs(found.mixing - MIXING).max():.3f}, ± {found.uncertainty:.3f}\n{found.mixing}")
    assert found.determined or roughness < 0.9
    assert not found.determined or np.abs(found.mixing - MIXING).max() < 0.1
