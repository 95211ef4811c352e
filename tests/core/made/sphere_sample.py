"""A sample made without a renderer: a Lambertian sphere of two materials under three white lights."""

from collections.abc import Sequence

import numpy as np
from synthetic import shaded_sphere

from mpsnet_core import Camera, Sample
from mpsnet_core.scene.rig import direction_from_angles
from mpsnet_core.synthesis.scene_description import Material, SceneDescription

WHITE = (0.8, 0.8, 0.8)
RED = (0.7, 0.2, 0.1)


def sphere_sample(
    size: int = 48, left: Sequence[float] = WHITE, right: Sequence[float] = WHITE, number: int = 0
) -> Sample:
    """The sphere's left half has the albedo `left`, its right half `right`; its rig has no symmetry."""
    sphere = shaded_sphere(size)
    directions = direction_from_angles([25.0, 35.0, 45.0], [80.0, 215.0, 330.0])
    is_right = np.broadcast_to(np.arange(size) >= size // 2, (size, size))
    albedo = np.where(is_right[..., None], right, left)
    shading = np.maximum(np.einsum("hwi,ki->khw", sphere.normals, directions), 0)
    pose = np.eye(4)
    pose[2, 3] = 3.5
    camera = Camera("perspective", size, size, np.array([1.6 * size, 1.6 * size]), None, pose)
    recipe = SceneDescription(
        seed=3,
        number=number,
        shape={"kind": "blobs", "seed": 11, "name": "sphère", "parts": [1.5, {"scale": 0.1}]},
        rotation=np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]),
        camera=camera,
        light_directions=directions,
        light_sizes=np.array([0.0, 1.5, 10.0]),
        materials=(Material(base_color=tuple(left)), Material("merl", source="blue-fabric", tint=(0.1, 0.2, 0.3))),
        bounces=1,
    )
    return Sample(
        lights=(shading[..., None] * albedo * sphere.mask[..., None]).astype(np.float32),
        normals=sphere.normals.astype(np.float32),
        depth=np.where(sphere.mask, 3.5 - sphere.normals[..., 2], 0).astype(np.float32),
        alpha=sphere.mask.astype(np.float32),
        material=np.where(sphere.mask, is_right, -1).astype(np.int32),
        lit=(shading > 0).astype(np.float32),
        recipe=recipe,
        renderer="a test",
    )
