"""Ambient occlusion by horizons beside rays against the mesh (embree): how far off each is, and the time, as a ratio.

PYTHONPATH=tests/core/made python tests/benchmarks/ambient_occlusion.py
"""

import argparse
import time

import numpy as np
from height_shapes import Surface, bumps, orthographic
from surface_shapes import grid_triangles

from mpsnet_core import Camera
from mpsnet_core.relief.occlusion import ambient_occlusion
from mpsnet_core.scene.rays import RayScene


def by_rays(surface: Surface, rays: int, seed: int) -> np.ndarray:
    """The share of `rays` random rays from each pixel, spread by their cosine, that leave the surface."""
    points = surface.heights.points().reshape(-1, 3)
    scene = RayScene(points, grid_triangles(*surface.mask.shape))
    normals = surface.normals.vectors.reshape(-1, 3)
    origins = points + 1e-4 * scene.size * normals
    rng = np.random.default_rng(seed)
    share = np.zeros(len(points))
    for _ in range(rays):
        sphere = rng.normal(size=normals.shape)
        direction = normals + sphere / np.linalg.norm(sphere, axis=1, keepdims=True)
        share += ~scene.occluded(origins, direction / np.linalg.norm(direction, axis=1, keepdims=True))
    return (share / rays).reshape(surface.mask.shape)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=256, help="side of the picture in pixels")
    options = parser.parse_args()
    side = options.size
    for name, camera in (
        ("orthographic", orthographic(side, side, side / 4)),
        ("perspective", Camera("perspective", side, side, (1.2 * side, 1.2 * side))),
    ):
        surface = bumps(camera, depth=4, size=2)
        truth = by_rays(surface, 1000, seed=1)
        for what, work in (
            ("horizons", lambda made=surface: ambient_occlusion(made.heights, made.normals)),
            ("16 rays", lambda made=surface: by_rays(made, 16, seed=2)),
            ("64 rays", lambda made=surface: by_rays(made, 64, seed=3)),
        ):
            start = time.perf_counter()
            found = work()
            clock = time.perf_counter() - start
            if what == "horizons":
                horizons = clock
            off = np.abs(found - truth)
            print(
                f"{name}, {what}: off by {off.mean():.4f}, at most {off.max():.3f}; {clock / horizons:.2f} x the time"
            )


if __name__ == "__main__":
    main()
