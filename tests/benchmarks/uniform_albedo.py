"""How long solving a matt surface of one colour takes, beside a pass of the default network on the same photo.

PYTHONPATH=tests/core/made python tests/benchmarks/uniform_albedo.py [--size 1200]

Processor time of a painted ball, of which the photo proves its colour, and of a glossy one, of which it does not.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np
from synthetic import shaded_sphere

from mpsnet_core import Capture, NormalMap
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.estimate.registry import MODELS_FOLDER
from mpsnet_core.estimate.uniform_albedo import refine_normals

PAINT = (0.9, 0.5, 0.3)


def ball(size: int, gloss: float) -> Capture:
    sphere = shaded_sphere(size, albedo=PAINT)
    cosines = np.maximum(sphere.normals @ sphere.rig.directions.T, 0)
    return sphere.capture(image=(sphere.image + gloss * cosines**20).astype(np.float32))


def spent(work: Callable[[], object]) -> float:
    begun = time.process_time()
    work()
    return time.process_time() - begun


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=1200)
    size = parser.parse_args().size
    network = OnnxModel(MODELS_FOLDER / "multiscale.onnx", passes=1)
    for name, gloss in (("matt", 0.0), ("glossy", 0.5)):
        capture = ball(size, gloss)
        answers: list[NormalMap] = []
        one_pass = spent(lambda capture=capture, answers=answers: answers.append(network(capture)))
        before = answers[0].vectors.copy()
        solving = spent(lambda capture=capture, answers=answers: refine_normals(capture, answers[0]))
        proven = "as it was" if np.array_equal(before, answers[0].vectors) else "solved"
        pixels = capture.mask.sum() / 1e6
        print(
            f"{name}, {proven}: {solving / pixels:.2f} s a megapixel of object, "
            f"{solving / one_pass:.2f} of a pass of the network"
        )


if __name__ == "__main__":
    main()
