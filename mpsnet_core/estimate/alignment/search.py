"""Find the camera of a photo without an initial pose: compare views from all around the mesh with the photo."""

from dataclasses import dataclass, replace

import numpy as np

from mpsnet_core.arrays.types import F32, Bools, Floats
from mpsnet_core.estimate.alignment.pose import MeshFaces, Poses
from mpsnet_core.estimate.alignment.refine import SCALES, Fit, PhotoPyramid, measure_fit, refine_camera
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap

DIRECTIONS, ROLLS = 320, 36  # viewing directions, 11 degrees apart, each rolled in steps of 10 degrees
SIDE = 48  # pixels of the images to compare
ZOOMS = (0.6, 1.0, 1.6)  # factors of the best view's focal length to try
SPREAD = 5.0  # the images extend to this multiple of the square root of the object's second moment
TRIED, ROUGH = 16, 5  # best views to refine roughly, and of those to refine fully
ROUGH_SCALES = ((48, 12), (96, 8))
CHOSEN = 96  # pixels of the object's longer side, to choose between starts
COMPARED_SCALES = SCALES[:-1]  # the finest scale takes most of the time, and only the best view needs it
# Shares of the search's time after which all views are compared, refined roughly, refined well, and tried with lenses.
COMPARED, ROUGHLY, WELL, LENSES = 0.2, 0.53, 0.68, 0.84
# Degrees between views that count as the same: after refinement, and before, when neighbours converge to the same view.
SAME, NEIGHBOURS = 5.0, 12.0


def search_cameras(
    photo: PhotoPyramid,
    faces: MeshFaces,
    lens: Camera,
    count: int = 3,
    *,
    fix_focal: bool = False,
    usual_focal: float | None = None,
    progress: Progress = silent,
) -> list[Fit]:
    """The `count` cameras with which the mesh fits the photo best, best first.

    Parameters
    ----------
    photo
        The photo's normals and mask.
    faces
        The mesh.
    lens
        A camera of the photo's size with the initial focal length and the principal point. Its pose is ignored.
    fix_focal
        Whether to keep the focal length.
    usual_focal
        A focal length in pixels to try as well, if that of the lens may be wrong.
    count
        Number of cameras to return.
    progress
        Called with the share done, 0 to 1, and a message.
    """
    views = _views(photo.estimate, faces, lens, part(progress, 0.0, COMPARED))
    fits = []
    for number, camera in enumerate(views):
        shown = _one_of(progress, COMPARED, ROUGHLY, number, len(views), "view %d of %d")
        fits.append(refine_camera(photo, faces, camera, fix_focal=True, scales=ROUGH_SCALES, progress=shown))
    rough = _distinct_fits(sorted(fits, key=lambda fit: fit.cost))[:ROUGH]
    best = []
    for number, fit in enumerate(rough):
        shown = _one_of(progress, ROUGHLY, WELL, number, len(rough), "best view %d of %d")
        camera, scales = fit.camera, COMPARED_SCALES
        best.append(refine_camera(photo, faces, camera, fix_focal=fix_focal, scales=scales, progress=shown))
    best = _distinct_fits(sorted(best, key=lambda fit: fit.cost))
    if not fix_focal:
        # Try other focal lengths: refinement may converge to a wrong one.
        factors = [*ZOOMS, *([usual_focal / float(best[0].camera.focal[0])] if usual_focal else [])]
        for number, factor in enumerate(factors):
            shown = _one_of(progress, WELL, LENSES, number, len(factors), "lens %d of %d")
            zoomed = _zoomed(best[0].camera, faces.scene.middle, factor)
            best.append(refine_camera(photo, faces, zoomed, scales=COMPARED_SCALES, progress=shown))
    found = _distinct_fits(sorted(best, key=lambda fit: fit.cost))[:count]
    last = part(progress, WELL if fix_focal else LENSES, 1.0)
    first = refine_camera(photo, faces, found[0].camera, fix_focal=fix_focal, scales=SCALES[-1:], progress=last)
    return [first, *found[1:]]


def _one_of(progress: Progress, start: float, end: float, number: int, count: int, what: str) -> Progress:
    """Progress of one of several steps from `start` to `end` that take equally long."""
    first, last = (start + (end - start) * (number + step) / count for step in (0, 1))
    return part(progress, first, last, what % (number + 1, count))


def _zoomed(camera: Camera, middle: Floats, factor: float) -> Camera:
    """A camera with focal length and distance from `middle` multiplied by `factor` (dolly zoom)."""
    pose = camera.world_from_camera.copy()
    distance = camera.depth_row() @ np.append(middle, 1.0)
    pose[:3, 3] += (factor - 1) * distance * camera.rotation[:, 2]
    return replace(camera, focal=camera.focal * factor, world_from_camera=pose)


def _distinct_fits(fits: list[Fit]) -> list[Fit]:
    """Fits without those that are close to a better one."""
    kept: list[Fit] = []
    for fit in fits:
        if all(_angle_between(fit.camera.rotation, other.camera.rotation) > SAME for other in kept):
            kept.append(fit)
    return kept


@dataclass(frozen=True)
class _ObjectExtent:
    """Place and size of an object in an image."""

    middle: Floats
    """(2,). x and y of its centre, in pixels."""
    spread: float
    """Root of its second moment, in pixels."""

    @classmethod
    def of(cls, mask: Bools) -> "_ObjectExtent":
        rows, columns = np.nonzero(mask)
        middle = np.array([columns.mean() + 0.5, rows.mean() + 0.5])
        moments = (columns + 0.5 - middle[0]) ** 2 + (rows + 0.5 - middle[1]) ** 2
        return cls(middle, float(np.sqrt(moments.mean())))


def _views(estimate: NormalMap, faces: MeshFaces, lens: Camera, progress: Progress) -> list[Camera]:
    """The TRIED views that are most similar to the photo."""
    frame, focal = _ObjectExtent.of(estimate.mask), float(lens.focal[0])
    photo = np.stack([_standardised_picture(estimate.vectors, estimate.mask, frame, roll) for roll in _rolls()])
    small = _small(faces, frame, focal)
    scores, frames = np.empty((DIRECTIONS, ROLLS)), []
    looks = _view_directions(DIRECTIONS)
    for number, rotation in enumerate(looks):
        if number % 16 == 0:
            progress(number / DIRECTIONS, f"view {number + 1} of {DIRECTIONS}")
        normals, mask = _picture(faces, rotation, *small)
        frames.append(_ObjectExtent.of(mask))
        scores[number] = _similarity(photo, _standardised_picture(normals, mask, frames[-1], 0.0))
    cameras: list[Camera] = []
    for choice in np.argsort(-scores, axis=None):
        number, roll = divmod(int(choice), ROLLS)
        angle = float(_rolls()[roll])
        if any(_angle_between((_turn(angle).T @ looks[number]).T, other.rotation) < NEIGHBOURS for other in cameras):
            continue
        cameras.append(_place_camera(estimate.mask, faces, looks[number], focal, lens.centre, frames[number], angle))
        if len(cameras) == TRIED:
            break
    return cameras


def move_onto_mask(photo: PhotoPyramid, faces: MeshFaces, camera: Camera) -> Fit:
    """Shift and zoom a camera until the mesh has the mask's place and size; unchanged if that does not fit better.

    A rough start, such as a viewport's view, shows the object elsewhere in the image.
    """
    focal, rotation = float(camera.focal[0]), camera.rotation.T
    _, mask = _picture(faces, rotation, *_small(faces, _ObjectExtent.of(photo.estimate.mask), focal))
    fit = measure_fit(photo, faces, camera, CHOSEN)
    if not mask.any():  # a flat sheet seen edge-on
        return fit
    placed = _place_camera(photo.estimate.mask, faces, rotation, focal, camera.centre, _ObjectExtent.of(mask), 0.0)
    return max(fit, measure_fit(photo, faces, placed, CHOSEN), key=lambda one: one.overlap)


def _small(faces: MeshFaces, frame: _ObjectExtent, focal: float) -> tuple[float, float]:
    """Focal length and distance of small images, with about the perspective of the photo."""
    return focal / frame.spread * SIDE / SPREAD, faces.scene.size * focal / max(4 * frame.spread, 1.0)


def _place_camera(
    photo: Bools, faces: MeshFaces, rotation: Floats, focal: float, centre: Floats, view: _ObjectExtent, angle: float
) -> Camera:
    """The camera that sees the mesh in the mask's place and size. view: of its small image, rolled by `angle`."""
    (height, width), frame = photo.shape, _ObjectExtent.of(photo)
    small_focal, distance = _small(faces, frame, focal)
    rotation = _turn(angle).T @ rotation
    scale = frame.spread / view.spread
    camera_distance = distance * focal / small_focal / scale
    # The mesh's centre is at the centre of the small image.
    offset = _pixel_turn(angle) @ (SIDE - view.middle) * scale
    x, y = (frame.middle + offset - centre) / focal * (1, -1)
    translation = np.array([x, y, -1.0]) * camera_distance - rotation @ faces.scene.middle
    return Poses(rotation[None], translation[None], np.array([focal]), centre).camera(width, height)


def _similarity(photo: Floats, view: Floats) -> Floats:
    """(R,) similarity of R images of the photo to one of the mesh, from their overlap and the normals' mean cosine."""
    both = np.minimum(photo[..., 3], view[..., 3]).sum(axis=(1, 2))
    either = np.maximum(photo[..., 3], view[..., 3]).sum(axis=(1, 2))
    cosines = (photo[..., :3] * view[..., :3]).sum(axis=(1, 2, 3))
    return both / np.maximum(either, 1e-9) + cosines / np.maximum(both, 1e-9)


def _angle_between(rotation: Floats, other: Floats) -> float:
    """Degrees between two rotations."""
    return float(np.degrees(np.arccos(np.clip((np.trace(rotation.T @ other) - 1) / 2, -1, 1))))


def _rolls() -> Floats:
    return np.arange(ROLLS) * 2 * np.pi / ROLLS


def _turn(angle: float) -> Floats:
    """(3, 3) rotation about the camera's axis, counter-clockwise in the image."""
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])


def _pixel_turn(angle: float) -> Floats:
    """(2, 2) inverse of :func:`_turn` for pixels, whose y points down."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _view_directions(count: int) -> Floats:
    """(count, 3, 3) rotations from world to camera space, for viewing directions spread evenly over the sphere."""
    number = np.arange(count) + 0.5
    z, angle = 1 - 2 * number / count, number * np.pi * (3 - np.sqrt(5))
    axis = np.stack([np.sqrt(1 - z * z) * np.cos(angle), np.sqrt(1 - z * z) * np.sin(angle), z], axis=1)
    up = np.where(np.abs(axis[:, 2:]) < 0.9, (0, 0, 1.0), (0, 1.0, 0))
    right = np.cross(up, axis)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return np.stack([right, np.cross(axis, right), axis], axis=1)


def _picture(faces: MeshFaces, rotation: Floats, focal: float, distance: float) -> tuple[F32, Bools]:
    """Normals and mask of the mesh in a centred image of 2 SIDE x 2 SIDE pixels."""
    translation = np.array([0, 0, -distance]) - rotation @ faces.scene.middle
    side = 2 * SIDE
    camera = Poses(rotation[None], translation[None], np.array([focal]), np.full(2, SIDE * 1.0)).camera(side, side)
    steps = np.arange(side) + 0.5
    seen = faces.seen(camera, steps, steps)
    return seen.normals.astype(np.float32), seen.mask


def _standardised_picture(normals: F32, mask: Bools, frame: _ObjectExtent, roll: float) -> Floats:
    """(SIDE, SIDE, 4) normals and mask, normalised in size and position, and rolled by `roll`."""
    steps = (np.arange(SIDE) + 0.5) / SIDE * 2 - 1
    place = np.stack(np.broadcast_arrays(steps, steps[:, None]), axis=-1) * (SPREAD / 2 * frame.spread)
    place = place @ _pixel_turn(roll).T + frame.middle
    column, row = np.floor(place).astype(int).transpose(2, 0, 1)
    inside = (row >= 0) & (row < mask.shape[0]) & (column >= 0) & (column < mask.shape[1])
    found = np.zeros((SIDE, SIDE, 4))
    found[inside, 3] = mask[row[inside], column[inside]]
    found[inside, :3] = normals[row[inside], column[inside]] * found[inside, 3:]
    found[..., :3] = found[..., :3] @ _turn(roll).T
    return found


# --- detect mirrored meshes: the mirror image fits the photo better if an import flipped one axis ---------------------


# A mesh is mirrored if the cost of its mirror image is below this share of its own. The costs of symmetric objects
# differ by less than half a percent.
MIRRORED = 0.96
# Above this multiple of the mesh's own cost, a rough fit of the mirror image is not refined.
HOPELESS = 1.5
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
    image = _fit_reflected(flipped, faces, fit.camera, HOPELESS * fit.cost, progress)
    if image.cost >= MIRRORED * fit.cost:
        return None
    # If the unmirrored mesh fits as well from there, the given fit was wrong, and nothing is mirrored.
    back = _fit_reflected(photo, faces, image.camera, np.inf, part(progress, 1.0, 1.0))
    return image if image.cost < MIRRORED * back.cost else None


def _fit_reflected(photo: PhotoPyramid, faces: MeshFaces, camera: Camera, most: float, progress: Progress) -> Fit:
    """The best fit that starts at reflections of `camera`; a rough one if it costs above `most`.

    photo: the mirrored one.
    """
    across = [*faces.axes, camera.rotation[:, 2]]
    starts = [move_onto_mask(photo, faces, _reflected(camera, faces.scene.middle, axis)) for axis in across]
    start = min(starts, key=lambda fit: fit.cost)
    rough = refine_camera(photo, faces, start.camera, fix_focal=True, scales=ROUGH_SCALES, progress=silent)
    if rough.cost > most:
        return rough
    return refine_camera(photo, faces, rough.camera, fix_focal=True, scales=SCALES[:-1], progress=progress)


def _reflected(camera: Camera, middle: Floats, axis: Floats) -> Camera:
    """The camera that sees the mirrored image of the world reflected at the plane through `middle` normal to `axis`."""
    mirror = np.eye(3) - 2 * np.outer(axis, axis)
    pose = np.eye(4)
    pose[:3, :3] = mirror @ camera.rotation * _ACROSS
    pose[:3, 3] = middle + mirror @ (camera.world_from_camera[:3, 3] - middle)
    centre = np.array([camera.width - camera.centre[0], camera.centre[1]])
    return replace(camera, centre=centre, world_from_camera=pose)
