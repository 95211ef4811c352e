"""Packed samples: a cache of training samples in half floats that reads fast.

Reading the EXR of a sample takes longer than simulating its photo. So each is read once, cropped to the object, and
stored in the folder ``packed`` next to it, which can be deleted at any time. A sample that was made again is packed
again.
"""

import logging
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.errors import FileError, FormatError
from mpsnet_core.io.files import atomic_write, ensure_folder
from mpsnet_core.progress import Progress, silent
from mpsnet_core.synthesis.job import sample_path, samples_there
from mpsnet_core.synthesis.sample import read_sample

log = logging.getLogger(__name__)

PACKED = "packed"
MARGIN = 4  # pixels around the object


class Packed(NamedTuple):
    """One sample, cropped to the object.

    lights: (9, H, W) half floats, R, G, B of light 1, then of lights 2 and 3; zero outside the mask. normals:
    (3, H, W) half floats. mask: (H, W) bool. lit: (3, H, W) bool, where at least half of a light arrives. directions:
    (3, 3) one light per row.
    """

    lights: Tensor
    normals: Tensor
    mask: Tensor
    lit: Tensor
    directions: NDArray[np.float64]


class PackedSamples:
    """The samples of some folders, folder by folder in the order of their numbers. Packs samples if necessary.

    Parameters
    ----------
    folders : sequence of path
        Folders of samples; each gets a folder ``packed``.

    Attributes
    ----------
    names, paths : list
        Names and file paths of the samples.
    left_out : list of Path
        Files that are damaged or show nothing. A warning gives the reason when they are packed.

    Raises
    ------
    FileError
        If a folder is missing or cannot be written to, or all of them together hold no usable sample.
    """

    def __init__(self, folders: Sequence[str | os.PathLike[str]], progress: Progress = silent) -> None:
        self.names: list[str] = []
        self.paths: list[Path] = []
        self.left_out: list[Path] = []
        for folder in map(Path, folders):
            if not folder.is_dir():
                raise FileError(f"the folder of samples {folder} does not exist; check the path")
            numbers = sorted(samples_there(folder))
            for place, number in enumerate(numbers):
                path = sample_path(folder, number)
                if not _is_packed(path):
                    progress(place / len(numbers), f"packing sample {place + 1} of {len(numbers)}")
                    _pack(path)
                if not _packed_path(path).stat().st_size:
                    self.left_out.append(path)
                else:
                    self.names.append(f"{folder.name}/{number}")
                    self.paths.append(path)
        if not self.paths:
            where = ", ".join(map(str, folders))
            raise FileError(f"there is no whole sample in {where}; make some with mpsnet synthesize")

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> Packed:
        packed = _packed_path(self.paths[index])
        try:
            record = np.load(packed, allow_pickle=False)
            lights, normals, mask, lit = (torch.from_numpy(record[name]) for name in Packed._fields[:4])
            return Packed(lights, normals, mask, lit, record["directions"])
        except (EOFError, LookupError, MemoryError, OSError, SyntaxError, TypeError, ValueError):
            raise FormatError(f"{packed} is damaged; delete it, and the sample is packed again") from None


def _packed_path(path: Path) -> Path:
    return path.parent / PACKED / f"{path.stem}.npy"


def _is_packed(path: Path) -> bool:
    packed = _packed_path(path)
    return packed.exists() and packed.stat().st_mtime_ns == path.stat().st_mtime_ns


def _pack(path: Path) -> None:
    """Pack a sample. The packed file of a damaged or dark sample is empty."""
    remade = path.stat().st_mtime_ns  # also set on the packed file, to recognise an outdated one
    packed = _packed_path(path)
    ensure_folder(packed.parent, "packed samples")
    with atomic_write(packed) as unfinished:
        try:
            record = _record(path)
        except FormatError as error:
            log.warning("left out: %s", error)
        else:
            with unfinished.open("wb") as file:
                np.save(file, record, allow_pickle=False)
        os.utime(unfinished, ns=(remade, remade))


def _record(path: Path) -> NDArray[np.void]:
    """The fields of :class:`Packed` as one record. Raises FormatError if the sample is damaged or dark."""
    sample = read_sample(path)
    if not (sample.lights[:, sample.mask] > 0).any():
        raise FormatError(
            f"sample {path} shows no pixel of its object completely, or no light reaches it; make it again"
        )
    box = bounding_box(sample.mask, MARGIN)
    mask = sample.mask[box]
    lights = sample.lights[:, *box].transpose(0, 3, 1, 2).reshape(9, *mask.shape)
    fields: dict[str, NDArray[Any]] = {
        "directions": sample.recipe.light_directions,
        "lights": (lights * mask).astype(np.float16),
        "normals": (sample.normals[box].transpose(2, 0, 1) * mask).astype(np.float16),
        "mask": mask,
        "lit": (sample.lit[:, *box] >= 0.5) & mask,
    }
    record = np.empty((), [(name, values.dtype, values.shape) for name, values in fields.items()])
    for name, values in fields.items():
        record[name] = values
    return record
