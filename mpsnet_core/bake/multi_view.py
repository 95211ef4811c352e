"""Many views: estimates normals from posed photos onto disk, one photo in memory at a time, ready to be baked."""

import hashlib
import json
import logging
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.sizes import check_same_size
from mpsnet_core.arrays.upsample import chosen_pixels, reduced_shape
from mpsnet_core.bake.colour_matching import matched
from mpsnet_core.bake.inputs import ViewReader
from mpsnet_core.bake.projection import View
from mpsnet_core.bake.view_agreement import Agreement
from mpsnet_core.bake.view_fit import warn_of_misfit
from mpsnet_core.capture.capture import Capture, capture_of, corrected_and_masked, warn_of_doubts, with_white
from mpsnet_core.capture.masks import mask_identity
from mpsnet_core.capture.reading import AS_STATED, Reading
from mpsnet_core.capture.transfer_curve import warn_of_doubtful_curve
from mpsnet_core.errors import FileError, GeometryError
from mpsnet_core.estimate.albedo import albedo_from_white, read_albedo
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.io.files import prefix_errors
from mpsnet_core.io.image import Image
from mpsnet_core.io.image_layers import layer_in
from mpsnet_core.io.image_reading import read_size
from mpsnet_core.io.image_writing import write_image
from mpsnet_core.io.photo_folder import PhotoFolder
from mpsnet_core.io.provenance import identity, is_up_to_date, provenance_line
from mpsnet_core.progress import Progress, part
from mpsnet_core.scene.camera import Camera, camera_data
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.mesh_depth import depth_of_mesh
from mpsnet_core.scene.normal_map import NormalMap, read_normals, write_normals
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.scene.rig import LightRig
from mpsnet_core.scene.view_photos import ViewPhoto

log = logging.getLogger(__name__)

# A mask from the mesh is ray cast at up to this many pixels on the longer side.
MASK_PIXELS = 2048


@dataclass(frozen=True)
class Photography:
    """How the photos of all views are read.

    rig_of: the lights in a camera's space. mask: "mesh" (where the camera sees the mesh), a folder of masks that have
    the photos' names, with or without the suffix _mask, or what :func:`read_capture` takes. reading: how images are
    read. white: folders of photos under white light that have the photos' names, with or without the suffix _white;
    the photos of several folders are added up.
    """

    rig_of: Callable[[Camera], LightRig]
    mask: str = "mesh"
    reading: Reading = AS_STATED
    white: Sequence[str] = ()

    @cached_property
    def masks(self) -> PhotoFolder | None:
        """The folder of masks, None if masks do not come from a folder."""
        return PhotoFolder(self.mask, "masks") if self.mask != "mesh" and Path(self.mask).is_dir() else None

    @cached_property
    def white_folders(self) -> list[PhotoFolder]:
        return [PhotoFolder(folder, "white photos") for folder in self.white]

    def white_of(self, view: ViewPhoto) -> list[Path]:
        """The view's photos under white light, one from each folder. Raises FileError if a folder has none."""
        return [_beside(view, folder, "white", "white photo") for folder in self.white_folders]

    def mask_of(self, view: ViewPhoto) -> str:
        """The source of the view's mask for :func:`read_capture`.

        In a folder of masks, that is the file at the photo's relative path, else the one with the view's or the photo's
        name. Raises FileError if the folder has none, or several match.
        """
        if self.mask == "mesh":
            return "none"
        if self.masks is None:
            return self.mask
        return os.fspath(_beside(view, self.masks, "mask", "mask"))

    def capture(self, view: ViewPhoto, scene: RayScene, *, rig_checked: bool = False) -> Capture:
        """The view's photo without lens distortion. rig_checked: see :func:`warn_of_doubts`.

        Raises InputError, which names the view, if it cannot be read.
        """
        with prefix_errors(f"view {view.name}"):
            capture = self._capture(view, scene)
        warn_of_doubts(capture, f"view {view.name}", rig_checked=rig_checked)
        return capture

    def _capture(self, view: ViewPhoto, scene: RayScene) -> Capture:
        image = self.reading.photo(view.photo)
        rig = self.rig_of(view.camera)
        image, mask = corrected_and_masked(image, rig, self.mask_of(view), self.reading)
        if view.lens is not None:
            from mpsnet_core.scene.photogrammetry import undistorted_mask

            mask = undistorted_mask(mask, view.camera, view.lens)
        image = _straightened(image, view)
        if self.mask == "mesh":
            if mask.shape == (view.camera.height, view.camera.width):
                mask = mask & mesh_mask(view.camera, scene)
            if not mask.any():
                raise GeometryError("its camera does not see the mesh; do the cameras and the mesh share one world?")
        depth = depth_of_mesh(view.camera, scene) if rig.near is not None else None
        warn_of_doubtful_curve(view.photo.name, image, mask, rig)
        capture = capture_of(image, mask, rig, view.camera, depth)
        if not self.white:
            return capture
        straightened = partial(_straightened, view=view)
        return with_white(capture, self.white_of(view), self.reading, straightened=straightened)


def check_photos(views: Sequence[ViewPhoto], photography: Photography) -> None:
    """Raise InputError, which names the view, if a photo is no image or its size differs from its camera's.

    Only the files' headers are read.
    """
    for view in views:
        camera, layer = (view.camera.height, view.camera.width), photography.reading.layer
        with prefix_errors(f"view {view.name}"):
            photos = {"the photo": (view.photo, layer)}
            photos |= {f"white photo {file}": (file, layer_in(file, layer)) for file in photography.white_of(view)}
            for what, photo in photos.items():
                size = read_size(*photo)
                if size is not None:
                    check_same_size("the camera", camera, what, size)


def _beside(view: ViewPhoto, folder: PhotoFolder, ending: str, what: str) -> Path:
    """The view's image in a folder: the one at the photo's relative path, else the one with the view's or the photo's
    name, with or without the suffix _`ending`. Raises FileError if there is none, or several match."""
    photo, top = view.photo, folder.path
    for within, stem in ((top / view.folder, photo.stem), (top, view.name), (top, photo.stem)):
        stems = [stem, f"{stem}_{ending}", f"{stem}{photo.suffix}"]
        found = folder.find(stems, f"the {what} of photo {photo.name}", within)
        if found:
            return found
    raise FileError(f"photo {photo.name} has no {what} {photo.stem} in {top}; put it there")


def _straightened(image: Image, view: ViewPhoto) -> Image:
    """A view's image without lens distortion."""
    if view.lens is None:
        return image
    from mpsnet_core.scene.photogrammetry import undistorted, undistorted_mask

    pixels = undistorted(image.pixels, view.camera, view.lens)
    clip, clipped = image.clip, image.clipped
    if clipped is not None or np.isfinite(clip):
        # Resampled pixels that a clipped one contributed to are wrong, although they are below the clipping value.
        whole = undistorted_mask(~np.any(image.saturated, axis=-1), view.camera, view.lens)
        clip, clipped = np.inf, np.broadcast_to(~whole[..., None], pixels.shape)
    return replace(image, pixels=pixels, alpha=None, clip=clip, clipped=clipped)


def mesh_mask(camera: Camera, scene: RayScene) -> NDArray[np.bool_]:
    """(H, W) bool: the pixels in which the camera sees the mesh. Large images are sampled in blocks of a few pixels."""
    small = reduced_shape(camera.height, camera.width, MASK_PIXELS)
    rows, columns = chosen_pixels(*small, camera.height, camera.width)
    pixels = np.stack(np.meshgrid(columns + 0.5, rows + 0.5), axis=-1).reshape(-1, 2)
    origins, directions, _ = scene.rays_of(camera, pixels)
    seen = np.isfinite(scene.distances(origins, directions)).reshape(small)
    mask: NDArray[np.bool_] = seen[np.ix_(*chosen_pixels(camera.height, camera.width, *small))]
    return mask


@dataclass(frozen=True)
class KeptView:
    """One view's estimated normals and confidence on disk, and its albedo if it is `coloured`.

    The files' descriptions record the inputs that they were made from.
    """

    folder: Path
    name: str
    coloured: bool = False

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

    def is_of(self, source: str) -> bool:
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


def sources_of(views: Sequence[ViewPhoto], photography: Photography, mesh: Mesh, recipe: str) -> list[str]:
    """For each view a line that changes with everything its normals depend on: photo, camera, rig, mask and settings.

    The mesh is included if masks or depth come from it. recipe: fingerprint of the settings that all views share: the
    model, how photos are read, dark frame and flat field.

    Raises InputError, which names the view, if a mask is missing, two views would share one from a folder, or a light
    is behind the object.
    """
    shape, whose, sources = _shape(mesh), dict[str, str](), []
    for view in views:
        with prefix_errors(f"view {view.name}"):
            mask = photography.mask_of(view)
            if photography.masks and whose.setdefault(mask, view.name) != view.name:
                raise FileError(f"its mask would be that of view {whose[mask]}, {mask}; name one {view.name}")
            sources.append(_source(view, photography, mask, shape, recipe))
    return sources


def _source(view: ViewPhoto, photography: Photography, mask: str, shape: str, recipe: str) -> str:
    rig = photography.rig_of(view.camera)
    needs_mesh = photography.mask == "mesh" or rig.near is not None
    return provenance_line(
        "normals",
        recipe,
        identity(view.photo),
        json.dumps(camera_data(view.camera)),
        repr(view.lens),
        json.dumps([rig.directions.tolist(), rig.mixing.tolist(), repr(rig)]),
        photography.mask if photography.mask == "mesh" else mask_identity(mask),
        shape if needs_mesh else "",
        *map(identity, photography.white_of(view)),
    )


def _shape(mesh: Mesh) -> str:
    """Fingerprint of the triangles in world space: of what a camera can see of a mesh."""
    digest = hashlib.sha256(np.ascontiguousarray(mesh.world_vertices).data)
    digest.update(np.ascontiguousarray(mesh.triangles).data)
    return digest.hexdigest()


class KeptViews(Sequence[View]):
    """Views whose normals are on disk. Each access reads a view and levels it against the mesh.

    shares: how much of each base map's relief each view shows, known once the view was read. gains: (V, 3) factors on
    the views' colours.
    """

    def __init__(
        self, kept: Sequence[KeptView], cameras: Sequence[Camera], mesh: Mesh, scene: RayScene, reader: ViewReader
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
        return matched(self.both(number)[1], self.gains[number])

    def both(self, number: int) -> tuple[View, View, float]:
        """A view as estimated, the same view levelled (unchanged without levelling), and the mean angle in degrees."""
        view, known = self.kept[number].read(self.cameras[number]), self._shares.get(number)
        if known is None:
            warn_of_misfit(self.kept[number].name, view, self.mesh, self.scene)
        estimated, levelled, angle, found = self.reader.prepared(view, self.mesh, self.scene, known)
        self._shares[number] = found
        return estimated, levelled, angle


def estimate_views(
    views: Sequence[ViewPhoto],
    sources: Sequence[str],
    photography: Photography,
    estimator: Estimator,
    stored: KeptViews,
    agreed: Agreement,
    *,
    progress: Progress,
) -> int:
    """Estimate and store each view's normals, except those that are stored already. Returns the number of these.

    sources: from :func:`sources_of`. agreed: receives every view.

    Raises InputError, which names the view, if its photo cannot be read.
    """
    known = 0
    for number, (view, source) in enumerate(zip(views, sources, strict=True)):
        named = f"view {number + 1} of {len(views)}: {view.name}"
        step = part(progress, number / len(views), (number + 1) / len(views))
        step(0.0, named)
        kept = stored.kept[number]
        if kept.is_of(source):
            known += 1
        else:
            capture = photography.capture(view, stored.scene, rig_checked=number > known)
            kept.write(capture, estimator(capture, part(step, 0.1, 0.8, named)), source)
        agreed.add(view.name, *stored.both(number))
    return known
