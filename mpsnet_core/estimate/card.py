"""Model cards: what an ONNX network is and how its inputs are made, stored in the file's metadata."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from mpsnet_core.errors import FormatError
from mpsnet_core.estimate.features import CONSTANTS, FEATURE_CHANNELS

CARD_KEY = "mpsnet.card"
# For people: how the model was trained (recipe, date, time, hardware, metrics), as JSON.
TRAINING_KEY = "mpsnet.training"
CARD_FORMAT = "mpsnet-model"
CARD_VERSION = 1


@dataclass(frozen=True)
class ModelCard:
    """How to run an ONNX file's network.

    Raises
    ------
    FormatError
        If a value has the wrong type or is out of range, or values contradict each other.
    """

    name: str
    """Name of the model, for people."""
    network: str
    """Name of the architecture, for people."""
    licence: str
    """Licence of the weights, for people."""
    kind: Literal["dense", "patch", "pyramid"]
    """What it maps: "dense" maps (N, C, H, W) to (N, 3, H, W). "pyramid" does so on one scale after the other, coarse
    to fine, with its output on the previous scale as an input. "patch" maps (N, C, patch, patch) to (N, 3), one pixel
    per patch."""
    inputs: Mapping[str, tuple[str, ...]]
    """The features stacked along the channels of each ONNX input, see
    :data:`mpsnet_core.estimate.features.FEATURE_CHANNELS`. Constants such as "lights" are of size 1 x 1 and are stacked
    with constants only: (N, 9, 1, 1)."""
    halo: int = 0
    """Dense and pyramid: radius of the receptive field in pixels."""
    multiple: int = 1
    """Dense and pyramid: height and width must be a multiple of this, because of pooling."""
    patch: int = 1
    """Patch only: side of a patch in pixels, odd."""
    frame: Literal["camera", "canonical"] = "camera"
    """Dense and pyramid: "camera", or "canonical" for a network that always sees the first light nearly straight up in
    the image and the others counter-clockwise from it, see :mod:`mpsnet_core.estimate.features`."""
    passes: int = 1
    """Canonical only: number of frames to average the network's output over, 1 to 6, see
    :func:`mpsnet_core.estimate.features.canonical_frames`."""
    magnified: float = 1.0
    """Pyramid only: factor by which a small image is magnified, 1 to 4, see
    :func:`mpsnet_core.estimate.dense.predict_dense`."""

    def __post_init__(self) -> None:
        for key in ("name", "network", "licence"):
            if not isinstance(getattr(self, key), str) or not getattr(self, key):
                raise FormatError(f'its card needs a text for "{key}"')
        if self.kind not in ("dense", "patch", "pyramid"):
            raise FormatError(f'its card\'s "kind" is {self.kind!r}; expected "dense", "patch" or "pyramid"')
        if self.frame not in ("camera", "canonical"):
            raise FormatError(f'its card\'s "frame" is {self.frame!r}; expected "camera" or "canonical"')
        if self.frame == "canonical" and self.kind == "patch":
            raise FormatError('its card\'s "frame" is "canonical", which a network that sees patches cannot have')
        if type(self.passes) is not int or not 1 <= self.passes <= 6:
            raise FormatError(f'its card\'s "passes" is {self.passes!r}; expected a whole number from 1 to 6')
        if self.passes > 1 and self.frame != "canonical":
            raise FormatError(f'its card\'s "passes" is {self.passes}, which needs the "frame" "canonical"')
        if type(self.magnified) not in (int, float) or not 1 <= self.magnified <= 4:
            raise FormatError(f'its card\'s "magnified" is {self.magnified!r}; expected a number from 1 to 4')
        if self.magnified > 1 and self.kind != "pyramid":
            raise FormatError(f'its card\'s "magnified" needs the "kind" "pyramid", not {self.kind!r}')
        if not isinstance(self.inputs, Mapping) or not self.inputs:
            raise FormatError("its card's \"inputs\" must name each input's features")
        for name, features in self.inputs.items():
            if not features:
                raise FormatError(f'its card\'s "inputs" has no list of features for input {name!r}')
            for feature in features:
                if not isinstance(feature, str) or feature not in FEATURE_CHANNELS:
                    raise FormatError(f"its card requests {feature!r}; this program has {', '.join(FEATURE_CHANNELS)}")
            if (constants := CONSTANTS.intersection(features)) and constants != set(features):
                raise FormatError(
                    f"its card stacks {', '.join(sorted(constants))}, which is one pixel, with maps in input {name!r}; "
                    "give it an input of its own"
                )
        for key, least in (("halo", 0), ("multiple", 1), ("patch", 1)):
            value = getattr(self, key)
            if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= 4096:
                raise FormatError(f'its card\'s "{key}" is {value!r}; expected a whole number from {least} to 4096')
        if self.patch % 2 == 0:
            raise FormatError(f'its card\'s "patch" is {self.patch}; expected an odd number of pixels')

    def to_json(self) -> str:
        """The card as text, for :data:`CARD_KEY` in the ONNX file's metadata."""
        inputs = {name: list(features) for name, features in self.inputs.items()}
        return json.dumps({"format": CARD_FORMAT, "version": CARD_VERSION, **self.__dict__, "inputs": inputs})


def card_from_metadata(metadata: Mapping[str, str]) -> ModelCard:
    """The card in an ONNX file's metadata. Raises FormatError if it is missing or malformed."""
    text = metadata.get(CARD_KEY)
    if text is None:
        raise FormatError(f"it has no card (metadata {CARD_KEY!r}), so it is unknown how its inputs are made")
    try:
        data: Any = json.loads(text)
    except (ValueError, RecursionError):
        raise FormatError(f"its card (metadata {CARD_KEY!r}) is not valid JSON") from None
    if not isinstance(data, dict) or data.pop("format", None) != CARD_FORMAT:
        raise FormatError(f"its card is not a {CARD_FORMAT} card")
    version = data.pop("version", None)
    if version != CARD_VERSION:
        raise FormatError(f"its card is version {version!r}, this program reads version {CARD_VERSION}; update it")
    known = {key: data[key] for key in ModelCard.__dataclass_fields__ if key in data}
    if isinstance(known.get("inputs"), dict):
        known["inputs"] = {
            name: tuple(features) if isinstance(features, list) else () for name, features in known["inputs"].items()
        }
    missing = [key for key in ("name", "network", "licence", "kind", "inputs") if key not in known]
    if missing:
        raise FormatError(f'its card lacks "{missing[0]}"')
    return ModelCard(**known)


def record_from_metadata(metadata: Mapping[str, str]) -> dict[str, Any]:
    """How the model was trained, from an ONNX file's metadata; empty if missing or malformed."""
    try:
        record = json.loads(metadata.get(TRAINING_KEY, "{}"))
    except (ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}
