"""Displacement: heights on an object's own UVs, from the normals that were baked onto them.

Between neighbouring texels the normals determine how the heights change, whatever the UVs' stretch
(:mod:`mpsnet_core.relief.displacement.height_constraints`), and on the two sides of a seam the heights are the same.
All of that is solved at once (:mod:`mpsnet_core.arrays.graph_poisson`), so that no island has a height of
its own and no seam opens. Normals that no surface can have together, as at folds of the mesh and at the borders of what
a photo shows, count less, and the heights lie flatter there.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.connected_components import connected
from mpsnet_core.arrays.graph_poisson import Graph, Solver, graph_of
from mpsnet_core.arrays.push_pull import push_pull
from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.bake.settings import check_texture
from mpsnet_core.bake.texture import Space
from mpsnet_core.defaults import MAX_BUMPS
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.relief.displacement.height_constraints import Chords, chords
from mpsnet_core.relief.displacement.uv_layout import Layout, layout_of
from mpsnet_core.relief.height_map import HeightMap
from mpsnet_core.relief.sizes import MAX_SIZE, check_square
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh

# How heights change along a curved surface depends on the heights themselves, and so does which gradients can be
# trusted: the second time they are known. After the third little changes.
PASSES = 3
# A gradient that is so far from what the gradients around it come to is half trusted.
STRAY = 0.2
# Texels that heights are carried on beyond an island with their gradient; from there on as they are.
CARRIED = 1.5
# The share of its texels that a base has in common with its mesh, at least.
COMMON = 0.5


@dataclass(frozen=True)
class Displacement:
    """How far the surface stands out from a mesh, along the mesh's smooth normals, on its UVs.

    Attributes
    ----------
    values : (S, S) float32 array
        Heights in world units, row 0 at v = 1; they continue smoothly beyond the islands.
    covered : (S, S) bool array
        Texels on the surface.
    texel : float
        Mean length of a texel in world units.
    seam_step : float
        Root mean square difference of the heights on the two sides of the seams, in world units.
    contradicted : float
        Share of the surface, from 0 to 1, where no surface has these normals.
    """

    values: NDArray[np.float32]
    covered: NDArray[np.bool_]
    texel: float
    seam_step: float
    contradicted: float

    def as_height_map(self) -> HeightMap:
        """The whole texture as a height map, for :func:`mpsnet_core.relief.height_files.write_height`."""
        size = len(self.values)
        camera = Camera("orthographic", size, size, np.full(2, 1 / self.texel))
        return HeightMap(self.values, np.ones(self.values.shape, bool), camera)


def displacement(
    vectors: NDArray[np.float32],
    mesh: Mesh,
    *,
    space: Space = "tangent",
    base: Mesh | None = None,
    scale: float = 0.0,
    mean: float | None = None,
    margin: int = 16,
    progress: Progress = silent,
) -> Displacement:
    """The heights h for which the surface p + h n, n the mesh's smooth normals, has the normals of a texture.

    Parameters
    ----------
    vectors : (S, S, 3) float32 array
        Unit normals in `space`, as :func:`mpsnet_core.bake.bake.bake_normals` bakes them onto `mesh`.
    mesh : Mesh
        The mesh that the texture was baked onto.
    space : {"tangent", "object"}
        Of the texture.
    base : Mesh, optional
        The mesh to be displaced, where that is `mesh` subdivided; with the same UVs.
    scale : float
        Share of the diagonal of the mesh's bounding box. Bumps wider than about this are left to the mesh, because
        estimated normals err smoothly: one degree all over is a height of 2 % of the size. 0 keeps all.
    mean : float, optional
        Mean height by area of each connected part, in world units. By default the surface stays where `mesh` is.
    margin : int
        Texels that the islands' borders are grown by.
    progress : Progress

    Returns
    -------
    Displacement
        Heights that are equal on the two sides of each seam, flatter where normals contradict one another.

    Raises
    ------
    SettingsError
        Where a number is out of range.
    GeometryError
        Where the texture does not fit the mesh, or the base is another mesh.
    """
    size = _checked_size(vectors, space, margin, scale, mean)
    progress(0.0, "laying out the UVs")
    own, laid = _layouts(mesh, base, size)
    covered = laid.triangle >= 0
    wanted = chords(vectors, space, own, laid, part(progress, 0.02, 0.2))
    areas = laid.areas()[laid.triangle[covered]]
    graph, offsets = _graph(laid, areas, scale)
    del own, laid
    heights, trust, apart = _solved(graph, offsets, wanted, areas, part(progress, 0.25, 0.85, "integrating"))
    heights -= _means(graph, areas, heights - (wanted.outwards if mean is None else np.float32(mean)))
    progress(0.9, "growing the margin")
    values = _with_margin(graph, heights, covered, margin)
    progress(1.0, "displaced")
    contradicted = float(areas[trust < 0.5].sum() / areas.sum())
    seam_step = float(np.sqrt(np.mean(apart**2))) if len(apart) else 0.0
    return Displacement(values, covered, float(np.sqrt(areas.mean())), seam_step, contradicted)


def _layouts(mesh: Mesh, base: Mesh | None, size: int) -> tuple[Layout, Layout]:
    """Of the mesh, and of what is displaced, which is the same unless there is a base."""
    own = layout_of(mesh, size)
    laid = own if base is None else layout_of(base, size)
    if not (laid.triangle >= 0).any():
        raise GeometryError(f"no texel of a {size} x {size} texture lies on the mesh's UVs; choose a larger texture")
    if own is not laid:
        _check_base(own, laid)
    return own, laid


def _graph(laid: Layout, areas: NDArray[np.float64], scale: float) -> tuple[Graph, NDArray[np.float64]]:
    """The graph of the N covered texels, and (M, 2, 2) how far right and down of its ties' texels the seams are.

    areas: (N,) of the texels in the world. scale: as :func:`displacement` takes it.
    """
    hold = np.zeros(len(areas), np.float32)
    if scale:
        hold += areas / (scale * np.linalg.norm(np.ptp(laid.mesh.world_vertices, axis=0)) / (2 * np.pi)) ** 2
    texels, offsets = laid.meeting()
    number = np.cumsum(laid.triangle >= 0) - 1
    return graph_of(laid.island, number[texels].astype(np.int32), hold), offsets


def _solved(
    graph: Graph, offsets: NDArray[np.float64], wanted: Chords, areas: NDArray[np.float64], progress: Progress
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """(N,) heights, (N,) how far the normals there are trusted, and (M,) the heights' steps at the ties."""
    solver = Solver(graph)
    heights = np.zeros(len(areas), np.float32)
    steps, trust = np.sqrt(areas).astype(np.float32), np.ones_like(heights)
    for done in range(PASSES):
        right, below = wanted.changes(graph, heights)
        if done:
            trust = _trust(graph, right, below, heights, steps)
        right, below = right * trust, below * trust
        across = _gradient(graph, right, below, graph.ties, offsets)
        known = across[:, 0] - across[:, 1]
        step = part(progress, done / PASSES, (done + 1) / PASSES)
        heights = solver.solve(graph.right_side(right, below, known), heights, step)
    return heights, trust, heights[graph.ties[:, 1]] - heights[graph.ties[:, 0]] - known


def _checked_size(vectors: NDArray[np.float32], space: str, margin: int, scale: float, mean: float | None) -> int:
    size = len(vectors)
    check_square(*vectors.shape[:2])
    check_texture(size, space, margin)
    if size > MAX_SIZE:
        raise SettingsError(f"heights on UVs have {MAX_SIZE} texels a side at most, not {size}; bake a smaller texture")
    if not np.isfinite(vectors).all():
        raise GeometryError("the texture holds values that are not finite; bake it again")
    if not 0 <= scale <= MAX_BUMPS:
        raise SettingsError(
            f"a scale of {scale:g} times the mesh's size cannot be used; choose 0 (keep all) to {MAX_BUMPS:g}"
        )
    if mean is not None and not np.isfinite(mean):
        raise SettingsError(f"the mean height must be a number, not {mean}")
    return size


def _check_base(own: Layout, base: Layout) -> None:
    """Raises GeometryError where the base is not the mesh subdivided: not on the same UVs, or far away."""
    on_own, on_base = own.triangle >= 0, base.triangle >= 0
    common = np.count_nonzero(on_own & on_base)
    least, most = ([end(mesh.world_vertices, axis=0) for mesh in (own.mesh, base.mesh)] for end in (np.min, np.max))
    apart = np.linalg.norm(np.subtract(*least) + np.subtract(*most)) / 2
    if common < COMMON * max(on_own.sum(), on_base.sum()) or apart > np.linalg.norm(most[0] - least[0]):
        raise GeometryError(
            "the base is another mesh, not the same one subdivided: its UVs or its place differ; give the mesh that is "
            "to be displaced, or leave the base out"
        )


def _trust(
    graph: Graph,
    right: NDArray[np.float32],
    below: NDArray[np.float32],
    heights: NDArray[np.float32],
    steps: NDArray[np.float32],
) -> NDArray[np.float32]:
    """(N,) from 0 to 1, how far the changes (N,) to the neighbours on the right and below agree with the heights.

    Where the mesh is folded, where the photo shows something else than lies there, and where its view ends, the normals
    are of no surface that stands out from the mesh: heights that follow them are torn, and their cliffs pull at all
    around. Gradients that do agree are trusted however steep they are. steps: (N,) from texel to texel in the world.
    """
    apart = (heights[graph.neighbours[:2]] - heights - np.stack([right, below])) * (graph.weights[:2] > 0) / steps
    trust: NDArray[np.float32] = np.reciprocal(1 + np.sum(np.square(apart), axis=0) / np.float32(STRAY**2))
    return trust


def _gradient(
    graph: Graph,
    right: NDArray[np.float32],
    below: NDArray[np.float32],
    texels: NDArray[np.int32],
    offsets: NDArray[np.floating[Any]],
) -> NDArray[np.float32]:
    """(...,) how much the heights change from texels (...,) over `offsets` (..., 2) right and down, by what is known of
    the changes (N,) to the neighbours around them."""
    total = np.zeros(texels.shape, np.float32)
    for axis, known in enumerate((right, below)):
        ahead, behind = graph.weights[axis, texels], graph.weights[axis + 2, texels]
        steps = ahead * known[texels] + behind * known[graph.neighbours[axis + 2, texels]]
        total += steps / np.maximum(ahead + behind, 1) * offsets[..., axis]
    return total


def _means(graph: Graph, areas: NDArray[np.float64], values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(N,) the mean by area over the connected part of the surface that each texel is on."""
    count = int(graph.islands.max()) + 1
    of_island = connected(count, *graph.islands[graph.ties].T.astype(np.int64))
    surface = of_island[graph.islands]
    sums = np.bincount(surface, values * areas, count) / np.maximum(np.bincount(surface, areas, count), 1e-300)
    means: NDArray[np.float32] = sums[surface].astype(np.float32)
    return means


def _with_margin(
    graph: Graph, heights: NDArray[np.float32], covered: NDArray[np.bool_], margin: int
) -> NDArray[np.float32]:
    """(S, S) the heights, grown beyond the islands.

    The first texels go on with the gradient of the nearest one inside, so that what is read between texels along a
    seam, half of it from the margin, is the same on both sides.
    """
    number = np.arange(len(heights), dtype=np.int32)
    right, below = (heights[graph.neighbours[axis]] - heights for axis in (0, 1))
    layers = np.zeros((*covered.shape, 5), np.float32)
    layers[covered, 0] = heights
    for axis in (0, 1):
        along = np.zeros((len(heights), 2))
        along[:, axis] = 1
        layers[covered, 1 + axis] = _gradient(graph, right, below, number, along)
    layers[..., 3] = -1
    layers[covered, 3:] = graph.cells[:, ::-1]
    layers = extend_to_nearest(layers, covered, margin)
    reached = layers[..., 3] >= 0
    offset = np.stack(np.meshgrid(*[np.arange(len(covered), dtype=np.float32)] * 2), axis=-1) - layers[..., 3:]
    distance = np.linalg.norm(offset, axis=-1, keepdims=True)
    offset *= np.minimum(1, CARRIED / np.maximum(distance, CARRIED))
    values: NDArray[np.float32] = layers[..., 0] + np.einsum("...i,...i->...", layers[..., 1:3], offset)
    del layers, offset, distance
    return push_pull(values, reached)
