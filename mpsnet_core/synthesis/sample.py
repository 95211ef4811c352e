"""Sample: what one view looks like under each of three white lights, with its true normals; one EXR file each."""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.files import existing_file, written_whole
from mpsnet_core.synthesis.recipe import Recipe, recipe_from_data

SAMPLE_VERSION = 1
METADATA = "mpsnet:sample"
MAX_SIDE = 8192
# Channels in file order. Light is stored as half floats (a relative 0.05%), geometry as floats.
_CHANNELS = (
    *(f"light{k}.{c}" for k in (1, 2, 3) for c in "RGB"),
    *(f"normal.{c}" for c in "XYZ"),
    "depth.Z",
    "alpha.A",
    "material.V",
    *(f"lit{k}.V" for k in (1, 2, 3)),
)
_FLOATS = {"normal.X", "normal.Y", "normal.Z", "depth.Z"}
_HALF_MAX = 65504.0


@dataclass(frozen=True)
class Sample:
    """One view, H x W pixels, row 0 on top.

    lights: (3, H, W, 3) float32, linear RGB radiance under each white light alone; a white matt surface that faces a
        light is 1. Premultiplied with alpha: the background is black.
    normals: (H, W, 3) float32 true unit normals in camera space, bump included; zero outside alpha.
    depth: (H, W) float32, distance in front of the camera along its axis; 0 outside alpha.
    alpha: (H, W) float32, the share of the pixel that the object covers, 0 to 1.
    material: (H, W) int, number of the material that weighs most; -1 outside alpha.
    lit: (3, H, W) float32, the share of each light that reaches the pixel, 0 to 1: 0 in attached and cast shadow.
    recipe: what the sample shows. renderer: what made it, for instance "synthesis" or "Cycles 4.5.15".
    """

    lights: NDArray[np.float32]
    normals: NDArray[np.float32]
    depth: NDArray[np.float32]
    alpha: NDArray[np.float32]
    material: NDArray[np.int32]
    lit: NDArray[np.float32]
    recipe: Recipe
    renderer: str

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) pixels that the object covers wholly."""
        return self.alpha > 0.99

    @property
    def lit_fractions(self) -> tuple[float, float, float, float]:
        """Shares of the mask's pixels that no, one, two and three lights reach (half of a light or more)."""
        count = (self.lit >= 0.5).sum(axis=0)[self.mask]
        shares = np.bincount(count, minlength=4) / max(1, len(count))
        return tuple(float(share) for share in shares)  # type: ignore[return-value]


def write_sample(path: str | os.PathLike[str], sample: Sample) -> None:
    """Write a sample as one multi-layer EXR, whole or not at all.

    Layers light1, light2, light3 (R, G, B), normal (X, Y, Z), depth (Z), alpha (A), material and lit1 to lit3 (V); the
    recipe, with the rig and the camera, as JSON in the attribute "mpsnet:sample".
    """
    path = Path(path)
    planes = [
        *np.minimum(sample.lights, _HALF_MAX).transpose(0, 3, 1, 2).reshape(9, *sample.alpha.shape),
        *sample.normals.transpose(2, 0, 1),
        sample.depth,
        sample.alpha,
        sample.material,
        *sample.lit,
    ]
    pixels = np.ascontiguousarray(np.stack(planes, axis=-1), np.float32)
    height, width, count = pixels.shape
    spec = oiio.ImageSpec(width, height, count, "float")
    spec.channelnames = _CHANNELS
    spec.channelformats = tuple(oiio.TypeFloat if name in _FLOATS else oiio.TypeHalf for name in _CHANNELS)
    spec.attribute("compression", "zip")
    spec.attribute("oiio:ColorSpace", "raw")
    spec.attribute(
        METADATA,
        json.dumps(
            {
                "version": SAMPLE_VERSION,
                "renderer": sample.renderer,
                "lit_fractions": sample.lit_fractions,
                "recipe": sample.recipe.data(),
            }
        ),
    )
    with written_whole(path) as unfinished:
        target = oiio.ImageOutput.create(str(unfinished))
        done = target.open(str(unfinished), spec) and target.write_image(pixels)
        if not (target.close() and done):
            reason = " ".join((target.geterror() or oiio.geterror()).split())
            raise InputError(f"cannot write {path} ({reason}); is the disk full?")


def read_sample(path: str | os.PathLike[str]) -> Sample:
    """Read and check a sample. Raises InputError where the file is cut short, damaged or no sample."""
    path = existing_file(path, "sample")
    raise InputError(f"{path}: reading samples is being written")


def read_sample_data(path: str | os.PathLike[str]) -> dict[str, Any]:
    """A sample's metadata alone: "version", "renderer", "lit_fractions" and "recipe" (plain data)."""
    raise InputError(f"{path}: reading samples is being written")


__all__ = ["Sample", "read_sample", "read_sample_data", "recipe_from_data", "write_sample"]
