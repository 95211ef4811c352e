"""Strategies that spoil good files in every way a disk, an editor or a stranger might, and odd values for options."""

import copy
import json
import re
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import OpenImageIO as oiio
from hypothesis import strategies as st

from mpsnet_core.estimate.card import CARD_KEY

DEEP: Any = [0]
for _ in range(300):
    DEEP = [DEEP]

CONTROL = "a\x1b[31m\x07\rb‮c\udcff"
# What a number in a file or an option may be instead.
NUMBERS = [0, 1, -1, 2, 7, 0.5, -0.0, 1e-308, 1e-300, 1e-12, 1e9, 1e18, 1e38, 1e300, 10**18, 10**400, 2**31, 2**63]
NOT_FINITE = [float("nan"), float("inf"), float("-inf")]
TEXTS = [
    *("", " ", "x" * 100_000, CONTROL, "a\nb", "..", "/", "nan", "-1/-4", "%s{}", "ä" * 300, "1" * 5000, "1,2,3", "--")
]
VALUES: list[Any] = [
    *(*NUMBERS, *NOT_FINITE, *TEXTS, "\ud800.png", None, True, [], {}, [[]], [1, 2, 3], [[1, 0], [0, 1]], DEEP)
]
# Of options: sizes and counts that are valid are small, so that no case takes long.
WORDS = [
    *(str(value) for value in [0, 1, -1, 2, 3, 0.5, 7, -0.0, *NOT_FINITE, 1e300, -1e300, 1e-300, 10**400, "1_0", "٣"]),
    *(text for text in TEXTS if text),
    *("0,0,1", "45,135", "1e300,1,1", "1,1,1e300", "0,0,0", "nan,nan", "1,2,3,4", "1,1,2,2=5", "0,0,4,4", "1,2"),
    *("0,0,0,0=1", "1,1,2,2=nan", "0,0,1e300,1=1", "threshold:nan", "threshold:1e300", "background:", "alpha", "auto"),
    *("none", "on", "off", "push-pull", "object", "directx", "linear", "srgb", "exr", "tif", "png", "all", "yes"),
    *("=", "a.json=", "####", "*", "<UDIM>", "<OBJECT>.png", "\udcf6.png", "o.exr", "o.png", "o.tif", "o.ply", "o.glb"),
    *("o.obj", "o.json", "o.html", "o.lp", "o.onnx", "o.npz", "o.txt", "o", "o/o.png", "\udcf6", "\udcf6/o.png"),
    *("x" * 300 + ".png", "a\x1b[2J.png", "loop", "loop/o.png", "empty", ".", "a=b"),
]


@st.composite
def spoilt(draw: st.DrawFn, file: Path) -> bytes:
    """The bytes of `file` with a few of them changed, or with an odd value in a place that its format has for one."""
    data = file.read_bytes()
    ways = [_bytes_changed, _bytes_changed, *(way for suffixes, way in _WAYS.items() if file.suffix in suffixes)]
    return draw(draw(st.sampled_from(ways))(data))


@st.composite
def _bytes_changed(draw: st.DrawFn, data: bytes) -> bytes:
    for _ in range(draw(st.integers(1, 3))):
        place = draw(st.integers(0, max(len(data) - 1, 0)))
        head, tail = data[:place], data[place:]
        way = draw(st.sampled_from(["bit", "byte", "cut", "drop", "insert", "zeros", "twice"]))
        length = draw(st.integers(1, 64))
        if way == "bit" and tail:
            data = head + bytes([tail[0] ^ 1 << draw(st.integers(0, 7))]) + tail[1:]
        elif way == "byte" and tail:
            data = head + bytes([draw(st.integers(0, 255))]) + tail[1:]
        elif way == "cut":
            data = head
        elif way == "drop":
            data = head + tail[length:]
        elif way == "insert":
            data = head + draw(st.binary(max_size=16)) + tail
        elif way == "zeros":
            data = head + bytes(length) + tail[length:]
        elif way == "twice":
            data = head + tail[:length] + tail
    return data


def _places(data: Any) -> Iterator[tuple[Any, Any]]:
    """Every list or object within, with each of its indices or keys."""
    for key, value in data.items() if isinstance(data, dict) else enumerate(data):
        yield data, key
        if isinstance(value, dict | list):
            yield from _places(value)


def odd_json(data: Any) -> st.SearchStrategy[Any]:
    """`data` with one or two of its values replaced, taken out, or called otherwise."""

    @st.composite
    def changed(draw: st.DrawFn) -> Any:
        whole = copy.deepcopy(data)
        for _ in range(draw(st.integers(1, 2))):
            places = list(_places(whole))
            if not places:
                break
            holder, key = draw(st.sampled_from(range(len(places))).map(places.__getitem__))
            way = draw(st.sampled_from(["value", "value", "value", "without", "renamed"]))
            if way == "value":
                holder[key] = copy.deepcopy(draw(st.sampled_from(VALUES)))
            elif way == "without" or isinstance(holder, list):
                del holder[key]
            else:
                holder[draw(st.sampled_from(TEXTS))] = holder.pop(key)
        return whole

    return changed()


def _json_changed(data: bytes) -> st.SearchStrategy[bytes]:
    return odd_json(json.loads(data)).map(lambda changed: json.dumps(changed).encode())


@st.composite
def _word_changed(draw: st.DrawFn, data: bytes) -> bytes:
    """One word of a text changed, or its line repeated or left out."""
    parts = re.split(r"([^\s,=<>\"\[\]/]+)", data.decode())
    place = draw(st.integers(0, len(parts) // 2 - 1)) * 2 + 1
    way = draw(st.sampled_from(["value", "value", "value", "number", "without", "many"]))
    if way == "value":
        parts[place] = str(draw(st.sampled_from(VALUES[:-1])))
    elif way == "number":
        parts[place] = str(draw(st.integers(-9, 9)))
    elif way == "without":
        parts[place] = ""
    else:
        parts[place] += f" {parts[place]}" * 6000
    return "".join(parts).encode(errors="surrogatepass")


@st.composite
def _array_changed(draw: st.DrawFn, data: bytes) -> bytes:
    """One array of an .npz file replaced, left out, or with an odd number in it."""
    with np.load(BytesIO(data)) as file:
        arrays = dict(file)
    name = draw(st.sampled_from(sorted(arrays)))
    array = arrays[name]
    way = draw(st.sampled_from(["number", "number", "kind", "shape", "without", "empty", "renamed"]))
    if way == "without":
        del arrays[name]
    elif way == "renamed":
        arrays[draw(st.sampled_from(["x", "ä", "\x1b"]))] = arrays.pop(name)
    elif way == "kind":
        kind = draw(st.sampled_from(["S5", "c16", "f2", "i1", "?", "u8"]))
        with np.errstate(invalid="ignore", over="ignore"):
            arrays[name] = array.astype("S5" if array.dtype.kind == "U" else kind)
    elif way == "shape":
        arrays[name] = draw(
            st.sampled_from([array.ravel(), array[None], np.atleast_1d(array)[:0], np.array(7), array[..., None]])
        )
    elif way == "empty":
        arrays[name] = np.empty((0, 3))
    elif array.dtype.kind in "fiu" and array.size:
        array = array.copy()
        number = draw(st.sampled_from([0, -1, 1, 9, 2**31 - 1] if array.dtype.kind != "f" else [*NOT_FINITE, 1e38, -1]))
        array.flat[draw(st.integers(0, array.size - 1))] = number
        arrays[name] = array
    buffer = BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def _card_changed(data: bytes) -> st.SearchStrategy[bytes]:
    """What a network's file says of it."""
    model = onnx.load_from_string(data)
    (card,) = (entry for entry in model.metadata_props if entry.key == CARD_KEY)

    def with_card(changed: Any) -> bytes:
        card.value = json.dumps(changed)
        return model.SerializeToString()

    return odd_json(json.loads(card.value)).map(with_card)


def odd_picture(path: Path, values: np.ndarray, attributes: dict[str, Any], kind: str = "float") -> None:
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind)
    for name, value in attributes.items():
        spec.attribute(name, value)
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), spec) and target.write_image(np.ascontiguousarray(values, np.float32))
    target.close()


_WAYS: dict[tuple[str, ...], Callable[[bytes], st.SearchStrategy[bytes]]] = {
    (".json", ".sfm"): _json_changed,
    (".toml", ".lp", ".xml", ".txt", ".obj", ".ply"): _word_changed,
    (".npz",): _array_changed,
    (".onnx",): _card_changed,
}


@st.composite
def odd_pixels(draw: st.DrawFn, good: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
    """A picture's values with something odd in some of them, and an odd attribute."""
    values = good.astype(np.float64)
    odd = draw(st.sampled_from([*NOT_FINITE, 0.0, -1.0, 1e-38, 1e-300, 1e14, 1e16, 1e30, 3e38, -3e38, 65504.0]))
    where = draw(st.sampled_from(["pixel", "channel", "half", "all", "scaled"]))
    channel = draw(st.integers(0, good.shape[2] - 1))
    if where == "pixel":
        values[good.shape[0] // 2, good.shape[1] // 2, channel] = odd
    elif where == "channel":
        values[..., channel] = odd
    elif where == "half":
        values[: good.shape[0] // 2] = odd
    elif where == "all":
        values[:] = odd
    else:
        with np.errstate(over="ignore", invalid="ignore"):
            values *= odd
    named = st.sampled_from(["Orientation", "ImageDescription", "ExposureTime", "oiio:ColorSpace", "Make"])
    attribute = draw(st.dictionaries(named, st.sampled_from([0, 9, 10**6, -1, "x", CONTROL[:9], 1e30, 6]), max_size=1))
    with np.errstate(over="ignore", invalid="ignore"):
        return values.astype(np.float32), attribute
