"""Detect mirrored meshes: the mirror image fits the photo better if an import flipped one axis."""

from dataclasses import replace

import numpy as np

from mpsnet_core.estimate.alignment.mesh_faces import MeshFaces
from mpsnet_core.estimate.alignment.pose import Floats
from mpsnet_core.estimate.alignment.refine import SCALES, Fit, PhotoPyramid, measure_fit, refine_camera
from mpsnet_core.estimate.alignment.search import move_onto_mask
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap

# A mesh is mirrored if the cost of its mirror image is below this share of its own. The costs of symmetric objects
# differ by less than half a percent.
MIRRORED = 0.96
_ACROSS = np.array([-1.0, 1.0, 1.0])


def find_better_mirrored(photo: PhotoPyramid, faces: MeshFaces, fit: Fit, progress: Progress = silent) -> Fit | None:
    """The fit of the mesh's mirror image if it is better than the mesh's own, else None.

    Candidates are reflections along the principal axes, because a nearly symmetric object fits nearly as well when
    reflected at its plane of symmetry, and along the viewing axis, because point pairs place a mirrored mesh so that it
    is seen from behind: from afar, its points and outline are then in the right places.

    The photo is mirrored, not the mesh. The camera of the returned fit sees the mesh in the mirrored photo.

    Parameters
    ----------
    photo
        The photo's normals and mask.
    faces
        The mesh as it is.
    fit
        Its best fit to the photo. The focal length stays.
    progress
        Called with the share done, 0 to 1, and a message.
    """
    estimate = photo.estimate
    flipped = PhotoPyramid(NormalMap((estimate.vectors[:, ::-1] * _ACROSS).astype(np.float32), estimate.mask[:, ::-1]))
    image = _fit_reflected(flipped, faces, fit.camera, progress)
    if image.cost >= MIRRORED * fit.cost:
        return None
    # If the unmirrored mesh fits as well from there, the given fit was wrong, and nothing is mirrored.
    back = _fit_reflected(photo, faces, image.camera, part(progress, 1.0, 1.0))
    return image if image.cost < MIRRORED * back.cost else None


def _fit_reflected(photo: PhotoPyramid, faces: MeshFaces, camera: Camera, progress: Progress) -> Fit:
    """The best fit that starts at reflections of `camera`. photo: the mirrored one."""
    across = [*faces.axes, camera.rotation[:, 2]]
    starts = [move_onto_mask(photo, faces, _reflected(camera, faces.scene.middle, axis)) for axis in across]
    start = min(starts, key=lambda one: measure_fit(photo, faces, one).cost)
    return refine_camera(photo, faces, start, fix_focal=True, scales=SCALES[:-1], progress=progress)


def _reflected(camera: Camera, middle: Floats, axis: Floats) -> Camera:
    """The camera that sees the mirrored image of the world reflected at the plane through `middle` normal to `axis`."""
    mirror = np.eye(3) - 2 * np.outer(axis, axis)
    pose = np.eye(4)
    pose[:3, :3] = mirror @ camera.rotation * _ACROSS
    pose[:3, 3] = middle + mirror @ (camera.world_from_camera[:3, 3] - middle)
    centre = np.array([camera.width - camera.centre[0], camera.centre[1]])
    return replace(camera, centre=centre, world_from_camera=pose)
