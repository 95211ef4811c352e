"""The camera of a photo: a chosen object, or the data stored with the photo when it was rendered or opened."""

from pathlib import Path
from typing import Any

from mpsnet_core.scene.camera import write_camera

from ..image_records import remembered
from ..images import picture_size
from ..provenance import Provenance, made_by, rounded
from ..scene.camera import scene_camera


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


def camera_provenance(scene: Any, image: Any) -> Provenance:
    """The pose and lens of a photo's camera object, as provenance; empty if there is no such object."""
    camera = chosen_camera(scene, image) if image else None
    if camera is None:
        return {}
    return {"Camera": f"{rounded(camera.matrix_world, 4)} {lens_stamp(camera)}"}


def lens_stamp(camera: Any) -> str:
    """Fingerprint of a camera object's lens and sensor settings."""
    data = camera.data
    sizes = data.lens, data.ortho_scale, data.sensor_width, data.sensor_height, data.shift_x, data.shift_y
    return f"{data.type} {data.sensor_fit} {rounded(sizes, 4)}"
