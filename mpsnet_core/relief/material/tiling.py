"""Detection of a material's periods: the two steps in the photo after which a weave repeats."""

from dataclasses import dataclass

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.arrays.mask_regions import box_sums
from mpsnet_core.arrays.resampling import block_means
from mpsnet_core.arrays.types import F32, F64, I64, Bools, Floats

# Steps are searched in an image whose longer side is at most this, then refined in the photo itself.
LONGEST = 2048
REFINED = 512
# A tile of a weave is at least this fraction of the photo.
MIN_TILE = 0.4
# Largest rotation of a weave, and deviation of its threads from a right angle, as gradients.
TURN, SKEW = 0.1, 0.03
# Least autocorrelation of a weave. Materials that do not repeat reach 0.1 or 0.2; one that reaches more by chance is
# joined all the better.
MIN_CORRELATION = 0.25
# Steps count as equally good down to this fraction of the best one. If there are very many, as in a fine weave, the
# longest ones are kept.
NEARLY = 0.9
MAX_PEAKS = 1000


@dataclass(frozen=True)
class Tiling:
    """The two steps by which a tile of the material is repeated."""

    right: F64
    """(2,) float64. Step to the neighbour on the right, (columns, rows) of the photo's pixels."""
    down: F64
    """(2,) float64. Step to the neighbour below, (columns, rows) of the photo's pixels."""
    correlation: tuple[float | None, float | None]
    """Autocorrelation of the photo at each step: 1 if it repeats exactly, 0 if uncorrelated. None if no step stands
    out: the material does not repeat, and the tile is as large as the photo allows."""


def find_tiling(features: F32, overlap: float) -> Tiling:
    """The tiling of a material, from the photo's features (H, W, C) of mean 0.

    A weave's step is a whole number of thread periods: a peak of the features' autocorrelation. Of the pairs of steps
    that are nearly perpendicular and leave room for the overlap (a fraction of the tile), the one with the largest tile
    is chosen: fewer repeats are visible.
    """
    height, width = features.shape[:2]
    factor = -(-max(height, width) // LONGEST)
    small = block_means(features, factor) if factor > 1 else features
    frame = np.array([width, height]) / (1 + overlap)
    across = _peaks(_autocorrelation(small, frame[0] / factor))
    down = _peaks(_autocorrelation(small.swapaxes(0, 1), frame[1] / factor))
    found = _chosen(across, _Peaks(down.steps[:, ::-1], down.correlation), frame / factor)
    exact = [None if one is None else (_refined(features, one[0] * factor, factor), one[1]) for one in found]
    return _filled(exact, frame)


# Of an image, for steps along an axis: (2 across + 1, N) the autocorrelation, whose rows are pixels sideways, columns
# pixels along the axis; the shortest step along the axis; and how far the steps reach sideways, in pixels.
_Autocorrelation = tuple[F64, int, int]


def _autocorrelation(seen: F32, most: float) -> _Autocorrelation:
    """``1 - Σ|f(x) - f(x + s)|² / Σ(|f(x)|² + |f(x + s)|²)`` over x with both in the image; steps s along columns."""
    height, width, channels = seen.shape
    last = max(1, min(int(most), width - 1))
    least, across = max(1, int(MIN_TILE * last)), max(1, min(int(TURN * last), height // 4))
    shape = tuple(-(-side // 128) * 128 for side in (height + across, width + last))
    product = np.zeros((2 * across + 1, last - least + 1))
    for channel in range(channels):
        spectrum = np.fft.rfft2(seen[..., channel], shape)
        correlation = np.fft.irfft2(np.abs(spectrum) ** 2, shape)
        product += correlation[np.arange(-across, across + 1), least : last + 1]
    energy = np.zeros((height + 1, width + 1))
    energy[1:, 1:] = np.einsum("ijk,ijk->ij", seen, seen, dtype=np.float64).cumsum(axis=0).cumsum(axis=1)
    sideways, along = np.arange(-across, across + 1)[:, None], np.arange(least, last + 1)
    own, shifted = (_box(energy, sign * sideways, sign * along) for sign in (1, -1))
    return 2 * product / np.maximum(own + shifted, 1e-12), least, across


def _box(table: F64, sideways: I64, along: I64) -> F64:
    """Sums over the part of an image that stays within it after a step (`sideways` rows, `along` columns)."""
    height, width = table.shape[0] - 1, table.shape[1] - 1
    top, bottom = np.maximum(-sideways, 0), height - np.maximum(sideways, 0)
    left, right = np.maximum(-along, 0), width - np.maximum(along, 0)
    return table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]


@dataclass(frozen=True)
class _Peaks:
    """N peaks of the autocorrelation, the longest step first."""

    steps: F64
    """(N, 2) float64. Steps of the peaks."""
    correlation: F64
    """(N,) float64. Autocorrelation at the peaks."""


# A step (columns, rows) and the autocorrelation there.
_Found = tuple[F64, float]


def _peaks(autocorrelation: _Autocorrelation) -> _Peaks:
    """The peaks that are nearly as high as the highest; none if that may be due to chance."""
    values, least, across = autocorrelation
    sideways, along = np.arange(-across, across + 1)[:, None], np.arange(values.shape[1]) + least
    peaks = np.zeros(values.shape, bool)
    highest = np.lib.stride_tricks.sliding_window_view(values, (3, 3)).max(axis=(2, 3))
    peaks[1:-1, 1:-1] = values[1:-1, 1:-1] == highest
    heights = np.where(peaks & (np.abs(sideways) <= TURN * along), values, -1.0)
    best = heights.max()
    rows, columns = np.nonzero(heights >= max(NEARLY * best, MIN_CORRELATION))
    order = np.argsort(-columns, kind="stable")[:MAX_PEAKS]
    rows, columns = rows[order], columns[order]
    places = []
    for row, column in zip(rows, columns, strict=True):
        along_peak, aside_peak = _peak(values[row, column - 1 : column + 2]), _peak(values[row - 1 : row + 2, column])
        places.append((least + column + along_peak, row - across + aside_peak))
    return _Peaks(np.reshape(places, (-1, 2)), heights[rows, columns])


def _chosen(across: _Peaks, down: _Peaks, frame: F64) -> list[_Found | None]:
    """The step across and the step down; None for one without repetition. frame: (2,) room for the tile alone."""
    pairs = [across.steps[:, None], down.steps[None]]
    skew = np.abs(pairs[0][..., 1] / pairs[0][..., 0] + pairs[1][..., 0] / pairs[1][..., 1])
    fits = (np.abs(pairs[0]) + np.abs(pairs[1]) <= frame).all(axis=-1)
    area = pairs[0][..., 0] * pairs[1][..., 1] - pairs[0][..., 1] * pairs[1][..., 0]
    area = np.where(fits & (skew <= SKEW), area, 0)
    if area.max(initial=0) > 0:
        i, j = np.unravel_index(np.argmax(area), area.shape)
        return [(across.steps[i], float(across.correlation[i])), (down.steps[j], float(down.correlation[j]))]
    found: list[_Found | None] = [None, None]
    # Only one of them repeats, if any: the one with the higher autocorrelation.
    axis = int(across.correlation.max(initial=0) < down.correlation.max(initial=0))
    peaks = (across, down)[axis]
    gradient = np.abs(peaks.steps[:, 1 - axis] / peaks.steps[:, axis])
    fitting = np.flatnonzero(peaks.steps[:, axis] + gradient * frame[1 - axis] <= frame[axis])
    if len(fitting):
        found[axis] = peaks.steps[fitting[0]], float(peaks.correlation[fitting[0]])
    return found


def _peak(three: F64) -> float:
    """Position of the peak, from -0.5 to 0.5, of the parabola through three values; the middle one is the highest."""
    curve = three[0] - 2 * three[1] + three[2]
    return float(np.clip(0.5 * (three[0] - three[2]) / curve, -0.5, 0.5)) if curve < 0 else 0.0


def _refined(features: F32, step: F64, factor: int) -> F64:
    """The step, found in an image `factor` times smaller, refined in the centre of the part where both its ends lie."""
    if factor == 1:
        return step
    reach = factor + 1
    whole = np.round(step[::-1]).astype(int)  # rows, columns
    sides = np.array(features.shape[:2])
    size = np.minimum(REFINED, sides - np.abs(whole) - 2 * reach)
    if size.min() < 4 * reach:
        return step
    top, left = (sides - np.abs(whole) - size) // 2 + np.maximum(-whole, 0)
    own = features[top : top + size[0], left : left + size[1]]
    apart = np.empty((2 * reach + 1, 2 * reach + 1))
    for i, j in np.ndindex(apart.shape):
        row, column = top + whole[0] + i - reach, left + whole[1] + j - reach
        shifted = features[row : row + size[0], column : column + size[1]]
        apart[i, j] = np.square(own - shifted).mean()
    i, j = (int(place) + 1 for place in np.unravel_index(np.argmin(apart[1:-1, 1:-1]), (2 * reach - 1, 2 * reach - 1)))
    exact = whole - reach + (i + _peak(-apart[i - 1 : i + 2, j]), j + _peak(-apart[i, j - 1 : j + 2]))
    return np.asarray(exact[::-1], np.float64)


def _filled(found: list[_Found | None], frame: F64) -> Tiling:
    """The tiling, where a direction without repetition gets the longest step that fits, perpendicular to the other."""
    right, down = found
    if right is not None and down is not None:
        steps = right[0], down[0]
    elif right is not None:
        steps = right[0], _across(np.array([-right[0][1], right[0][0]]), right[0], frame, 1)
    elif down is not None:
        steps = _across(np.array([down[0][1], -down[0][0]]), down[0], frame, 0), down[0]
    else:
        longest = np.floor(frame)
        steps = np.array([longest[0], 0.0]), np.array([0.0, longest[1]])
    return Tiling(*steps, (right and right[1], down and down[1]))


def _across(square: F64, step: F64, frame: F64, axis: int) -> F64:
    """The longest step along `square`, mostly along the axis, for which there is room next to the other step."""
    square = square / square[axis]
    lengths = (frame - np.abs(step)) / np.maximum(np.abs(square), 1e-9)
    return square * np.floor(lengths.min())


# ----------------------------------------------------------------------------------------------------------------------
# Resampling of the part of a photo that becomes the tile.


def sampled(features: F32, tiling: Tiling, size: tuple[int, int], overlap: tuple[int, int]) -> F32:
    """(H + overlap[0], W + overlap[1], C) the centre of the photo, resampled along the tiling's steps.

    features: (H', W', C), of which the first two are gradients along columns and rows; they become gradients along the
        tiling's steps. size: (H, W) pixels of a tile. A tile aligned with the photo's pixels is cropped unchanged.
    """
    steps = np.stack([tiling.right, tiling.down])
    rows, columns = size[0] + overlap[0], size[1] + overlap[1]
    spans = np.array([columns / size[1], rows / size[0]])
    start = (np.array(features.shape[1::-1]) - spans @ steps) / 2
    if np.array_equal(steps, np.diag(size[::-1])):
        left, top = np.round(start).astype(int)
        return features[top : top + rows, left : left + columns].copy()
    places = np.zeros((3, 3))  # maps row vectors of the tile's pixels to the photo's
    places[:2, :2], places[2, :2], places[2, 2] = steps / [[size[1]], [size[0]]], start, 1
    taken = resampled(features, places, (rows, columns))
    along = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    taken[..., :2] = taken[..., :2] @ along.T.astype(np.float32)
    return taken


def resampled(values: F32, places: F64, shape: tuple[int, int], *, repeated: bool = False) -> F32:
    """Resample values (H, W, C) to `shape` under an affine map, low-pass filtered for reductions.

    places: (3, 3) matrix that maps a row vector (column, row, 1) to its position in `values`. repeated: values wrap
        around at their border.
    """
    values_to_places = tuple(np.linalg.inv(places).ravel().tolist())
    whole = oiio.ROI(0, shape[1], 0, shape[0], 0, 1, 0, values.shape[2])
    source = oiio.ImageBuf(np.ascontiguousarray(values))
    beyond = "periodic" if repeated else "clamp"
    found = oiio.ImageBufAlgo.warp(source, values_to_places, "catmull-rom", 0.0, False, beyond, whole)
    return np.asarray(found.get_pixels(oiio.FLOAT), np.float32)


# ----------------------------------------------------------------------------------------------------------------------
# Seamless tiles: overlapping borders of an image joined along the line where they differ least.


# Pixels of cross-fade on either side of the cut.
FEATHER = 2
# Rows that a cut needs: its own, and the feather on either side.
MIN_JOINED = 2 * FEATHER + 1
# Differences coarser than the overlap divided by this are faded over all of it: a cut would show them as an edge.
FADED = 8


def seamless(patch: F32, overlap: tuple[int, int]) -> tuple[F32, Bools]:
    """A tile (H, W, C) that repeats without a seam, from a larger image, and the places of its cuts.

    patch: (H + overlap[0], W + overlap[1], C): the rows and columns of the overlap at its end are equal, or similar, to
        those at its beginning. All channels share one cut, where their total difference is smallest.

    Returns the tile and (H, W) bool, True on the cuts. The tile's own border has no cut: the patch continues across it.
    """
    across, cut = _make_rows_seamless(patch.swapaxes(0, 1), overlap[1], closed=False)
    done, second_cut = _make_rows_seamless(across.swapaxes(0, 1), overlap[0], closed=True)
    # Keep the first cut in the rows that remain; the last rows were the overlap.
    cut = cut.swapaxes(0, 1)[: len(done)]
    return done, cut | second_cut


def _make_rows_seamless(patch: F32, overlap: int, *, closed: bool) -> tuple[F32, Bools]:
    """The patch without its last `overlap` rows, blended so that its first row continues its last; and the cut.

    closed: the patch repeats along columns already, so the cut must meet itself there.
    """
    first, second = patch[:overlap], patch[len(patch) - overlap :]
    apart = first - second
    coarse = _coarse(apart, max(1, overlap // FADED), closed)
    line = minimum_cut(np.square(apart - coarse).sum(axis=-1), closed=closed)
    rows = np.arange(overlap)[:, None]
    share = _eased((rows - line + FEATHER) / (2 * FEATHER))[..., None]
    faded = _eased((rows[..., None] + 0.5) / overlap)
    done = patch[: len(patch) - overlap].copy()
    done[:overlap] = second + share * (apart - coarse) + faded * coarse
    cut = np.zeros(done.shape[:2], bool)
    cut[:overlap] = rows == line
    return done, cut


def minimum_cut(cost: Floats, *, closed: bool) -> I64:
    """(W,) the row in each column of the minimum-cost line across `cost` (H, W) (Efros and Freeman 2001).

    The line moves by at most one row per column, and stays FEATHER rows away from the upper and lower edge. closed: it
    ends next to its start. Then it is the best line through the cheapest point of the open one.
    """
    inner = cost[FEATHER : len(cost) - FEATHER]
    line = _open_cut(inner, None)
    if closed:
        column = int(np.argmin(inner[line, np.arange(len(line))]))
        line = np.roll(_open_cut(np.roll(inner, -column, axis=1), int(line[column])), column)
    return line + FEATHER


def _open_cut(cost: Floats, through: int | None) -> I64:
    """The cheapest line by dynamic programming. If `through` is given, it starts in that row and ends next to it."""
    height, width = cost.shape
    total = cost[:, 0].astype(np.float64)
    if through is not None:
        total[np.arange(height) != through] = np.inf
    came = np.zeros((width, height), np.int8)
    rows = np.arange(height)
    for column in range(1, width):
        padded = np.concatenate([[np.inf], total, [np.inf]])
        choices = np.stack([padded[1:-1], padded[:-2], padded[2:]])
        best = choices.argmin(axis=0)
        came[column] = np.array([0, -1, 1], np.int8)[best]
        total = choices[best, rows] + cost[:, column]
    if through is not None:
        total[np.abs(rows - through) > 1] = np.inf
    line = np.empty(width, np.int64)
    line[-1] = np.argmin(total)
    for column in range(width - 1, 0, -1):
        line[column - 1] = line[column] + came[column, line[column]]
    return line


def _coarse(apart: F32, reach: int, closed: bool) -> F32:
    """The low frequencies, coarser than `reach` pixels: a box filter over squares, applied twice."""
    sides = (2 * reach, 2 * reach) if closed else (0, 0)
    padded = np.pad(apart, ((0, 0), sides, (0, 0)), mode="wrap")
    counts = box_sums(np.ones(padded.shape[:2]), reach)
    for channel in range(padded.shape[-1]):
        for _ in range(2):
            padded[..., channel] = box_sums(padded[..., channel], reach) / counts
    return padded[:, sides[0] : padded.shape[1] - sides[1]]


def _eased(share: Floats) -> F32:
    """Smoothstep from 0 to 1."""
    share = np.clip(share, 0, 1)
    return (share * share * (3 - 2 * share)).astype(np.float32)


@dataclass(frozen=True)
class Seam:
    """Visibility of a tile's joins: the change of normals across them, relative to elsewhere. 1 is invisible."""

    border: tuple[float, float]
    """Angle between normals on either side of the tile's border, divided by that between any two neighbours; the mean
    and the 95th percentile."""
    cut: tuple[float, float]
    """The same across the cuts."""


def measure_seam(normals: F32, cut: Bools) -> Seam:
    """Measure how visible the joins of a tile's normals (H, W, 3) are. cut: (H, W) where it was cut."""
    border, cuts, inner = [], [], []
    for axis in (0, 1):
        turned = np.linalg.norm(np.roll(normals, -1, axis) - normals, axis=-1)
        crossed = cut | np.roll(cut, -1, axis)
        last = np.zeros_like(cut)
        last[(-1,) if axis == 0 else (slice(None), -1)] = True
        border.append(turned[last])
        cuts.append(turned[crossed & ~last])
        inner.append(turned[~crossed & ~last])
    return Seam(_shares(border, inner), _shares(cuts, inner))


def _shares(steps: list[F32], inner: list[F32]) -> tuple[float, float]:
    these, those = np.concatenate(steps), np.concatenate(inner)
    if not len(these):
        return 1.0, 1.0
    low = 1e-6  # a flat surface has no steps at all
    mean = (float(these.mean()) + low) / (float(those.mean()) + low)
    return mean, (float(np.percentile(these, 95)) + low) / (float(np.percentile(those, 95)) + low)
