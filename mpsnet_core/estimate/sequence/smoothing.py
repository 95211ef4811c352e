"""Temporal denoising of normals, without lag: a mean over earlier and later frames that show the same.

A bilateral filter in time (Tomasi and Manduchi 1998). Past and future have equal weights. A neighbouring frame counts
at a pixel only if the photos are equal there within camera noise, over small patches as in non-local means (Buades et
al. 2005). Moving objects keep their edges; static ones lose noise by the square root of the number of frames.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import box_sums
from mpsnet_core.defaults import MAX_SMOOTHING
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.scene.normal_map import NormalMap

PATCH = 7  # side in pixels of the patches to compare
# The mean square difference of a patch, divided by the noise variance, is 1 without motion, with a standard deviation
# of sqrt(2 / (3 * 49)) = 0.12. Up to this value, the difference counts as noise.
SURE = 1.5
# Noise grows with brightness: it is measured in this many classes of brightness, on about this many pixels in all.
CLASSES = 8
MEASURED = 32768
# Lower limit of the noise, as a share of the light; it changes a normal by about one degree. Compressed video copies
# many pixels from frame to frame, whose differences show less noise than others. In shadows, the limit is for this
# share of the mean light.
MIN_NOISE = 0.01
SHADOW = 0.2
# Lower limit of confidence: if no frame is confident, all have equal weights.
MIN_CONFIDENCE = 0.01

# Median absolute value of unit normal noise, and the gain of Immerkær's kernel (1996) on noise.
MEDIAN_OF_NOISE = 0.6745
KERNEL_GAIN = 6.0


@dataclass(frozen=True)
class EstimatedFrame:
    """A frame of which the normals are estimated."""

    number: int
    """Frame number."""
    photo: NDArray[np.floating[Any]]
    """(H, W, 3). Linear photo."""
    normals: NormalMap
    """Its estimated normals."""
    wanted: bool = True
    """Whether its smoothed normals are needed."""


def smoothed(frames: Iterable[EstimatedFrame], reach: int, step: int = 1) -> Iterator[tuple[int, NormalMap]]:
    """Number and smoothed normals of every wanted frame, in order, delayed by at most `reach` frames.

    frames: in increasing order of their numbers. reach: number of frames before and after a frame to average it with;
    fewer at the ends and where frames are missing. 0 does not smooth. step: least difference between the numbers of
    successive frames.

    Raises SettingsError if `reach` is out of range, GeometryError if two photos within it differ in size.
    """
    if not 0 <= reach <= MAX_SMOOTHING:
        raise SettingsError(f"smoothing over {reach} frames each way is out of range; choose 0 to {MAX_SMOOTHING}")
    span = reach * step
    recent: deque[EstimatedFrame] = deque()
    waiting: deque[EstimatedFrame] = deque()
    similarities: dict[tuple[int, int], NDArray[np.float32]] = {}
    for frame in frames:
        while waiting and waiting[0].number + span < frame.number:
            yield from _answer(waiting.popleft(), recent, similarities, span)
        while recent and recent[0].number < frame.number - 2 * span:
            gone = recent.popleft().number
            similarities = {pair: similarity for pair, similarity in similarities.items() if gone not in pair}
        for earlier in recent:
            if frame.number - earlier.number <= span and (frame.wanted or earlier.wanted):
                similarities[earlier.number, frame.number] = _similarity(earlier, frame)
        recent.append(frame)
        waiting.append(frame)
        while waiting and waiting[0].number + span <= frame.number:
            yield from _answer(waiting.popleft(), recent, similarities, span)
    for frame in waiting:
        yield from _answer(frame, recent, similarities, span)


def _answer(
    frame: EstimatedFrame,
    recent: Iterable[EstimatedFrame],
    similarities: dict[tuple[int, int], NDArray[np.float32]],
    span: int,
) -> Iterator[tuple[int, NormalMap]]:
    if not frame.wanted:
        return
    near = [other for other in recent if abs(other.number - frame.number) <= span]
    if len(near) == 1:
        yield frame.number, frame.normals
        return
    total = np.zeros_like(frame.normals.vectors)
    for other in near:
        weight = other.normals.confidence + np.float32(MIN_CONFIDENCE)
        if other is not frame:
            weight = weight * similarities[min(frame.number, other.number), max(frame.number, other.number)]
        total += weight[..., None] * other.normals.vectors  # normals are zero outside their mask
    yield frame.number, NormalMap(total, frame.normals.mask, frame.normals.confidence)


def _similarity(a: EstimatedFrame, b: EstimatedFrame) -> NDArray[np.float32]:
    """(H, W) weights, 0 to 1, of how certainly two photos are equal around a pixel, up to noise; 0 outside a mask."""
    if a.photo.shape != b.photo.shape:
        sizes = " and ".join(f"{frame.photo.shape[1]} x {frame.photo.shape[0]}" for frame in (a, b))
        raise GeometryError(f"frames {a.number} and {b.number} are {sizes}; smoothing needs frames of one size")
    both = a.normals.mask & b.normals.mask
    squares = np.zeros(both.shape, np.float32)
    for channel in range(3):
        first, second = (frame.photo[..., channel].astype(np.float32, copy=False) for frame in (a, b))
        difference = np.where(both, second - first, np.float32(0))
        squares += np.square(difference / _noise(difference, (first + second) / np.float32(2), both))
    count = box_sums(both.astype(np.float32), PATCH // 2)
    mean_square = box_sums(squares, PATCH // 2) / np.maximum(3 * count, 1)
    return np.where(both, np.exp(-np.maximum(mean_square - SURE, 0)), 0).astype(np.float32)


def _noise(
    difference: NDArray[np.float32], brightness: NDArray[np.float32], inside: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """(H, W) standard deviation of the noise in a difference of photos, as a function of brightness.

    Immerkær's kernel removes constants and gradients from the difference. The remainder is noise, except along moving
    edges, which the median ignores.
    """
    across = difference[:, :-2] - 2 * difference[:, 1:-1] + difference[:, 2:]
    rest = np.abs(across[:-2] - 2 * across[1:-1] + across[2:]) / (KERNEL_GAIN * MEDIAN_OF_NOISE)
    whole = inside[:, :-2] & inside[:, 1:-1] & inside[:, 2:]
    places = np.flatnonzero(whole[:-2] & whole[1:-1] & whole[2:])
    places = places[:: max(1, len(places) // MEASURED)]
    mean = float(brightness.mean(where=inside)) if inside.any() else 0.0
    least = np.float32(MIN_NOISE) * np.maximum(brightness, np.float32(max(SHADOW * mean, 1e-6)))
    if len(places) < CLASSES:
        return least
    rest, level = rest.ravel()[places], brightness[1:-1, 1:-1].ravel()[places]
    classes = np.array_split(np.argsort(level, kind="stable"), CLASSES)
    levels = [float(level[members].mean()) for members in classes]
    strengths = [float(np.median(rest[members])) for members in classes]
    return np.maximum(np.interp(brightness, levels, strengths).astype(np.float32), least)
