"""How far photos unlike the usual mislead the default network and equation 2, on blobs whose normals are known.

python tests/benchmarks/unusual_photos.py [--blobs 4] [--size 128] [--condition WORDS]

Lights that stand near the camera's axis or far from it, ambient light, and an object that is a small part of a photo
without a mask. Blobs of one grey and of six paints, with a little noise, under a rig that is known as a calibrated one
is. Prints mean errors in degrees, and what the default expects of itself.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mpsnet_core import Capture, LightRig, angular_error, published_rig
from mpsnet_core.arrays.mask_regions import box_sums
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.learning.evaluation.colour import COLOURINGS, ROUGHNESS
from mpsnet_core.learning.evaluation.scenes import built_blob, held_out_blob, ideal_photograph, published_view
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.scene_description import Material
from mpsnet_core.synthesis.shading.synthesise import synthesise

NOISE = 0.005  # standard deviation, as a share of what is bright
SURFACES = ("white", "hard cells")
SMALL = 3.5  # sides of the photo that the object is a small part of, in sides of its own

Change = Callable[[Capture, NDArray[np.float64]], Capture]


def usual(capture: Capture, colour: NDArray[np.float64]) -> Capture:
    return capture


def ambient(share: float) -> Change:
    """Light from all sides, as a share of the lights'. colour: (H, W, 3) of the surface, as channels see it."""

    def changed(capture: Capture, colour: NDArray[np.float64]) -> Capture:
        bright = np.percentile(capture.image[capture.mask], 95)
        return replace(capture, image=capture.image + share * bright * colour / colour[capture.mask].mean())

    return changed


def grain(share: float) -> Change:
    """Darker and brighter spots of one colour, as of stone or plaster, with this standard deviation."""

    def changed(capture: Capture, colour: NDArray[np.float64]) -> Capture:
        spots = np.random.default_rng(2).normal(size=capture.mask.shape)
        for _ in range(3):
            spots = box_sums(spots, 1)
        spots *= share / spots.std()
        return replace(capture, image=(capture.image * (1 + spots[..., None])).astype(np.float32))

    return changed


def without_outline(share: float) -> Change:
    """The middle of the object alone, as of a wall that fills the photo, with :func:`grain`."""

    def changed(capture: Capture, colour: NDArray[np.float64]) -> Capture:
        mask, quarter = np.zeros_like(capture.mask), len(capture.mask) // 4
        mask[quarter:-quarter, quarter:-quarter] = capture.mask[quarter:-quarter, quarter:-quarter]
        return replace(grain(share)(capture, colour), mask=mask)

    return changed


def in_large_photo(masked: bool) -> Change:
    def changed(capture: Capture, colour: NDArray[np.float64]) -> Capture:
        around = round(len(capture.mask) * (SMALL - 1) / 2)
        image = np.pad(capture.image, [(around, around), (around, around), (0, 0)])
        mask = np.pad(capture.mask, around)
        return Capture(image, mask if masked else np.ones_like(mask), capture.rig)

    return changed


CONDITIONS: dict[str, tuple[float, Change]] = {
    "slant 30": (30, usual),
    **{f"slant {slant}": (slant, usual) for slant in (8, 12, 20, 50, 60, 70)},
    **{f"ambient {share:.0%}": (30, ambient(share)) for share in (0.03, 0.1, 0.3)},
    "grain 2%": (30, grain(0.02)),
    "grain 5%": (30, grain(0.05)),
    **{f"middle, grain {share:.0%}": (30, without_outline(share)) for share in (0.0, 0.05)},
    "small, masked": (30, in_large_photo(masked=True)),
    "small, no mask": (30, in_large_photo(masked=False)),
}


def photographed(blob: int, surface: str, size: int, slant: float) -> tuple[Capture, NDArray[np.float64], np.ndarray]:
    """The photo, (H, W, 3) the surface's colour, and (H, W, 3) its true normals."""
    colours, pattern = COLOURINGS[surface]
    materials = tuple(Material(base_color=colour, roughness=ROUGHNESS, specular=0.0) for colour in colours)
    recipe = published_view(held_out_blob(blob), materials, size, pattern=pattern)
    recipe = replace(recipe, light_directions=published_rig(slant).directions)
    sample = synthesise(recipe, built_blob(blob), [load_reflectance(material) for material in materials])
    capture = ideal_photograph(sample, "separated")
    colour = np.array(colours, np.float64)[np.maximum(sample.material, 0)]
    return replace(capture, rig=LightRig(recipe.light_directions)), colour, sample.normals


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--blobs", type=int, default=4)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--condition", default="", help="only those whose name holds this")
    options = parser.parse_args()
    default, equation_2 = Estimator(), Estimator("lambertian")
    random = np.random.default_rng(1)
    print(f"{'':18}{'surface':12}{'default':>9}{'expected':>9}{'eq. 2':>9}")
    for name, (slant, change) in CONDITIONS.items():
        for surface in SURFACES if options.condition in name else ():
            figures = []
            for blob in range(options.blobs):
                capture, colour, truth = photographed(blob, surface, options.size, slant)
                object_alone = capture.mask
                capture = change(capture, colour)
                noise = (NOISE * random.normal(size=capture.image.shape)).astype(np.float32)
                capture = replace(capture, image=capture.image + noise)
                around = (len(capture.mask) - len(object_alone)) // 2
                inside = slice(around, around + len(object_alone))
                found, plain = default(capture), equation_2(capture)
                errors = (
                    angular_error(found.vectors[inside, inside], truth),
                    90 * (1 - found.confidence[inside, inside]),
                    angular_error(plain.vectors[inside, inside], truth),
                )
                scored = object_alone & capture.mask[inside, inside]
                figures.append([float(values[scored].mean()) for values in errors])
            print(f"{name:18}{surface:12}" + "".join(f"{value:9.1f}" for value in np.mean(figures, axis=0)), flush=True)


if __name__ == "__main__":
    main()
