"""Test on DiLiGenT (Shi et al. 2016): one-shot captures multiplexed from photographs under white light."""

from collections.abc import Sequence
from functools import lru_cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from mpsnet_core.arrays.sizes import check_same_size
from mpsnet_core.arrays.types import F32, F64
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.errors import FileError, FormatError, GeometryError, InputError, SettingsError
from mpsnet_core.estimate.estimator import usable_channels
from mpsnet_core.io.files import existing_file
from mpsnet_core.io.image_reading import read_data, read_mask
from mpsnet_core.io.opening import DAMAGED, AnyPath
from mpsnet_core.learning.evaluation.evaluation import Evaluation, table_of_errors
from mpsnet_core.learning.evaluation.measure import Case, Row, white_choices
from mpsnet_core.learning.evaluation.operations import EvaluateDiligent
from mpsnet_core.learning.evaluation.published import OBJECTS, PUBLISHED_LIGHTS, Lights, diligent_figures
from mpsnet_core.scene.rig import LightRig
from mpsnet_core.synthesis.reflectance.lambertian_error import PUBLISHED_MIXING

# Weights of a white photograph's R, G, B in one channel of the capture: c_i = Σ_j P_ij I_k(i),j.
PROTOCOLS: dict[str, F64] = {"separated": np.eye(3), "published": PUBLISHED_MIXING, "white": np.full((3, 3), 1 / 3)}
MAX_TRUTH_BYTES = 64 << 20
DAMAGED_PHOTOGRAPHS = 20  # of the bear, by the data set's authors
BRIGHT_FACING = "bright_facing_mae_deg"


def object_folder(root: AnyPath, name: str) -> Path | None:
    """The folder of one object in DiLiGenT's ``pmsData``, or None if it is absent."""
    for folder in (Path(root) / f"{name}PNG", Path(root) / "pmsData" / f"{name}PNG"):
        if folder.is_dir():
            return folder
    return None


def read_diligent(folder: AnyPath, lights: Lights, protocol: str, *, white: bool = False) -> Capture:
    """Multiplex a capture from three of an object's white photographs.

    lights: numbers of the lights for the red, green and blue channel, from 1. Each photograph is divided by its light's
    intensity. protocol: a key of :data:`PROTOCOLS`. white: whether to add their sum as the white photo.

    Raises InputError if a file is missing or does not match.
    """
    folder = Path(folder)
    directions = _numbers(folder / "light_directions.txt")
    intensities = _numbers(folder / "light_intensities.txt")
    if (intensities <= 0).any():
        raise FormatError(f"{folder / 'light_intensities.txt'} holds a light without intensity; all must be above 0")
    names = _text(folder / "filenames.txt").split()
    count = min(len(directions), len(intensities), len(names))
    for light in lights:
        if not 1 <= light <= count:
            raise SettingsError(f"{folder.name} has lights 1 to {count}, not {light}; correct --lights")
    # The 16-bit values of the photographs are linear, whatever the metadata of the files says.
    photos = [read_data(folder / names[light - 1])[0] / intensities[light - 1] for light in lights]
    for light, photo in zip(lights, photos, strict=True):
        check_same_size(f"{folder / names[light - 1]}", photo.shape, f"{names[lights[0] - 1]}", photos[0].shape)
    weights = PROTOCOLS[protocol]
    mixed = [photo @ channel for photo, channel in zip(photos, weights, strict=True)]
    beside = (np.sum(photos, axis=0) @ weights.T).astype(np.float32) if white else None
    try:
        rig = LightRig(directions[[light - 1 for light in lights]])
    except InputError as error:
        raise GeometryError(f"{folder.name}, lights {lights}: {error}") from None
    return Capture(np.stack(mixed, axis=-1).astype(np.float32), read_mask(folder / "mask.png"), rig, white=beside)


def read_truth(folder: AnyPath) -> F32:
    """(H, W, 3) true normals in camera space. Raises InputError if they are missing."""
    path = existing_file(Path(folder) / "Normal_gt.mat", "MATLAB file")
    if path.stat().st_size > MAX_TRUTH_BYTES:
        raise FormatError(f"MATLAB file {path} is larger than 64 MiB; it is not DiLiGenT's")
    try:
        matlab = import_module("scipy.io.matlab")
    except ModuleNotFoundError:
        raise SettingsError("true normals need SciPy: pip install '.[train]' in a copy of the repository") from None
    try:
        truth = np.asarray(matlab.loadmat(path, variable_names=["Normal_gt"])["Normal_gt"], np.float64)
    except (*DAMAGED, matlab.MatReadError) as error:
        raise FormatError(f"{path} is damaged, or holds no numbers called Normal_gt ({error}); copy it again") from None
    if truth.ndim != 3 or truth.shape[2] != 3:
        raise FormatError(f"{folder}: Normal_gt has shape {truth.shape}, expected height x width x 3")
    return normalised(truth).astype(np.float32)


class Diligent(Evaluation):
    """The photographs of DiLiGenT in a root folder, multiplexed.

    Absent objects are skipped and reported.

    The data set has no meshes, so cast shadows are unknown. Instead, rows have "bright_facing_mae_deg": the mean error
    over pixels whose true normal faces all three lights and whose channels are all above 2% of their 99th percentile.
    Interreflections can make a cast shadow that bright.

    Raises FileError if all objects are absent.
    """

    title = "DiLiGenT, one photo each"

    def __init__(self, options: EvaluateDiligent) -> None:
        folders = {name: object_folder(options.folder, name) for name in dict.fromkeys(options.object or OBJECTS)}
        if not any(folders.values()):
            wanted = ", ".join(f"{name}PNG" for name in list(folders)[:2])
            raise FileError(f"{options.folder} has none of DiLiGenT's folders ({wanted}, ...); give its pmsData folder")
        self.lights = [_triple(text) for text in options.lights] or list(PUBLISHED_LIGHTS)
        self.absent = [name for name, folder in folders.items() if folder is None]
        self.cases = [
            partial(_case, name, folder, triple, protocol, beside)
            for name, folder in folders.items()
            if folder is not None
            for triple in self.lights
            for protocol in options.protocol or PROTOCOLS
            for beside in white_choices(options.white)
        ]

    def table(self, rows: Sequence[Row]) -> str:
        """A line per protocol, model and triple of lights, their means, and the paper's results.

        Below, a line per protocol and model, over the bright pixels that face all lights.
        """
        lines: list[Row] = []
        for protocol in dict.fromkeys(row.labels["protocol"] for row in rows):
            measured = [row for row in rows if row.labels["protocol"] == protocol]
            for model in dict.fromkeys(row.labels["model"] for row in measured):
                lines += _with_means([row for row in measured if row.labels["model"] == model])
            paper = self.published(rows) if protocol == "published" else []
            lines += _with_means([_row(figure) for figure in paper if figure["lights"]])
            lines += [_row(figure).labelled(lights="figure 8") for figure in paper if not figure["lights"]]
        table = table_of_errors(lines, ("protocol", "model", "lights"), "object")
        if all(row.figure(BRIGHT_FACING) is None for row in rows):
            return table
        bright = table_of_errors(rows, ("protocol", "model"), "object", BRIGHT_FACING)
        return f"{table}\n\nwhere the true normal faces all three lights and no channel is dark\n{bright}"

    def published(self, rows: Sequence[Row]) -> list[dict[str, Any]]:
        """The paper's table 2 and figure 8 for the objects and lights measured; for its own protocol only."""
        if not any(row.labels["protocol"] == "published" for row in rows):
            return []
        return diligent_figures(list(dict.fromkeys(row.labels["object"] for row in rows)), self.lights)

    def notes(self, rows: Sequence[Row]) -> list[str]:
        """The source of the paper's results, and known damage of the data."""
        notes = []
        if self.published(rows):
            notes.append("paper: table 2 and figure 8 of Ju et al. 2019, as printed; figure 8 names no lights")
        bear = [min(row.labels["lights"]) for row in rows if row.labels["object"] == "bear"]
        if min(bear, default=DAMAGED_PHOTOGRAPHS + 1) <= DAMAGED_PHOTOGRAPHS:
            notes.append(f"the bear's first {DAMAGED_PHOTOGRAPHS} photographs are damaged; they are used here")
        return notes

    def skipped(self) -> list[str]:
        """The absent objects."""
        return [f"absent, skipped: {', '.join(self.absent)}"] if self.absent else []


def _triple(text: str) -> Lights:
    try:
        first, second, third = (int(number) for number in text.split(","))
    except ValueError:
        raise SettingsError(f"--lights {text} is not three numbers; write them like 48,1,96") from None
    return first, second, third


def _case(name: str, folder: Path, lights: Lights, protocol: str, white: bool) -> Case:
    labels = {"object": name, "lights": list(lights), "protocol": protocol, "photos": 1 + white}
    capture, truth = read_diligent(folder, lights, protocol, white=white), _truth(folder)
    if truth.shape != capture.image.shape:
        raise GeometryError(f"{folder}: the truth is {truth.shape}, the photos {capture.image.shape}")
    usable, towards = usable_channels(capture), truth @ capture.rig.directions.T > 0
    bright_facing = np.all(usable & towards, axis=-1)
    return Case(labels, capture, truth, {BRIGHT_FACING.removesuffix("_deg"): bright_facing})


# Consecutive cases often show the same object.
_truth = lru_cache(maxsize=1)(read_truth)


def _with_means(rows: Sequence[Row]) -> list[Row]:
    """One model's rows and, if there are several triples, their copies labelled as the mean of all triples."""
    lines = [row.labelled(lights=",".join(map(str, row.labels["lights"]))) for row in rows]
    triples = len({line.labels["lights"] for line in lines})
    return lines + [line.labelled(lights=f"mean of {triples}") for line in lines if triples > 1]


def _row(figure: dict[str, Any]) -> Row:
    labels = {name: figure[name] for name in ("object", "lights", "protocol")}
    return Row({**labels, "model": f"paper: {figure['model']}"}, {"mae_deg": figure["mae_deg"]})


def _text(path: Path) -> str:
    return existing_file(path, "DiLiGenT's list").read_text(encoding="utf-8", errors="backslashreplace")


def _numbers(path: Path) -> F64:
    lines = _text(path).splitlines()
    try:
        values = np.array([[float(number) for number in line.split()] for line in lines if line.strip()])
    except ValueError as error:
        raise FormatError(f"{path} is not a table of numbers ({error}); copy it again") from None
    if values.shape[1:] != (3,) or not np.isfinite(values).all():
        raise FormatError(f"{path} must hold three numbers a line; copy it again")
    return values
