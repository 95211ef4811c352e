"""Checkpoints: everything a run needs to resume as if it had never stopped."""

import math
import warnings
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple, get_origin, get_type_hints

import torch
from torch import Tensor

from mpsnet_core.errors import FormatError, InputError
from mpsnet_core.io.files import atomic_write, existing_file
from mpsnet_core.io.opening import DAMAGED, AnyPath
from mpsnet_core.learning.training.recipe import TrainingConfig, recipe_from_data

FORMAT = "mpsnet-checkpoint"
MAX_BYTES = 4 << 30
# Limit of steps, and of seconds.
MAX_STEPS = 10**9


class Checkpoint(NamedTuple):
    """The state of a training run, from which it can be resumed."""

    recipe: TrainingConfig
    """How the network is trained."""
    step: int
    """Number of steps done."""
    weights: dict[str, Tensor]
    """The network's weights."""
    mean_weights: dict[str, Tensor]
    """Their running mean."""
    optimisers: list[dict[str, Any]]
    """States of the optimisers."""
    seconds: float
    """Training time so far in seconds."""
    samples: str
    """Fingerprint of the samples."""
    precision: str
    """Precision of the layers."""
    errors: Tensor
    """(samples,), or (0,) without a hard share. The network's error on each sample in radians, NaN where unseen."""
    continues: dict[str, Any] | None
    """Training record of the initial network, see :class:`mpsnet_core.learning.training.loop.Trained`."""


# Types of the values in the file.
_TYPES: dict[str, Any] = {name: get_origin(kind) or kind for name, kind in get_type_hints(Checkpoint).items()}
_TYPES |= {"recipe": dict, "continues": dict | None}


def write_checkpoint(path: AnyPath, checkpoint: Checkpoint) -> None:
    """Write the file atomically."""
    data = {**checkpoint._asdict(), "format": FORMAT, "recipe": checkpoint.recipe.to_json()}
    content = BytesIO()
    torch.save(data, content)
    with atomic_write(Path(path)) as unfinished:  # PyTorch would not say that the disk is full
        unfinished.write_bytes(content.getbuffer())


def read_checkpoint(path: AnyPath) -> Checkpoint:
    """Read a checkpoint without executing code in it. Raises InputError if it is missing, damaged or another file."""
    path = existing_file(path, "checkpoint")
    if path.stat().st_size > MAX_BYTES:
        raise FormatError(f"checkpoint {path} is larger than 4 GiB, the limit for checkpoints; check the path")
    try:
        with path.open("rb") as file:  # torch.load accepts other formats, and zipfile a ZIP appended to any data
            whole = file.read(4) == b"PK\3\4"
        with zipfile.ZipFile(path) as archive:  # torch.load ignores checksums; torch.save never compresses
            whole &= all(entry.compress_type == zipfile.ZIP_STORED for entry in archive.infolist())
            whole = whole and archive.testzip() is None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about damaged files
            data = torch.load(path, map_location="cpu", weights_only=True) if whole else None
    except DAMAGED:
        data = None
    if isinstance(data, dict):
        data.setdefault("errors", torch.empty(0))  # which earlier versions did not write
    if not isinstance(data, dict) or data.pop("format", None) != FORMAT or set(data) != set(_TYPES):
        raise FormatError(f"checkpoint {path} is damaged, or is not a checkpoint of this program; resume from another")
    for name, kind in _TYPES.items():
        if not isinstance(data[name], kind):
            raise FormatError(f"checkpoint {path} is not of this program ({name} has another type); resume another")
    if isinstance(data["step"], bool) or not (0 <= data["step"] < MAX_STEPS and 0 <= data["seconds"] < MAX_STEPS):
        raise FormatError(f"checkpoint {path} is damaged: its steps or seconds are out of range; resume from another")
    errors = data["errors"]
    if not (errors.ndim == 1 and (errors.isnan() | (errors >= 0) & (errors <= math.pi)).all()):
        raise FormatError(f"checkpoint {path} is damaged: its samples' errors are out of range; resume from another")
    try:
        return Checkpoint(**{**data, "recipe": recipe_from_data(data["recipe"])})
    except InputError as error:
        raise FormatError(f"checkpoint {path}: {error}") from None
