"""Photo simulation: packed samples become training photos, on the device that trains.

The capture model's parameters are drawn in :mod:`mpsnet_core.synthesis.capture_model`; here they are applied to a whole
batch at once. Networks that go from coarse to fine see an example at several scales: first the whole object, then
windows of it, each at twice the resolution. The finest is the camera's own pixels, with its blur, mosaic, noise, levels
and JPEG; the others are means of those. Beyond the sample's own resolution the picture is magnified, as soft as large
photos of smooth things. For other networks, and in evaluations, the sample's own pixels are the camera's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from mpsnet_core.arrays.types import F32, F64, I64
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.features import CAMERA_FRAME, MIN_MEAN, LightFrame, canonical_frames
from mpsnet_core.estimate.white_photo import WhitePhoto
from mpsnet_core.learning.training.jpeg import jpeg_losses
from mpsnet_core.learning.training.networks.network import Network, unit
from mpsnet_core.learning.training.packed import Packed, PackedSamples
from mpsnet_core.scene.rig import LightRig
from mpsnet_core.synthesis.capture_model import CaptureDraw, CaptureModel, blur_weights, turned
from mpsnet_core.synthesis.random_sampling import generator, new_seed

WINDOW = 128  # pixels a side
Frames = Literal["canonical", "any", "camera"]
COARSEST = (64.0, 128.0)  # pixels of the object's longer side on the first scale
# How many scales follow the first one.
FINER_SHARES = (0.1, 0.4, 0.25, 0.15, 0.1)
NEAREST_SHARE = 0.7  # of the frames are among the two in which the first light stands most nearly straight up
FITTED = 2000  # pixels that a white photo is fitted to
MIN_COVERED = 0.02  # share of a coarse pixel that the mask must cover for it to count
# Planes of an arranged sample; those of the white photo follow where there is one.
PHOTO, NORMALS, LIT, MASK, WHITE = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 10), slice(10, 13)


class Scale(NamedTuple):
    """N windows on one scale. Maps are (N, C, H, W), zero outside the known mask."""

    maps: dict[str, Tensor]
    """The maps by the names of :data:`mpsnet_core.estimate.features.FEATURE_CHANNELS`, without "previous" and those
    that :func:`mpsnet_core.learning.training.inputs.feature_tensor` makes of them."""
    truth: Tensor
    """(N, 3, H, W). True unit normals."""
    weights: Tensor
    """(N, H, W). 1 where a pixel counts."""
    lit: Tensor
    """(N, 3, H, W). Whether each light reaches a pixel."""
    examples: Tensor
    """(N,). Which examples of the batch these are."""
    places: I64
    """(N, 2) int64. Upper left corner of each window in the window of the scale before, in that scale's pixels; it
    covers half of that window's side."""


@dataclass
class _Example:
    """One sample, arranged to be photographed."""

    planes: Tensor
    """(10 or 13, H, W). The sample at its own resolution, zero outside the mask."""
    directions: F64
    """(3, 3) float64. Unit vectors to the lights, one light per row."""
    draw: CaptureDraw
    """The photograph's numbers."""
    finest: int
    """Number of the last scale that it is seen on, from 0."""
    coarse: tuple[int, int]
    """Height and width of the object on the first scale."""
    offset: I64
    """(2,) int64. Offset of the present window, in pixels of the present scale, from the object's own corner."""
    bicubic: bool
    """Whether the sample is resized bicubically."""


class PhotoSimulator:
    """Draws batches of examples: `batch(step, size)` depends on nothing but the samples, their errors, the seed and the
    step.

    Parameters
    ----------
    samples : PackedSamples
        Every epoch shows all of them.
    model : CaptureModel, optional
        Changes to the capture model.
    seed : int
        Of all that is drawn.
    window : int
        Pixels a side, around pixels that count; 0, where there is one scale, for whole pictures.
    finer : sequence of float
        Shares of how many scales follow the first; none for one scale, the samples' own pixels.
    frames : str
        Frames that samples are seen in: "canonical", those in which the first light stands most nearly straight up, the
        lights counter-clockwise; "any", turned by any quarters, mirrored or not, the lights in any order; "camera", as
        the samples are.
    shuffled : bool
        Whether every epoch has an order of its own.
    hard_share : float
        Share of the examples that are drawn in proportion to their samples' errors, not in turn.
    device : torch.device, optional
        Where photographs are made; the CPU unless given.

    Attributes
    ----------
    errors : ndarray
        (samples,) float64. The network's mean angular error on each sample in radians, NaN where it has not seen it.
    """

    def __init__(
        self,
        samples: PackedSamples,
        model: CaptureModel | None = None,
        *,
        seed: int = 0,
        window: int = WINDOW,
        finer: Sequence[float] = FINER_SHARES,
        frames: Frames = "canonical",
        shuffled: bool = True,
        hard_share: float = 0.0,
        device: torch.device | None = None,
    ) -> None:
        self.samples, self.model, self.seed, self.window = samples, model or CaptureModel(), seed, window
        self.finer, self.frames, self.shuffled = np.cumsum(finer) / np.sum(finer), frames, shuffled
        self.hard_share, self.device = hard_share, device or torch.device("cpu")
        self.errors = np.full(len(samples), np.nan)
        self._drawn: list[int] = []  # the samples of the last batch
        self._order: tuple[int, I64] = (-1, np.empty(0, np.int64))

    def batch(self, step: int, size: int) -> list[Scale]:
        """The scales of step `step`'s examples, coarse to fine."""
        rng = generator(self.seed, 3, step)
        noise = torch.Generator(self.device).manual_seed(new_seed(rng))
        self._drawn = [self._index(step * size + k) for k in range(size)]
        examples = [self._example(self.samples[index], rng) for index in self._drawn]
        if len(self.finer):
            return _simulated(examples, self.window, rng, noise)
        (whole,) = _simulated(examples, _side(examples, self.window), rng, noise)
        return [_cut(whole, self.window, rng) if self.window else whole]

    def record_errors(self, scales: Sequence[Scale], angles: Tensor) -> None:
        """Update the errors of the last batch's samples. angles: of the windows of all its scales, in radians."""
        owners = torch.cat([scale.examples for scale in scales])
        for number, sample in enumerate(self._drawn):
            error = float(angles[owners == number].mean())
            # A mean with earlier photographs: each is of other windows, under other colours.
            self.errors[sample] = np.nanmean([self.errors[sample], error])

    def _index(self, number: int) -> int:
        """The sample of an example: the next in the epoch's order, or one that is drawn by its error."""
        by_error = int(number * self.hard_share)
        if int((number + 1) * self.hard_share) > by_error:
            known = self.errors[~np.isnan(self.errors)]
            # A sample that was not seen yet counts as an average one.
            chances = np.where(np.isnan(self.errors), known.mean() if len(known) else 1.0, self.errors) + 1e-6
            return int(generator(self.seed, 4, number).choice(len(chances), p=chances / chances.sum()))
        epoch, place = divmod(number - by_error, len(self.samples))
        if not self.shuffled:
            return place
        if self._order[0] != epoch:
            rng = generator(self.seed, 1, epoch)
            self._order = (epoch, rng.permutation(len(self.samples)))
        return int(self._order[1][place])

    def _example(self, packed: Packed, rng: np.random.Generator) -> "_Example":
        draw = self.model.draw(rng)
        frame = CAMERA_FRAME
        if self.frames != "camera":
            frame = _near_frame(packed.directions, rng) if self.frames == "canonical" else _any_frame(rng)
        example = _arranged(packed, draw, frame, self.device)
        if not len(self.finer):
            return example
        height, width = example.coarse
        example.finest = int(np.searchsorted(self.finer, rng.random(), side="right"))
        longest = COARSEST[0] * (COARSEST[1] / COARSEST[0]) ** rng.random() * self.window / WINDOW
        scale = longest / max(height, width)
        example.coarse = max(8, round(height * scale)), max(8, round(width * scale))
        room = self.window - np.array(example.coarse)
        example.offset = -np.array([rng.integers(space + 1) for space in np.maximum(room, 0)])
        example.bicubic = rng.random() < 0.5
        return example


def views_of(network: Network, augment: bool) -> dict[str, Any]:
    """How a network sees photographs: `finer` and `frames` of :class:`PhotoSimulator`.

    augment: whether in any frame where the network's is the camera's.
    """
    frames: Frames = "canonical" if network.frame == "canonical" else "any" if augment else "camera"
    return {"finer": FINER_SHARES if network.kind == "pyramid" else (), "frames": frames}


def simulate_photo(packed: Packed, draw: CaptureDraw) -> tuple[Capture, F32]:
    """Photograph a sample's own pixels in camera space, under three lights at once.

    Returns the capture, whose rig and mask have the draw's errors, and (H, W, 3) true normals, zero where unknown.
    """
    example = _arranged(packed, draw, CAMERA_FRAME, torch.device("cpu"))
    planes = _window(example, 0, _side([example]))
    light, mask = torch.stack([planes[channels] for channels in _photos(draw)]), planes[None, MASK] > 0
    draws, finer = _Draws.of([draw] * len(light), light.device), torch.zeros(len(light))
    exposure = _exposures(light, mask.expand(len(light), -1, -1, -1), draws)
    shot = _shot(light, draws, exposure, finer, torch.Generator().manual_seed(draw.noise_seed))
    height, width = packed.mask.shape

    def whole(values: Tensor) -> NDArray[Any]:
        return np.ascontiguousarray(values[:, :height, :width].permute(1, 2, 0).numpy())

    capture = Capture(
        whole(shot[0]),
        whole(_known(mask, draws.mask_error[:1], finer[:1])[0])[..., 0],
        LightRig(turned(packed.directions, draw.direction_errors), draw.known_mixing, is_ground_truth=draw.exact),
        clip=1.0 if draw.bits else np.inf,
        white=whole(shot[1]) if draw.white else None,
        white_clipped=np.repeat(~whole(_unclipped(shot[1:], draws.bits[1:])[0]), 3, axis=2)
        if draw.white and draw.bits
        else None,
    )
    return capture, whole(unit(planes[None, NORMALS])[0])


def _near_frame(directions: F64, rng: np.random.Generator) -> LightFrame:
    """Mostly one of the two nearest, which single passes use; else any, for averages of more passes."""
    frames = canonical_frames(directions)
    return frames[int(rng.integers(2 if rng.random() < NEAREST_SHARE else len(frames)))]


def _any_frame(rng: np.random.Generator) -> LightFrame:
    first, second, third = (int(light) for light in rng.permutation(3))
    return LightFrame((first, second, third), int(rng.integers(4)), bool(rng.integers(2)))


def _arranged(packed: Packed, draw: CaptureDraw, frame: LightFrame, device: torch.device) -> _Example:
    """The sample as the photo's channels see it, turned into the frame; its one scale is the sample's own."""
    # Turned as packed, which is half of the bytes.
    lights, normals, mask, lit = (
        _turned(values, frame).to(device) for values in (packed.lights, packed.normals, packed.mask, packed.lit)
    )
    order, rotation, photos = list(frame.order), frame.rotation, _photos(draw)
    # Unit normals turn with the picture. Light k becomes the frame's light order.index(k).
    weights = torch.cat([_weights(mixing, draw.colours) for mixing in (draw.mixing, draw.white_mixing)[: len(photos)]])
    weights = weights[:, np.argsort(order)].flatten(1).to(device)
    surface = lights.float()
    if draw.grain:
        surface *= _grain(draw, surface.shape[1:], device).repeat(3, 1, 1)
    seen = (weights @ surface.flatten(1)).reshape(-1, *mask.shape)
    truth = torch.tensor(rotation, dtype=torch.float32, device=device) @ normals.float().flatten(1)
    planes = torch.cat([seen[PHOTO], truth.reshape(normals.shape), lit[order], mask[None], seen[3:]])
    height, width = planes.shape[1:]
    directions = packed.directions[order] @ rotation.T
    return _Example(planes, directions, draw, 0, (height, width), np.zeros(2, np.int64), False)


def _grain(draw: CaptureDraw, shape: Sequence[int], device: torch.device) -> Tensor:
    """(3, H, W) factors for the albedo's red, green and blue: smooth noise on a lattice of the grain's size."""
    lattice = [max(2, round(side / draw.grain_size)) for side in shape]
    spots = torch.from_numpy(generator(draw.noise_seed, 2).standard_normal((1, 3, *lattice), np.float32)).to(device)
    spots = functional.interpolate(spots, size=tuple(shape), mode="bicubic", align_corners=False)[0]
    spots = torch.lerp(spots[:1], spots, draw.grain_hue)
    return torch.exp(draw.grain * spots / spots.std(dim=(1, 2), keepdim=True))


def _turned(values: Tensor, frame: LightFrame) -> Tensor:
    """Planes (..., H, W) as they are in the frame, see :meth:`LightFrame.picture`; copied at most once."""
    quarters = frame.quarter_turns % 4
    if quarters % 2:
        values = values.transpose(-2, -1)
    return values.flip([-2] * (quarters in (1, 2)) + [-1] * ((quarters in (2, 3)) != frame.mirrored)).contiguous()


def _side(examples: Sequence[_Example], least: int = 0) -> int:
    """Pixels a side of a square that holds each example at its own resolution; a multiple of JPEG's blocks."""
    return -(-max(least, *(side for example in examples for side in example.coarse)) // 16) * 16


def _simulated(
    examples: list[_Example], window: int, rng: np.random.Generator, generator: torch.Generator
) -> list[Scale]:
    """All scales of some examples; the finer ones of those that have them."""
    device, count = examples[0].planes.device, len(examples)
    draws = _Draws.of([example.draw for example in examples], device)
    known = np.stack([turned(example.directions, example.draw.direction_errors) for example in examples])
    # Of the photos, which have the examples' numbers, and then of the white ones.
    exposure, means = torch.ones(2 * count, device=device), torch.ones(count, 3, device=device)
    white_fits: dict[int, WhitePhoto | None] = {}
    chosen, places = list(range(count)), np.zeros((count, 2), np.int64)
    scales: list[Scale] = []
    for level in range(max(example.finest for example in examples) + 1):
        windows = [_window(examples[k], level, window) for k in chosen]
        planes, photos = torch.stack([one[: WHITE.start] for one in windows]), len(chosen)
        whites = [number for number, k in enumerate(chosen) if examples[k].draw.white]
        light = torch.stack([one[PHOTO] for one in windows] + [windows[number][WHITE] for number in whites])
        shown = [*range(photos), *whites]
        owners = [chosen[number] for number in shown]
        numbers = chosen + [count + k for k in owners[photos:]]
        drawn, mask = draws.subset(owners), planes[:, MASK] > 0
        finer = torch.tensor([examples[k].finest - level for k in owners], device=device)
        if level == 0:
            exposure[numbers] = _exposures(light, mask[shown], drawn)
        light, white = _shot(light, drawn, exposure[numbers], finer, generator).tensor_split([photos])
        seen = _known(mask, drawn.mask_error[:photos], finer[:photos])
        shot, light = light, unmixed(light, drawn.known_mixing[:photos])
        for number, k, white_image in zip(whites, owners[photos:], white, strict=True):
            valid = seen[number, 0] & _unclipped(white_image[None], drawn.bits[number : number + 1])[0, 0]
            if level == 0:
                sure = valid & _unclipped(shot[number][None], drawn.bits[number : number + 1])[0, 0]
                white_fits[k] = _fit_white_photo(shot[number, :, sure], white_image[:, sure], examples[k].draw)
            light[number] = _normalise_by_white_photo(shot[number], white_image, white_fits[k], light[number], valid)
        light = light * seen.float()
        if level == 0:
            means = _means(light, seen)
        mean = means[chosen]
        counts = (mask & seen).float()
        painted = torch.tensor([float(white_fits.get(k) is not None) for k in chosen], device=device)
        scales.append(
            Scale(
                maps={
                    "photo": light / mean.mean(dim=1)[:, None, None, None],
                    "mask": seen.float(),
                    "lights": torch.tensor(known[chosen].reshape(-1, 9, 1, 1), dtype=torch.float32, device=device),
                    "channel_means": (mean / mean.mean(dim=1, keepdim=True))[:, :, None, None],
                    "given": torch.stack([torch.full_like(painted, level > 0), painted], dim=1)[:, :, None, None],
                    "exact": drawn.exact[:photos, None, None, None],
                },
                truth=unit(planes[:, NORMALS]) * counts,
                weights=counts[:, 0],
                lit=(planes[:, LIT] > 0.5).float(),
                examples=torch.tensor(chosen, device=device),
                places=places,
            )
        )
        finer_ones = [(n, k) for n, k in enumerate(chosen) if examples[k].finest > level]
        places = np.array([_zoom(examples[k], mask[n, 0], window, rng) for n, k in finer_ones]).reshape(-1, 2)
        chosen = [k for _, k in finer_ones]
    return scales


# --- where the windows are --------------------------------------------------------------------------------------------


def _window(example: _Example, level: int, window: int) -> Tensor:
    """(10 or 13, window, window) means over the mask inside each pixel, whose own plane is 0 or 1; zero beyond."""
    planes, size = example.planes, [length << level for length in example.coarse]
    height, width = planes.shape[1:]
    top, left = (int(place) for place in example.offset)
    if size[0] <= height:
        # Columns before rows, of which only the window's are needed then.
        first, last = max(top, 0), min(top + window, size[0])
        tall = functional.interpolate(planes[None], size=(size[0], width), mode="bilinear", antialias=True)
        tall = tall[:, :, first:last]
        whole = functional.interpolate(tall, size=(last - first, size[1]), mode="bilinear", antialias=True)[0]
        # Negative padding cuts.
        found = functional.pad(whole, (-left, left + window - size[1], first - top, top + window - last))
    else:
        steps = torch.arange(window, device=planes.device) + 0.5
        y, x = ((steps + start) / length * 2 - 1 for start, length in ((top, size[0]), (left, size[1])))
        grid = torch.stack([x.expand(window, -1), y[:, None].expand(-1, window)], dim=-1)[None]
        mode = "bicubic" if example.bicubic else "bilinear"
        found = functional.grid_sample(planes[None], grid, mode=mode, align_corners=False)[0]
    least = MIN_COVERED if level < example.finest and size[0] <= height else 0.5
    covered = (found[MASK] > least).float()
    # Products with masks, here and below: on CPUs torch.where takes ten times as long.
    found = found * (covered / found[MASK].clamp(min=MIN_COVERED))
    for channels in _photos(example.draw):
        found[channels].clamp_(min=0)
    found[MASK] = covered
    return found


def _zoom(example: _Example, mask: Tensor, window: int, rng: np.random.Generator) -> I64:
    """Choose the next window, about a pixel of the object, and move the example there."""
    places = torch.nonzero(mask).cpu().numpy()
    middle = places[rng.integers(len(places))] if len(places) else np.full(2, window // 2)
    jitter = rng.integers(-(window // 8), window // 8 + 1, size=2)
    place = np.clip(middle + jitter - window // 4, 0, window - window // 2)
    example.offset = 2 * (example.offset + place)
    return np.asarray(place, np.int64)


def _cut(whole: Scale, size: int, rng: np.random.Generator) -> Scale:
    """A window of each whole picture, whose middle half holds a pixel that counts."""
    corners = []
    for weights in whole.weights:
        places = torch.nonzero(weights).cpu().numpy()
        corner = places[rng.integers(len(places))] - size // 4 - rng.integers(max(size // 2, 1), size=2)
        corners.append(np.clip(corner, 0, np.array(weights.shape) - size))

    def cut(values: Tensor) -> Tensor:
        if values.shape[-1] == 1:
            return values
        pairs = zip(values, corners, strict=True)
        return torch.stack([picture[..., top : top + size, left : left + size] for picture, (top, left) in pairs])

    maps = {name: cut(values) for name, values in whole.maps.items()}
    return whole._replace(maps=maps, truth=cut(whole.truth), weights=cut(whole.weights), lit=cut(whole.lit))


# --- the camera -------------------------------------------------------------------------------------------------------


class _Draws(dict[str, Tensor]):
    """Capture draws of N examples, as tensors (N, ...), by the names of :class:`CaptureDraw`."""

    @classmethod
    def of(cls, draws: Sequence[CaptureDraw], device: torch.device) -> "_Draws":
        columns = {name: np.array([vars(draw)[name] for draw in draws], np.float32) for name in vars(draws[0])}
        return cls({name: torch.tensor(values, device=device) for name, values in columns.items()})

    def __getattr__(self, name: str) -> Tensor:
        return self[name]

    def subset(self, which: Tensor | Sequence[int]) -> "_Draws":
        return _Draws({name: values[which] for name, values in self.items()})


def _photos(draw: CaptureDraw) -> tuple[slice, ...]:
    """The planes of the draw's photos: the one in coloured light, and the white one where there is one."""
    return (PHOTO, WHITE) if draw.white else (PHOTO,)


def _weights(mixing: F64, colours: F64) -> Tensor:
    """(3, 3, 3) responses of a photo's channels to each light's red, green and blue."""
    return torch.tensor(np.einsum("ik,ij->ikj", mixing, colours), dtype=torch.float32)


def _exposures(light: Tensor, mask: Tensor, draws: _Draws) -> Tensor:
    """(N,) factors that bring the highlights of N photos to the sensor's drawn exposure."""
    factors = []
    for values, where, share, exposure in zip(light, mask, draws.highlights, draws.exposure, strict=True):
        brightness = values.amax(dim=0)[where[0]]
        bright = _quantile(brightness, 1 - float(share)) if len(brightness) else torch.ones_like(exposure)
        factors.append(exposure / bright.clamp(min=1e-6))
    return torch.stack(factors)


def _quantile(values: Tensor, share: float) -> Tensor:
    """As torch.quantile, which sorts."""
    place = share * (len(values) - 1)
    below = min(int(place), len(values) - 1)
    low, high = (torch.kthvalue(values, 1 + min(rank, len(values) - 1)).values for rank in (below, below + 1))
    return low + (place - below) * (high - low)


def _shot(light: Tensor, draws: _Draws, exposure: Tensor, finer: Tensor, generator: torch.Generator) -> Tensor:
    """Photograph what arrives in windows (N, 3, H, W): the values of the photos' files.

    finer: (N,) how many scales finer the camera's own pixels are: noise falls with the pixels that are averaged.
    """
    light = light * exposure[:, None, None, None]
    soft = torch.nonzero((draws.blur > 0) & (finer < 2)).flatten()
    if len(soft):
        light[soft] = _blurred(light[soft], draws.blur[soft] / 2.0 ** finer[soft])
    own, stored = finer == 0, draws.bits > 0
    mosaic = torch.nonzero(own & (draws.mosaic > 0)).flatten()
    if len(mosaic):
        light[mosaic] = _demosaiced(light[mosaic])
    # Variances of the shot noise, for each unit of light, and of the read noise.
    shot, read = 1 / draws.full_well, (draws.read_noise / draws.full_well).square()
    scale = 0.25**finer
    deviation = light.clamp(min=0).mul_((shot * scale)[:, None, None, None]).add_((read * scale)[:, None, None, None])
    noise = torch.randn(light.shape, generator=generator, device=light.device)
    light += noise.mul_(deviation.sqrt_())
    unbounded = light[~stored]
    light.clamp_(0, 1)
    light[~stored] = unbounded
    rounded = torch.nonzero(own & stored).flatten()
    if len(rounded):
        light[rounded] = _stored(light[rounded], draws.subset(rounded))
    return light


def _unclipped(white: Tensor, bits: Tensor) -> Tensor:
    """(N, 1, H, W) where photos (N, 3, H, W) are not clipped."""
    return (white < 0.98).all(dim=1, keepdim=True) | (bits == 0)[:, None, None, None]


def _fit_white_photo(photo: Tensor, white: Tensor, draw: CaptureDraw) -> WhitePhoto | None:
    """From pixels (3, N) of an example's two photos; the lights count as equally bright in the white one."""
    sample = slice(None, None, 1 + photo.shape[1] // FITTED)
    photo_pixels, white_pixels = (values[:, sample].T.cpu().numpy() for values in (photo, white))
    return WhitePhoto.fit(photo_pixels, white_pixels, draw.known_mixing, np.ones(3))


def _normalise_by_white_photo(
    photo: Tensor, white: Tensor, fit: WhitePhoto | None, light: Tensor, valid: Tensor
) -> Tensor:
    """(3, H, W) each light alone, as :func:`mpsnet_core.estimate.white_photo.normalise_by_white_photo` does it.

    light: the unmixed photo, which is returned without a fit.
    """
    if fit is None:
        return light
    gains, lower_limits, unmixing_before, unmixing_after, mean_factors = (
        torch.tensor(values, dtype=torch.float32, device=photo.device) for values in fit[:5]
    )
    albedo = torch.maximum(torch.tensordot(unmixing_before, white, 1), lower_limits[:, None, None])
    albedo /= gains[:, None, None]
    factors = torch.where(valid, albedo.mean(dim=0) / albedo, mean_factors[:, None, None])
    return torch.tensordot(unmixing_after, torch.tensordot(unmixing_before, photo, 1) * factors, 1)


def _known(mask: Tensor, error: Tensor, finer: Tensor) -> Tensor:
    """Masks (N, 1, H, W) with their error; a mask that erosion would empty is returned unchanged."""
    known = _grown(mask, (error / 2**finer).trunc().long())
    return known | mask & ~known.flatten(1).any(1)[:, None, None, None]


def _blurred(planes: Tensor, sigma: Tensor) -> Tensor:
    """Planes (N, C, H, W) under Gaussians of N widths; the border is repeated beyond it."""
    weights = [blur_weights(float(width)) for width in sigma]
    reach = max(len(gaussian) // 2 for gaussian in weights)
    kernels = np.stack([np.pad(gaussian, reach - len(gaussian) // 2) for gaussian in weights]).astype(np.float32)
    kernel = torch.from_numpy(kernels).to(planes.device)[:, :, None, None, None]
    # On CPUs sums of shifted planes take a ninth of a grouped convolution's time.
    planes = functional.pad(planes, (reach,) * 4, mode="replicate")
    for dim in (2, 3):
        sharp, size = planes, planes.shape[dim] - 2 * reach
        planes = sharp.narrow(dim, 0, size) * kernel[:, 0]
        for shift in range(1, 2 * reach + 1):
            planes.addcmul_(sharp.narrow(dim, shift, size), kernel[:, shift])
    return planes


# Bilinear interpolation of a Bayer mosaic: the weights of a missing value's neighbours.
_GREEN = torch.tensor([[0.0, 0.25, 0.0], [0.25, 1.0, 0.25], [0.0, 0.25, 0.0]])
_RED_BLUE = torch.tensor([[0.25, 0.5, 0.25], [0.5, 1.0, 0.5], [0.25, 0.5, 0.25]])


def _demosaiced(planes: Tensor) -> Tensor:
    """Pictures (N, 3, H, W) behind a Bayer mosaic (red top left), interpolated bilinearly."""
    sites = torch.zeros(3, *planes.shape[2:], device=planes.device)
    sites[0, ::2, ::2] = sites[1, ::2, 1::2] = sites[1, 1::2, ::2] = sites[2, 1::2, 1::2] = 1
    kernel = torch.stack([_RED_BLUE, _GREEN, _RED_BLUE])[:, None].to(planes.device)
    total = functional.conv2d(functional.pad(planes * sites, (1,) * 4), kernel, groups=3)
    return total / functional.conv2d(functional.pad(sites[None], (1,) * 4), kernel, groups=3)


def _stored(light: Tensor, draws: _Draws) -> Tensor:
    """Values (N, 3, H, W) from 0 to 1, written to files and read back."""
    curved = torch.nonzero(draws.srgb > 0).flatten()
    light[curved] = _to_srgb(light[curved])
    top = (2.0**draws.bits - 1)[:, None, None, None]
    levels = torch.round(light * top)
    jpeg = torch.nonzero(draws.jpeg_quality > 0).flatten()
    if len(jpeg):
        levels[jpeg] = jpeg_losses(levels[jpeg], draws.jpeg_quality[jpeg], draws.halved_chroma[jpeg] > 0)
    values = levels / top
    values[curved] = _from_srgb(values[curved])
    return values


def _to_srgb(linear: Tensor) -> Tensor:
    curve = 1.055 * linear.clamp(min=1e-6) ** (1 / 2.4) - 0.055
    return curve + (linear <= 0.0031308) * (12.92 * linear - curve)


def _from_srgb(values: Tensor) -> Tensor:
    curve = ((values + 0.055) / 1.055) ** 2.4
    return curve + (values <= 0.04045) * (values / 12.92 - curve)


def _grown(mask: Tensor, pixels: Tensor) -> Tensor:
    """Masks (N, 1, H, W) larger by (N,) pixels, or smaller where negative, by octagons."""
    shrunk = (pixels < 0)[:, None, None, None]
    region = mask ^ shrunk
    for step in range(int(pixels.abs().max())):
        rows = _spread(region, 2)
        larger = _spread(rows, 3) if step % 2 else rows | _spread(region, 3)
        region = region | larger & (pixels.abs() > step)[:, None, None, None]
    return region ^ shrunk


def _spread(region: Tensor, dim: int) -> Tensor:
    """A bool region, grown by one pixel along an axis."""
    size, spread = region.shape[dim] - 1, region.clone()
    spread.narrow(dim, 0, size).logical_or_(region.narrow(dim, 1, size))
    spread.narrow(dim, 1, size).logical_or_(region.narrow(dim, 0, size))
    return spread


def unmixed(photo: Tensor, mixing: Tensor) -> Tensor:
    """Each light's share of photos (N, 3, H, W) under mixings (N, 3, 3); under light directions, equation 2."""
    inverse: Tensor = torch.linalg.inv(mixing.double()).float()
    return (inverse @ photo.flatten(2)).reshape(photo.shape)


def _means(light: Tensor, used: Tensor) -> Tensor:
    """(N, 3) means of photos, zero where they are not used, over where they are; 1 where not above zero, and at least
    :data:`MIN_MEAN` of the channels' mean."""
    means = light.sum(dim=(2, 3)) / used.sum(dim=(2, 3)).clamp(min=1)
    means = torch.where(means > 0, means, 1)
    return torch.maximum(means, MIN_MEAN * means.mean(dim=1, keepdim=True))
