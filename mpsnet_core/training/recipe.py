"""Training recipe: all that a training run is made of, but for the samples' place. One TOML file per shipped model."""

import os
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from mpsnet_core.errors import InputError
from mpsnet_core.files import existing_file

RECIPES = Path(__file__).parent / "recipes"
MAX_RECIPE_BYTES = 1 << 16

# Smallest and largest value of each number of a recipe.
_RANGES: dict[str, tuple[float, float]] = {
    "steps": (1, 100_000_000),
    "batch": (1, 65536),
    "crop": (0, 8192),
    "patches": (0, 65536),
    "seed": (0, 2**31 - 1),
    "learning_rate": (1e-8, 1.0),
    "weight_decay": (0.0, 1.0),
    "warm_up": (0, 1_000_000),
    "restart": (0, 100_000_000),
    "ema": (0.0, 0.99999),
    "error_weight": (0.0, 100.0),
}


@dataclass(frozen=True)
class TrainingRecipe:
    """How one model is trained.

    name: the model's. title: a line for people. network: of :data:`mpsnet_core.training.networks.NETWORKS`, options:
    its own, such as its width. samples: the commands that make the samples it was meant for; for people.
    steps: of the optimiser. batch: pictures a step (over all processes). crop: side of a picture in pixels, 0 for whole
    pictures (patch-wise networks alone). patches: places taken from each picture where the network is patch-wise, so
    that a step sees batch * patches of them.
    learning_rate: AdamW's highest; it rises over `warm_up` steps and falls to nothing along a cosine. restart: the step
    at which it rises once more, to half its highest, and falls again (Loshchilov and Hutter, "SGDR", ICLR 2017); 0 for
    never. weight_decay: of
    weights, not of biases and batch norm. ema: decay of the weights' running mean, which is what becomes the model.
    error_weight: of the squared error of the expected error in the loss, for networks that give one.
    calibrated: chance that a photograph's mixing is known (:class:`mpsnet_core.synthesis.photographs.capture_model.
    CaptureModel`); a second number holds from the restart on. seed: of the first weights, the photographs and their
    order.

    Raises InputError where a value is out of its range.
    """

    name: str
    title: str
    network: str
    steps: int
    options: Mapping[str, Any] = field(default_factory=dict)
    samples: tuple[str, ...] = ()
    batch: int = 16
    crop: int = 128
    patches: int = 0
    learning_rate: float = 1e-3
    weight_decay: float = 1e-2
    warm_up: int = 200
    restart: int = 0
    ema: float = 0.999
    error_weight: float = 1.0
    calibrated: tuple[float, ...] = (0.9,)
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("name", "title", "network"):
            value = getattr(self, name)
            if not isinstance(value, str) or not value:
                raise InputError(f"the recipe's {name} must be a text, not {value!r}")
        if not isinstance(self.options, Mapping):
            raise InputError(f"the recipe's options must be a table, not {self.options!r}")
        if not all(isinstance(line, str) for line in self.samples):
            raise InputError("the recipe's samples must be a list of texts")
        chances = [isinstance(chance, float) and 0 <= chance <= 1 for chance in self.calibrated]
        if not all(chances) or len(chances) not in ((1, 2) if self.restart else (1,)):
            raise InputError(
                f"the recipe's calibrated must be a chance from 0.0 to 1.0, or two where there is a restart, not "
                f"{list(self.calibrated)}"
            )
        for name, (low, high) in _RANGES.items():
            value, kind = getattr(self, name), type(getattr(self, name))
            if kind not in (int, float) or (kind is float and isinstance(low, int)) or not low <= value <= high:
                raise InputError(f"the recipe's {name} must be from {low:g} to {high:g}, not {value!r}")
        if self.restart >= self.steps:
            raise InputError(f"the recipe's restart must come before its {self.steps} steps, not at {self.restart}")

    def to_json(self) -> dict[str, Any]:
        """The recipe as plain data, which :func:`recipe_from_data` takes."""
        return {
            **asdict(self),
            "options": dict(self.options),
            "samples": list(self.samples),
            "calibrated": list(self.calibrated),
        }


def recipe_names() -> list[str]:
    """The recipes that come with the package."""
    return sorted(file.stem for file in RECIPES.glob("*.toml"))


def read_recipe(name: str | os.PathLike[str]) -> TrainingRecipe:
    """A recipe by its name, or from a TOML file. Raises InputError where there is none or it is malformed."""
    name = os.fspath(name)
    path = RECIPES / f"{name}.toml" if name in recipe_names() else Path(name)
    if path.suffix.lower() != ".toml":
        raise InputError(f"there is no recipe {name!r}; choose {', '.join(recipe_names())} or give a .toml file")
    path = existing_file(path, "recipe")
    if path.stat().st_size > MAX_RECIPE_BYTES:
        raise InputError(f"recipe {path} is larger than 64 KiB; it is not one of ours")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"recipe {path} is not valid TOML: {error}") from None
    try:
        return recipe_from_data(data)
    except InputError as error:
        raise InputError(f"recipe {path}: {error}") from None


def recipe_from_data(data: Mapping[str, Any]) -> TrainingRecipe:
    """A recipe from plain data. Raises InputError where something is missing, unknown or out of its range."""
    known = {entry.name for entry in fields(TrainingRecipe)}
    for name in data:
        if name not in known:
            raise InputError(f"the recipe's {name!r} is not known; choose {', '.join(sorted(known))}")
    for name in ("name", "title", "network", "steps"):
        if name not in data:
            raise InputError(f'the recipe lacks "{name}"; add it')
    lists = {name: data[name] for name in ("samples", "calibrated") if name in data}
    for name, values in lists.items():
        if not isinstance(values, list | tuple):
            raise InputError(f"the recipe's {name} must be a list, not {values!r}")
    return TrainingRecipe(**{**data, **{name: tuple(values) for name, values in lists.items()}})
