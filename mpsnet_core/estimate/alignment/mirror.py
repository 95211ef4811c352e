"""How well the mirror image of a mesh would fit a photo: better, where an import turned one axis of the mesh over."""

from dataclasses import replace

import numpy as np

from mpsnet_core.estimate.alignment.mesh_faces import MeshFaces
from mpsnet_core.estimate.alignment.pose import Floats
from mpsnet_core.estimate.alignment.refine import Fit, measured, refined
from mpsnet_core.estimate.alignment.search import moved_onto_mask
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap

# A mesh counts as mirrored where its mirror image costs less than this share of what it costs itself. Symmetric objects
# cost the same within half a percent.
MIRRORED = 0.96
_ACROSS = np.array([-1.0, 1.0, 1.0])


def better_mirrored(estimate: NormalMap, faces: MeshFaces, fit: Fit) -> Fit | None:
    """The fit of the mesh's mirror image where that is better than the mesh's own; None where it is not.

    An object that is nearly symmetric fits nearly as well mirrored; its plane of symmetry lies across one of its
    principal axes. And pairs place any mirrored mesh so that it is seen from behind: from afar, its points and outline
    then are where they should be. What is mirrored here is the photo, not the mesh: the camera of the fit sees the mesh
    in the mirrored photo.

    Parameters
    ----------
    estimate
        The photo's normals and mask.
    faces
        The mesh as it is.
    fit
        How it fits the photo best. The focal length stays.
    """
    flipped = NormalMap((estimate.vectors[:, ::-1] * _ACROSS).astype(np.float32), estimate.mask[:, ::-1])
    image = _fit_reflected(flipped, faces, fit.camera)
    if image.cost >= MIRRORED * fit.cost:
        return None
    # From there the mesh as it is may fit as well: then the fit was a wrong one, and nothing is mirrored.
    back = _fit_reflected(estimate, faces, image.camera)
    return image if image.cost < MIRRORED * back.cost else None


def _fit_reflected(estimate: NormalMap, faces: MeshFaces, camera: Camera) -> Fit:
    """The fit near what `camera` sees of the mesh in a mirror. estimate: the mirror image of what `camera` took."""
    across = [*faces.axes, camera.rotation[:, 2]]
    starts = [moved_onto_mask(estimate, faces, _reflected(camera, faces.scene.middle, axis)) for axis in across]
    start = min(starts, key=lambda one: measured(estimate, faces, one).cost)
    return refined(estimate, faces, start, fix_focal=True)


def _reflected(camera: Camera, middle: Floats, axis: Floats) -> Camera:
    """What sees the mirrored picture of the world that is mirrored at the plane through `middle` across `axis`."""
    mirror = np.eye(3) - 2 * np.outer(axis, axis)
    pose = np.eye(4)
    pose[:3, :3] = mirror @ camera.rotation * _ACROSS
    pose[:3, 3] = middle + mirror @ (camera.world_from_camera[:3, 3] - middle)
    centre = np.array([camera.width - camera.centre[0], camera.centre[1]])
    return replace(camera, centre=centre, world_from_camera=pose)
