"""Filling: inpaints normals where no view sees the surface from the relief around it, in each UV island separately."""

from dataclasses import replace

import numpy as np

from mpsnet_core.arrays.connected_components import connected
from mpsnet_core.arrays.graph_poisson import Graph, Solver, graph_of
from mpsnet_core.arrays.mask_regions import dilated
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, I32, Bools
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.arrays.upsample import upsampled
from mpsnet_core.errors import SettingsError
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.texture import Texture

# Larger textures are solved at half the size first.
FINEST = 512
# Texels this far from the rim keep the solution of the half-size texture.
BAND = 4


def check_filling(space: str) -> None:
    """Raise SettingsError if a texture in that space cannot be filled."""
    if space != "tangent":
        raise SettingsError("only a texture in tangent space can be filled; bake in tangent space, or do not fill")


def fill_unseen(texture: Texture, islands: I32, known: Bools, *, progress: Progress = silent) -> Texture:
    """Fill the unseen texels smoothly from the rim of the seen ones.

    Parameters
    ----------
    texture : Texture
        A tangent-space texture without padding.
    islands : (H, W) int32 array
        Number of the UV island under each texel, from 0; -1 where there is none. Nothing is carried from one island to
        another, because their tangents differ.
    known : (H, W) bool array
        Fully seen texels. Partly seen ones are averaged with the mesh's own normal: they are replaced as well, although
        they count as seen.
    progress : Progress

    Returns
    -------
    Texture
        The texture with `filled`. Unseen texels that are not connected to a seen one are unchanged.

    Notes
    -----
    The normals' x and y solve Laplace's equation, with the rim as Dirichlet boundary and zero flux (Neumann) across the
    islands' borders. By the maximum principle they stay within the rim's range, so a unit vector exists for each x, y.
    """
    xy, reached = _membrane(texture.vectors[..., :2], islands, known, progress)
    vectors, place = texture.vectors.copy(), np.nonzero(reached)
    upright = np.sqrt(np.maximum(1 - dot(xy[place], xy[place]), 0))
    vectors[place] = np.concatenate([xy[place], upright[:, None]], axis=-1)
    return replace(texture, vectors=vectors, filled=reached & ~texture.seen)


def _membrane(xy: F32, islands: I32, known: Bools, progress: Progress) -> tuple[F32, Bools]:
    """(H, W, 2) the values, with unknown ones solved as in :func:`fill_unseen`, and (H, W) which of these were reached.

    A large texture is solved at half the size first. That is exact enough where the solution is smooth; only bands
    along the rim and the islands' borders are solved again.
    """
    xy, settled = xy.copy(), np.zeros_like(known)
    if max(islands.shape) > FINEST:
        coarse, blocks, even = _half_size_membrane(xy, islands, known, progress)
        near = dilated(known, BAND)
        height, width = islands.shape
        for rows in bands(height):
            over = np.arange(height)[rows] // 2
            from_coarse = np.repeat(even[over], 2, axis=1)[:, :width] & ~near[rows]
            from_coarse &= np.repeat(blocks[over], 2, axis=1)[:, :width] == islands[rows]
            doubled = upsampled(coarse, (2 * len(coarse), 2 * coarse.shape[1]), rows)[:, :width]
            xy[rows][from_coarse], settled[rows] = doubled[from_coarse], from_coarse
    reached = _solve(xy, islands, known | settled, part(progress, 0.5, 1.0))
    return xy, reached | settled


def _half_size_membrane(xy: F32, islands: I32, known: Bools, progress: Progress) -> tuple[F32, I32, Bools]:
    """:func:`_membrane` at half the size: values, islands, and whether a texel's whole neighbourhood has values and
    lies in one island."""
    height, width = (-(-length // 2) for length in islands.shape)
    quarters = [np.s_[down::2, right::2] for down, right in np.ndindex(2, 2)]
    blocks = np.full((height, width), -1, np.int32)
    for quarter in quarters:
        part_of = islands[quarter]
        inside = np.s_[: part_of.shape[0], : part_of.shape[1]]
        blocks[inside] = np.maximum(blocks[inside], part_of)
    total, count = np.zeros((height, width, 2), np.float32), np.zeros((height, width), np.uint8)
    for quarter in quarters:
        part_of = islands[quarter]
        inside = np.s_[: part_of.shape[0], : part_of.shape[1]]
        own = known[quarter] & (part_of == blocks[inside])
        total[inside] += np.where(own[..., None], xy[quarter], np.float32(0))
        count[inside] += own
    total /= np.maximum(count, 1)[..., None]
    coarse, reached = _membrane(total, blocks, count > 0, part(progress, 0.0, 0.5))
    valued = np.where(reached | (count > 0), blocks, np.int32(-1))
    padded = np.pad(valued, 1, constant_values=-1)
    even = valued >= 0
    for down, right in np.ndindex(3, 3):
        even &= padded[down : down + height, right : right + width] == valued
    return coarse, blocks, even


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
