"""Inputs of a bake: meshes, and each view's camera and normal map, for one pose or for each frame of a sequence."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mpsnet_core.bake.base_maps import BaseMap, log_shares, remove_base_details
from mpsnet_core.bake.low_frequency_correction import (
    LowFrequencyCorrection,
    apply_low_frequency_correction,
    find_low_frequency_correction,
)
from mpsnet_core.bake.projection import View
from mpsnet_core.bake.view_agreement import warn_of_misfit
from mpsnet_core.defaults import Convention
from mpsnet_core.errors import FileError
from mpsnet_core.estimate.albedo import read_albedo
from mpsnet_core.io.files import prefix_errors
from mpsnet_core.io.frames import is_folder_or_pattern, matching_files, numbering
from mpsnet_core.io.metadata import content_fingerprint
from mpsnet_core.io.provenance import fingerprint
from mpsnet_core.progress import Progress
from mpsnet_core.scene.camera import read_camera
from mpsnet_core.scene.mesh import Mesh, join_meshes
from mpsnet_core.scene.normal_directions import check_directions
from mpsnet_core.scene.normal_map import read_normals
from mpsnet_core.scene.rays import RayScene

log = logging.getLogger(__name__)

# A mesh of which a smaller share is taken lacks shapes that the photo shows.
UNLIKE = 0.15


@dataclass(frozen=True)
class ViewInputs:
    """The files of a view."""

    camera: Path
    """Camera file."""
    normals: Path
    """Normal map in camera space."""
    confidence: Path | None = None
    """Confidence map, if there is one."""
    albedo: Path | None = None
    """Albedo, if there is one."""

    @property
    def files(self) -> list[Path]:
        return [file for file in (self.camera, self.normals, self.confidence, self.albedo) if file]


@dataclass(frozen=True)
class BakeInputs:
    """The files of one bake."""

    meshes: tuple[Path, ...]
    """Mesh files."""
    views: tuple[ViewInputs, ...]
    """The files of each view."""

    @property
    def files(self) -> list[Path]:
        return [*self.meshes, *(file for view in self.views for file in view.files)]

    def facts(self) -> list[str]:
        """Fingerprints of the meshes, cameras and normal maps.

        Those of meshes and cameras are of their content, because Blender writes the files anew for every run.
        """
        hashed_files = [*self.meshes, *(view.camera for view in self.views)]
        return [*map(content_fingerprint, hashed_files), *(fingerprint(view.normals) for view in self.views)]


@dataclass(frozen=True)
class ViewReader:
    """Reads views and prepares them to be baked."""

    correction_scale: float
    """Scale of the low-frequency correction as a fraction of the mesh's size, 0 for none."""
    base_maps: Sequence[BaseMap] = ()
    """The mesh's base maps, whose relief is removed from the views (:mod:`mpsnet_core.bake.base_maps`)."""
    convention: Convention = "opengl"
    """Convention of the views' normal maps."""
    agreed: bool = False
    """Whether the correction is limited to what the view's expected error explains."""

    def read(
        self,
        inputs: Sequence[ViewInputs],
        meshes: Sequence[Mesh],
        progress: Progress,
        known: Sequence[Sequence[float]] | None = None,
    ) -> tuple[list[View], list[Sequence[float]]]:
        """The prepared views, and for each the shares of the base maps' relief that were removed from it.

        known: these shares, if they have been estimated before. Otherwise, views that do not fit the mesh are logged.

        Raises InputError, which names the view, if one cannot be read, is not in camera space, or its files differ in
        size.
        """
        whole = join_meshes(meshes)
        scene = RayScene.of(whole)
        views, shares = list[View](), list[Sequence[float]]()
        for number, one in enumerate(inputs):
            progress(number / len(inputs), f"reading {one.normals.name}")
            with prefix_errors(f"view {one.camera}={one.normals}"):
                normals = read_normals(one.normals, convention=self.convention, confidence=one.confidence)
                check_directions(normals, one.normals.name, warned=known is not None)
                view = View(read_camera(one.camera), normals, None if one.albedo is None else read_albedo(one.albedo))
                if known is None:
                    warn_of_misfit(f"{one.camera}={one.normals}", view, whole, scene)
                _, view, correction, found = self.prepared(view, whole, scene, known[number] if known else None)
                if known is None and self.agreed and correction is not None and correction.share < UNLIKE:
                    log.info(
                        "the mesh's large shapes are %.1f° apart from the estimate's, which expects to be %.1f° wrong: "
                        "they stay nearly as estimated; if the mesh is exact, trust it (--level on)",
                        correction.apart,
                        view.normals.expected_error,
                    )
                shares.append(found)
                views.append(view)
        if known is None:
            log_shares(shares)
        return views, shares

    def prepared(
        self, view: View, mesh: Mesh, scene: RayScene, known: Sequence[float] | None = None
    ) -> tuple[View, View, LowFrequencyCorrection | None, Sequence[float]]:
        """The view without the base maps' relief, the same view levelled, its correction if there is one, and the
        shares of the relief that were removed (`known`, if given)."""
        normals, shares = remove_base_details(view.normals, view.camera, mesh, scene, self.base_maps, known)
        estimated = replace(view, normals=normals)
        if not self.correction_scale or (self.agreed and not normals.expected_error):
            return estimated, estimated, None, shares
        how = self.correction_scale, self.agreed
        correction = find_low_frequency_correction(normals, view.camera, mesh, scene, *how)
        levelled = replace(view, normals=apply_low_frequency_correction(normals, correction))
        return estimated, levelled, correction, shares


def frame_inputs(mesh: str, views: Sequence[tuple[str, str]]) -> dict[int, BakeInputs]:
    """The inputs of a sequence by frame number. Files without a number serve all frames.

    mesh: a file, or a folder or pattern of numbered files. views: camera and normal map of each, given in the same way.

    Raises FileError if a pattern matches no sequence, or no frame number is common to all.
    """
    meshes = _by_number(mesh, "mesh")
    pairs = [(_by_number(camera, "camera"), _by_number(normals, "normal map")) for camera, normals in views]
    numbered = [files for pair in pairs for files in pair if isinstance(files, dict)]
    numbers = sorted(set.intersection(*map(set, numbered)))
    if isinstance(meshes, dict):
        numbers = [number for number in numbers if number in meshes]
    if not numbers:
        raise FileError("the frames of all views and meshes have no number in common; check the patterns")
    left_out = max(map(len, numbered)) - len(numbers)
    if left_out:
        log.warning("%d frame(s) are left out: not every view or mesh has their number", left_out)
    found = {}
    for number in numbers:
        views_of = (ViewInputs(_file_of(cameras, number), _file_of(normals, number)) for cameras, normals in pairs)
        found[number] = BakeInputs((_file_of(meshes, number),), tuple(views_of))
    return found


def _by_number(given: str, what: str) -> Path | dict[int, Path]:
    """A file, or the files of a folder or a pattern by the numbers in their names."""
    if not is_folder_or_pattern(given):
        return Path(given)
    files = matching_files(given, what)
    numbered = numbering(files)
    if numbered is None:
        raise FileError(f"the {what}s of {given} are not a sequence: their names may differ in one number only")
    return dict(zip(numbered.numbers, files, strict=True))


def _file_of(files: Path | dict[int, Path], number: int) -> Path:
    return files[number] if isinstance(files, dict) else files
