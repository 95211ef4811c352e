"""The camera of a photo: a chosen object, or the data stored with the photo when it was rendered or opened."""

import json
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mathutils import Matrix, Vector

from mpsnet_core.errors import InputError
from mpsnet_core.scene.camera import Camera, write_camera

from ..image_records import Provenance, from_json, made_by, remember, remembered, rounded
from ..images import picture_size
from ..scene.camera import scene_camera

# Stored with a rendered photo and its normals: where its objects stood, by name.
PLACES = "places"
# Stored with a photo: where the object stood to which its pairs of points belong.
_PAIRED = "paired"
_PLACE = "Place of object and camera"
_SAME = 1e-4


def is_real(photo: Any) -> bool:
    """Whether an image is a photo that was not rendered here."""
    return photo is not None and made_by(photo) != "render_photo"


def chosen_camera(scene: Any, image: Any) -> Any:
    """The camera object of a real photo, or of a normal map's photo; None if there is none."""
    photo = image.mps.photo or image
    camera = photo.mps.camera if is_real(photo) else None
    if camera is None or camera.type != "CAMERA" or scene.objects.get(camera.name) != camera:
        return None
    return camera


def lacks_photo_camera(scene: Any, image: Any) -> bool:
    """Whether the camera of a photo, or of a normal map's photo, is unknown."""
    return remembered(image, "camera") is None and chosen_camera(scene, image) is None


def lacks_camera(scene: Any, normals: Any) -> bool:
    """Whether normals were estimated from a real photo whose camera is unknown."""
    return made_by(normals) == "estimate" and lacks_photo_camera(scene, normals)


def write_photo_camera(path: Path, scene: Any, image: Any, otherwise: Any = None) -> bool:
    """Write the camera of a photo, or of a normal map's photo.

    If it is unknown, write the camera object `otherwise`. Returns False if there is none either.
    """
    camera, stored = chosen_camera(scene, image), remembered(image, "camera")
    if camera is None and stored is not None:
        path.write_text(stored, encoding="utf-8")
        return True
    camera = camera or otherwise
    if camera is not None:
        write_camera(path, scene_camera(camera, scene, picture_size(image)))
    return camera is not None


def places_of(objects: Iterable[Any]) -> str:
    """Where objects stand, as text to store with their photo."""
    return json.dumps({obj.name: [value for row in obj.matrix_world for value in row] for obj in objects})


def place_in_photo(image: Any, obj: Any) -> Matrix:
    """Where an object stood when its photo was rendered, (4, 4); where it stands now if that is unknown.

    The photo's camera and lights were stored as they stood then.
    """
    return _place(remembered(image, PLACES), obj)


def _place(stored: str | None, obj: Any) -> Matrix:
    """The place of an object in what :func:`places_of` stored; its present one if it is not there."""
    flat: Any = from_json(stored, dict).get(obj.name)
    with suppress(TypeError, ValueError):  # a hostile file may hold anything
        then = Matrix([flat[row : row + 4] for row in range(0, 16, 4)])
        if abs(then.determinant()) > 0:
            return then
    return obj.matrix_world.copy()


def back_to_photo(image: Any, obj: Any) -> Matrix | None:
    """The motion (4, 4) that takes an object to where it stood in its photo; None if it has not moved."""
    then = place_in_photo(image, obj)
    if max(abs(value) for row in then - obj.matrix_world for value in row) < 1e-6:
        return None
    return then @ obj.matrix_world.inverted_safe()


def camera_beside(camera: Camera, image: Any, other: Any, objects: Iterable[Any]) -> Camera:
    """The camera of one image, moved along to where the objects stood in the other image.

    Raises InputError if no single motion takes all objects from one place to the other.
    """
    motions = [
        np.array(place_in_photo(other, obj) @ place_in_photo(image, obj).inverted_safe(), np.float64) for obj in objects
    ]
    motion = motions[0]
    turn = motion[:3, :3]
    if max(abs(one - motion).max() for one in motions) > _SAME or abs(turn @ turn.T - np.eye(3)).max() > _SAME:
        raise InputError(
            "the objects moved against each other, or were scaled, between the photos of two rigs; bake one rig at a "
            "time, or render their photos again"
        )
    return replace(camera, world_from_camera=motion @ camera.world_from_camera)


def take_pairs_along(photo: Any, obj: Any) -> None:
    """Move the photo's points on an object to where they are on it now."""
    if len(photo.mps.pairs):
        motion = obj.matrix_world @ _place(remembered(photo, _PAIRED), obj).inverted_safe()
        for pair in photo.mps.pairs:
            pair.point = motion @ Vector(pair.point)
    remember(photo, _PAIRED, places_of([obj]))


def camera_provenance(scene: Any, image: Any, target: Any = None) -> Provenance:
    """The lens of a photo's camera, and its pose relative to the target, as provenance.

    Object and camera may move together: for the bake, nothing changes then.
    """
    camera = chosen_camera(scene, image) if image else None
    pose = target.matrix_world if target is not None else Matrix.Identity(4)
    if camera is None:
        stands = place_in_photo(image, target) if image and target is not None else pose
        return {_PLACE: rounded(stands, 4)} if target is not None else {}
    return {_PLACE: rounded(pose.inverted_safe() @ camera.matrix_world, 4), "Camera's lens": lens_stamp(camera)}


def lens_stamp(camera: Any) -> str:
    """Fingerprint of a camera object's lens and sensor settings."""
    data = camera.data
    sizes = data.lens, data.ortho_scale, data.sensor_width, data.sensor_height, data.shift_x, data.shift_y
    return f"{data.type} {data.sensor_fit} {rounded(sizes, 4)}"
