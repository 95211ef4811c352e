"""Check the operators in an ONNX file before onnxruntime opens it.

onnxruntime runs whatever a file contains and cannot be interrupted: an endless `Loop` would block its thread forever.
Only the operators of feed-forward convolutional networks are allowed.
"""

import mmap
from collections.abc import Iterator
from pathlib import Path

from mpsnet_core.errors import FormatError

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
                raise FormatError(
                    f"model file {path} has {refused}, which feed-forward convolutional networks do not need; "
                    "export it without"
                )
        except (IndexError, UnicodeDecodeError):
            raise FormatError(
                f"model file {path} is not an ONNX model that can be run (it is damaged); export it again"
            ) from None


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
