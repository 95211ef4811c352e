"""Packed samples: a folder's samples for training, in half floats, in one file that is mapped into memory.

Reading a sample's EXR takes longer than photographing it. So each is read once, cut to the object, and appended to
``packed.bin`` in its folder, which can be deleted at any time. Samples that were remade since then are read again.
"""

import logging
import os
import struct
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mpsnet_core.errors import FileError, FormatError, InputError
from mpsnet_core.io.claims import Claims
from mpsnet_core.progress import Progress, silent
from mpsnet_core.synthesis.job import FOLDER_CLAIM, sample_path, samples_there
from mpsnet_core.synthesis.sample import MAX_SIDE, read_sample

log = logging.getLogger(__name__)

DATA = "packed.bin"
PACKING_CLAIM = FOLDER_CLAIM + 1  # of several processes one packs, the others wait
MARGIN = 4  # pixels around the object
BYTES_A_PIXEL = 9 * 2 + 3 * 2 + 1
# Before each sample's pixels: a mark, its number, its kind of shape, height and width, and its light directions.
_HEADER = struct.Struct("<4sI12sII9d")
_MARK = b"MPS1"


class Packed(NamedTuple):
    """One sample, cut to the object.

    lights: (9, H, W) half, light 1's red, green, blue, then light 2's, light 3's; zero outside the mask. normals:
    (3, H, W) half. mask: (H, W) bool. lit: (3, H, W) bool, where half of a light or more arrives. directions: (3, 3).
    kind: of its shape.
    """

    lights: Tensor
    normals: Tensor
    mask: Tensor
    lit: Tensor
    directions: NDArray[np.float64]
    kind: str


class _Entry(NamedTuple):
    """Where in the file a sample's pixels begin, and its header. A damaged sample has no pixels."""

    number: int
    kind: str
    start: int
    size: tuple[int, int]
    directions: NDArray[np.float64]

    @property
    def end(self) -> int:
        return self.start + self.size[0] * self.size[1] * BYTES_A_PIXEL


class PackedSamples:
    """The whole samples of some folders, folder by folder in the order of their numbers, packed where they are not yet.

    Parameters
    ----------
    folders : sequence of path
        Where the samples are; each folder gets a file ``packed.bin``.
    kinds : sequence of str
        Of shapes to use; empty for all.

    Attributes
    ----------
    names, paths : list
        Of the samples.
    left_out : list of Path
        Files that are no whole samples, or show nothing; the log warns why when they are packed.

    Raises
    ------
    FileError
        Where a folder is missing, cannot be written to, or holds no whole sample.
    """

    def __init__(
        self, folders: Sequence[str | os.PathLike[str]], kinds: Sequence[str] = (), progress: Progress = silent
    ) -> None:
        self.names: list[str] = []
        self.paths: list[Path] = []
        self.left_out: list[Path] = []
        self._places: list[tuple[NDArray[np.uint8], _Entry]] = []
        for folder in map(Path, folders):
            entries = _packed(folder, progress)
            file = np.memmap(folder / DATA, np.uint8, mode="r") if entries else np.empty(0, np.uint8)
            for number, entry in sorted(entries.items()):
                path = sample_path(folder, number)
                if entry.end == entry.start:
                    self.left_out.append(path)
                elif not kinds or entry.kind in kinds:
                    self.names.append(f"{folder.name}/{number}")
                    self.paths.append(path)
                    self._places.append((file, entry))
        if not self._places:
            what = f"sample of {' or '.join(kinds)}" if kinds else "sample"
            where = ", ".join(map(str, folders))
            raise FileError(f"there is no whole {what} in {where}; make some with mpsnet synthesize")

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
        return Packed(planes[:9], planes[9:], (bits & 1) > 0, lit, entry.directions, entry.kind)


def _packed(folder: Path, progress: Progress) -> dict[int, _Entry]:
    """The entries of the folder's packed file, by the samples' numbers, once what was missing is packed as well."""
    if not folder.is_dir():
        raise FileError(f"the folder of samples {folder} does not exist; check the path")
    present = samples_there(folder)
    if any(_missing(folder, present)):
        with Claims(folder) as claims:
            while not _appended(folder, present, claims, progress):
                progress(0.0, f"another process packs the samples in {folder}")
                time.sleep(0.2)
    return {number: entry for number, entry in _entries(folder / DATA).items() if number in present}


def _missing(folder: Path, present: set[int]) -> tuple[list[int], list[int]]:
    """Numbers of the samples that were remade since the folder was packed, and of those that are not packed."""
    data = folder / DATA
    known = present & set(_entries(data))
    packed = data.stat().st_mtime_ns if known else 0
    remade = [number for number in known if sample_path(folder, number).stat().st_mtime_ns > packed]
    return sorted(remade), sorted(present - known)


def _appended(folder: Path, present: set[int], claims: Claims, progress: Progress) -> bool:
    """Pack what is missing. Returns whether all is packed; False where another process packs."""
    data = folder / DATA
    with claims.claim(PACKING_CLAIM) as ours:
        if ours:
            try:
                _append(folder, *_missing(folder, present), progress)
            except OSError as error:
                raise FileError(f"{data} cannot be written ({error.strerror}); make room there") from None
        return ours


def _entries(data: Path) -> dict[int, _Entry]:
    """The whole samples of a packed file. What comes after one that was cut short does not count."""
    entries: dict[int, _Entry] = {}
    if not data.exists():
        return entries
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


def _append(folder: Path, remade: Sequence[int], missing: Sequence[int], progress: Progress) -> None:
    data, numbers = folder / DATA, [*remade, *missing]
    if not numbers:
        return
    end = max((entry.end for entry in _entries(data).values()), default=0)
    begun = time.time_ns()
    packed = data.stat().st_mtime_ns if remade else begun
    with data.open("r+b" if data.exists() else "wb") as file:
        try:
            file.truncate(end)
            file.seek(end)
            for done, number in enumerate(numbers):
                packed = packed if done < len(remade) else begun
                progress(done / len(numbers), f"packing sample {done + 1} of {len(numbers)}")
                try:
                    file.write(_block(sample_path(folder, number), number))
                except InputError as error:
                    log.warning("left out: %s", error)
                    file.write(_HEADER.pack(_MARK, number, b"", 0, 0, *np.zeros(9)))
            file.flush()
            os.fsync(file.fileno())
            packed = begun
        finally:
            # Samples that are remade meanwhile, and those that were but are not packed yet, are newer than the file.
            file.close()
            os.utime(data, ns=(packed, packed))


def _block(path: Path, number: int) -> bytes:
    sample = read_sample(path)
    rows, columns = np.nonzero(sample.mask)
    if not (sample.lights[:, sample.mask] > 0).any():
        raise FormatError(f"sample {path} shows no pixel of its object wholly, or no light reaches it; make it again")
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
    kind = str(sample.recipe.shape["kind"]).encode("ascii", "replace")[:12]
    head = _HEADER.pack(_MARK, number, kind, *mask.shape, *sample.recipe.light_directions.ravel())
    return b"".join([head, planes.astype(np.float16).tobytes(), bits.tobytes()])
