"""AliceVision, which Meshroom drives: views, intrinsics and poses of a scene as JSON (cameras.sfm, .json).

https://github.com/alicevision/AliceVision/tree/develop/src/aliceVision/sfmDataIO. File versions differ in the
definitions of focal length and principal point. Numbers are written as text.
"""

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.errors import FormatError
from mpsnet_core.io.files import existing_file, prefix_errors
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.photogrammetry.posed_photo import FLIP_YZ, Lens, PosedPhoto, photogrammetry_camera, rotation

# A scene with its points is far larger than its cameras, and takes about ten times this in memory while it is read.
MAX_FILE_BYTES = 1 << 28

# Number of coefficients of each distortion type. Newer files state the type of a "pinhole", older ones name the camera
# by it.
_DISTORTIONS = {"none": 0, "radialk1": 1, "radialk3": 3, "brown": 5}
_OLD_TYPES = {"radial1": "radialk1", "radial3": "radialk3", "brown": "brown"}

Version = tuple[int, int, int]


def read_alicevision(path: AnyPath) -> list[PosedPhoto]:
    """The posed photos of an AliceVision scene. Photos without a pose are left out.

    The world is that of the meshes that the same version writes. Since file version 1.2.3, their y and z axes point the
    other way than those of the poses, and the cameras are rotated to match.

    Raises FileError if the file is missing; FormatError if it is damaged, no scene, or larger than 256 MiB, or a
    camera is not of type pinhole, radial1, radial3 or brown, or is one of a rig of several; GeometryError if a pose
    is not rigid.
    """
    file = existing_file(path, "scene")
    with prefix_errors(file):
        if file.stat().st_size > MAX_FILE_BYTES:
            raise FormatError("it is larger than 256 MiB; take cameras.sfm of Meshroom's StructureFromMotion")
        try:
            scene = json.loads(file.read_text(encoding="utf-8-sig"))
        except UnicodeDecodeError:
            raise FormatError("it is not text; save the scene as JSON (node ConvertSfMFormat)") from None
        except (ValueError, RecursionError) as error:
            raise FormatError(f"it is not valid JSON ({error}); save the scene again") from None
        if not isinstance(scene, dict) or "views" not in scene or "version" not in scene:
            raise FormatError('it is not an AliceVision scene, which has "version" and "views"; choose cameras.sfm')
        version = _version(scene["version"])
        intrinsics = {str(record.get("intrinsicId")): record for record in _records(scene, "intrinsics")}
        poses = {str(record.get("poseId")): record for record in _records(scene, "poses")}
        photos = []
        for view in _records(scene, "views"):
            pose, intrinsic = poses.get(str(view.get("poseId"))), intrinsics.get(str(view.get("intrinsicId")))
            if pose is None:
                continue
            name = view.get("path")
            with prefix_errors(f"photo {name!r}"):
                if not isinstance(name, str):
                    raise FormatError('its "path" is not text; save the scene again')
                if intrinsic is None:
                    raise FormatError(f"its intrinsic {view.get('intrinsicId')} is not in the scene; save both")
                if str(view.get("isPoseIndependant", "true")).lower() in ("false", "0"):
                    raise FormatError("it belongs to several cameras mounted together; reconstruct without their rig")
                photos.append(_posed(name, intrinsic, pose, version))
        return photos


def _posed(name: str, intrinsic: dict[str, Any], pose: dict[str, Any], version: Version) -> PosedPhoto:
    transform = _part(_part(pose, "pose"), "transform")
    # Stored in column-major order from world to camera, which in row-major order is camera to world.
    turn = rotation(_numbers(transform, "rotation", 9), "its pose")
    position = _numbers(transform, "center", 3)
    if version >= (1, 2, 3):
        turn, position = FLIP_YZ @ turn, FLIP_YZ @ position
    width, height = (_number(intrinsic, side) for side in ("width", "height"))
    # AliceVision's origin is the centre of the first pixel, ours its corner.
    centre = _numbers(intrinsic, "principalPoint", 2) + 0.5
    if version >= (1, 2, 1):
        centre += np.array([width, height]) / 2
    focal = _focal(intrinsic, width, version)
    camera = photogrammetry_camera(int(width), int(height), focal, centre, turn, position)
    return PosedPhoto(name, camera, _lens(intrinsic))


def _focal(intrinsic: dict[str, Any], width: float, version: Version) -> F64:
    """(2,) focal length in pixels. For one lens in all versions, see compatibilityData/scene_v*.json in AliceVision."""
    if version < (1, 2, 0):
        return np.repeat(_numbers(intrinsic, "pxFocalLength", 1), 2)
    if version < (1, 2, 2):
        return _numbers(intrinsic, "pxFocalLength", 2)
    sensor, ratio = _number(intrinsic, "sensorWidth", 36.0), _number(intrinsic, "pixelRatio", 1.0)
    if sensor <= 0 or ratio <= 0:
        raise FormatError('its "sensorWidth" and "pixelRatio" must be above 0; save the scene again')
    focal = _number(intrinsic, "focalLength") / sensor * width
    if version < (1, 2, 5):
        return np.array([focal, focal / ratio])
    if version < (1, 2, 9):
        return np.array([focal, focal * ratio])
    if version < (1, 2, 11) and ratio != 1:
        raise FormatError("versions 1.2.9 and 1.2.10 are read with square pixels only; save it with a newer Meshroom")
    return np.array([focal / ratio, focal])


def _lens(intrinsic: dict[str, Any]) -> Lens:
    kind = str(intrinsic.get("type")).lower()
    bend = _OLD_TYPES.get(kind) or str(intrinsic.get("distortionType", "none")).lower()
    undistortion = str(intrinsic.get("undistortionType", "none")).lower()
    for name, read in ((kind, ("pinhole", *_OLD_TYPES)), (bend, _DISTORTIONS), (undistortion, ("none",))):
        if name not in read:
            raise FormatError(
                f"camera type {name!r} is not supported (pinhole, radial1, radial3 and brown are); choose one "
                "of these in Meshroom's CameraInit node"
            )
    values = _numbers(intrinsic, "distortionParams", _DISTORTIONS[bend]).tolist() if _DISTORTIONS[bend] else []
    return Lens(radial=tuple(values[:3]), tangential=(values[4], values[3]) if bend == "brown" else (0.0, 0.0))


def _version(value: Any) -> Version:
    try:
        major, minor, revision = (int(part) for part in value)
    except (OverflowError, TypeError, ValueError):
        raise FormatError(f'its "version" is {value!r}, not three whole numbers; save the scene again') from None
    if major != 1:
        raise FormatError(f"it is of version {major}.{minor}.{revision}, and 1.x.x is read here; update this program")
    return major, minor, revision


def _records(scene: dict[str, Any], key: str) -> Iterator[dict[str, Any]]:
    records = scene.get(key) or []  # an empty list is written as an empty string
    if not isinstance(records, list) or not all(isinstance(record, dict) for record in records):
        raise FormatError(f'its "{key}" is not a list of objects; save the scene again')
    yield from records


def _part(record: dict[str, Any], key: str) -> dict[str, Any]:
    part = record.get(key)
    if not isinstance(part, dict):
        raise FormatError(f'it lacks "{key}", or it is not an object; save the scene again')
    return part


def _number(record: dict[str, Any], key: str, otherwise: float | None = None) -> float:
    value = record.get(key, otherwise)
    return float(_finite([value], key)[0])


def _numbers(record: dict[str, Any], key: str, count: int) -> F64:
    value = record.get(key)
    values = value if isinstance(value, list) else [value]
    if len(values) != count:
        raise FormatError(f'its "{key}" must be {count} numbers, not {len(values)}; save the scene again')
    return _finite(values, key)


def _finite(values: list[Any], key: str) -> F64:
    try:
        if any(isinstance(value, bool) for value in values):
            raise ValueError
        numbers = [float(value) for value in values]
    except (TypeError, ValueError, OverflowError):
        numbers = [math.nan]
    if not all(map(math.isfinite, numbers)):
        raise FormatError(f'its "{key}" is missing or not a finite number; save the scene again')
    return np.array(numbers)
