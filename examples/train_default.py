"""The default network from nothing: make samples on all cores, train on the GPU where there is one, export.

python examples/train_default.py --meshes FOLDER --fits FITS.npz [--count 20000] [--minutes 60] [-o output]

Every part goes on where it stopped: run it again with more minutes, or on the samples of an earlier run. Needs
pip install '.[train]'. The folder holds at the end the samples, multiscale.checkpoint to go on from, and
multiscale.onnx, annealed over the last fifth of the time.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

SHAPES = "blobs,drapery,reliefs,groups,meshes"
ANNEALED = 0.2  # share of the time


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", required=True, help="folder of mesh files to train on")
    parser.add_argument("--fits", required=True, help=".npz of neural fits to measured materials, or a folder of MERL")
    parser.add_argument("--count", type=int, default=20000, help="samples to train on")
    parser.add_argument("--minutes", type=float, default=60.0, help="of training")
    parser.add_argument("--recipe", default="multiscale", help="multiscale, multiscale-gpu or a .toml file")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "output" / "training")
    options = parser.parse_args()
    folder = options.output
    folder.mkdir(parents=True, exist_ok=True)
    made = ["--bounces", "3", "--merl", options.fits, "--shapes", SHAPES, "--meshes", options.meshes]
    mpsnet("synthesize", *made, "--count", 96, "--seed", 977, "--merl-part", "validation", "-o", folder / "validation")
    mpsnet(
        "synthesize", *made, "--count", options.count, "--seed", 51, "--merl-part", "training", "-o", folder / "samples"
    )
    if options.minutes <= 0:
        return
    checkpoint, model = folder / "multiscale.checkpoint", folder / "multiscale.onnx"
    trained = ["--recipe", options.recipe, "--samples", folder / "samples", "--validation", folder / "validation"]
    resumed = ["--resume", checkpoint] if checkpoint.exists() else []
    rest = ["--checkpoint", checkpoint, "-o", model]
    minutes = options.minutes * (1 - ANNEALED)
    before = steps_of(checkpoint) if resumed else 0
    mpsnet("train", *trained, *resumed, "--minutes", minutes, *rest)
    steps = max(1, round((steps_of(checkpoint) - before) * ANNEALED / (1 - ANNEALED)))
    mpsnet("train", *trained, "--resume", checkpoint, "--anneal", steps, *rest)


def steps_of(checkpoint: Path) -> int:
    """How many steps a checkpoint has had."""
    from mpsnet_core.learning.training.checkpoint import read_checkpoint

    return read_checkpoint(checkpoint).step


def mpsnet(*arguments: object) -> None:
    """Run a verb of the command line; end where it fails."""
    command = [sys.executable, "-m", "mpsnet_core", *map(str, arguments)]
    print(re.sub(r"^\S+ -m mpsnet_core", "mpsnet", " ".join(command)), flush=True)
    if code := subprocess.run(command, check=False).returncode:
        sys.exit(code)


if __name__ == "__main__":
    main()
