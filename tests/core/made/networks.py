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
# What the default network sees.
ALL = {"pixels": ("photo", "mask", "previous"), "rig": ("lights", "channel_means", "given")}


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


def sees_all(path: Path, **facts: Any) -> Path:
    """Random weights, pooled once; it sees everything that the default network sees. facts: of its card."""
    weights = random_weights(7, a=(8, 8, 5, 5), l=(8, 14, 1, 1), b=(8, 8, 3, 3), c=(3, 8, 3, 3), d=(1, 8, 1, 1))
    weights |= {"s": np.float32([1, 1, 2, 2]), "tilted": np.float32([[[[0]], [[0]], [[4]]]])}
    nodes = [
        conv("pixels", "p", "a", pads=[2] * 4),
        conv("rig", "q", "l"),
        helper.make_node("Add", ["p", "q"], ["h"]),
        helper.make_node("Tanh", ["h"], ["t"]),
        helper.make_node("AveragePool", ["t"], ["u"], kernel_shape=[2, 2], strides=[2, 2]),
        conv("u", "v", "b", pads=[1] * 4),
        helper.make_node("Resize", ["v", "", "s"], ["w"], mode="linear", coordinate_transformation_mode="half_pixel"),
        helper.make_node("Add", ["t", "w"], ["r"]),
        conv("r", "n", "c", pads=[1] * 4),
        helper.make_node("Add", ["n", "tilted"], ["normals"]),
        conv("r", "e", "d"),
        helper.make_node("Sigmoid", ["e"], ["confidence"]),
    ]
    return write_model(
        path,
        nodes,
        weights,
        card(**{"kind": "pyramid", "inputs": ALL, "halo": 8, "multiple": 2, "frame": "canonical", **facts}),
        inputs={"pixels": ("n", 8, "h", "w"), "rig": ("n", 14, 1, 1)},
        outputs={"normals": ("n", 3, "h", "w"), "confidence": ("n", 1, "h", "w")},
    )


def hands_on(path: Path, **facts: Any) -> Path:
    """A pyramid that says what equation 2 says on the first scale, and after it what it said on the scale before.

    It is 45° off on the first scale by its own account. facts: of its card.
    """
    nodes = [
        helper.make_node("Split", ["pixels", "parts"], ["initial", "before", "error"], axis=1),
        helper.make_node("Split", ["given", "ones"], ["there", "white"], axis=1),
        helper.make_node("Sub", ["before", "initial"], ["change"]),
        helper.make_node("Mul", ["change", "there"], ["changed"]),
        helper.make_node("Add", ["initial", "changed"], ["normals"]),
        helper.make_node("Mul", ["error", "share"], ["doubt"]),
        helper.make_node("Sub", ["half", "doubt"], ["more"]),
        helper.make_node("Mul", ["more", "there"], ["told"]),
        helper.make_node("Add", ["half", "told"], ["confidence"]),
    ]
    weights = {
        "parts": np.int64([3, 3, 1]),
        "ones": np.int64([1, 1]),
        "share": np.float32(2 / np.pi),
        "half": np.float32(0.5),
    }
    seen = {"pixels": ("initial_normals", "previous"), "given": ("given",)}
    return write_model(
        path,
        nodes,
        weights,
        card(**{"kind": "pyramid", "inputs": seen, "frame": "canonical", **facts}),
        inputs={"pixels": ("n", 7, "h", "w"), "given": ("n", 2, 1, 1)},
        outputs={"normals": ("n", 3, "h", "w"), "confidence": ("n", 1, "h", "w")},
    )


def random_weights(seed: int, **shapes: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Normal numbers, scaled so that signals neither grow nor fade."""
    random = np.random.default_rng(seed)
    return {
        name: (random.standard_normal(shape) * (2 / np.prod(shape[1:])) ** 0.5).astype(np.float32)
        for name, shape in shapes.items()
    }
