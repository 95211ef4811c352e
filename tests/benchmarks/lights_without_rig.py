"""How far lights that are found in photos are off: by the network alone, and as refined by the photo.

python tests/benchmarks/lights_without_rig.py [--diligent pmsData] [--samples FOLDER ...]

DiLiGenT's ball and cat are seen under the paper's four triples of lights and under four triples on one side of the
object, mixed as in the paper and each alone (white).
Samples are those of `mpsnet synthesize`, photographed under three colours with up to 35% crosstalk, and under one white
light each.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpsnet_core import Capture, InputError
from mpsnet_core.arrays.unit_vectors import angular_error, normalised
from mpsnet_core.estimate.lights.find import find_lights, guess_lights
from mpsnet_core.learning.evaluation.diligent import object_folder, read_diligent
from mpsnet_core.learning.evaluation.published import PUBLISHED_LIGHTS
from mpsnet_core.learning.training.packed import PackedSamples
from mpsnet_core.learning.training.photo_simulation import simulate_photo
from mpsnet_core.synthesis.capture_model import CaptureModel
from mpsnet_core.synthesis.random_sampling import generator

COMMON = {"exact": 0.0, "measured": 0.0, "white": 0.0, "grain": 0.3}
MODELS = {
    "coloured": CaptureModel(**COMMON, crosstalk=(0.0, 0.35)),
    "white": CaptureModel(**COMMON, crosstalk=(0.0, 0.0), colour_overlap=(1.0, 1.0), overlap_shares=(1.0, 1.0)),
}

# Numbers of DiLiGenT's lights that are all on one side of the object: within half a turn around the camera's axis.
ON_ONE_SIDE = ((89, 96, 72), (89, 96, 8), (73, 78, 8), (41, 48, 8))

Case = tuple[Capture, NDArray[np.float64]]


def photographed(samples: PackedSamples, model: CaptureModel) -> Iterator[Case]:
    """Photos of samples, and the lights that explain each channel best."""
    for number in range(len(samples)):
        drawn = model.draw(generator(1, number))
        try:
            capture, _ = simulate_photo(samples[number], drawn)
        except InputError:  # a mask without pixels
            continue
        mixing = drawn.mixing / np.diag(drawn.mixing)[:, None]
        yield capture, normalised(mixing @ samples[number].directions)


def report(name: str, cases: Iterator[Case]) -> None:
    network, refined, within = [], [], []
    for capture, lights in cases:
        try:
            found = find_lights([(capture.image, capture.mask)])
        except InputError:
            continue
        network.append(angular_error(guess_lights(capture.image, capture.mask).directions, lights))
        refined.append(angular_error(found.rig.directions, lights))
        within.append(refined[-1] < 2 * found.errors)
    print(
        f"{name}: {len(network)} photos, the network alone {np.mean(network):.1f}°, refined {np.mean(refined):.1f}°, "
        f"{np.mean(within):.0%} within twice the stated error",
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--diligent", type=Path, help="the data set's folder pmsData")
    parser.add_argument("--samples", type=Path, nargs="*", default=[], help="folders of samples")
    options = parser.parse_args()
    for name in ("ball", "cat") if options.diligent else ():
        folder = object_folder(options.diligent, name)
        for protocol in ("published", "white"):
            for where, triples in (("around", PUBLISHED_LIGHTS), ("on one side", ON_ONE_SIDE)):
                captures = [read_diligent(folder, lights, protocol) for lights in triples]
                report(f"{name}, {protocol}, {where}", ((one, one.rig.directions) for one in captures))
    for folder in options.samples:
        samples = PackedSamples([folder])
        for name, model in MODELS.items():
            report(f"{folder.name}, {name}", photographed(samples, model))


if __name__ == "__main__":
    main()
