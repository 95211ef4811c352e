"""Object masks: from files, alpha, a threshold, a photo of the empty scene, or the image border alone."""

import logging
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from mpsnet_core.arrays import mask_regions as regions
from mpsnet_core.arrays.resampling import block_means
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.sizes import SAME_CAMERA, check_same_size
from mpsnet_core.arrays.statistics import deviation
from mpsnet_core.arrays.types import F32, I32, I64, Bools
from mpsnet_core.capture.decode import AS_STATED, Correction, PhotoReadOptions, corrected
from mpsnet_core.defaults import MASK
from mpsnet_core.errors import FileError, NoObject, Note, SettingsError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image import Image
from mpsnet_core.io.image_encoding import Encoding
from mpsnet_core.io.image_reading import read_mask
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.provenance import fingerprint

log = logging.getLogger(__name__)

MaskNotes = Literal["all", "doubts", "none"]

# Keywords for a mask, besides a file, threshold:T and background:FILE.
WORDS = ("alpha", "auto", "alpha-or-auto", "none")
ALPHA_OR_NONE = "alpha-or-none"

# The object is segmented in an image of at most this side; the outline is then refined at full size, within this many
# pixels of the small image.
WORKING_SIDE, OUTLINE = 1024, 2
# The background is estimated from the image border. Its width as a share of the shorter side; the share of it that the
# object may cover. It may cover half of it in front of a dark background, from which it then differs by more than noise
# and uneven light do: by UNLIKE display values, and NOT_NOISE times as much as the darker half of the border.
BORDER_SHARE, OBJECT_AT_BORDER, UNLIKE, NOT_NOISE = 0.04, 0.2, 0.15, 4
# Display values, 0 to 1: least contrast of the object; brightness below which a background is dark.
MIN_CONTRAST, DARK = 0.02, 0.1
# Largest gap to close, as a share of the image side. Largest holes to fill, as shares of the object's area: the first
# if a shadow may have made them, the second always.
GAP, SHADOW, SPECK = 0.004, 0.05, 0.001
# Parts smaller than this share of the largest are dropped.
PART = 0.02
# Least value of Otsu's criterion, 0 to 1, for a clear mask. A single normal distribution has 0.64.
CLEAR = 0.75
# Shares of the photo. Below the first, an unclear mask is noise; most objects are between the other two.
NOISE_SHARE, SMALL_SHARE, LARGE_SHARE = 0.002, 0.01, 0.8


@takes_files
def find_mask(
    image: Image,
    choice: AnyPath = MASK,
    *,
    encoding: Encoding = "auto",
    layer: str | None = None,
    correction: Correction | None = None,
    notes: MaskNotes = "all",
) -> Bools:
    """The object's pixels in a photo.

    Parameters
    ----------
    image : Image
        The photo, read and corrected.
    choice : str or path
        A mask file; "alpha"; "none", the whole photo; "threshold:T", see :func:`threshold_mask`; "auto", see
        :func:`auto_mask`; "background:FILE", the same scene without the object, see :func:`background_mask`;
        "alpha-or-auto": alpha if the photo has it, else "auto" if an object stands out clearly, else the whole photo.
    encoding, layer, correction
        How the photo was read and corrected. The background photo is read alike; `layer` is ignored if it has only one.
    notes : {"all", "doubts", "none"}
        What to log about a mask that is found: its size and doubts, doubts only, or nothing.

    Returns
    -------
    (H, W) bool

    Raises
    ------
    InputError
        If a file is missing or damaged, or nothing stands out from the background.
    """
    return mask_of(image, choice, PhotoReadOptions(encoding, layer, correction), notes)


def mask_of(image: Image, choice: AnyPath, options: PhotoReadOptions = AS_STATED, notes: MaskNotes = "all") -> Bools:
    """As :func:`find_mask`, which takes the options one by one.

    "alpha-or-none" is the photo's alpha if it has any, else the whole photo.
    """
    words = os.fspath(choice)
    kind, _, argument = words.partition(":")
    if words == "none" or (words == ALPHA_OR_NONE and image.alpha is None):
        return _whole(image)
    if words in ("alpha", ALPHA_OR_NONE) or (words == "alpha-or-auto" and image.alpha is not None):
        if image.alpha is None:
            raise SettingsError("the photo has no alpha channel to take the mask from; give a mask file or a threshold")
        return image.alpha > 0.5
    if words == "alpha-or-auto":
        try:
            return auto_mask(image.pixels, notes, clearly=True)
        except NoObject:
            if notes != "none":
                log.warning(
                    "no object stands out clearly from a background: the whole photo is assumed to be the object; if "
                    "it is not, choose a mask [no-mask]"
                )
            return _whole(image)
    if words == "auto":
        return auto_mask(image.pixels, notes)
    if kind == "threshold":
        return threshold_mask(image.pixels, argument)
    if kind == "background":
        background = _read_background(argument, image, options)
        return background_mask(image.pixels, background.pixels, notes)
    if not Path(words).exists():
        known = ", ".join(WORDS)
        raise FileError(f"mask {words} does not exist, and is none of {known}, threshold:T, background:FILE; check it")
    return read_mask(words)


def _read_background(file: str, photo: Image, options: PhotoReadOptions) -> Image:
    if not file:
        raise SettingsError("a mask by background names a photo of the scene without the object: background:FILE")
    return corrected(options.companion(file, photo), options.correction)


def _whole(image: Image) -> Bools:
    """(H, W) True everywhere; a read-only broadcast that takes no memory."""
    return np.broadcast_to(np.True_, image.pixels.shape[:2])


def mask_source(choice: str) -> str | None:
    """The file, folder or pattern that a mask choice names; None for a keyword, even if a folder has that name."""
    if choice in WORDS or choice.startswith("threshold:"):
        return None
    return choice.removeprefix("background:")


def mask_identity(choice: str) -> str:
    """Text that changes with the mask choice and with the contents of the files it names."""
    return fingerprint(choice) if mask_source(choice) else choice


def threshold_mask(pixels: F32, threshold: str | float) -> Bools:
    """(H, W) whether the brightest channel is above `threshold` (0 to 1) times its 99.9th percentile."""
    try:
        level = float(threshold)
    except ValueError:
        level = -1.0
    if not 0 <= level < 1:
        raise SettingsError(f"a mask threshold is a number from 0 up to 1, not {threshold!r}; 0.05 is a good start")
    brightest: F32 = np.nan_to_num(pixels.max(axis=-1), posinf=0.0)
    return brightest > level * np.percentile(brightest, 99.9)


def auto_mask(pixels: F32, notes: MaskNotes = "all", *, clearly: bool = False) -> Bools:
    """(H, W) the object in front of a dark or plain background that covers most of the image border.

    pixels: (H, W, 3) linear. The background model is a quadratic in x and y per channel, fitted to the border. The
    object differs from it by more than the border does, and by more than Otsu's threshold (1979, on the log
    differences). Gaps are closed. Small holes that a shadow may have made are filled: those in front of a dark
    background, or that do not look like the background.

    clearly: reject an object that hardly differs from the background in places. Cloth, a wall or a relief that fills
    the photo has no background, and Otsu's threshold would separate its own pattern.

    Raises GeometryError if nothing stands out.
    """
    factor = _factor(pixels)
    small = block_means(pixels, factor)
    white = _white(small)
    photo = _display_values(small, white)
    behind = _smooth_background(photo)

    def contrast(rows: slice) -> F32:
        lines, columns = np.arange(rows.start, rows.stop) // factor, np.arange(pixels.shape[1]) // factor
        return _contrast(_display_values(pixels[rows], white), behind[lines][:, columns])

    return _refine_outline(_segment(photo, behind, notes, clearly), contrast, factor, pixels.shape[:2])


def background_mask(pixels: F32, background: F32, notes: MaskNotes = "all") -> Bools:
    """(H, W) where the photo differs from a photo of the same scene without the object.

    pixels, background: (H, W, 3) linear, under the same lights. The exposures may differ: their ratio is measured at
    the image border. Otherwise as :func:`auto_mask`. Shadows that the object casts become part of the mask.

    Raises GeometryError if sizes differ or nothing stands out.
    """
    check_same_size("the background", background.shape, "the photo", pixels.shape, SAME_CAMERA)
    factor = _factor(pixels)
    small, empty = block_means(pixels, factor), block_means(background, factor)
    white = _white(small)
    scale = white / _exposure_ratio(small, empty)
    photo, behind = _display_values(small, white), _display_values(empty, scale)

    def contrast(rows: slice) -> F32:
        return _contrast(_display_values(pixels[rows], white), _display_values(background[rows], scale))

    return _refine_outline(_segment(photo, behind, notes), contrast, factor, pixels.shape[:2])


# --- what stands out --------------------------------------------------------------------------------------------------


class _Segmentation(NamedTuple):
    """The object in the small image."""

    mask: Bools
    """(h, w). The object's mask."""
    threshold: float
    """Threshold of the contrast between object and background."""


def _segment(photo: F32, behind: F32, notes: MaskNotes, clearly: bool = False) -> _Segmentation:
    """The object, where a photo differs from its background; both (H, W, 3) display values."""
    contrast = _contrast(photo, behind)
    dark = float(np.median(behind)) < DARK
    typical, high = np.quantile(contrast[_border(contrast.shape)], (0.5, 1 - OBJECT_AT_BORDER))
    if dark and high > max(UNLIKE, NOT_NOISE * typical):
        high = 1.5 * typical  # as far as the median of noise alone
    # Twice the contrast at the border, where noise and an uneven background are all there is.
    least = max(MIN_CONTRAST, 2 * float(high))
    threshold, clearness = _otsu(np.log(np.maximum(contrast, least / 4)))
    threshold = max(float(np.exp(threshold)), least)
    mask = _clean_up(contrast > threshold, contrast, threshold, dark=dark)
    if not mask.any() or (clearness < CLEAR and (clearly or mask.mean() < NOISE_SHARE)):
        raise NoObject("no object stands out from the background; give a mask file, or a photo of the background")
    if notes == "all":
        share = 100 * mask.mean()
        log.info("the mask covers %.1f%% of the photo (confidence %.0f%%)", share, 100 * clearness)
    if notes != "none":
        for doubt in _doubts(mask, clearness, plain=high <= UNLIKE):
            log.warning("%s [doubtful-mask]", doubt)
    return _Segmentation(mask, threshold)


def _clean_up(mask: Bools, contrast: F32, threshold: float, *, dark: bool) -> Bools:
    """The mask without specks, with gaps closed and holes filled that a shadow may have made."""
    mask = regions.remove_small_regions(mask, PART * regions.labelled(mask)[1][1:].max(initial=0))
    gap = max(1, round(GAP * max(mask.shape)))
    mask = regions.eroded(regions.dilated(mask, gap), gap)

    def by_shadow(labels: I32, sizes: I64) -> Bools:
        unlike = np.bincount(labels.ravel(), contrast.ravel(), len(sizes)) / np.maximum(sizes, 1)
        area = sizes[0]
        return (sizes <= SPECK * area) | ((sizes <= SHADOW * area) & (dark | (unlike > threshold / 2)))

    mask = regions.fill_holes(mask, by_shadow)
    return regions.remove_small_regions(mask, PART * regions.labelled(mask)[1][1:].max(initial=0))


def _doubts(mask: Bools, clearness: float, plain: bool) -> Iterator[Note]:
    share, touching = mask.mean(), mask[_border(mask.shape, 1)].mean()
    if clearness < CLEAR:
        yield Note("object and background hardly differ in places: look at the mask before you use it")
    if touching > 0.01:
        yield Note(
            "the mask meets %.0f%% of the photo's border: is the object completely in the picture, in front of a dark "
            "or plain background?",
            100 * touching,
        )
    if not plain:
        yield Note("the photo's border is not plain, or mostly object: look at the mask before you use it")
    holes = regions.fill_small_holes(mask, mask.size).mean() / share - 1
    if holes > SHADOW:
        yield Note(
            "the mask has holes of %.0f%% of its area, where the photo looks like the background: if they belong to "
            "the object, give a mask file or none",
            100 * holes,
        )
    if not SMALL_SHARE <= share <= LARGE_SHARE:
        small = Note("the mask is small for an object: look at it before you use it")
        yield small if share < SMALL_SHARE else Note("the mask is large for an object: look at it before you use it")


def _otsu(values: F32) -> tuple[float, float]:
    """Otsu's threshold and criterion: the variance between the classes divided by the total variance, 0 to 1."""
    counts, edges = np.histogram(values, 256)
    share, middles = counts / counts.sum(), (edges[1:] + edges[:-1]) / 2
    weight, moment = np.cumsum(share)[:-1], np.cumsum(share * middles)
    mean = moment[-1]
    inner = weight * (1 - weight)
    between = np.divide((mean * weight - moment[:-1]) ** 2, inner, out=np.zeros_like(inner), where=inner > 1e-12)
    # All thresholds between two distant classes are equally good: take the middle one.
    best = np.flatnonzero(between >= between.max() * (1 - 1e-9))
    total = float((share * (middles - mean) ** 2).sum())
    return float(edges[1 + best[len(best) // 2]]), float(between.max() / total) if total > 0 else 0.0


# --- the background ---------------------------------------------------------------------------------------------------


def _smooth_background(photo: F32) -> F32:
    """(H, W, 3) the quadratic robustly fitted to the border's values."""
    height, width, channels = photo.shape
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    powers = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1).astype(np.float32)
    border = _border(photo.shape)
    behind = np.empty_like(photo)
    for channel in range(channels):
        values, terms = photo[border, channel], powers[border]
        fitted = np.full_like(values, np.median(values))
        for _ in range(6):
            off = np.abs(values - fitted)
            agree = off <= 4 * deviation(off, MIN_CONTRAST / 8)
            factors = np.linalg.lstsq(terms[agree], values[agree], rcond=None)[0]
            fitted = terms @ factors
        behind[..., channel] = np.clip(powers @ factors, values[agree].min(), values[agree].max())
    return behind


def _exposure_ratio(photo: F32, background: F32) -> float:
    """Brightness of the photo relative to the background at the image border; 1 if that is too dark."""
    border = _border(photo.shape)
    shown, empty = photo[border], background[border]
    bright = empty > max(float(np.quantile(empty, 0.75)), 0.002 * float(photo.max()))
    return float(np.median(shown[bright] / empty[bright])) if bright.any() else 1.0


def _border(shape: tuple[int, ...], wide: int | None = None) -> Bools:
    """(H, W) pixels along the image border, `wide` pixels or BORDER_SHARE of the shorter side."""
    wide = wide or max(2, round(BORDER_SHARE * min(shape[:2])))
    border = np.ones(shape[:2], bool)
    border[wide:-wide, wide:-wide] = False
    return border


# --- sizes and scales -------------------------------------------------------------------------------------------------


def _refine_outline(
    found: _Segmentation, contrast: Callable[[slice], F32], factor: int, shape: tuple[int, ...]
) -> Bools:
    """(H, W) the small mask at full size: along its outline each pixel is thresholded by its own contrast."""
    if factor == 1:
        return found.mask
    height, width = shape
    columns = np.arange(width) // factor
    surely, maybe = regions.eroded(found.mask, OUTLINE), regions.dilated(found.mask, OUTLINE)
    mask = np.empty((height, width), bool)
    for rows in bands(height):
        lines = np.arange(rows.start, rows.stop) // factor
        mask[rows] = (contrast(rows) > found.threshold) & maybe[lines][:, columns] | surely[lines][:, columns]
    fine = factor**2 * OUTLINE**2
    return regions.remove_small_regions(regions.fill_small_holes(mask, fine), fine)


def _factor(pixels: F32) -> int:
    return int(-(-max(pixels.shape[:2]) // WORKING_SIDE))


def _white(small: F32) -> F32:
    """(3,) white point of each channel: weak and strong lights count alike."""
    return np.maximum(np.quantile(small, 0.999, axis=(0, 1)), 1e-9).astype(np.float32)


def _display_values(pixels: F32, white: F32) -> F32:
    """Roughly perceptual values, 0 to 1. The square root also makes shot noise uniform."""
    return np.sqrt(np.clip(np.nan_to_num(pixels / white), 0, 1))


def _contrast(photo: F32, behind: F32) -> F32:
    """(H, W) largest difference over the three channels."""
    return np.abs(photo - behind).max(axis=-1)
