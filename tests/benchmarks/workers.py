"""How much more N workers of a Dask cluster make than one: samples by the synthesis, by Cycles, and by stand-in work.

python tests/benchmarks/workers.py [--work stand-in synthesis cycles] [--workers 1 2 4] [--rounds 2] [--count 24]

The cluster is on this machine, so that more workers than cores gain nothing but by stand-in work: it waits instead of
working, then writes a sample, and shows what handing out and collecting cost. The rate is that of the files as they
appear, after each worker has made two: a run of hours does not feel how long Blender takes to start.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from distributed import LocalCluster

from mpsnet_core.io.files import atomic_write
from mpsnet_core.synthesis.farm.run import SYNTHESIS_COMMAND, blender_command, make_samples
from mpsnet_core.synthesis.farm.work import THIS_PYTHON, serve
from mpsnet_core.synthesis.job import SampleJob, sample_path
from mpsnet_core.synthesis.make import make_sample

KINDS = ("stand-in", "synthesis", "cycles")
STAND_IN_SECONDS = 0.5
SIZE = 128


def stand_in(folder: str) -> None:
    """A worker that waits; what it writes is the first sample that it makes, again and again."""
    first: list[bytes] = []

    def make(job: SampleJob, number: int, path: Path) -> None:
        if not first:
            make_sample(job, number, path)
            first.append(path.read_bytes())
        time.sleep(STAND_IN_SECONDS)
        with atomic_write(path) as unfinished:
            unfinished.write_bytes(first[0])

    serve(folder, make)


def rate(kind: str, workers: int, count: int, folder: Path) -> float:
    """Samples a second, after each worker has made two."""
    job = SampleJob(renderer="cycles" if kind == "cycles" else "synthesis", count=count, size=SIZE, shapes=("blobs",))
    command: Sequence[str] = {
        "stand-in": (THIS_PYTHON, str(Path(__file__).resolve()), "--stand-in"),
        "synthesis": SYNTHESIS_COMMAND,
        "cycles": blender_command(),
    }[kind]
    with LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        made = make_samples(folder, job, command, cluster=cluster.scheduler_address)
    assert made.made == count, made.failed
    times = sorted(sample_path(folder, number).stat().st_mtime for number in range(count))[2 * workers :]
    return (len(times) - 1) / (times[-1] - times[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--workers", nargs="+", type=int, default=(1, 2, 4))
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--count", type=int, default=24, help="samples for each worker")
    parser.add_argument("--stand-in", metavar="FOLDER", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.stand_in:
        stand_in(options.stand_in)
        return
    for kind in options.work:
        rates: dict[int, list[float]] = {workers: [] for workers in options.workers}
        for _ in range(options.rounds):
            for workers, found in rates.items():
                with tempfile.TemporaryDirectory() as folder:
                    found.append(rate(kind, workers, options.count * workers, Path(folder)))
        alone = next(iter(rates.values()))
        for workers, found in rates.items():
            times = statistics.median(one / other for one, other in zip(found, alone, strict=True))
            print(
                f"{kind}, {workers} workers: {statistics.median(found):.2f} samples a second, {times:.2f} times one",
                flush=True,
            )


if __name__ == "__main__":
    main()
