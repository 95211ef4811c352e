"""DiLiGenT (Shi et al. 2016) as a test of one-shot captures multiplexed from white photographs."""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.capture import Capture
from mpsnet_core.errors import InputError
from mpsnet_core.estimate import Estimator
from mpsnet_core.evaluation.matfile import read_mat_array
from mpsnet_core.files import existing_file
from mpsnet_core.images import read_data, read_mask
from mpsnet_core.normals import NormalMap, angular_error, normalised
from mpsnet_core.progress import Progress, silent
from mpsnet_core.rig import LightRig

OBJECTS = ("ball", "bear", "buddha", "cat", "cow", "goblet", "harvest", "pot1", "pot2", "reading")

Lights = tuple[int, int, int]
# The paper's four triples (Table 2), counted from 1 as DiLiGenT's file names do.
PUBLISHED_LIGHTS: tuple[Lights, ...] = ((48, 1, 96), (8, 41, 89), (73, 72, 27), (22, 50, 78))

# How a white photograph's R, G, B make up one channel of the capture: c_i = Σ_j P_ij I_k(i),j.
PROTOCOLS: dict[str, NDArray[np.float64]] = {
    "separated": np.eye(3),
    "published": np.full((3, 3), 2 / 9) + np.eye(3) * (5 / 9 - 2 / 9),
    "white": np.full((3, 3), 1 / 3),
}


@dataclass(frozen=True)
class Result:
    """One estimate against the truth. mae_deg: mean angular error over the mask in degrees."""

    object: str
    lights: Lights
    protocol: str
    model: str
    mae_deg: float
    median_deg: float
    capture: Capture
    estimate: NormalMap
    truth: NDArray[np.float32]

    def row(self) -> dict[str, Any]:
        """The result as a row of the table that ``--json`` writes."""
        return {
            "object": self.object,
            "lights": list(self.lights),
            "protocol": self.protocol,
            "model": self.model,
            "mae_deg": round(self.mae_deg, 4),
            "median_deg": round(self.median_deg, 4),
        }


def object_folder(root: str | os.PathLike[str], name: str) -> Path | None:
    """The folder of one object under DiLiGenT's ``pmsData``, or None where it is absent."""
    for folder in (Path(root) / f"{name}PNG", Path(root) / "pmsData" / f"{name}PNG"):
        if folder.is_dir():
            return folder
    return None


def read_diligent(folder: str | os.PathLike[str], lights: Lights, protocol: str) -> Capture:
    """Multiplex a capture from three of an object's white photographs.

    lights: numbers from 1; light a gives the red channel, b green, c blue. Each photograph is divided by its light's
    intensity. protocol: a key of :data:`PROTOCOLS`.

    Raises InputError where a file is missing or does not fit.
    """
    folder = Path(folder)
    if protocol not in PROTOCOLS:
        raise InputError(f"protocol {protocol!r} is not known; choose {', '.join(PROTOCOLS)}")
    directions = _numbers(folder / "light_directions.txt")
    intensities = _numbers(folder / "light_intensities.txt")
    if (intensities <= 0).any():
        raise InputError(f"{folder / 'light_intensities.txt'} holds a light without intensity; all must be above 0")
    names = existing_file(folder / "filenames.txt", "DiLiGenT's list").read_text().split()
    count = min(len(directions), len(intensities), len(names))
    for light in lights:
        if not 1 <= light <= count:
            raise InputError(f"{folder.name} has lights 1 to {count}, not {light}; mend --lights")
    mixed = []
    for weights, light in zip(PROTOCOLS[protocol], lights, strict=True):
        # The photographs' 16-bit values are linear, whatever the files say.
        photo, _ = read_data(folder / names[light - 1])
        mixed.append(photo / intensities[light - 1] @ weights)
    try:
        rig = LightRig(directions[[light - 1 for light in lights]])
    except InputError as error:
        raise InputError(f"{folder.name}, lights {lights}: {error}") from None
    return Capture(np.stack(mixed, axis=-1).astype(np.float32), read_mask(folder / "mask.png"), rig)


def read_truth(folder: str | os.PathLike[str]) -> NDArray[np.float32]:
    """(H, W, 3) true normals in camera space. Raises InputError where they are missing."""
    truth = read_mat_array(Path(folder) / "Normal_gt.mat", "Normal_gt")
    if truth.ndim != 3 or truth.shape[2] != 3:
        raise InputError(f"{folder}: Normal_gt has shape {truth.shape}, expected height x width x 3")
    return normalised(truth).astype(np.float32)


def evaluate_diligent(
    root: str | os.PathLike[str],
    *,
    lights: Sequence[Lights] = PUBLISHED_LIGHTS,
    protocols: Iterable[str] = tuple(PROTOCOLS),
    models: Iterable[str] = ("lambertian",),
    skipped: list[str] | None = None,
    progress: Progress = silent,
) -> Iterator[Result]:
    """Estimate and compare, for every object that is there.

    skipped: what is absent is appended here, a line each. Raises InputError where no object is there at all.
    """
    folders = {name: object_folder(root, name) for name in OBJECTS}
    present = {name: folder for name, folder in folders.items() if folder is not None}
    if not present:
        raise InputError(f"{root} has none of DiLiGenT's folders (ballPNG, catPNG, ...); give its pmsData folder")
    absent = [name for name in OBJECTS if name not in present]
    if absent and skipped is not None:
        skipped.append(f"absent, skipped: {', '.join(absent)}")
    estimators = [Estimator(model) for model in models]
    protocols = list(protocols)
    total, done = len(present) * len(lights) * len(protocols) * len(estimators), 0
    for name, folder in present.items():
        truth = read_truth(folder)
        for triple in lights:
            for protocol in protocols:
                capture = read_diligent(folder, triple, protocol)
                if truth.shape != capture.image.shape:
                    raise InputError(f"{folder}: the truth is {truth.shape}, the photos {capture.image.shape}")
                for estimator in estimators:
                    progress(done / total, f"{name}, lights {triple}, {protocol}, {estimator.name}")
                    estimate = estimator(capture)
                    error = angular_error(estimate.vectors, truth)[capture.mask]
                    mean, median = float(error.mean()), float(np.median(error))
                    yield Result(name, triple, protocol, estimator.name, mean, median, capture, estimate, truth)
                    done += 1
    progress(1.0, "evaluated")


def _numbers(path: Path) -> NDArray[np.float64]:
    try:
        lines = existing_file(path, "DiLiGenT's list").read_text().splitlines()
        values = np.array([[float(number) for number in line.split()] for line in lines if line.strip()])
    except ValueError as error:
        raise InputError(f"{path} is not a table of numbers ({error}); copy it again") from None
    if values.shape[1:] != (3,) or not np.isfinite(values).all():
        raise InputError(f"{path} must hold three numbers a line; copy it again")
    return values
