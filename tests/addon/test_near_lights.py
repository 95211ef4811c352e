"""Lights close to the object, rendered by Cycles: where they stand and how they fall off, as the core knows them."""

import bpy
import numpy as np
import pytest

from mpsnet_core import LightRig, angular_error, read_camera, read_normals, read_rig, write_rig

SIZE = 96


def photographed(tmp_path, scene):
    """The unit sphere's photo: true normals, and where all three lights reach it well, by arithmetic of our own."""
    bpy.ops.mps.render_photo(width=SIZE, height=SIZE, samples=16, output=str(tmp_path / "photo.exr"))
    camera = read_camera(tmp_path / "photo.camera.json")
    y, x = np.mgrid[:SIZE, :SIZE].reshape(2, -1) + 0.5
    origins, rays = camera.rays(np.stack([x, y], axis=-1))
    b = np.einsum("ni,ni->n", origins, rays)
    inside = b**2 - np.einsum("ni,ni->n", origins, origins) + 1
    points = origins + rays * (-b - np.sqrt(np.maximum(inside, 0)))[:, None]
    lit = inside > 0.02
    for light in (light.object for light in scene.mps.rig.lights):
        place = np.array(light.matrix_world.translation)
        towards = place - (0 if light.data.type == "SUN" else points)
        lit &= np.einsum("ni,ni->n", np.broadcast_to(towards, points.shape), points) > 0.05 * np.linalg.norm(place)
    return (points @ camera.rotation).reshape(SIZE, SIZE, 3), lit.reshape(SIZE, SIZE)


def error(tmp_path, truth, lit, **options):
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.exr"), **options)
    return float(angular_error(read_normals(tmp_path / "normals.exr").vectors, truth)[lit].mean())


@pytest.mark.parametrize("kind", ["AREA", "POINT"])
def test_lights_at_one_and_a_half_times_the_objects_size_cost_the_baseline_little(sphere, scene, tmp_path, kind):
    bpy.ops.mps.add_rig(projection="PERSPECTIVE", focal_length=50)
    truth, lit = photographed(tmp_path, scene)
    assert lit.sum() > 1000
    distant = error(tmp_path, truth, lit)

    sphere.select_set(True)
    bpy.ops.mps.add_rig(light_type="AREA", distance=3)
    for light in scene.mps.rig.lights if kind == "POINT" else ():
        light.object.data.type = "POINT"
        light.object.data.shadow_soft_size = 0.01
    truth, lit = photographed(tmp_path, scene)
    rig = read_rig(tmp_path / "photo.rig.json")
    assert rig.near is not None and rig.near.lobe == (kind == "AREA")
    assert scene.mps.estimate.surface == sphere
    assert lit.sum() > 700
    near = error(tmp_path, truth, lit)
    assert near <= 1.2 * max(distant, 0.1), f"{near} under near lights, {distant} under distant ones"

    # Taken as distant, or the ball as flat, it is wrong by far more.
    scene.mps.estimate.surface = None
    assert error(tmp_path, truth, lit) > 10 * near
    write_rig(tmp_path / "distant.json", LightRig(rig.directions, rig.mixing))
    assert error(tmp_path, truth, lit, rig_file=str(tmp_path / "distant.json")) > 10 * near
