"""Dense networks: on the box around the object, in tiles, and where the card says so on one scale after another."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.bands import bands
from mpsnet_core.capture import Capture
from mpsnet_core.estimate.card import ModelCard
from mpsnet_core.estimate.features import CONSTANTS, FEATURE_CHANNELS, Seen, mean_light, mean_white, window_map
from mpsnet_core.estimate.light_frame import CAMERA_FRAME, LightFrame, canonical_frames
from mpsnet_core.normals import normalised
from mpsnet_core.progress import Progress
from mpsnet_core.surface.upsample import upsampled

Floats = NDArray[np.float32]
Window = tuple[slice, slice]

# A pyramid begins at the scale on which the object's longer side is at most this many pixels.
COARSEST = 128
RIGHT_ANGLE = np.float32(np.pi / 2)


class Network(Protocol):
    """Runs an ONNX network: inputs by name to normals (N, 3, H, W) and confidence (N, 1, H, W)."""

    def __call__(self, inputs: dict[str, Floats], count: int, *size: int) -> tuple[Floats, Floats]: ...


def dense_answer(network: Network, card: ModelCard, capture: Capture, tile: int, progress: Progress) -> Floats:
    """(H, W, 4) the normals of `capture`, of no particular length, and their confidence; zero outside the mask.

    A pyramid's first scale shows the whole object on at most 128 pixels a side. Each further scale has twice the
    resolution, and the network sees its own answer on the one before. A pixel of a coarse scale is the mean of those
    inside the mask. Where the card asks for several passes they are averaged on every scale.

    Photo, features and answers are made a tile at a time, so that beside the photo and this array little memory is
    needed however large they are.
    """
    answer = np.zeros((*capture.mask.shape, 4), np.float32)
    box = _box(capture.mask)
    photo = _Photo(capture, box)
    frames = canonical_frames(capture.rig.directions, card.passes) if card.frame == "canonical" else [CAMERA_FRAME]
    halvings = photo.halvings if card.kind == "pyramid" else 0
    previous: Floats | None = None
    for halving in range(halvings, -1, -1):
        shape = photo.shape(halving)
        result = answer[box] if halving == 0 else np.zeros((*shape, 4), np.float32)
        work = list(_tiles(shape, tile, card.multiple, card.halo))
        for number, (window, place) in enumerate(work):
            progress(_done(halving, halvings, number / len(work)), f"tile {number + 1} of {len(work)}")
            kept = _within(place, window)
            seen = photo.seen(window, halving, previous)
            if seen.mask[kept].any():
                for frame in frames:
                    result[place] += _tile_answer(network, card, seen, frame)[kept] / np.float32(len(frames))
        if halving:
            result[..., :3] = normalised(result[..., :3])
            # Half floats are as fine as what is made of them, and take half of the memory.
            previous = result.astype(np.float16) if result.size > HALVED_FROM else result
    return answer


# From this many values on a coarse answer is kept in half floats.
HALVED_FROM = 1 << 24


def _done(halving: int, halvings: int, share: float) -> float:
    """The share of all work that is done, as each scale has four times the pixels of the one before."""
    total = sum(4.0**-k for k in range(halvings + 1))
    return (sum(4.0**-k for k in range(halving + 1, halvings + 1)) + share * 4.0**-halving) / total


def _box(mask: NDArray[np.bool_]) -> Window:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)


def _within(place: Window, window: Window) -> Window:
    rows, columns = (slice(a.start - w.start, a.stop - w.start) for a, w in zip(place, window, strict=True))
    return rows, columns


@dataclass(frozen=True)
class _Photo:
    """The box around the object, seen on any scale."""

    capture: Capture
    box: Window

    def __post_init__(self) -> None:
        capture = self.capture
        object.__setattr__(self, "image", capture.image[self.box])
        object.__setattr__(self, "mask", capture.mask[self.box])
        object.__setattr__(self, "means", mean_light(capture))
        object.__setattr__(self, "white_means", mean_white(capture))

    @property
    def halvings(self) -> int:
        """How often the resolution is halved until the object's longer side is small."""
        count = 0
        while max(self.shape(count)) > COARSEST:
            count += 1
        return count

    def shape(self, halving: int) -> tuple[int, int]:
        """Height and width of the box on a scale."""
        height, width = (side.stop - side.start for side in self.box)
        return -(-height >> halving), -(-width >> halving)
