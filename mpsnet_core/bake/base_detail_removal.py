"""Removal of the base map's relief from a view's normals, because adding detail to the map would double it.

A photo shows the relief of a map that was made from the same object, but not of one that was sculpted.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mpsnet_core.arrays.bilinear import bilinear
from mpsnet_core.arrays.rotations import rotated, rotation_between
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.arrays.upsample import chosen_pixels, reduced_shape
from mpsnet_core.bake.detail_blending import resampled
from mpsnet_core.bake.low_frequency_correction import correct_low_frequencies
from mpsnet_core.errors import check_choice
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.mesh_hits import MeshHits, mesh_hits
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.rays import RayScene

log = logging.getLogger(__name__)

BaseMapInPhotos = Literal["auto", "yes", "no"]
SHOWN: tuple[BaseMapInPhotos, ...] = ("auto", "yes", "no")

# An estimated share below this is taken for chance.
MIN_SHARE = 0.25
# Radians: relief fainter than this is too weak to estimate the share from.
FAINT = 0.01
# Pixels on the photo's longer side at which the resolutions of map and photo are compared.
PROBED_PIXELS = 128


@dataclass(frozen=True, eq=False)
class BaseMap:
    """A normal map that an object has already, and that detail is added to.

    Raises
    ------
    SettingsError
        If `shown` is none of these.
    """

    vectors: F32
    """(H, W, 3) float32. Unit vectors in tangent space, row 0 at v = 1."""
    shown: BaseMapInPhotos = "auto"
    """Whether the photos show its relief, too: "yes", "no", or "auto" to estimate the share of it."""
    triangles: Bools | None = None
    """(T,) bool. Triangles of the mesh that it applies to; all by default."""
    corner: tuple[int, int] | None = None
    """Lower left corner of the unit square of UV space (UDIM tile) that it covers; by default it covers 0 to 1, and
    repeats beyond."""

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
    """Apply :func:`remove_base_detail` for each of the maps on parts of the mesh. Returns their shares, too."""
    found = []
    for number in range(len(base_maps)):
        share = None if shares is None else shares[number]
        if share != 0:  # otherwise the map need not be read
            normals, share = remove_base_detail(normals, camera, mesh, scene, base_maps[number], share)
        found.append(share)
    return normals, tuple(found)


@takes_files
def remove_base_detail(
    normals: NormalMap, camera: Camera, mesh: Mesh, scene: RayScene, base_map: BaseMap, share: float | None = None
) -> tuple[NormalMap, float]:
    """Remove the relief of the mesh's base map from a view's normals.

    Parameters
    ----------
    normals : NormalMap
        The view's normals, in camera space.
    camera : Camera
        The view's camera.
    mesh : Mesh
        The mesh.
    scene : RayScene
        The mesh for ray casting, in world space.
    base_map : BaseMap
        The mesh's base map.
    share : float, optional
        Share of the relief, 0 to 1, that the view shows, if it is known. By default `base_map.shown` decides; "auto"
        fits the map's relief to the view's by least squares, after the low frequencies of both are corrected
        (:mod:`mpsnet_core.bake.low_frequency_correction`): a view's own may be wrong.

    Returns
    -------
    normals : NormalMap
        Each normal is turned by that share of the rotation from the mesh's normal with the map to that without it.
    share : float
        The share of the relief that was removed.
    """
    if share is None and base_map.shown != "auto":
        share = float(base_map.shown == "yes")
    if share == 0:
        return normals, 0.0
    mask = _mask_of_map(normals.mask, camera, mesh, base_map)
    reduced_map = _reduce_to_photo_resolution(base_map, mask, camera, mesh, scene)
    without_map, with_map, seen = _shading_normals(mask, camera, mesh, scene, replace(base_map, vectors=reduced_map))
    if not seen.any():
        return normals, 0.0
    if share is None:
        given = normals if base_map.triangles is None else replace(normals, mask=seen)
        view, relief = (
            correct_low_frequencies(one, camera, mesh, scene).vectors for one in (given, NormalMap(with_map, seen))
        )
        share = _share(view[seen] - without_map[seen], relief[seen] - without_map[seen])
        if share == 0:
            return normals, 0.0
    vectors = normals.vectors.copy()
    vectors[seen] = rotated(vectors[seen], np.float32(share) * rotation_between(with_map[seen], without_map[seen]))
    return replace(normals, vectors=vectors), share


def log_shares(shares: Sequence[Sequence[float]]) -> None:
    """Log how many views show the base maps' relief. shares: for each view, the share removed of each map."""
    taken = [share for of_view in shares for share in of_view if share]
    if taken:
        share, views = sum(taken) / len(taken), f"{sum(map(any, shares))} of {len(shares)} view(s)"
        log.info("%s show %.0f%% of the existing map's relief, which is not added to it again", views, 100 * share)


def _share(view: F32, relief: F32) -> float:
    """The least-squares share of a map's relief (N, 3) in a view's (N, 3), both as offsets from the mesh's normals."""
    known = float((relief * relief).sum(dtype=np.float64)) + len(relief) * FAINT**2
    share = float((view * relief).sum(dtype=np.float64)) / known
    return min(share, 1.0) if share >= MIN_SHARE else 0.0


def _mask_of_map(mask: Bools, camera: Camera, mesh: Mesh, base_map: BaseMap) -> Bools:
    """(H, W) the mask, limited to the bounding rectangle in the image of the triangles that the map applies to."""
    if base_map.triangles is None:
        return mask
    place = camera.extent(mesh.world_vertices[np.unique(mesh.triangles[base_map.triangles])])
    inside = np.zeros_like(mask)
    inside[place] = mask[place]
    return inside


def _map_applies(seen: MeshHits, base_map: BaseMap) -> Bools:
    """(M,) whether the map applies at each surface point."""
    applies = np.ones(len(seen.triangle), bool) if base_map.triangles is None else base_map.triangles[seen.triangle]
    if base_map.corner is None:
        return applies
    on_tile: Bools = np.all(np.floor(seen.at(seen.mesh.uvs)) == base_map.corner, axis=1)
    return applies & on_tile


def _shading_normals(
    mask: Bools, camera: Camera, mesh: Mesh, scene: RayScene, base_map: BaseMap
) -> tuple[F32, F32, Bools]:
    """Shading normals (H, W, 3) of the mesh without and with its base map, in camera space, and (H, W) their validity.

    They are valid where the mesh is seen within the mask and the map applies.
    """
    without_map, with_map = np.zeros((2, *mask.shape, 3), np.float32)
    visible = np.zeros_like(mask)
    for rows in bands(len(mask)):
        row, column = np.nonzero(mask[rows])
        row += rows.start
        seen = mesh_hits(mesh, camera, scene, np.stack([column, row], axis=1) + 0.5)
        normal, tangent = seen.at(mesh.corner_normals), seen.at(mesh.tangents[..., :3])
        bitangent = np.cross(normal, tangent) * mesh.tangents[seen.triangle, 0, 3:]
        right, up = (seen.at(mesh.uvs) - (base_map.corner or (0, 0))).T
        height, width = base_map.vectors.shape[:2]
        # Blender repeats an image beyond 0 to 1; that of a tile is only used on the tile.
        repeat = base_map.corner is None
        x, y, z = bilinear(base_map.vectors, right * width, (1 - up) * height, repeat=repeat).T[..., None]
        place = row[seen.hit], column[seen.hit]
        without_map[place] = seen.in_camera(normal)
        with_map[place] = seen.in_camera(x * tangent + y * bitangent + z * normal)
        visible[place] = _map_applies(seen, base_map) & seen.from_front
    return without_map, with_map, visible


def _reduce_to_photo_resolution(base_map: BaseMap, mask: Bools, camera: Camera, mesh: Mesh, scene: RayScene) -> F32:
    """The map, reduced to about the photo's resolution on the surface: the photo does not show finer relief."""
    height, width = mask.shape
    rows, columns = chosen_pixels(*reduced_shape(height, width, PROBED_PIXELS), height, width)
    row, column = np.nonzero(mask[np.ix_(rows, columns)])
    pixels = np.stack([columns[column], rows[row]], axis=1) + 0.5
    first, second = (mesh_hits(mesh, camera, scene, pixels + step) for step in ((0, 0), (1, 0)))
    _, of_first, of_second = np.intersect1d(first.hit, second.hit, assume_unique=True, return_indices=True)
    together = first.triangle[of_first] == second.triangle[of_second]
    together &= _map_applies(first, base_map)[of_first]
    vectors = base_map.vectors
    if not together.any():
        return vectors
    steps = (second.at(mesh.uvs)[of_second] - first.at(mesh.uvs)[of_first])[together] * vectors.shape[1::-1]
    texels = float(np.median(np.linalg.norm(steps, axis=1)))
    if texels <= 1:
        return vectors
    return normalised(resampled(vectors, *(max(1, round(side / texels)) for side in vectors.shape[:2])))
