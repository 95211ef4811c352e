"""Training recipe: all settings of a training run but for its files. One TOML file per shipped model."""

import os
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

from mpsnet_core.errors import FormatError, InputError, SettingsError
from mpsnet_core.io.files import existing_file
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.synthesis.capture_model import CaptureModel
from mpsnet_core.synthesis.field_limits import check_fields, limited, with_tuples

RECIPES = Path(__file__).parent / "recipes"
# A name of many dots takes memory by the square of them.
MAX_RECIPE_BYTES = 1 << 13


@dataclass(frozen=True)
class TrainingConfig:
    """How one model is trained.

    Raises SettingsError where a value is out of its range.
    """

    name: str
    """The model's name."""
    title: str
    """A line for people."""
    network: str
    """Kind of network, of :data:`mpsnet_core.learning.training.networks.NETWORKS`."""
    steps: int = limited(MISSING, 1, 100_000_000)
    """Steps of the optimiser."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """The network's own options, such as its width."""
    samples: tuple[str, ...] = ()
    """The commands that make its samples, for people."""
    batch: int = limited(16, 1, 65536)
    """Pictures a step (over all processes)."""
    crop: int = limited(128, 0, 8192)
    """Side of a picture in pixels, 0 for whole pictures (patch-wise networks alone)."""
    patches: int = limited(0, 0, 65536)
    """Patches from each picture where the network is patch-wise, batch * patches a step."""
    learning_rate: float = limited(1e-3, 1e-8, 1.0)
    """It rises over `warm_up` steps, stays, and falls to nothing over the last `decay` steps, in a straight line
    (Hägele et al., "Scaling laws and compute-optimal training beyond fixed training durations", 2024)."""
    weight_decay: float = limited(1e-2, 0.0, 1.0)
    """Decay of weights, not of biases and batch norm."""
    warm_up: int = limited(200, 0, 1_000_000)
    """Number of first steps over which the learning rate rises."""
    decay: int = limited(0, 0, 100_000_000)
    """Number of last steps over which the learning rate falls."""
    ema: float = limited(0.999, 0.0, 0.99999)
    """Decay of the weights' running mean, which becomes the model."""
    error_weight: float = limited(1.0, 0.0, 100.0)
    """Weight in the loss of the squared error of the expected error, where the network predicts one."""
    gradient_weight: float = limited(0.0, 0.0, 100.0)
    """Weight in the loss of the difference between the normals' gradients and the true ones; patch-wise networks have
    none."""
    optimiser: Literal["adamw", "muon"] = "adamw"
    """"adamw", or "muon" for the weights of convolutions and AdamW for the rest."""
    augment: bool = True
    """Whether samples are turned by quarters, mirrored, and their lights put in any order, anew each time they are
    seen; networks with a canonical frame turn them by themselves."""
    frozen_norms: bool = False
    """Whether batch norms keep the means and variances that they begin with, for a network that is trained further:
    those of a small batch differ from step to step."""
    hard_share: float = limited(0.0, 0.0, 0.9)
    """Share of the pictures that are drawn with a chance that grows with the network's error on their samples, not in
    turn; patch-wise networks have none."""
    capture: Mapping[str, Any] = field(default_factory=dict)
    """Ranges and chances of :class:`mpsnet_core.synthesis.capture_model.CaptureModel` that differ from its own."""
    seed: int = limited(0, 0, 2**31 - 1)
    """Seed of the first weights, the photographs and their order."""

    def __post_init__(self) -> None:
        check_fields(self, "the recipe's")
        capture_model(self.capture)
        if self.warm_up + self.decay > self.steps:
            raise SettingsError(f"the recipe's warm_up and decay are longer than its {self.steps} steps; give it more")

    def to_json(self) -> dict[str, Any]:
        """The recipe as plain data, for :func:`recipe_from_data`."""
        tables = {"options": dict(self.options), "capture": dict(self.capture)}
        return {**asdict(self), **tables, "samples": list(self.samples)}


def capture_model(changes: Mapping[str, Any]) -> CaptureModel:
    """The capture model with some of its ranges and chances changed. Raises SettingsError where a change is invalid."""
    own = CaptureModel()
    for name in changes:
        if name not in vars(own):
            raise SettingsError(f"the recipe's capture has no {name!r}; choose {', '.join(vars(own))}")
    model = replace(own, **with_tuples(changes))
    check_fields(model, "the recipe's capture:")
    return model


def recipe_names() -> list[str]:
    """The recipes that come with the package."""
    return sorted(file.stem for file in RECIPES.glob("*.toml"))


def read_recipe(name: AnyPath) -> TrainingConfig:
    """A recipe by its name, or from a TOML file. Raises InputError where there is none or it is malformed."""
    name = os.fspath(name)
    path = RECIPES / f"{name}.toml" if name in recipe_names() else Path(name)
    if path.suffix.lower() != ".toml":
        raise SettingsError(f"there is no recipe {name!r}; choose {', '.join(recipe_names())} or give a .toml file")
    path = existing_file(path, "recipe")
    if path.stat().st_size > MAX_RECIPE_BYTES:
        raise FormatError(f"recipe {path} is larger than 8 KiB, the limit for recipes; check the path")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (ValueError, RecursionError) as error:  # ValueError also for numbers of 5,000 digits
        raise FormatError(f"recipe {path} is not valid TOML: {error}") from None
    try:
        return recipe_from_data(data)
    except InputError as error:
        raise FormatError(f"recipe {path}: {error}") from None


def recipe_from_data(data: Mapping[str, Any]) -> TrainingConfig:
    """A recipe from plain data. Raises SettingsError where something is missing, unknown or out of its range."""
    known = {entry.name for entry in fields(TrainingConfig)}
    for name in data:
        if name not in known:
            raise SettingsError(f"the recipe's {name!r} is not known; choose {', '.join(sorted(known))}")
    for name in ("name", "title", "network", "steps"):
        if name not in data:
            raise SettingsError(f'the recipe lacks "{name}"; add it')
    return TrainingConfig(**with_tuples(data))
