"""Checks of a photo before it is used: exposure, noise, lights and focus, each with advice if it is not good."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mpsnet_core.arrays.crests import crests
from mpsnet_core.arrays.mask_regions import bounding_box, box_sums, dilated
from mpsnet_core.arrays.resampling import block_means
from mpsnet_core.arrays.statistics import DEVIATIONS
from mpsnet_core.arrays.types import F32, F64, Bools, Floats
from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.capture.capture import ALIKE, PAIRS, channel_angles, finite_inside
from mpsnet_core.capture.transfer import CLOSE, DECIDED
from mpsnet_core.errors import Note
from mpsnet_core.io.image import CHANNELS, Image
from mpsnet_core.scene.rig import LightRig
from mpsnet_core.scene.rig_check import check_rig, misfit_words

Level = Literal["good", "watch", "bad"]
Figures = dict[str, float | list[float]]
LEVELS: tuple[Level, ...] = ("good", "watch", "bad")
ITEMS = ("encoding", "exposure", "clipping", "channels", "lights", "rig", "mixing", "reach", "focus")

# Pairs of limits: beyond the first the level is "watch", beyond the second "bad".
# Exposure, as a share of full scale, or of the brightest channel if the file has no full scale.
DARK, WEAK = (0.2, 0.05), (0.05, 0.02)
AIM = 0.7
# Signal-to-noise ratio.
NOISY = (10.0, 4.0)
# Shares of the object's pixels.
CLIPPED, REACHED = (0.005, 0.05), (0.5, 0.3)
# Angle in radians between channels as vectors over all pixels; condition number of the mixing matrix.
CLOSE_CHANNELS, MIXED = (0.05, ALIKE), (8.0, 20.0)
# Degrees between two lights, and from the camera's axis; condition number of the directions' matrix: three lights
# 120° apart have 5.3 at a slant of 15°, and 10.5 at 7.7°.
CLOSE_LIGHTS, LOW_LIGHTS, IN_LINE = (20.0, 10.0), (70.0, 80.0), (6.0, 12.0)
# A light does not reach a pixel below this share of its channel's 95th percentile, or this multiple of the noise. If
# the latter is above the second share of that percentile, shadows cannot be detected.
SHADOW, SHADOW_NOISE, UNSEEN = 0.03, 4.0, 0.25
# Probability of the rig, among other orders and orientations of its lights, above which the photo proves it.
LIKELY = 0.95
# Standard deviation of the blur in pixels, for an object with the area of a square of side FOCUS_SIDE.
BLURRED, FOCUS_SIDE = (1.6, 4.0), 400
# Least height of an edge that shows the blur: as a share of the object's 95th percentile, and as a multiple of the
# noise. Least number of such edges.
EDGE, EDGE_NOISE, MIN_EDGES = 0.08, 10.0, 50
SHARPEST = 90  # percentile
# Variances of the two smoothing filters that are compared, in pixels²: a box of 3 or 5 twice, and the derivative's box.
FINE, COARSE = 4 / 3 + 1 / 3, 4 + 1 / 3
# Pixels to examine; larger photos are checked on some rows only.
PIXELS = 4_000_000
RUN = 32  # length in pixels of the row segments on which noise is measured
MIN_RUNS = 30


@dataclass(frozen=True)
class Finding:
    """One item of a check."""

    item: str
    """What was checked: "encoding", "exposure", "clipping", "channels", "lights", "rig", "mixing", "reach" or
    "focus"."""
    level: Level
    """How serious it is: "good", "watch" or "bad"."""
    sentence: Note
    """The finding and, unless it is good, what to do about it."""
    figures: Figures
    """The measured values."""


def check_photo(
    image: Image,
    mask: Bools,
    rig: LightRig | None,
    encoding_evidence: float | None = None,
    *,
    mixing_stated: bool = True,
) -> list[Finding]:
    """Check a photo and its lights: one finding per item.

    Parameters
    ----------
    image : Image
        The photo, read and corrected.
    mask : (H, W) bool
        The object, at least one pixel.
    rig : LightRig, optional
        The lights. Without it, they are not checked.
    encoding_evidence : float, optional
        If the file does not state its encoding: the evidence that it is not the usual one, see
        :func:`mpsnet_core.capture.transfer.evidence_for_linear`. There is an additional finding on it.
    mixing_stated : bool, optional
        Whether the rig's mixing is known. If not, there is an additional finding.

    Raises
    ------
    FormatError
        If the photo is not finite inside the mask.
    """
    whole = finite_inside(image.pixels, mask, "photo")
    step = -(-mask.size // PIXELS)
    rows = slice(step // 2, None, step)
    if not mask[rows].any():
        rows = slice(None)
    pixels, inside = whole[rows].astype(np.float64), mask[rows]
    clipped = np.asarray(image.saturated)[rows]
    noise = _noise(pixels, inside)
    values = pixels[inside]
    full_scale = 1.0 if np.isfinite(image.clip) or image.clipped is not None else None
    return [
        *([] if rig is None or encoding_evidence is None else [_encoding(encoding_evidence)]),
        _exposure(values, noise, full_scale),
        _clipping(values, clipped[inside]),
        _channels(values, rig),
        *([] if rig is None else [_lights(rig), _rig(whole, mask, rig)]),
        *([] if rig is None or mixing_stated else [_mixing()]),
        _reach(values, noise, rig),
        _focus(whole, mask, noise),
    ]


def worst(findings: Sequence[Finding]) -> Level:
    """The worst level of the findings."""
    return _worse(*(one.level for one in findings))


def _level(value: float, limits: tuple[float, float]) -> Level:
    """Level of a value. The order of its limits decides whether large or small values are bad."""
    watch, bad = limits if limits[0] < limits[1] else (-limits[0], -limits[1])
    value = value if limits[0] < limits[1] else -value
    return "bad" if value > bad else "watch" if value > watch else "good"


def _worse(*levels: Level) -> Level:
    return max(levels, key=LEVELS.index)


def _listed(values: Floats) -> list[float]:
    return [round(float(one), 4) for one in values]


def _encoding(encoding_evidence: float) -> Finding:
    figures: Figures = {"other_rather": round(encoding_evidence, 3)}
    level = _level(encoding_evidence, (CLOSE, DECIDED))
    if level == "good":
        words = Note("the file does not state its colour encoding; nothing contradicts the usual one")
    elif level == "watch":
        words = Note(
            "the file does not state its colour encoding, and by its shading it may not be the usual one; set the "
            "encoding to linear or srgb (--encoding) [transfer-curve]"
        )
    else:
        words = Note(
            "the file does not state its colour encoding, and by its shading it is not the usual one; set the encoding "
            "to linear or srgb (--encoding) [transfer-curve]"
        )
    return Finding("encoding", level, words, figures)


def _exposure(values: F64, noise: F64, full_scale: float | None) -> Finding:
    bright = np.percentile(values, 99, axis=0)
    highest, weakest = float(bright.max()), int(bright.argmin())
    signal = float((np.percentile(values, 90, axis=0) / np.maximum(noise, 1e-12)).min())
    figures: Figures = {"brightest": _listed(bright), "noise": _listed(noise)}
    share = float(bright[weakest]) / (full_scale or max(highest, 1e-12))
    dark: Level = _level(highest, DARK) if full_scale else "good"
    weak, noisy = _level(share, WEAK), _level(signal, NOISY)
    level = _worse(dark, weak, noisy)
    of_what = "full scale" if full_scale else "the brightest channel"
    if level == "good":
        reached = 100 * bright.min() / (full_scale or highest)
        words = Note(
            "the object's brightest hundredth reaches at least %.0f%% of %s in every channel", reached, of_what
        )
        return Finding("exposure", level, words, figures)
    if dark == level:
        longer = AIM / max(highest, 1e-3)
        words = Note(
            "the object's brightest hundredth reaches only %.1f%% of full scale; expose about %.0f times as long",
            *(100 * highest, longer),
        )
        return Finding("exposure", level, words, figures)
    name = CHANNELS[weakest]
    if weak == level:
        words = Note(
            "the %s channel reaches only %.1f%% of %s; make the %s light brighter, or check that it is on",
            *(name, 100 * share, of_what, name),
        )
        return Finding("exposure", level, words, figures)
    words = Note(
        "the noise is 1/%.0f of the object's brightness in its darkest channel; expose longer, at a lower ISO, or "
        "average several photos",
        max(signal, 1),
    )
    return Finding("exposure", level, words, figures)


def _clipping(values: F64, clipped: Bools) -> Finding:
    # Float files of raw converters are clipped at 1 without saying so.
    at_one = (values.max(axis=0) <= 1.0) & (values > 0.9999)
    shares = (clipped | at_one).mean(axis=0)
    worst_one = int(shares.argmax())
    level = _level(float(shares[worst_one]), CLIPPED)
    name = CHANNELS[worst_one]
    words = Note(
        "%.1f%% of the object is clipped in %s; use a shorter exposure, or dim the %s light [clipped-photo]",
        *(100 * shares[worst_one], name, name),
    )
    if level == "good":
        words = Note("nothing of the object is clipped")
        words = Note("almost nothing of the object is clipped") if shares.any() else words
    return Finding("clipping", level, words, {"clipped": _listed(shares)})


def _channels(values: F64, rig: LightRig | None) -> Finding:
    angles = channel_angles(values)
    condition = 1.0 if rig is None else float(np.linalg.cond(rig.mixing))
    figures: Figures = {"mixing_condition": round(condition, 2)}
    if angles is not None:
        figures["angles_deg"] = _listed(np.degrees(angles))
        if angles.max() <= ALIKE:
            words = Note(
                "the three channels are nearly the same, as under white light; switch the lights to red, green and "
                "blue, or superpose three photos [channels-alike]"
            )
            return Finding("channels", "bad", words, figures)
        if angles.min() <= CLOSE_CHANNELS[0]:
            first, second = PAIRS[int(angles.argmin())]
            level: Level = _level(float(angles.min()), CLOSE_CHANNELS)
            words = Note(
                "%s and %s show nearly the same light; check the lights' colours, and that all three are on",
                *(first, second),
            )
            return Finding("channels", level, words, figures)
    level = _level(condition, MIXED)
    if level != "good":
        words = Note("the rig's mixing matrix amplifies noise %.0f times; use lights of purer colours", condition)
        return Finding("channels", level, words, figures)
    if angles is None:
        words = Note("the object faces one way, so the channels cannot be compared")
        return Finding("channels", "good", words, figures)
    words = Note("the channels show different lights, %.0f° apart or more", np.degrees(angles.min()))
    return Finding("channels", level, words, figures)


def _lights(rig: LightRig) -> Finding:
    pairs = [(0, 1), (0, 2), (1, 2)]
    angles = np.array([angular_error(rig.directions[one], rig.directions[other]) for one, other in pairs])
    first, second = (CHANNELS[light] for light in pairs[int(angles.argmin())])
    condition, lowest = float(np.linalg.cond(rig.directions)), int(rig.slants.argmax())
    figures: Figures = {"apart_deg": _listed(angles), "slants_deg": _listed(rig.slants)}
    figures["condition"] = round(condition, 2)
    close, low = _level(float(angles.min()), CLOSE_LIGHTS), _level(float(rig.slants[lowest]), LOW_LIGHTS)
    in_line = _level(condition, IN_LINE)
    level = _worse(close, low, in_line)
    if level == "good":
        words = Note(
            "the lights stand %.0f° apart or more, %.0f° to %.0f° from the camera's axis",
            *(angles.min(), rig.slants.min(), rig.slants.max()),
        )
    elif close == level:
        words = Note("the %s and the %s light stand only %.0f° apart; move them apart", first, second, angles.min())
    elif in_line == level:
        words = Note(
            "the lights stand nearly in one line, or close around the camera; move one out of it, or all outwards"
        )
    else:
        words = Note(
            "the %s light stands %.0f° from the camera's axis and casts long shadows; move it towards the camera",
            *(CHANNELS[lowest], rig.slants[lowest]),
        )
    return Finding("lights", level, words, figures)


def _rig(pixels: F32, mask: Bools, rig: LightRig) -> Finding:
    fit = check_rig(pixels, mask, rig)
    figures: Figures = {"probability": round(fit.probability, 4)}
    if fit.better:
        return Finding("rig", "bad", misfit_words(fit.better), figures)
    if fit.probability > LIKELY:
        words = Note("by its shading, the photo was taken under the rig's lights, in its order")
        return Finding("rig", "good", words, figures)
    return Finding("rig", "good", Note("the photo does not tell whether the lights are in the rig's order"), figures)


def _mixing() -> Finding:
    words = Note(
        "the rig does not state how the lights' colours mix; calibrate the mixing with a photo of a grey ball "
        "[unknown-mixing]"
    )
    return Finding("mixing", "watch", words, {})


def _reach(values: F64, noise: F64, rig: LightRig | None) -> Finding:
    if rig is not None:
        noise = np.sqrt(np.square(np.linalg.inv(rig.mixing)) @ np.square(noise))
        values = values @ np.linalg.inv(rig.mixing).T
    bright = np.percentile(values, 95, axis=0)
    seen = SHADOW_NOISE * noise < UNSEEN * bright
    if not seen.any():
        return Finding("reach", "good", Note("the photo is too dark to tell which lights reach the object"), {})
    dark = (values <= np.maximum(SHADOW * bright, SHADOW_NOISE * noise)) & seen
    reached = float((~dark.any(axis=1)).mean())
    by_light = 1 - dark.mean(axis=0)
    level = _level(reached, REACHED)
    figures: Figures = {"all_lights": round(reached, 4), "each_light": _listed(by_light)}
    unseen = " and the ".join(name for name, known in zip(CHANNELS, seen, strict=True) if not known)
    lights = Note("all lights but the %s one, too dark to tell,", unseen) if unseen else Note("all three lights")
    words = Note("%s reach %.0f%% of the object", lights, 100 * reached)
    if level != "good":
        name = CHANNELS[int(by_light.argmin())]
        words = Note(
            "%s, the %s one %.0f%%; move the %s light towards the camera, or turn the object",
            *(words, name, 100 * by_light.min(), name),
        )
    return Finding("reach", level, words, figures)


def _noise(pixels: F64, inside: Bools) -> F64:
    """(3,) standard deviation of the noise in the smoothest fifth of the object; 0 if unknown.

    Measured by second differences along short row segments: those of smooth shading nearly vanish.
    """
    width = (pixels.shape[1] - 2) // RUN * RUN
    if width <= 0:
        return np.zeros(3)
    second = (pixels[:, :-2] - 2 * pixels[:, 1:-1] + pixels[:, 2:])[:, :width] / np.sqrt(6)
    whole = (inside[:, :-2] & inside[:, 1:-1] & inside[:, 2:])[:, :width].reshape(len(pixels), -1, RUN).all(axis=-1)
    if np.count_nonzero(whole) < MIN_RUNS:
        return np.zeros(3)
    runs = np.abs(second).reshape(len(pixels), -1, RUN, 3)[whole]
    return np.asarray(DEVIATIONS * np.percentile(np.median(runs, axis=1), 20, axis=0), np.float64)


def _focus(pixels: Floats, mask: Bools, noise: F64) -> Finding:
    side = np.sqrt(np.count_nonzero(mask))
    factor = max(1, int(side / FOCUS_SIDE))
    # A very blurred outline is an edge in a smaller image. There only the outline counts: shading may look like edges.
    for smaller, outline in ((factor, False), (2 * factor, True), (4 * factor, True)):
        blur = _sharpest_edges(pixels, mask, noise, smaller, outline)
        if blur is not None:
            break
    else:
        return Finding("focus", "good", Note("the object shows no edges by which its focus could be judged"), {})
    # The blur of large objects is rated relative to their size, that of small ones in pixels.
    level = _level(blur * min(1.0, FOCUS_SIDE / side), BLURRED)
    figures: Figures = {"blur_pixels": round(blur, 3)}
    if level == "good":
        return Finding("focus", level, Note("the sharpest edges are sharp"), figures)
    words = Note(
        "even the sharpest edges are blurred by %.1f pixels, 1/%.0f of the object's size; focus on it, stop down, and "
        "hold camera and object still",
        *(blur, side / blur),
    )
    return Finding("focus", level, words, figures)


def _sharpest_edges(pixels: Floats, mask: Bools, noise: F64, factor: int, outline: bool) -> float | None:
    """Standard deviation of the blur in pixels, at the sharpest edges of paint and outline, or of the outline alone.

    Compares the gradients of two smoothed images, after Zhuo and Sim, "Defocus map estimation from a single image",
    Pattern Recognition 44, 2011. factor: by which the image is reduced first. None if too few edges are high enough.
    """
    part = bounding_box(mask, 8 * factor)
    small = block_means(pixels[part], factor)
    inside = mask[part][::factor, ::factor]
    near = dilated(inside, 2)
    # The image border is not an edge.
    near[:6], near[-6:], near[:, :6], near[:, -6:] = False, False, False, False
    if not near.any():
        return None
    light = small.sum(axis=-1, dtype=np.float64)
    bright = max(float(np.percentile(light[near], 95)), 1e-12)
    grain = float(np.linalg.norm(noise)) / factor
    fine, coarse = (np.gradient(box_sums(box_sums(light, reach), reach) / (2 * reach + 1) ** 4) for reach in (1, 2))
    steep = np.hypot(*fine)
    high = max(EDGE * bright, EDGE_NOISE * grain)
    edge = near & (steep * np.sqrt(2 * np.pi * FINE) > high) & crests(steep, *fine)
    if outline:
        # If noise may have hidden a sharp outline in the larger image, a blurred one here proves nothing.
        edge &= dilated(~inside, 2) & (2 * EDGE_NOISE * grain < EDGE * bright)
    if np.count_nonzero(edge) < MIN_EDGES:
        return None
    ratio = steep[edge] / np.maximum(np.hypot(*coarse)[edge], 1e-12)
    sharp = float(np.clip(np.percentile(ratio, SHARPEST) ** 2, 1.001, COARSE / FINE))
    return float(factor * np.sqrt((COARSE - FINE * sharp) / (sharp - 1)))
