"""What a photo shows of the normal map that an object wears already: taken out of it, lest it be laid onto itself.

A map that was sculpted is not to be seen in a photo; one that was made of the same object is.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.bilinear import bilinear
from mpsnet_core.arrays.rotations import rotated, rotation_between
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.arrays.upsample import chosen_pixels, reduced_shape
from mpsnet_core.bake.detail_blending import resampled
from mpsnet_core.bake.low_frequency_correction import correct_low_frequencies
from mpsnet_core.errors import check_choice
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.mesh_seen import MeshSeen, mesh_seen
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.rays import RayScene

log = logging.getLogger(__name__)

Shown = Literal["auto", "yes", "no"]
SHOWN: tuple[Shown, ...] = ("auto", "yes", "no")

# A smaller share of the map than this is chance.
LEAST_SHARE = 0.25
# Radians: maps whose relief is fainter than this allow no estimate of the share.
FAINT = 0.01
# How fine the map is beside the photo is probed at this many pixels on the photo's longer side.
PROBED_PIXELS = 128


@dataclass(frozen=True, eq=False)
class BaseMap:
    """The normal map that an object wears, to add detail to.

    Parameters
    ----------
    vectors : (H, W, 3) float32 array
        Unit vectors in tangent space, row 0 at v = 1.
    shown : {"auto", "yes", "no"}
        Whether the photos show its relief as well; "auto" estimates how much of it.
    triangles : (T,) bool array, optional
        Triangles of the mesh that wear it; all by default.
    corner : (int, int), optional
        Lower left corner of the only unit square of UV space where it lies; by default it lies from 0 to 1.

    Raises
    ------
    SettingsError
        If `shown` is none of these words.
    """

    vectors: NDArray[np.float32]
    shown: Shown = "auto"
    triangles: NDArray[np.bool_] | None = None
    corner: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        check_choice("shown", self.shown, SHOWN)


def remove_base_details(
    normals: NormalMap,
    camera: Camera,
    mesh: Mesh,
    scene: RayScene,
    base_maps: Sequence[BaseMap],
    shares: Sequence[float] | None = None,
) -> tuple[NormalMap, tuple[float, ...]]:
    """:func:`remove_base_detail` for each of several maps that parts of the mesh wear, with the shares of all."""
    found = []
    for number in range(len(base_maps)):
        share = None if shares is None else shares[number]
        if share != 0:  # else it need not even be read
            normals, share = remove_base_detail(normals, camera, mesh, scene, base_maps[number], share)
        found.append(share)
    return normals, tuple(found)


def remove_base_detail(
    normals: NormalMap, camera: Camera, mesh: Mesh, scene: RayScene, base_map: BaseMap, share: float | None = None
) -> tuple[NormalMap, float]:
    """A view's normals without the relief of the map that the mesh wears.

    Parameters
    ----------
    normals : NormalMap
        The view's, in camera space.
    camera : Camera
        What the view's pixels see.
    mesh : Mesh
        The mesh.
    scene : RayScene
        The mesh's, in the world.
    base_map : BaseMap
        The map that the mesh wears.
    share : float, optional
        Share of the relief, 0 to 1, that the view shows, where it is known. By default `base_map.shown` decides; "auto"
        is the least-squares share of the map's relief in the view's, both levelled
        (:mod:`mpsnet_core.bake.low_frequency_correction`), because low frequencies may be wrong in the view.

    Returns
    -------
    normals : NormalMap
        Each normal turned by that share of the rotation from the mesh's normal with the map to that without.
    share : float
        The share of the relief that was removed.
    """
    if share is None and base_map.shown != "auto":
        share = float(base_map.shown == "yes")
    if share == 0:
        return normals, 0.0
    mask = _where_worn(normals.mask, camera, mesh, base_map)
    worn_map = _as_fine_as_seen(base_map, mask, camera, mesh, scene)
    own, worn, seen = _normals_worn(mask, camera, mesh, scene, replace(base_map, vectors=worn_map))
    if not seen.any():
        return normals, 0.0
    if share is None:
        given = normals if base_map.triangles is None else replace(normals, mask=seen)
        view, relief = (
            correct_low_frequencies(one, camera, mesh, scene).vectors for one in (given, NormalMap(worn, seen))
        )
        share = _share(view[seen] - own[seen], relief[seen] - own[seen])
        if share == 0:
            return normals, 0.0
    vectors = normals.vectors.copy()
    vectors[seen] = rotated(vectors[seen], np.float32(share) * rotation_between(worn[seen], own[seen]))
    return replace(normals, vectors=vectors), share


def note_shares(shares: Sequence[Sequence[float]]) -> None:
    """Log how many views show the present maps' relief. shares: for each view, what of each map was taken out of it."""
    taken = [share for of_view in shares for share in of_view if share]
    if taken:
        share, views = sum(taken) / len(taken), f"{sum(map(any, shares))} of {len(shares)} view(s)"
        log.info("%s show %.0f%% of the present map's relief, which is not added to it again", views, 100 * share)


def _share(view: NDArray[np.float32], relief: NDArray[np.float32]) -> float:
    """The share of a map's relief, departures (N, 3) from the mesh's normals, in those of a view (N, 3)."""
    known = float((relief * relief).sum(dtype=np.float64)) + len(relief) * FAINT**2
    share = float((view * relief).sum(dtype=np.float64)) / known
    return min(share, 1.0) if share >= LEAST_SHARE else 0.0


def _where_worn(mask: NDArray[np.bool_], camera: Camera, mesh: Mesh, base_map: BaseMap) -> NDArray[np.bool_]:
    """(H, W) the mask within the rectangle in which the camera sees the triangles that wear the map, if any."""
    if base_map.triangles is None:
        return mask
    points = mesh.world_vertices[np.unique(mesh.triangles[base_map.triangles])]
    x, y, w = camera.projection_rows() @ np.concatenate([points, np.ones((len(points), 1))], axis=1).T
    if (w <= 0).any():  # some are behind the camera, and their projections are meaningless
        return mask
    height, width = mask.shape
    (left, right), (top, bottom) = (
        np.clip([np.floor((c / w).min()), np.ceil((c / w).max())], 0, end).astype(int)
        for c, end in ((x, width), (y, height))
    )
    inside = np.zeros_like(mask)
    inside[top:bottom, left:right] = mask[top:bottom, left:right]
    return inside


def _wears(seen: MeshSeen, base_map: BaseMap) -> NDArray[np.bool_]:
    """(M,) whether what is seen wears the map."""
    worn = np.ones(len(seen.triangle), bool) if base_map.triangles is None else base_map.triangles[seen.triangle]
    if base_map.corner is None:
        return worn
    on_tile: NDArray[np.bool_] = np.all(np.floor(seen.at(seen.mesh.uvs)) == base_map.corner, axis=1)
    return worn & on_tile


def _normals_worn(
    mask: NDArray[np.bool_], camera: Camera, mesh: Mesh, scene: RayScene, base_map: BaseMap
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    """The mesh's own shading normals (H, W, 3), those with its present map, in camera space, and (H, W) where it is
    seen within the mask and wears the map."""
    own, worn = np.zeros((2, *mask.shape, 3), np.float32)
    visible = np.zeros_like(mask)
    for rows in bands(len(mask)):
        row, column = np.nonzero(mask[rows])
        row += rows.start
        seen = mesh_seen(mesh, camera, scene, np.stack([column, row], axis=1) + 0.5)
        normal, tangent = seen.at(mesh.corner_normals), seen.at(mesh.tangents[..., :3])
        bitangent = np.cross(normal, tangent) * mesh.tangents[seen.triangle, 0, 3:]
        right, up = (seen.at(mesh.uvs) - (base_map.corner or (0, 0))).T
        height, width = base_map.vectors.shape[:2]
        x, y, z = bilinear(base_map.vectors, right * width, (1 - up) * height).T[..., None]
        place = row[seen.hit], column[seen.hit]
        own[place] = seen.in_camera(normal)
        worn[place] = seen.in_camera(x * tangent + y * bitangent + z * normal)
        visible[place] = _wears(seen, base_map) & seen.from_front(own[place])
    return own, worn, visible


def _as_fine_as_seen(
    base_map: BaseMap, mask: NDArray[np.bool_], camera: Camera, mesh: Mesh, scene: RayScene
) -> NDArray[np.float32]:
    """The map with about as many pixels as the photo has on the surface: finer relief is not seen in it."""
    height, width = mask.shape
    rows, columns = chosen_pixels(*reduced_shape(height, width, PROBED_PIXELS), height, width)
    row, column = np.nonzero(mask[np.ix_(rows, columns)])
    pixels = np.stack([columns[column], rows[row]], axis=1) + 0.5
    first, second = (mesh_seen(mesh, camera, scene, pixels + step) for step in ((0, 0), (1, 0)))
    _, of_first, of_second = np.intersect1d(first.hit, second.hit, assume_unique=True, return_indices=True)
    together = first.triangle[of_first] == second.triangle[of_second]
    together &= _wears(first, base_map)[of_first]
    vectors = base_map.vectors
    if not together.any():
        return vectors
    steps = (second.at(mesh.uvs)[of_second] - first.at(mesh.uvs)[of_first])[together] * vectors.shape[1::-1]
    texels = float(np.median(np.linalg.norm(steps, axis=1)))
    if texels <= 1:
        return vectors
    return normalised(resampled(vectors, *(max(1, round(side / texels)) for side in vectors.shape[:2])))
