"""Filling: continues the relief where no view sees the surface from what is around it, across seams as well."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.connected_components import connected
from mpsnet_core.arrays.graph_poisson import Graph, Solver, graph_of
from mpsnet_core.arrays.mask_regions import dilated
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.bake.fill_colours import SeamEdges, continued
from mpsnet_core.errors import SettingsError
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.texture import Texture

# (N, 3) unit tangents and bitangents in object space at texels in these rows and columns.
Frames = Callable[[NDArray[np.int64], NDArray[np.int64]], tuple[NDArray[np.float32], NDArray[np.float32]]]


def check_filling(space: str) -> None:
    """Raise SettingsError if a texture in that space cannot be filled."""
    if space != "tangent":
        raise SettingsError("only a texture in tangent space can be filled; bake in tangent space, or do not fill")


def fill_unseen(
    texture: Texture,
    islands: NDArray[np.int32],
    known: NDArray[np.bool_],
    seams: SeamEdges,
    frames: Frames,
    *,
    progress: Progress = silent,
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

    def relief(row: NDArray[np.int64], column: NDArray[np.int64]) -> NDArray[np.float32]:
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


def _solve(
    xy: NDArray[np.float32], islands: NDArray[np.int32], known: NDArray[np.bool_], progress: Progress
) -> NDArray[np.bool_]:
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


def _reached(graph: Graph, rim: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) which unknowns are connected to the rim, (N,)."""
    own = np.arange(len(rim))
    ends = [(own[ahead != own], ahead[ahead != own].astype(np.int64)) for ahead in graph.neighbours[:2]]
    part_of = connected(len(rim), *map(np.concatenate, zip(*ends, strict=True)))
    touched = np.zeros(len(rim), bool)
    touched[part_of[rim]] = True
    return touched[part_of]
