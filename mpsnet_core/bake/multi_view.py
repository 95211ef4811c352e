"""The work of ``views``: normals of posed photos on disk, one photo in memory at a time, and their textures."""

import hashlib
import json
import logging
import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.sizes import check_same_size
from mpsnet_core.bake import texture_files, view_agreement
from mpsnet_core.bake.bake import bake_texture_sets
from mpsnet_core.bake.base_maps import log_shares
from mpsnet_core.bake.inputs import ViewReader
from mpsnet_core.bake.operations import BakeViews, ViewsBaked
from mpsnet_core.bake.projection import FEATHER, View
from mpsnet_core.bake.report import texture_maps, view_table, write_bake_report
from mpsnet_core.capture.capture import Capture
from mpsnet_core.capture.decode import AS_STATED, PhotoReadOptions
from mpsnet_core.capture.masks import mask_identity
from mpsnet_core.capture.open import MESH, PhotoSet, Source
from mpsnet_core.capture.operations import ReadsPhotos
from mpsnet_core.errors import FileError
from mpsnet_core.estimate.albedo import albedo_from_white, read_albedo
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.estimate.operations import RunsModel
from mpsnet_core.io import files as disk
from mpsnet_core.io.frames import PhotoFolder
from mpsnet_core.io.html_page import page_path
from mpsnet_core.io.image_reading import layer_in, read_size
from mpsnet_core.io.image_writing import write_image
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.provenance import fingerprint, is_up_to_date, operation_facts, provenance_line
from mpsnet_core.progress import Progress, part
from mpsnet_core.scene.camera import Camera, camera_data
from mpsnet_core.scene.mesh import Mesh, join_meshes
from mpsnet_core.scene.normal_map import NormalMap, read_normals, write_normals
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.scene.rig import LightRig, read_rig, read_world_lights
from mpsnet_core.scene.texture import Texture
from mpsnet_core.scene.texture_sets import TextureSet
from mpsnet_core.scene.view_photos import ViewPhoto, camera_files, posed_photos

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ViewCaptureSettings:
    """How the photos of all views are read."""

    rig_of: Callable[[Camera], LightRig]
    """The lights in a camera's space."""
    mask: str = MESH
    """A folder of masks named like the photos, with or without the suffix _mask; "mesh", where the camera sees the
    mesh; or what :func:`mpsnet_core.read_capture` takes."""
    options: PhotoReadOptions = AS_STATED
    """How photos are read."""
    white: Sequence[str] = ()
    """Folders of photos under white light, named like the photos, with or without the suffix _white. The photos of
    several folders are added up."""

    @cached_property
    def masks(self) -> PhotoFolder | None:
        """The folder of masks, None if masks do not come from a folder."""
        return PhotoFolder(self.mask, "masks") if self.mask != MESH and Path(self.mask).is_dir() else None

    @cached_property
    def white_folders(self) -> list[PhotoFolder]:
        return [PhotoFolder(folder, "white photos") for folder in self.white]

    def white_of(self, view: ViewPhoto) -> list[Path]:
        """The view's photos under white light, one from each folder. Raises FileError if a folder has none."""
        return [_companion_image(view, folder, "white", "white photo") for folder in self.white_folders]

    def mask_of(self, view: ViewPhoto) -> str:
        """The source of the view's mask for :func:`read_capture`.

        In a folder of masks, that is the file at the photo's relative path, else the one with the view's or the photo's
        name. Raises FileError if the folder has none, or several match.
        """
        if self.masks is None:
            return self.mask
        return os.fspath(_companion_image(view, self.masks, "mask", "mask"))

    def source(self, view: ViewPhoto, scene: RayScene) -> Source:
        """The view's photo, to be opened."""
        facts = self.rig_of(view.camera), self.mask_of(view), f"view {view.name}", view.camera, view.lens
        return Source(view.photo, *facts, scene=scene, white=self.white_of(view))


def _companion_image(view: ViewPhoto, folder: PhotoFolder, ending: str, what: str) -> Path:
    """The view's image in a folder: the one at the photo's relative path, else the one with the view's or the photo's
    name, with or without the suffix _`ending`. Raises FileError if there is none, or several match."""
    photo, top = view.photo, folder.path
    for within, stem in ((top / view.folder, photo.stem), (top, view.name), (top, photo.stem)):
        stems = [stem, f"{stem}_{ending}", f"{stem}{photo.suffix}"]
        found = folder.find(stems, f"the {what} of photo {photo.name}", within)
        if found:
            return found
    raise FileError(f"photo {photo.name} has no {what} {photo.stem} in {top}; put it there")


@dataclass(frozen=True)
class CachedView:
    """One view's estimated normals, confidence and albedo on disk.

    The files' descriptions record the inputs that they were made from.
    """

    folder: Path
    """Folder of the files."""
    name: str
    """Name of the view, with which the files' names begin."""
    coloured: bool = False
    """Whether there is an albedo."""

    @property
    def normals(self) -> Path:
        return self.folder / f"{self.name}_normals.png"

    @property
    def confidence(self) -> Path:
        return self.folder / f"{self.name}_confidence.png"

    @property
    def albedo(self) -> Path:
        return self.folder / f"{self.name}_albedo.exr"

    @property
    def files(self) -> list[Path]:
        return [self.normals, self.confidence, *([self.albedo] if self.coloured else [])]

    def is_made_from(self, source: str) -> bool:
        """Whether all files exist, are complete, and were made from `source`, a line of :func:`sources_of`."""
        return all(is_up_to_date(file, source) for file in self.files)

    def write(self, capture: Capture, normals: NormalMap, source: str) -> None:
        """Write the files. capture: the photo that the normals were estimated from."""
        write_normals(self.normals, normals, description=source)
        write_image(self.confidence, normals.confidence, description=source)
        if self.coloured:
            albedo = np.concatenate([albedo_from_white(capture, normals), capture.mask[..., None]], axis=-1)
            write_image(self.albedo, albedo, bits=16, color_space="lin_rec709_scene", description=source)

    def read(self, camera: Camera) -> View:
        """Read the view as it was estimated."""
        normals = read_normals(self.normals, confidence=self.confidence)
        return View(camera, normals, read_albedo(self.albedo) if self.coloured else None)


def sources_of(
    views: Sequence[ViewPhoto], photography: ViewCaptureSettings, mesh: Mesh, settings_fingerprint: str
) -> list[str]:
    """For each view a line that changes with everything its normals depend on: photo, camera, rig, mask and settings.

    The mesh is included if masks or depth come from it. settings_fingerprint: of the settings that all views share: the
    model, how photos are read, dark frame and flat field.

    Raises InputError, which names the view, if a mask is missing, two views would share one from a folder, a light is
    behind the object, or a white photo cannot be read or has another size than its camera, by its header.
    """
    shape, owners, sources = _shape(mesh), dict[str, str](), []
    for view in views:
        with disk.prefix_errors(f"view {view.name}"):
            mask = photography.mask_of(view)
            if photography.masks and owners.setdefault(mask, view.name) != view.name:
                raise FileError(f"its mask would be that of view {owners[mask]}, {mask}; add one named {view.name}")
            sources.append(_source(view, photography, mask, shape, settings_fingerprint))
    return sources


def _source(view: ViewPhoto, photography: ViewCaptureSettings, mask: str, shape: str, settings_fingerprint: str) -> str:
    rig = photography.rig_of(view.camera)
    needs_mesh = photography.mask == MESH or rig.near is not None
    white = photography.white_of(view)
    for file in white:
        size = read_size(file, layer_in(file, photography.options.layer))
        camera = view.camera.height, view.camera.width
        check_same_size("the camera", camera, f"white photo {file}", size or camera)
    return provenance_line(
        "normals",
        settings_fingerprint,
        fingerprint(view.photo),
        json.dumps(camera_data(view.camera)),
        repr(view.lens),
        json.dumps([rig.directions.tolist(), rig.mixing.tolist(), repr(rig)]),
        photography.mask if photography.mask == MESH else mask_identity(mask),
        shape if needs_mesh else "",
        *map(fingerprint, white),
    )


def _shape(mesh: Mesh) -> str:
    """Fingerprint of the triangles in world space: of what a camera can see of a mesh."""
    digest = hashlib.sha256(np.ascontiguousarray(mesh.world_vertices).data)
    digest.update(np.ascontiguousarray(mesh.triangles).data)
    return digest.hexdigest()


class CachedViews(Sequence[View]):
    """Views whose normals are on disk. Each access reads a view and levels it against the mesh.

    shares: how much of each base map's relief each view shows, known once the view was read. gains: (V, 3) factors on
    the views' colours.
    """

    def __init__(
        self, kept: Sequence[CachedView], cameras: Sequence[Camera], mesh: Mesh, scene: RayScene, reader: ViewReader
    ) -> None:
        self.kept, self.cameras, self.mesh, self.scene, self.reader = kept, cameras, mesh, scene, reader
        self.gains = np.ones((len(kept), 3), np.float32)
        self._shares: dict[int, Sequence[float]] = {}

    @property
    def shares(self) -> list[Sequence[float]]:
        return list(self._shares.values())

    def __len__(self) -> int:
        return len(self.kept)

    def __getitem__(self, number: int) -> View:  # type: ignore[override]  # nothing takes slices
        return view_agreement.matched(self.both(number)[1], self.gains[number])

    def both(self, number: int) -> tuple[View, View, float]:
        """A view as estimated, the same view levelled (unchanged without levelling), and the mean angle in degrees."""
        view, known = self.kept[number].read(self.cameras[number]), self._shares.get(number)
        if known is None:
            view_agreement.warn_of_misfit(self.kept[number].name, view, self.mesh, self.scene)
        estimated, levelled, correction, found = self.reader.prepared(view, self.mesh, self.scene, known)
        self._shares[number] = found
        return estimated, levelled, 0.0 if correction is None else correction.mean_angle


def estimate_views(
    views: Sequence[ViewPhoto],
    sources: Sequence[str],
    photography: ViewCaptureSettings,
    estimator: Estimator,
    stored: CachedViews,
    agreed: view_agreement.Agreement,
    *,
    progress: Progress,
) -> int:
    """Estimate and store each view's normals, except those that are stored already. Returns the number of these.

    sources: from :func:`sources_of`. agreed: receives every view.

    Raises InputError, which names the view, if its photo cannot be read.
    """
    known = 0
    photos = PhotoSet([photography.source(view, stored.scene) for view in views], photography.options)
    for number, (view, source) in enumerate(zip(views, sources, strict=True)):
        named = f"view {number + 1} of {len(views)}: {view.name}"
        step = part(progress, number / len(views), (number + 1) / len(views))
        step(0.0, named)
        kept = stored.kept[number]
        if kept.is_made_from(source):
            known += 1
        else:
            capture = photos.open(photos.sources[number])
            kept.write(capture, estimator(capture, part(step, 0.1, 0.8, named)), source)
        agreed.add(view.name, *stored.both(number))
    return known


def bake_views(options: BakeViews, progress: Progress) -> ViewsBaked:
    """Write the textures, and report and figures if requested."""
    # Check as much as possible before the long work.
    baking, level = texture_files.bake_settings(options, FEATHER), options.level_scale()
    target = texture_files.texture_target(options)
    inputs, outputs = _checked_files(options, target.output)
    photography = _photography(options)
    views = posed_photos(options.cameras, options.photos, layer=options.layer)
    photos = [photo for view in views for photo in (view.photo, *photography.white_of(view))]
    disk.check_no_overwrite(photos, outputs)
    kept_files = [file for view in _cached(options, views, options.keep) for file in view.files] if options.keep else []
    for file in kept_files:
        disk.check_own(file)
    disk.check_no_overwrite([*inputs, *photos, *outputs], kept_files)
    progress(0.0, "reading the mesh")
    plan = texture_files.planned(options, target, [*inputs, *photos, *map(Path, outputs[1:]), *kept_files])
    mesh = join_meshes(plan.meshes)
    settings_fingerprint = operation_facts(options, RunsModel, ReadsPhotos, **options.model_facts(options.passes))
    sources = sources_of(views, photography, mesh, settings_fingerprint)
    scene = RayScene.of(mesh)
    estimator = options.estimator(options.passes)
    with nullcontext(options.keep) if options.keep else disk.temporary_folder() as folder:
        if options.keep:
            disk.remove_abandoned(disk.ensure_folder(options.keep, "normals of the views"))
        reader = ViewReader(level, plan.base_maps.in_photos(), agreed=options.agreed)
        kept = _cached(options, views, folder)
        stored = CachedViews(kept, [view.camera for view in views], mesh, scene, reader)
        agreed = view_agreement.agreement(mesh, scene, FEATHER)
        step = part(progress, 0.02, 0.72)
        known = estimate_views(views, sources, photography, estimator, stored, agreed, progress=step)
        log_shares(stored.shares)
        if options.white:
            stored.gains = view_agreement.colour_gains(agreed.colours)
        baked = bake_texture_sets(plan.meshes, stored, plan.texture_sets, baking, progress=part(progress, 0.72, 1.0))
        table = agreed.views(stored.gains.tolist() if options.white else None)
        view_agreement.warn_of_doubts(table)
        how = f"levelled at {level:g} of the mesh's size" if level else "not levelled"
        before = f"; {known} kept from before" if known else ""
        return _written(
            options, plan, baked, table, estimator.name, f"{len(views)} view(s) by {estimator.name}, {how}{before}"
        )


def _checked_files(options: BakeViews, output: str) -> tuple[list[Path], list[str]]:
    """The files that are read, except photos, and those that are written. Raises InputError if one would overwrite
    another, or its folder cannot be written."""
    if options.report:
        page_path(options.report)
    if options.json:
        disk.writable_path(options.json)
    outputs = [file for file in (output, options.report, options.json) if file]
    mask = None if options.mask == MESH else options.mask
    inputs = [*camera_files(options.cameras), *options.inputs(options.rig, *options.mesh, options.onto, mask=mask)]
    disk.check_no_overwrite(inputs, outputs)
    return inputs, outputs


def _photography(options: BakeViews) -> ViewCaptureSettings:
    if options.lights_in == "world":
        rig_of = read_world_lights(options.rig).seen_by
    else:
        rig = read_rig(options.rig)

        def rig_of(camera: Camera) -> LightRig:
            return rig

    return ViewCaptureSettings(rig_of, options.mask, options.read_options(), options.white)


def _cached(options: BakeViews, views: Sequence[ViewPhoto], folder: AnyPath) -> list[CachedView]:
    return [CachedView(Path(folder), view.name, bool(options.white)) for view in views]


def _written(
    options: BakeViews,
    plan: texture_files.BakePlan,
    baked: Iterable[tuple[TextureSet, Texture]],
    table: Sequence[view_agreement.ViewAgreement],
    model: str,
    summary: str,
) -> ViewsBaked:
    """Write textures, report and figures: all of them or none."""
    written, maps = [], []
    with disk.write_transaction():
        for texture_set, one, texture in texture_files.write_textures(plan, baked):
            written.append(one)
            if options.report:
                maps += texture_maps(texture, texture_set.named)
            del texture
        text = texture_files.format_textures(options, plan.target, written)
        result = ViewsBaked(
            plan.target.output,
            written,
            *texture_files.checked_shares(options, written),
            view_agreement.table_rows(table),
            options.level_scale(),
            model,
            text="\n".join([view_table(table), summary, text]),
        )
        if options.report:
            write_bake_report(options.report, Path(plan.target.output).name, maps, table, [text, summary])
        if options.json:
            disk.write_json(options.json, result.metrics("views", "seen", "filled", "level", "model"))
    return result
