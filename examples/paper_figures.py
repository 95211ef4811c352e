"""Draw figures 5, 6 and 8 of the MPS-Net paper again, with the networks of this package.

    python examples/paper_figures.py --merl fits.npz --meshes meshes --diligent pmsData

Leaves three files in output:

    figure_5.svg    one blob under each measured material: the error of each network
    figure_6.png    meshes of one and of several materials: normals and errors
    figure_8.png    errors on DiLiGenT's objects, with the paper's figure

Leave out an option, and its figure is left out. All three take a quarter of an hour of a core, most of it for the
patch-wise MPS-Net.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpsnet_core import InputError
from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.learning.evaluation.evaluation import Evaluation
from mpsnet_core.learning.evaluation.measure import Result, measure
from mpsnet_core.learning.evaluation.operations import EvaluateDiligent, EvaluateMaterials, EvaluateRendered
from mpsnet_core.learning.evaluation.published import PUBLISHED_LIGHTS, TABLE_2
from mpsnet_core.learning.evaluation.report import HIGHEST_ERROR, case_picture
from mpsnet_core.scene.pictures import BACKGROUND, colour_scale, contact_sheet, cropped, error_picture

OUTPUT = Path(__file__).resolve().parent / "output"
MODELS = ("lambertian", "demultiplexer", "psfcn", "mpsnet", "multiscale")
BLOB_SIZE, MESH_SIZE, TILE = 96, 128, 240  # pixels
LIGHTS = PUBLISHED_LIGHTS[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--merl", default="", help="measured materials: MERL's folder, or the .npz of fits to it")
    parser.add_argument("--meshes", type=Path, help="mesh files")
    parser.add_argument("--diligent", type=Path, help="DiLiGenT's pmsData")
    given = parser.parse_args()
    if not (given.merl or given.meshes or given.diligent):
        parser.error("nothing to draw: give --merl, --meshes or --diligent")
    OUTPUT.mkdir(exist_ok=True)
    try:
        if given.merl:
            (OUTPUT / "figure_5.svg").write_text(figure_5(given.merl), encoding="utf-8")
        if given.meshes:
            save("figure_6.png", figure_6(given.meshes, given.merl))
        if given.diligent:
            save("figure_8.png", figure_8(given.diligent))
    except InputError as error:
        raise SystemExit(f"paper_figures: {error}") from None


def figure_5(merl: str) -> str:
    """The chart of the materials' errors."""
    materials = EvaluateMaterials(merl=merl, size=BLOB_SIZE).evaluation()
    rows = [row for results in measured(materials) for row in materials.rows(results)]
    print(materials.table(rows))
    return materials.charts(rows)[0]


def figure_6(meshes: Path, merl: str) -> NDArray[np.float32]:
    """One view of each mesh, of one and of several materials: normals and errors of each network."""
    rendered = EvaluateRendered(mesh=(str(meshes),), merl=merl, views=1, size=MESH_SIZE).evaluation()
    pictures = [case_picture(results) for results in measured(rendered)]
    width = max(picture.shape[1] for picture in pictures)
    missing = [[(0, 0), (0, width - one.shape[1]), (0, 0)] for one in pictures]
    return np.concatenate(
        [np.pad(one, wide, constant_values=BACKGROUND) for one, wide in zip(pictures, missing, strict=True)]
    )


def figure_8(root: Path) -> NDArray[np.float32]:
    """Errors on DiLiGenT's objects: a row for each, a column for each network."""
    tiles = []
    lights = ",".join(map(str, LIGHTS))
    objects = EvaluateDiligent(folder=str(root), lights=(lights,), protocol=("published",)).evaluation()
    for results in measured(objects):
        case = results[0].case
        pictures = [error_picture(one.error.astype(np.float64), case.scored, HIGHEST_ERROR) for one in results]
        paper = {"mpsnet": f", the paper's {TABLE_2[LIGHTS][case.labels['object']]:.1f}°"}
        titles = [f"{one.model} {one.mae_deg:.1f}°{paper.get(one.model, '')}" for one in results]
        tiles += list(zip(titles, cropped(pictures, case.scored), strict=True))
        tiles.append(("degrees", colour_scale(HIGHEST_ERROR, TILE)))
    return contact_sheet(tiles, len(MODELS) + 1, TILE)


def measured(evaluation: Evaluation) -> Iterator[list[Result]]:
    for results in measure(evaluation.cases, MODELS):
        print(results[0].case.title)
        yield results


def save(name: str, picture: NDArray[np.float32]) -> None:
    write_picture(OUTPUT / name, picture)
    print(f"wrote {OUTPUT / name}")


if __name__ == "__main__":
    main()
