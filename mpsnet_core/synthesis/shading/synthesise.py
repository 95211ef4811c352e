"""Render a sample from a recipe, without Blender."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.types import F32, I64
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.synthesis.random_sampling import generator
from mpsnet_core.synthesis.reflectance import Reflectance
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import SceneDescription
from mpsnet_core.synthesis.shading.indirect import STRIDE, Lobe, indirect, lobe, reflect_light
from mpsnet_core.synthesis.shading.lights import TURNS, Light, illumination
from mpsnet_core.synthesis.shading.pattern import dirt_weight, material_weights, paint_factors
from mpsnet_core.synthesis.shading.surface_points import Surface, SurfacePoints
from mpsnet_core.synthesis.shapes import Shape

RENDERER = "synthesis"


@dataclass(frozen=True)
class _Colouring:
    """The K materials of N points."""

    weights: F32
    """(N, K) float32. Weights of the materials."""
    paint: F32 | None
    """(N, 3) float32. Factors of the materials' colours, or None."""
    dirt: F32 | None
    """(N,) float32. Opacity of a matt layer over the materials, or None."""

    def albedo(self, recipe: SceneDescription, lobes: Sequence[Lobe]) -> F32:
        """(N, 3) diffuse albedo of the points, as if they were matt."""
        colour: F32 = self.weights @ np.array([lobe.albedo for lobe in lobes])
        if self.paint is not None:
            colour = colour * self.paint
        if self.dirt is not None:
            colour += self.dirt[:, None] * (np.array(recipe.dirt.color, np.float32) - colour)
        return colour


def synthesise(
    recipe: SceneDescription, shape: Shape, reflectances: Sequence[Reflectance], supersampling: int = 1
) -> Sample:
    """Render the shape with the recipe's camera, under each of its lights alone.

    reflectances: one for each of the recipe's materials. supersampling: rays along a pixel's side; radiance, coverage,
    depth and normals are their means (a box filter).

    Direct light is shadowed. Indirect light, up to the recipe's number of bounces, is diffuse only: surfaces send and
    receive it as matt ones with their albedo at normal incidence. The same recipe gives the same bytes.
    """
    camera = recipe.camera.resized(recipe.camera.width * supersampling, recipe.camera.height * supersampling)
    grid = (camera.height, camera.width)
    surface = Surface(recipe, shape)
    pixels, depth, points = surface.seen(camera)
    lights = [Light(way, float(size)) for way, size in zip(recipe.light_directions, recipe.light_sizes, strict=True)]
    lobes = [lobe(reflectance) for reflectance in reflectances]
    rng = generator(recipe.seed, recipe.number)
    turns = rng.integers(TURNS, size=camera.height * camera.width)[pixels]

    colouring = _colouring(recipe, points)
    arrivals = [illumination(light, points, surface.scene, pixels, grid, turns) for light in lights]
    direct = [
        _direct(recipe, reflectances, lobes, light, points, colouring, irradiance, turns)
        for light, (irradiance, _) in zip(lights, arrivals, strict=True)
    ]
    radiance = np.stack(direct, axis=1)
    if recipe.bounces and len(points):
        footprint = (1.0 if camera.projection == "orthographic" else float(depth.mean())) / camera.focal.min()

        def albedo(met: SurfacePoints) -> F32:
            return _colouring(recipe, met).albedo(recipe, lobes)

        step = STRIDE * supersampling, float(footprint)
        received = indirect(surface, lights, points, pixels, grid, *step, albedo, recipe.bounces)
        radiance += received * colouring.albedo(recipe, lobes)[:, None]

    image = _Image(grid, supersampling, pixels)
    alpha = image.share(np.ones(len(points), np.float32))
    covered = alpha > 0
    weights = image.share(colouring.weights)
    seen = image.share(radiance.reshape(-1, 9)).reshape(*alpha.shape, 3, 3).transpose(2, 0, 1, 3).copy()
    normals = np.where(covered[..., None], normalised(image.share(points.normal)), np.float32(0))
    material = np.where(covered, weights.argmax(axis=2), -1).astype(np.int32)
    lit = np.stack([image.mean(lit, alpha) for _, lit in arrivals])
    return Sample(seen, normals, image.mean(depth, alpha), alpha, material, lit, recipe, RENDERER)


def _colouring(recipe: SceneDescription, points: SurfacePoints) -> _Colouring:
    return _Colouring(
        material_weights(recipe.pattern, len(recipe.materials), points.place, points.part),
        paint_factors(recipe.paint, points.place),
        dirt_weight(recipe.dirt, points.place),
    )


def _direct(
    recipe: SceneDescription,
    reflectances: Sequence[Reflectance],
    lobes: Sequence[Lobe],
    light: Light,
    points: SurfacePoints,
    colouring: _Colouring,
    irradiance: F32,
    turns: I64,
) -> F32:
    """(N, 3) radiance of the points towards the viewer by direct light."""
    radiance = np.zeros((len(points), 3), np.float32)
    for number, (reflectance, one) in enumerate(zip(reflectances, lobes, strict=True)):
        weights = colouring.weights[:, number]
        used = np.flatnonzero((weights > 0) & (irradiance > 0))
        normals, views = points.normal.take(used, axis=0), points.view.take(used, axis=0)
        paint = None if colouring.paint is None else colouring.paint.take(used, axis=0)
        shade = reflect_light(reflectance, one.width, light, normals, views, paint, turns[used])
        shade *= (weights * irradiance).take(used)[:, None]
        radiance[used] = radiance.take(used, axis=0) + shade
    if colouring.dirt is not None:
        soiled = irradiance[:, None] * np.array(recipe.dirt.color, np.float32)
        radiance += colouring.dirt[:, None] * (soiled - radiance)
    return radiance


class _Image:
    """Averages values at points over pixels, each of which covers `times` x `times` cells of a finer grid.

    pixels: (N,) indices of the points in that grid, in row-major order.
    """

    def __init__(self, grid: tuple[int, int], times: int, pixels: I64) -> None:
        self.grid, self.times, self.pixels = grid, times, pixels

    def share(self, values: F32) -> F32:
        """(H, W, ...) mean over the whole pixel, counting zero where there is no point."""
        fine = np.zeros((self.grid[0] * self.grid[1], *values.shape[1:]), np.float32)
        fine[self.pixels] = values
        times, (height, width) = self.times, self.grid
        fine = fine.reshape(height // times, times, width // times, times, *values.shape[1:])
        return fine[:, 0, :, 0] if times == 1 else fine.mean(axis=(1, 3), dtype=np.float32)

    def mean(self, values: F32, alpha: F32) -> F32:
        """(H, W) mean over the covered part of the pixel."""
        mean = self.share(values)
        mean /= np.maximum(alpha, 1e-6)
        return mean
