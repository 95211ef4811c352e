"""How the bake's time grows with the texture's size and the number of views, each as a share of the smallest one's.

python tests/benchmarks/bake_by_size.py [--faces 7000] [--rounds 3] [--large]

--large bakes and writes a texture of 8192 x 8192 texels from eight views instead, and shows the processor time as a
multiple of that of 2048 x 2048, and the peak memory where the system tells it.
"""

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from mpsnet_core.bake.bake import View, bake_normals
from mpsnet_core.bake.texture import write_texture
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.normal_map import NormalMap

LARGE = 8192


def sphere(faces: int) -> Mesh:
    rows = max(3, round((faces / 4) ** 0.5))
    u, v = np.meshgrid(np.linspace(0, 1, 2 * rows + 1), np.linspace(0.02, 0.98, rows + 1), indexing="ij")
    azimuth, height = 2 * np.pi * u, np.pi * (v - 0.5)
    points = np.stack([np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth), np.sin(height)], -1)
    number = np.arange(u.size).reshape(u.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    points, uvs = points.reshape(-1, 3), np.stack([u, v], -1).reshape(-1, 2)
    return Mesh(points, triangles, points[triangles], uvs[triangles])


def view(azimuth: float, pixels: int = 1024) -> View:
    z = np.array([np.cos(azimuth), np.sin(azimuth), 0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([[-z[1], z[0], 0], [0, 0, 1], z], axis=1)
    pose[:3, 3] = 4 * z
    camera = Camera("orthographic", pixels, pixels, [pixels / 2.2] * 2, None, pose)
    return View(camera, NormalMap(np.ones((pixels, pixels, 3)), np.ones((pixels, pixels), bool)))


def processor_seconds(mesh: Mesh, views: list[View], size: int) -> float:
    """Of baking and writing a texture."""
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        write_texture(Path(folder) / "texture.png", bake_normals(mesh, views, size=size))
    return time.process_time() - start


def peak_memory() -> str:
    """How much memory this process took at most, in megabytes (10^6 bytes)."""
    if sys.platform == "win32":
        return "no peak memory here"
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6:.0f} MB at most"


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the bake at several sizes.")
    parser.add_argument("--faces", type=int, default=7000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--large", action="store_true", help="show the peak memory of a large texture instead")
    arguments = parser.parse_args()
    mesh = sphere(arguments.faces)
    views = [view(azimuth) for azimuth in np.arange(8) * np.pi / 4]
    if arguments.large:
        usual = min(processor_seconds(mesh, views, 2048) for _ in range(arguments.rounds))
        large = processor_seconds(mesh, views, LARGE)
        print(f"{LARGE} x {LARGE} texels: {large:.1f} s, {large / usual:.1f} times 2048 x 2048; {peak_memory()}")
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
