"""COLMAP: cameras and images of a sparse model, as text or binary.

https://colmap.github.io/format.html and, for the camera models, https://colmap.github.io/cameras.html
"""

import logging
import math
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.arrays.unit_vectors import quaternion_matrix
from mpsnet_core.errors import FileError, FormatError
from mpsnet_core.io.files import existing_file, prefix_errors
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.photogrammetry.posed_photo import Lens, PosedPhoto, photogrammetry_camera, rotation

log = logging.getLogger(__name__)

# Parameters of the camera models, in the file's order. p1 and p2 are OpenCV's.
_SIMPLE, _PINHOLE = ("f", "cx", "cy"), ("fx", "fy", "cx", "cy")
_OPENCV = (*_PINHOLE, "k1", "k2", "p1", "p2")
_PARAMETERS = {"SIMPLE_PINHOLE": _SIMPLE, "PINHOLE": _PINHOLE, "SIMPLE_RADIAL": (*_SIMPLE, "k1")}
_PARAMETERS |= {"RADIAL": (*_SIMPLE, "k1", "k2"), "OPENCV": _OPENCV, "FULL_OPENCV": (*_OPENCV, "k3", "k4", "k5", "k6")}
# Binary files identify a model by its index here.
# fmt: off
_MODELS = (
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
    "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION",
    "DIVISION", "SIMPLE_FISHEYE", "FISHEYE", "EUCM", "EQUIRECTANGULAR",
)
# fmt: on

NO_MODEL = "no COLMAP model (cameras.bin or cameras.txt, also in sparse/0)"

# Where a model may be in the given folder, in COLMAP's own projects and in the output of its undistorter.
_PLACES = ("", "sparse/0", "sparse", "0")

MAX_FILE_BYTES = 1 << 30
MAX_LINE = 1 << 26
MAX_NAME = 4096


@dataclass(frozen=True)
class _Intrinsics:
    """A camera of COLMAP."""

    width: int
    """Width of the image, in pixels."""
    height: int
    """Height of the image, in pixels."""
    focal: tuple[float, float]
    """Focal lengths along x and y, in pixels."""
    centre: tuple[float, float]
    """Principal point, in pixels."""
    lens: Lens
    """The distortion."""


def read_colmap(path: AnyPath) -> list[PosedPhoto]:
    """The posed photos of a COLMAP sparse model.

    path: its folder, a project's folder (for the model in sparse/0), or one of the files cameras.bin, images.bin,
        cameras.txt and images.txt. Where a folder has both kinds the binary ones are read, as COLMAP does.

    World axes and scale are the model's, as in COLMAP's meshes.

    Raises FileError if files are missing; FormatError if they are damaged or larger than 1 GiB, or a camera is
    none of the models SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV and FULL_OPENCV; GeometryError if a
    value cannot be a camera's.
    """
    cameras, images = _model_files(Path(path))
    for file in (cameras, images):
        if existing_file(file, "COLMAP file").stat().st_size > MAX_FILE_BYTES:
            raise FormatError(f"{file} is larger than 1 GiB; save the model as binary, with only the photos you need")
    if cameras.suffix == ".bin":
        with cameras.open("rb") as source, prefix_errors(cameras):
            intrinsics = _binary_cameras(_Binary(source))
        with images.open("rb") as source, prefix_errors(images):
            return _binary_images(_Binary(source), intrinsics)
    with cameras.open(encoding="utf-8-sig", errors="replace") as text, prefix_errors(cameras):
        intrinsics = _text_cameras(text)
    with images.open(encoding="utf-8-sig", errors="replace") as text, prefix_errors(images):
        return _text_images(text, intrinsics)


def _model_files(path: Path) -> tuple[Path, Path]:
    if path.is_file():
        if path.name not in ("cameras.bin", "images.bin", "cameras.txt", "images.txt"):
            raise FormatError(f"{path} is no file of a COLMAP model; name its folder, or cameras.bin, or cameras.txt")
        return path.with_name(f"cameras{path.suffix}"), path.with_name(f"images{path.suffix}")
    if not path.is_dir():
        raise FileError(f"{path} does not exist; name the folder of a COLMAP model")
    cameras = model_in(path)
    if cameras is None:
        raise FileError(f"folder {path} holds {NO_MODEL}; choose it")
    if cameras.parent.name == "0" and cameras.parent != path and cameras.parent.with_name("1").is_dir():
        log.info("%s holds several models; the first, 0, is read", cameras.parent.parent)
    return cameras, cameras.with_name(f"images{cameras.suffix}")


def model_in(folder: Path) -> Path | None:
    """The file of cameras of the COLMAP model in a folder or a project's folder; None if there is none."""
    places = (folder / place / f"cameras{suffix}" for place in _PLACES for suffix in (".bin", ".txt"))
    return next(filter(Path.is_file, places), None)


def _intrinsics(model: str, width: int, height: int, values: tuple[float, ...]) -> _Intrinsics:
    given = dict(zip(_PARAMETERS[model], values, strict=True))
    get = given.get
    focal = (given["f"],) * 2 if "f" in given else (given["fx"], given["fy"])
    lens = Lens(
        _trimmed(get("k1", 0.0), get("k2", 0.0), get("k3", 0.0)),
        _trimmed(get("k4", 0.0), get("k5", 0.0), get("k6", 0.0)),
        (get("p2", 0.0), get("p1", 0.0)),
    )
    return _Intrinsics(width, height, focal, (given["cx"], given["cy"]), lens)


def _trimmed(*coefficients: float) -> tuple[float, ...]:
    """Coefficients without trailing zeros."""
    used = len(coefficients)
    while used and coefficients[used - 1] == 0:
        used -= 1
    return coefficients[:used]


def _known_model(model: str) -> str:
    if model not in _PARAMETERS:
        raise FormatError(
            f"camera model {model} is not supported ({', '.join(_PARAMETERS)} are); undistort the photos with "
            "COLMAP (image_undistorter) and use its model and photos"
        )
    return model


def _posed(name: str, inside: _Intrinsics, pose: F64) -> PosedPhoto:
    """pose: quaternion w, x, y, z and translation, world to camera."""
    length = math.hypot(*pose[:4])
    if not np.isfinite(pose).all() or abs(length - 1) > 1e-2:
        raise FormatError("its quaternion is not a rotation, or its translation not finite; export the model again")
    w, x, y, z = pose[:4] / length
    camera_from_world = rotation(quaternion_matrix(w, x, y, z), "the photo")
    turn = camera_from_world.T
    camera = photogrammetry_camera(inside.width, inside.height, inside.focal, inside.centre, turn, -turn @ pose[4:])
    return PosedPhoto(name, camera, inside.lens)


def _text_cameras(source: TextIO) -> dict[int, _Intrinsics]:
    cameras = {}
    for number, line in _lines(source):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        with prefix_errors(f"line {number}"):
            try:
                identity, model, width, height = int(words[0]), words[1], int(words[2]), int(words[3])
                values = tuple(float(word) for word in words[4:])
            except (IndexError, ValueError):
                raise FormatError("not CAMERA_ID MODEL WIDTH HEIGHT PARAMS...; export the model again") from None
            wanted = len(_PARAMETERS[_known_model(model)])
            if len(values) != wanted:
                raise FormatError(f"{model} has {wanted} parameters, here are {len(values)}; export the model again")
            cameras[identity] = _intrinsics(model, width, height, values)
    return cameras


def _text_images(source: TextIO, cameras: dict[int, _Intrinsics]) -> list[PosedPhoto]:
    """Read two lines per photo: its pose and name, and its 2D points, which may be none."""
    photos = []
    lines = _lines(source)
    for number, line in lines:
        if not line.strip() or line.startswith("#"):
            continue
        words = line.split(maxsplit=9)
        with prefix_errors(f"line {number}"):
            try:
                pose, camera, name = np.array([float(word) for word in words[1:8]]), int(words[8]), words[9].strip()
            except (IndexError, ValueError):
                raise FormatError("not IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME; export the model again") from None
            photos.append(_posed(name, _camera_of(camera, cameras), pose))
        number, line = next(lines, (0, ""))
        with prefix_errors(f"line {number}"):
            _check_points(line.split())
    return photos


def _check_points(words: list[str]) -> None:
    """Raise FormatError if a line is not X, Y, POINT3D_ID of any number of points: it may belong to the next photo."""
    try:
        whole = len(words) % 3 == 0 and all(math.isfinite(float(word)) for word in words[-3:])
    except ValueError:
        whole = False
    if not whole:
        raise FormatError("not the points of the photo above (X Y POINT3D_ID ..., or empty); export the model again")


def _lines(source: TextIO) -> Iterator[tuple[int, str]]:
    number = 0
    while line := source.readline(MAX_LINE):
        number += 1
        if len(line) == MAX_LINE:
            raise FormatError(f"line {number}: longer than {MAX_LINE >> 20} MiB; export the model again")
        yield number, line


class _Binary:
    """A little-endian file whose counts are checked against the remaining bytes."""

    def __init__(self, source: BinaryIO) -> None:
        self._source, self._left = source, os.fstat(source.fileno()).st_size

    def skip(self, size: int) -> None:
        if size > self._left:
            raise FormatError("it is cut short; copy or export it again")
        self._left -= size
        self._source.seek(size, os.SEEK_CUR)

    def read(self, layout: str) -> tuple[Any, ...]:
        start = self._source.tell()
        self.skip(struct.calcsize(layout))
        self._source.seek(start)
        return struct.unpack(layout, self._source.read(struct.calcsize(layout)))

    def count(self, smallest: int) -> int:
        """Read the number of records of at least `smallest` bytes that follow."""
        (count,) = self.read("<Q")
        if count * smallest > self._left:
            raise FormatError(f"it states {count} records, more than fit into it; copy or export it again")
        return int(count)

    def name(self) -> str:
        """Read text up to a null byte."""
        start = self._source.tell()
        text, zero, _ = self._source.read(MAX_NAME).partition(b"\0")
        if not zero:
            raise FormatError("it holds a photo's name that does not end; copy or export it again")
        self._source.seek(start)
        self.skip(len(text) + 1)
        return text.decode("utf-8", errors="replace")

    def end(self) -> None:
        if self._left:
            raise FormatError("it is longer than it states; copy or export it again")


def _binary_cameras(source: _Binary) -> dict[int, _Intrinsics]:
    cameras = {}
    for _ in range(source.count(24)):
        identity, number, width, height = source.read("<IiQQ")
        model = _known_model(_MODELS[number] if 0 <= number < len(_MODELS) else f"number {number}")
        cameras[identity] = _intrinsics(model, width, height, source.read(f"<{len(_PARAMETERS[model])}d"))
    source.end()
    return cameras


def _binary_images(source: _Binary, cameras: dict[int, _Intrinsics]) -> list[PosedPhoto]:
    photos = []
    for _ in range(source.count(73)):
        pose, camera = np.array(source.read("<I7d")[1:]), source.read("<I")[0]
        name = source.name()
        source.skip(24 * source.count(24))  # its 2D points
        with prefix_errors(f"photo {name!r}"):
            photos.append(_posed(name, _camera_of(camera, cameras), pose))
    source.end()
    return photos


def _camera_of(identity: int, cameras: dict[int, _Intrinsics]) -> _Intrinsics:
    if identity not in cameras:
        raise FormatError(f"its camera {identity} is not in the file of cameras; export both files again")
    return cameras[identity]
