"""Photos with their cameras, from photogrammetry or from the project's own files."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mpsnet_core.errors import FileError, SettingsError
from mpsnet_core.io.files import check_no_overwrite, ensure_folder, prefix_errors, write_transaction
from mpsnet_core.io.frames import PhotoFolder
from mpsnet_core.io.image import Image, warn_of_saturation
from mpsnet_core.io.image_reading import read_image, read_size
from mpsnet_core.io.image_writing import write_photo
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.progress import Progress
from mpsnet_core.scene import operations
from mpsnet_core.scene.camera import AS_SOLVED, Camera, camera_for, read_camera, write_camera
from mpsnet_core.scene.photogrammetry.posed_photo import undistorted, undistorted_mask
from mpsnet_core.scene.view_files import read_views

if TYPE_CHECKING:
    from mpsnet_core.scene.photogrammetry.posed_photo import Lens

log = logging.getLogger(__name__)

# Number of missing photos that a warning names.
NAMED_PHOTOS = 3
CAMERA_SUFFIX = ".camera.json"
COLMAP_SUFFIXES = (".bin", ".txt")


def camera_files(cameras: AnyPath) -> list[Path]:
    """The files that :func:`posed_photos` may read cameras from: the given file, or the camera files in a folder."""
    path = Path(cameras)
    if not path.is_dir():
        return [path]
    return [file for file in path.rglob("*") if file.name.endswith((CAMERA_SUFFIX, *COLMAP_SUFFIXES))]


@dataclass(frozen=True)
class ViewPhoto:
    """A photo and its camera."""

    name: str
    """Name that is unique among the views, for messages and files."""
    photo: Path
    """The photo's file."""
    camera: Camera
    """Its pinhole camera."""
    lens: "Lens | None" = None
    """The photo's distortion; None if there is none."""
    folder: Path = Path()
    """Folder of the photo, relative to the folder of all photos."""


def posed_photos(cameras: AnyPath, photos: AnyPath | None = None, *, layer: str | None = None) -> list[ViewPhoto]:
    """Photos with their cameras, sorted by name. A camera of another size than its photo is scaled, with a note.

    Parameters
    ----------
    cameras : path-like
        Cameras of a photogrammetry program (:func:`mpsnet_core.read_cameras`); a folder of camera files,
        NAME.camera.json for the photo NAME.png; or a file that lists the photos as well ("mpsnet-views", which the
        add-on writes).
    photos : path-like, optional
        Folder of the photos, required unless `cameras` lists them.
    layer : str, optional
        Of the photos, if they are EXRs with several.

    Returns
    -------
    list of ViewPhoto
        Cameras of photogrammetry without a photo are left out, with a warning.

    Raises
    ------
    FileError
        If a file, or the photo of a camera file, is missing, or several photos match a camera.
    FormatError, GeometryError
        If the cameras are malformed, or a photo is not an image or differs from its camera in aspect ratio.
    SettingsError
        If `photos` is required but missing.
    """
    cameras = Path(cameras)
    if photos is None:
        if cameras.suffix.lower() != ".json":
            raise SettingsError(f"{cameras} does not name its photos; give the folder of the photos")
        found = [ViewPhoto(*view) for view in read_views(cameras)]
    else:
        folder = PhotoFolder(photos)
        own = sorted(cameras.glob(f"[!.]*{CAMERA_SUFFIX}")) if cameras.is_dir() else []
        found = [_own_photo(file, folder) for file in own] if own else _photogrammetry_photos(cameras, folder)
    for what, names in (("called", [view.name for view in found]), ("in", [str(view.photo) for view in found])):
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice:
            raise FileError(f"{cameras} has two cameras for photos {what} {twice}; rename one of the photos")
    return [_fitted(view, layer) for view in found]


def _fitted(view: ViewPhoto, layer: str | None) -> ViewPhoto:
    with prefix_errors(f"view {view.name}"):
        size = read_size(view.photo, layer)
        camera = size and camera_for(view.camera, size[1], size[0], AS_SOLVED)
    return replace(view, camera=camera or view.camera)


def _own_photo(camera: Path, photos: PhotoFolder) -> ViewPhoto:
    name = camera.name.removesuffix(CAMERA_SUFFIX)
    photo = photos.find([name], f"the photo of camera {camera.name}")
    if photo is None:
        raise FileError(f"camera {camera.name} has no photo {name} in {photos.path}; put it there")
    return ViewPhoto(name, photo, read_camera(camera))


def _photogrammetry_photos(cameras: Path, photos: PhotoFolder) -> list[ViewPhoto]:
    from mpsnet_core.scene.photogrammetry import read_cameras
    from mpsnet_core.scene.photogrammetry.colmap import NO_MODEL, model_in
    from mpsnet_core.scene.photogrammetry.posed_photo import as_displayed, find_photo

    if cameras.is_dir() and model_in(cameras) is None:
        raise FileError(
            f"folder {cameras} holds no file NAME{CAMERA_SUFFIX} for a photo called NAME, and {NO_MODEL}; choose the "
            "folder that holds one of them, or rename the camera files like their photos"
        )
    views, missing = [], []
    for posed in read_cameras(cameras):
        photo = find_photo(posed, photos)
        if photo is None:
            missing.append(posed.photo)
            continue
        posed = as_displayed(posed, photo)
        # Photos in different subfolders may have the same name.
        place = photo.relative_to(photos.path)
        lens = None if posed.lens.is_identity else posed.lens
        views.append(ViewPhoto("_".join(place.with_suffix("").parts), photo, posed.camera, lens, place.parent))
    if not views:
        raise FileError(f"none of the {len(missing)} photos of {cameras}, such as {missing[0]}, is in {photos.path}")
    if missing:
        named = ", ".join(missing[:NAMED_PHOTOS]) + (", ..." if len(missing) > NAMED_PHOTOS else "")
        log.warning("%d camera(s) have no photo in %s and are left out: %s", len(missing), photos.path, named)
    return views


def write_cameras(options: operations.WriteCameras, progress: Progress) -> operations.CamerasWritten:
    """Write a camera file for each photo, and the undistorted photo if its lens has distortion."""
    views = posed_photos(options.cameras, options.photos)
    folder = ensure_folder(options.output, "cameras")
    check_no_overwrite([view.photo for view in views], [folder / f"{view.name}.exr" for view in views])
    corrected_photos = 0
    for number, view in enumerate(views):
        progress(number / len(views), view.name)
        camera = folder / f"{view.name}{CAMERA_SUFFIX}"
        if view.lens is None:
            write_camera(camera, view.camera)
            continue
        _undistort(options, view, camera, folder / f"{view.name}.exr")
        corrected_photos += 1
    progress(1.0, "done")
    lenses = f", {corrected_photos} photo(s) undistorted" if corrected_photos else ", without distortion"
    names, text = [f"{view.name}{CAMERA_SUFFIX}" for view in views], f"{folder}: {len(views)} camera(s){lenses}"
    return operations.CamerasWritten(str(folder), names, corrected_photos, text=text)


def _undistort(options: operations.WriteCameras, view: ViewPhoto, camera: Path, photo: Path) -> None:
    """Write the camera and the undistorted photo, both or neither."""
    assert view.lens is not None
    with prefix_errors(view.photo):
        image = read_image(view.photo, encoding=options.encoding)
        warn_of_saturation(view.photo, image)
        pixels = undistorted(image.pixels, view.camera, view.lens)
        shown = np.ones(image.pixels.shape[:2], bool) if image.alpha is None else image.alpha > 0.5
        alpha = undistorted_mask(shown, view.camera, view.lens)
    with write_transaction():
        write_camera(camera, view.camera)
        write_photo(photo, Image(pixels, alpha.astype(np.float32), np.inf, assumed=image.assumed), bits=16)
