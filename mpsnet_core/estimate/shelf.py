"""The model shelf: which models there are by name. Light to import; no model is loaded here."""

import os
from dataclasses import dataclass
from pathlib import Path

from mpsnet_core.errors import InputError

LAMBERTIAN = "lambertian"
LAMBERTIAN_GREY_WORLD = "lambertian-grey-world"
DEFAULT_MODEL = LAMBERTIAN

SHELF = Path(__file__).parent / "models"


@dataclass(frozen=True)
class ShelfEntry:
    """A model that can be asked for by name; file is None for what needs no network."""

    name: str
    title: str
    file: Path | None = None


def shelf() -> list[ShelfEntry]:
    """All models that come with the package, the baselines first."""
    baselines = [
        ShelfEntry(LAMBERTIAN, "The baseline, at once: a matt surface of one grey (equation 2 of the paper)"),
        ShelfEntry(
            LAMBERTIAN_GREY_WORLD,
            "The baseline for a matt surface of one colour: each channel is divided by its own mean first",
        ),
    ]
    return baselines + [ShelfEntry(file.stem, "network", file) for file in sorted(SHELF.glob("*.onnx"))]


def find_model(name: str | os.PathLike[str]) -> Path:
    """The ONNX file of a model given by name or by path. Raises InputError where there is none."""
    name = os.fspath(name)
    on_shelf = {entry.name: entry.file for entry in shelf()}
    file = on_shelf.get(name)
    if file is not None:
        return file
    if Path(name).suffix.lower() == ".onnx":
        if Path(name).is_file():
            return Path(name)
        raise InputError(f"model file {name} does not exist; check the path")
    raise InputError(f"there is no model {name!r}; choose {', '.join(on_shelf)} or give an .onnx file")
