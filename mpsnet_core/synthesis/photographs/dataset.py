"""Dataset: samples as a network learns from them, photographed anew each time they are read."""

import itertools
import logging
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.capture import Capture
from mpsnet_core.errors import InputError
from mpsnet_core.estimate.features import feature_maps
from mpsnet_core.estimate.light_frame import QUARTER_TURN
from mpsnet_core.progress import Progress, silent
from mpsnet_core.synthesis.photographs.capture_model import CaptureModel, photograph
from mpsnet_core.synthesis.sample import read_sample, read_sample_data

log = logging.getLogger(__name__)

_MIRROR = np.diag([-1, 1, 1])
CANONICAL_REACH = 15.0  # degrees
KEPT_MARGIN = 8  # pixels around the object


class Example(NamedTuple):
    """What there is to see, and what there is to find. Row 0 on top; vectors in camera space.

    photo: (H, W, 3) float32, the map "photo" of :mod:`mpsnet_core.estimate.features`: linear, unmixed as far as the
        mixing is known, of mean 1; zero outside the mask. initial_normals: (H, W, 3) float32, equation 2, likewise.
    light_directions: (3, 3) float32, unit vectors as they are known, errors included; a light a row.
    mask: (H, W) bool, as it is known.
    truth: (H, W, 3) float32 true unit normals; zero where there are none, which a mask that is too large reaches.
    """

    photo: NDArray[np.float32]
    initial_normals: NDArray[np.float32]
    light_directions: NDArray[np.float32]
    mask: NDArray[np.bool_]
    truth: NDArray[np.float32]


class SampleDataset:
    """The samples in one or more folders, each a photograph drawn anew in every epoch.

    An example depends on nothing but the files and (seed, epoch, index): not on who reads it, nor in what order. It is
    a map-style dataset of PyTorch's DataLoader: it has a length, takes an index and pickles. Call :meth:`set_epoch`
    before each epoch's workers start (with ``persistent_workers`` they would not hear of it).

    folders: where ``sample_*.exr`` are; in the order of their names.
    capture_model: what photographs are drawn from. crop: pixels a side of the part that is shown, which holds some of
        the object; 0 for all of it. A crop is exposed as a photo of its own.
    augment: turn the picture by quarters, mirror it, and change which light is whose channel's; with all vectors.
    canonical: do so such that the lights run counter-clockwise and the first stands straight up, or nearly: turning by
        quarters leaves up to 15°, and more where lights are far from 120° apart. Without `augment` the nearest
        arrangement is taken, else one by chance.
    keep: hold what was read in memory, the part around the object alone: about 1 MB for a sample of 256 x 256.

    Files that are no whole samples are told once in the log, left out and kept in `broken` as (path, sentence). Foreign
    files and files that were cut short are found here, damage within on reading: then the next sample stands in, as it
    does for a crop into which no light falls.

    Raises InputError where a folder is missing, no whole sample is found, one is smaller than the crop, or the crop or
    the seed is below 0.
    """

    def __init__(
        self,
        folders: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
        *,
        seed: int = 0,
        capture_model: CaptureModel | None = None,
        crop: int = 0,
        augment: bool = True,
        canonical: bool = False,
        keep: bool = False,
        progress: Progress = silent,
    ) -> None:
        for name, value in (("seed", seed), ("crop", crop)):
            if value < 0:
                raise InputError(f"the dataset's {name} cannot be {value}; choose 0 or more")
        self.seed, self.crop, self.augment, self.epoch = seed, crop, augment, 0
        self.canonical = canonical
        self.capture_model = capture_model or CaptureModel()
        self._kept: dict[Path, _Shown] | None = {} if keep else None
        self.broken: list[tuple[Path, str]] = []
        self.paths: list[Path] = []
        found = _sample_files([folders] if isinstance(folders, str | os.PathLike) else folders)
        for number, path in enumerate(found):
            progress(number / len(found), "looking through the samples")
            try:
                camera = read_sample_data(path)["recipe"]["camera"]
            except InputError as error:
                self._leave_out(path, error)
                continue
            if crop > min(camera["width"], camera["height"]):
                raise InputError(
                    f"sample {path} is {camera['width']} x {camera['height']}, smaller than the crop of {crop}; "
                    "take a smaller crop"
                )
            self.paths.append(path)
        progress(1.0, f"{len(self.paths)} samples, {len(self.broken)} left out")
        if not self.paths:
            raise InputError(f"none of the {len(found)} samples in {found[0].parent} is whole; make them again")

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> Example:
        return self.example(index, self.epoch)

    def set_epoch(self, epoch: int) -> None:
        """Draw from now on the photographs of `epoch`."""
        self.epoch = epoch

    def example(self, index: int, epoch: int = 0) -> Example:
        """Example `index`, 0 to len - 1, as it is in `epoch`. Raises IndexError for others."""
        capture, truth = self.capture(index, epoch)
        maps = feature_maps(capture, ("photo", "initial_normals"))
        photo, initial = (maps[name].transpose(1, 2, 0) for name in ("photo", "initial_normals"))
        return Example(photo, initial, capture.rig.directions.astype(np.float32), capture.mask, truth)

    def capture(self, index: int, epoch: int = 0) -> tuple[Capture, NDArray[np.float32]]:
        """What example `index` is made of: the photo with all that is known of it, and the true normals (H, W, 3)."""
        if not 0 <= index < len(self):
            raise IndexError(f"example {index} of {len(self)}")
        left_out = {path for path, _ in self.broken}
        for path in self.paths[index:] + self.paths[:index]:
            if path in left_out:
                continue
            rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.seed, epoch, index])))
            try:
                shown = self._shown(path)
            except InputError as error:
                self._leave_out(path, error)
                continue
            try:
                return self._photographed(shown, rng)
            except InputError as error:
                log.info("%s is passed over: %s", path, error)
        raise InputError(f"none of the {len(self)} samples in {self.paths[0].parent} can be used; make them again")

    def _shown(self, path: Path) -> "_Shown":
        if self._kept is not None and path in self._kept:
            return self._kept[path]
        sample = read_sample(path)
        normals = np.where(sample.mask[..., None], sample.normals, np.float32(0))
        if self._kept is None:
            return _Shown(sample.lights, normals, sample.mask, sample.recipe.light_directions)
        # Light is stored as half floats; half a float's normals are good to 0.03 degrees.
        rows, columns = _around(sample.mask, KEPT_MARGIN)
        shown = _Shown(
            sample.lights[:, rows, columns].astype(np.float16),
            normals[rows, columns].astype(np.float16),
            sample.mask[rows, columns].copy(),
            sample.recipe.light_directions,
        )
        self._kept[path] = shown
        return shown

    def _photographed(self, shown: "_Shown", rng: np.random.Generator) -> tuple[Capture, NDArray[np.float32]]:
        lights, normals, mask, directions = shown
        draw = self.capture_model.draw(rng)
        if self.crop:
            rows, columns = _crop(mask, self.crop, rng)
            lights, normals, mask = lights[:, rows, columns], normals[rows, columns], mask[rows, columns]
        lights, normals = lights.astype(np.float32), normals.astype(np.float32)
        arrangement = _Arrangement((0, 1, 2), 0, False)
        if self.canonical:
            arrangement = _canonical(directions, rng if self.augment else None)
        elif self.augment:
            order, turns, mirrored = rng.permutation(3), int(rng.integers(4)), bool(rng.random() < 0.5)
            arrangement = _Arrangement((int(order[0]), int(order[1]), int(order[2])), turns, mirrored)
        lights, normals, mask, directions = _arranged(lights, normals, mask, directions, arrangement)
        return photograph(lights, mask, directions, draw), normals

    def _leave_out(self, path: Path, error: InputError) -> None:
        self.broken.append((path, str(error)))
        log.warning("left out: %s", error)


class _Shown(NamedTuple):
    """Of a sample: lights (3, H, W, 3), normals (H, W, 3) zero outside mask (H, W), and light directions (3, 3)."""

    lights: NDArray[Any]
    normals: NDArray[Any]
    mask: NDArray[np.bool_]
    directions: NDArray[np.float64]


class _Arrangement(NamedTuple):
    """Which light gives which channel, then quarter turns counter-clockwise, then whether left and right change."""

    order: tuple[int, int, int]
    turns: int
    mirrored: bool

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(3, 3) what the turns and the mirror do to a vector of camera space."""
        turn = np.linalg.matrix_power(QUARTER_TURN, self.turns)
        return _MIRROR @ turn if self.mirrored else turn


def _arranged(
    lights: NDArray[np.float32],
    normals: NDArray[np.float32],
    mask: NDArray[np.bool_],
    directions: NDArray[np.float64],
    arrangement: _Arrangement,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_], NDArray[np.float64]]:
    order, turns, mirrored = arrangement
    lights, normals, mask = (
        np.rot90(lights[list(order)], turns, (1, 2)),
        np.rot90(normals, turns),
        np.rot90(mask, turns),
    )
    if mirrored:
        lights, normals, mask = lights[:, :, ::-1], normals[:, ::-1], mask[:, ::-1]
    matrix = arrangement.matrix
    return (
        lights,
        np.ascontiguousarray(normals @ matrix.T.astype(np.float32)),
        np.ascontiguousarray(mask),
        directions[list(order)] @ matrix.T,
    )


def _canonical(directions: NDArray[np.float64], rng: np.random.Generator | None) -> _Arrangement:
    """Lights counter-clockwise, the first nearly straight up: the nearest arrangement, or a near one by chance."""
    found = []
    for mirrored, first, turns in itertools.product((False, True), range(3), range(4)):
        for order in ((first, (first + 1) % 3, (first + 2) % 3), (first, (first + 2) % 3, (first + 1) % 3)):
            arrangement = _Arrangement(order, turns, mirrored)
            turned = directions[list(order)] @ arrangement.matrix.T
            if np.linalg.det(turned) > 0:
                off = abs(math.degrees(math.atan2(turned[0, 0], turned[0, 1])))
                found.append((off, arrangement))
    found.sort(key=lambda entry: entry[0])
    near = [entry for entry in found if entry[0] <= CANONICAL_REACH] or found[:1]
    return near[0 if rng is None else int(rng.integers(len(near)))][1]


def _sample_files(folders: Sequence[str | os.PathLike[str]]) -> list[Path]:
    found: list[Path] = []
    for folder in map(Path, folders):
        if not folder.is_dir():
            raise InputError(f"the folder of samples {folder} does not exist; check the path")
        found += sorted(folder.glob("sample_*.exr"))
    if not found:
        raise InputError(f"there are no samples in {', '.join(map(str, folders))}; make some with mpsnet synthesize")
    return found


def _around(mask: NDArray[np.bool_], margin: int) -> tuple[slice, slice]:
    """Rows and columns of the mask's bounding box, and `margin` pixels more; all of them where it is empty."""
    places = np.argwhere(mask)
    if not len(places):
        return slice(None), slice(None)
    low, high = np.maximum(places.min(axis=0) - margin, 0), places.max(axis=0) + margin + 1
    return slice(low[0], high[0]), slice(low[1], high[1])


def _crop(mask: NDArray[np.bool_], size: int, rng: np.random.Generator) -> tuple[slice, slice]:
    """Rows and columns of a square that holds a pixel of the mask, wherever in it."""
    places = np.argwhere(mask)
    place = places[rng.integers(len(places))] if len(places) else np.zeros(2, np.int64)
    corner = np.clip(place - rng.integers(size, size=2), 0, np.array(mask.shape) - size)
    return slice(corner[0], corner[0] + size), slice(corner[1], corner[1] + size)
