"""Small networks whose answer is known, built node by node with onnx."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from mpsnet_core.estimate.card import CARD_KEY, ModelCard

Shape = Sequence[int | str]
DENSE: Shape = ("n", 3, "h", "w")


def card(**changes: Any) -> ModelCard:
    """A card of a dense network that sees the initial normals."""
    facts = {"name": "test", "network": "test", "licence": "CC0-1.0", "kind": "dense"}
    return ModelCard(**{**facts, "inputs": {"x": ("initial_normals",)}, **changes})


def write_model(
    path: Path,
    nodes: Sequence[onnx.NodeProto],
    weights: Mapping[str, np.ndarray],
    model_card: ModelCard | Mapping[str, Any] | str | None,
    *,
    inputs: Mapping[str, Shape] | None = None,
    outputs: Mapping[str, Shape] | None = None,
    input_type: int = TensorProto.FLOAT,
) -> Path:
    """Write an ONNX file. The card may be a ModelCard, a dict or text that need not be a valid one, or missing."""

    def values(shapes: Mapping[str, Shape], kind: int) -> list[onnx.ValueInfoProto]:
        return [helper.make_tensor_value_info(name, kind, shape) for name, shape in shapes.items()]

    graph = helper.make_graph(
        list(nodes),
        "test",
        values(inputs or {"x": DENSE}, input_type),
        values(outputs or {"normals": ("n", 3, None, None)}, TensorProto.FLOAT),
        [numpy_helper.from_array(np.asarray(value), name) for name, value in weights.items()],
    )
    # Versions that every onnxruntime we allow can read.
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if model_card is not None:
        text = model_card.to_json() if isinstance(model_card, ModelCard) else model_card
        helper.set_model_props(model, {CARD_KEY: text if isinstance(text, str) else json.dumps(text)})
    onnx.save(model, str(path))
    return path


def conv(source: str, target: str, weight: str, **attributes: Any) -> onnx.NodeProto:
    return helper.make_node("Conv", [source, weight], [target], **attributes)


def pass_through(path: Path, model_card: Any = None, **changes: Any) -> Path:
    """A 1x1 convolution by the identity: what comes in goes out."""
    identity = np.eye(3, dtype=np.float32)[..., None, None]
    return write_model(path, [conv("x", "normals", "w")], {"w": identity}, model_card or card(), **changes)


def random_weights(seed: int, **shapes: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Normal numbers, scaled so that signals neither grow nor fade."""
    random = np.random.default_rng(seed)
    return {
        name: (random.standard_normal(shape) * (2 / np.prod(shape[1:])) ** 0.5).astype(np.float32)
        for name, shape in shapes.items()
    }
