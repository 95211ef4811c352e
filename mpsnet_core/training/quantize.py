"""Quantisation: the int8 twin of a dense model, calibrated on what the model sees of samples.

Convolutions in eight bits are two to three times as quick on processors that have instructions for them, and the file
is about a third of the size. Between the first convolution over the picture and the last all is in eight bits. Those
two, which see and say directions, stay in single precision, and so does whatever depends on the lights: 256 steps are
too coarse for both.
"""

import json
import logging
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx
import onnxruntime
from numpy.typing import NDArray
from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static

from mpsnet_core.errors import InputError
from mpsnet_core.estimate.card import CARD_KEY, TRAINING_KEY, ModelCard, record_from_metadata
from mpsnet_core.estimate.features import CONSTANTS
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.files import writable_path, written_whole
from mpsnet_core.normals import angular_error
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.synthesis.photographs.dataset import SampleDataset
from mpsnet_core.training.examples import Arrays, Examples

QUANTISED = ("Add", "Concat", "Conv", "DepthToSpace", "Relu")
CROP = 128
SEED = 2  # of the photographs
# Tells onnxruntime that shapes are inferred, as ours are.
PREPARED = {"onnx.quant.pre_process": "onnxruntime.quant"}


class Twin(NamedTuple):
    """card: the twin's. model_mae_deg, mae_deg: mean angular errors, in degrees, of the model that it was made from and
    of the twin, on the same photographs."""

    card: ModelCard
    model_mae_deg: float
    mae_deg: float


def quantise(
    model: str | os.PathLike[str],
    samples: Sequence[Path],
    output: str | os.PathLike[str],
    *,
    count: int = 64,
    progress: Progress = silent,
) -> Twin:
    """Write the int8 twin of a model (QDQ, weights by channel), named after it with "-int8"; its record goes along.

    model: an ONNX file of ours, of a dense network. samples: folders of samples such as it was trained on. count: how
    many photographs of them calibrate it, and how many others tell what it costs.

    Weights have seven bits: with eight, sums of 16 bits overflow on processors without VNNI instructions, and the
    answers would depend on the processor.

    Raises InputError where the model is none, works by patches or is in eight bits already, where the samples cannot be
    used, or where `output` cannot be written; Cancelled where `progress` does.
    """
    output = writable_path(output)
    if count < 1:
        raise InputError(f"{count} photographs cannot calibrate a model; choose 1 or more")
    source = OnnxModel(model)
    card = source.card
    if card.kind != "dense":
        raise InputError(f"model file {source.path} works patch by patch; only dense models have int8 twins")
    graph = onnx.load(str(source.path))
    if any(node.op_type == "QuantizeLinear" for node in graph.graph.node):
        raise InputError(f"model file {source.path} is in eight bits already; give the one that it was made from")
    inner = _inner_nodes(graph, card)
    if not inner:
        raise InputError(f"model file {source.path} has no layer between its first and its last; leave it as it is")
    dataset = SampleDataset(list(samples), seed=SEED, canonical=card.frame == "canonical")
    examples = Examples(dataset, dict(card.inputs), -(-CROP // card.multiple) * card.multiple)
    photographs = _Photographs(examples, list(card.inputs), count, part(progress, 0, 0.5))
    twin = _quantised(graph, inner, photographs)
    twin_card = ModelCard(**{**card.__dict__, "name": f"{card.name}-int8"})
    first = -(-count // len(examples)) * len(examples)  # of the epoch after those that calibrated
    errors = _errors(
        [source.session, onnxruntime.InferenceSession(twin.SerializeToString(), providers=["CPUExecutionProvider"])],
        _Photographs(examples, list(card.inputs), count, part(progress, 0.5, 1), first),
    )
    figures = Twin(twin_card, *errors)
    record = record_from_metadata({entry.key: entry.value for entry in graph.metadata_props})
    record["int8"] = {"of": card.name, "photographs": count, "mae_deg": round(figures.mae_deg, 3)}
    record["int8"]["mae_deg_of_model"] = round(figures.model_mae_deg, 3)
    del twin.metadata_props[:]
    onnx.helper.set_model_props(twin, {CARD_KEY: twin_card.to_json(), TRAINING_KEY: json.dumps(record)})
    with written_whole(output) as unfinished:
        unfinished.write_bytes(twin.SerializeToString())
    return figures


class _Photographs(CalibrationDataReader):
    """Examples `first` to `first` + `count` - 1, one at a time, as a model's inputs."""

    def __init__(self, examples: Examples, names: list[str], count: int, progress: Progress, first: int = 0) -> None:
        self.examples, self.names, self.count, self.progress, self.first = examples, names, count, progress, first
        self.given = 0

    def next_example(self) -> Arrays | None:
        if self.given == self.count:
            return None
        self.progress(self.given / self.count, f"photograph {self.given + 1} of {self.count}")
        self.given += 1
        return self.examples[self.first + self.given - 1]

    def inputs(self, example: Arrays) -> dict[str, NDArray[np.float32]]:
        return {name: values[None] for name, values in zip(self.names, example[0], strict=True)}

    def get_next(self) -> dict[str, NDArray[np.float32]] | None:
        example = self.next_example()
        return None if example is None else self.inputs(example)


def _quantised(graph: onnx.ModelProto, nodes: list[str], photographs: _Photographs) -> onnx.ModelProto:
    prepared = onnx.ModelProto()
    prepared.CopyFrom(graph)
    onnx.helper.set_model_props(prepared, PREPARED)
    with tempfile.TemporaryDirectory() as folder, _quiet_root():
        file = Path(folder) / "int8.onnx"
        quantize_static(
            prepared,
            file,
            photographs,
            quant_format=QuantFormat.QDQ,
            op_types_to_quantize=list(QUANTISED),
            nodes_to_quantize=nodes,
            per_channel=True,
            reduce_range=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
        )
        return onnx.load(str(file))


@contextmanager
def _quiet_root() -> Iterator[None]:
    """onnxruntime tells the root logger what it thinks of a model; what the measurement says counts."""
    log, silence = logging.getLogger(), logging.Filter("nobody")
    log.addFilter(silence)
    try:
        yield
    finally:
        log.removeFilter(silence)


def _inner_nodes(graph: onnx.ModelProto, card: ModelCard) -> list[str]:
    """Names of the nodes that lie between convolutions over the picture, and take nothing from the lights."""
    lights = {name for name, features in card.inputs.items() if features[0] in CONSTANTS}
    picture = set(card.inputs) - lights
    behind: set[str] = set()  # values that a convolution over the picture lies before
    for node in graph.graph.node:
        seen = set(node.input)
        if seen & picture:
            picture |= set(node.output)
            if node.op_type == "Conv" or seen & behind:
                behind |= set(node.output)
        elif seen & lights:
            lights |= set(node.output)
    ahead: set[str] = set()  # values that a convolution lies after
    inner = []
    for node in reversed(graph.graph.node):
        leads_on = bool(ahead.intersection(node.output))
        if leads_on or node.op_type == "Conv":
            ahead |= set(node.input)
        if leads_on and node.op_type in QUANTISED and behind.intersection(node.input) and not lights & set(node.input):
            inner.append(node.name)
    return inner[::-1]


def _errors(sessions: Sequence[Any], photographs: _Photographs) -> list[float]:
    """Of each model the mean angular error in degrees, over the pixels that count of all the photographs."""
    errors: list[list[NDArray[np.float64]]] = [[] for _ in sessions]
    while (example := photographs.next_example()) is not None:
        _, truth, counts = example
        for found, session in zip(errors, sessions, strict=True):
            (normals,) = session.run(["normals"], photographs.inputs(example))
            found.append(angular_error(np.moveaxis(normals[0], 0, -1), np.moveaxis(truth, 0, -1))[counts > 0])
    return [float(np.concatenate(found).mean()) for found in errors]
