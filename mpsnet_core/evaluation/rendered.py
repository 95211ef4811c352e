"""Rendered: meshes from files, of one and of several materials, as in figure 6 of the paper."""

import os
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.evaluation.diligent import protocol_weights
from mpsnet_core.evaluation.evaluation import Evaluation
from mpsnet_core.evaluation.measure import Case
from mpsnet_core.evaluation.published import FIGURE_6
from mpsnet_core.evaluation.scenes import HELD_OUT_SEED, SIZE, ideal_photograph, published_view
from mpsnet_core.evaluation.tables import table_of_means
from mpsnet_core.synthesis.drawing import HELD_OUT, draw_recipe
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.recipe import Material, Pattern
from mpsnet_core.synthesis.reflectance import load_reflectance, material_names
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes.meshes import load_mesh, mesh_files
from mpsnet_core.synthesis.shapes.shape import turn_about

SEVERAL = 4  # materials
VIEWS = 2
ELEVATION, FIRST_TURN = 15.0, 20.0  # degrees
MAX_VIEWS = 360


class Rendered(Evaluation):
    """Meshes, each seen from all around, once of one material and once of several in a pattern, synthesised.

    paths: mesh files, or folders of them. merl: where measured materials are taken from, every fifth of them, which
    training can leave out; "" for principled ones. views: of each mesh. Views and materials are the same every time.

    Raises InputError where a file is missing or there are no meshes or materials.
    """

    title = "Rendered meshes"

    def __init__(
        self,
        paths: Sequence[str | os.PathLike[str]],
        *,
        merl: str | os.PathLike[str] = "",
        protocols: Sequence[str] = ("published",),
        views: int = VIEWS,
        size: int = SIZE,
    ) -> None:
        if not 1 <= views <= MAX_VIEWS:
            raise InputError(f"{views} views of a mesh cannot be shown; choose 1 to {MAX_VIEWS}")
        for protocol in protocols:
            protocol_weights(protocol)
        source = os.fspath(merl)
        self.measured = bool(source)
        pictures = [(file, view) for file in _files(paths) for view in range(views)]
        self.cases = [
            partial(_case, file, view, 360 * view / views, count, number, source, protocol, size)
            for number, (file, view) in enumerate(pictures)
            for count in (1, SEVERAL)
            for protocol in protocols
        ]

    def table(self, rows: Sequence[dict[str, Any]]) -> str:
        """A line for each protocol and model, a column for each mesh with one and with several materials."""
        named = [{**row, "picture": f"{row['object']}, {row['materials']}"} for row in rows]
        return table_of_means(named, ("protocol", "model"), "picture")

    def published(self, rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
        """Figure 6, which shows other meshes."""
        return [{"model": "MPS-Net", "mae_deg": error, "source": "Figure 6"} for error in FIGURE_6]

    def notes(self, rows: Sequence[dict[str, Any]]) -> list[str]:
        """What was photographed, and what the paper found on its own."""
        figure = ", ".join(f"{error:.2f}" for error in FIGURE_6)
        kind = "every fifth of the measured ones, or of fits to them" if self.measured else "principled materials"
        return [
            f"of one and of {SEVERAL} materials: {kind}; one bounce of light, three point lights, orthographic",
            f"paper, on other meshes than these: MPS-Net {figure} (figure 6 of Ju et al. 2019)",
        ]


def _files(paths: Sequence[str | os.PathLike[str]]) -> list[Path]:
    files: list[Path] = []
    for path in map(Path, paths):
        files += [path / name for name in mesh_files(path)] if path.is_dir() else [path]
    for file in files:
        if not file.is_file():
            raise InputError(f"the mesh file or folder {file} does not exist; check the path")
    return files


def _case(file: Path, view: int, turn: float, count: int, number: int, merl: str, protocol: str, size: int) -> Case:
    sample = _sample(file, turn, count, number, merl, size)
    labels = {
        "object": file.stem,
        "view": view + 1,
        "materials": "one" if count == 1 else "several",
        "protocol": protocol,
    }
    return Case(labels, ideal_photograph(sample, protocol), sample.normals)


@lru_cache(maxsize=1)
def _sample(file: Path, turn: float, count: int, number: int, merl: str, size: int) -> Sample:
    materials = _materials(number, count, merl)
    recipe = published_view(
        {"kind": "meshes", "seed": HELD_OUT_SEED, "pose": "upright", "files": [file.name], "deformed": False},
        materials,
        size,
        _standing(FIRST_TURN + turn),
        pattern=Pattern("voronoi" if number % 2 else "noise", scale=2.5, seed=number),
        bounces=1,
    )
    return synthesise(recipe, load_mesh(str(file)), [load_reflectance(material, merl) for material in materials])


def _standing(turn: float) -> NDArray[np.float64]:
    """The object's z upwards in the picture, seen from a little above, turned about it."""
    return turn_about((1, 0, 0), ELEVATION - 90).T @ turn_about((0, 0, 1), turn).T


def _materials(number: int, count: int, merl: str) -> tuple[Material, ...]:
    """Materials of picture `number`: no two of a picture's alike, where they are measured."""
    if merl:
        names = material_names(merl)[::HELD_OUT]
        rng = np.random.Generator(np.random.PCG64([HELD_OUT_SEED, number]))
        chosen = rng.permutation(len(names))[np.arange(count) % len(names)]
        return tuple(Material(kind=names[place][0], source=names[place][1]) for place in chosen)
    job = SampleJob("synthesis", 1, seed=HELD_OUT_SEED)
    return tuple(draw_recipe(job, SEVERAL * number + place).materials[0] for place in range(count))
