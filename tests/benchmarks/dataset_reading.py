"""What a training example costs, as shares of reading its file: the photograph, the maps, turning and cropping.

python tests/benchmarks/dataset_reading.py [--size 256] [--samples 12] [--rounds 5]
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.camera import Camera
from mpsnet_core.rig import published_rig
from mpsnet_core.synthesis.job import sample_path
from mpsnet_core.synthesis.photographs.capture_model import CaptureModel
from mpsnet_core.synthesis.photographs.dataset import SampleDataset
from mpsnet_core.synthesis.recipe import Material, Recipe
from mpsnet_core.synthesis.sample import Sample, read_sample, write_sample


def sample(size: int, number: int) -> Sample:
    """A bumpy sphere of grainy albedo, about as compressible as a rendered sample."""
    x, y = np.meshgrid(np.linspace(-1, 1, size), np.linspace(1, -1, size))
    mask = x**2 + y**2 < 0.9
    bumps = 0.2 * np.stack([np.sin(9 * x + number), np.cos(8 * y - number), np.zeros_like(x)], -1)
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0.01))], -1) + bumps
    normals = np.where(mask[..., None], normals / np.linalg.norm(normals, axis=-1, keepdims=True), 0)
    directions = published_rig().directions
    shading = np.maximum(np.einsum("hwi,ki->khw", normals, directions), 0)
    albedo = 0.5 + 0.02 * np.random.Generator(np.random.PCG64(number)).normal(size=(size, size, 3))
    camera = Camera("orthographic", size, size, np.array([size / 2, size / 2]))
    recipe = Recipe(0, number, {"kind": "blobs"}, np.eye(3), camera, directions, np.zeros(3), (Material(),))
    return Sample(
        lights=(shading[..., None] * albedo).astype(np.float32),
        normals=normals.astype(np.float32),
        depth=np.where(mask, 3 - normals[..., 2], 0).astype(np.float32),
        alpha=mask.astype(np.float32),
        material=np.where(mask, 0, -1).astype(np.int32),
        lit=(shading > 0).astype(np.float32),
        recipe=recipe,
        renderer="benchmark",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--samples", type=int, default=12)
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    oiio.attribute("threads", 1)  # one worker of a DataLoader has one core
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.samples):
            write_sample(sample_path(folder, number), sample(options.size, number))
        paths = sorted(Path(folder).glob("*.exr"))
        plain = SampleDataset(folder, augment=False, capture_model=CaptureModel.ideal())
        half = options.size // 2
        datasets = {
            "ideal photographs": plain,
            "photographs": SampleDataset(folder, augment=False),
            "photographs, turned": SampleDataset(folder),
            f"photographs, turned, {half} of {options.size} pixels": SampleDataset(folder, crop=half),
        }
        runs: dict[str, Callable[[int, int], object]] = {"reading the file": lambda epoch, n: read_sample(paths[n])}
        for name, dataset in datasets.items():
            runs[name] = lambda epoch, n, dataset=dataset: dataset.example(n, epoch)
        runs["looking through the folder"] = lambda epoch, n: SampleDataset(folder) if n == 0 else None
        times: dict[str, list[float]] = {name: [] for name in runs}
        for epoch in range(options.rounds):
            for name, run in runs.items():
                start = time.process_time()
                for number in range(options.samples):
                    run(epoch, number)
                times[name].append((time.process_time() - start) / options.samples)
    reading = statistics.median(times["reading the file"])
    for name, values in times.items():
        print(f"{name:45s} {statistics.median(values) / reading:5.2f}  ({1e3 * statistics.median(values):.1f} ms)")


if __name__ == "__main__":
    main()
