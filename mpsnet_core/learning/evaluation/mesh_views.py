"""Views of mesh files: each mesh upright, seen from all sides."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mpsnet_core.errors import FileError
from mpsnet_core.learning.evaluation.scenes import HELD_OUT_SEED, NO_PATTERN, published_view
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import Material, Pattern, SceneDescription
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes.meshes import load_mesh, mesh_files
from mpsnet_core.synthesis.shapes.shape import turn_about

ELEVATION, FIRST_TURN = 15.0, 20.0  # degrees


@dataclass(frozen=True)
class MeshView:
    """A view of a mesh file. number: of the view, from 1. turn: rotation about the vertical axis in degrees."""

    file: Path
    number: int
    turn: float

    @property
    def labels(self) -> dict[str, str | int]:
        """Mesh and view, for rows."""
        return {"object": self.file.stem, "view": self.number}

    def recipe(
        self, materials: tuple[Material, ...], size: int, *, pattern: Pattern = NO_PATTERN, bounces: int = 0
    ) -> SceneDescription:
        """Scene of the view: the mesh's z is up, and the camera looks slightly down. See :func:`published_view`."""
        standing = turn_about((1, 0, 0), ELEVATION - 90).T @ turn_about((0, 0, 1), self.turn).T
        shape = {
            "kind": "meshes",
            "seed": HELD_OUT_SEED,
            "pose": "upright",
            "files": [self.file.name],
            "deformed": False,
        }
        return published_view(shape, materials, size, standing, pattern=pattern, bounces=bounces)

    def sample(self, recipe: SceneDescription, merl: str = "") -> Sample:
        """The recipe's sample. merl: path of measured materials. Raises InputError if the mesh is damaged."""
        return synthesise(
            recipe, load_mesh(str(self.file)), [load_reflectance(material, merl) for material in recipe.materials]
        )


def mesh_views(paths: Sequence[str | os.PathLike[str]], views: int) -> list[MeshView]:
    """`views` views of each mesh. paths: mesh files, or folders of them.

    Raises FileError if a file is missing or a folder has no meshes.
    """
    files: list[Path] = []
    for path in map(Path, paths):
        files += [path / name for name in mesh_files(path)] if path.is_dir() else [path]
    for file in files:
        if not file.is_file():
            raise FileError(f"the mesh file or folder {file} does not exist; check the path")
    return [MeshView(file, view + 1, FIRST_TURN + 360 * view / views) for file in files for view in range(views)]
