"""Photographing: packed samples become training photographs, on the device that trains.

The capture model's numbers are drawn in :mod:`mpsnet_core.synthesis.capture_model`; here they are applied to a whole
batch at once. Networks that go from coarse to fine see an example at several scales: first the whole object, then
windows of it, each at twice the resolution. The finest is the camera's own pixels, with its blur, mosaic, noise, levels
and JPEG; the others are means of those. Beyond the sample's own resolution the picture is magnified, as soft as large
photos of smooth things. For other networks, and in evaluations, the sample's own pixels are the camera's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.card import ModelCard
from mpsnet_core.estimate.light_frame import CAMERA_FRAME, LightFrame, canonical_frames
from mpsnet_core.learning.training.jpeg import jpeg_losses
from mpsnet_core.learning.training.networks.network import Network, unit
from mpsnet_core.learning.training.packed import Packed, PackedSamples
from mpsnet_core.scene.rig import LightRig
from mpsnet_core.synthesis.capture_model import CaptureDraw, CaptureModel, blur_weights, turned

WINDOW = 128  # pixels a side
COARSEST = (64.0, 128.0)  # pixels of the object's longer side on the first scale
# How many scales follow the first one.
FINER_SHARES = (0.1, 0.4, 0.25, 0.15, 0.1)
NEAREST_SHARE = 0.7  # of the frames are among the two in which the first light stands most nearly straight up
LEAST_COVERED = 0.02  # share of a coarse pixel that the mask must cover for it to count
SHOWN = 13  # planes: photo, white photo, normals, lit (3 each), mask


class Scale(NamedTuple):
    """N windows on one scale. Maps are (N, C, H, W), zero outside the known mask.

    maps: by the names of :data:`mpsnet_core.estimate.features.FEATURE_CHANNELS`, without "previous" and those that
    :func:`mpsnet_core.learning.training.inputs.map_of` makes of them. truth: (N, 3, H, W) true unit normals. weights:
    (N, H, W) 1 where a pixel counts. lit: (N, 3, H, W) whether each light reaches it. examples: (N,) which examples of
    the batch these are. places: (N, 2) where in the window of the scale before this one begins, in that one's pixels;
    it covers half of its side.
    """

    maps: dict[str, Tensor]
    truth: Tensor
    weights: Tensor
    lit: Tensor
    examples: Tensor
    places: NDArray[np.int64]


@dataclass
class _Example:
    """One sample, arranged to be photographed."""

    planes: Tensor  # (13, H, W) at its own resolution, zero outside the mask
    directions: NDArray[np.float64]
    draw: CaptureDraw
    finest: int
    coarse: tuple[int, int]  # height and width of the object on the first scale
    offset: NDArray[np.int64]  # of the present window, in pixels of the present scale, from the object's own corner
    bicubic: bool


class Photographer:
    """Draws batches of examples: `batch(step, size)` depends on nothing but the samples, the seed and the step.

    Parameters
    ----------
    samples : PackedSamples
        Every epoch shows all of them.
    model : CaptureModel, optional
        Of the capture's numbers.
    seed : int
        Of all that is drawn.
    window : int
        Pixels a side, around pixels that count; 0, where there is one scale, for whole pictures.
    finer : sequence of float
        Shares of how many scales follow the first; none for one scale, the samples' own pixels.
    canonical : bool
        Whether in frames in which the first light stands most nearly straight up, the lights counter-clockwise; else
        turned by any quarters, mirrored or not, the lights in any order.
    shuffled : bool
        Whether every epoch has an order of its own.
    device : torch.device, optional
        Where photographs are made; the CPU unless given.
    """

    def __init__(
        self,
        samples: PackedSamples,
        model: CaptureModel | None = None,
        *,
        seed: int = 0,
        window: int = WINDOW,
        finer: Sequence[float] = FINER_SHARES,
        canonical: bool = True,
        shuffled: bool = True,
        device: torch.device | None = None,
    ) -> None:
        self.samples, self.model, self.seed, self.window = samples, model or CaptureModel(), seed, window
        self.finer, self.canonical, self.shuffled = np.cumsum(finer) / np.sum(finer), canonical, shuffled
        self.device = device or torch.device("cpu")
        self._order: tuple[int, NDArray[np.int64]] = (-1, np.empty(0, np.int64))

    @classmethod
    def of(
        cls,
        network: Network | ModelCard,
        samples: PackedSamples,
        model: CaptureModel | None = None,
        *,
        seed: int,
        window: int,
        shuffled: bool = True,
        device: torch.device | None = None,
    ) -> "Photographer":
        """For the photographs that a network, or the one of a card, sees."""
        finer = FINER_SHARES if network.kind == "pyramid" else ()
        canonical = network.frame == "canonical"
        return cls(
            samples, model, seed=seed, window=window, finer=finer, canonical=canonical, shuffled=shuffled, device=device
        )

    def batch(self, step: int, size: int) -> list[Scale]:
        """The scales of step `step`'s examples, coarse to fine."""
        key = [self.seed, 3, step]
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(key)))
        generator = torch.Generator(self.device).manual_seed(int(rng.integers(1 << 62)))
        examples = [self._example(self.samples[self._index(step * size + k)], rng) for k in range(size)]
        if len(self.finer):
            return _photographed(examples, self.window, rng, generator)
        (whole,) = _photographed(examples, _side(examples, self.window), rng, generator)
        return [_cut(whole, self.window, rng) if self.window else whole]

    def _index(self, number: int) -> int:
        epoch, place = divmod(number, len(self.samples))
        if not self.shuffled:
            return place
        if self._order[0] != epoch:
            rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([self.seed, 1, epoch])))
            self._order = (epoch, rng.permutation(len(self.samples)))
        return int(self._order[1][place])

    def _example(self, packed: Packed, rng: np.random.Generator) -> "_Example":
        draw = self.model.draw(rng)
        frame = _near_frame(packed.directions, rng) if self.canonical else _any_frame(rng)
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


def photograph(packed: Packed, draw: CaptureDraw) -> tuple[Capture, NDArray[np.float32]]:
    """Photograph a sample's own pixels in camera space, under three lights at once.

    Returns the capture, whose rig and mask have the draw's errors, and (H, W, 3) true normals, zero where unknown.
    """
    example = _arranged(packed, draw, CAMERA_FRAME, torch.device("cpu"))
    planes, draws = _window(example, 0, _side([example]))[None], _Draws.of([draw], torch.device("cpu"))
    exposure, noise = _exposures(planes, draws), torch.Generator().manual_seed(draw.noise_seed)
    shot = _shot(planes, draws, exposure, torch.zeros(1), noise)
    height, width = packed.mask.shape

    def whole(values: Tensor) -> NDArray[np.float32]:
        return np.ascontiguousarray(values[0, :, :height, :width].permute(1, 2, 0).numpy())

    capture = Capture(
        whole(shot.photo),
        whole(shot.mask)[..., 0] > 0,
        LightRig(turned(packed.directions, draw.direction_errors), draw.known_mixing, exact=draw.exact),
        clip=1.0 if draw.bits else np.inf,
        white=whole(shot.white) if draw.white else None,
        white_clipped=np.repeat(whole(shot.unclipped) == 0, 3, axis=2) if draw.white and draw.bits else None,
    )
    return capture, whole(unit(planes[:, 6:9]))


def _near_frame(directions: NDArray[np.float64], rng: np.random.Generator) -> LightFrame:
    """Mostly one of the two nearest, which single passes use; else any, for averages of more passes."""
    frames = canonical_frames(directions)
    return frames[int(rng.integers(2 if rng.random() < NEAREST_SHARE else len(frames)))]


def _any_frame(rng: np.random.Generator) -> LightFrame:
    first, second, third = (int(light) for light in rng.permutation(3))
    return LightFrame((first, second, third), int(rng.integers(4)), bool(rng.integers(2)))


def _arranged(packed: Packed, draw: CaptureDraw, frame: LightFrame, device: torch.device) -> _Example:
    """The sample as the photo's channels see it, turned into the frame; its one scale is the sample's own."""
    lights, normals, mask, lit = (
        values.to(device) for values in (packed.lights, packed.normals, packed.mask, packed.lit)
    )
    order, rotation = list(frame.order), frame.rotation
    height, width = mask.shape
    # Unit normals turn with the picture. Light k becomes the frame's light order.index(k).
    mixed = _weights(draw, device) @ lights.float().reshape(3, 3, -1)[order].reshape(9, -1)
    planes = torch.cat(
        [
            mixed.reshape(6, height, width),
            torch.einsum("dc,chw->dhw", torch.tensor(rotation, dtype=torch.float32, device=device), normals.float()),
            lit[order].float(),
            mask[None].float(),
        ]
    )
    planes = torch.rot90(planes, frame.quarter_turns, (1, 2))
    if frame.mirrored:
        planes = planes.flip(2)
    height, width = planes.shape[1:]
    directions = packed.directions[order] @ rotation.T
    return _Example(planes, directions, draw, 0, (height, width), np.zeros(2, np.int64), False)


def _side(examples: Sequence[_Example], least: int = 0) -> int:
    """Pixels a side of a square that holds each example at its own resolution; a multiple of JPEG's blocks."""
    return -(-max(least, *(side for example in examples for side in example.coarse)) // 16) * 16


def _photographed(
    examples: list[_Example], window: int, rng: np.random.Generator, generator: torch.Generator
) -> list[Scale]:
    """All scales of some examples; the finer ones of those that have them."""
    device = examples[0].planes.device
    draws = _Draws.of([example.draw for example in examples], device)
    known = np.stack([turned(example.directions, example.draw.direction_errors) for example in examples])
    chosen = list(range(len(examples)))
    places = np.zeros((len(examples), 2), np.int64)
    scales: list[Scale] = []
    for level in range(max(example.finest for example in examples) + 1):
        planes = torch.stack([_window(examples[k], level, window) for k in chosen])
        some = torch.tensor(chosen, device=device)
        drawn = draws.chosen(some)
        finer = torch.tensor([examples[k].finest - level for k in chosen], device=device)
        if level == 0:
            exposure = _exposures(planes, drawn)
        shot = _shot(planes, drawn, exposure[some], finer, generator)
        photo = unmixed(shot.photo, drawn.known_mixing) * shot.mask
        white = shot.white * shot.mask * shot.unclipped
        if level == 0:
            means = _means(photo, white, shot.mask, shot.unclipped)
        mean = means[some]
        photo = photo / mean[:, :3].mean(dim=1)[:, None, None, None]
        white = white / mean[:, 3:, None, None] * drawn.white[:, None, None, None]
        mask = planes[:, 12:] > 0
        counts = (mask & shot.mask).float()
        given = torch.stack([torch.full((len(chosen),), float(level > 0), device=device), drawn.white], dim=1)
        scales.append(
            Scale(
                maps={
                    "photo": photo,
                    "mask": shot.mask.float(),
                    "white": white,
                    "lights": torch.tensor(known[chosen].reshape(-1, 9, 1, 1), dtype=torch.float32, device=device),
                    "channel_means": (mean[:, :3] / mean[:, :3].mean(dim=1, keepdim=True))[:, :, None, None],
                    "given": given[:, :, None, None],
                    "exact": drawn.exact[:, None, None, None],
                },
                truth=unit(planes[:, 6:9]) * counts,
                weights=counts[:, 0],
                lit=(planes[:, 9:12] > 0.5).float(),
                examples=some,
                places=places,
            )
        )
        zoomed = [number for number, k in enumerate(chosen) if examples[k].finest > level]
        places = np.array([_zoom(examples[chosen[n]], mask[n, 0], window, rng) for n in zoomed]).reshape(-1, 2)
        chosen = [chosen[n] for n in zoomed]
    return scales


# --- where the windows are --------------------------------------------------------------------------------------------


def _window(example: _Example, level: int, window: int) -> Tensor:
    """(13, window, window) means over the mask inside each pixel, the mask's own plane as bool; zero beyond."""
    planes, size = example.planes, [length << level for length in example.coarse]
    height = planes.shape[1]
    top, left = (int(place) for place in example.offset)
    if size[0] <= height:
        whole = functional.interpolate(planes[None], size=size, mode="bilinear", antialias=True)[0]
        # Negative padding cuts.
        found = functional.pad(whole, (-left, left + window - size[1], -top, top + window - size[0]))
    else:
        steps = torch.arange(window, device=planes.device) + 0.5
        y, x = ((steps + start) / length * 2 - 1 for start, length in ((top, size[0]), (left, size[1])))
        grid = torch.stack([x.expand(window, -1), y[:, None].expand(-1, window)], dim=-1)[None]
        mode = "bicubic" if example.bicubic else "bilinear"
        found = functional.grid_sample(planes[None], grid, mode=mode, align_corners=False)[0]
    least = LEAST_COVERED if level < example.finest and size[0] <= height else 0.5
    covered = found[12:] > least
    found[:12] = torch.where(covered, found[:12] / found[12:].clamp(min=LEAST_COVERED), 0)
    found[:6].clamp_(min=0)
    found[12:] = covered
    return found


def _zoom(example: _Example, mask: Tensor, window: int, rng: np.random.Generator) -> NDArray[np.int64]:
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


class _Draws(NamedTuple):
    """Capture draws of N examples, as tensors (N, ...)."""

    known_mixing: Tensor
    exposure: Tensor
    highlights: Tensor
    full_well: Tensor
    read_noise: Tensor
    bits: Tensor
    srgb: Tensor
    jpeg_quality: Tensor
    halved_chroma: Tensor
    blur: Tensor
    mosaic: Tensor
    mask_error: Tensor
    white: Tensor
    exact: Tensor

    @classmethod
    def of(cls, draws: Sequence[CaptureDraw], device: torch.device) -> "_Draws":
        return cls(
            *(
                torch.tensor(np.array([getattr(draw, name) for draw in draws]).astype(np.float32), device=device)
                for name in cls._fields
            )
        )

    def chosen(self, which: Tensor) -> "_Draws":
        return _Draws(*(values[which] for values in self))


def _weights(draw: CaptureDraw, device: torch.device) -> Tensor:
    """(6, 9) responses of the photo's and the white photo's channels to each light's red, green and blue."""
    photo = np.einsum("ik,ij->ikj", draw.mixing, draw.colours)
    white = np.einsum("ik,ij->ikj", draw.white_mixing, draw.colours)
    return torch.tensor(np.concatenate([photo, white]).reshape(6, 9), dtype=torch.float32, device=device)


class _Shot(NamedTuple):
    """N photographs. photo, white: (N, 3, H, W) values of their files. unclipped: (N, 1, H, W) 1 where the white one is
    not clipped. mask: (N, 1, H, W) bool, as it is known."""

    photo: Tensor
    white: Tensor
    unclipped: Tensor
    mask: Tensor


def _exposures(planes: Tensor, draws: _Draws) -> Tensor:
    """(N, 2) factors that bring the photo's and the white photo's highlights to the sensor's drawn exposure."""
    factors = []
    for values, share, exposure in zip(planes, draws.highlights, draws.exposure, strict=True):
        for first in (0, 3):
            brightness = values[first : first + 3].amax(dim=0)[values[12] > 0]
            bright = torch.quantile(brightness, 1 - share) if len(brightness) else torch.ones_like(exposure)
            factors.append(exposure / bright.clamp(min=1e-6))
    return torch.stack(factors).reshape(-1, 2)


def _shot(planes: Tensor, draws: _Draws, exposure: Tensor, finer: Tensor, generator: torch.Generator) -> _Shot:
    """Photograph windows (N, 13, H, W).

    finer: (N,) how many scales finer the camera's own pixels are: noise falls with the pixels that are averaged.
    """
    light = _blurred(planes[:, :6], torch.where(finer < 2, draws.blur / 2.0**finer, 0))
    light = light * exposure.repeat_interleave(3, dim=1)[:, :, None, None]
    own, stored = finer == 0, draws.bits > 0
    mosaic = torch.nonzero(own & (draws.mosaic > 0)).flatten()
    if len(mosaic):
        light[mosaic] = _demosaiced(light[mosaic])
    shot = (1 / draws.full_well)[:, None, None, None]
    read = (draws.read_noise / draws.full_well).square()[:, None, None, None]
    noise = torch.randn(light.shape, generator=generator, device=light.device)
    light = light + torch.sqrt(light.clamp(min=0) * shot + read) * noise / 2.0 ** finer[:, None, None, None]
    light = torch.where(stored[:, None, None, None], light.clamp(0, 1), light)
    rounded = torch.nonzero(own & stored).flatten()
    if len(rounded):
        light[rounded] = _stored(light[rounded], draws.chosen(rounded))
    photo, white = light[:, :3], light[:, 3:]
    unclipped = ((white < 0.98).all(dim=1, keepdim=True) | ~stored[:, None, None, None]).float()
    mask = planes[:, 12:] > 0
    known = _grown(mask, (draws.mask_error / 2**finer).trunc().long())
    # A mask that would have shrunk to nothing stays as it was.
    known = torch.where(known.flatten(1).any(1)[:, None, None, None], known, mask)
    return _Shot(photo, white, unclipped, known)


def _blurred(planes: Tensor, sigma: Tensor) -> Tensor:
    """Planes (N, C, H, W) under Gaussians of N widths; the border is repeated beyond it."""
    weights = [blur_weights(float(width)) for width in sigma]
    reach = max(len(gaussian) // 2 for gaussian in weights)
    if not reach:
        return planes
    kernels = np.stack([np.pad(gaussian, reach - len(gaussian) // 2) for gaussian in weights]).astype(np.float32)
    count, channels, height, _ = planes.shape
    kernel = torch.from_numpy(kernels).to(planes.device).repeat_interleave(channels, dim=0)[:, None, None]
    flat = functional.pad(planes, (reach,) * 4, mode="replicate").reshape(1, count * channels, height + 2 * reach, -1)
    flat = functional.conv2d(flat, kernel, groups=count * channels)
    flat = functional.conv2d(flat, kernel.transpose(2, 3), groups=count * channels)
    return flat.reshape(planes.shape)


# Bilinear interpolation of a Bayer mosaic: the weights of a missing value's neighbours.
_GREEN = torch.tensor([[0.0, 0.25, 0.0], [0.25, 1.0, 0.25], [0.0, 0.25, 0.0]])
_RED_BLUE = torch.tensor([[0.25, 0.5, 0.25], [0.5, 1.0, 0.5], [0.25, 0.5, 0.25]])


def _demosaiced(planes: Tensor) -> Tensor:
    """Pictures (N, 6, H, W) behind a Bayer mosaic (red top left), interpolated bilinearly."""
    sites = torch.zeros(3, *planes.shape[2:], device=planes.device)
    sites[0, ::2, ::2] = sites[1, ::2, 1::2] = sites[1, 1::2, ::2] = sites[2, 1::2, 1::2] = 1
    sites = sites.repeat(2, 1, 1)
    kernel = torch.stack([_RED_BLUE, _GREEN, _RED_BLUE]).repeat(2, 1, 1)[:, None].to(planes.device)
    total = functional.conv2d(functional.pad(planes * sites, (1,) * 4), kernel, groups=6)
    return total / functional.conv2d(functional.pad(sites[None], (1,) * 4), kernel, groups=6)


def _stored(light: Tensor, draws: _Draws) -> Tensor:
    """Values (N, 6, H, W) from 0 to 1, written to files and read back."""
    top = (2.0**draws.bits - 1)[:, None, None, None]
    curved = draws.srgb[:, None, None, None] > 0
    levels = torch.round(torch.where(curved, _to_srgb(light), light) * top)
    jpeg = torch.nonzero(draws.jpeg_quality > 0).flatten()
    if len(jpeg):
        pairs = levels[jpeg].reshape(2 * len(jpeg), 3, *levels.shape[2:])
        quality = draws.jpeg_quality[jpeg].repeat_interleave(2)
        halved = draws.halved_chroma[jpeg].repeat_interleave(2) > 0
        levels[jpeg] = jpeg_losses(pairs, quality, halved).reshape(levels[jpeg].shape)
    values = levels / top
    return torch.where(curved, _from_srgb(values), values)


def _to_srgb(linear: Tensor) -> Tensor:
    return torch.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear.clamp(min=1e-6) ** (1 / 2.4) - 0.055)


def _from_srgb(values: Tensor) -> Tensor:
    return torch.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055).clamp(min=1e-6) ** 2.4)


def _grown(mask: Tensor, pixels: Tensor) -> Tensor:
    """Masks (N, 1, H, W) larger by (N,) pixels, or smaller where negative, by octagons."""
    grown = mask.float()
    for step in range(int(pixels.abs().max())):
        turn = ((pixels.abs() > step).float() * pixels.sign())[:, None, None, None]
        region = torch.where(turn < 0, 1 - grown, grown)
        if step % 2:
            larger = functional.max_pool2d(region, 3, 1, 1)
        else:
            larger = torch.maximum(
                functional.max_pool2d(region, (3, 1), 1, (1, 0)), functional.max_pool2d(region, (1, 3), 1, (0, 1))
            )
        grown = torch.where(turn == 0, grown, torch.where(turn < 0, 1 - larger, larger))
    return grown > 0


def unmixed(photo: Tensor, mixing: Tensor) -> Tensor:
    """Each light's share of photos (N, 3, H, W) under mixings (N, 3, 3); under light directions, equation 2."""
    return torch.einsum("nij,njhw->nihw", torch.linalg.inv(mixing.double()).float(), photo)


def _means(photo: Tensor, white: Tensor, mask: Tensor, unclipped: Tensor) -> Tensor:
    """(N, 6) means of photo and white photo, zero where they do not count, over the mask; 1 where not above zero."""
    pairs = ((photo, mask), (white, mask * unclipped))
    means = torch.cat([values.sum(dim=(2, 3)) / count.sum(dim=(2, 3)).clamp(min=1) for values, count in pairs], dim=1)
    means = torch.where(means > 0, means, 1)
    photo_mean = means[:, :3].mean(dim=1, keepdim=True)
    # A channel that is black everywhere must not blow up the others.
    return torch.cat([torch.maximum(means[:, :3], 1e-4 * photo_mean), means[:, 3:]], dim=1)
