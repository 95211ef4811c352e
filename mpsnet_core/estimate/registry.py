"""The registered models by name. Cheap to import: it loads no model."""

import logging
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from mpsnet_core.errors import FileError, SettingsError
from mpsnet_core.io.opening import AnyPath

log = logging.getLogger(__name__)

LAMBERTIAN = "lambertian"
LAMBERTIAN_GREY_WORLD = "lambertian-grey-world"
BASELINES = (LAMBERTIAN, LAMBERTIAN_GREY_WORLD)
DEFAULT_MODEL = "multiscale"
QUICK_MODEL = "multiscale-quick"
STILL_PASSES: Literal[3] = 3  # of the default, averaged; frames of a sequence get one
DEFAULT_TILE = 672  # side of a dense network's tiles, in pixels

MODELS_FOLDER = Path(__file__).parent / "models"
# In the repository and the sdist, but not in wheels.
COMPARISON_FOLDER = MODELS_FOLDER / "comparison"


@dataclass(frozen=True)
class RegisteredModel:
    """A model that comes with the package."""

    number: int
    """Number that .blend files store."""
    name: str
    """Name that the options take."""
    label: str
    """Display name."""
    title: str
    """What it is, in a line."""
    file: Path | None = None
    """The network's file; None for the baselines, which are not networks."""
    passes: Literal[1, 3] | None = None
    """Number of passes for stills, in place of the card's."""
    comparison: bool = False
    """Whether it is for comparisons and scripts, and left out of menus."""
    sha256: str = ""
    """Hash of a file that wheels do not include; empty for others."""

    @property
    def installed(self) -> bool:
        """Whether its file exists, or it needs none."""
        return self.file is None or self.file.is_file()

    @property
    def how_to_install(self) -> str:
        """Where to get a file that wheels lack."""
        assert self.file is not None
        return (
            f"put {self.file.name} (sha256 {self.sha256}) from the repository's mpsnet_core/estimate/models/comparison "
            f"into {COMPARISON_FOLDER}, or give its path, or that of one made by mpsnet train --recipe {self.name}"
        )


_DEFAULT = "The default: one network from coarse to fine, with equation 2 inside, which states how certain it is"
_QUICK = "The default in one pass: a sixth to half of the time, a little less accurate"
_GREY_WORLD = "The baseline for flat, matt cloth, leather or plaster of one colour: each channel divided by its mean"
_MULTISCALE = MODELS_FOLDER / "multiscale.onnx"
# Names and titles of the networks, readable without onnxruntime.
_MODELS = (
    RegisteredModel(0, DEFAULT_MODEL, "Multiscale", _DEFAULT, _MULTISCALE, STILL_PASSES),
    RegisteredModel(2, QUICK_MODEL, "Multiscale Quick", _QUICK, _MULTISCALE, 1),
    RegisteredModel(
        3,
        "mpsnet",
        "MPS-Net (2019)",
        "The paper's network, patch by patch: only for rigs like the paper's",
        MODELS_FOLDER / "mpsnet.onnx",
    ),
    RegisteredModel(
        5,
        "psfcn",
        "PS-FCN",
        "Chen et al. 2018 for three lights, half the published width",
        COMPARISON_FOLDER / "psfcn.onnx",
        comparison=True,
        sha256="a14a058c95d291335b943945f0ff12b55fe3d8bc1259e6f450dbe896655c2096",
    ),
    RegisteredModel(
        6,
        "demultiplexer",
        "Demultiplexer",
        "Ju et al. 2018: three intensities from each pixel, then equation 2",
        COMPARISON_FOLDER / "demultiplexer.onnx",
        comparison=True,
        sha256="6b355a5b53681663a7fff50806dc57162557dc0cef8431b855255db49b60d998",
    ),
    RegisteredModel(
        7, LAMBERTIAN, "Lambertian", "The baseline, instantly: for matt surfaces of one grey (equation 2 of the paper)"
    ),
    RegisteredModel(8, LAMBERTIAN_GREY_WORLD, "Lambertian Grey World", _GREY_WORLD, comparison=True),
)
OLD_NAMES = {"multiscale-int8": QUICK_MODEL}  # 0.2.0's quick network


def known_models() -> list[RegisteredModel]:
    """All models that have names, the default first, whether or not their files exist."""
    return list(_MODELS)


def registered_models() -> list[RegisteredModel]:
    """The installed models, the default first. Wheels lack the networks for comparison."""
    return [entry for entry in _MODELS if entry.installed]


class NetworkFile(NamedTuple):
    """A network's file."""

    path: Path
    """The .onnx file."""
    passes: Literal[1, 3] | None = None
    """Number of passes in place of the card's, see :class:`RegisteredModel`."""


def find_network(name: AnyPath) -> NetworkFile:
    """The ONNX file of a network given by name or by path.

    Raises SettingsError if there is no such network, FileError if its file is missing.
    """
    name = os.fspath(name)
    if name in OLD_NAMES:
        log.warning("the model %s is now called %s; its old name will go", name, OLD_NAMES[name])
        name = OLD_NAMES[name]
    for entry in known_models():
        if entry.name == name:
            if entry.file is None:
                raise SettingsError(f"{name} is not a network and has no file; name a network")
            if not entry.installed:
                raise FileError(f"the network {name}, to compare with, is not installed: {entry.how_to_install}")
            return NetworkFile(entry.file, entry.passes)
    if Path(name).suffix.lower() == ".onnx":
        if Path(name).is_file():
            return NetworkFile(Path(name))
        raise FileError(f"model file {name} does not exist; check the path")
    names = ", ".join(entry.name for entry in registered_models())
    raise SettingsError(f"there is no model {name!r}; choose {names} or give an .onnx file")
