"""The mixing matrix against Cycles: grey balls with gloss over a table that throws light back."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Vector

from mpsnet_core.capture.calibrate.ball import distant_camera
from mpsnet_core.capture.calibrate.circles import find_balls
from mpsnet_core.capture.calibrate.mixing import mixing_from_ball
from mpsnet_core.io.image import Image, linear_to_srgb, srgb_to_linear
from mpsnet_core.io.image_reading import read_image
from mpsnet_core.scene.rig import LightRig, direction_from_angles

SIDE = 320
ANGLES = [(35, 100), (30, 215), (40, 325)]
# What the rig file says of the same lights.
TOLD = [(36.5, 97.5), (31.5, 218), (38.2, 326.5)]
MIXING = np.array([[1.0, 0.2, 0.1], [0.15, 0.8, 0.25], [0.05, 0.3, 0.7]])


def grey(name: str, colour: float, roughness: float) -> "bpy.types.Material":
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = (colour, colour, colour, 1)
    shader.inputs["Roughness"].default_value = roughness
    return material


@pytest.mark.parametrize(("colour", "roughness"), [(0.5, 0.9), (0.3, 0.5), (0.4, 0.3)])
def test_a_grey_ball_determines_the_matrix_to_a_tenth_or_that_it_does_not(
    scene, tmp_path: Path, colour: float, roughness: float
) -> None:
    bpy.ops.mesh.primitive_uv_sphere_add(segments=128, ring_count=64, radius=1)
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(grey("Ball", colour, roughness))
    bpy.ops.mesh.primitive_plane_add(size=8, location=(0, 0, -1.6))
    bpy.context.object.data.materials.append(grey("Table", 0.1, 0.9))
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
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 48, False
    scene.render.resolution_x = scene.render.resolution_y = SIDE
    if bpy.app.version >= (5, 0):
        scene.render.image_settings.media_type = "IMAGE"
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = str(tmp_path / "ball.exr")
    bpy.ops.render.render(write_still=True)

    pixels = read_image(tmp_path / "ball.exr").pixels
    pixels = pixels / np.percentile(pixels, 99.5)
    pixels = srgb_to_linear(np.rint(linear_to_srgb(pixels) * 255) / 255).astype(np.float32)
    ball = find_balls(pixels, distant_camera(SIDE, SIDE), mirror=False)[0]
    found = mixing_from_ball(Image(pixels, None, 1.0), ball, LightRig(direction_from_angles(*np.transpose(TOLD))))
    print(f"off by {np.abs(found.mixing - MIXING).max():.3f}, ± {found.uncertainty:.3f}\n{found.mixing}")
    assert found.determined or roughness < 0.9
    assert not found.determined or np.abs(found.mixing - MIXING).max() < 0.1
