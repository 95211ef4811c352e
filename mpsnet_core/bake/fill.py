"""Filling: what no view sees continues the relief around it, each UV island on its own."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.connected_components import connected
from mpsnet_core.arrays.graph_poisson import Graph, Solver, graph_of
from mpsnet_core.bake.texture import Texture
from mpsnet_core.errors import SettingsError
from mpsnet_core.progress import Progress, part, silent


def check_filling(space: str) -> None:
    """Raises SettingsError where a texture in that space cannot be filled."""
    if space != "tangent":
        raise SettingsError("only a texture in tangent space can be filled; bake in tangent space, or do not fill")


def fill_unseen(
    texture: Texture, islands: NDArray[np.int32], known: NDArray[np.bool_], *, progress: Progress = silent
) -> Texture:
    """The texture with what no view sees filled smoothly from the rim of what some view does.

    Parameters
    ----------
    texture : Texture
        In tangent space, without padding.
    islands : (S, S) int32 array
        Number of the UV island that lies under each texel, from 0; -1 where none does. Nothing reaches from one to
        another, whose tangents differ.
    known : (S, S) bool array
        Texels that are seen as a whole. Of others that are seen in part, the mesh's own normal is in the mean: they are
        replaced as well, though they count as seen.
    progress : Progress

    Returns
    -------
    Texture
        With `filled`. Texels that hang together with none that is seen stay as they are.

    Notes
    -----
    The normals' x and y solve Laplace's equation with the rim's as boundary values, and no change across the islands'
    borders: the smoothest membrane. It stays within the rim's values, so that a unit vector goes with each x and y.
    """
    size = len(islands)
    none = np.empty((0, 2), np.int32)
    graph = graph_of(np.where(known, np.int32(-1), islands), none, np.empty(0, np.float32))
    row, column = graph.cells.T
    # (N,) how many of a texel's neighbours are known, and (N, 2) the sums of their x and y.
    rim, sums = np.zeros(len(row), np.float32), np.zeros((len(row), 2), np.float32)
    for down, right in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        y, x = np.clip(row + down, 0, size - 1), np.clip(column + right, 0, size - 1)
        beside = known[y, x] & (islands[y, x] == graph.islands)
        rim += beside
        sums[beside] += texture.vectors[y[beside], x[beside], :2]
    reached = _reached(graph, rim > 0)
    vectors, filled = texture.vectors.copy(), np.zeros_like(texture.seen)
    if reached.any():
        # What is not reached is held where it is, apart from the rest.
        solver, start = Solver(replace(graph, hold=np.where(reached, rim, 1))), np.zeros_like(rim)
        slopes = []
        for axis in (0, 1):
            step = part(progress, axis / 2, (axis + 1) / 2, "filling what no view sees")
            slopes.append(solver.solve(sums[:, axis], start, step)[reached])
        upright = np.sqrt(np.maximum(1 - slopes[0] ** 2 - slopes[1] ** 2, 0))
        place = row[reached], column[reached]
        vectors[place], filled[place] = np.stack([*slopes, upright], axis=-1), ~texture.seen[place]
    return replace(texture, vectors=vectors, filled=filled)


def _reached(graph: Graph, rim: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N,) which unknowns hang together with any of the rim, (N,)."""
    own = np.arange(len(rim))
    ends = [(own[ahead != own], ahead[ahead != own].astype(np.int64)) for ahead in graph.neighbours[:2]]
    part_of = connected(len(rim), *map(np.concatenate, zip(*ends, strict=True)))
    touched = np.zeros(len(rim), bool)
    touched[part_of[rim]] = True
    return touched[part_of]
