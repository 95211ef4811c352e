"""What a sequence costs beside its estimates: frames a second against the estimator alone, and memory by their number.

    python tests/benchmarks/sequence_throughput.py [--model multiscale] [--threads 0] [--frames 12] [--rounds 5]
        [--smooth 0] [--video] [--memory]

The frames are 512 x 512, 8-bit PNG with alpha, of an object that fills three quarters of them. "Alone" is the estimator
called on captures that are in memory already; "sequence" reads, estimates and writes files, in turns with it, with the
same number of threads. --video takes the frames from one FFV1 file instead. --memory also runs `mpsnet estimate` on 30
and on 300 frames, each in a process of its own, and tells both peaks, where the system tells them.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture, capture_from
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.estimate.sequence.run import estimate_sequence
from mpsnet_core.estimate.sequence.source import Frame, Masks, photo_frames
from mpsnet_core.estimate.sequence.video import read_video_header, video_frames, video_outputs
from mpsnet_core.io.image_writing import write_image
from mpsnet_core.scene.rig import LightRig, published_rig, write_rig

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


def video(path: Path, count: int, rig: LightRig) -> Path:
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=24)
        stream.width = stream.height = SIDE
        stream.pix_fmt = "bgra"
        for number in range(count):
            values = np.rint(255 * picture(number % DIFFERENT, rig)).astype(np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(values, format="rgba").reformat(format="bgra")))
        container.mux(stream.encode(None))
    return path


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


# Linux counts what the process that starts another had in memory; this one is small.
PEAK = """
import resource, subprocess, sys
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


def peak_memory(folder: Path, count: int, options: argparse.Namespace, rig: LightRig) -> float:
    """Megabytes (10^6 bytes) that `mpsnet estimate` takes at most for so many frames."""
    source = folder / f"shots{count}"
    photographs(source, count, rig)
    write_rig(folder / "rig.json", rig)
    command = [sys.executable, "-m", "mpsnet_core", "estimate", source, "--rig", folder / "rig.json"]
    command += ["--model", options.model, "--threads", str(options.threads), "--smooth", str(options.smooth)]
    command += ["-o", folder / f"out{count}"]
    done = subprocess.run([sys.executable, "-c", PEAK, *command], check=True, capture_output=True, text=True)
    return int(done.stdout) * (1 if sys.platform == "darwin" else 1024) / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description="Time a sequence beside the estimator alone.")
    parser.add_argument("--model", default="multiscale")
    parser.add_argument("--threads", type=int, default=0, help="of the estimator; 0 for all cores")
    parser.add_argument("--frames", type=int, default=12, help="in a round")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--smooth", type=int, default=0)
    parser.add_argument("--video", action="store_true", help="frames from a video")
    parser.add_argument("--memory", action="store_true", help="also the peak memory of 30 and of 300 frames")
    options = parser.parse_args()
    rig = published_rig()

    def take(frame: Frame) -> Capture:
        return capture_from(frame.read(), rig, mask=frame.mask)

    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        photos = photographs(folder / "shots", options.frames, rig)
        outputs = [folder / "out" / f"{photo.stem}_normals.png" for photo in photos]
        clip = video(folder / "clip.mkv", options.frames, rig) if options.video else None
        estimator = Estimator(options.model, passes=1, threads=options.threads)
        captures = [take(frame) for frame in photo_frames(photos[:DIFFERENT], outputs, masks=Masks(None))]

        def alone() -> None:
            for number in range(options.frames):
                estimator(captures[number % len(captures)])

        def sequence() -> None:
            shutil.rmtree(folder / "out", ignore_errors=True)
            if clip is None:
                frames = photo_frames(photos, outputs, masks=Masks(None), reach=options.smooth)
            else:
                places = video_outputs(clip, folder / "out", ".png")
                frames = video_frames(read_video_header(clip), places, masks=Masks(None), reach=options.smooth)
            done = estimate_sequence(frames, take, estimator, recipe="", smooth=options.smooth)
            assert done.made == options.frames

        def one_after_the_other() -> None:
            """What it would be without threads: reading, estimating, writing in turn."""
            from mpsnet_core.scene.normal_map import write_normals

            for frame in photo_frames(photos, outputs, masks=Masks(None)):
                write_normals(folder / "turn.png", estimator(take(frame)))

        alone()
        times = [(seconds(alone), seconds(sequence), seconds(one_after_the_other)) for _ in range(options.rounds)]
    for number, name in enumerate(("alone", "sequence", "in turn")):
        median = statistics.median(round[number] for round in times)
        share = statistics.median(round[0] / round[number] for round in times)
        print(f"{name:9} {options.frames / median:6.2f} frames a second, {share:.0%} of the estimator alone")
    if options.memory:
        with tempfile.TemporaryDirectory() as made:
            few, many = (peak_memory(Path(made), count, options, rig) for count in (30, 300))
        print(f"peak memory: {few:.0f} MB for 30 frames, {many:.0f} MB for 300, {many / few - 1:+.0%}")


if __name__ == "__main__":
    main()
