"""Networks in ONNX files: dense ones on the mask's box, in tiles where it is large; per-patch ones in batches."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from mpsnet_core.capture import Capture
from mpsnet_core.errors import InputError
from mpsnet_core.estimate.card import ModelCard, card_from_metadata
from mpsnet_core.estimate.features import FEATURE_CHANNELS, feature_maps
from mpsnet_core.files import existing_file
from mpsnet_core.normals import NormalMap
from mpsnet_core.progress import Progress, silent

PROVIDERS = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "directml": "DmlExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
}
MAX_MODEL_BYTES = 2 << 30
DEFAULT_TILE = 1024
PATCHES_A_BATCH = 1024


class OnnxModel:
    """A network from an ONNX file, with its card.

    path: the file. provider: "cpu", "cuda", "directml" or "coreml". threads: CPU threads, 0 for all.
    tile: the side of a tile in pixels for dense networks; memory grows with its square.

    Raises InputError where the file is not an ONNX model of ours, where its inputs do not fit its card, or where the
    provider is not present.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        provider: str = "cpu",
        threads: int = 0,
        tile: int = DEFAULT_TILE,
    ) -> None:
        self.path = existing_file(path, "model file")
        if self.path.stat().st_size > MAX_MODEL_BYTES:
            raise InputError(f"model file {self.path} is larger than 2 GiB; it is not one of ours")
        if tile < 64:
            raise InputError(f"a tile of {tile} pixels is too small; use 64 or more")
        if threads < 0:
            raise InputError(f"{threads} threads cannot be; use 0 for all cores or a number above")
        self.tile = tile
        self.session = _session(self.path, provider, threads)
        try:
            self.card = card_from_metadata(self.session.get_modelmeta().custom_metadata_map)
            _check_fit(self.session, self.card)
        except InputError as error:
            raise InputError(f"model file {self.path} cannot be used: {error}") from None
        self._outputs = [node.name for node in self.session.get_outputs()]

    def __call__(self, capture: Capture, progress: Progress = silent) -> NormalMap:
        """Normals of `capture` in camera space; confidence 1 inside the mask unless the network gives one."""
        rows, columns = _box(capture.mask)
        box = Capture(capture.image[rows, columns], capture.mask[rows, columns], capture.rig, clip=capture.clip)
        names = {feature for features in self.card.inputs.values() for feature in features}
        maps = feature_maps(box, names)
        inputs = {name: np.concatenate([maps[f] for f in features]) for name, features in self.card.inputs.items()}
        run = self._dense if self.card.kind == "dense" else self._patches
        vectors = np.zeros((*capture.mask.shape, 3), np.float32)
        confidence = np.zeros(capture.mask.shape, np.float32)
        vectors[rows, columns], confidence[rows, columns] = run(inputs, box.mask, progress)
        progress(1.0, "normals estimated")
        return NormalMap(vectors, capture.mask, confidence)

    def _run(self, inputs: dict[str, NDArray[np.float32]]) -> dict[str, NDArray[np.float32]]:
        try:
            outputs = dict(zip(self._outputs, self.session.run(None, inputs), strict=True))
        except _RUNTIME_ERRORS as error:
            shapes = ", ".join(f"{name} {value.shape}" for name, value in inputs.items())
            reason = " ".join(str(error).split())[:200]
            raise InputError(
                f"model file {self.path} failed on {shapes}: {reason}; export it with dynamic sizes"
            ) from None
        if not all(np.isfinite(outputs[name]).all() for name in ("normals", "confidence") if name in outputs):
            raise InputError(f"model file {self.path} gave values that are not finite; train or export it again")
        return outputs

    def _shaped(
        self, name: str, outputs: dict[str, NDArray[np.float32]], expected: tuple[int, ...]
    ) -> NDArray[np.float32]:
        """An output in the shape it must have; axes of length one do not matter."""
        shape = outputs[name].shape
        if [size for size in shape if size > 1] != [size for size in expected if size > 1]:
            raise InputError(
                f'model file {self.path} cannot be used: its output "{name}" is {shape}, expected {expected}'
            )
        return outputs[name].reshape(expected)

    def _dense(
        self, inputs: dict[str, NDArray[np.float32]], mask: NDArray[np.bool_], progress: Progress
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        height, width = mask.shape
        grain = self.card.multiple
        padding = [(0, 0), (0, -height % grain), (0, -width % grain)]
        inputs = {name: np.pad(values, padding) for name, values in inputs.items()}
        padded_height, padded_width = height + padding[1][1], width + padding[2][1]
        # Tiles and their halos begin on the network's grain, so that pooling falls on the same pixels as untiled.
        step = max(1, self.tile // grain) * grain
        halo = -(-self.card.halo // grain) * grain
        vectors = np.zeros((padded_height, padded_width, 3), np.float32)
        confidence = np.ones((padded_height, padded_width), np.float32)
        tiles = list(_tiles(padded_height, padded_width, step, halo))
        for number, (outer, inner, place) in enumerate(tiles):
            progress(number / len(tiles), f"tile {number + 1} of {len(tiles)}")
            if not mask[place].any():
                continue
            outputs = self._run({name: values[(slice(None), *outer)][None] for name, values in inputs.items()})
            size = (outer[0].stop - outer[0].start, outer[1].stop - outer[1].start)
            vectors[place] = self._shaped("normals", outputs, (1, 3, *size))[0].transpose(1, 2, 0)[inner]
            if "confidence" in outputs:
                confidence[place] = self._shaped("confidence", outputs, (1, 1, *size))[0, 0][inner]
        return vectors[:height, :width], confidence[:height, :width]

    def _patches(
        self, inputs: dict[str, NDArray[np.float32]], mask: NDArray[np.bool_], progress: Progress
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        side, reach = self.card.patch, self.card.patch // 2
        windows = {
            name: np.lib.stride_tricks.sliding_window_view(
                np.pad(values, [(0, 0), (reach, reach), (reach, reach)]), (len(values), side, side)
            )[0]
            for name, values in inputs.items()
        }
        vectors, confidence = np.zeros((*mask.shape, 3), np.float32), np.ones(mask.shape, np.float32)
        rows, columns = np.nonzero(mask)
        for start in range(0, len(rows), PATCHES_A_BATCH):
            progress(start / len(rows), f"pixel {start} of {len(rows)}")
            y, x = rows[start : start + PATCHES_A_BATCH], columns[start : start + PATCHES_A_BATCH]
            outputs = self._run({name: view[y, x] for name, view in windows.items()})
            vectors[y, x] = self._shaped("normals", outputs, (len(y), 3))
            if "confidence" in outputs:
                confidence[y, x] = self._shaped("confidence", outputs, (len(y), 1))[:, 0]
        return vectors, confidence


_RUNTIME_ERRORS: tuple[type[Exception], ...] = (
    RuntimeError,
    ValueError,
    *(
        error
        for error in vars(onnxruntime.capi.onnxruntime_pybind11_state).values()
        if isinstance(error, type) and issubclass(error, Exception)
    ),
)


def _session(path: Path, provider: str, threads: int) -> Any:
    if provider not in PROVIDERS:
        raise InputError(f"provider {provider!r} is not known; choose {', '.join(PROVIDERS)}")
    present = onnxruntime.get_available_providers()
    if PROVIDERS[provider] not in present:
        usable = ", ".join(name for name, full in PROVIDERS.items() if full in present)
        raise InputError(
            f"provider {provider!r} is not in this onnxruntime; choose {usable} or install one that has it"
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_ALL
    options.log_severity_level = 4  # what goes wrong is said in our own sentence
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=[PROVIDERS[provider]])
    except _RUNTIME_ERRORS as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(
            f"model file {path} is not an ONNX model that can be run ({reason}); export it again"
        ) from None


def _check_fit(session: Any, card: ModelCard) -> None:
    nodes = {node.name: node for node in session.get_inputs()}
    if set(nodes) != set(card.inputs):
        raise InputError(f"it has inputs {sorted(nodes)}, its card describes {sorted(card.inputs)}")
    for name, node in nodes.items():
        channels = sum(FEATURE_CHANNELS[feature] for feature in card.inputs[name])
        side: Any = "any" if card.kind == "dense" else card.patch
        expected = ["any", channels, side, side]
        shape = ["any" if not isinstance(size, int) else size for size in node.shape]
        fits = len(shape) == 4 and all(
            want in (have, "any") or have == "any" for want, have in zip(expected, shape, strict=True)
        )
        if not fits or (shape[1] != channels) or node.type != "tensor(float)":
            raise InputError(
                f"input {name!r} is {node.type} {shape}; expected tensor(float) {expected} for "
                f"{' + '.join(card.inputs[name])}"
            )
        # Dense networks run on one tile at a time, so a batch fixed at 1 does no harm.
        batch_fits = shape[0] == "any" or (card.kind == "dense" and shape[0] == 1)
        if not batch_fits or any(
            have != want for have, want in zip(shape[1:], expected[1:], strict=True) if want == "any"
        ):
            raise InputError(
                f"input {name!r} has the fixed size {shape}; expected {expected}: export with dynamic sizes"
            )
    if "normals" not in [node.name for node in session.get_outputs()]:
        raise InputError('it has no output called "normals"')


def _box(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of the mask's bounding box."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


Window = tuple[slice, slice]


def _tiles(height: int, width: int, step: int, halo: int) -> Iterator[tuple[Window, Window, Window]]:
    """For each tile: what is read (with halo), which part of that is kept, and where it goes."""
    for top in range(0, height, step):
        for left in range(0, width, step):
            bottom, right = min(top + step, height), min(left + step, width)
            outer_top, outer_left = max(top - halo, 0), max(left - halo, 0)
            outer = (
                slice(outer_top, min(bottom + halo, height)),
                slice(outer_left, min(right + halo, width)),
            )
            inner = (slice(top - outer_top, bottom - outer_top), slice(left - outer_left, right - outer_left))
            yield outer, inner, (slice(top, bottom), slice(left, right))
