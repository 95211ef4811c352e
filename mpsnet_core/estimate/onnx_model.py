"""Networks in ONNX files: open them, check them against their cards, run them."""

import atexit
import contextlib
import mmap
import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, wait
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import TypeVar

import numpy as np
import onnxruntime

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32
from mpsnet_core.capture.capture import Capture
from mpsnet_core.errors import FormatError, SettingsError, check_choice
from mpsnet_core.estimate.card import ModelCard, card_from_metadata, record_from_metadata
from mpsnet_core.estimate.dense import predict_dense, predict_patches
from mpsnet_core.estimate.distant_lights import convert_to_distant_view, rotate_to_camera_space
from mpsnet_core.estimate.features import CONSTANTS, channel_count
from mpsnet_core.estimate.registry import DEFAULT_TILE
from mpsnet_core.io.files import existing_file, prefix_errors
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.normal_map import NormalMap

# --- check the operators in an ONNX file before onnxruntime opens it --------------------------------------------------
# onnxruntime runs whatever a file contains and cannot be interrupted: an endless `Loop` would block its thread forever.
# Only the operators of feed-forward convolutional networks are allowed.


ALLOWED = frozenset(
    (
        *("Abs", "Acos", "Add", "And", "AveragePool", "BatchNormalization", "Cast", "Ceil", "Clip", "Concat"),
        *("Constant", "ConstantOfShape", "Conv", "ConvTranspose", "Cos", "DepthToSpace", "DequantizeLinear", "Div"),
        *("Dropout", "Elu", "Equal", "Erf", "Exp", "Expand", "Flatten", "Floor", "Gather", "Gemm"),
        *("GlobalAveragePool", "GlobalMaxPool", "Greater", "GreaterOrEqual", "HardSigmoid", "HardSwish", "Identity"),
        *("InstanceNormalization", "LayerNormalization", "LeakyRelu", "Less", "LessOrEqual", "Log", "MatMul", "Max"),
        *("MaxPool", "Mean", "Min", "Mul", "Neg", "Not", "Or", "PRelu", "Pad", "Pow", "QuantizeLinear", "Reciprocal"),
        *("ReduceL2", "ReduceMax", "ReduceMean", "ReduceMin", "ReduceSum", "Relu", "Reshape", "Resize", "Round"),
        *("Selu", "Shape", "Sigmoid", "Sign", "Sin", "Slice", "Softmax", "Softplus", "SpaceToDepth", "Split", "Sqrt"),
        *("Squeeze", "Sub", "Sum", "Tanh", "Transpose", "Unsqueeze", "Where"),
    )
)
# Field numbers in onnx.proto.
_MODEL_GRAPH, _MODEL_FUNCTION = 7, 25
_GRAPH_NODE, _GRAPH_TENSOR, _GRAPH_SPARSE = 1, 5, 15
_NODE_OPERATOR, _NODE_ATTRIBUTE, _NODE_DOMAIN = 4, 5, 7
_ATTRIBUTE_OF_TENSORS, _ATTRIBUTE_OF_GRAPHS, _ATTRIBUTE_OF_SPARSE = (5, 10), (6, 11), (22, 23)
_TENSOR_ELSEWHERE = 13


def check_operators(path: Path) -> None:
    """Raise FormatError if a file is not an ONNX model, or contains an operator or a part that is not allowed."""
    if not path.stat().st_size:
        return  # an empty file cannot be mapped; onnxruntime rejects it
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        try:
            for refused in _refused(content):
                raise FormatError(f"model file {path} has {refused}, which no network here needs; export it without")
        except (IndexError, UnicodeDecodeError):
            raise FormatError(f"model file {path} is damaged, or no ONNX model; export it again") from None


def _refused(content: mmap.mmap) -> Iterator[str]:
    """Names of the operators and parts that are not allowed."""
    for part, *span in _fields(content, 0, len(content)):
        if part == _MODEL_FUNCTION:
            yield "functions of its own"
        if part != _MODEL_GRAPH:
            continue
        for number, start, end in _fields(content, *span):
            if number == _GRAPH_SPARSE:
                yield "sparse weights"  # a few bytes unpack to any size
            if number == _GRAPH_TENSOR:
                yield from _refused_in_tensor(content, start, end)
            if number == _GRAPH_NODE:
                yield from _refused_in_node(content, start, end)


def _refused_in_node(content: mmap.mmap, start: int, end: int) -> Iterator[str]:
    for number, *span in _fields(content, start, end):
        value = slice(*span)
        if number == _NODE_OPERATOR and (operator := content[value].decode()) not in ALLOWED:
            yield f'the operator "{operator[:99]}"'
        if number == _NODE_DOMAIN and (domain := content[value].decode()) not in ("", "ai.onnx"):
            yield f'operators of "{domain[:99]}"'
        if number == _NODE_ATTRIBUTE:
            for kind, *inner in _fields(content, *span):
                if kind in _ATTRIBUTE_OF_TENSORS:
                    yield from _refused_in_tensor(content, *inner)
                if kind in _ATTRIBUTE_OF_GRAPHS:
                    yield "a graph within a graph"
                if kind in _ATTRIBUTE_OF_SPARSE:
                    yield "sparse weights"


def _refused_in_tensor(content: mmap.mmap, start: int, end: int) -> Iterator[str]:
    # Old versions of onnxruntime read weights from any file of the user's that the model names.
    if any(number == _TENSOR_ELSEWHERE for number, *_ in _fields(content, start, end)):
        yield "weights in another file"


def _fields(content: mmap.mmap, at: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Number, start and end of each length-delimited field of a protobuf message. IndexError if it is damaged."""
    while at < end:
        key, at = _varint(content, at)
        number, kind = (key & 0xFFFFFFFF) >> 3, key & 7  # as onnxruntime reads it
        if kind == 0:
            _, at = _varint(content, at)
        elif kind == 2:
            length, at = _varint(content, at)
            if at + length > end:
                raise IndexError
            yield number, at, at + length
            at += length
        elif kind in (1, 5):
            at += 8 if kind == 1 else 4
        else:  # groups, which ONNX does not have
            raise IndexError


def _varint(content: mmap.mmap, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        byte = content[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value & ((1 << 64) - 1), at
    raise IndexError


T = TypeVar("T")

# On Windows the variable that mpsnet_core/__init__.py sets has no effect.
onnxruntime.disable_telemetry_events()

PROVIDERS = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "directml": "DmlExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
}
MAX_MODEL_BYTES = 2 << 30
MAX_THREADS = 1024
# Longer normals, and confidences beyond, overflow where they are squared.
MAX_OUTPUT = 1e15
EXIT_CANCELLED = 130
# How long an interrupted run may take to stop after the layer that it is in, before it is left behind.
STOP_SECONDS = 0.3


def _most_memory() -> int:
    """Memory limit of running networks in bytes: half of the machine's, at most 16 GiB."""
    try:
        machine = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError):  # Windows, which does not overcommit memory
        machine = 32 << 30
    return min(16 << 30, machine // 2)


MAX_ARENA_BYTES = _most_memory()


class OnnxModel:
    """A network from an ONNX file, with its card. Options as in :class:`mpsnet_core.estimate.estimator.Estimator`.

    passes: replaces the number on the card of networks in the canonical frame.

    Raises FileError if the file is missing, FormatError if it is not an MPS-Net model or its inputs do not match its
    card, SettingsError if an option is out of range or the provider is not available.
    """

    def __init__(
        self,
        path: AnyPath,
        *,
        provider: str = "cpu",
        threads: int = 0,
        tile: int = DEFAULT_TILE,
        passes: int | None = None,
    ) -> None:
        self.path = existing_file(path, "model file")
        if self.path.stat().st_size > MAX_MODEL_BYTES:
            raise FormatError(f"model file {self.path} is larger than 2 GiB, the limit for networks; check the path")
        if tile < 64:
            raise SettingsError(f"a tile of {tile} pixels is too small; use 64 or more")
        if not 0 <= threads <= MAX_THREADS or threads != int(threads):
            raise SettingsError(f"{threads} threads is out of range; use 0 for all cores, or 1 to {MAX_THREADS}")
        self.tile = tile
        check_operators(self.path)
        self.session = open_session(self.path, provider, threads)
        with prefix_errors(f"model file {self.path} cannot be used"):
            metadata = _metadata(self.session)
            self.card = card_from_metadata(metadata)
            if passes is not None:
                self.card = replace(self.card, passes=passes)
            _check_fit(self.session, self.card)
        self.record = record_from_metadata(metadata)
        self._outputs = [node.name for node in self.session.get_outputs()]

    def __call__(
        self, capture: Capture, progress: Progress = silent, *, passes: int | None = None, rough: bool = False
    ) -> NormalMap:
        """Normals of `capture` in camera space. Confidence is 1 inside the mask unless the network outputs it.

        passes: replaces the number on the card of dense networks. rough: as in
        :func:`mpsnet_core.estimate.dense.predict_dense`.
        """
        card = self.card if passes is None else replace(self.card, passes=passes)
        seen = convert_to_distant_view(capture)
        if self.card.kind != "patch":
            answer = predict_dense(self._run, card, seen, self.tile, progress, rough=rough)
        else:
            answer = predict_patches(self._run, self.card, seen, progress)
        if not any(answer[rows, :, :3].any() for rows in bands(len(answer))):
            raise FormatError(f"model file {self.path} returned no normals, only zeros; train or export it again")
        rotate_to_camera_space(answer[..., :3], capture.camera)
        self._release_memory()
        progress(1.0, "normals estimated")
        return NormalMap(answer[..., :3], capture.mask, answer[..., 3], in_place=True)

    def _run(self, inputs: dict[str, F32], count: int, *size: int) -> tuple[F32, F32]:
        """The network's normals (count, 3, *size) and confidence (count, 1, *size); all 1 if it outputs none."""
        try:
            outputs = dict(zip(self._outputs, run_session(self.session, inputs), strict=True))
        except _RUNTIME_ERRORS as error:
            shapes = ", ".join(f"{name} {value.shape}" for name, value in inputs.items())
            if "memory" in str(error):
                raise FormatError(
                    f"model file {self.path} failed on {shapes}: it needs more memory than there is, or than "
                    f"{MAX_ARENA_BYTES / (1 << 30):.3g} GiB; use smaller tiles"
                ) from None
            reason = " ".join(str(error).split())[:200]
            raise FormatError(
                f"model file {self.path} failed on {shapes}: {reason}; export it with dynamic sizes"
            ) from None
        if not all((np.abs(outputs[name]) < MAX_OUTPUT).all() for name in ("normals", "confidence") if name in outputs):
            raise FormatError(f"model file {self.path} returned values that are not finite; train or export it again")
        normals = self._shaped("normals", outputs, (count, 3, *size))
        if "confidence" not in outputs:
            return normals, np.ones((count, 1, *size), np.float32)
        return normals, self._shaped("confidence", outputs, (count, 1, *size))

    def _release_memory(self) -> None:
        """Free the memory that onnxruntime reserved for large tiles. It does so only in a run, so run a tiny input."""
        side = self.card.patch if self.card.kind == "patch" else self.card.multiple
        least = {}
        for name, features in self.card.inputs.items():
            size = 1 if CONSTANTS.intersection(features) else side
            least[name] = np.zeros((1, channel_count(features), size, size), np.float32)
        shrinking = onnxruntime.RunOptions()
        shrinking.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
        with contextlib.suppress(*_RUNTIME_ERRORS):  # other people's networks may refuse so small an input
            run_session(self.session, least, shrinking)

    def _shaped(self, name: str, outputs: dict[str, F32], expected: tuple[int, ...]) -> F32:
        """An output in the expected shape. Axes of length one may differ."""
        shape = outputs[name].shape
        if [length for length in shape if length > 1] != [length for length in expected if length > 1]:
            raise FormatError(f'model file {self.path} cannot be used: "{name}" is {shape}, expected {expected}')
        return outputs[name].reshape(expected)


def run_session(
    session: onnxruntime.InferenceSession, inputs: dict[str, F32], options: onnxruntime.RunOptions | None = None
) -> list[F32]:
    """Run a network. If a signal raises an exception meanwhile, the network stops after its present layer."""
    options = options or onnxruntime.RunOptions()
    return _in_a_thread(lambda: session.run(None, inputs, options), stop=lambda: setattr(options, "terminate", True))


def _in_a_thread(work: Callable[[], T], stop: Callable[[], None] = lambda: None) -> T:
    """The result of `work`, which is done in a thread, so that this one hears signals.

    A few bytes in a file can make one call of onnxruntime take minutes. stop: asks `work` to stop after a signal. If it
    does not within a moment, it is left behind, and ends with the process.
    """
    outcome = Future[T]()

    def report() -> None:
        try:
            outcome.set_result(work())
        except BaseException as error:  # noqa: BLE001 - raised again in the other thread
            outcome.set_exception(error)

    thread = threading.Thread(target=report, daemon=True)
    try:
        thread.start()  # a signal may come while it waits for the thread
        while thread.is_alive():
            thread.join(1)  # without a limit, Windows hears no signals
    except RuntimeError:  # no more threads can be started
        raise
    except BaseException:
        stop()
        wait([outcome], STOP_SECONDS)
        # The libraries cannot be unloaded under it: the process would abort.
        atexit.register(lambda: None if outcome.done() else os._exit(EXIT_CANCELLED))
        raise
    return outcome.result()


_OF_RUNTIME = vars(onnxruntime.capi.onnxruntime_pybind11_state).values()
_KINDS = [kind for kind in _OF_RUNTIME if isinstance(kind, type) and issubclass(kind, Exception)]
_RUNTIME_ERRORS: tuple[type[Exception], ...] = (RuntimeError, ValueError, *_KINDS)


def open_session(path: Path, provider: str, threads: int) -> onnxruntime.InferenceSession:
    check_choice("provider", provider, PROVIDERS)
    present = onnxruntime.get_available_providers()
    if PROVIDERS[provider] not in present:
        usable = ", ".join(name for name, full in PROVIDERS.items() if full in present)
        raise SettingsError(f"provider {provider!r} is not in this onnxruntime; choose {usable} or install one with it")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
    options.enable_mem_pattern = False  # takes 50% more memory for one size only, and is no faster
    # Spinning threads would take cores from the reading and writing of other frames; without it a still is as fast.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.add_session_config_entry("session.load_model_format", "ONNX")  # whatever the file's suffix
    _limit_memory()
    options.add_session_config_entry("session.use_env_allocators", "1")
    options.log_severity_level = 4  # errors are reported in our own sentence
    try:
        # With fallback, a failure prints to stdout and tries the CPU again, which is useless if the CPU just failed.
        fallback = int(provider != "cpu")
        names = [PROVIDERS[provider]]
        opened = partial(onnxruntime.InferenceSession, str(path), options, providers=names, enable_fallback=fallback)
        return _in_a_thread(opened)  # which computes what is constant
    except _RUNTIME_ERRORS as error:
        reason = " ".join(str(error).split())[:200]
        raise FormatError(f"model file {path} is no ONNX model that can be run ({reason}); export it again") from None


@cache
def _limit_memory() -> None:
    """Limit the memory of all sessions of this process: a few bytes in a file can request tensors of any size."""
    memory = onnxruntime.OrtMemoryInfo(
        "Cpu", onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, onnxruntime.OrtMemType.DEFAULT
    )
    limit = onnxruntime.OrtArenaCfg({"max_mem": MAX_ARENA_BYTES})
    with contextlib.suppress(*_RUNTIME_ERRORS):  # another library in this process registered an allocator
        onnxruntime.create_and_register_allocator(memory, limit)


def _metadata(session: onnxruntime.InferenceSession) -> dict[str, str]:
    try:
        return dict(session.get_modelmeta().custom_metadata_map)
    except UnicodeDecodeError:
        raise FormatError("its metadata are not UTF-8 text; export it again") from None


def _check_fit(session: onnxruntime.InferenceSession, card: ModelCard) -> None:
    nodes, patches = {node.name: node for node in session.get_inputs()}, card.kind == "patch"
    if set(nodes) != set(card.inputs):
        raise FormatError(f"it has inputs {sorted(nodes)}, its card describes {sorted(card.inputs)}")
    for name, node in nodes.items():
        side: int | str = 1 if CONSTANTS.intersection(card.inputs[name]) else card.patch if patches else "any"
        expected = ["any", channel_count(card.inputs[name]), side, side]
        shape = ["any" if not isinstance(size, int) else size for size in node.shape]
        # Dense networks run on one tile at a time, so a batch fixed at 1 is harmless.
        fits = len(shape) == 4 and shape[0] in (("any",) if patches else ("any", 1)) and shape[1] == expected[1]
        if node.type != "tensor(float)" or not fits or not {*shape[2:]} <= {side, "any"}:
            raise FormatError(f"input {name!r} is {node.type} {shape}, not tensor(float) {expected}; export it so")
    if "normals" not in [node.name for node in session.get_outputs()]:
        raise FormatError('it has no output called "normals"')
