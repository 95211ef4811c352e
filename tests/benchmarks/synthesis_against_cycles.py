"""How many times less processor time synthesis takes than Cycles for the same views without bounces, if they agree.

    python tests/benchmarks/synthesis_against_cycles.py [--size 512] [--views 3] [--seed 1] [--rounds 3]

Needs pip's bpy. The views are drawn as a job's samples are, of one principled material. Processor time is that of all
threads, so that what else the machine does counts little. Counted are, for Cycles, the render from Blender's scene to
pixels, for synthesis :func:`synthesise` from the shape to the sample; no shapes, no files and no process starts. Cycles
takes two numbers of samples a pixel: a job's own, and the fewest (a power of two) whose noise is below the 2% by which
the two renderers may differ, mean relative difference outside shadow edges.

Ends with 1 where they differ by more, or synthesis is less than 30 times as fast as Cycles with a job's own samples.
"""

import argparse
import os
import statistics
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from quiet import quiet

from mpsnet_core.arrays.mask_regions import dilated, eroded
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import SceneDescription
from mpsnet_core.synthesis.scene_sampling import draw_scene
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes import Shape, build_shape

LIMIT, GOAL = 0.02, 30
REFERENCE_SAMPLES = 1024
SMALL = 128  # pixels a side, where noise and differences are measured


def drawn(seed: int, number: int, size: int) -> SceneDescription:
    """A view that both renderers show alike: a single material, as noise and cells are others in Blender."""
    recipe = draw_scene(SampleJob("synthesis", number + 1, seed=seed, size=size, bounces=0), number)
    plain = replace(recipe.materials[0], subsurface=0.0)
    return replace(
        recipe,
        materials=(plain,),
        paint=replace(recipe.paint, amount=0.0),
        dirt=replace(recipe.dirt, amount=0.0),
        bump=replace(recipe.bump, height=0.0),
    )


def synthesised(recipe: SceneDescription, shape: Shape, supersampling: int = 1) -> Sample:
    return synthesise(recipe, shape, [load_reflectance(one) for one in recipe.materials], supersampling)


def difference(sample: Sample, reference: Sample) -> float:
    """Mean relative difference of the lights, outside shadow edges and away from outlines."""
    total = weight = 0.0
    for light, other, lit, told in zip(sample.lights, reference.lights, sample.lit, reference.lit, strict=True):
        edge = (lit > 0) & (lit < 1) | (told > 0) & (told < 1) | dilated(lit == 0, 1) & dilated(lit > 0, 1)
        clear = eroded(sample.mask & reference.mask, 1) & ~dilated(edge, 1)
        total += float(np.abs(light - other)[clear].mean(axis=-1).sum())
        weight += float(other[clear].mean(axis=-1).sum())
    return total / weight


class Cycles:
    """Renders views and keeps the processor time of the last render."""

    def __init__(self, folder: Path) -> None:
        import bpy

        from blender_addon.training.samples.render import render_sample

        self.render_sample, self.folder, self.seconds = render_sample, folder, 0.0
        self.start = 0.0
        bpy.app.handlers.render_init.append(self._begin)
        bpy.app.handlers.render_complete.append(self._end)

    def _begin(self, *_: object) -> None:
        self.start = time.process_time()

    def _end(self, *_: object) -> None:
        self.seconds = time.process_time() - self.start

    def __call__(self, recipe: SceneDescription, shape: Shape, samples: int) -> Sample:
        with quiet():
            return self.render_sample(recipe, shape, samples, self.folder / "sample.exr")


def seconds(recipe: SceneDescription, shape: Shape) -> float:
    """Processor time of a sample."""
    start = time.process_time()
    synthesised(recipe, shape)
    return time.process_time() - start


def main() -> int:
    parser = argparse.ArgumentParser(description="Time synthesis against Cycles.")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--views", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    own = SampleJob("cycles", 1).samples
    print(f"{arguments.size} x {arguments.size} pixels, processor time, no bounces")

    ratios: dict[str, list[float]] = {"own": [], "noise": []}
    differences = []
    with tempfile.TemporaryDirectory() as folder:
        cycles = Cycles(Path(folder))
        for number in range(arguments.views):
            recipe, small = (drawn(arguments.seed, number, size) for size in (arguments.size, SMALL))
            shape = build_shape(recipe.shape)
            reference = cycles(small, shape, REFERENCE_SAMPLES)
            differences.append(difference(synthesised(small, shape, 2), reference))
            enough = next(
                (n for n in (4, 8, 16, 32, 64, 128, 256) if difference(cycles(small, shape, n), reference) <= LIMIT),
                512,
            )
            times: dict[str, list[float]] = {"synthesis": [], "own": [], "noise": []}
            for turn in range(arguments.rounds + 1):
                each = statistics.median(seconds(recipe, shape) for _ in range(3))
                for name, samples in (("own", own), ("noise", enough)):
                    cycles(recipe, shape, samples)
                    if turn:  # the first round warms up
                        times[name].append(cycles.seconds)
                if turn:
                    times["synthesis"].append(each)
            for name, found in ratios.items():
                found.append(statistics.median(a / b for a, b in zip(times[name], times["synthesis"], strict=True)))
            print(
                f"view {number} ({recipe.shape['kind']}, {len(shape.triangles)} triangles, lights of "
                f"{recipe.light_sizes[0]:.1f}°): they differ by {differences[-1]:.2%}; "
                f"synthesis {statistics.median(times['synthesis']):.3f} s, "
                f"Cycles {statistics.median(times['own']):.2f} s ({own} samples, {ratios['own'][-1]:.0f} times), "
                f"{statistics.median(times['noise']):.2f} s ({enough} samples, {ratios['noise'][-1]:.0f} times)"
            )
    own_ratio, noise_ratio = (statistics.median(found) for found in ratios.values())
    print(f"median: {own_ratio:.1f} times as fast as with a job's own samples, {noise_ratio:.1f} as with the fewest")
    print(f"largest difference {max(differences):.2%}")
    return int(own_ratio < GOAL or max(differences) > LIMIT)


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pip's bpy can hang while it cleans up
