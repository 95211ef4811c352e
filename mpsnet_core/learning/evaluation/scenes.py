"""Scenes of the synthetic tests: photographs of held-out shapes under the published rig.

Jobs draw the seeds of their shapes below 2^62 (:func:`mpsnet_core.synthesis.random_sampling.new_seed`), whatever the
job's seed. The seeds here are above that: no training data contains these shapes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from mpsnet_core.arrays.types import F32, F64
from mpsnet_core.capture.capture import Capture
from mpsnet_core.errors import FileError, GeometryError
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.learning.evaluation.diligent import PROTOCOLS
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rig import LightRig, published_rig
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import Material, Pattern, SceneDescription
from mpsnet_core.synthesis.shading.synthesise import synthesise
from mpsnet_core.synthesis.shapes import Shape, build_shape
from mpsnet_core.synthesis.shapes.meshes import load_mesh, mesh_files
from mpsnet_core.synthesis.shapes.shape import turn_about

ELEVATION, FIRST_TURN = 15.0, 20.0  # degrees, of views of meshes
HELD_OUT_SEED = 1 << 62
NO_PATTERN = Pattern()
DISTANCE = 10.0
HIGHLIGHTS = 0.01  # share of the pixels that are brighter than 1
MARGIN = 1.02  # half the image width, in radii of the object's bounding sphere


def held_out_blob(number: int = 0) -> dict[str, Any]:
    """The description of a smooth blob that is in no training data."""
    return {"kind": "blobs", "seed": HELD_OUT_SEED + number, "pose": "any", "character": "smooth"}


@lru_cache(maxsize=1)
def built_blob(number: int) -> Shape:
    """The shape of :func:`held_out_blob`."""
    return build_shape(held_out_blob(number))


def published_view(
    shape: dict[str, Any],
    materials: tuple[Material, ...],
    size: int,
    rotation: F64 | None = None,
    *,
    pattern: Pattern = NO_PATTERN,
    bounces: int = 0,
) -> SceneDescription:
    """Scene of an orthographic view under the paper's rig: three point lights, slant 30°, tilts 120° apart."""
    pose = np.eye(4)
    pose[2, 3] = DISTANCE
    return SceneDescription(
        seed=HELD_OUT_SEED,
        number=0,
        shape=shape,
        rotation=np.eye(3) if rotation is None else rotation,
        camera=Camera("orthographic", size, size, np.full(2, size / (2 * MARGIN)), np.full(2, size / 2), pose),
        light_directions=published_rig().directions,
        light_sizes=np.zeros(3),
        materials=materials,
        pattern=pattern,
        bounces=bounces,
    )


def ideal_photograph(sample: Sample, protocol: str, *, white: bool = False) -> Capture:
    """Photograph a sample without noise or calibration errors, with colours weighted by the protocol.

    protocol: a key of :data:`mpsnet_core.learning.evaluation.diligent.PROTOCOLS`; "separated" is an ideal rig,
    "published" the paper's multiplexed images. white: whether to add a photo under all three lights, turned white.
    Raises GeometryError if no light reaches the object.
    """
    weights = PROTOCOLS[protocol].astype(np.float32)

    def channel(number: int, light: F32) -> F32:
        # Not a matrix product, whose order of summation differs between machines.
        return np.asarray(sum(weights[number, j] * light[..., j] for j in range(3)))

    image = np.stack([channel(k, sample.lights[k]) for k in range(3)], axis=-1)
    seen = image.max(axis=-1)[sample.mask]
    bright = float(np.quantile(seen, 1 - HIGHLIGHTS, method="higher")) if len(seen) else 0.0
    if bright <= 0:
        raise GeometryError("no pixel shows the object completely, or no light reaches it; take another sample")
    rig = LightRig(sample.recipe.light_directions, is_ground_truth=True)
    beside = np.stack([channel(k, sample.lights.sum(axis=0)) for k in range(3)], axis=-1) if white else None
    return Capture(image * np.float32(1 / bright), sample.mask, rig, white=beside)


@dataclass(frozen=True)
class MeshView:
    """A view of a mesh file."""

    file: Path
    """The mesh file."""
    number: int
    """Number of the view, from 1."""
    turn: float
    """Rotation about the vertical axis in degrees."""

    @property
    def labels(self) -> dict[str, str | int]:
        """Mesh and view, for rows."""
        return {"object": self.file.stem, "view": self.number}

    def recipe(
        self, materials: tuple[Material, ...], size: int, *, pattern: Pattern = NO_PATTERN, bounces: int = 0
    ) -> SceneDescription:
        """Scene of the view: the mesh's z is up, and the camera looks slightly down. See :func:`published_view`."""
        standing = turn_about((1, 0, 0), ELEVATION - 90).T @ turn_about((0, 0, 1), self.turn).T
        shape = {"kind": "meshes", "seed": HELD_OUT_SEED, "pose": "upright", "files": [self.file.name]}
        shape["deformed"] = False
        return published_view(shape, materials, size, standing, pattern=pattern, bounces=bounces)

    def sample(self, recipe: SceneDescription, merl: str = "") -> Sample:
        """The recipe's sample. merl: path of measured materials. Raises InputError if the mesh is damaged."""
        reflectances = [load_reflectance(material, merl) for material in recipe.materials]
        return synthesise(recipe, load_mesh(str(self.file)), reflectances)


def mesh_views(paths: Sequence[AnyPath], views: int) -> list[MeshView]:
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
