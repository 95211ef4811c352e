"""The network that finds the lights of a photo without a rig: train it on samples, and write lights.onnx.

python examples/train_lights.py --samples FOLDER [--samples FOLDER ...] --validation FOLDER [--steps N] [-o FILE]

The samples are those of `mpsnet synthesize`; 128 pixels a side suffice. It takes about half an hour, and goes on from
lights.onnx.checkpoint; lights.packed may be deleted. It needs pip install '.[train]'. Measure the printed "within 2" on
the held-out samples, and set ERROR_SCALE in mpsnet_core/estimate/lights/find.py so that it is 0.95.
"""

import argparse
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import count, pairwise
from pathlib import Path

import numpy as np
import onnx
import torch
from numpy.typing import NDArray
from onnx import helper, numpy_helper
from torch import Tensor, nn
from torch.nn import functional

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.errors import InputError
from mpsnet_core.estimate.lights.find import SIDE, crops, into_views
from mpsnet_core.learning.training.loop import resolved_precision
from mpsnet_core.learning.training.packed import PackedSamples
from mpsnet_core.learning.training.photo_simulation import simulate_photo
from mpsnet_core.synthesis.capture_model import CaptureModel
from mpsnet_core.synthesis.random_sampling import generator

# Lights are of any direction, and crosstalk becomes a part of it; grain must not be taken for shading.
PHOTOS = CaptureModel(exact=0.0, measured=0.0, white=0.0, grain=0.3, crosstalk=(0.0, 0.35))
WIDTHS, HIDDEN = (24, 48, 76, 104), 128
BATCH, VIEWS_OF_EACH, LEARNING_RATE, DECAYED = 16, 3, 1.5e-3, 0.4
LEAST_ERROR = 0.02  # radians
QUANTISED = 2000  # weights: layers with fewer stay as they are


class Block(nn.Module):
    """Two convolutions, with a connection past them."""

    def __init__(self, channels: int, wider: int, stride: int) -> None:
        super().__init__()
        self.c1, self.c2 = nn.Conv2d(channels, wider, 3, stride, 1), nn.Conv2d(wider, wider, 3, 1, 1)
        self.n1, self.n2 = nn.BatchNorm2d(wider), nn.BatchNorm2d(wider)
        self.skip = nn.Conv2d(channels, wider, 1, stride) if channels != wider or stride > 1 else nn.Identity()

    def forward(self, x: Tensor) -> Tensor:
        inner = self.n2(self.c2(functional.relu(self.n1(self.c1(x)))))
        return functional.relu(self.skip(x) + inner)


class LightNetwork(nn.Module):
    """From a crop (N, 3, SIDE, SIDE) and its mask (N, 1, SIDE, SIDE) to light directions (N, 3, 3) and their errors
    (N, 3) in radians."""

    place: Tensor

    def __init__(self) -> None:
        super().__init__()
        pairs = [(WIDTHS[0], WIDTHS[0])]
        for narrow, wide in pairwise(WIDTHS):
            pairs += [(narrow, wide), (wide, wide)]
        self.stem = nn.Conv2d(6, WIDTHS[0], 5, 2, 2)
        self.blocks = nn.Sequential(*(Block(a, b, 1 if a == b else 2) for a, b in pairs))
        self.head = nn.Sequential(nn.Linear(16 * WIDTHS[-1], HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, 12))
        y, x = torch.meshgrid(torch.linspace(1, -1, SIDE), torch.linspace(-1, 1, SIDE), indexing="ij")
        self.register_buffer("place", torch.stack([x, y])[None])

    def forward(self, photo: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        seen = torch.cat([torch.log1p(photo.clamp(min=0)) * mask, mask, self.place * mask], 1)
        found = self.head(self.blocks(functional.relu(self.stem(seen))).flatten(1))
        towards = found[:, :9].reshape(-1, 3, 3) + torch.tensor([0.0, 0.0, 1.0])
        return functional.normalize(towards, dim=2), functional.softplus(found[:, 9:] - 1) + LEAST_ERROR


def batch(samples: PackedSamples, seed: int, step: int, size: int, views: int) -> tuple[Tensor, Tensor]:
    """Crops (N, 4, SIDE, SIDE) of some views of `size` photos, and the lights (N, 3, 3) as each view shows them."""
    rng = generator(seed, step)
    seen: list[NDArray[np.float32]] = []
    lights: list[NDArray[np.float64]] = []
    while len(seen) < size * views:
        packed, drawn = samples[int(rng.integers(len(samples)))], PHOTOS.draw(rng)
        try:
            capture, _ = simulate_photo(packed, drawn)
        except InputError:  # a mask without pixels
            continue
        every = np.moveaxis(crops(capture.image, capture.mask), -1, 1)
        mixing = drawn.mixing / np.diag(drawn.mixing)[:, None]
        effective = normalised(mixing @ packed.directions)
        turned = into_views(np.broadcast_to(effective, (len(every), 3, 3)))
        for view in rng.permutation(len(every))[:views]:
            order = rng.permutation(3)
            seen.append(every[view][[*order, 3]])
            lights.append(turned[view][order])
    return torch.from_numpy(np.array(seen)), torch.from_numpy(np.array(lights, np.float32))


def batches(samples: PackedSamples, first: int) -> Iterator[tuple[Tensor, Tensor]]:
    """The batches of all steps from the first one on, each photographed during the step before."""
    with ThreadPoolExecutor(1) as ahead:
        following = ahead.submit(batch, samples, 1, first, BATCH, VIEWS_OF_EACH)
        for step in count(first + 1):
            now = following.result()
            following = ahead.submit(batch, samples, 1, step, BATCH, VIEWS_OF_EACH)
            yield now


def angles(directions: Tensor, lights: Tensor) -> Tensor:
    """(N, 3) angles in radians."""
    return torch.acos((directions * lights).sum(2).clamp(-1 + 1e-6, 1 - 1e-6))


def train(samples: PackedSamples, held_out: PackedSamples, steps: int, checkpoint: Path) -> LightNetwork:
    """The exponential mean of a network's weights over its training."""
    torch.manual_seed(0)
    network, mean = LightNetwork(), LightNetwork().eval()
    mean.load_state_dict(network.state_dict())
    optimiser = torch.optim.AdamW(network.parameters(), lr=LEARNING_RATE, weight_decay=0.02)
    precision = resolved_precision("auto", torch.device("cpu"))
    first = 0
    if checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True)
        network.load_state_dict(state["network"])
        mean.load_state_dict(state["mean"])
        optimiser.load_state_dict(state["optimiser"])
        first = state["step"]
    tests = batch(held_out, 2, 0, 200, 1)
    for step, (seen, lights) in zip(range(first, steps), batches(samples, first), strict=False):
        rate = min(1.0, (step + 1) / 200) * min(1.0, (steps - step) / steps / DECAYED)
        for group in optimiser.param_groups:
            group["lr"] = LEARNING_RATE * rate
        with torch.autocast("cpu", torch.bfloat16, enabled=precision == "bfloat16"):
            directions, errors = (found.float() for found in network(seen[:, :3], seen[:, 3:]))
        loss = (angles(directions, lights) / errors + 2 * torch.log(errors)).mean()  # Laplace's distribution
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        with torch.no_grad():
            for kept, new in zip(mean.parameters(), network.parameters(), strict=True):
                kept.lerp_(new, 1 - min(0.998, (1 + step) / (10 + step)))
            for kept, new in zip(mean.buffers(), network.buffers(), strict=True):
                kept.copy_(new)
        if step % 250 == 249 or step == steps - 1:
            with torch.no_grad():
                directions, errors = mean(tests[0][:, :3], tests[0][:, 3:])
            off = angles(directions, tests[1])
            within = float((off < 2 * errors).float().mean())
            print(f"{step + 1}: held out {float(torch.rad2deg(off.mean())):.2f}°, within 2: {within:.2f}", flush=True)
            state = {"network": network, "mean": mean, "optimiser": optimiser}
            torch.save({name: one.state_dict() for name, one in state.items()} | {"step": step + 1}, checkpoint)
    return mean


def write(network: LightNetwork, path: Path) -> None:
    """Write the ONNX file, its weights as 8-bit integers with a scale for each output channel."""
    inputs = (torch.rand(2, 3, SIDE, SIDE), torch.ones(2, 1, SIDE, SIDE))
    names = ["photo", "mask"], ["directions", "errors"]
    torch.onnx.export(
        network.eval(),
        inputs,
        str(path),
        input_names=names[0],
        output_names=names[1],
        dynamic_axes={name: {0: "views"} for name in (*names[0], *names[1])},
        opset_version=17,
        dynamo=False,
    )
    model = onnx.load(str(path))
    for weights in list(model.graph.initializer):
        values = numpy_helper.to_array(weights)
        if values.size < QUANTISED:
            continue
        scale = np.abs(values).reshape(len(values), -1).max(axis=1).clip(1e-12) / 127
        levels = np.rint(values / scale.reshape(-1, *(1,) * (values.ndim - 1))).astype(np.int8)
        model.graph.initializer.remove(weights)
        for name, part in (("levels", levels), ("scale", scale), ("zero", np.zeros(len(values), np.int8))):
            model.graph.initializer.append(numpy_helper.from_array(part, f"{weights.name}.{name}"))
        parts = [f"{weights.name}.{name}" for name in ("levels", "scale", "zero")]
        model.graph.node.insert(0, helper.make_node("DequantizeLinear", parts, [weights.name], axis=0))
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=Path, action="append", required=True, help="folder to train on")
    parser.add_argument("--validation", type=Path, required=True, help="folder of held-out samples")
    parser.add_argument("--steps", type=int, default=4200, help="steps in all")
    parser.add_argument("-o", "--output", type=Path, default=Path("lights.onnx"))
    options = parser.parse_args()
    cache = options.output.with_suffix(".packed")
    samples, held_out = (PackedSamples(folders, cache=cache) for folders in (options.samples, [options.validation]))
    write(train(samples, held_out, options.steps, options.output.with_suffix(".onnx.checkpoint")), options.output)


if __name__ == "__main__":
    main()
