"""Inference of dense networks: in tiles over the object's bounding box; pyramids from coarse to fine scales."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.resampling import chosen_pixels, means_inside, upsampled
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools, Floats
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.card import ModelCard
from mpsnet_core.estimate.features import (
    CAMERA_FRAME,
    CONSTANTS,
    LightFrame,
    PhotoCrop,
    canonical_frames,
    channel_count,
    feature_map,
    feature_maps,
    mean_light,
)
from mpsnet_core.io.image import storage_type
from mpsnet_core.progress import Progress, part

T = TypeVar("T", bound=np.generic)
Window = tuple[slice, slice]

# A pyramid starts at the scale where the object's longer side is at most this many pixels.
COARSEST = 128
# Images of up to this many pixels a side are magnified if the card says so.
SMALL = 256
# Scales of more pixels are interpolated where only the surface's colours are wanted. Where the finest one has more, one
# of its three or more passes is left out: coarser scales have averaged them.
FINE = 1 << 22
RIGHT_ANGLE = np.float32(np.pi / 2)
# Pixels of a large photo that are read at a time to make a coarse scale.
READ_AT_ONCE = 1 << 20


class NetworkRunner(Protocol):
    """Runs an ONNX network: inputs by name to normals (N, 3, H, W) and confidence (N, 1, H, W)."""

    def __call__(self, inputs: dict[str, F32], count: int, *size: int) -> tuple[F32, F32]: ...


def predict_dense(
    network: NetworkRunner, card: ModelCard, capture: Capture, tile: int, progress: Progress, *, rough: bool = False
) -> Floats:
    """(H, W, 4) normals of `capture`, not normalised, and their confidence; zero outside the mask.

    A pyramid's first scale shows the whole object on at most 128 pixels a side. Each further scale has twice the
    resolution, and the network sees its own output on the previous scale. A pixel of a coarse scale is the mean of its
    photo pixels inside the mask. Several passes are averaged on every scale; a large finest scale leaves out the first
    of three or more.

    rough: whether to interpolate the scales of more than 4 megapixels.

    If the card says to magnify, the finest scale of at most 256 pixels a side is magnified and estimated by a pyramid
    of its own: a small photo has too few scales.

    Scales, features and outputs are computed a tile at a time: large photos need little memory beyond the photo and
    the returned array.
    """
    output: Floats = np.zeros((*capture.mask.shape, 4), storage_type(capture.mask.shape))
    photo = _Photo(capture)
    frames = canonical_frames(capture.rig.directions, card.passes) if card.frame == "canonical" else [CAMERA_FRAME]
    first = SMALL if card.magnified > 1 else COARSEST
    halvings = photo.halvings(first) if card.kind == "pyramid" else 0
    previous: Floats | None = None
    if card.magnified > 1:
        rest = sum(4.0**k for k in range(1, halvings + 1))
        share = card.magnified**2 / (card.magnified**2 + rest)
        previous = _predict_magnified(network, card, photo, halvings, tile, part(progress, 0.0, share))
        progress, halvings = part(progress, share, 1.0), halvings - 1
        if halvings < 0:
            output[photo.box] = previous
    for halving in range(halvings, -1, -1):
        shape = photo.shape(halving)
        fine = previous is not None and shape[0] * shape[1] > FINE
        left_out = 1 if fine and halving == 0 and len(frames) > 2 else 0
        chosen = [] if rough and fine else frames[left_out:]
        result = output[photo.box] if halving == 0 else np.zeros((*shape, 4), storage_type(shape))
        work = list(_tiles(shape, tile, card.multiple, card.halo))
        for number, (window, place) in enumerate(work):
            if previous is not None:  # free the rows that no further tile reads
                rows, _ = _window_on_previous_scale(window, previous)
                previous.resize((rows.stop, *previous.shape[1:]), refcheck=False)
            progress(_share_done(halving, halvings, number / len(work)), f"tile {number + 1} of {len(work)}")
            if photo.holds_object(place, halving):
                inner, crop = _relative_to_window(place, window), photo.crop(window, halving, previous)
                for frame in chosen:
                    result[place] += _predict_tile(network, card, crop, frame)[inner] / np.float32(len(chosen))
                if not chosen and crop.previous is not None:
                    result[place] = _as_output(crop.previous)[inner] * crop.mask[inner][..., None]
        previous = result
    return output


def _predict_magnified(
    network: NetworkRunner, card: ModelCard, photo: "_Photo", halving: int, tile: int, progress: Progress
) -> F32:
    """(h, w, 4) the output on a scale, estimated from its magnified image."""
    height, width = photo.shape(halving)
    crop = photo.crop((slice(0, height), slice(0, width)), halving, None)
    large = _magnified(photo.capture, crop, card.magnified)
    found = predict_dense(network, replace(card, magnified=1.0), large, tile, progress).astype(np.float32, copy=False)
    found[..., :3] = normalised(found[..., :3])
    return _resized(found, large.mask, (height, width)) * crop.mask[..., None]


def _magnified(capture: Capture, crop: PhotoCrop, times: float) -> Capture:
    """A whole scale as a capture of its own, magnified bilinearly from the pixels inside the mask."""
    shape = round(crop.mask.shape[0] * times), round(crop.mask.shape[1] * times)
    light = _resized(crop.light, crop.mask, shape)
    rows, columns = chosen_pixels(*shape, *crop.mask.shape)
    rig = replace(capture.rig, mixing=np.eye(3))
    # The white photo only marks that it has been applied already.
    return Capture(light, crop.mask[rows][:, columns], rig, white=light if crop.grey else None)


def _resized(values: F32, mask: Bools, shape: tuple[int, int]) -> F32:
    """Values (h, w, C) resized bilinearly to (H, W), from the pixels inside the mask only."""
    inside = mask[..., None].astype(np.float32)
    covered = np.maximum(upsampled(inside, shape, slice(None)), np.float32(1e-3))
    return upsampled(values * inside, shape, slice(None)) / covered


def _share_done(halving: int, halvings: int, share: float) -> float:
    """The share of all work that is done: each scale has four times the pixels of the previous one."""
    work = [4.0**-k for k in range(halvings + 1)]
    return (sum(work[halving + 1 :]) + share * work[halving]) / sum(work)


def _relative_to_window(place: Window, window: Window) -> Window:
    rows, columns = (slice(a.start - w.start, a.stop - w.start) for a, w in zip(place, window, strict=True))
    return rows, columns


class _Photo:
    """The photo within the object's bounding box, on any scale."""

    def __init__(self, capture: Capture) -> None:
        self.box = bounding_box(capture.mask)
        self.capture = capture
        self._means = mean_light(capture)

    def shape(self, halving: int) -> tuple[int, int]:
        """Height and width of the box on a scale."""
        height, width = (-(-(side.stop - side.start) >> halving) for side in self.box)
        return height, width

    def halvings(self, side: int) -> int:
        """How often to halve the resolution until the object's longer side is at most `side` pixels."""
        count = 0
        while max(self.shape(count)) > side:
            count += 1
        return count

    def holds_object(self, window: Window, halving: int) -> bool:
        """Whether any pixel of the object is in a window of a scale."""
        return bool(self.capture.mask[self._photo_pixels(*window, halving)].any())

    def crop(self, window: Window, halving: int, previous: Floats | None) -> PhotoCrop:
        """A window of a scale, with the output (h, w, 4) on the previous scale."""
        light, mask = self._read(window, halving)
        before = None if previous is None else _previous(previous, window)
        rig, grey = self.capture.rig, self.capture.white is not None
        return PhotoCrop(light, mask, rig.directions, self._means, before, rig.is_ground_truth, grey)

    def _read(self, window: Window, halving: int) -> tuple[F32, Bools]:
        shape = window[0].stop - window[0].start, window[1].stop - window[1].start
        image, mask = np.zeros((*shape, 3), np.float32), np.zeros(shape, bool)
        # A few rows of the window at a time: a row of a coarse scale covers many of the photo's own rows.
        rows = max(1, READ_AT_ONCE // (shape[1] << 2 * halving))
        for top in range(0, shape[0], rows):
            part = slice(top, min(top + rows, shape[0]))
            own = slice(window[0].start + part.start, window[0].start + part.stop)
            place = self._photo_pixels(own, window[1], halving)
            pixels = self.capture.image[place].astype(np.float32, copy=False)
            image[part], mask[part] = means_inside(pixels, self.capture.mask[place], halving)
        return self.capture.rig.unmixed(image), mask

    def _photo_pixels(self, rows: slice, columns: slice, halving: int) -> Window:
        first, second = (
            slice(side.start + (part.start << halving), min(side.start + (part.stop << halving), side.stop))
            for side, part in zip(self.box, (rows, columns), strict=True)
        )
        return first, second


def _previous(output: Floats, window: Window) -> F32:
    """The map "previous" (h, w, 4) of a window at twice the resolution of `output`; bilinear, ignoring empty pixels."""
    rows, columns = _window_on_previous_scale(window, output)
    part = output[rows, columns].astype(np.float32)
    filled = (part[..., :3] != 0).any(axis=-1, keepdims=True)
    part[..., :3] = normalised(part[..., :3])
    part[..., 3:] = (1 - part[..., 3:]) * RIGHT_ANGLE
    part = np.concatenate([part, np.ones_like(filled, np.float32)], axis=-1) * filled
    part = upsampled(part, (2 * part.shape[0], 2 * part.shape[1]), slice(None))
    down, right = (
        slice(side.start - 2 * source.start, side.stop - 2 * source.start)
        for side, source in zip(window, (rows, columns), strict=True)
    )
    part = part[down, right]
    values: F32 = np.divide(part[..., :4], np.maximum(part[..., 4:], np.float32(1e-3)))
    values[..., :3] = normalised(values[..., :3])
    return values


def _as_output(previous: F32) -> F32:
    """The map "previous" (h, w, 4) as an output: with its confidence in place of the expected error."""
    return np.concatenate([previous[..., :3], 1 - previous[..., 3:] / RIGHT_ANGLE], axis=-1)


def _window_on_previous_scale(window: Window, output: Floats) -> Window:
    """The part of an output that a window at twice its resolution needs."""
    rows, columns = (
        slice(max(side.start // 2 - 1, 0), min(-(-side.stop // 2) + 1, length))
        for side, length in zip(window, output.shape, strict=False)
    )
    return rows, columns


def _predict_tile(network: NetworkRunner, card: ModelCard, crop: PhotoCrop, frame: LightFrame) -> F32:
    """(H, W, 4) unit normals in camera space and confidence; zero outside the mask."""
    height, width = crop.mask.shape
    size = _padded(frame.picture(crop.mask).shape, card.multiple)
    vectors, confidence = (values[0] for values in network(_inputs(card, crop, frame), 1, *size))
    output = np.zeros((*_padded(crop.mask.shape, card.multiple), 4), np.float32)
    view = frame.picture(output)
    rotated = frame.rotation.T.astype(np.float32) @ vectors.reshape(3, -1)
    view[..., :3] = rotated.reshape(vectors.shape).transpose(1, 2, 0)
    view[..., 3] = np.clip(confidence[0], 0, 1)
    return output[:height, :width] * crop.mask[..., None]


def _inputs(card: ModelCard, crop: PhotoCrop, frame: LightFrame) -> dict[str, F32]:
    """The network's inputs by name, (1, C, H, W), in a light frame."""
    turned = _in_frame(crop, frame, card.multiple)
    inputs = {}
    for name, features in card.inputs.items():
        size = (1, 1) if CONSTANTS.intersection(features) else turned.mask.shape
        stacked = np.empty((1, channel_count(features), *size), np.float32)
        first = 0
        for feature in features:
            values = feature_map(feature, turned)
            stacked[0, first : first + len(values)] = values
            first += len(values)
        inputs[name] = stacked
    return inputs


def _in_frame(crop: PhotoCrop, frame: LightFrame, multiple: int) -> PhotoCrop:
    """A window in a light frame, padded with zeros to the network's multiple."""
    order = list(frame.order)

    def picture(values: NDArray[T]) -> NDArray[T]:
        padded = np.zeros((*_padded(values.shape[:2], multiple), *values.shape[2:]), values.dtype)
        padded[: values.shape[0], : values.shape[1]] = values
        return frame.picture(padded)

    previous = None
    if crop.previous is not None:
        previous = picture(crop.previous)
        previous[..., :3] = previous[..., :3] @ frame.rotation.T.astype(np.float32)
    light, mask = picture(crop.light)[..., order], picture(crop.mask)
    lights, means = frame.lights(crop.directions), crop.means[order]
    return crop._replace(light=light, mask=mask, directions=lights, means=means, previous=previous)


def _padded(shape: tuple[int, ...], multiple: int) -> tuple[int, ...]:
    return tuple(-(-length // multiple) * multiple for length in shape)


def _tiles(shape: tuple[int, int], tile: int, grain: int, halo: int) -> Iterator[tuple[Window, Window]]:
    """For each tile, from the bottom up: the window to read, which includes the halo, and the tile itself."""
    # Tiles and windows start at multiples of `grain`: pooling then covers the same pixels as without tiles.
    reach = -(-halo // grain) * grain
    height, width = shape
    down, right = (_step(length, max(1, tile // grain) * grain, grain, reach) for length in shape)

    def grown(top: int, left: int, by: int) -> Window:
        rows = slice(max(top - by, 0), min(top + down + by, height))
        return rows, slice(max(left - by, 0), min(left + right + by, width))

    for top in reversed(range(0, height, down)):
        for left in range(0, width, right):
            yield grown(top, left, reach), grown(top, left, 0)


def _step(length: int, tile: int, grain: int, reach: int) -> int:
    """Length of the tiles along one side: about equal, or the whole side if one window covers it."""
    if length <= tile + 2 * reach:
        return max(length, 1)
    return -(-length // -(-length // tile) // grain) * grain


# --- patch-wise networks: one small patch around every pixel of the object, in batches --------------------------------


# The values between a network's layers stay in the processor's last cache.
PATCHES_A_BATCH = 128


def predict_patches(network: NetworkRunner, card: ModelCard, capture: Capture, progress: Progress) -> F32:
    """(H, W, 4) normals of `capture`, not normalised, and their confidence; zero outside the mask."""
    side, reach = card.patch, card.patch // 2
    box = bounding_box(capture.mask)
    mask = capture.mask[box]
    # Maps are zero outside the mask, so the bounding box holds all of them.
    cut = Capture(capture.image[box], mask, capture.rig, white=None if capture.white is None else capture.white[box])
    maps = feature_maps(cut, {name for names in card.inputs.values() for name in names})
    inputs = {name: np.concatenate([maps[f] for f in features]) for name, features in card.inputs.items()}
    # Constants are shared by all patches; the other inputs are views, indexed by each patch's middle pixel.
    constants = {name: values for name, values in inputs.items() if CONSTANTS.intersection(card.inputs[name])}
    windows = {}
    for name in inputs.keys() - constants.keys():
        padded = np.pad(inputs[name], [(0, 0), (reach, reach), (reach, reach)])
        windows[name] = np.lib.stride_tricks.sliding_window_view(padded, (len(padded), side, side))[0]
    output = np.zeros((*capture.mask.shape, 4), np.float32)
    inside = output[box]
    rows, columns = np.nonzero(mask)
    for some in bands(len(rows), PATCHES_A_BATCH):
        progress(some.start / len(rows), f"pixel {some.start} of {len(rows)}")
        y, x = rows[some], columns[some]
        batch = {name: view[y, x] for name, view in windows.items()}
        batch |= {name: np.broadcast_to(values, (len(y), *values.shape)) for name, values in constants.items()}
        inside[y, x] = np.concatenate(network(batch, len(y)), axis=1)
    return output
