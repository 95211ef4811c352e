"""A mesh's UV islands, and the seams where they meet on the surface."""

import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.mask_regions import connected
from mpsnet_core.arrays.rasterize import texel_areas
from mpsnet_core.arrays.types import F64, I32, I64
from mpsnet_core.errors import GeometryError, InputError
from mpsnet_core.scene.mesh import Labels, Mesh

# UVs closer than this coincide; a texel of the largest texture is 60 times as wide.
SAME_UV = 1e-6
# Limit of whole numbers.
FARTHEST = 2.0**62
# A direction that is unlikely to lie in a plane of symmetry.
ASKEW = np.array([0.62, 0.55, 0.56])


@dataclass(frozen=True)
class Islands:
    """UV islands: triangles that are connected in UV space, and the seams that separate them on the surface."""

    of_triangle: I32
    """(T,). Number of each triangle's island, from 0. Islands are ordered by their position in space, which does not
    change when the mesh is subdivided."""
    seam_uvs: F64
    """(E, 2 sides, 2 ends, 2). UVs of the surface's edges that lie at two places in the texture. The ends are in the
    same order on both sides."""
    seam_islands: I32
    """(E, 2). The island on either side."""

    @property
    def count(self) -> int:
        """The number of islands."""
        return int(self.of_triangle.max()) + 1


def islands_of(mesh: Mesh) -> Islands:
    """A mesh's islands. Vertices at the same point, which some files split at seams, are merged. An edge of more than
    two triangles joins them in pairs."""
    places = welded(mesh)
    texture = np.round(np.clip(mesh.uvs.astype(np.float64) / SAME_UV, -FARTHEST, FARTHEST)).astype(np.int64)
    start, end = (0, 1, 2), (1, 2, 0)
    ends = np.stack([places[:, start], places[:, end]], axis=-1).reshape(-1, 2)
    rounded = np.stack([texture[:, start], texture[:, end]], axis=2).reshape(-1, 2, 2)
    uvs = np.stack([mesh.uvs[:, start], mesh.uvs[:, end]], axis=2).reshape(-1, 2, 2).astype(np.float64)
    turned = ends[:, 0] > ends[:, 1]
    for values in (ends, rounded, uvs):
        values[turned] = values[turned, ::-1]
    order = np.lexsort((*rounded.reshape(-1, 4).T, ends[:, 1], ends[:, 0]))
    one, other = order[:-1], order[1:]
    shared = (ends[one] == ends[other]).all(axis=1)
    same = (rounded[one] == rounded[other]).all(axis=(1, 2))
    root = connected(len(places), one[shared & same] // 3, other[shared & same] // 3)
    islands = _in_order(mesh, np.unique(root, return_inverse=True)[1].reshape(-1))
    sides = np.stack([one, other], axis=1)[shared & ~same]
    return Islands(islands, uvs[sides], islands[sides // 3])


def welded(mesh: Mesh) -> I64:
    """(T, 3) vertex indices of the triangles' corners, equal for vertices at the same point."""
    return np.unique(mesh.vertices, axis=0, return_inverse=True)[1].reshape(-1)[mesh.triangles]


def _in_order(mesh: Mesh, islands: I64) -> I32:
    middles = mesh.vertices[mesh.triangles].mean(axis=1) @ ASKEW
    mean = np.bincount(islands, middles) / np.bincount(islands)
    rank = np.empty(len(mean), np.int32)
    rank[np.argsort(mean)] = np.arange(len(mean), dtype=np.int32)
    return rank[islands]


# ----------------------------------------------------------------------------------------------------------------------
# Texture sets: which parts of which meshes share a texture, by UDIM tiles, materials and objects.
#
# UDIM numbers the unit squares of UV space as 1001 + u + 10 v, ten squares to a row. Mari introduced it.


log = logging.getLogger(__name__)

FIRST_TILE, TILES_IN_A_ROW, ROWS_OF_TILES = 1001, 10, 100
# Models have a few tiles, hero assets of films some dozens. UVs in more are not scaled to unit squares.
MAX_TILES = 100
# UVs that exceed a unit square by up to this count as ending at its border.
ROUNDING = 1e-5
# Names for triangles without one.
NAMELESS = {"material": "no_material", "object": "object"}


@dataclass(frozen=True, eq=False)
class TextureSet:
    """Parts of meshes that share one texture. Compared by identity.

    Examples
    --------
    >>> TextureSet((None,), tile=1012).corner
    (1, 1)
    """

    parts: tuple[I64 | None, ...]
    """For each mesh, (K,) int64 indices of its triangles in the set; None for all of them."""
    tile: int | None = None
    """Number of the UDIM tile; None for the unit square from 0 to 1."""
    material: str | None = None
    """Name of the material, if textures are split by materials."""
    object: str | None = None
    """Name of the object, if textures are split by objects."""

    @property
    def corner(self) -> tuple[int, int]:
        """The unit square's lower left corner in UV space."""
        row, column = divmod((self.tile or FIRST_TILE) - FIRST_TILE, TILES_IN_A_ROW)
        return column, row

    @property
    def named(self) -> str:
        """Its name for messages, "" for the only set."""
        names = {"object": self.object, "material": self.material, "tile": self.tile}
        return ", ".join(f"{what} {name}" for what, name in names.items() if name is not None)


def texture_sets(
    meshes: Sequence[Mesh], *, tiles: bool = False, materials: bool = False, objects: bool = False
) -> list[TextureSet]:
    """The texture sets of meshes: one for all, or one for each UDIM tile, material and object, or their combinations.

    Materials with the same name are merged across meshes. Objects of different meshes are not: equal names are
    numbered.

    Raises GeometryError if the UVs have no area, none lies in any texture's unit square, or they lie in more than
    `MAX_TILES` tiles.
    """
    if not any(texel_areas(mesh.uvs).any() for mesh in meshes):
        raise GeometryError("the mesh's UVs have no area; unwrap it in Blender (UV > Smart UV Project)")
    found = []
    for obj, material, parts in _groups(meshes, materials, objects):
        group = TextureSet(parts, None, material, obj)
        if not tiles:
            found.append(group)
            continue
        try:
            found += _tiles(meshes, group)
        except InputError as error:
            raise type(error)(f"{group.named}: {error}" if group.named else str(error)) from None
    if tiles:
        _log_islands_across_tiles(meshes)
        _log_uvs_outside_tiles(meshes, "the UDIM tiles", TILES_IN_A_ROW, ROWS_OF_TILES)
    else:
        _log_uvs_outside_tiles(meshes, "0 to 1", 1, 1)
    return found


def _groups(
    meshes: Sequence[Mesh], materials: bool, objects: bool
) -> Iterator[tuple[str | None, str | None, tuple[I64 | None, ...]]]:
    """Yield object, material, and for each mesh the triangles that belong to both."""
    if not (materials or objects):
        yield None, None, (None,) * len(meshes)
        return
    groups: dict[tuple[str | None, str | None], list[I64]] = {}
    taken: Counter[str] = Counter()
    for place, mesh in enumerate(meshes):
        object_names, object_of = _labels(mesh, mesh.objects, "object", objects)
        material_names, material_of = _labels(mesh, mesh.materials, "material", materials)
        distinct = [_numbered(name, taken) for name in object_names] if objects else [None]
        for key in np.unique(object_of * len(material_names) + material_of):
            one, other = divmod(int(key), len(material_names))
            triangles = np.flatnonzero((object_of == one) & (material_of == other))
            name = (distinct[one], material_names[other] if materials else None)
            parts = groups.setdefault(name, [np.empty(0, np.int64) for _ in meshes])
            parts[place] = triangles
    for (obj, material), parts in groups.items():
        yield obj, material, tuple(parts)


def _labels(mesh: Mesh, labels: Labels | None, what: str, split: bool) -> tuple[list[str], I64]:
    if not split or labels is None:
        return [NAMELESS[what]], np.zeros(len(mesh.triangles), np.int64)
    return [name or NAMELESS[what] for name in labels.names], labels.number.astype(np.int64)


def _numbered(name: str, taken: Counter[str]) -> str:
    """The name, with a number appended if it is taken."""
    while True:
        taken[name] += 1
        numbered = name if taken[name] == 1 else f"{name}_{taken[name]}"
        if numbered == name or not taken[numbered]:
            taken[numbered] += numbered != name
            return numbered


def _tiles(meshes: Sequence[Mesh], group: TextureSet) -> list[TextureSet]:
    """The group's tiles in order. A triangle that crosses a tile's border is in both tiles."""
    reaches = [_reach(mesh, part) for mesh, part in zip(meshes, group.parts, strict=True)]
    tiles = {number for low, high in reaches for number in _tile_numbers(low, high)}
    if not tiles:
        raise GeometryError("all UVs lie outside the UDIM tiles, of which 1001 is 0 to 1; move the islands into them")
    if len(tiles) > MAX_TILES:
        raise GeometryError(
            f"the UVs lie in {len(tiles)} UDIM tiles, more than the {MAX_TILES} that are baked at once; scale the UV "
            "islands so that each tile is a unit square"
        )
    found = []
    for number in sorted(tiles):
        texture_set = TextureSet((), number, group.material, group.object)
        parts = []
        for (low, high), part in zip(reaches, group.parts, strict=True):
            within = np.flatnonzero(((low <= texture_set.corner) & (high >= texture_set.corner)).all(axis=1))
            parts.append(within if part is None else part[within])
        found.append(TextureSet(tuple(parts), number, group.material, group.object))
    return found


def _reach(mesh: Mesh, part: I64 | None) -> tuple[I64, I64]:
    """(K, 2) lower left corners of the first and the last unit square that each triangle covers."""
    uvs = mesh.uvs if part is None else mesh.uvs[part]
    # Clip to one beyond the tiles: enough to tell what is outside, and int64 cannot overflow.
    limits = (-1, (TILES_IN_A_ROW, ROWS_OF_TILES))
    low = np.clip(np.floor(uvs.min(axis=1).astype(np.float64) + ROUNDING), *limits).astype(np.int64)
    high = np.clip(np.ceil(uvs.max(axis=1).astype(np.float64) - ROUNDING) - 1, *limits).astype(np.int64)
    return low, np.maximum(low, high)


def _tile_numbers(low: I64, high: I64) -> set[int]:
    numbers = set()
    for first_u, first_v, last_u, last_v in np.unique(np.concatenate([low, high], axis=1), axis=0).tolist():
        for v in range(max(first_v, 0), min(last_v, ROWS_OF_TILES - 1) + 1):
            for u in range(max(first_u, 0), min(last_u, TILES_IN_A_ROW - 1) + 1):
                numbers.add(FIRST_TILE + u + TILES_IN_A_ROW * v)
    return numbers


def _log_uvs_outside_tiles(meshes: Sequence[Mesh], where: str, width: int, height: int) -> None:
    """Log triangles outside all textures. Raises GeometryError if all are."""
    limit = np.array([width, height])
    count = sum(int(((m.uvs < -1e-4) | (m.uvs > limit + 1e-4)).any(axis=(1, 2)).sum()) for m in meshes)
    bounds = [(mesh.uvs.min(axis=(0, 1)), mesh.uvs.max(axis=(0, 1))) for mesh in meshes]
    if all((high <= 0).any() or (low >= limit).any() for low, high in bounds):
        raise GeometryError(
            f"all of the mesh's UVs lie outside the texture ({where}); move the UV islands into it, or bake UDIM tiles "
            "(<UDIM> in the file's name) [uvs-outside]"
        )
    if count:
        total = sum(len(mesh.triangles) for mesh in meshes)
        tiles = "" if width * height > 1 else "; bake UDIM tiles (<UDIM> in the file's name) to have them too"
        log.warning("%d of %d triangles have UVs outside %s, where no texture is%s", count, total, where, tiles)


def _log_islands_across_tiles(meshes: Sequence[Mesh]) -> None:
    """Log UV islands that lie in several tiles: a texture and its padding end at the tile's border."""
    crossing = sum(_crossing_islands(mesh) for mesh in meshes)
    if crossing:
        islands = "1 UV island lies" if crossing == 1 else f"{crossing} UV islands lie"
        log.info("%s across the border of two UDIM tiles; filtered textures show it as a seam", islands)


def _crossing_islands(mesh: Mesh) -> int:
    low, high = _reach(mesh, None)
    if (low == low[0]).all() and (high == low[0]).all():
        return 0
    island = islands_of(mesh).of_triangle
    least, most = (np.full((int(island.max()) + 1, 2), start) for start in (1 << 30, -1))
    np.minimum.at(least, island, low)
    np.maximum.at(most, island, high)
    return int(((most > least).any(axis=1) & (most[:, 0] >= 0)).sum())
