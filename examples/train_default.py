"""The default network, trained in one command: samples are made on the CPU while it learns from those there are.

python examples/train_default.py --meshes FOLDER --fits FITS.npz [--count 20000] [--minutes 60] [-o output]

It trains on the GPU where there is one. This trains the shipped network further there:

python examples/train_default.py --meshes FOLDER --fits FITS.npz --recipe multiscale-gpu-fine-tune --resume multiscale
    --minutes 9

Every part goes on where it stopped: run it again with more minutes, or on the samples of an earlier run. Needs
pip install '.[train]'. The folder holds at the end the samples, multiscale.checkpoint to go on from, and
multiscale.onnx, annealed over the last sixth of the time.
"""

import argparse
import re
import subprocess
import sys
import time
from pathlib import Path

SHAPES = "blobs,drapery,reliefs,groups,hollows,meshes"
HELD_OUT = 96
PARTS = 5  # of equal length. Each reads the samples made since the last one; a sixth lowers the learning rate to zero
FIRST = 64  # samples to begin with
# Half of the samples have their lights around the camera, half anywhere. Seeds differ, and so do their shapes.
FOLDERS = {"samples": ("around", 51), "samples_any_rig": ("any", 52)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", required=True, help="folder of mesh files to train on")
    parser.add_argument("--fits", required=True, help=".npz of neural fits to measured materials, or a folder of MERL")
    parser.add_argument("--count", type=int, default=20000, help="samples to train on")
    parser.add_argument("--minutes", type=float, default=60.0, help="of training, 0 to make the samples alone")
    parser.add_argument("--recipe", default="multiscale", help="a name, such as multiscale-gpu, or a .toml file")
    parser.add_argument("--resume", help="network to train further if there is no checkpoint: a name or .onnx file")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "output" / "training")
    options = parser.parse_args()
    folder = options.output
    folder.mkdir(parents=True, exist_ok=True)
    made = ["synthesize", "--bounces", 3, "--merl", options.fits, "--shapes", SHAPES, "--meshes", options.meshes]
    mpsnet(*made, "--count", HELD_OUT, "--seed", 977, "--merl-part", "validation", "-o", folder / "validation")
    made += ["--count", -(-options.count // 2), "--merl-part", "training"]
    folders = [[*made, "--rigs", rigs, "--seed", seed, "-o", folder / name] for name, (rigs, seed) in FOLDERS.items()]
    if options.minutes <= 0:
        for each in folders:
            mpsnet(*each)
        return
    making = [started(*each, "--progress", "none") for each in folders]  # two bars would share a line
    try:
        while any(one.poll() is None for one in making) and not begun(folder, options.count):
            time.sleep(1)
        train(options, folder)
    finally:
        for one in making:
            one.terminate()  # what is made stays, and the same command goes on
            one.wait()


def begun(folder: Path, count: int) -> bool:
    """Whether each folder of samples has enough to begin with."""
    return all(len([*folder.glob(f"{name}/*.exr")]) >= min(FIRST, count) / 2 for name in FOLDERS)


def train(options: argparse.Namespace, folder: Path) -> None:
    """Train part by part, each on all samples that are there by then, then anneal and export."""
    checkpoint, minutes = folder / "multiscale.checkpoint", options.minutes / (PARTS + 1)
    trained = ["train", "--recipe", options.recipe, "--cache", folder / "packed"]
    trained += [word for name in FOLDERS for word in ("--samples", folder / name)]
    rest = ["--checkpoint", checkpoint, "-o", folder / "multiscale.onnx"]
    steps = [0]
    for _ in range(PARTS):
        source = checkpoint if checkpoint.exists() else options.resume
        mpsnet(*trained, *(["--resume", source] if source else []), "--minutes", minutes, *rest)
        steps.append(steps_of(checkpoint))
    anneal = max(1, steps[-1] - steps[-2])
    held_out = ["--validation", folder / "validation"]
    mpsnet(*trained, *held_out, "--resume", checkpoint, "--anneal", anneal, *rest)


def steps_of(checkpoint: Path) -> int:
    """How many steps a checkpoint has had."""
    from mpsnet_core.learning.training.checkpoint import read_checkpoint

    return read_checkpoint(checkpoint).step


def started(*arguments: object) -> subprocess.Popen[bytes]:
    """Start a verb of the command line."""
    command = [sys.executable, "-m", "mpsnet_core", *map(str, arguments)]
    print(re.sub(r"^\S+ -m mpsnet_core", "mpsnet", " ".join(command)), flush=True)
    return subprocess.Popen(command)


def mpsnet(*arguments: object) -> None:
    """Run a verb of the command line; end where it fails."""
    if code := started(*arguments).wait():
        sys.exit(code)


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("stopped; the same command goes on")
