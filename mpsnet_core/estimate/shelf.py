"""The model shelf: which models there are by name. Light to import; no model is loaded here."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

from mpsnet_core.errors import InputError

LAMBERTIAN = "lambertian"
LAMBERTIAN_GREY_WORLD = "lambertian-grey-world"
DEFAULT_MODEL = "multiscale"
AVERAGED_MODEL = "multiscale-averaged"
DEFAULT_TILE = 448  # pixels a side of what a dense network sees at a time

SHELF = Path(__file__).parent / "models"


@dataclass(frozen=True)
class ShelfEntry:
    """A model that can be asked for by name.

    label: its name for people. file: None for what needs no network. passes: in place of those on the file's card.
    """

    name: str
    label: str
    title: str
    file: Path | None = None
    passes: Literal[1, 3] | None = None


# What is known of the networks without opening their files, which takes onnxruntime.
_NETWORKS = (
    (
        "multiscale",
        "Multiscale",
        "The default: a network over five scales that knows the lights and tells how sure it is",
    ),
    ("multiscale-int8", "Multiscale 8-Bit", "The default in 8-bit numbers, quicker on most processors"),
    ("mpsnet", "MPS-Net", "The paper's network, patch by patch, a quarter of its width: slow"),
    ("mpsnet-dense", "MPS-Net Dense", "The paper's layers over the whole picture: quick, and not the same network"),
    ("psfcn", "PS-FCN", "Chen et al. 2018 for three lights, half the published width"),
    ("demultiplexer", "Demultiplexer", "Ju et al. 2018: three intensities from each pixel, then equation 2"),
)


def shelf() -> list[ShelfEntry]:
    """All models that come with the package, the default first."""
    networks = [ShelfEntry(name, label, title, SHELF / f"{name}.onnx") for name, label, title in _NETWORKS]
    averaged = ShelfEntry(
        AVERAGED_MODEL,
        "Multiscale Averaged",
        "The default three times, each light first once: better, at a third of its speed",
        SHELF / f"{DEFAULT_MODEL}.onnx",
        passes=3,
    )
    networks.insert(1, averaged)
    return [
        *(entry for entry in networks if entry.file and entry.file.is_file()),
        ShelfEntry(
            LAMBERTIAN, "Lambertian", "The baseline, at once: a matt surface of one grey (equation 2 of the paper)"
        ),
        ShelfEntry(
            LAMBERTIAN_GREY_WORLD,
            "Lambertian Grey World",
            "The baseline for a matt surface of one colour: each channel is divided by its own mean first",
        ),
    ]


class NetworkFile(NamedTuple):
    """Where a network is, and passes in place of its card's, see :class:`ShelfEntry`."""

    path: Path
    passes: Literal[1, 3] | None = None


def find_network(name: str | os.PathLike[str]) -> NetworkFile:
    """The ONNX file of a network given by name or by path. Raises InputError where there is none."""
    name = os.fspath(name)
    for entry in shelf():
        if entry.name == name:
            if entry.file is None:
                raise InputError(f"{name} is no network and has no file; name a network")
            return NetworkFile(entry.file, entry.passes)
    if Path(name).suffix.lower() == ".onnx":
        if Path(name).is_file():
            return NetworkFile(Path(name))
        raise InputError(f"model file {name} does not exist; check the path")
    names = ", ".join(entry.name for entry in shelf())
    raise InputError(f"there is no model {name!r}; choose {names} or give an .onnx file")
