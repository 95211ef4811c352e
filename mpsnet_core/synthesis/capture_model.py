"""Capture model: the numbers of the cameras, lights and files that photographs of samples come from.

Every range stands in :class:`CaptureModel`, with its source. What is drawn from them is applied by
:mod:`mpsnet_core.learning.training.photo_simulation`.
"""

from dataclasses import dataclass, replace

import numpy as np

from mpsnet_core.arrays.types import F32, F64
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.field_limits import limited
from mpsnet_core.synthesis.random_sampling import generator, log_uniform, uniform

Range = tuple[float, float]


@dataclass(frozen=True)
class CaptureDraw:
    """One photograph's numbers, as :meth:`CaptureModel.draw` draws them."""

    exact: bool
    """Whether the rig is known exactly."""
    mixing: F64
    """(3, 3) float64. The mixing matrix M of the image formation, strengths and sensitivities included."""
    colours: F64
    """(3, 3) float64. What channel i sees of a surface's red, green and blue; rows sum to 1."""
    known_mixing: F64
    """(3, 3) float64. The mixing matrix that the estimate assumes."""
    direction_errors: F64
    """(3, 3) float64. Radians, how far the light directions that are known are off; of each row only the part across
    the light's direction counts."""
    exposure: float
    """The brightness that the object's highlights exceed, as a share of the sensor's full well, see
    :class:`CaptureModel`."""
    highlights: float
    """The share of the object's pixels that counts as highlights, see :class:`CaptureModel`."""
    full_well: float
    """Electrons at saturation; infinite without shot noise."""
    read_noise: float
    """Electrons, standard deviation in the dark."""
    bits: int
    """Bits of a channel's stored values; 0 for a float picture."""
    srgb: bool
    """Whether the values carry the sRGB curve."""
    jpeg_quality: int
    """libjpeg's quality, 0 for no JPEG."""
    halved_chroma: bool
    """Whether JPEG keeps colour at half the resolution."""
    blur: float
    """Pixels, standard deviation of a Gaussian."""
    mosaic: bool
    """Whether the camera's sensor sees one colour a pixel."""
    mask_error: int
    """Pixels by which the mask is too large, or too small where negative."""
    noise_seed: int
    """What the noise is drawn from, where a photograph is taken alone."""
    white: bool
    """Whether a second photo shows the same under white light."""
    white_mixing: F64
    """(3, 3) float64. The mixing matrix of the white photo."""
    grain: float = 0.0
    """Standard deviation of the logarithm of the albedo's grain, 0 for none."""
    grain_size: float = 1.0
    """Diameter of a spot of the grain in pixels of the sample."""
    grain_hue: float = 0.0
    """0 for grain of one tint, 1 for red, green and blue that vary independently."""


@dataclass(frozen=True)
class CaptureModel:
    """The ranges that photographs are drawn from, (least, most) each. Chances are from 0 to 1.

    The limits of each are those of what a recipe may set it to. What is drawn log-uniformly stays above 0; a crosstalk
    of 1 leaves no inverse of the mixing.
    """

    crosstalk: tuple[float, float] = limited((0.0, 0.4), 0.0, 0.9)
    """The most that a channel sees of a light that is not its own, as a share of what it sees of its own. The spectral
    sensitivities of cameras' channels overlap (Jiang et al., "What is the space of spectral sensitivity functions for
    digital color cameras?", WACV 2013), the more the broader the lights' spectra are."""
    colour_overlap: tuple[float, float] = limited((0.0, 0.6), 0.0, 1.0)
    """The most that a channel sees of a surface's colour that is not its own, as a share of what it sees of its own. A
    sample is rendered in red, green and blue, but real channels and lights are broad, and see of each other's colour.
    The MPS-Net paper's images have 2/9 to 5/9, which is 0.4."""
    overlap_shares: tuple[float, float] = limited((0.0, 1.0), 0.0, 1.0)
    """How much of the most each of a photograph's six shares of crosstalk, and of colour, has. The paper's images have
    all of it."""
    light_strengths: tuple[float, float] = limited((0.7, 1.4), 0.001, 1000.0)
    """Strength of each light against the others, log-uniform. LEDs of three colours are of three kinds and are seldom
    brought to one brightness; our estimate."""
    channel_gains: tuple[float, float] = limited((0.6, 1.6), 0.001, 1000.0)
    """Gain of each camera channel, log-uniform. Daylight multipliers of cameras' raw files are some 2, 1 and 1.5 (the
    "pre_mul" of dcraw's tables); white balance undoes a part of it."""
    exact: float = limited(0.33, 0.0, 1.0)
    """Chance that mixing and light directions are known exactly, as those of a rig in Blender are."""
    rendered: float = limited(0.5, 0.0, 1.0)
    """Chance that a photo whose rig is known exactly is a render: lights of one colour each, no noise, no blur, no
    JPEG, an exact mask."""
    measured: float = limited(0.33, 0.0, 1.0)
    """Chance that mixing and light directions were measured well; see the errors below, which are our estimates. What
    is left was measured badly, or the mixing not at all: then the identity is assumed, as for a rig file without one. A
    network that expects unknown crosstalk more often than it occurs exaggerates every gradient."""
    mixing_error: tuple[float, float] = limited((0.0, 0.03), 0.0, 1.0)
    """Standard deviation of a mixing's entries, as a share of its largest, of rigs that were measured well."""
    direction_error: tuple[float, float] = limited((0.0, 1.5), 0.0, 90.0)
    """Degrees, standard deviation across two axes by which the known light directions are off, of rigs that were
    measured well. A highlight found one pixel off on a mirror ball of 100 pixels' radius is 1.1° off (twice its
    normal's error)."""
    bad_mixing_error: tuple[float, float] = limited((0.03, 0.1), 0.0, 1.0)
    """As `mixing_error`, of rigs that were measured badly."""
    bad_direction_error: tuple[float, float] = limited((1.5, 4.0), 0.0, 90.0)
    """As `direction_error`, in degrees, of rigs that were measured badly; those put up by protractor are off by some
    3°."""
    unknown: float = limited(0.5, 0.0, 1.0)
    """The chance that the mixing of a rig that was measured badly is not known at all."""
    exposure: tuple[float, float] = limited((0.25, 1.2), 0.001, 1000.0)
    """The brightness that the object's highlights exceed, as a share of the sensor's full well, log-uniform; above 1
    they are saturated."""
    highlights: tuple[float, float] = limited((0.005, 0.15), 1e-6, 1.0)
    """The share of the object's pixels that counts as highlights, log-uniform: who photographs a dark glossy thing lets
    its highlights burn, who exposes for a histogram's right end does not."""
    full_well: tuple[float, float] = limited((1500.0, 40_000.0), 1.0, 1e9)
    """Electrons at saturation, log-uniform. The noise is EMVA Standard 1288's linear model (release 4.0, 2021): shot
    noise with the variance of the electrons' number, and read noise; as Gaussians, after Foi et al., "Practical
    Poissonian-Gaussian noise modeling and fitting for single-image raw-data", IEEE TIP 17(10), 2008. Data sheets by
    that standard state some 33,000 electrons for Sony's IMX174, 10,500 for its IMX264; telephones hold about 5,000, and
    every doubling of ISO halves what is used of the well."""
    read_noise: tuple[float, float] = limited((1.5, 12.0), 1e-6, 1e6)
    """Electrons, standard deviation in the dark, log-uniform. The same data sheets state some 7 electrons for the
    IMX174 and 2.3 for the IMX264."""
    bits: tuple[int, ...] = limited((8, 10, 12, 14, 16), 0, 16)
    """Bits of a channel's stored values; 0 for a float picture, which neither clips nor rounds. 8 and 16 are what PNG
    and TIFF hold, 10 to 14 what camera raw holds."""
    srgb: float = limited(0.5, 0.0, 1.0)
    """Chance that the values carry the sRGB curve (IEC 61966-2-1), which reading undoes."""
    jpeg: float = limited(0.35, 0.0, 1.0)
    """Chance that the photo is JPEG instead, which has 8 bits and the curve."""
    jpeg_quality: tuple[int, int] = limited((60, 98), 1, 100)
    """libjpeg's quality; cameras use 85 and more, messengers 60 to 80."""
    halved_chroma: float = limited(0.5, 0.0, 1.0)
    """Chance that JPEG keeps colour at half the resolution (4:2:0)."""
    blur: tuple[float, float] = limited((0.0, 1.2), 0.0, 16.0)
    """Pixels, standard deviation of a Gaussian. Lenses and demosaicing that leave half the contrast at 0.16 to 0.5
    cycles a pixel (MTF50) have 1.2 to 0.4."""
    mosaic: float = limited(0.3, 0.0, 1.0)
    """Chance that the camera's sensor sees one colour a pixel (Bayer) and the others are interpolated."""
    white: float = limited(0.25, 0.0, 1.0)
    """Chance that a second photo shows the same under white light."""
    white_strengths: tuple[float, float] = limited((0.87, 1.15), 0.001, 1000.0)
    """Strength of each light in the white photo, log-uniform; three of one make differ by some 10%."""
    mask_error: tuple[int, int] = limited((-3, 2), -32, 32)
    """Pixels by which the mask is too large, or too small where negative; our estimate for masks by threshold and by
    hand."""
    grain: float = limited(0.0, 0.0, 1.0)
    """Chance that the albedo varies in small spots, as that of stone, plaster and paper does. It multiplies a sample's
    pixels, so samples of any kind can have it."""
    grain_amount: tuple[float, float] = limited((0.01, 0.2), 0.001, 1.0)
    """Standard deviation of the grain's logarithm, log-uniform; our estimate."""
    grain_size: tuple[float, float] = limited((1.0, 12.0), 1.0, 64.0)
    """Diameter of a spot in pixels of the sample, log-uniform; our estimate."""
    grain_tinted: float = limited(0.3, 0.0, 1.0)
    """Chance that the spots differ in tint as well as in brightness; our estimate."""

    def draw(self, rng: np.random.Generator) -> CaptureDraw:
        """One photograph's numbers. Takes as many random numbers whatever the ranges are."""
        mixing, colours = (_overlap(rng, most, self.overlap_shares) for most in (self.crosstalk, self.colour_overlap))
        colours = colours / colours.sum(axis=1, keepdims=True)
        strengths = [log_uniform(rng, *self.light_strengths) for _ in range(3)]
        gains = [log_uniform(rng, *self.channel_gains) for _ in range(3)]
        kind, rendered, unknown = rng.random(3) < (self.exact, self.rendered, self.unknown)
        rendered &= kind
        well = rng.random() < self.measured / max(1 - self.exact, 1e-9)
        mixing = np.diag(strengths) if rendered else np.diag(gains) @ mixing @ np.diag(strengths)
        spread = uniform(rng, *(self.mixing_error if well else self.bad_mixing_error))
        direction_error = np.radians(uniform(rng, *(self.direction_error if well else self.bad_direction_error)))
        known = mixing + spread * mixing.max() * rng.normal(size=(3, 3))
        if kind:
            known, direction_error = mixing, 0.0
        elif unknown and not well:
            known = np.eye(3)
        jpeg = rng.random() < self.jpeg and not rendered
        bits = self.bits[_whole(rng, (0, len(self.bits) - 1))]
        srgb = rng.random() < self.srgb
        quality = _whole(rng, self.jpeg_quality)
        white_strengths = [log_uniform(rng, *self.white_strengths) for _ in range(3)]
        white_gains = [log_uniform(rng, *self.channel_gains) for _ in range(3)]
        draw = CaptureDraw(
            exact=bool(kind),
            mixing=mixing,
            colours=colours,
            known_mixing=known,
            direction_errors=direction_error * rng.normal(size=(3, 3)),
            exposure=log_uniform(rng, *self.exposure),
            highlights=log_uniform(rng, *self.highlights),
            full_well=log_uniform(rng, *self.full_well),
            read_noise=log_uniform(rng, *self.read_noise),
            bits=8 if jpeg else bits,
            srgb=jpeg or srgb,
            jpeg_quality=quality if jpeg else 0,
            halved_chroma=rng.random() < self.halved_chroma,
            blur=uniform(rng, *self.blur),
            mosaic=rng.random() < self.mosaic,
            mask_error=_whole(rng, self.mask_error),
            noise_seed=int(rng.integers(1 << 62)),
            white=rng.random() < self.white,
            white_mixing=np.outer(white_gains, white_strengths),
        )
        # From a generator of its own, so that the other parameters of a seed do not depend on it.
        own = generator(draw.noise_seed, 1)
        grainy, tinted = own.random(2) < (self.grain, self.grain_tinted)
        draw = replace(
            draw,
            grain=log_uniform(own, *self.grain_amount) * bool(grainy),
            grain_size=log_uniform(own, *self.grain_size),
            grain_hue=own.random() * bool(tinted),
        )
        if not rendered:
            return draw
        bits = 16 if self.bits != (0,) else 0
        return replace(
            draw, full_well=np.inf, read_noise=0.0, bits=bits, srgb=False, blur=0.0, mosaic=False, mask_error=0
        )


def blur_weights(sigma: float) -> F32:
    """Weights (2 reach + 1,) of a Gaussian with standard deviation `sigma` in pixels; a single 1 where that is 0.

    The discrete Gaussian of Lindeberg, "Scale-space for discrete signals" (PAMI 1990), which has the right width where
    a sampled one, narrower than a pixel, would vanish.
    """
    reach = int(np.ceil(3 * sigma))
    if reach == 0:
        return np.ones(1, np.float32)
    frequency = 2 * np.pi * np.arange(8 * reach + 1) / (16 * reach)
    half = np.fft.irfft(np.exp(sigma**2 * (np.cos(frequency) - 1)))[: reach + 1]
    weights = np.concatenate([half[:0:-1], half])
    return (weights / weights.sum()).astype(np.float32)


def turned(directions: F64, errors: F64) -> F64:
    """Unit vectors (N, 3) turned by the angles that the errors (N, 3) have across them."""
    across = errors - (errors * directions).sum(axis=1, keepdims=True) * directions
    angle = np.linalg.norm(across, axis=1, keepdims=True)
    return np.cos(angle) * directions + np.sin(angle) * normalised(across)


def _overlap(rng: np.random.Generator, limits: Range, shares: Range) -> F64:
    """(3, 3) ones on the diagonal, and elsewhere shares of a level that is drawn from `limits`."""
    level, (least, most) = uniform(rng, *limits), shares
    return np.eye(3) + level * (least + (most - least) * rng.random((3, 3))) * (1 - np.eye(3))


def _whole(rng: np.random.Generator, limits: tuple[int, int]) -> int:
    # Not by rng.integers, which takes no random number where there is but one to choose.
    return limits[0] + int((limits[1] - limits[0] + 1) * rng.random())
