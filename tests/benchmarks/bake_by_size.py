"""How the bake's time grows with the texture's size and the number of views, each as a share of the smallest one's.

PYTHONPATH=tests/core/made python tests/benchmarks/bake_by_size.py [--rounds 3] [--large]

--large bakes and writes a texture of 8192 x 8192 texels from eight views instead, and shows the processor time as a
multiple of that of 2048 x 2048, and the peak memory.
"""

import argparse
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from memory import peak
from surface_shapes import camera_looking, sphere_mesh, sphere_view

from mpsnet_core.bake.bake import View, bake_normals
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.texture import write_texture

LARGE = 8192


def processor_seconds(mesh: Mesh, views: list[View], size: int) -> float:
    """Of baking and writing a texture."""
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        write_texture(Path(folder) / "texture.png", bake_normals(mesh, views, size=size))
    return time.process_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the bake at several sizes.")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--large", action="store_true", help="show the peak memory of a large texture instead")
    arguments = parser.parse_args()
    mesh = sphere_mesh(84, 42)
    directions = [(np.cos(azimuth), np.sin(azimuth), 0) for azimuth in np.arange(8) * np.pi / 4]
    views = [sphere_view(camera_looking(direction, size=1024)) for direction in directions]
    if arguments.large:
        usual = min(processor_seconds(mesh, views, 2048) for _ in range(arguments.rounds))
        large = processor_seconds(mesh, views, LARGE)
        print(
            f"{LARGE} x {LARGE} texels: {large:.1f} s, {large / usual:.1f} times 2048 x 2048; {peak():.0f} MB at most"
        )
        return
    cases = [(size, count) for count in (1, 8) for size in (1024, 2048, 4096)]
    seconds: dict[tuple[int, int], list[float]] = {case: [] for case in cases}
    for _ in range(arguments.rounds):
        for size, count in cases:
            start = time.perf_counter()
            bake_normals(mesh, views[:count], size=size)
            seconds[size, count].append(time.perf_counter() - start)
    smallest = statistics.median(seconds[cases[0]])
    print(f"{len(mesh.triangles)} faces")
    for (size, count), times in seconds.items():
        median = statistics.median(times)
        least = min(times)
        print(f"{size:5} texels, {count} views: {median / smallest:6.2f} (median {median:.2f} s, least {least:.2f} s)")


if __name__ == "__main__":
    main()
