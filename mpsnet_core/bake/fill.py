"""Filling: continues relief and colours where no view sees the surface from what is around it, across seams as well.

The texture's texels are merged into cells of an island in a block of the texture. Cells are linked with their
neighbours in the texture and with those beyond the island's seams, and Laplace's equation on this graph continues what
is known.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mpsnet_core.arrays.graph_poisson import Graph, Solver, graph_of
from mpsnet_core.arrays.mask_regions import connected, dilated
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, F64, I32, I64, Bools
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.errors import SettingsError
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.texture import Texture

# Blocks across a texture, and texels of each that are looked at: what is filled is smooth.
BLOCKS, LOOKED_AT = 256, 4


# To the right, below, to the left, above: columns and rows, as in a Graph.
_SIDES = ((1, 0), (0, 1), (-1, 0), (0, -1))


@dataclass(frozen=True)
class SeamEdges:
    """E edges of the surface that lie at two places in a texture."""

    uvs: F64
    """(E, 2 sides, 2 ends, 2). UVs in the texture's unit square."""
    islands: I32
    """(E, 2). The islands on either side."""


@dataclass(frozen=True)
class _Cells:
    """N cells: the parts of islands in the blocks of a texture."""

    shape: tuple[int, int]
    """Height and width of the texture."""
    side: int
    """Width and height of a block in texels."""
    count: int
    """Number of islands."""
    keys: I64
    """(N,) ascending. The block and the island of each, see :meth:`key`."""

    def key(self, row: I64, column: I64, island: I32) -> I64:
        """Keys of blocks' islands; -1 where the island is -1, or the block beside the texture."""
        columns = -(-self.shape[1] // self.side)
        inside = (island >= 0) & (column >= 0) & (column < columns) & (row >= 0)
        return np.where(inside, (row * columns + column) * self.count + island, -1)

    def places(self) -> tuple[I64, I64, I32]:
        """(N,) each: row and column of the block, and the island."""
        block, island = np.divmod(self.keys, self.count)
        return *np.divmod(block, -(-self.shape[1] // self.side)), island.astype(np.int32)

    def number(self, key: I64) -> I64:
        """The cells of keys; -1 where there is none."""
        place = np.minimum(np.searchsorted(self.keys, key), len(self.keys) - 1)
        return np.where(self.keys[place] == key, place, -1)


@dataclass(frozen=True)
class Continued:
    """Values of K kinds, continued over a surface."""

    cells: _Cells
    """The cells."""
    values: F64
    """(N, K). The value of each."""
    touched: Bools
    """(N,). The cells that the surface links with a known one. The others have the mean of all known ones."""

    def at(self, row: I64, column: I64, island: I32) -> tuple[F32, Bools]:
        """(M, K) values at texels, bilinear between the cells of their island, and (M,) whether these are touched."""
        side = self.cells.side
        y, x = (row + 0.5) / side - 0.5, (column + 0.5) / side - 0.5
        top, left = np.floor(y).astype(np.int64), np.floor(x).astype(np.int64)
        total, weight = np.zeros((len(row), self.values.shape[1]), np.float32), np.full(len(row), 1e-12, np.float32)
        touched = np.zeros(len(row), bool)
        for down, right in np.ndindex(2, 2):
            cell = self.cells.number(self.cells.key(top + down, left + right, island))
            share = np.abs(1 - down - (y - top)) * np.abs(1 - right - (x - left)) * (cell >= 0) + 1e-9 * (cell >= 0)
            total += (self.values[cell] * share[:, None]).astype(np.float32)
            weight += share.astype(np.float32)
            touched |= self.touched[cell] & (cell >= 0)
        return total / weight[:, None], touched


def continued(values_at: Callable[[I64, I64], F32], islands: I32, known: Bools, seams: SeamEdges) -> Continued:
    """Continue what is known at texels over the surface.

    values_at: (M, K) of known texels in these rows and columns, (M,) each; they must mean the same on all islands.
    islands: (H, W), -1 where there is none. known: (H, W), somewhere on an island.
    """
    side = max(1, -(-max(islands.shape) // BLOCKS))
    step = max(1, side // LOOKED_AT)
    island = islands[::step, ::step]
    rows, columns = np.indices(island.shape, np.int64) * step
    cells = _Cells((len(islands), islands.shape[1]), side, int(islands.max()) + 1, np.empty(0, np.int64))
    key = cells.key(rows // side, columns // side, island)
    cells = replace(cells, keys=np.unique(key[key >= 0]))
    seen = known[::step, ::step] & (key >= 0)
    of_cell, looked_at, count = cells.number(key[seen]), values_at(rows[seen], columns[seen]), len(cells.keys)
    amount = np.bincount(of_cell, minlength=count)
    sums = [np.bincount(of_cell, one, count).astype(np.float64) for one in looked_at.T]
    values: F64 = np.stack(sums, axis=1) / np.maximum(amount, 1)[:, None]
    ties = _across(seams, cells)
    touched = _solved(values, amount > 0, cells, ties[(ties >= 0).all(axis=1) & (ties[:, 0] != ties[:, 1])])
    return Continued(cells, values, touched)


def fill_colours(colours: F32, islands: I32, known: Bools, seams: SeamEdges) -> None:
    """Fill unknown colours on UV islands in place.

    Islands that no known colour reaches get the mean of all known ones.

    colours: (H, W, 3). islands: (H, W), -1 where there is none. known: (H, W).
    """
    if not known.any() or (known | (islands < 0)).all():
        return
    found = continued(lambda row, column: colours[row, column], islands, known, seams)
    for band in bands(len(islands)):
        row, column = np.nonzero((islands[band] >= 0) & ~known[band])
        colours[band][row, column] = found.at(row + band.start, column, islands[band][row, column])[0]


def _across(seams: SeamEdges, cells: _Cells) -> I64:
    """(M, 2) the cells on either side of points along the seams, about a block apart; -1 where there is none."""
    height, width = cells.shape
    places = np.stack([seams.uvs[..., 0] * width, (1 - seams.uvs[..., 1]) * height], axis=-1) / cells.side
    near = (np.abs(places) < 4 * BLOCKS).all(axis=(1, 2, 3))
    places, islands = places[near], seams.islands[near]
    lengths = np.linalg.norm(places[:, :, 1] - places[:, :, 0], axis=-1).max(axis=1)
    points = np.ceil(np.maximum(lengths, 1)).astype(np.int64)
    edge = np.repeat(np.arange(len(points)), points)
    along = (np.arange(len(edge)) - (np.cumsum(points) - points)[edge] + 0.5) / points[edge]
    at = places[edge, :, 0] + along[:, None, None] * (places[edge, :, 1] - places[edge, :, 0])
    found = np.full((len(edge), 2), -1, np.int64)
    for down, right in sorted(np.ndindex(3, 3), key=lambda by: abs(by[0] - 1) + abs(by[1] - 1)):
        column, row = np.moveaxis(np.floor(at).astype(np.int64), -1, 0)
        there = cells.number(cells.key(row + (down - 1), column + (right - 1), islands[edge]))
        found = np.where(found < 0, there, found)
    return found


def _solved(values: F64, known: Bools, cells: _Cells, ties: I64) -> Bools:
    """Continue known values (N, K) over all cells in place. Returns (N,) the cells that are linked with a known one.

    ties: (M, 2) cells that touch at seams.
    """
    row, column, island = cells.places()
    sides = [cells.number(cells.key(row + down, column + right, island)) for right, down in _SIDES]
    own = np.arange(len(known))
    ends = [np.stack([own, beside], axis=1)[beside >= 0] for beside in sides[:2]]
    part = connected(len(known), *np.concatenate([*ends, ties]).T)
    touched = np.zeros(len(known), bool)
    touched[part[known]] = True
    touched = touched[part]
    mean, unknown = values[known].mean(axis=0), np.flatnonzero(touched & ~known)
    values[~known] = mean  # also of islands that nothing known touches
    if not len(unknown):
        return touched
    place = np.full(len(known) + 1, -1, np.int32)  # the last is that of no cell
    place[unknown] = np.arange(len(unknown), dtype=np.int32)
    hold, sums = np.zeros(len(unknown), np.float32), np.zeros((len(unknown), values.shape[1]))
    linked = [(np.arange(len(unknown)), beside[unknown]) for beside in sides]
    linked += [(place[one], other) for one, other in (ties.T, ties[:, ::-1].T)]
    for one, other in linked:
        rim = (one >= 0) & (other >= 0) & known[other]
        np.add.at(hold, one[rim], np.float32(1))
        np.add.at(sums, one[rim], values[other[rim]])
    neighbours = np.stack([place[beside[unknown]] for beside in sides])
    weights = (neighbours >= 0).astype(np.float32)
    neighbours = np.where(neighbours >= 0, neighbours, np.arange(len(unknown), dtype=np.int32))
    among = place[ties][(place[ties] >= 0).all(axis=1)]
    position = np.stack([row, column], axis=1)[unknown].astype(np.int32)
    solver = Solver(Graph(position, island[unknown], neighbours, weights, among, np.ones(len(among), np.float32), hold))
    for channel in range(values.shape[1]):
        begin = np.full(len(unknown), mean[channel], np.float32)
        values[unknown, channel] = solver.solve(sums[:, channel].astype(np.float32), begin)
    return touched


# (N, 3) unit tangents and bitangents in object space at texels in these rows and columns.
Frames = Callable[[I64, I64], tuple[F32, F32]]


def check_filling(space: str) -> None:
    """Raise SettingsError if a texture in that space cannot be filled."""
    if space != "tangent":
        raise SettingsError("only a texture in tangent space can be filled; bake in tangent space, or do not fill")


def fill_unseen(
    texture: Texture, islands: I32, known: Bools, seams: SeamEdges, frames: Frames, *, progress: Progress = silent
) -> Texture:
    """Fill the unseen texels smoothly from the rim of the seen ones.

    Parameters
    ----------
    texture : Texture
        A tangent-space texture without padding.
    islands : (H, W) int32 array
        Number of the UV island under each texel, from 0; -1 where there is none.
    known : (H, W) bool array
        Fully seen texels. Partly seen ones are averaged with the mesh's own normal: they are replaced as well, although
        they count as seen.
    seams : SeamEdges
        Where islands meet on the surface.
    frames : Frames
        The surface's tangents and bitangents, which differ from island to island.
    progress : Progress

    Returns
    -------
    Texture
        The texture with `filled`. Unseen texels that the surface does not connect to a seen one are unchanged.

    Notes
    -----
    What is continued is the relief, ``x T + y B``, a vector in object space, by Laplace's equation. Near the rim, x and
    y are solved again, texel by texel. Both stay within the range of the rim: a unit vector exists for each x, y.
    """
    on_islands = known & (islands >= 0)
    if not on_islands.any():
        return replace(texture, filled=np.zeros_like(known))

    def relief(row: I64, column: I64) -> F32:
        tangent, bitangent = frames(row, column)
        x, y = texture.vectors[row, column, :2].T[..., None]
        return x * tangent + y * bitangent

    found = continued(relief, islands, known, seams)
    xy, reached = texture.vectors[..., :2].copy(), np.zeros_like(known)
    for band in bands(len(islands)):
        row, column = np.nonzero((islands[band] >= 0) & ~known[band])
        values, touched = found.at(row + band.start, column, islands[band][row, column])
        row, column = row[touched] + band.start, column[touched]
        tangent, bitangent = frames(row, column)
        xy[row, column] = np.stack([dot(values[touched], tangent), dot(values[touched], bitangent)], axis=-1)
        reached[row, column] = True
    if found.cells.side > 1:
        settled = reached & ~dilated(on_islands, found.cells.side)
        reached |= _solve(xy, islands, known | settled, progress)
    vectors, place = texture.vectors.copy(), np.nonzero(reached)
    upright = np.sqrt(np.maximum(1 - dot(xy[place], xy[place]), 0))
    vectors[place] = np.concatenate([xy[place], upright[:, None]], axis=-1)
    return replace(texture, vectors=vectors, filled=reached & ~texture.seen)


def _solve(xy: F32, islands: I32, known: Bools, progress: Progress) -> Bools:
    """Solve for the unknown values in place. Returns (H, W) which of them were reached."""
    height, width = islands.shape
    none = np.empty((0, 2), np.int32)
    graph = graph_of(np.where(known, np.int32(-1), islands), none, np.empty(0, np.float32))
    row, column = graph.cells.T
    # (N,) how many of a texel's neighbours are known, and (N, 2) the sums of their values.
    rim, sums = np.zeros(len(row), np.float32), np.zeros((len(row), 2), np.float32)
    for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        y, x = np.clip(row + down, 0, height - 1), np.clip(column + right, 0, width - 1)
        next_to_known = known[y, x] & (islands[y, x] == graph.islands)
        rim += next_to_known
        sums[next_to_known] += xy[y[next_to_known], x[next_to_known]]
    filled = np.zeros_like(known)
    reached = _reached(graph, rim > 0)
    if reached.any():
        # Unreached unknowns are pinned, to keep the system regular.
        solver, start = Solver(replace(graph, hold=np.where(reached, rim, 1))), np.zeros_like(rim)
        place = row[reached], column[reached]
        for axis in (0, 1):
            step = part(progress, axis / 2, (axis + 1) / 2, "filling what no view sees")
            xy[(*place, axis)] = solver.solve(sums[:, axis], start, step)[reached]
        filled[place] = True
    return filled


def _reached(graph: Graph, rim: Bools) -> Bools:
    """(N,) which unknowns are connected to the rim, (N,)."""
    own = np.arange(len(rim))
    ends = [(own[ahead != own], ahead[ahead != own].astype(np.int64)) for ahead in graph.neighbours[:2]]
    part_of = connected(len(rim), *map(np.concatenate, zip(*ends, strict=True)))
    touched = np.zeros(len(rim), bool)
    touched[part_of[rim]] = True
    return touched[part_of]
