"""Lens distortion; undistorted photos and masks."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.resampling import bilinear
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.sizes import check_same_size
from mpsnet_core.arrays.types import F32, F64, I64, Bools, Floats
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.files import PHOTO_SUFFIXES, is_file
from mpsnet_core.io.frames import PhotoFolder
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image_reading import read_orientation
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.camera import AS_SOLVED, Camera

# Rows at a time: each of their pixels takes about 200 bytes of memory. More rows are no faster.
ROWS = 32

Matrix = tuple[tuple[float, float], tuple[float, float]]

# Samples of the distance from the axis to find where the distortion stops growing.
_REACH_STEPS = 4096


@dataclass(frozen=True)
class Lens:
    """Brown's distortion model, as COLMAP, OpenCV, Metashape and AliceVision fit it to lenses.

    Raises
    ------
    GeometryError
        If a coefficient is not finite.

    Notes
    -----
    A point that a pinhole camera projects to p = (x, y), in focal lengths from the optical axis, x right and y down,
    appears at A d through this lens, where r is the length of p and ::

        d = p (1 + radial[0] r² + radial[1] r⁴ + ...) / (1 + divisor[0] r² + ...) + tangential r² + 2 (tangential·p) p

    D. C. Brown, "Decentering Distortion of Lenses", Photogrammetric Engineering 32(3), 1966.

    Examples
    --------
    >>> Lens(radial=(-0.2,)).distorted([0.5, 0.0]).tolist()
    [0.475, 0.0]
    """

    radial: tuple[float, ...] = ()
    """Any number of coefficients: k1, k2, k3, k4."""
    divisor: tuple[float, ...] = ()
    """Any number of coefficients of the divisor: k4, k5, k6 of OpenCV's full model."""
    tangential: tuple[float, float] = (0.0, 0.0)
    """OpenCV's (p2, p1), which are Metashape's (p1, p2)."""
    affinity: Matrix = ((1.0, 0.0), (0.0, 1.0))
    """2 x 2. Rows of the matrix A, for pixels that are not square or not at right angles; the identity by default."""

    def __post_init__(self) -> None:
        if not np.isfinite([*self.radial, *self.divisor, *self.tangential, *chain(*self.affinity)]).all():
            raise GeometryError("the lens has a coefficient that is not finite; calibrate it again")

    @property
    def is_identity(self) -> bool:
        """Whether the lens has no distortion."""
        return not any((*self.radial, *self.divisor, *self.tangential)) and self.affinity == Lens.affinity

    def distorted(self, points: ArrayLike) -> F64:
        """Distorted points (..., 2) of the image plane, in focal lengths from the axis, y down."""
        x, y = np.moveaxis(np.asarray(points, np.float64), -1, 0)
        square = x * x + y * y
        scale = _polynomial(self.radial, square) / _polynomial(self.divisor, square)
        (right, down), ((xx, xy), (yx, yy)) = self.tangential, self.affinity
        scale = scale + 2 * (right * x + down * y)
        bent_x, bent_y = x * scale + right * square, y * scale + down * square
        return np.stack([xx * bent_x + xy * bent_y, yx * bent_x + yy * bent_y], axis=-1)

    def reach(self, limit: float) -> float:
        """Distance from the axis, in focal lengths and at most `limit`, up to which the distortion is monotonic.

        Beyond it, a polynomial that was fitted inside the photo would show the photo's edge again, mirrored.
        """
        distance = np.linspace(0, limit, _REACH_STEPS)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            shown = distance * _polynomial(self.radial, distance**2) / _polynomial(self.divisor, distance**2)
            turned = ~(np.diff(shown) > 0)
        return float(distance[turned.argmax()]) if turned.any() else limit


def photo_points(points: ArrayLike, camera: Camera, lens: Lens) -> F64:
    """Positions in the photo of image points of the pinhole camera.

    Parameters
    ----------
    points : (..., 2) array_like
        Pixels of the undistorted image.
    camera : Camera
    lens : Lens

    Returns
    -------
    (..., 2) float64 array
        Pixels of the photo.
    """
    plane = (np.asarray(points, np.float64) - camera.centre) / camera.focal
    return lens.distorted(plane) * camera.focal + camera.centre


@takes_files
def undistorted(image: Floats, camera: Camera, lens: Lens) -> F32:
    """Undistort a photo to the image of the pinhole camera, by bilinear interpolation.

    Parameters
    ----------
    image : (H, W) or (H, W, C) array
        The photo, linear, of the camera's size.
    camera : Camera
    lens : Lens

    Returns
    -------
    float32 array of the same shape
        0 outside the photo; `image` itself if the lens has no distortion.

    Raises
    ------
    GeometryError
        If photo and camera differ in size.

    Notes
    -----
    Saturated pixels are blended with their neighbours and can no longer be recognised: see :func:`undistorted_mask`.
    """
    image = np.asarray(image, np.float32)
    check_same_size("the photo", image.shape[:2], "its camera", (camera.height, camera.width), AS_SOLVED)
    if lens.is_identity:
        return image
    photo = image.reshape(*image.shape[:2], -1)
    straight = np.zeros_like(photo)
    for rows, inside, x, y in _sources(camera, lens):
        straight[rows][inside] = bilinear(photo, x, y, np.float32)
    return straight.reshape(image.shape)


def undistorted_mask(mask: Bools, camera: Camera, lens: Lens) -> Bools:
    """Undistort a photo's mask: True for the pixels that :func:`undistorted` interpolates from the mask alone.

    Parameters
    ----------
    mask : (H, W) bool array
        For example the unsaturated pixels, of the camera's size.
    camera : Camera
    lens : Lens

    Returns
    -------
    (H, W) bool array
        False outside the photo.

    Raises
    ------
    GeometryError
        If mask and camera differ in size.
    """
    mask = np.asarray(mask, bool)
    check_same_size("the photo", mask.shape[:2], "its camera", (camera.height, camera.width), AS_SOLVED)
    if lens.is_identity:
        return mask
    straight = np.zeros_like(mask)
    for rows, inside, x, y in _sources(camera, lens):
        straight[rows][inside] = bilinear(mask, x, y) == 1
    return straight


def _sources(camera: Camera, lens: Lens) -> Iterator[tuple[slice, Bools, F64, F64]]:
    """For some rows at a time: which pixels show the photo, and the columns and rows there that they show."""
    shape = (int(camera.height), int(camera.width))
    size = np.array(shape[::-1])
    corners = (np.array([[0, 0], [1, 0], [0, 1], [1, 1]]) * size - camera.centre) / camera.focal
    reach = lens.reach(float(np.linalg.norm(corners, axis=1).max()))
    for rows in bands(shape[0], ROWS):
        pixels = np.stack(np.meshgrid(np.arange(shape[1]) + 0.5, np.arange(shape[0])[rows] + 0.5), axis=-1)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # where a divisor is zero
            points = photo_points(pixels, camera, lens)
        square = (((pixels - camera.centre) / camera.focal) ** 2).sum(axis=-1)
        inside = ((points >= 0) & (points <= size)).all(axis=-1) & (square <= reach**2)
        yield rows, inside, *points[inside].T


def _polynomial(coefficients: tuple[float, ...], square: F64) -> Any:
    """1 + c0 s + c1 s² + ..."""
    value: Any = 0.0
    for coefficient in reversed(coefficients):
        value = (value + coefficient) * square
    return 1 + value


# ----------------------------------------------------------------------------------------------------------------------
# A photo's camera and lens from photogrammetry, in the project's conventions, and the photo's file.


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
    return left @ right


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
    focal, pose = np.abs(turn @ camera.focal), camera.world_from_camera @ roll.T
    turned_lens = Lens(lens.radial, lens.divisor, (right, down), (tuple(affinity[0]), tuple(affinity[1])))
    return PosedPhoto(posed.photo, Camera(camera.projection, width, height, focal, centre, pose), turned_lens)
