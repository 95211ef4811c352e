"""Cameras, orthographic or perspective, with their pose; camera files."""

import logging
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.sizes import finite_array
from mpsnet_core.arrays.types import F64, Floats
from mpsnet_core.errors import FormatError, GeometryError, SettingsError
from mpsnet_core.io.files import prefix_errors, read_json, write_json
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.opening import AnyPath

log = logging.getLogger(__name__)

CAMERA_FORMAT = "mpsnet-camera"
CAMERA_VERSION = 1
CAMERA_KEYS = ("projection", "width", "height", "focal", "centre", "world_from_camera")
MAX_SIDE = 1_000_000
# Limits in pixels or pixels per world unit, and in world units: products of such values stay finite.
MAX_VALUE = 1e9
FARTHEST = 1e12
MIN_FOCAL = 1e-6
FULL_FRAME = 36.0  # mm, the longer side of the sensor that 35 mm equivalent focal lengths refer to

# The remedies if a camera and a photo differ in aspect ratio.
THIS_PHOTO = "give the camera of this photo; the photo may have been scaled since, but neither cropped nor turned"
AS_SOLVED = "give the photo as it was in photogrammetry, neither cropped nor turned; for a raw file, its own JPEG"

Projection = Literal["orthographic", "perspective"]


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole or orthographic camera.

    Raises
    ------
    GeometryError
        If a size is not positive or the pose is not rigid.

    Examples
    --------
    >>> camera = Camera("perspective", 640, 480, np.array([800.0, 800.0]))
    >>> x, y, w = camera.projection_rows() @ [0.1, 0, -2, 1]
    >>> float(x / w), float(y / w)
    (360.0, 240.0)
    """

    projection: Projection
    """Kind of projection: "orthographic" or "perspective"."""
    width: int
    """Width of the image, in pixels."""
    height: int
    """Height of the image, in pixels."""
    focal: F64
    """(2,) float64. Along x and y: the focal length in pixels if perspective, the pixels per world unit if
    orthographic."""
    centre: F64 = None  # type: ignore[assignment]  # never None once made
    """(2,) float64. Principal point in pixels; pixel (row r, column c) covers [c, c+1] x [r, r+1] with row 0 on top.
    The image centre by default."""
    world_from_camera: F64 = field(default_factory=lambda: np.eye(4))
    """(4, 4) float64. Rigid pose; the identity by default. Camera axes: x right, y up, z towards the viewer (Blender's
    and OpenGL's)."""

    def __post_init__(self) -> None:
        if self.projection not in ("orthographic", "perspective"):
            raise GeometryError(f'a camera\'s projection is "orthographic" or "perspective", not {self.projection!r}')
        for what, size in (("width", self.width), ("height", self.height)):
            if isinstance(size, bool) or not isinstance(size, int | np.integer) or not 1 <= size <= MAX_SIDE:
                raise GeometryError(f"the camera's {what} must be a whole number of pixels from 1 to {MAX_SIDE}")
        focal = finite_array(self.focal, (2,), "the camera's focal", np.inf)
        if not ((focal >= MIN_FOCAL) & (focal <= MAX_VALUE)).all():
            raise GeometryError(f"the camera's focal in x and in y must be {MIN_FOCAL:g} to {MAX_VALUE:g} pixels")
        middle = np.array([self.width / 2, self.height / 2])
        centre = finite_array(middle if self.centre is None else self.centre, (2,), "the camera's centre", MAX_VALUE)
        pose = finite_array(self.world_from_camera, (4, 4), "the camera's world_from_camera", FARTHEST)
        turn = pose[:3, :3]
        rigid = np.allclose(turn.T @ turn, np.eye(3), atol=1e-4) and np.linalg.det(turn) > 0
        if not rigid or not np.allclose(pose[3], [0, 0, 0, 1]):
            raise GeometryError(
                "the camera's world_from_camera is not a rotation and a translation; remove scale, shear and mirroring"
            )
        for name, value in (("focal", focal), ("centre", centre), ("world_from_camera", pose)):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @property
    def rotation(self) -> F64:
        """(3, 3) rotation from camera space to world space."""
        return self.world_from_camera[:3, :3]

    @property
    def focal_35mm(self) -> float:
        """A perspective camera's 35 mm equivalent focal length, the mean of both, in millimetres."""
        return float(self.focal.mean()) / max(self.width, self.height) * FULL_FRAME

    def resized(self, width: int, height: int) -> "Camera":
        """The same view at another resolution."""
        scale = np.array([width / self.width, height / self.height])
        return replace(self, width=width, height=height, focal=self.focal * scale, centre=self.centre * scale)

    def cropped(self, left: int, top: int, width: int, height: int, factor: int = 1) -> "Camera":
        """The camera of a part of the image, whose blocks of `factor` x `factor` pixels become one pixel each."""
        width, height = -(-width // factor), -(-height // factor)
        centre = (self.centre - (left, top)) / factor
        return replace(self, width=width, height=height, focal=self.focal / factor, centre=centre)

    def projection_rows(self) -> F64:
        """(3, 4) projection matrix P: for a homogeneous world point p, P p is (x w, y w, w) in pixels."""
        camera_from_world = np.linalg.inv(self.world_from_camera)
        (fx, fy), (cx, cy) = self.focal, self.centre
        if self.projection == "orthographic":
            rows = np.array([[fx, 0, 0, cx], [0, -fy, 0, cy], [0, 0, 0, 1.0]])
        else:
            rows = np.array([[fx, 0, -cx, 0], [0, -fy, -cy, 0], [0, 0, -1.0, 0]])
        return rows @ camera_from_world

    def extent(self, points: Floats) -> tuple[slice, slice]:
        """Rows and columns of the image that bound world points (N, 3), at least one of each.

        All of them if a point is beside or behind the camera, where projections are meaningless.
        """
        rows = self.projection_rows()
        x, y, w = rows[:, :3] @ points.T + rows[:, 3:]
        if (w <= 0).any():
            return slice(0, self.height), slice(0, self.width)
        spans = []
        for place, length in ((y / w, self.height), (x / w, self.width)):
            # Two more on each side: points half a pixel outside the image count, and projections are rounded.
            start = int(np.clip(np.floor(place.min()) - 2, 0, length - 1))
            spans.append(slice(start, int(np.clip(np.ceil(place.max()) + 2, start + 1, length))))
        return spans[0], spans[1]

    def depth_row(self) -> F64:
        """(4,) row d: a homogeneous world point's distance in front of the camera along its axis is d·p."""
        return -np.linalg.inv(self.world_from_camera)[2]

    def points(self, depth: Floats, first_row: int = 0) -> F64:
        """(h, W, 3) points in camera space: rows of pixels from `first_row` on, at `depth` (h, W) along the axis."""
        depth = np.asarray(depth, np.float64)
        x = (np.arange(depth.shape[1]) + 0.5 - self.centre[0]) / self.focal[0]
        y = (self.centre[1] - (np.arange(depth.shape[0]) + first_row + 0.5)) / self.focal[1]
        scale = depth if self.projection == "perspective" else np.ones_like(depth)
        return np.stack([x * scale, y[:, None] * scale, -depth], axis=-1)

    def rays(self, points: ArrayLike) -> tuple[F64, F64]:
        """World-space origins and unit directions, each (N, 3), of the rays through image points (N, 2) in pixels."""
        points = np.asarray(points, dtype=np.float64)
        x, y = ((points - self.centre) / self.focal * (1, -1)).T
        zero, one = np.zeros_like(x), np.ones_like(x)
        if self.projection == "orthographic":
            origins, directions = np.stack([x, y, zero], -1), np.stack([zero, zero, -one], -1)
        else:
            origins, directions = np.zeros((len(x), 3)), np.stack([x, y, -one], -1)
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        return origins @ self.rotation.T + self.world_from_camera[:3, 3], directions @ self.rotation.T


def pixel_camera(width: int, height: int) -> Camera:
    """The camera of a photo whose lens is unknown: orthographic, with a pixel as world unit."""
    return Camera("orthographic", width, height, np.ones(2))


def camera_of_lens(focal_length: float, width: int, height: int) -> Camera:
    """A perspective camera at the origin from a 35 mm equivalent focal length, in landscape or portrait format.

    Parameters
    ----------
    focal_length : float
        In millimetres, on a sensor whose longer side is 36 mm.
    width, height : int
        Image size in pixels.

    Raises
    ------
    SettingsError
        If the focal length is not above 0.

    Examples
    --------
    >>> camera_of_lens(50, 4000, 6000).focal.round(1).tolist()
    [8333.3, 8333.3]
    """
    if not (np.isfinite(focal_length) and focal_length > 0):
        raise SettingsError(f"a focal length is a number of millimetres above 0, not {focal_length}")
    return Camera("perspective", width, height, np.full(2, focal_length / FULL_FRAME * max(width, height)))


def camera_for(camera: Camera | float | None, width: int, height: int, remedy: str = THIS_PHOTO) -> Camera | None:
    """The camera of a photo of that size: a camera file's, that of a lens, or None if neither is known.

    camera: of the photo, or of the same photo at another size; a 35 mm equivalent focal length; or None. A camera of
    another size is scaled, which is reported. Raises GeometryError, with the `remedy`, if its aspect ratio is another.
    """
    if not isinstance(camera, Camera):
        return None if camera is None else camera_of_lens(camera, width, height)
    if (camera.width, camera.height) == (width, height):
        return camera
    # Whoever scales a photo rounds its shorter side to whole pixels.
    longer = max(width, height) / max(camera.width, camera.height)
    if max(abs(camera.width * longer - width), abs(camera.height * longer - height)) > 1:
        sizes = f"{camera.width} x {camera.height} but the photo is {width} x {height}"
        raise GeometryError(f"the camera is {sizes}; {remedy}")
    log.info(
        "the camera is for %s x %s pixels and the photo has %s x %s: the camera is scaled; if the photo "
        "was cropped instead, give its own camera",
        camera.width,
        camera.height,
        width,
        height,
    )
    return camera.resized(width, height)


def camera_data(camera: Camera) -> dict[str, Any]:
    """A camera as plain JSON data, the inverse of :func:`camera_from_data`."""
    sizes = {"projection": camera.projection, "width": int(camera.width), "height": int(camera.height)}
    return sizes | {name: getattr(camera, name).tolist() for name in ("focal", "centre", "world_from_camera")}


def camera_from_data(data: dict[str, Any]) -> Camera:
    """A camera from JSON data with at least the keys of :func:`camera_data`. "centre" is optional.

    Raises FormatError if a key is missing, GeometryError if a value cannot be a camera's.
    """
    missing = [key for key in CAMERA_KEYS if key not in data and key != "centre"]
    if missing:
        raise FormatError(f'it lacks "{missing[0]}"; add it')
    return Camera(**{key: data[key] for key in CAMERA_KEYS if key in data})


def read_camera(path: AnyPath) -> Camera:
    """Read a JSON camera file.

    Raises
    ------
    FileError
        If the file is missing.
    FormatError
        If it is not a camera file.
    GeometryError
        If its values cannot be a camera's.
    """
    data = read_json(path, CAMERA_FORMAT, CAMERA_VERSION, CAMERA_KEYS)
    with prefix_errors(f"camera file {path}"):
        return camera_from_data(data)


@takes_files
def write_camera(path: AnyPath, camera: Camera) -> None:
    """Write a JSON camera file atomically.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    write_json(path, {"format": CAMERA_FORMAT, "version": CAMERA_VERSION, **camera_data(camera)})
