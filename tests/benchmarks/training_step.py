"""Where the time of a training step of the default goes.

python tests/benchmarks/training_step.py SAMPLES... [--steps 20] [--precision bfloat16]

SAMPLES: folders of `mpsnet synthesize`. The step is that of fine-tuning the shipped network: four photographs, frozen
norms, Muon, one thread. Processor time, the first two steps left out. Needs torch (pip install '.[train]').
On Linux, GLIBC_TUNABLES=glibc.malloc.hugetlb=1 before the command takes a tenth off.
"""

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

import mpsnet_core.learning.training.loop as loop
from mpsnet_core.estimate.registry import find_network
from mpsnet_core.learning.training.muon import Muon
from mpsnet_core.learning.training.networks.multiscale import Multiscale
from mpsnet_core.learning.training.recipe import read_recipe

# Title, owner and name of each part; a part within another one is counted there only.
PARTS: list[tuple[str, Any, str]] = [
    ("photographs simulated", loop.PhotoSimulator, "batch"),
    ("coarse scales for the next ones", loop._Run, "_batch"),
    ("forward", Multiscale, "forward"),
    ("loss", loop, "loss_of"),
    ("backward", torch.autograd, "backward"),
    ("AdamW", torch.optim.AdamW, "step"),
    ("Muon", Muon, "step"),
    ("mean of the weights", loop._Run, "_update_mean_weights"),
]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("samples", nargs="+", type=Path)
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--precision", choices=("auto", "bfloat16", "float32"), default="auto")
    given = parser.parse_args()
    torch.set_num_threads(1)
    spent: dict[str, float] = {}
    running: list[str] = []

    def timed(title: str, work: Callable[..., Any]) -> Callable[..., Any]:
        def measured(*values: Any, **named: Any) -> Any:
            if running:
                return work(*values, **named)
            running.append(title)
            begun = time.process_time()
            try:
                return work(*values, **named)
            finally:
                spent[title] = spent.get(title, 0.0) + time.process_time() - begun
                running.pop()

        return measured

    recipe = read_recipe("multiscale-fine-tune")
    run = loop._Run(recipe, given.samples, [], loop.TrainingPaths(), given.precision, lambda *_: None)
    run.begin(find_network("multiscale").path)
    for title, owner, name in PARTS:
        setattr(owner, name, timed(title, getattr(owner, name)))
    whole, windows, first = [], [], run.step
    for number in range(given.steps + 2):
        if number == 2:
            spent.clear()
        begun = time.process_time()
        scales = run.simulator.batch(first + number, recipe.batch)
        run.advance(scales)
        whole.append(time.process_time() - begun)
        windows.append(sum(len(scale.truth) for scale in scales))
    total = sum(whole[2:])
    print(f"{statistics.median(whole[2:]):.3f} s of one core in the median, {statistics.mean(windows[2:]):.1f} windows")
    for title, seconds in spent.items():
        print(f"{title:32s} {seconds / given.steps:.3f} s {seconds / total:4.0%}")


if __name__ == "__main__":
    main()
