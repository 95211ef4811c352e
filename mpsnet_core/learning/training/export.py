"""Export a trained network as an ONNX file with its card, if its outputs equal PyTorch's."""

import json
import platform
import time
import warnings
from dataclasses import replace
from io import BytesIO
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch
from torch import Tensor, nn

from mpsnet_core.errors import InputError, SettingsError
from mpsnet_core.estimate.card import CARD_KEY, TRAINING_KEY, ModelCard
from mpsnet_core.estimate.features import CONSTANTS, FEATURE_CHANNELS
from mpsnet_core.io.files import atomic_write, writable_path
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.learning.training.loop import Trained
from mpsnet_core.learning.training.networks import Network

onnxruntime.disable_telemetry_events()  # as in mpsnet_core/estimate/onnx_model.py

OPSET = 17
LICENCE = "GPL-3.0-or-later"
TOLERANCE = 1e-4
RIGHT_ANGLE = float(np.pi / 2)


def export_onnx(trained: Trained, path: AnyPath) -> None:
    """Write a network's ONNX file, with its card and training record.

    The file has opset 17, dynamic batch, height and width, and inferred shapes. Its outputs are "normals" and, if the
    network predicts its error e, "confidence", 1 - e / 90°. It is written only if the outputs of onnxruntime equal
    PyTorch's to 1e-4, on images of two sizes.

    Raises FileError if `path` cannot be written, SettingsError if weights are not finite, InputError if the outputs
    differ.
    """
    path = writable_path(path)
    for name, values in trained.network.state_dict().items():
        if not values.isfinite().all():
            raise SettingsError(f"weights of the network are not finite ({name}); train with a lower learning rate")
    network = trained.network.eval()
    model = onnx_of(network)
    model.metadata_props.add(key=CARD_KEY, value=card_of(network, trained.recipe.name).to_json())
    model.metadata_props.add(key=TRAINING_KEY, value=json.dumps(record_of(trained)))
    _check_equal_outputs(network, model)
    with atomic_write(path) as unfinished:
        unfinished.write_bytes(model.SerializeToString())


def card_of(network: Network, name: str) -> ModelCard:
    """The card of a network called `name`."""
    card = ModelCard(name, type(network).__name__, LICENCE, network.kind, network.inputs)
    if network.kind == "patch":
        return replace(card, patch=network.patch)
    facts = {name: getattr(network, name) for name in ("halo", "multiple", "frame", "magnified")}
    return replace(card, **facts)


def record_of(trained: Trained) -> dict[str, Any]:
    """Training record of a model, as plain data: recipe, date, time, hardware, versions, metrics."""
    metrics, before = trained.metrics, trained.continues or {}
    return {
        "recipe": trained.recipe.to_json(),
        "steps": trained.step,
        "samples": trained.samples,
        "samples_fingerprint": trained.fingerprint,
        "date": time.strftime("%Y-%m-%d"),
        "minutes": round(trained.seconds / 60 + before.get("minutes", 0.0), 1),
        "hardware": trained.hardware,
        "precision": trained.precision,
        "torch": torch.__version__,
        "python": platform.python_version(),
        "validation_mae_deg": metrics and round(metrics.mae_deg, 3),
        "validation_rank_correlation": metrics and metrics.rank_correlation and round(metrics.rank_correlation, 3),
        "continues": trained.continues,
    }


class _ExportedNetwork(nn.Module):
    """A network with the outputs of its card."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self.network = network
        self.eval()  # the exporter restores the mode it finds

    def forward(self, *inputs: Tensor) -> Tensor | tuple[Tensor, Tensor]:
        prediction = self.network.forward(*inputs)  # not a call, which would prefix the layers' names
        if prediction.expected_error is None:
            return prediction.normals
        return prediction.normals, (1 - prediction.expected_error / RIGHT_ANGLE).clamp(0, 1)


def onnx_of(network: Network) -> onnx.ModelProto:
    """The network's graph, without metadata."""
    answer = _ExportedNetwork(network)
    inputs = _examples(network, 2, network.patch if network.kind == "patch" else 64)
    outputs = ["normals", "confidence"] if isinstance(answer(*inputs), tuple) else ["normals"]
    size = {} if network.kind == "patch" else {2: "height", 3: "width"}
    axes = {name: {0: "batch", **({} if given[0] in CONSTANTS else size)} for name, given in network.inputs.items()}
    axes |= {name: {0: "batch", **size} for name in outputs}
    content = BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings about the exporter itself
        torch.onnx.export(
            answer,
            inputs,
            content,  # type: ignore[arg-type]  # without dynamo, it may be a file in memory
            input_names=list(network.inputs),
            output_names=outputs,
            dynamic_axes=axes,
            opset_version=OPSET,
            dynamo=False,
        )
    return onnx.shape_inference.infer_shapes(onnx.load_from_string(content.getvalue()), strict_mode=True)


def _check_equal_outputs(network: Network, model: onnx.ModelProto) -> None:
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    sides = (network.patch,) if network.kind == "patch" else (64, 96)
    for side in sides:
        inputs = _examples(network, 3, side)
        with torch.no_grad():
            expected = _ExportedNetwork(network)(*inputs)
        expected = expected if isinstance(expected, tuple) else (expected,)
        found = session.run(None, {name: values.numpy() for name, values in zip(network.inputs, inputs, strict=True)})
        for ours, theirs in zip(expected, found, strict=True):
            difference = float(np.abs(ours.numpy() - theirs).max())
            if not difference <= TOLERANCE:
                raise InputError(f"the exported model differs from the trained by {difference:.2g}; export elsewhere")


def _examples(network: Network, count: int, side: int) -> tuple[Tensor, ...]:
    """Inputs with plausible values: images not below 0, directions of unit length."""
    generator = torch.Generator().manual_seed(side)
    examples = []
    for features in network.inputs.values():
        channels = sum(FEATURE_CHANNELS[name] for name in features)
        size = 1 if features[0] in CONSTANTS else side
        values = torch.rand((count, channels, size, size), generator=generator)
        if features[0] == "lights":
            directions = nn.functional.normalize((values[:, :9] - 0.5).view(count, 3, 3), dim=2)
            values = torch.cat([directions.reshape(count, 9, 1, 1), values[:, 9:]], dim=1)
        examples.append(values)
    return tuple(examples)
