"""Packed samples: a cache of training samples in half floats that reads fast.

Reading the EXR of a sample takes longer than simulating its photo. So each is read once, cropped to the object, and
stored in a folder of the cache's own, which can be deleted at any time. The samples' folders may be other people's, and
are not written to. A sample that was made again is packed again.
"""

import logging
import os
import weakref
import zlib
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.row_bands import usable_cores
from mpsnet_core.arrays.types import F64
from mpsnet_core.errors import FileError, FormatError, InputError, NoObject
from mpsnet_core.io.files import atomic_write, ensure_folder, existing_file, resolved, temporary_folder
from mpsnet_core.io.opening import DAMAGED, AnyPath
from mpsnet_core.progress import Progress, silent
from mpsnet_core.synthesis.job import sample_path, samples_there
from mpsnet_core.synthesis.sample import Sample, read_sample

log = logging.getLogger(__name__)

MARGIN = 4  # pixels around the object


class Packed(NamedTuple):
    """One sample, cropped to the object."""

    lights: Tensor
    """(9, H, W) half floats. R, G, B of light 1, then of lights 2 and 3; zero outside the mask."""
    normals: Tensor
    """(3, H, W) half floats. True unit normals in camera space."""
    mask: Tensor
    """(H, W) bool. Where the object is."""
    lit: Tensor
    """(3, H, W) bool. Where at least half of a light arrives."""
    directions: F64
    """(3, 3) float64. Unit vectors to the lights, one light per row."""


class PackedSamples:
    """The samples of some folders, folder by folder in the order of their numbers. Packs samples if necessary.

    Parameters
    ----------
    folders : sequence of path
        Folders of samples.
    cache : path, optional
        Folder for the packed samples, which is created if needed and which other runs may share. By default a temporary
        one, which lasts as long as this object.
    skip_damaged : bool
        Whether damaged samples are left out, with a warning that names them, as those that show nothing are.

    Attributes
    ----------
    names, paths : list
        Names and file paths of the samples.
    left_out : dict of Path to str
        Why samples were left out.

    Raises
    ------
    FileError
        If a folder is missing, the cache cannot be written to, or no usable sample is left.
    FormatError
        If a sample is damaged and not to be skipped.
    """

    def __init__(
        self,
        folders: Sequence[AnyPath],
        progress: Progress = silent,
        *,
        cache: AnyPath | None = None,
        skip_damaged: bool = False,
    ) -> None:
        self.names: list[str] = []
        self.paths: list[Path] = []
        self.left_out: dict[Path, str] = {}
        self._packed: list[Path] = []
        if cache is None:
            kept = ExitStack()
            self._cache = kept.enter_context(temporary_folder())
            weakref.finalize(self, kept.close)
        else:
            self._cache = ensure_folder(cache, "packed samples")
        for folder in map(Path, folders):
            if not folder.is_dir():
                raise FileError(f"the folder of samples {folder} does not exist; check the path")
            self._add(folder, skip_damaged, progress)
        if not self.paths:
            where = ", ".join(map(str, folders))
            raise FileError(f"there is no whole sample in {where}; make some with mpsnet synthesize")

    def _add(self, folder: Path, skip_damaged: bool, progress: Progress) -> None:
        """Add the samples of a folder; those that are not packed yet are packed on all cores."""
        numbers, unusable = sorted(samples_there(folder)), dict[Path, InputError]()
        found: list[tuple[int, Path, Path]] = []
        running: deque[tuple[Path, Future[None]]] = deque()

        def finish_first() -> None:
            path, work = running.popleft()
            try:
                work.result()
            except (FormatError, NoObject) as error:
                if isinstance(error, FormatError) and not skip_damaged:
                    raise FormatError(f"{error}, or leave such samples out with --skip-damaged") from None
                unusable[path] = error

        with ThreadPoolExecutor(usable_cores()) as pool:
            for place, number in enumerate(numbers):
                path = sample_path(folder, number)
                packed = self._packed_path(path)
                found.append((number, path, packed))
                if packed.is_file() and not packed.is_symlink():
                    continue
                if len(running) == usable_cores():  # so that progress tells what is packed by now
                    finish_first()
                progress(place / len(numbers), f"packing sample {place + 1} of {len(numbers)}")
                running.append((path, pool.submit(_pack, path, packed)))
            while running:
                finish_first()
        for number, path, packed in found:
            if path in unusable:
                log.warning("left out: %s", unusable[path])
                self.left_out[path] = str(unusable[path])
                continue
            self._packed.append(packed)
            self.names.append(f"{folder.name}/{number}")
            self.paths.append(path)

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> Packed:
        packed = self._packed[index]
        try:
            record = np.load(existing_file(packed, "packed sample"), allow_pickle=False)
            lights, normals, mask, lit = (torch.from_numpy(record[name]) for name in Packed._fields[:4])
            return Packed(lights, normals, mask, lit, record["directions"])
        except DAMAGED:
            raise FormatError(f"{packed} is damaged; delete it, and the sample is packed again") from None

    def _packed_path(self, path: Path) -> Path:
        """The packed file of a sample: of its path and version. Raises FileError if the sample cannot be opened."""
        sample = existing_file(path, "sample").stat()
        # A sample that was made again, or replaced by one of the same size and time, is another version.
        version = f"{sample.st_size} {sample.st_mtime_ns} {sample.st_ctime_ns}".encode()
        place, number = zlib.crc32(os.fsencode(resolved(path))), zlib.crc32(version)
        return self._cache / f"{path.stem}-{place:08x}-{number:08x}.npy"


def _pack(path: Path, packed: Path) -> None:
    """Pack a sample, and remove its outdated versions. Raises as :func:`_record`."""
    record = _record(path)
    try:
        with atomic_write(packed) as unfinished, unfinished.open("wb") as file:
            np.save(file, record, allow_pickle=False)
    except FileError:
        if not packed.is_file() or packed.is_symlink():  # else another process has just written it
            raise
    for other in packed.parent.glob(f"{packed.stem.rpartition('-')[0]}-*.npy"):
        if other != packed:
            other.unlink(missing_ok=True)


def box_of_object(sample: Sample) -> tuple[slice, slice]:
    """Rows and columns of a sample that are packed."""
    return bounding_box(sample.mask, MARGIN)


def _record(path: Path) -> NDArray[np.void]:
    """The fields of :class:`Packed` as one record. Raises FormatError if it is damaged, NoObject if it is dark."""
    sample = read_sample(path)
    if not (sample.lights[:, sample.mask] > 0).any():
        raise NoObject(f"sample {path} shows no pixel of its object completely, or no light reaches it; make it again")
    box = box_of_object(sample)
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
