"""Quantisation of a dense model or a pyramid to 8 bits (int8), calibrated on photographs of samples.

8-bit convolutions are two to three times as fast on processors with instructions for them, and the file is about a
third of the size. Everything between the first convolutions, which see the image, and the last one is quantised. The
values of first and last convolutions are directions; they stay in single precision, as does everything that depends on
the lights only: 256 levels are too coarse for both.
"""

import io
import json
import logging
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray
from onnxruntime.quantization import CalibrationMethod, QuantFormat, QuantType, quantize_static
from torch import Tensor

from mpsnet_core.errors import FormatError
from mpsnet_core.estimate.card import CARD_KEY, TRAINING_KEY, ModelCard, record_from_metadata
from mpsnet_core.estimate.features import CONSTANTS
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.io.files import atomic_write, temporary_folder, writable_path
from mpsnet_core.learning.training.export import RIGHT_ANGLE
from mpsnet_core.learning.training.inputs import inputs_with_previous_scale
from mpsnet_core.learning.training.networks import Prediction
from mpsnet_core.learning.training.packed import PackedSamples
from mpsnet_core.learning.training.photo_simulation import PhotoSimulator, Scale
from mpsnet_core.learning.training.validation import validation_errors
from mpsnet_core.progress import Progress, part, silent

QUANTISED = ("Add", "Concat", "Conv", "DepthToSpace", "Relu")
CROP = 128
PERCENTILE = 99.99  # of the values, to be covered by the 8-bit range
SEED = 2  # of the photographs
# Tells onnxruntime that shapes are inferred already.
PREPARED = {"onnx.quant.pre_process": "onnxruntime.quant"}


class QuantizationErrors(NamedTuple):
    """Mean angular errors in degrees of a model and of its int8 version, on the same photographs."""

    model_mae_deg: float
    mae_deg: float


def quantise(
    model: str | os.PathLike[str],
    samples: Sequence[Path],
    output: str | os.PathLike[str],
    *,
    count: int = 64,
    progress: Progress = silent,
) -> QuantizationErrors:
    """Write the int8 version of a model (QDQ, per-channel weights), with "-int8" added to its name, and its record.

    model: an MPS-Net ONNX file of a dense network or a pyramid. samples: folders of samples like those it was trained
    on. count: number of their photographs to calibrate on, and number of others to measure the error on.

    Weights have 7 bits. With 8, 16-bit sums overflow on processors without VNNI instructions, and the output would
    depend on the processor.

    Raises InputError if the model is unusable, patch-wise or quantised already, the samples are unusable, or `output`
    cannot be written. Raises Cancelled if `progress` does.
    """
    output = writable_path(output)
    source = OnnxModel(model)
    card = source.card
    if card.kind == "patch":
        raise FormatError(f"model file {source.path} works patch by patch; only those that do not have int8 versions")
    try:
        graph = onnx.load(str(source.path))
    except onnx.checker.ValidationError as error:
        raise FormatError(
            f"model file {source.path} keeps weights in another file ({error}); give one that holds them all"
        ) from None
    if any(node.op_type == "QuantizeLinear" for node in graph.graph.node):
        raise FormatError(
            f"model file {source.path} is quantized to int8 already; give the model that it was made from"
        )
    inner = _inner_nodes(graph, card)
    if not inner:
        raise FormatError(f"model file {source.path} has no layer between its first and its last; leave it as it is")
    packed = PackedSamples(samples, skip_damaged=True)
    simulator = PhotoSimulator.of(card, packed, seed=SEED, window=-(-CROP // card.multiple) * card.multiple)
    source_model = _SessionModel(source.session, card)
    quantised = _quantised(graph, inner, _CalibrationInputs(simulator, source_model, count, part(progress, 0, 0.5)))
    session = onnxruntime.InferenceSession(quantised.SerializeToString(), providers=["CPUExecutionProvider"])
    first = -(-count // len(packed)) * len(packed)  # start of the epoch after those used for calibration
    errors = _errors([source_model, _SessionModel(session, card)], simulator, first, count, part(progress, 0.5, 1))
    figures = QuantizationErrors(*errors)
    record = record_from_metadata({entry.key: entry.value for entry in graph.metadata_props})
    record["int8"] = {"of": card.name, "photographs": count, "mae_deg": round(figures.mae_deg, 3)}
    record["int8"]["mae_deg_of_model"] = round(figures.model_mae_deg, 3)
    int8_card = replace(card, name=f"{card.name}-int8")
    del quantised.metadata_props[:]
    onnx.helper.set_model_props(quantised, {CARD_KEY: int8_card.to_json(), TRAINING_KEY: json.dumps(record)})
    with atomic_write(output) as unfinished:
        unfinished.write_bytes(quantised.SerializeToString())
    return figures


class _SessionModel:
    """Runs a model on inputs in the order of its card."""

    def __init__(self, session: Any, card: ModelCard) -> None:
        self.session, self.inputs = session, card.inputs
        self.outputs = [output.name for output in session.get_outputs()]

    def named(self, inputs: Sequence[Tensor]) -> dict[str, NDArray[np.float32]]:
        return {name: values.numpy() for name, values in zip(self.inputs, inputs, strict=True)}

    def __call__(self, *inputs: Tensor) -> Prediction:
        outputs = dict(
            zip(self.outputs, map(torch.from_numpy, self.session.run(None, self.named(inputs))), strict=True)
        )
        confidence = outputs.get("confidence")
        return Prediction(outputs["normals"], None if confidence is None else (1 - confidence) * RIGHT_ANGLE)


class _CalibrationInputs:
    """A model's inputs for `count` photographs, scale by scale, as onnxruntime reads calibration data."""

    def __init__(self, simulator: PhotoSimulator, model: _SessionModel, count: int, progress: Progress) -> None:
        self.inputs = (
            model.named(seen)
            for scales in _photographs(simulator, 0, count, progress)
            for seen in inputs_with_previous_scale(model, model.inputs, scales)
        )

    def get_next(self) -> dict[str, NDArray[np.float32]] | None:
        return next(self.inputs, None)


def _photographs(simulator: PhotoSimulator, first: int, count: int, progress: Progress) -> Iterator[list[Scale]]:
    for number in range(count):
        progress(number / count, f"photograph {number + 1} of {count}")
        yield simulator.batch(first + number, 1)


def _quantised(graph: onnx.ModelProto, nodes: list[str], photographs: _CalibrationInputs) -> onnx.ModelProto:
    prepared = onnx.ModelProto()
    prepared.CopyFrom(graph)
    onnx.helper.set_model_props(prepared, PREPARED)
    with temporary_folder() as folder, _quiet_root(), redirect_stdout(io.StringIO()):
        file = folder / "int8.onnx"
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
            # Covering a few outliers would make the quantisation steps of all other values too coarse.
            calibrate_method=CalibrationMethod.Percentile,
            extra_options={"CalibPercentile": PERCENTILE},
            weight_type=QuantType.QInt8,
        )
        return onnx.load(str(file))


@contextmanager
def _quiet_root() -> Iterator[None]:
    """Silence the root logger, where onnxruntime warns about models: we measure the error instead."""
    log, silence = logging.getLogger(), logging.Filter("nobody")
    log.addFilter(silence)
    try:
        yield
    finally:
        log.removeFilter(silence)


def _inner_nodes(graph: onnx.ModelProto, card: ModelCard) -> list[str]:
    """Names of the convolutions between the first and the last, without those that depend on the lights only, and of
    the nodes of types :data:`QUANTISED` between them."""
    lights = {name for name, features in card.inputs.items() if features[0] in CONSTANTS}
    own = set(card.inputs) - lights  # values of the image, before any convolution
    behind: set[str] = set()  # values computed by a convolution over the image, or from one
    for node in graph.graph.node:
        seen = set(node.input)
        if (node.op_type == "Conv" and seen & own) or seen & behind:
            behind |= set(node.output)
        if node.op_type != "Conv" and seen & own:
            own |= set(node.output)
        elif seen & lights and not seen & (own | behind):
            lights |= set(node.output)
    ahead: set[str] = set()  # values that some convolution depends on
    inner_ahead: set[str] = set()  # values that some quantised convolution depends on
    inner = []
    for node in reversed(graph.graph.node):
        seen, convolution = set(node.input), node.op_type == "Conv"
        fits = node.op_type in QUANTISED and seen & behind and not seen & (own | lights)
        chosen = fits and bool((ahead if convolution else inner_ahead).intersection(node.output))
        if chosen:
            inner.append(node.name)
        if convolution or ahead.intersection(node.output):
            ahead |= seen
        if chosen or inner_ahead.intersection(node.output):
            inner_ahead |= seen
    return inner[::-1]


def _errors(
    models: Sequence[_SessionModel], simulator: PhotoSimulator, first: int, count: int, progress: Progress
) -> list[float]:
    """Mean angular error in degrees of each model, over all valid pixels of `count` photographs."""
    errors: list[list[NDArray[np.float32]]] = [[] for _ in models]
    for scales in _photographs(simulator, first, count, progress):
        for own, model in zip(errors, models, strict=True):
            own += [error for error, _ in validation_errors(model, model.inputs, scales)]
    return [float(np.concatenate(own).mean(dtype=np.float64)) for own in errors]
