"""What simulating an example's photo costs, as a share of the step that learns from it: one core, recipe multiscale.

python tests/benchmarks/photo_simulation.py SAMPLES [--steps 12]

SAMPLES is a folder of samples; they are packed first, which takes no part in the time. Processor time is measured, so
that what else the machine does counts little.
"""

import argparse
import os
import statistics
import time
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"

import torch

from mpsnet_core.learning.training.loop import TrainingPaths, _Run
from mpsnet_core.learning.training.recipe import read_recipe
from mpsnet_core.progress import silent


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("samples")
    parser.add_argument("--steps", type=int, default=12)
    options = parser.parse_args()
    torch.set_num_threads(1)
    recipe = read_recipe("multiscale")
    run = _Run(recipe, [Path(options.samples)], [], TrainingPaths(), "auto", silent)
    simulating, learning = [], []
    for step in range(options.steps + 2):
        times = [time.process_time()]
        scales = run.simulator.batch(step, recipe.batch)
        times.append(time.process_time())
        run.advance(scales)
        times.append(time.process_time())
        if step > 1:  # the first ones also load and plan
            simulating.append((times[1] - times[0]) / recipe.batch)
            learning.append((times[2] - times[1]) / recipe.batch)
    one, other = (statistics.mean(values) for values in (simulating, learning))
    print(f"an example: photographed in {1e3 * one:.1f} ms, learned from in {1e3 * other:.1f} ms: {one / other:.2f}")


if __name__ == "__main__":
    main()
