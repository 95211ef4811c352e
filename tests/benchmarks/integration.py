"""How long integration takes, beside a sparse direct solver on the same equations, and how wrong the heights are.

    python tests/benchmarks/integration.py [--size 1024] [--rounds 3] [--bilateral-direct] [--large]

Shapes whose heights are known: one smooth, and two spheres, of which one stands before the other and grows out of it
elsewhere. Times are of the clock and of the processor (which tells more where other programs run). --large: 4096 x 4096
and the peak of memory, each method in a process of its own. The direct solver is SciPy's (not one of the project's
dependencies).
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from mpsnet_core.heights.bilateral import PASSES, chosen_sides
from mpsnet_core.heights.fast import equations, fast
from mpsnet_core.heights.gradients import gradients
from mpsnet_core.heights.height_map import pixel_camera
from mpsnet_core.heights.integrate import METHODS, integrate
from mpsnet_core.heights.multigrid import Links
from mpsnet_core.normals import NormalMap

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]
try:
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import spsolve
except ImportError:
    spsolve = None


def bumpy(size: int) -> tuple[NormalMap, np.ndarray]:
    """A smooth surface within a disc, and its heights in pixels."""
    x, y = places(size)
    height = 0.4 * np.exp(-2 * (x**2 + y**2)) + 0.05 * np.sin(9 * x + 2) * np.cos(7 * y)
    along_x = -1.6 * x * np.exp(-2 * (x**2 + y**2)) + 0.45 * np.cos(9 * x + 2) * np.cos(7 * y)
    along_y = -1.6 * y * np.exp(-2 * (x**2 + y**2)) - 0.35 * np.sin(9 * x + 2) * np.sin(7 * y)
    mask = x**2 + y**2 < 0.97
    return NormalMap(np.stack([-along_x, -along_y, np.ones_like(x)], axis=-1), mask), height * size / 2


def two_spheres(size: int) -> tuple[NormalMap, np.ndarray]:
    """Two spheres, one half before the other and half out of it, and their heights in pixels."""
    x, y = places(size)
    highest, vectors = np.full(x.shape, -np.inf), np.zeros((*x.shape, 3))
    for centre, radius in (((-0.25, -0.1, 0.0), 0.6), ((0.3, 0.15, 0.45), 0.5)):
        away = radius**2 - (x - centre[0]) ** 2 - (y - centre[1]) ** 2
        height = np.where(away > 0, centre[2] + np.sqrt(np.maximum(away, 0)), -np.inf)
        above = height > highest
        highest[above] = height[above]
        vectors[above] = np.stack([x - centre[0], y - centre[1], height - centre[2]], axis=-1)[above]
    mask = np.isfinite(highest)
    return NormalMap(vectors, mask), np.where(mask, highest, 0) * size / 2


def places(size: int) -> tuple[np.ndarray, np.ndarray]:
    x = (np.arange(size) + 0.5) / size * 2 - 1
    return tuple(np.meshgrid(x, -x))


def solved_directly(weights: Links, pulls: Links, mask: np.ndarray) -> np.ndarray:
    """The same normal equations in float64 by SciPy's LU; the first pixel stays at 0."""
    number = np.cumsum(mask).reshape(mask.shape) - 1
    one, other, weight, pull = (
        np.concatenate(both)
        for both in zip(
            *(
                (number[:, :-1][used], number[:, 1:][used], link[used], aim[used])
                if link is weights.right
                else (number[:-1][used], number[1:][used], link[used], aim[used])
                for link, aim in ((weights.right, pulls.right), (weights.down, pulls.down))
                for used in (link > 0,)
            ),
            strict=True,
        )
    )
    count = int(mask.sum())
    weight, pull = weight.astype(float), pull.astype(float)
    rows, columns = np.concatenate([one, other, one, other]), np.concatenate([one, other, other, one])
    matrix = coo_matrix((np.concatenate([weight, weight, -weight, -weight]), (rows, columns)), (count, count)).tocsc()
    aim = np.bincount(other, pull, count) - np.bincount(one, pull, count)
    found = np.zeros(mask.shape)
    found[mask] = np.concatenate([[0], spsolve(matrix[1:, 1:], aim[1:])])
    return found


def timed(work: Callable[[], np.ndarray], rounds: int = 1) -> tuple[float, float, np.ndarray]:
    """The least seconds of the clock, and of the processor, of some rounds; and what was made."""
    times = []
    for _ in range(rounds):
        start, spent = time.perf_counter(), time.process_time()
        made = work()
        times.append((time.perf_counter() - start, time.process_time() - spent))
    return min(t[0] for t in times), min(t[1] for t in times), made


def error(heights: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> str:
    """Mean and largest, but for a constant."""
    off = (heights - truth)[mask]
    off = np.abs(off - np.median(off))
    return f"off by {off.mean():.3f} pixels on average, {off.max():.1f} at most"


def small(size: int, rounds: int, bilateral_direct: bool) -> None:
    for name, (normals, truth) in (("one smooth surface", bumpy(size)), ("two spheres", two_spheres(size))):
        mask, camera = normals.mask, pixel_camera(size, size)
        print(f"{name}: {size} x {size}, {mask.mean():.0%} of them in the mask", flush=True)
        spent = {}
        for method in METHODS:
            clock, spent[method], heights = timed(lambda m=method: integrate(normals, method=m).values, rounds)
            print(f"  {method}: {clock:.2f} s ({spent[method]:.2f} s of processor), {error(heights, truth, mask)}")
        if spsolve is None:
            print("  no direct solver to compare with: SciPy is not installed (pip install scipy)")
            continue
        wanted = gradients(normals, camera)
        clock, direct, depth = timed(lambda: solved_directly(*equations(wanted), mask))
        print(f"  fast, solved directly: {clock:.2f} s ({direct:.2f} s of processor), {error(-depth, truth, mask)}")
        print(f"  of the direct solver's time: fast {spent['fast'] / direct:.3f}", flush=True)
        if bilateral_direct:
            clock, direct, depth = timed(lambda: bilateral_directly(wanted, mask))
            print(f"  bilateral, directly: {clock:.2f} s ({direct:.2f} s of processor), {error(-depth, truth, mask)}")
            print(f"  of the direct solver's time: bilateral {spent['bilateral'] / direct:.3f}", flush=True)


def bilateral_directly(wanted, mask: np.ndarray) -> np.ndarray:
    """As many passes as the project's own, from the same start, each solved to the end."""
    depth = fast(wanted)
    for _ in range(PASSES):
        depth = solved_directly(*chosen_sides(wanted, depth.astype(np.float32)), mask)
    return depth


def large(method: str, size: int) -> None:
    normals, truth = bumpy(size)
    truth, mask = truth.astype(np.float32), normals.mask
    before = peak()
    clock, spent, heights = timed(lambda: integrate(normals, method=method).values)
    print(f"{method}, {size} x {size}: {clock:.1f} s ({spent:.1f} s of processor), {error(heights, truth, mask)};")
    print(f"  peak of memory {peak():.0f} MB, of which {before:.0f} MB to make the normals", flush=True)


def peak() -> float:
    """Megabytes that this process held at most."""
    if resource is None:
        return float("nan")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20 if sys.platform == "darwin" else 1 << 10)


def main() -> None:
    parser = argparse.ArgumentParser(description="Time integration beside a direct solver.")
    parser.add_argument("--size", type=int)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--bilateral-direct", action="store_true", help="the bilateral method directly, too: minutes")
    parser.add_argument("--large", action="store_true", help="4096 x 4096, with the peak of memory")
    parser.add_argument("--method", choices=METHODS, help="with --large, this one alone, in this process")
    options = parser.parse_args()
    if options.large and options.method:
        large(options.method, options.size or 4096)
    elif options.large:
        for method in METHODS:
            command = [sys.executable, __file__, "--large", "--method", method, "--size", str(options.size or 4096)]
            subprocess.run(command, check=True)
    else:
        small(options.size or 1024, options.rounds, options.bilateral_direct)


if __name__ == "__main__":
    main()
