"""Detail added on top of an object's base map, whose relief is kept."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.arrays.resampling import bilinear, chosen_pixels, reduced_shape
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.unit_vectors import dot, normalised, rotated, rotation_between
from mpsnet_core.bake.low_frequency_correction import correct_low_frequencies
from mpsnet_core.bake.map_list import ListedMap, read_map_list
from mpsnet_core.defaults import CONVENTIONS, Convention
from mpsnet_core.errors import FileError, FormatError, SettingsError, check_choice
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.normal_encoding import read_vectors
from mpsnet_core.scene.normal_map import OUTWARDS_SHARE, NormalMap
from mpsnet_core.scene.rays import MeshHits, RayScene, mesh_hits
from mpsnet_core.scene.texture import Texture
from mpsnet_core.scene.texture_names import TOKENS, check_one_texture, map_files
from mpsnet_core.scene.texture_sets import TextureSet

# Tolerance on the unit length of decoded normals: 8 bits, JPEG and averages of steep gradients change it.
NEARLY_UNIT = 0.1
# The fraction of the pixels other than background that must be normals.
NORMALS_SHARE = 0.6
# Background (black, white, neutral grey, transparent) takes the value of normals up to this many pixels away.
MARGIN = 16


def read_base_map(path: AnyPath, *, convention: Convention = "opengl") -> F32:
    """Read the tangent-space normal map of an object.

    Parameters
    ----------
    path : str or PathLike
        An image of 8 or 16 bits or float, of any size. Row 0 is at v = 1.
    convention : {"opengl", "directx"}
        Whether green points up or down.

    Returns
    -------
    (H, W, 3) float32 array
        Unit vectors; +z where the file has no normals.

    Raises
    ------
    FileError
        If the file cannot be read.
    FormatError
        If it is not a normal map, or is one in object space.
    """
    vectors, alpha = read_vectors(path, convention)
    length = np.empty(vectors.shape[:2], np.float32)
    for rows in bands(len(vectors)):
        length[rows] = np.linalg.norm(np.nan_to_num(vectors[rows]), axis=-1)
    # Normals count even where alpha is 0: alpha may hold gloss or height instead.
    unit = np.abs(length - 1) < NEARLY_UNIT
    # Black and white decode to vectors of length sqrt(3), neutral grey to length 0: background.
    opaque = np.ones(length.shape, bool) if alpha is None else alpha > 0
    filled = unit | (opaque & (length > NEARLY_UNIT) & (length < np.sqrt(3) - NEARLY_UNIT))
    if unit.sum() < NORMALS_SHARE * max(filled.sum(), 1):
        raise FormatError(f"{path} is not a normal map: its colours are not unit vectors 0.5 + 0.5 n; choose another")
    normals = unit & (vectors[..., 2] >= 0)
    if normals.sum() < OUTWARDS_SHARE * unit.sum():
        raise FormatError(f"{path} is not in tangent space: many normals point inwards; bake it in tangent space")
    for rows in bands(len(vectors)):
        vectors[rows] = np.where(normals[rows, :, None], normalised(vectors[rows]), [0, 0, 1])
    return extend_to_nearest(vectors, normals, MARGIN)


@takes_files
def blend_detail(texture: Texture, base_map: F32) -> Texture:
    """Blend the texture's normals as detail onto the base map.

    Parameters
    ----------
    texture : Texture
        Detail in tangent space. Where it is flat, the result is the base map.
    base_map : (H, W, 3) float32 array
        Unit vectors in tangent space, resampled to the texture's size. Where it is flat, the result is the texture.

    Returns
    -------
    Texture

    Raises
    ------
    SettingsError
        If the texture is not in tangent space.

    Notes
    -----
    Reoriented Normal Mapping (Barré-Brisebois and Hill, "Blending in Detail", 2012).
    """
    check_blending(texture.space)
    base_map = np.asarray(base_map, np.float32)
    height, width = texture.vectors.shape[:2]
    if base_map.shape[:2] != (height, width):
        base_map = resampled(base_map, height, width)
    vectors = np.empty_like(texture.vectors)
    for rows in bands(height):
        vectors[rows] = reoriented(texture.vectors[rows], normalised(base_map[rows]))
    return replace(texture, vectors=vectors)


def check_blending(space: str) -> None:
    """Raise SettingsError if textures in that space cannot be blended."""
    if space != "tangent":
        raise SettingsError("only a texture in tangent space can go on top of an existing map; bake in tangent space")


def reoriented(detail: F32, base: F32) -> F32:
    """Detail (..., 3) turned by the shortest rotation from +z to the base (..., 3); unit vectors in tangent space.

    Reoriented Normal Mapping: Barré-Brisebois and Hill, "Blending in Detail" (2012), its closed form of the rotation,
    r = t (t·u) / t_z - u for t = base + (0, 0, 1) and u = detail with x and y negated.
    """
    t = base + np.array([0, 0, 1], np.float32)
    u = detail * np.array([-1, -1, 1], np.float32)
    along = dot(t, u) / np.maximum(t[..., 2], 1e-6)
    return normalised(t * along[..., None] - u)


def resampled(vectors: F32, height: int, width: int) -> F32:
    """Resample to another size: linear interpolation to enlarge, area means to reduce."""
    region = oiio.ROI(0, width, 0, height, 0, 1, 0, 3)
    result = oiio.ImageBufAlgo.resize(oiio.ImageBuf(np.ascontiguousarray(vectors)), filtername="triangle", roi=region)
    return np.asarray(result.get_pixels(oiio.FLOAT), np.float32)


# ----------------------------------------------------------------------------------------------------------------------
# Removal of the base map's relief from a view's normals, because adding detail to the map would double it.
#
# A photo shows the relief of a map that was made from the same object, but not of one that was sculpted.


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
        mapped = NormalMap(with_map, seen)
        view, relief = (correct_low_frequencies(one, camera, mesh, scene).vectors for one in (given, mapped))
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


# ----------------------------------------------------------------------------------------------------------------------
# Base maps of textures, found by the tokens of the textures' names or in a list file.


@dataclass(frozen=True)
class MapFile:
    """The file of a base map."""

    file: Path
    """The file."""
    convention: Convention
    """Which way its green channel points."""


def base_map_files(given: AnyPath, convention: Convention, texture_sets: Sequence[TextureSet]) -> list[MapFile | None]:
    """The base map of each texture set, None where there is none.

    given: an image, whose name may contain the same tokens <UDIM>, <MATERIAL> and <OBJECT> as the textures' names; or a
    .json file that lists several (:mod:`mpsnet_core.bake.map_list`), of which the first that matches a texture set's
    object and material applies. convention: of the image, and of listed maps without one.

    Raises InputError if the list is malformed, a name has a token that the textures are not split by, or no texture set
    has a map.
    """
    base_files: list[MapFile | None] = [None] * len(texture_sets)
    is_list = Path(given).suffix.lower() == ".json"
    listed = read_map_list(given) if is_list else [ListedMap(Path(given))]
    sought: list[Path | None] = [None] * len(texture_sets)
    for entry in listed:
        points = entry.convention or convention
        check_choice("convention", points, CONVENTIONS)
        for number, (texture_set, file) in enumerate(
            zip(texture_sets, map_files(entry.file, texture_sets), strict=True)
        ):
            meant = entry.object in (None, texture_set.object) and entry.material in (None, texture_set.material)
            # Not every object or tile needs a map. A missing file whose name has no tokens fails when it is read.
            if meant and base_files[number] is None:
                sought[number] = file
                if file == entry.file or file.is_file():
                    base_files[number] = MapFile(file, points)
    if not any(base_files):
        check = "the objects, materials and files in it" if is_list else f"the path, and {', '.join(TOKENS)} in it"
        raise FileError(f"{given}: there is no existing map for any of the textures; check {check}")
    for texture_set, found, missing in zip(texture_sets, base_files, sought, strict=True):
        if found is None:
            named = f" {missing}" if missing else ""
            log.info("%s: there is no existing map%s, so nothing lies beneath its texture", texture_set.named, named)
    return base_files


def one_base_map(file: str, convention: Convention, shown: BaseMapInPhotos) -> BaseMap:
    """The base map of every texture of a sequence.

    Raises InputError if the file stands for several maps, or cannot be read.
    """
    check_one_texture(file)
    if Path(file).suffix.lower() == ".json":
        raise SettingsError(f"{file} lists existing maps for several textures; name one image for the detail")
    return BaseMap(read_base_map(file, convention=convention), shown)


class BaseMaps(Sequence[BaseMap]):
    """The base maps of meshes, read on request. The last one stays in memory. All are read once at construction.

    Texture sets that share a map and a unit square of UV space share one :class:`BaseMap`, whose triangles are those of
    the joined meshes (:func:`mpsnet_core.scene.mesh.join_meshes`).

    base_files: from :func:`base_map_files`, for the texture sets.

    Raises InputError if a map cannot be read.
    """

    def __init__(
        self,
        base_files: Sequence[MapFile | None],
        texture_sets: Sequence[TextureSet],
        meshes: Sequence[Mesh],
        shown: BaseMapInPhotos,
    ) -> None:
        self.shown = shown
        together: dict[tuple[MapFile, tuple[int, int] | None], list[TextureSet]] = {}
        for texture_set, map_file in zip(texture_sets, base_files, strict=True):
            if map_file is not None:
                together.setdefault((map_file, None if texture_set.tile is None else texture_set.corner), []).append(
                    texture_set
                )
        self._maps = [(*key, _triangles(parts, meshes)) for key, parts in together.items()]
        self._number = {texture_set: number for number, parts in enumerate(together.values()) for texture_set in parts}
        self._last: tuple[MapFile, F32] | None = None
        for map_file in dict.fromkeys(key for key, _ in together):
            self._vectors(map_file)  # an unreadable map fails before the long work

    def __len__(self) -> int:
        return len(self._maps)

    def __getitem__(self, number: int) -> BaseMap:  # type: ignore[override]  # nothing takes slices
        one, corner, triangles = self._maps[number]
        return BaseMap(self._vectors(one), self.shown, triangles, corner)

    def vectors_for(self, texture_set: TextureSet) -> F32 | None:
        """(H, W, 3) the vectors of a texture set's base map, None if it has none."""
        number = self._number.get(texture_set)
        return None if number is None else self._vectors(self._maps[number][0])

    def in_photos(self) -> Sequence[BaseMap]:
        """The maps whose relief the photos may show."""
        return () if self.shown == "no" else self

    def _vectors(self, map_file: MapFile) -> F32:
        if self._last is None or self._last[0] != map_file:
            self._last = None  # free it before the next is read: each may be large
            self._last = map_file, read_base_map(map_file.file, convention=map_file.convention)
        return self._last[1]


def _triangles(texture_sets: Sequence[TextureSet], meshes: Sequence[Mesh]) -> Bools | None:
    """(T,) which of the meshes' triangles belong to the texture sets; None for all."""
    if any(all(part is None for part in texture_set.parts) for texture_set in texture_sets):
        return None
    ends = np.cumsum([0] + [len(mesh.triangles) for mesh in meshes])
    applies = np.zeros(ends[-1], bool)
    for texture_set in texture_sets:
        for start, end, part in zip(ends[:-1], ends[1:], texture_set.parts, strict=True):
            applies[start:end][slice(None) if part is None else part] = True
    return applies
