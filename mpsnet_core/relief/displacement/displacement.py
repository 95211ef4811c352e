"""Displacement: heights on a mesh's UVs, integrated from the normals that were baked onto them.

The normals determine the change of height between neighbouring texels, independently of the UVs' stretch
(:mod:`mpsnet_core.relief.displacement.height_constraints`). On the two sides of a seam the heights are equal. One
system of equations covers it all (:mod:`mpsnet_core.arrays.graph_poisson`): islands have no offsets of their own, and
no seam opens. Contradicting normals, as at folds of the mesh and at the borders of what a photo shows, have less
weight, which flattens the heights there.
"""

from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.graph_poisson import Graph, Solver, graph_of
from mpsnet_core.arrays.mask_regions import connected
from mpsnet_core.arrays.rasterize import extend_to_nearest, texel_areas
from mpsnet_core.arrays.resampling import push_pull
from mpsnet_core.arrays.types import F32, F64, I32, Bools, Floats
from mpsnet_core.arrays.unit_vectors import dot
from mpsnet_core.defaults import MAX_BUMPS
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.relief.displacement.height_constraints import HeightDifferences, seen_share, slope_constraints
from mpsnet_core.relief.displacement.uv_layout import Layout, Seams, layout_of
from mpsnet_core.relief.height_map import MAX_SIZE, HeightMap, check_square
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.texture import Space, check_texture

# Number of solves. Changes of height along a curved surface, and the trust in gradients, depend on the heights, which
# are known from the second solve on. After the third, little changes.
PASSES = 3
# A gradient that deviates this much from the solved heights has half its weight.
STRAY = 0.2
# Texels beyond an island over which heights continue with their gradient; constant beyond.
CARRIED = 1.5
# Length over which relief decays to a third where no view saw it: this many mean edges of the mesh or this many texels,
# whichever is longer.
FADE, TEXELS = 1.0, 3.0
# Errors of interpolated heights at seams below this fraction of the relief are tolerated; after this many steps, little
# changes.
SPIKE, SEAM_STEPS = 0.02, 60
# Least fraction of texels that a base and its mesh have in common.
COMMON = 0.5


@dataclass(frozen=True, eq=False)
class Displacement:
    """Heights of a surface over a mesh, along the mesh's smooth normals, on its UVs."""

    values: F32
    """(S, S) float32. Heights in world units, row 0 at v = 1, extrapolated smoothly beyond the islands."""
    covered: Bools
    """(S, S) bool. Texels with surface under them."""
    texel: float
    """Mean length of a texel in world units."""
    seam_step: float
    """Root mean square difference of the heights on the two sides of the seams, in world units."""
    contradicted: float
    """Fraction of the surface, from 0 to 1, where the normals contradict one another."""

    def as_height_map(self) -> HeightMap:
        """The texture as a height map, for :func:`mpsnet_core.relief.height_files.write_height`."""
        size = len(self.values)
        camera = Camera("orthographic", size, size, np.full(2, 1 / self.texel))
        return HeightMap(self.values, np.ones(self.values.shape, bool), camera)


@takes_files
def displacement(
    vectors: F32,
    mesh: Mesh,
    *,
    space: Space = "tangent",
    base: Mesh | None = None,
    scale: float = 0.0,
    mean: float | None = None,
    margin: int = 16,
    progress: Progress = silent,
) -> Displacement:
    """The heights h for which the surface p + h n has the normals of a texture, where n are the mesh's smooth normals.

    Parameters
    ----------
    vectors : (S, S, 3) float32 array
        Unit normals in `space`, as :func:`mpsnet_core.bake.bake.bake_normals` bakes them onto `mesh`.
    mesh : Mesh
        The mesh that the texture was baked onto.
    space : {"tangent", "object"}
        Space of the texture's normals.
    base : Mesh, optional
        The mesh to be displaced, if that is `mesh` subdivided, with the same UVs.
    scale : float
        Fraction of the diagonal of the mesh's bounding box. Bumps wider than about this come from the mesh, because
        the errors of estimated normals are smooth: one degree over the whole object is a height of 2 % of its size.
        Without a base, facets with smooth shading stay flat, too. 0 keeps all bumps, and rounds facets.
    mean : float, optional
        Mean height by area of each connected part, in world units. By default the surface stays where `mesh` is.
    margin : int
        Texels by which the UV islands are dilated.
    progress : Progress

    Returns
    -------
    Displacement
        Heights that are equal on both sides of each seam, and flatter where normals contradict one another.

    Raises
    ------
    SettingsError
        If a value is out of range.
    GeometryError
        If the texture does not fit the mesh, or the base is another mesh.
    """
    progress(0.0, "laying out the UVs")
    vectors = np.asarray(vectors, np.float32)
    own, laid = _layouts(mesh, base, _checked_size(vectors, space, margin, scale, mean))
    areas, seams = laid.areas()[laid.triangle[covered := laid.triangle >= 0]], laid.seams()
    seen = seen_share(vectors, space, own, _fade(own, areas)) if scale else np.ones(vectors.shape[:2], np.float32)
    wanted = slope_constraints(vectors, seen, space, own, laid, bool(scale) and base is None, part(progress, 0.02, 0.2))
    graph = graph_of(laid.island, seams.texels[seams.met], _hold(own, areas, seen[covered], scale))
    del own, laid
    heights, trust, apart = _solved(graph, seams, wanted, areas, part(progress, 0.25, 0.85, "integrating"))
    if mean is not None or not scale:
        heights -= _means(graph, areas, heights - (wanted.outwards if mean is None else np.float32(mean)))
    progress(0.9, "growing the margin")
    values = _meeting(_with_margin(graph, heights, covered, margin), graph, heights, covered, seams)
    progress(1.0, "displaced")
    return _measured(values, covered, areas, trust, apart)


def _measured(values: F32, covered: Bools, areas: Floats, trust: Floats, apart: Floats) -> Displacement:
    """The heights with their statistics. areas, trust: of the covered texels. apart: differences of height at seams."""
    seam_step = float(np.sqrt(np.mean(apart**2))) if len(apart) else 0.0
    contradicted = float(areas[trust < 0.5].sum() / areas.sum())
    return Displacement(values, covered, float(np.sqrt(areas.mean())), seam_step, contradicted)


def _layouts(mesh: Mesh, base: Mesh | None, size: int) -> tuple[Layout, Layout]:
    """The layouts of the mesh and of the displaced mesh, which are the same without a base."""
    own = layout_of(mesh, size)
    laid = own if base is None else layout_of(base, size)
    if not (laid.triangle >= 0).any():
        raise GeometryError(f"no texel of a {size} x {size} texture lies on the mesh's UVs; choose a larger texture")
    if own is not laid:
        _check_base(own, laid)
    return own, laid


def _fade(own: Layout, areas: F64) -> float:
    """Length, in world units, over which relief decays where no view saw it. areas: (N,) of the texels."""
    edge = np.sqrt(2 * (own.areas() * texel_areas(own.corners)).mean())
    return float(max(FADE * edge, TEXELS * np.sqrt(areas.mean())))


def _hold(own: Layout, areas: F64, seen: F32, scale: float) -> F32:
    """(N,) weights that pull the heights to the mesh: 0 for a scale of 0, largest where no view saw the surface.

    areas: (N,) of the texels, in world units. seen: (N,) from 0 to 1. scale: see :func:`displacement`.
    """
    if not scale:
        return np.zeros(len(areas), np.float32)
    broadest = float(scale * np.linalg.norm(np.ptp(own.mesh.world_vertices, axis=0)) / (2 * np.pi))
    width = np.where(seen > 0, broadest, min(_fade(own, areas), broadest))
    return (areas / width**2).astype(np.float32)


def _solved(
    graph: Graph, seams: Seams, wanted: HeightDifferences, areas: F64, progress: Progress
) -> tuple[F32, F32, F32]:
    """(N,) heights, (N,) trust in the normals there, and (M,) the steps of height at the ties across seams."""
    solver = Solver(graph)
    heights = np.zeros(len(areas), np.float32)
    steps, trust = np.sqrt(areas).astype(np.float32), np.ones_like(heights)
    for done in range(PASSES):
        right, below = wanted.changes(graph, heights)
        if done:
            trust = _trust(graph, right, below, heights, steps)
        right, below = right * trust, below * trust
        across = _gradient(graph, right, below, graph.ties, seams.offsets[seams.met])
        known = across[:, 0] - across[:, 1]
        step = part(progress, done / PASSES, (done + 1) / PASSES)
        wanted_side = graph.right_side(right, below, known) + graph.hold * wanted.outwards
        heights = solver.solve(wanted_side, heights, step)
    return heights, trust, heights[graph.ties[:, 1]] - heights[graph.ties[:, 0]] - known


def _checked_size(vectors: F32, space: str, margin: int, scale: float, mean: float | None) -> int:
    size = len(vectors)
    check_square(*vectors.shape[:2])
    check_texture(size, space, margin)
    if size > MAX_SIZE:
        raise SettingsError(f"heights on UVs have {MAX_SIZE} texels a side at most, not {size}; bake a smaller texture")
    if not np.isfinite(vectors).all():
        raise GeometryError("the texture holds values that are not finite; bake it again")
    if not 0 <= scale <= MAX_BUMPS:
        raise SettingsError(f"a scale of {scale:g} times the mesh's size: choose 0 (keep all) to {MAX_BUMPS:g}")
    if mean is not None and not np.isfinite(mean):
        raise SettingsError(f"the mean height must be a number, not {mean}")
    return size


def _check_base(own: Layout, base: Layout) -> None:
    """Raise GeometryError if the base is not the subdivided mesh: its UVs differ, or it is far away."""
    on_own, on_base = own.triangle >= 0, base.triangle >= 0
    common = np.count_nonzero(on_own & on_base)
    least, most = ([end(mesh.world_vertices, axis=0) for mesh in (own.mesh, base.mesh)] for end in (np.min, np.max))
    apart = np.linalg.norm(np.subtract(*least) + np.subtract(*most)) / 2
    if common < COMMON * max(on_own.sum(), on_base.sum()) or apart > np.linalg.norm(most[0] - least[0]):
        raise GeometryError(
            "the base is another mesh, not the same one subdivided: its UVs or its place differ; give the mesh that is "
            "to be displaced, or leave the base out"
        )


def _trust(graph: Graph, right: F32, below: F32, heights: F32, steps: F32) -> F32:
    """(N,) trust from 0 to 1: how well the changes (N,) to the neighbours on the right and below fit the heights.

    At folds of the mesh, where the photo shows another surface, and at a view's border, the normals belong to no height
    field over the mesh: heights that follow them tear, and the cliffs distort their surroundings. Consistent gradients
    are trusted, however steep they are. steps: (N,) distance between texels in world units.
    """
    apart = (heights[graph.neighbours[:2]] - heights - np.stack([right, below])) * (graph.weights[:2] > 0) / steps
    return np.reciprocal(1 + np.sum(np.square(apart), axis=0) / np.float32(STRAY**2))


def _gradient(graph: Graph, right: F32, below: F32, texels: I32, offsets: Floats) -> F32:
    """(...,) change of height from texels (...,) over `offsets` (..., 2), right and down, from the changes (N,) to the
    neighbours around them."""
    total = np.zeros(texels.shape, np.float32)
    for axis, known in enumerate((right, below)):
        ahead, behind = graph.weights[axis, texels], graph.weights[axis + 2, texels]
        steps = ahead * known[texels] + behind * known[graph.neighbours[axis + 2, texels]]
        total += steps / np.maximum(ahead + behind, 1) * offsets[..., axis]
    return total


def _means(graph: Graph, areas: F64, values: F32) -> F32:
    """(N,) the area-weighted mean over the connected part of the surface that each texel belongs to."""
    count = int(graph.islands.max()) + 1
    of_island = connected(count, *graph.islands[graph.ties].T.astype(np.int64))
    surface = of_island[graph.islands]
    sums = np.bincount(surface, values * areas, count) / np.maximum(np.bincount(surface, areas, count), 1e-300)
    return sums[surface].astype(np.float32)


def _with_margin(graph: Graph, heights: F32, covered: Bools, margin: int) -> F32:
    """(S, S) the heights, extrapolated beyond the islands.

    The first texels continue with the gradient of the nearest one inside. So the interpolated height along a seam, half
    of which comes from the margin, is the same on both sides.
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
    values: F32 = layers[..., 0] + dot(layers[..., 1:3], offset)
    del layers, offset, distance
    return push_pull(values, reached)


def _meeting(values: F32, graph: Graph, heights: F32, covered: Bools, seams: Seams) -> F32:
    """(S, S) the heights with the margin adjusted so that both sides of a seam interpolate to nearly equal heights.

    If islands are less than two texels apart, or too small to cover one, interpolation mixes in another island's
    heights: a spike on the surface. The simultaneous iterative reconstruction technique (SIRT) adjusts the texels
    between the islands until interpolation gives the islands' own height.
    """
    right, below = (heights[graph.neighbours[axis]] - heights for axis in (0, 1))
    near = np.maximum(seams.texels, 0)
    sides = heights[near] + _gradient(graph, right, below, near, seams.offsets)
    known = seams.texels >= 0
    any_known = known.any(axis=1)
    wanted = ((sides * known).sum(axis=1) / np.maximum(known.sum(axis=1), 1))[any_known, None]
    size = len(values)
    place = np.clip(seams.places[any_known], 0, size - 1)
    first = np.minimum(place.astype(np.int64), size - 2)
    x, y = np.moveaxis(place - first, -1, 0)
    share = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=-1)
    texel = (first[..., 1] * size + first[..., 0])[..., None] + np.array([0, 1, size, size + 1])
    gives = share * ~covered.ravel()[texel]
    found = values.ravel().astype(np.float64)
    apart = np.abs(wanted - (found[texel] * share).sum(axis=-1))
    if not apart.size or apart.max() < SPIKE * np.ptp(heights):
        return values
    reads = np.maximum(np.bincount(texel.ravel(), share.ravel(), size * size), 1e-9)
    for _ in range(SEAM_STEPS):
        missing = wanted - (found[texel] * share).sum(axis=-1)
        found += np.bincount(texel.ravel(), (gives * missing[..., None]).ravel(), size * size) / reads
    return found.reshape(size, size).astype(np.float32)
