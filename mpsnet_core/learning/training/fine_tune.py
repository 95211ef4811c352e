"""Fine-tuning: load the weights of an exported network into one that can be trained."""

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import onnx
import torch
from google.protobuf.message import DecodeError
from numpy.typing import NDArray
from onnx import numpy_helper
from torch import Tensor, nn
from torch.nn import functional

from mpsnet_core.errors import FormatError
from mpsnet_core.estimate.card import TRAINING_KEY
from mpsnet_core.io.files import existing_file
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.learning.training.inputs import Batch
from mpsnet_core.learning.training.networks import Network

MAX_BYTES = 1 << 30
CONVOLUTIONS = (nn.Conv2d, nn.ConvTranspose2d)
# RMS of a filter's weights before a batch norm, about as long training leaves them. The norm makes the output
# independent of this scale, but the scale decides how much one optimiser step changes the direction of the weights.
WEIGHT_SCALE = 0.06
LIT_PIXELS = 100_000  # to fit which lights reach a pixel
LIT_DECAY = 1e-5


@dataclass(frozen=True)
class Exported:
    """A network's ONNX file."""

    path: str
    """The file."""
    record: dict[str, Any]
    """How the network was trained."""
    filters: list[tuple[NDArray[Any], NDArray[Any] | None]]
    """Weights, and biases or None, of its convolutions in execution order."""

    @property
    def step(self) -> int:
        """Number of steps it was trained for."""
        return int(self.record["steps"])


def read_exported(path: AnyPath) -> Exported:
    """Read an exported network. Raises InputError if it is missing, damaged, or not by :func:`export_onnx`."""
    path = existing_file(path, "model")
    refusal = f"model {path} is damaged or was not trained here; resume from another"
    if path.stat().st_size > MAX_BYTES:
        raise FormatError(refusal)
    try:
        model = onnx.load(str(path), load_external_data=False)
        record = json.loads({entry.key: entry.value for entry in model.metadata_props}[TRAINING_KEY])
        values = {entry.name: numpy_helper.to_array(entry) for entry in model.graph.initializer}
        filters = _filters(model.graph, values)
        exported = Exported(str(path), record, filters)
        if exported.step < 0 or not isinstance(record["minutes"], int | float):
            raise ValueError
    except (DecodeError, onnx.checker.ValidationError, LookupError, RecursionError, TypeError, ValueError):
        raise FormatError(refusal) from None
    return exported


def _filters(graph: onnx.GraphProto, values: dict[str, NDArray[Any]]) -> list[tuple[NDArray[Any], NDArray[Any] | None]]:
    """Weights and biases in execution order. Those of the shipped MPS-Net are half floats, cast where
    they are used."""
    casts = [node.input[0] for node in graph.node if node.op_type == "Cast" and node.input[0] in values]
    if casts:
        return [(values[name].astype(np.float32), values[name.replace("weight", "bias")]) for name in casts]
    nodes = [node for node in graph.node if node.op_type in ("Conv", "ConvTranspose")]
    return [(values[node.input[1]], values[node.input[2]] if len(node.input) > 2 else None) for node in nodes]


@torch.no_grad()
def load_exported_weights(network: Network, exported: Exported, inputs: tuple[Tensor, ...]) -> None:
    """Copy the exported network's weights.

    Export folds each batch norm into the convolution before it. Here every batch norm takes its mean and variance from
    a batch of `inputs`, and its scale and shift undo them. The network's output is that of the exported one, and
    batch norm works as usual when training resumes. The weights before a batch norm are rescaled to one RMS: folding
    leaves some layers that change ten times as fast as others.

    Raises FormatError if the file is of a network with another architecture.
    """
    filters = iter(exported.filters)
    # Bias that the next batch norm must add, and scale that it must divide by, from the last convolution.
    bias: Tensor | None = None
    scale = torch.ones(())

    def before_convolution(layer: nn.Module, _: Any) -> None:
        nonlocal bias, scale
        weight, bias = (None if values is None else torch.from_numpy(values.copy()) for values in next(filters))
        assert isinstance(layer, CONVOLUTIONS) and weight is not None
        if weight.shape != layer.weight.shape or (layer.bias is not None and bias is None):
            raise ValueError
        if layer.bias is None and bias is not None:  # a batch norm was folded into it
            scale = (WEIGHT_SCALE / weight.square().mean(dim=(1, 2, 3)).sqrt().clamp(min=1e-6)).to(layer.weight.device)
            weight = weight.to(scale.device) * scale[:, None, None, None]
        layer.weight.copy_(weight)
        if layer.bias is not None and bias is not None:
            layer.bias.copy_(bias)

    def before_norm(layer: nn.Module, values: tuple[Tensor]) -> None:
        if bias is None:
            raise ValueError
        assert isinstance(layer, nn.BatchNorm2d) and layer.running_mean is not None and layer.running_var is not None
        variance, mean = torch.var_mean(values[0], dim=(0, 2, 3), correction=0)
        layer.running_mean.copy_(mean)
        layer.running_var.copy_(variance)
        layer.weight.copy_(torch.sqrt(variance + layer.eps) / scale)
        layer.bias.copy_(bias.to(mean.device) + mean / scale)

    hooks = []
    for layer in network.modules():
        if isinstance(layer, CONVOLUTIONS):
            hooks.append(layer.register_forward_pre_hook(before_convolution))
        elif isinstance(layer, nn.BatchNorm2d):
            hooks.append(layer.register_forward_pre_hook(before_norm))
    try:
        network.eval()
        network(*inputs)
        if next(filters, None) is not None:
            raise ValueError
    except (ValueError, RuntimeError, StopIteration):
        raise FormatError(f"model {exported.path} is not of the recipe's network; resume from another") from None
    finally:
        for hook in hooks:
            hook.remove()
        network.train()


def fit_lit_layer(network: Network, batch: Batch) -> None:
    """Fit the layer `lit`, if the network has one, to a batch: logistic regression of which lights reach a pixel.

    The layer is used in training only, so exported files lack it. From random weights it would need thousands of steps,
    and its gradients would disturb all other layers meanwhile.
    """
    layer = getattr(network, "lit", None)
    if layer is None or batch.lit is None:
        return
    seen: list[Tensor] = []
    hook = layer.register_forward_pre_hook(lambda _, values: seen.append(values[0].detach().float()))
    network.eval()
    network.training = True  # makes forward() run `lit`; the batch norms stay in evaluation mode
    with torch.no_grad():
        network(*batch.inputs)
    hook.remove()
    network.train()
    counted = batch.weights > 0
    maps, reach = (values.movedim(1, -1)[counted] for values in (seen[0], batch.lit))
    every = max(1, len(maps) // LIT_PIXELS)
    maps, reach = maps[::every], reach[::every]
    weight, bias = (values.detach().clone().requires_grad_() for values in (layer.weight.flatten(1), layer.bias))
    solver: Any = torch.optim.LBFGS([weight, bias], max_iter=200, line_search_fn="strong_wolfe")

    def loss() -> Tensor:
        solver.zero_grad()
        entropy = functional.binary_cross_entropy_with_logits(maps @ weight.T + bias, reach)
        total: Tensor = entropy + LIT_DECAY * weight.square().sum()  # stays finite if all lights reach everywhere
        torch.autograd.backward(total)
        return total

    solver.step(loss)
    with torch.no_grad():
        layer.weight.copy_(weight.reshape(layer.weight.shape))
        layer.bias.copy_(bias)
