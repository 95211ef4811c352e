"""Packed samples: what training needs of a folder's samples, in half floats, in one file that is mapped into memory.

Reading a sample's EXR takes longer than photographing it. So each is read once, cut to the object, and appended to
``packed.bin`` in its folder, which can be deleted at any time.
"""

import logging
import os
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mpsnet_core.errors import InputError
from mpsnet_core.progress import Progress, silent
from mpsnet_core.synthesis.job import sample_path, samples_there
from mpsnet_core.synthesis.sample import MAX_SIDE, Sample, read_sample

log = logging.getLogger(__name__)

DATA = "packed.bin"
MARGIN = 4  # pixels around the object
BYTES_A_PIXEL = 9 * 2 + 3 * 2 + 1
# Before each sample's pixels: a mark, its number, its kind of shape, height and width, and its light directions.
_HEADER = struct.Struct("<4sI12sII9d")
_MARK = b"MPS1"


class Packed(NamedTuple):
    """One sample, cut to the object.

    lights: (9, H, W) half, light 1's red, green, blue, then light 2's, light 3's; zero outside the mask. normals:
    (3, H, W) half. mask: (H, W) bool. lit: (3, H, W) bool, where half of a light or more arrives. directions: (3, 3).
    """

    lights: Tensor
    normals: Tensor
    mask: Tensor
    lit: Tensor
    directions: NDArray[np.float64]


class _Entry(NamedTuple):
    """Where in the file a sample's pixels begin, and what its header says. A damaged sample has no pixels."""

    number: int
    kind: str
    start: int
    size: tuple[int, int]
    directions: NDArray[np.float64]

    @property
    def end(self) -> int:
        return self.start + self.size[0] * self.size[1] * BYTES_A_PIXEL


class PackedSamples:
    """The whole samples of some folders, packed where they are not yet.

    kinds: of shapes to take; empty for all. Raises InputError where a folder is missing, cannot be written to, or there
    is no whole sample.
    """

    def __init__(self, folders: Sequence[Path], kinds: Sequence[str] = (), progress: Progress = silent) -> None:
        self.names: list[str] = []
        self._places: list[tuple[NDArray[np.uint8], _Entry]] = []
        for folder in folders:
            entries = _packed(folder, progress)
            file = np.memmap(folder / DATA, np.uint8, mode="r")
            for number, entry in sorted(entries.items()):
                if entry.end > entry.start and (not kinds or entry.kind in kinds):
                    self.names.append(f"{folder.name}/{number}")
                    self._places.append((file, entry))
        if not self._places:
            raise InputError(f"there is no whole sample in {', '.join(map(str, folders))}; make some first")

    def __len__(self) -> int:
        return len(self._places)

    def __getitem__(self, index: int) -> Packed:
        file, entry = self._places[index]
        height, width = entry.size
        count = height * width
        data = file[entry.start : entry.end]
        planes = torch.from_numpy(data[: 24 * count].view(np.float16).reshape(12, height, width).copy())
        bits = torch.from_numpy(data[24 * count :].reshape(height, width).copy())
        lit = torch.stack([(bits & (2 << light)) > 0 for light in range(3)])
        return Packed(planes[:9], planes[9:], (bits & 1) > 0, lit, entry.directions)


def _packed(folder: Path, progress: Progress) -> dict[int, _Entry]:
    """What the folder's packed file holds, by the samples' numbers, once what was missing is there as well."""
    if not folder.is_dir():
        raise InputError(f"the folder of samples {folder} does not exist; check the path")
    there, data = samples_there(folder), folder / DATA
    entries = _entries(data) if data.exists() else {}
    missing = sorted(there - set(entries))
    if missing:
        try:
            _append(folder, missing, max((entry.end for entry in entries.values()), default=0), progress)
        except OSError as error:
            raise InputError(f"{data} cannot be written ({error.strerror}); make room there") from None
        entries = _entries(data)
    return {number: entry for number, entry in entries.items() if number in there}


def _entries(data: Path) -> dict[int, _Entry]:
    """The whole samples of a packed file. What comes after one that was cut short does not count."""
    entries = {}
    total = data.stat().st_size
    with data.open("rb") as file:
        place = 0
        while len(head := file.read(_HEADER.size)) == _HEADER.size:
            mark, number, kind, height, width, *directions = _HEADER.unpack(head)
            if mark != _MARK or max(height, width) > MAX_SIDE:
                break
            start = place + _HEADER.size
            name = kind.rstrip(b"\0").decode("ascii", "replace")
            entry = _Entry(number, name, start, (height, width), np.array(directions).reshape(3, 3))
            if entry.end > total:
                break
            entries[number] = entry
            place = entry.end
            file.seek(place)
    return entries


def _append(folder: Path, numbers: Sequence[int], end: int, progress: Progress) -> None:
    data = folder / DATA
    with data.open("r+b" if data.exists() else "wb") as file:
        file.truncate(end)
        file.seek(end)
        for done, number in enumerate(numbers):
            progress(done / len(numbers), f"packing sample {done + 1} of {len(numbers)}")
            try:
                file.write(_block(number, read_sample(sample_path(folder, number))))
            except InputError as error:
                log.warning("left out: %s", error)
                file.write(_HEADER.pack(_MARK, number, b"", 0, 0, *np.zeros(9)))
        file.flush()
        os.fsync(file.fileno())


def _block(number: int, sample: Sample) -> bytes:
    rows, columns = np.nonzero(sample.mask)
    if not len(rows):
        raise InputError(f"sample {number} shows no pixel of its object wholly; make it again")
    box = (
        slice(max(rows.min() - MARGIN, 0), rows.max() + MARGIN + 1),
        slice(max(columns.min() - MARGIN, 0), columns.max() + MARGIN + 1),
    )
    mask = sample.mask[box]
    lights = sample.lights[:, *box].transpose(0, 3, 1, 2).reshape(9, *mask.shape)
    planes = np.concatenate([lights, sample.normals[box].transpose(2, 0, 1)]) * mask
    bits = mask.astype(np.uint8)
    for light in range(3):
        bits |= np.uint8(2 << light) * (mask & (sample.lit[light][box] >= 0.5))
    recipe = sample.recipe
    kind = str(recipe.shape["kind"]).encode("ascii", "replace")[:12]
    head = _HEADER.pack(_MARK, number, kind, *mask.shape, *recipe.light_directions.ravel())
    return head + planes.astype(np.float16).tobytes() + bits.tobytes()
