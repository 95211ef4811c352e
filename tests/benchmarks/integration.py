"""How long integration takes, beside a sparse direct solver on the same equations, and how wrong the heights are.

    PYTHONPATH=tests/core/made python tests/benchmarks/integration.py [--size 1024] [--rounds 3] [--large]

Shapes whose heights are known, and the same with noise: one smooth, and two spheres, of which one stands before the
other on one side and grows out of it on the other. Times are of the clock and of the processor, which tells more where
other programs run. --large: 4096 x 4096 and the peak of memory, each method in a process of its own. The direct solver
is SciPy's, which is not one of the project's dependencies.
"""

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from height_shapes import square_camera, two_spheres
from memory import peak

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.relief.integration.bilateral import PASSES, chosen_sides
from mpsnet_core.relief.integration.fast import equations, fast
from mpsnet_core.relief.integration.gradients import gradients
from mpsnet_core.relief.integration.integrate import METHODS, Method, integrate
from mpsnet_core.relief.integration.multigrid import Links
from mpsnet_core.scene.camera import pixel_camera
from mpsnet_core.scene.normal_map import NormalMap

try:
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import spsolve
except ImportError:
    spsolve = None


def bumpy(size: int) -> tuple[NormalMap, np.ndarray]:
    """A smooth surface within a disc, and its heights in pixels."""
    vectors, mask = np.empty((size, size, 3), np.float32), np.empty((size, size), bool)
    heights = np.empty((size, size), np.float32)
    for rows in bands(size):
        x, y = (place[rows] for place in places(size))
        hill = 0.4 * np.exp(-2 * (x**2 + y**2))
        heights[rows] = (hill + 0.05 * np.sin(9 * x + 2) * np.cos(7 * y)) * size / 2
        vectors[rows, :, 0] = 4 * x * hill - 0.45 * np.cos(9 * x + 2) * np.cos(7 * y)
        vectors[rows, :, 1] = 4 * y * hill + 0.35 * np.sin(9 * x + 2) * np.sin(7 * y)
        vectors[rows, :, 2] = 1
        mask[rows] = x**2 + y**2 < 0.97
    return NormalMap(vectors, mask), heights


def noisy(normals: NormalMap, degrees: float) -> NormalMap:
    """Every pixel's normal turned at random, by so many degrees (rms)."""
    noise = np.random.default_rng(0).normal(0, np.radians(degrees) / np.sqrt(2), normals.vectors.shape)
    return NormalMap(normals.vectors + noise, normals.mask)


def places(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Every pixel's x and y, from -1 to 1; views that take no memory."""
    x = (np.arange(size) + 0.5) / size * 2 - 1
    return np.broadcast_to(x, (size, size)), np.broadcast_to(-x[:, None], (size, size))


def solved_directly(weights: Links, pulls: Links, mask: np.ndarray) -> np.ndarray:
    """The same normal equations in float64 by SciPy's LU; the first pixel stays at 0."""
    number = np.cumsum(mask).reshape(mask.shape) - 1
    right, down = weights.right > 0, weights.down > 0
    one = np.concatenate([number[:, :-1][right], number[:-1][down]])
    other = np.concatenate([number[:, 1:][right], number[1:][down]])
    weight = np.concatenate([weights.right[right], weights.down[down]]).astype(float)
    pull = np.concatenate([pulls.right[right], pulls.down[down]]).astype(float)
    count = int(mask.sum())
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
    return f"off by {off.mean():.2g} pixels on average, {off.max():.2g} at most"


def small(size: int, rounds: int) -> None:
    smooth, spheres = bumpy(size), two_spheres(square_camera(size))
    compare("one smooth surface", *smooth, rounds)
    compare("the same with 5° of noise", noisy(smooth[0], 5), smooth[1], rounds)
    compare("two spheres", spheres.normals, spheres.z * size / 2, rounds)
    compare("the same with 5° of noise", noisy(spheres.normals, 5), spheres.z * size / 2, rounds)


def compare(name: str, normals: NormalMap, truth: np.ndarray, rounds: int) -> None:
    """Print seconds and errors of either method, and of the direct solver."""
    mask = normals.mask
    print(f"{name}: {mask.shape[1]} x {mask.shape[0]}, {mask.mean():.0%} of them in the mask", flush=True)
    spent = {}
    for method in METHODS:
        clock, spent[method], heights = timed(partial(heights_of, normals, method), rounds)
        print(f"  {method}: {clock:.2f} s ({spent[method]:.2f} s of processor), {error(heights, truth, mask)}")
    if spsolve is None:
        print("  no direct solver to compare with: SciPy is not installed (pip install scipy)")
        return
    wanted = gradients(normals, pixel_camera(*mask.shape[::-1]))
    clock, direct, depth = timed(partial(solved_directly, *equations(wanted), mask))
    print(f"  fast, solved directly: {clock:.2f} s ({direct:.2f} s of processor), {error(-depth, truth, mask)}")
    sides = chosen_sides(wanted, fast(wanted))
    clock, once, _ = timed(partial(solved_directly, *sides, mask))
    print(f"  one of the bilateral method's passes, solved directly: {clock:.2f} s ({once:.2f} s of processor)")
    print(
        f"  of the direct solver's processor time: fast {spent['fast'] / direct:.3f}, "
        f"bilateral, of as many passes, {spent['bilateral'] / (direct + PASSES * once):.3f}",
        flush=True,
    )


def heights_of(normals: NormalMap, method: Method) -> np.ndarray:
    return integrate(normals, method=method).values


def large(method: Method, size: int) -> None:
    normals, truth = bumpy(size)
    before = peak()
    clock, spent, heights = timed(partial(heights_of, normals, method))
    print(
        f"{method}, {size} x {size}: {clock:.1f} s ({spent:.1f} s of processor), {error(heights, truth, normals.mask)};"
    )
    print(f"  peak of memory {peak():.0f} MB, of which {before:.0f} MB to make the normals", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Time integration beside a direct solver.")
    parser.add_argument("--size", type=int)
    parser.add_argument("--rounds", type=int, default=3)
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
        small(options.size or 1024, options.rounds)


if __name__ == "__main__":
    main()
