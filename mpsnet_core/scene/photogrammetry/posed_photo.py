"""A photo's camera and lens from photogrammetry, in the project's conventions, and the photo's file."""

from dataclasses import dataclass
from pathlib import Path, PureWindowsPath

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.types import F64, I64
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.files import PHOTO_SUFFIXES, is_file
from mpsnet_core.io.image_reading import read_orientation
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.photo_folder import PhotoFolder
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.photogrammetry.lens import Lens

# Cameras of photogrammetry look along +z with y down, ours along -z with y up.
FLIP_YZ = np.diag([1.0, -1.0, -1.0])

# Largest entry of R Rᵀ - I for a rotation R in a file. It accepts rounding to four digits, but no scale or shear.
ROTATION_TOLERANCE = 1e-3

# Rotation on the image plane (x right, y down) from the stored photo to the displayed one, for each EXIF orientation
# without mirroring.
_TURNS: dict[int, I64] = {
    1: np.array([[1, 0], [0, 1]]),
    3: np.array([[-1, 0], [0, -1]]),
    6: np.array([[0, -1], [1, 0]]),
    8: np.array([[0, 1], [-1, 0]]),
}


@dataclass(frozen=True, eq=False)
class PosedPhoto:
    """A photo's camera and lens."""

    photo: str
    """Its name or path in the camera file."""
    camera: Camera
    """The pinhole camera, in the world space of that file's own mesh."""
    lens: Lens
    """The distortion from that camera's image to the photo."""


def rotation(values: ArrayLike, what: str) -> F64:
    """The rotation nearest to `values`, nine numbers in row-major order. what: its owner, for messages.

    Raises GeometryError if it is not near, or a value is not finite.
    """
    matrix = np.asarray(values, np.float64).reshape(3, 3)
    # The first bound keeps the product finite, and rejects NaN.
    if not (np.abs(matrix) < 2).all() or np.abs(matrix @ matrix.T - np.eye(3)).max() > ROTATION_TOLERANCE:
        raise GeometryError(f"the rotation of {what} is not a rotation matrix; export the cameras again")
    left, _, right = np.linalg.svd(matrix)
    if np.linalg.det(left @ right) < 0:
        raise GeometryError(f"the rotation of {what} is a mirroring; export the cameras again, without mirrored axes")
    nearest: F64 = left @ right
    return nearest


def photogrammetry_camera(
    width: int, height: int, focal: ArrayLike, centre: ArrayLike, turn: ArrayLike, position: ArrayLike
) -> Camera:
    """A pinhole camera from a photogrammetry program's parameters.

    focal, centre: (2,) pixels. turn: (3, 3) rotation from its camera space (x right, y down, z forward) to the world.
    position: (3,) in the world. Raises GeometryError if a value cannot be a camera's.
    """
    pose = np.eye(4)
    pose[:3, :3] = np.asarray(turn) @ FLIP_YZ
    pose[:3, 3] = position
    return Camera("perspective", width, height, np.asarray(focal), np.asarray(centre), pose)


def find_photo(posed: PosedPhoto, photos: PhotoFolder) -> Path | None:
    """The file of a photo: at its relative path, else by its name, else by its stem with any photo's suffix.

    Parameters
    ----------
    posed : PosedPhoto
        If its path leads elsewhere, the longest trailing part that is a file in the folder is used.
    photos : PhotoFolder

    Returns
    -------
    Path or None
        The raw file with that stem, if there is one next to the photo; None if no file matches.

    Raises
    ------
    FileError
        If several files match.
    """
    # Accepts both kinds of slash. No part may lead out of the folder.
    path = PureWindowsPath(posed.photo)
    parts = [part for part in path.parts if part not in (path.anchor, "..", ".")]
    places = [photos.path.joinpath(*parts[start:]) for start in range(len(parts))]
    for place in places:
        if is_file(place):
            return photos.find([place.stem], f"photo {posed.photo!r}", place.parent, raw_only=True) or place
    for place in places:
        # Metashape omits suffixes, so a name with a dot may be a stem.
        stems = [place.name, *([place.stem] if place.suffix.lower() in PHOTO_SUFFIXES else [])]
        found = photos.find(stems, f"photo {posed.photo!r}", place.parent)
        if found:
            return found
    return None


def as_displayed(posed: PosedPhoto, file: AnyPath) -> PosedPhoto:
    """`posed` rotated as :func:`mpsnet_core.read_image` rotates the photo in `file` by its EXIF orientation.

    Photogrammetry programs use photos as they are stored, not as they are displayed.

    Parameters
    ----------
    posed : PosedPhoto
    file : path-like
        The photo.

    Raises
    ------
    FileError, FormatError
        If the file cannot be read.
    GeometryError
        If it is stored mirrored, which no camera pose can undo.
    """
    orientation = read_orientation(file)
    if orientation not in _TURNS:
        raise GeometryError(f"{file} is stored mirrored (EXIF orientation {orientation}); save it again as it is shown")
    return turned(posed, orientation)


def turned(posed: PosedPhoto, orientation: int) -> PosedPhoto:
    """A photo's camera and lens after the photo is rotated by an EXIF orientation.

    Parameters
    ----------
    posed : PosedPhoto
    orientation : {1, 3, 6, 8}
        None, by 180°, by 90° clockwise, by 90° counter-clockwise.
    """
    if orientation == 1:
        return posed
    turn, camera, lens = _TURNS[orientation], posed.camera, posed.lens
    size = np.array([camera.width, camera.height])
    width, height = np.abs(turn @ size).tolist()
    # The rotated image's smallest x and y become 0.
    centre = turn @ camera.centre - np.minimum(turn @ size, 0)
    roll = np.eye(4)
    roll[:2, :2] = [[turn[0, 0], -turn[0, 1]], [-turn[1, 0], turn[1, 1]]]  # the same rotation with y up
    right, down = (turn @ lens.tangential).tolist()
    affinity = (turn @ np.array(lens.affinity) @ turn.T).tolist()
    return PosedPhoto(
        posed.photo,
        Camera(
            camera.projection, width, height, np.abs(turn @ camera.focal), centre, camera.world_from_camera @ roll.T
        ),
        Lens(lens.radial, lens.divisor, (right, down), (tuple(affinity[0]), tuple(affinity[1]))),
    )
