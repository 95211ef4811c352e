"""Dense networks: on the box around the object, in tiles where it is large, in the frames that the card asks for."""

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.capture import Capture
from mpsnet_core.estimate.card import ModelCard
from mpsnet_core.estimate.features import CONSTANTS, FEATURE_CHANNELS, mean_light, window_map
from mpsnet_core.estimate.grids import Grid, StraightGrid, TurnedGrid, Window
from mpsnet_core.estimate.light_frame import CAMERA_FRAME, LightFrame, canonical_frames
from mpsnet_core.normals import normalised
from mpsnet_core.progress import Progress
from mpsnet_core.rig import LightRig


class Network(Protocol):
    """Runs an ONNX network: inputs by name to normals (N, 3, H, W) and confidence (N, 1, H, W)."""

    def __call__(
        self, inputs: dict[str, NDArray[np.float32]], count: int, *size: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...


def dense_answer(
    network: Network, card: ModelCard, capture: Capture, tile: int, progress: Progress
) -> NDArray[np.float32]:
    """(H, W, 4) the normals of `capture`, of no particular length, and their confidence; zero outside the mask.

    Photo, features and answers are made a tile at a time, so that beside the photo and this array little memory is
    needed however large they are.
    """
    answer = np.zeros((*capture.mask.shape, 4), np.float32)
    means = mean_light(capture)
    frames = canonical_frames(capture.rig.directions, card.passes) if card.frame == "canonical" else [CAMERA_FRAME]
    grids = [_grid(capture, answer, frame) for frame in frames]
    work = [
        (frame, grid, windows)
        for frame, grid in zip(frames, grids, strict=True)
        for windows in _tiles(grid.shape, tile, card.multiple, card.halo, grid.margin)
    ]
    for number, (frame, grid, (window, around, place)) in enumerate(work):
        progress(number / len(work), f"tile {number + 1} of {len(work)}")
        photo, mask = grid.read(window)
        kept = tuple(slice(a.start - w.start, a.stop - w.start) for a, w in zip(around, window, strict=True))
        if not mask[kept].any():
            continue
        inputs = _inputs(card, photo, mask, capture.rig, frame, means)
        outputs = network(inputs, 1, *_padded(mask.shape, card.multiple))
        vectors, confidence = (values[0][:, *kept] for values in outputs)
        in_camera = np.einsum("chw,cd->hwd", vectors, frame.rotation.astype(np.float32))
        share = np.clip(confidence, 0, 1) / np.float32(len(frames))
        unit = normalised(in_camera).transpose(2, 0, 1)
        grid.write(place, around, np.concatenate([unit, share]), mask[kept])
    return answer


def _grid(capture: Capture, answer: NDArray[np.float32], frame: LightFrame) -> Grid:
    # Views of the same memory: what is written into the turned answer stands in the answer.
    image: Any = np.rot90(capture.image, frame.quarter_turns)
    mask: Any = np.rot90(capture.mask, frame.quarter_turns)
    turned: Any = np.rot90(answer, frame.quarter_turns)
    return TurnedGrid(image, mask, turned, frame.rest) if frame.rest else StraightGrid(image, mask, turned)


def _inputs(
    card: ModelCard,
    photo: NDArray[np.float32],
    mask: NDArray[np.bool_],
    rig: LightRig,
    frame: LightFrame,
    means: NDArray[np.float64],
) -> dict[str, NDArray[np.float32]]:
    """What the network sees of a window, (1, C, H, W), filled up with zeros to the network's multiple."""
    order = list(frame.order)
    light, directions = rig.unmixed(photo)[..., order], frame.lights(rig.directions)
    inputs = {}
    for name, features in card.inputs.items():
        size = (1, 1) if CONSTANTS.intersection(features) else _padded(mask.shape, card.multiple)
        stacked = np.zeros((1, sum(FEATURE_CHANNELS[feature] for feature in features), *size), np.float32)
        first = 0
        for feature in features:
            values = window_map(feature, light, mask, directions, means[order])
            stacked[0, first : first + len(values), : values.shape[1], : values.shape[2]] = values
            first += len(values)
        inputs[name] = stacked
    return inputs


def _padded(shape: tuple[int, ...], multiple: int) -> tuple[int, ...]:
    return tuple(-(-length // multiple) * multiple for length in shape)


def _tiles(
    shape: tuple[int, int], tile: int, grain: int, halo: int, margin: int
) -> Iterator[tuple[Window, Window, Window]]:
    """For each tile: the window that is read, with halo and margin; the tile with its margin; the tile itself."""
    # Tiles and windows begin on the network's grain, so that pooling falls on the same pixels as untiled.
    reach = -(-(halo + margin) // grain) * grain
    height, width = shape
    down, right = (_step(length, max(1, tile // grain) * grain, grain, reach) for length in shape)

    def grown(top: int, left: int, by: int) -> Window:
        return (
            slice(max(top - by, 0), min(top + down + by, height)),
            slice(max(left - by, 0), min(left + right + by, width)),
        )

    for top in range(0, height, down):
        for left in range(0, width, right):
            yield grown(top, left, reach), grown(top, left, margin), grown(top, left, 0)


def _step(length: int, tile: int, grain: int, reach: int) -> int:
    """How long tiles are along a side: about the same for all, and no two where one window takes what two would."""
    if length <= tile + 2 * reach:
        return max(length, 1)
    return -(-length // -(-length // tile) // grain) * grain
