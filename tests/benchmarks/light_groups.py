"""How long three renders of one light each take, as a multiple of one render with three light groups.

    python tests/benchmarks/light_groups.py [--size 256] [--samples 64] [--views 3] [--rounds 3]

Needs pip's bpy. The views are those that a job of generated shapes draws. Both ways take the same samples a pixel and
the same threads, in turn, each round anew; what is timed is the processor's time, which other work on the machine
hardly changes. Tells how far the images of the two ways are apart, and in units of what noise alone makes of it: two
renders of each way that differ in their seeds tell how much that is. Ends with 1 where the median of the ratios is
below 2.5 or the images are further apart than noise explains.
"""

import argparse
import statistics
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from quiet import quiet

from blender_addon.training.samples.render import prepare, render_layers
from blender_addon.training.samples.scene import add_shape, sample_scene
from mpsnet_core.synthesis.cycles import LIGHT_GROUPS, sample_from_cycles
from mpsnet_core.synthesis.drawing import draw_recipe
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.recipe import Recipe
from mpsnet_core.synthesis.shapes import Shape, build_shape

WANTED, EXPLAINED = 2.5, 1.15


def render(recipe: Recipe, shape: Shape, samples: int, alone: str, path: Path) -> tuple[float, np.ndarray]:
    """CPU seconds that the render took and its lights (3, H, W, 3). alone: the only light group whose sun is there."""
    with sample_scene(recipe) as scene, quiet():
        vertices, triangles = add_shape(scene, recipe, shape)
        prepare(scene, recipe, samples)
        for obj in list(scene.objects) if alone else ():
            if obj.type == "LIGHT" and obj.lightgroup != alone:
                scene.collection.objects.unlink(obj)
        start = time.process_time()
        render_layers(scene, path)
        seconds = time.process_time() - start
    return seconds, sample_from_cycles(path, recipe, vertices, triangles, "benchmark").lights


def together(recipe: Recipe, shape: Shape, samples: int, path: Path) -> tuple[float, np.ndarray]:
    return render(recipe, shape, samples, "", path)


def apart(recipe: Recipe, shape: Shape, samples: int, path: Path) -> tuple[float, np.ndarray]:
    renders = [render(recipe, shape, samples, name, path) for name in LIGHT_GROUPS]
    return sum(seconds for seconds, _ in renders), np.stack([lights[k] for k, (_, lights) in enumerate(renders)])


def main() -> int:
    parser = argparse.ArgumentParser(description="Time one render with light groups against three renders.")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--views", type=int, default=3)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    job = SampleJob("cycles", count=arguments.views, seed=1, size=arguments.size)
    ratios, distances = [], []
    with tempfile.TemporaryDirectory(prefix="mpsnet-") as folder:
        path = Path(folder) / "layers.exr"
        for number in range(arguments.views):
            recipe = draw_recipe(job, number)
            shape = build_shape(recipe.shape)
            images: dict[object, list[np.ndarray]] = {together: [], apart: []}
            seconds: dict[object, float] = {}
            for turn in range(max(2, arguments.rounds)):
                seeded = replace(recipe, number=1000 * turn + number)
                for way in (together, apart) if turn % 2 else (apart, together):
                    seconds[way], lights = way(seeded, shape, arguments.samples, path)
                    images[way].append(lights)
                ratios.append(seconds[apart] / seconds[together])
            (a, b), (c, d) = images[together][:2], images[apart][:2]
            noise = np.sqrt((np.abs(a - b).mean() ** 2 + np.abs(c - d).mean() ** 2) / 2)
            distances.append(np.abs(a - d).mean() / noise)
            print(
                f"view {number} ({recipe.shape['kind']}, {recipe.bounces} bounces): apart {seconds[apart]:.1f} s, "
                f"together {seconds[together]:.1f} s; images apart by {np.abs(a - d).mean() / d.mean():.2%}, "
                f"{distances[-1]:.2f} of noise"
            )
    print(f"apart / together: median {statistics.median(ratios):.2f}, least {min(ratios):.2f}")
    return int(statistics.median(ratios) < WANTED or max(distances) > EXPLAINED)


if __name__ == "__main__":
    sys.exit(main())
