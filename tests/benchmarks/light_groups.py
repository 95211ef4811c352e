"""How long three renders of one light each take, as a multiple of one render with three light groups.

    python tests/benchmarks/light_groups.py [--size 256] [--samples 64] [--views 3] [--rounds 3]

Needs pip's bpy. The views are those that a job of generated shapes draws. Both ways take the same samples a pixel and
the same threads, in turn, each round anew; what is timed is the processor's time, which other work on the machine
hardly changes. That both ways show the same is a test, tests/addon/test_samples.py.
"""

import argparse
import statistics
import tempfile
import time
from pathlib import Path

from quiet import quiet

from blender_addon.training.samples.render import prepare, render_layers
from blender_addon.training.samples.scene import add_shape, sample_scene
from mpsnet_core.synthesis.cycles import LIGHT_GROUPS
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.scene_description import SceneDescription
from mpsnet_core.synthesis.scene_sampling import draw_scene
from mpsnet_core.synthesis.shapes import Shape, build_shape


def seconds(recipe: SceneDescription, shape: Shape, samples: int, alone: str, path: Path) -> float:
    """Of processor time that a render takes. alone: the only light group whose sun is there."""
    with sample_scene(recipe) as scene, quiet():
        add_shape(scene, recipe, shape)
        prepare(scene, recipe, samples)
        for obj in list(scene.objects) if alone else ():
            if obj.type == "LIGHT" and obj.lightgroup != alone:
                scene.collection.objects.unlink(obj)
        start = time.process_time()
        render_layers(scene, path)
        return time.process_time() - start


def main() -> None:
    parser = argparse.ArgumentParser(description="Time one render with light groups against three renders.")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--views", type=int, default=3)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    job = SampleJob("cycles", count=arguments.views, seed=1, size=arguments.size)
    ratios = []
    with tempfile.TemporaryDirectory(prefix="mpsnet-") as folder:
        path = Path(folder) / "layers.exr"
        for number in range(arguments.views):
            recipe = draw_scene(job, number)
            shape = build_shape(recipe.shape)
            for turn in range(arguments.rounds):
                ways = [("",), LIGHT_GROUPS]
                took = {
                    way: sum(seconds(recipe, shape, arguments.samples, name, path) for name in way)
                    for way in (ways if turn % 2 else reversed(ways))
                }
                ratios.append(took[LIGHT_GROUPS] / took["",])
            print(f"view {number} ({recipe.shape['kind']}, {recipe.bounces} bounces): {ratios[-1]:.2f}", flush=True)
    print(f"apart / together: median {statistics.median(ratios):.2f}, least {min(ratios):.2f}")


if __name__ == "__main__":
    main()
