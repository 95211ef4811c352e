"""Agisoft Metashape: cameras exported as XML (File > Export > Export Cameras).

The camera model is that of the user manual's appendix "Camera models", frame cameras: with x and y in focal lengths,

    u = width/2 + cx + x' f + x' b1 + y' b2        x' = x (1 + k1 r² + ... + k4 r⁸) + p1 (r² + 2x²) + 2 p2 xy
    v = height/2 + cy + y' f                       y' = y (1 + k1 r² + ... + k4 r⁸) + p2 (r² + 2y²) + 2 p1 xy
"""

import logging
from dataclasses import dataclass, field
from functools import cache
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.errors import FormatError
from mpsnet_core.io.files import existing_file, prefix_errors
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.photogrammetry.posed_photo import Lens, PosedPhoto, photogrammetry_camera, rotation

log = logging.getLogger(__name__)

# A thousand photos are a few MB.
MAX_FILE_BYTES = 1 << 26

_PARAMETERS = ("f", "fx", "cx", "cy", "b1", "b2", "k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4")

EXPORT = "export the cameras again (File > Export > Export Cameras, Agisoft XML)"


@dataclass(frozen=True)
class _Similarity:
    """The map of p to turn · scale · p + shift, from chunk to world."""

    turn: F64 = field(default_factory=lambda: np.eye(3))
    """(3, 3). Rotation."""
    shift: F64 = field(default_factory=lambda: np.zeros(3))
    """(3,). Translation, in the world's unit."""
    scale: float = 1.0
    """Scale."""


def read_metashape(path: AnyPath) -> list[PosedPhoto]:
    """The posed photos of a Metashape XML file. Photos that are disabled or not aligned are left out.

    The world is that of the chunk's own meshes: the transform of the chunk, or of a camera's component, is applied. Its
    scale applies to the cameras' positions; their poses stay rigid.

    Raises FileError if the file is missing; FormatError if it is damaged, larger than 64 MiB, has a document type
    or several chunks, or a camera is not a frame camera; GeometryError if a pose is not rigid.
    """
    file = existing_file(path, "camera file")
    if file.stat().st_size > MAX_FILE_BYTES:
        raise FormatError(f"{file} is larger than 64 MiB and so not a file of cameras; {EXPORT}")
    with prefix_errors(file):
        try:
            text = file.read_text(encoding="utf-8-sig")
        except UnicodeDecodeError:
            raise FormatError(f"it is not UTF-8 text; {EXPORT}") from None
        # Entities would let a small file allocate any amount of memory; Metashape writes none.
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise FormatError(f"it has a document type, which no file of Metashape has; {EXPORT}")
        try:
            document = ElementTree.fromstring(text)
        except (ElementTree.ParseError, ValueError) as error:
            raise FormatError(f"it is not valid XML ({error}); {EXPORT}") from None
        chunks = document.findall("chunk")
        if document.tag != "document" or not chunks:
            raise FormatError(f"it is not a Metashape file of cameras (a document with a chunk); {EXPORT}")
        if len(chunks) > 1:
            raise FormatError(f"it holds {len(chunks)} chunks, each with a world of its own; export the cameras of one")
        return _chunk_photos(chunks[0])


def _chunk_photos(chunk: Element) -> list[PosedPhoto]:
    sensors = {sensor.get("id"): sensor for sensor in chunk.iterfind("sensors/sensor")}
    whole = chunk.find("transform")
    components = {part.get("id"): part.find("transform") for part in chunk.iterfind("components/component")}
    similarity, calibration = cache(_similarity), cache(_calibration)  # shared by many cameras
    system = (chunk.findtext("reference") or "LOCAL_CS").strip()
    if not system.startswith("LOCAL_CS"):
        log.warning(
            "the chunk has geographic coordinates, in which Metashape writes meshes differently from cameras; "
            "export both in local coordinates"
        )
    photos = []
    for camera in chunk.iterfind("cameras//camera"):  # groups contain cameras, too
        pose = camera.find("transform")
        if pose is None or camera.get("enabled", "1").lower() in ("0", "false"):
            continue
        name = camera.get("label", "")
        with prefix_errors(f"photo {name!r}"):
            sensor = sensors.get(camera.get("sensor_id"))
            if sensor is None:
                raise FormatError(f"its sensor {camera.get('sensor_id')} is not in the file; {EXPORT}")
            transform = components.get(camera.get("component_id"))
            world = similarity(whole if transform is None else transform)
            matrix = _numbers(pose.text, 16, "its transform").reshape(4, 4)
            photos.append(_posed(name, calibration(sensor), matrix, world))
    return photos


def _posed(name: str, calibration: tuple[int, int, dict[str, float]], pose: F64, world: _Similarity) -> PosedPhoto:
    """The posed photo. calibration: of :func:`_calibration`. pose: (4, 4) camera to chunk, x right, y down, z ahead."""
    turn = world.turn @ rotation(pose[:3, :3], "the camera")
    with np.errstate(over="ignore", invalid="ignore"):  # Camera rejects non-finite values
        position = world.scale * (world.turn @ pose[:3, 3]) + world.shift
    width, height, values = calibration
    get = values.get
    focal = (values["f"] + get("b1", 0.0), values["f"])
    centre = (width / 2 + get("cx", 0.0), height / 2 + get("cy", 0.0))
    camera = photogrammetry_camera(width, height, focal, centre, turn, position)
    lens = Lens(
        radial=tuple(get(f"k{i}", 0.0) for i in (1, 2, 3, 4)),
        tangential=(get("p1", 0.0), get("p2", 0.0)),
        affinity=((1.0, get("b2", 0.0) / focal[0]), (0.0, 1.0)),
    )
    return PosedPhoto(name, camera, lens)


def _calibration(sensor: Element) -> tuple[int, int, dict[str, float]]:
    """Width, height and the given parameters; Metashape omits those that are zero."""
    found = sensor.findall("calibration")
    adjusted = [calibration for calibration in found if calibration.get("class") == "adjusted"]
    if not found:
        raise FormatError(f"its sensor {sensor.get('label')!r} has no calibration; align the photos, then {EXPORT}")
    calibration = (adjusted or found)[-1]
    for kind in (sensor.get("type", "frame"), calibration.get("type", "frame")):
        if kind != "frame":
            raise FormatError(
                f"its sensor is of type {kind!r}, and only 'frame' is read here; undistort the photos in Metashape "
                "(File > Export > Convert Images) and align those"
            )
    resolution = calibration.find("resolution")
    if resolution is None:
        resolution = sensor.find("resolution")
    given = {} if resolution is None else resolution.attrib
    width, height = (int(_numbers(given.get(side), 1, f"its sensor's {side}")[0]) for side in ("width", "height"))
    parameters = [child for child in calibration if child.tag in _PARAMETERS]
    values = {child.tag: float(_numbers(child.text, 1, f"its sensor's {child.tag}")[0]) for child in parameters}
    if "f" not in values:
        old = "; it was written by PhotoScan 1.1 or older" if "fx" in values else ""
        raise FormatError(f"its sensor's calibration lacks the focal length f{old}; {EXPORT} with a newer version")
    for name in ("p3", "p4"):
        if values.get(name):
            raise FormatError(f"its sensor has the distortion {name}, which is not supported; calibrate without p3, p4")
    return width, height, values


def _similarity(transform: Element | None) -> _Similarity:
    """A chunk's or a component's transform: rotation, translation and scale, any of which may be missing."""
    if transform is None:
        return _Similarity()
    if not len(transform):
        raise FormatError(f"the chunk's transform is of a version older than 1.2; {EXPORT} with a newer version")
    given: dict[str, Any] = {}
    if (text := transform.findtext("rotation")) is not None:
        given["turn"] = rotation(_numbers(text, 9, "the chunk's rotation"), "the chunk")
    if (text := transform.findtext("translation")) is not None:
        given["shift"] = _numbers(text, 3, "the chunk's translation")
    if (text := transform.findtext("scale")) is not None:
        given["scale"] = float(_numbers(text, 1, "the chunk's scale")[0])
        if given["scale"] <= 0:
            raise FormatError(f"the chunk's scale is {given['scale']:g}, which must be above 0; {EXPORT}")
    return _Similarity(**given)


def _numbers(text: str | None, count: int, what: str) -> F64:
    try:
        numbers = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != count or not np.isfinite(numbers).all():
        kind = "a finite number" if count == 1 else f"{count} finite numbers"
        raise FormatError(f"{what} must be {kind}; {EXPORT}")
    return numbers
