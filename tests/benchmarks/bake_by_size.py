"""The peak memory of a bake of eight views onto 8192 x 8192 texels, and its time as a multiple of that of 2048 x 2048.

PYTHONPATH=tests/core/made python tests/benchmarks/bake_by_size.py
"""

import tempfile
import time
from pathlib import Path

import numpy as np
from memory import peak
from surface_shapes import camera_looking, sphere_mesh, sphere_view

from mpsnet_core import Mesh, View, bake_normals, write_texture

LARGE = 8192


def processor_seconds(mesh: Mesh, views: list[View], size: int) -> float:
    """Of baking and writing a texture."""
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        write_texture(Path(folder) / "texture.png", bake_normals(mesh, views, size=size))
    return time.process_time() - start


def main() -> None:
    mesh = sphere_mesh(84, 42)
    directions = [(np.cos(azimuth), np.sin(azimuth), 0) for azimuth in np.arange(8) * np.pi / 4]
    views = [sphere_view(camera_looking(direction, size=1024)) for direction in directions]
    usual = min(processor_seconds(mesh, views, 2048) for _ in range(3))
    large = processor_seconds(mesh, views, LARGE)
    print(f"{LARGE} x {LARGE} texels: {large:.1f} s, {large / usual:.1f} times 2048 x 2048; {peak():.0f} MB at most")


if __name__ == "__main__":
    main()
