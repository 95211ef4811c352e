"""Baking: camera-space normals of one or more views onto the UVs of one or more meshes."""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.rasterize import Raster, TextureSize, put_rows, texel_areas, width_and_height
from mpsnet_core.arrays.resampling import push_pull
from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.types import F32, F64, I32, I64, Bools
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.bake.fill import SeamEdges, fill_colours, fill_unseen
from mpsnet_core.bake.projection import Projector, Projectors, View, ViewAccumulator, masks_hide_all, seen_triangles
from mpsnet_core.bake.settings import BakeSettings, Padding, padded
from mpsnet_core.bake.texel_surface import Barycentric, TexelSampler
from mpsnet_core.defaults import MARGIN, TEXTURE_SIZE
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.mesh import Mesh, join_meshes
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.scene.texture import Space, Texture
from mpsnet_core.scene.texture_sets import Islands, TextureSet, islands_of, texture_sets

log = logging.getLogger(__name__)

T = TypeVar("T", bound=np.generic)

# Sample points that a CPU core processes at once: few enough for its cache, enough to make NumPy efficient.
POINTS_AT_ONCE = 1 << 17
# With supersampling, sample points that are held in memory at once; about 20 bytes each.
POINTS_HELD = 1 << 22
# The weight of the mesh's own normal where views fade out: that of a view at 80 degrees to the surface normal.
FADE = 1e-3
# Expected error of a view in degrees from which the mesh has this weight everywhere: at such a slant few pixels show
# the surface, those of the photo and of the mesh are not the same points, and estimates err most. Exact views stay so.
DOUBT = 5.0


@takes_files
def bake_normals(
    mesh: Mesh,
    views: Sequence[View],
    *,
    size: TextureSize = TEXTURE_SIZE,
    space: Space = "tangent",
    margin: int = MARGIN,
    padding: Padding = "nearest",
    samples: int = 1,
    feather: float = 0.0,
    strength: float = 1.0,
    fill: bool = False,
    progress: Progress = silent,
) -> Texture:
    """Bake the views' normals onto the mesh's UVs in the unit square.

    Parameters
    ----------
    mesh : Mesh
        A mesh with UVs.
    views : sequence of View
        Read one after the other, and more than once if they do not all fit into memory.
    size, space, margin, padding, samples, feather, strength, fill
        See :class:`mpsnet_core.bake.settings.BakeSettings`.
    progress : Progress
        Receives the fraction done and a message.

    Returns
    -------
    Texture
        Each texel is the mean over the views that see it, weighted by confidence and by the fourth power of the cosine
        between surface and camera. Where views expect an error, the mesh has a little weight, too: it shows at grazing
        angles. Texels that no view sees keep the mesh's shading normal unless they are filled.
        Colours have the same weights. Where no view has one, they go on along the surface, and beyond the islands.

    Raises
    ------
    SettingsError
        If a number is out of range.
    GeometryError
        If there is no view, or no texel is seen.
    Cancelled
        If `progress` raises it.
    """
    baking = BakeSettings(size, space, margin, padding, samples, feather, strength, fill)
    ((_, texture),) = bake_texture_sets([mesh], views, texture_sets([mesh]), baking, progress=progress)
    return texture


@takes_files
def bake_texture_sets(
    meshes: Sequence[Mesh],
    views: Sequence[View],
    chosen: Sequence[TextureSet],
    baking: BakeSettings,
    *,
    progress: Progress = silent,
) -> Iterator[tuple[TextureSet, Texture]]:
    """Bake the views' normals onto the UVs of several meshes, which occlude one another: one texture for each set.

    Parameters
    ----------
    meshes : sequence of Mesh
        Meshes in one world space.
    views : sequence of View
        See :func:`bake_normals`.
    chosen : sequence of TextureSet
        Texture sets of these meshes, from :func:`mpsnet_core.scene.texture_sets.texture_sets`.
    baking : BakeSettings
        How the textures are baked.
    progress : Progress
        Receives the fraction done and a message.

    Yields
    ------
    (TextureSet, Texture)
        One texture at a time, computed when requested. Sets without texels are skipped.

    Raises
    ------
    GeometryError
        If there is no view, no texel lies on the UVs, or no view sees any of the meshes.
    """
    bake = _prepared(meshes, views, baking, part(progress, 0.0, 0.1))
    # Unseen textures are held back until some texel is known to be seen: if none is, that is an error.
    any_face_seen = any(triangles.any() for triangles in bake.seen)
    any_seen, any_covered, waiting = False, False, list[TextureSet]()
    for number, texture_set in enumerate(chosen):
        step = part(progress, 0.1 + 0.9 * number / len(chosen), 0.1 + 0.9 * (number + 1) / len(chosen))
        texture = bake.texture(texture_set, step)
        if texture is None:
            if texture_set.named:
                log.info("%s: no texel lies on its UVs, so it gets no texture", texture_set.named)
            continue
        any_covered, any_seen = True, any_seen or bool(texture.seen.any())
        if not (any_seen or any_face_seen):
            waiting.append(texture_set)
            continue
        step(0.9, "growing the margin")
        yield texture_set, _finished(texture, baking)
        step(1.0, "baked")
    if not any_covered:
        width, height = width_and_height(baking.size)
        raise GeometryError(f"no texel of a {width} x {height} texture lies on the mesh's UVs; choose a larger size")
    if not any_seen:
        raise GeometryError(_why_unseen(meshes, bake, any_face_seen))
    for texture_set in waiting:
        texture = bake.texture(texture_set, part(progress, 1.0, 1.0))
        if texture is not None:
            yield texture_set, _finished(texture, baking)


def _why_unseen(meshes: Sequence[Mesh], bake: "_Bake", any_face_seen: bool) -> str:
    """Why no view sees a texel. any_face_seen: whether some view sees some triangle."""
    if any_face_seen:
        return (
            "nothing that the views see lands in the texture: in tangent space, normals must not point away from the "
            "mesh's own. Was the object or the camera moved since the photo? If not, check the normals, or bake in "
            "object space"
        )
    if masks_hide_all(meshes, bake.projectors):
        return (
            "no view sees any of the mesh within its mask, although the cameras see it; check that the masks (the "
            "normal maps' alpha) show the object, and that each camera is that of its photo"
        )
    return (
        "no view sees any of the mesh; check that the cameras and the mesh share one world, its axes and unit "
        "(--up, --unit), and that its normals point outwards"
    )


def _prepared(meshes: Sequence[Mesh], views: Sequence[View], baking: BakeSettings, progress: Progress) -> "_Bake":
    if not len(views):
        raise GeometryError("there is no view to bake; give at least one camera with its normal map")
    progress(0.0, "laying out the UVs")
    whole = join_meshes(meshes)
    scene = RayScene.of(whole)
    del whole
    projectors = Projectors(views, scene, baking.feather)
    seen = seen_triangles(meshes, projectors, scene, progress)
    # The views were read: they have colours if their samples have more than four values.
    islands = [islands_of(mesh) for mesh in meshes] if baking.fill or projectors.values > 4 else None
    return _Bake(meshes, projectors, seen, scene.middle, baking, islands)


def _finished(texture: Texture, baking: BakeSettings) -> Texture:
    colours = texture.colours
    if colours is not None:
        # Extrapolate colours smoothly beyond the islands.
        whole = push_pull(colours[..., :3], texture.covered)
        colours = np.concatenate([whole, colours[..., 3:] > 0], axis=-1, dtype=np.float32)
        if baking.padding == "none":
            colours[~texture.covered] = 0
    vectors = padded(texture.vectors, texture.covered, baking.padding, baking.margin)
    return replace(texture, vectors=vectors, colours=colours)


@dataclass(frozen=True)
class _Bake:
    """What all textures of a bake share."""

    meshes: Sequence[Mesh]
    """The meshes."""
    projectors: Projectors
    """The views' projectors."""
    seen: Sequence[Bools]
    """For each mesh, (T,) whether a view sees the centres of its triangles."""
    middle: F64
    """(3,). The scene's centre in world space."""
    baking: BakeSettings
    """How the textures are baked."""
    islands: Sequence[Islands] | None
    """The UV islands of each mesh; None if nothing is filled."""

    def texture(self, texture_set: TextureSet, progress: Progress) -> Texture | None:
        """The texture set's texture, without padding, or None if no texel lies on its UVs."""
        (width, height), samples = width_and_height(self.baking.size), self.baking.samples
        under = self._rasterised(texture_set, (width * samples, height * samples))
        coloured = self.projectors.values > 4
        texture = _blank((height, width), self.baking.space, colours=coloured)
        island_of = self._islands(texture_set)
        filled = (0, 0) if island_of is None else (height, width)
        islands, known = np.full(filled, -1, np.int32), np.zeros(filled, bool)
        # With supersampling, a few rows at once. Views that do not fit into memory are read again for each group of
        # rows; then a group has at least as many points as the texture has texels.
        points_in_memory = POINTS_HELD if self.projectors.all else max(POINTS_HELD, width * height)
        groups = [slice(0, height)] if samples == 1 else bands(height, max(1, points_in_memory // (width * samples**2)))
        sampled = 0.9 if island_of is None else 0.6  # fraction of the work
        for number, rows in enumerate(groups):
            step = part(progress, sampled * number / len(groups), sampled * (number + 1) / len(groups))
            fine = slice(rows.start * samples, rows.stop * samples)
            points = texture
            if samples > 1:
                points = _blank((fine.stop - fine.start, width * samples), self.baking.space, colours=coloured)
            self._sample(points, under, fine, step)
            if samples > 1:
                averaged = _averaged(points, samples)
                for name, values in vars(averaged).items():
                    if isinstance(values, np.ndarray):
                        getattr(texture, name)[rows] = values
            if island_of is not None:
                for band in bands(rows.stop - rows.start):
                    fine_band = slice(band.start * samples, band.stop * samples)
                    laid = under.raster.rows(slice(fine.start + fine_band.start, fine.start + fine_band.stop))
                    shape = band.stop - band.start, samples, width, samples
                    own = np.where(laid >= 0, island_of[under.order[laid]], np.int32(-1))
                    place = slice(rows.start + band.start, rows.start + band.stop)
                    islands[place] = own.reshape(shape).max(axis=(1, 3))
                    known[place] = (points.seen[fine_band] | (laid < 0)).reshape(shape).all(axis=(1, 3))
            del points
        if not texture.covered.any():
            return None
        if under.area > 1.05 * texture.covered.sum() * samples**2:
            _warn_of_overlapping_uvs(self.meshes, texture_set)
        if texture.colours is not None:
            fill_colours(texture.colours[..., :3], islands, texture.colours[..., 3] > 0, self._seams(texture_set))
        if not self.baking.fill:
            return texture
        return fill_unseen(
            texture,
            islands,
            known,
            self._seams(texture_set),
            lambda row, column: under.frames(row, column, samples),
            progress=part(progress, 0.6, 0.9),
        )

    def _rasterised(self, texture_set: TextureSet, size: tuple[int, int]) -> "_RasterisedSurfaces":
        """The texture set's triangles in a raster of this width and height."""
        surfaces, seen = [], []
        for mesh, triangles, seen_of in zip(self.meshes, texture_set.parts, self.seen, strict=True):
            if triangles is None or len(triangles):
                surfaces.append(TexelSampler(mesh, triangles, texture_set.corner, self.middle, size))
                seen.append(seen_of if triangles is None else seen_of[triangles])
        # Where UVs overlap (mirrored halves), a triangle that a view sees wins: it is rasterised last.
        order = np.argsort(np.concatenate(seen), kind="stable")
        corners = np.concatenate([surface.corners for surface in surfaces])
        inside = ((corners > -1) & (corners < size)).all(axis=(1, 2))
        area = float(texel_areas(corners[inside]).sum())
        may_show = np.append(self._facing_a_view(surfaces)[order], False)
        return _RasterisedSurfaces(surfaces, order, Raster(corners[order], size), area, may_show)

    def _facing_a_view(self, surfaces: Sequence[TexelSampler]) -> Bools:
        """(T,) whether some view may see the front of each triangle; all of them if each texel must be computed."""
        count = sum(len(surface.corners) for surface in surfaces)
        if self.baking.space == "object" or not self.projectors.all:
            return np.ones(count, bool)
        facing = [np.any([view.faces(surface) for view in self.projectors.all], axis=0) for surface in surfaces]
        return np.concatenate(facing)

    def _seams(self, texture_set: TextureSet) -> SeamEdges:
        """The seams of the texture set's meshes in its unit square, with the islands' numbers of :meth:`_islands`."""
        assert self.islands is not None
        first = np.cumsum([0, *(one.count for one in self.islands)])
        uvs: F64 = np.concatenate([one.seam_uvs for one in self.islands])
        numbered = [one.seam_islands + before for one, before in zip(self.islands, first, strict=False)]
        return SeamEdges(uvs - np.array(texture_set.corner, np.float64), np.concatenate(numbered).astype(np.int32))

    def _islands(self, texture_set: TextureSet) -> I32 | None:
        """The UV island of each of the texture set's triangles, in the order of :meth:`texture`'s corners."""
        if self.islands is None:
            return None
        numbers, first = [], 0
        for triangles, islands in zip(texture_set.parts, self.islands, strict=True):
            numbers.append(first + (islands.of_triangle if triangles is None else islands.of_triangle[triangles]))
            first += islands.count
        return np.concatenate(numbers)

    def _sample(self, points: Texture, under: "_RasterisedSurfaces", rows: slice, progress: Progress) -> None:
        """Write the views' samples at these rows of the texture into `points`, (R, C), which holds those rows alone."""
        width = points.covered.shape[1]
        jobs = bands(rows.stop - rows.start, max(1, POINTS_AT_ONCE // width))
        views, values, begun, done = len(self.projectors.views), self.projectors.values, 0, 0
        for batch in self.projectors.batches():
            first, last = begun == 0, begun + len(batch) == views
            begun += len(batch)

            def work(band: slice, batch: list[Projector] = batch, first: bool = first, last: bool = last) -> None:
                laid = under.raster.rows(slice(rows.start + band.start, rows.start + band.stop))
                here = points.rows(band)
                np.greater_equal(laid, 0, out=here.covered)
                for surface, triangle, texels in under.patches(laid, under.may_show):
                    row = texels.astype(np.int32) // np.int32(width)
                    column = texels - row * width
                    place = surface.place(triangle, column, row + (rows.start + band.start))
                    sums = ViewAccumulator.none(len(texels), values) if first else ViewAccumulator.kept(here, texels)
                    own = surface.at(place, surface.normal)
                    at = surface.points(place, own)
                    for projector in batch:
                        sums.add(*projector.sample_points(at))
                    if last:
                        self._finish(here, texels, surface, place, (own, at.normals), sums)
                    else:
                        sums.keep(here, texels)
                if last:
                    here.seen[...] = here.views != 0
                    # +z: the surface's own normal in tangent space, or no surface.
                    flat = ~here.covered if self.baking.space == "object" else ~here.seen
                    np.copyto(here.vectors[..., 2], 1, where=flat)

            def after(count: int = len(batch)) -> None:
                nonlocal done
                progress(done / (views * len(jobs)), "baking")
                done += count

            on_all_cores(work, jobs, after)

    def _finish(
        self,
        points: Texture,
        texels: I64,
        surface: TexelSampler,
        place: Barycentric,
        normals: tuple[F32, F32],
        sums: ViewAccumulator,
    ) -> None:
        """Write the accumulated means at the texels of these flat indices.

        normals: (3, N) the surface's own, interpolated in object space, and as unit vectors in world space.
        """
        assert points.spread is not None and points.views is not None
        points.views.ravel()[texels] = sums.views
        # In tangent space the surface's own normal is +z and need not be computed.
        some = np.flatnonzero(sums.views) if self.baking.space == "tangent" else np.arange(len(texels))
        doubt = 1.0 if self.projectors.feather > 0 else min(1.0, (self.projectors.expected_error / DOUBT) ** 2)
        own, mean = (one.take(some, axis=1) for one in normals)
        mean *= np.float32(FADE * doubt)
        mean += sums.sums.take(some, axis=0)[:, :3].T
        encoded = surface.encoded(place.some(some), own, mean, self.baking.space, self.baking.strength)
        if self.baking.space == "tangent":  # which cannot hold what points behind the shading normal's plane
            behind = np.flatnonzero(encoded[2] <= 0)
            encoded[:, behind] = np.array([[0], [0], [1]], np.float32)
            points.views.ravel()[texels.take(some.take(behind))] = 0
        put_rows(points.vectors.reshape(-1, 3), texels.take(some), encoded.T)
        if len(self.projectors.views) > 1:
            points.spread.ravel()[texels.take(some)] = sums.spread().take(some)
        if points.colours is not None:
            weight = sums.sums[:, 7:]
            points.colours.reshape(-1, 4)[texels] = sums.sums[:, 4:] / np.where(weight > 0, weight, 1)


@dataclass(frozen=True)
class _RasterisedSurfaces:
    """The surfaces under a texture's sample points."""

    surfaces: Sequence[TexelSampler]
    """The meshes' surfaces."""
    order: I64
    """For each triangle of `raster`, its index among the concatenated triangles of all surfaces."""
    raster: Raster
    """Rasterised triangles of all surfaces, concatenated and sorted by `order`."""
    area: float
    """The triangles' area in the raster, in pixels; more than are covered where UVs overlap."""
    may_show: Bools
    """(T + 1,). Whether some view may see each triangle of `raster`; at the end False, for points without one."""

    def patches(self, laid: I32, chosen: Bools | None = None) -> Iterator[tuple[TexelSampler, I64, I64]]:
        """Yield each surface with (N,) its triangles and (N,) the flat indices of the points above them.

        laid: (R, C) triangle numbers, rows of the raster. chosen: (T + 1,) which triangles, as `may_show`.
        """
        texels = np.flatnonzero(laid >= 0 if chosen is None else chosen.take(laid))
        triangle = self.order.take(laid.ravel().take(texels))
        if len(self.surfaces) == 1:
            yield self.surfaces[0], triangle, texels
            return
        ends = np.cumsum([len(surface.corners) for surface in self.surfaces])
        owner = np.searchsorted(ends, triangle, side="right")
        for number, surface in enumerate(self.surfaces):
            mine = np.flatnonzero(owner == number)
            yield surface, triangle.take(mine) - (ends[number] - len(surface.corners)), texels.take(mine)

    def frames(self, row: I64, column: I64, samples: int) -> tuple[F32, F32]:
        """(N, 3) unit tangents and bitangents in object space at the middles of texels, zero beside the surfaces.

        row, column: (N,) of the texture. samples: points of the raster across a texel.
        """
        width, middle = self.raster.width // samples, samples // 2
        tangents, bitangents = np.zeros((2, len(row), 3), np.float32)
        for band in bands(int(row.max(initial=-1)) + 1):
            inside = np.flatnonzero((row >= band.start) & (row < band.stop))
            if not len(inside):
                continue
            laid = self.raster.rows(slice(band.start * samples, band.stop * samples))
            laid = laid[middle::samples, middle::samples]
            texel = (row[inside] - band.start) * width + column[inside]
            wanted, number = np.full(laid.size, -1, np.int32), np.zeros(laid.size, np.int64)
            wanted[texel], number[texel] = laid.ravel()[texel], inside
            for surface, triangle, texels in self.patches(wanted.reshape(laid.shape)):
                down, right = np.divmod(texels, width)
                place = surface.place(triangle, right * samples + middle, (down + band.start) * samples + middle)
                for out, axis in zip((tangents, bitangents), surface.frames(place), strict=True):
                    out[number[texels]] = axis.T
        return tangents, bitangents


def _warn_of_overlapping_uvs(meshes: Sequence[Mesh], texture_set: TextureSet) -> None:
    level, remedy = logging.INFO, ""
    if texture_set.material is None and any(mesh.materials and len(mesh.materials.names) > 1 for mesh in meshes):
        # As of photogrammetry: each has a texture of its own.
        level = logging.WARNING
        remedy = "; if each material has its own texture, put <MATERIAL> into the output's name"
    elif len(meshes) > 1:
        remedy = "; pack the objects' UVs together, or give each object a texture of its own"
    shown = "there, the texture shows only one of the surfaces, if possible one that a view sees"
    log.log(level, f"UVs overlap: {shown}{remedy} [overlapping-uvs]")


def _averaged(points: Texture, samples: int) -> Texture:
    """Average samples x samples points to a texel.

    A texel's normal is the normalised mean of the points that a view sees or, if none is seen, of all points on the
    surface. Its colour is the mean of the known ones.
    """
    height, width = (length // samples for length in points.covered.shape)

    def blocks(values: NDArray[T]) -> NDArray[T]:
        return values.reshape(height, samples, width, samples, *values.shape[2:])

    seen = blocks(points.seen).any(axis=(1, 3), keepdims=True)
    # Points that no view sees hold the surface's own normal, which would flatten the detail of their neighbours.
    counts = (blocks(points.covered) & (blocks(points.seen) | ~seen)).reshape(points.covered.shape)
    weight = blocks(counts).sum(axis=(1, 3), dtype=np.float32)
    vectors = blocks(np.where(counts[..., None], points.vectors, 0)).sum(axis=(1, 3))
    colours = None
    if points.colours is not None:
        # Unknown colours are zero, and so is their weight.
        total = blocks(points.colours).sum(axis=(1, 3))
        colours = total / np.maximum(total[..., 3:], 1)
    assert points.views is not None and points.spread is not None
    views = blocks(points.views).max(axis=(1, 3))
    spread = blocks(np.where(counts, points.spread, 0)).sum(axis=(1, 3)) / np.maximum(weight, 1)
    spread = spread.astype(np.float32)
    return Texture(normalised(vectors), seen[:, 0, :, 0], weight > 0, points.space, views, spread, colours)


def _blank(shape: tuple[int, int], space: Space, colours: bool) -> Texture:
    """A texture of zeros."""
    vectors, seen, covered = np.zeros((*shape, 3), np.float32), np.zeros(shape, bool), np.zeros(shape, bool)
    views, spread = np.zeros(shape, np.uint16), np.zeros(shape, np.float32)
    return Texture(vectors, seen, covered, space, views, spread, np.zeros((*shape, 4), np.float32) if colours else None)
