"""What a sequence costs beside its estimates: frames a second against the estimator alone, and memory by their number.

    python tests/benchmarks/sequence_throughput.py [--frames 12] [--rounds 5] [--memory]

The frames are 512 x 512, 8-bit PNG with alpha, of an object that fills three quarters of them. "Alone" is the estimator
called on captures that are in memory already; "sequence" reads, estimates and writes files, in turns with it. --memory
also runs `mpsnet estimate` on 30 and on 300 frames, each in a process of its own, and tells both peaks.
"""

import argparse
import os
import shutil
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from memory import peak_of_estimate

from mpsnet_core import Capture, LightRig, estimate_sequence, published_rig, write_image, write_rig
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.open import PhotoSet, Source
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.estimate.sequence.source import Frame, Masks, photo_frames

SIDE, DIFFERENT = 512, 6


def picture(number: int, rig: LightRig) -> np.ndarray:
    """(H, W, 4) a noisy ball with waves that turn, as stored in a file."""
    x = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    x, y = np.meshgrid(x, -x)
    inside = x**2 + y**2 < 0.96
    waves = 0.2 * np.sin(20 * (x * np.cos(number / 9) + y * np.sin(number / 9)))
    normals = normalised(np.stack([x + waves, y + waves, np.sqrt(np.maximum(1 - x**2 - y**2, 0.04))], axis=-1))
    noise = np.random.default_rng(number).normal(0, 0.01, normals.shape)
    light = np.clip(0.8 * np.maximum(normals @ rig.directions.T, 0) + noise, 0, 1)
    return np.concatenate([light ** (1 / 2.2), inside[..., None]], axis=-1)


def photographs(folder: Path, count: int, rig: LightRig) -> list[Path]:
    """So many frames; after the first few they repeat."""
    folder.mkdir()
    files = [folder / f"frame_{number:04d}.png" for number in range(1, count + 1)]
    for number, file in enumerate(files):
        if number < DIFFERENT:
            write_image(file, picture(number, rig), bits=8, color_space="sRGB")
        else:
            os.link(files[number % DIFFERENT], file)
    return files


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def peak_memory(folder: Path, count: int, rig: LightRig) -> float:
    """Megabytes (10^6 bytes) that `mpsnet estimate` takes at most for so many frames."""
    source = folder / f"shots{count}"
    photographs(source, count, rig)
    write_rig(folder / "rig.json", rig)
    return peak_of_estimate(source, "--rig", folder / "rig.json", "-o", folder / f"out{count}")


def main() -> None:
    parser = argparse.ArgumentParser(description="Time a sequence beside the estimator alone.")
    parser.add_argument("--frames", type=int, default=12, help="in a round")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--memory", action="store_true", help="also the peak memory of 30 and of 300 frames")
    options = parser.parse_args()
    rig = published_rig()

    def take(frame: Frame) -> Capture:
        return PhotoSet().open(frame.source)

    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        photos = photographs(folder / "shots", options.frames, rig)
        outputs = [folder / "out" / f"{photo.stem}_normals.png" for photo in photos]
        estimator, like = Estimator("multiscale", passes=1), Source(folder, rig)
        captures = [take(frame) for frame in photo_frames(photos[:DIFFERENT], outputs, masks=Masks(), like=like)]

        def alone() -> None:
            for number in range(options.frames):
                estimator(captures[number % len(captures)])

        def sequence() -> None:
            shutil.rmtree(folder / "out", ignore_errors=True)
            frames = photo_frames(photos, outputs, masks=Masks(), like=like)
            done = estimate_sequence(frames, take, estimator, recipe="")
            assert done.made == options.frames

        alone()
        times = [(seconds(alone), seconds(sequence)) for _ in range(options.rounds)]
    for number, name in enumerate(("alone", "sequence")):
        median = statistics.median(round[number] for round in times)
        share = statistics.median(round[0] / round[number] for round in times)
        print(f"{name:9} {options.frames / median:6.2f} frames a second, {share:.0%} of the estimator alone")
    if options.memory:
        with tempfile.TemporaryDirectory() as made:
            few, many = (peak_memory(Path(made), count, rig) for count in (30, 300))
        print(f"peak memory: {few:.0f} MB for 30 frames, {many:.0f} MB for 300, {many / few - 1:+.0%}")


if __name__ == "__main__":
    main()
