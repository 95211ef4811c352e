"""Cameras from photogrammetry: COLMAP, Metashape and AliceVision (Meshroom), with their lenses.

:func:`read_cameras` reads the files of any of them. In :mod:`.posed_photo`, :func:`~.posed_photo.find_photo` finds the
photos, :func:`~.posed_photo.as_displayed` rotates a camera by the photo's EXIF orientation, and
:func:`~.posed_photo.undistorted` removes the lens distortion.
"""

from pathlib import Path

from mpsnet_core.errors import FormatError
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.photogrammetry.alicevision import read_alicevision
from mpsnet_core.scene.photogrammetry.colmap import read_colmap
from mpsnet_core.scene.photogrammetry.metashape import read_metashape
from mpsnet_core.scene.photogrammetry.posed_photo import PosedPhoto

_COLMAP = dict.fromkeys((".bin", ".txt", ""), read_colmap)
_READERS = {".xml": read_metashape, ".sfm": read_alicevision, ".json": read_alicevision, **_COLMAP}


def read_cameras(path: AnyPath) -> list[PosedPhoto]:
    """The posed photos of a photogrammetry program, sorted by the photos' names.

    Parameters
    ----------
    path : path-like
        The folder of a COLMAP model (or of a project with sparse/0) or one of its files; a Metashape .xml; an
        AliceVision (Meshroom) .sfm or .json.

    Returns
    -------
    list of PosedPhoto
        World axes and scale are those of the meshes that the same program exports.

    Raises
    ------
    FileError
        If the file is missing.
    FormatError
        If it is damaged, not of one of these kinds, or without posed photos.
    GeometryError
        If a pose is not rigid, or a value cannot be a camera's.
    """
    path = Path(path)
    reader = read_colmap if path.is_dir() else _READERS.get(path.suffix.lower())
    if reader is None:
        raise FormatError(
            f"{path} is not a supported file of cameras: name a COLMAP folder, a Metashape .xml (File > Export "
            "> Export Cameras) or Meshroom's cameras.sfm"
        )
    photos = sorted(reader(path), key=lambda posed: posed.photo)
    if not photos:
        raise FormatError(f"{path} holds no photo with a pose; align the photos and export the cameras again")
    return photos
