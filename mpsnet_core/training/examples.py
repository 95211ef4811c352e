"""Examples: what a network sees of the samples, an endless sequence that depends on nothing but the seed."""

import multiprocessing
import signal
import threading
import traceback
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

from mpsnet_core.errors import InputError
from mpsnet_core.estimate.features import CONSTANTS, feature_maps
from mpsnet_core.synthesis.photographs.dataset import SampleDataset
from mpsnet_core.training.networks import Network

Arrays = tuple[tuple[np.ndarray, ...], np.ndarray, np.ndarray]


class Batch(NamedTuple):
    """inputs: (N, C, H, W) each, in the network's order. truth: (N, 3, H, W). weights: (N, H, W) 1 where a pixel
    counts: inside the mask, and its true normal is known."""

    inputs: tuple[Tensor, ...]
    truth: Tensor
    weights: Tensor


class Examples(Dataset[Arrays]):
    """Example `number` of an endless sequence: every epoch all samples, in an order and photographs of its own.

    crop: pixels a side of the square that is cut out, around a pixel that counts; 0 for the whole picture. It is cut
    from the finished feature maps, so that means over the mask are the whole object's, as they are in use.
    """

    def __init__(
        self,
        samples: SampleDataset,
        inputs: dict[str, tuple[str, ...]],
        crop: int = 0,
        shuffled: bool = True,
    ) -> None:
        self.samples, self.inputs, self.crop, self.shuffled = samples, inputs, crop, shuffled
        self._order: tuple[int, np.ndarray] = (-1, np.empty(0, np.int64))

    def __len__(self) -> int:
        return len(self.samples)

    def __getitem__(self, number: int) -> Arrays:
        epoch, place = divmod(number, len(self.samples))
        index = self._index(epoch, place)
        capture, truth = self.samples.capture(index, epoch)
        maps = feature_maps(capture, {name for names in self.inputs.values() for name in names})
        counts = capture.mask & truth.any(axis=-1)
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.samples.seed, 2, epoch, index])))
        window, size = _window(counts, self.crop, rng), (self.crop, self.crop)
        inputs = tuple(
            np.concatenate(
                [maps[name] if name in CONSTANTS else _padded(maps[name][:, *window], size) for name in names]
            )
            for names in self.inputs.values()
        )
        truth, counts = truth[window].transpose(2, 0, 1), counts[window].astype(np.float32)
        return inputs, _padded(truth, size), _padded(counts, size)

    def _index(self, epoch: int, place: int) -> int:
        if not self.shuffled:
            return place
        if self._order[0] != epoch:
            rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.samples.seed, 1, epoch])))
            self._order = (epoch, rng.permutation(len(self.samples)))
        return int(self._order[1][place])


def _window(counts: np.ndarray, crop: int, rng: np.random.Generator) -> tuple[slice, slice]:
    """Rows and columns of a square whose middle half holds a pixel that counts, where there is one."""
    if crop == 0:
        return slice(None), slice(None)
    places = np.argwhere(counts)
    place = places[rng.integers(len(places))] if len(places) else np.array(counts.shape) // 2
    corner = place - crop // 4 - rng.integers(crop // 2, size=2)
    corner = np.maximum(np.minimum(corner, np.array(counts.shape) - crop), 0)
    return slice(corner[0], corner[0] + crop), slice(corner[1], corner[1] + crop)


def _padded(values: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(..., H, W) with zeros to the right and below where a picture is smaller than `size`."""
    short = [(0, max(0, wanted - had)) for wanted, had in zip(size, values.shape[-2:], strict=True)]
    return np.pad(values, [(0, 0)] * (values.ndim - 2) + short)


class _Steps(Sampler[list[int]]):
    """Numbers of the examples that one of several processes takes in each step from `start` on."""

    def __init__(self, start: int, steps: int, batch: int, rank: int, processes: int) -> None:
        self.start, self.steps, self.batch, self.rank, self.processes = start, steps, batch, rank, processes

    def __iter__(self) -> Iterator[list[int]]:
        for step in range(self.start, self.steps):
            first = step * self.batch
            yield list(range(first + self.rank, first + self.batch, self.processes))

    def __len__(self) -> int:
        return self.steps - self.start


def batches(
    examples: Examples, *, start: int, steps: int, batch: int, workers: int, rank: int = 0, processes: int = 1
) -> Iterator[Batch]:
    """The batches of steps `start` to `steps` - 1, made by `workers` processes (0: by this one).

    Raises InputError where none of the samples can be used, or a worker dies.
    """
    loader = DataLoader(
        examples,
        batch_sampler=_Steps(start, steps, batch, rank, processes),
        num_workers=workers,
        collate_fn=collated,
        prefetch_factor=4 if workers else None,
        multiprocessing_context="spawn" if workers else None,
    )
    others = set(multiprocessing.active_children())
    handler = signal.getsignal(signal.SIGCHLD) if hasattr(signal, "SIGCHLD") else None
    iterator = iter(loader)
    made = set(multiprocessing.active_children()) - others
    if made and handler is not None and threading.current_thread() is threading.main_thread():
        # When a worker dies PyTorch would raise an error wherever we are; so it is found when the next batch is due.
        signal.signal(signal.SIGCHLD, handler)
    try:
        yield from iterator
    except InputError as error:  # another process' comes with its traceback, the sentence at the end
        sentence = str(error).strip().splitlines()[-1]
        del iterator  # it would hold its processes for seconds, and the frames hold it
        traceback.clear_frames(error.__traceback__)
        raise InputError(sentence.removeprefix(f"{InputError.__module__}.{InputError.__name__}: ")) from None
    except (EOFError, OSError, RuntimeError):
        for worker in made:
            worker.join(timeout=1)
        if all(worker.is_alive() for worker in made):
            raise
        raise InputError(
            "a process that makes examples was ended; if for want of memory, go on with fewer workers"
        ) from None


def collated(examples: list[Arrays]) -> Batch:
    """Pictures of different sizes, as whole ones may be, get zeros to the right and below."""
    height, width = (max(sizes) for sizes in zip(*(weights.shape for _, _, weights in examples), strict=True))

    def stacked(values: Iterable[np.ndarray]) -> Tensor:
        return torch.from_numpy(np.stack([_padded(one, (height, width)) for one in values]))

    inputs = tuple(
        torch.from_numpy(np.stack(values)) if values[0].shape[1:] == (1, 1) else stacked(values)
        for values in zip(*(inputs for inputs, _, _ in examples), strict=True)
    )
    return Batch(inputs, stacked(truth for _, truth, _ in examples), stacked(weights for _, _, weights in examples))


def on_device(batch: Batch, device: torch.device) -> Batch:
    """The batch where the network is."""
    inputs = tuple(values.to(device, non_blocking=True) for values in batch.inputs)
    return Batch(inputs, batch.truth.to(device, non_blocking=True), batch.weights.to(device, non_blocking=True))


def patches_of(batch: Batch, network: Network, count: int, generator: torch.Generator) -> Batch:
    """`count` patches from each picture of a batch, around pixels that count; pictures without any are passed over.

    inputs become (N * count, C, patch, patch), zero beyond the picture; truth (N * count, 3); weights (N * count,).
    Inputs of one pixel ("lights") are repeated as they are.
    """
    pictures, pixels = [], []
    height, width = batch.weights.shape[1:]
    for number, weights in enumerate(batch.weights):
        places = torch.nonzero(weights.flatten() > 0).squeeze(1).cpu()
        if len(places):
            chosen = places[torch.randint(len(places), (count,), generator=generator)]
            pixels.append(chosen)
            pictures.append(torch.full_like(chosen, number))
    if not pictures:
        raise InputError("no pixel of a whole batch has a known normal; make the samples again")
    device = batch.truth.device
    picture, pixel = torch.cat(pictures).to(device), torch.cat(pixels).to(device)
    y, x = pixel // width, pixel % width
    reach = network.patch // 2
    offsets = torch.arange(network.patch, device=device)
    rows, columns = (y[:, None] + offsets)[:, :, None], (x[:, None] + offsets)[:, None, :]
    inputs = []
    for values in batch.inputs:
        if values.shape[2:] == (height, width):
            padded = torch.nn.functional.pad(values, (reach, reach, reach, reach))
            inputs.append(padded.permute(0, 2, 3, 1)[picture[:, None, None], rows, columns].permute(0, 3, 1, 2))
        else:
            inputs.append(values[picture])
    return Batch(tuple(inputs), batch.truth[picture, :, y, x], torch.ones(len(pixel), device=device))
