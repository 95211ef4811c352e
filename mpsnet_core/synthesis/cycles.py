"""Samples from Cycles: convert the multi-layer EXR of a render to a sample; ray casting adds depth and visibility."""

from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F32, Bools, Floats
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.errors import FormatError
from mpsnet_core.io.files import existing_file
from mpsnet_core.io.image_input import channel_names, image_input_or_reason, pending_error, silence_libraries
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import triangle_normals
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.synthesis.sample import Sample
from mpsnet_core.synthesis.scene_description import SceneDescription
from mpsnet_core.synthesis.shading.directions import disc
from mpsnet_core.synthesis.shading.lights import Light

LIGHT_GROUPS = ("light1", "light2", "light3")
WEIGHTS = "weights"  # passes with this name and a number hold the weights of three materials each
# Shadow rays to an area light, and the offset of their origin from the surface.
SHADOW_RAYS, OFFSET = 16, 1e-4
# Other positions in a pixel to try, one after the other, if a ray through its centre misses the object at an outline.
_ELSEWHERE = ((np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1) + 0.5) / 4 - 0.5).reshape(-1, 2)


def sample_from_cycles(
    path: AnyPath, recipe: SceneDescription, vertices: Floats, triangles: NDArray[np.integer[Any]], renderer: str
) -> Sample:
    """The sample in the multi-layer EXR that Blender 4.5 or later rendered for a recipe.

    Its passes belong to one view layer: Combined (for alpha), Combined_light1 to _light3 (light groups), Normal (in
    world space, which equals camera space), and weights0, weights3 (material weights, three per pass) or, if the recipe
    has no materials, the material index. Blender 4.5 writes them into one part, 5.0 and later into one part per pass.

    vertices (V, 3) and triangles (T, 3): the rendered mesh in world space. Depth and `lit` are computed from it by ray
    casting. renderer: as in :class:`Sample`.

    Raises FormatError if the file is damaged, is no such render, or has values that are not finite.
    """
    path = existing_file(path, "render")
    planes = _planes(path)
    camera = recipe.camera

    def layer(name: str, *choices: str) -> F32:
        """A pass, (H, W, C), by its name and the possible names of its channels."""
        for channels in choices:
            if all(f"{name}.{channel}" in planes for channel in channels):
                values = np.stack([planes[f"{name}.{channel}"] for channel in channels], axis=-1)
                return _checked(values, f"{name} pass", camera, path)
        raise FormatError(f"{path} has no {name} pass; it is not a render of a sample, make the sample again")

    alpha = np.clip(layer("Combined", "A")[..., 0], 0, 1)
    covered = alpha > 0
    lights = np.stack([layer(f"Combined_{name}", "RGB") for name in LIGHT_GROUPS])
    normals = np.where(covered[..., None], normalised(layer("Normal", "XYZ")), np.float32(0))
    if recipe.materials:
        passes = [f"{WEIGHTS}{first}" for first in range(0, len(recipe.materials), 3)]
        material = np.concatenate([layer(name, "RGB") for name in passes], axis=-1).argmax(axis=-1)
    else:
        old = any(name.startswith("IndexMA.") for name in planes)  # its name up to Blender 4.5
        index = layer("IndexMA" if old else "Material Index", "X", "V")  # V if the compositor wrote it
        material = np.rint(index[..., 0]).astype(np.int64)
    depth, lit = _traced(recipe, RayScene(vertices, triangles), vertices, triangles, normals, covered)
    lights = np.where(covered[..., None], np.maximum(lights, 0), np.float32(0))
    material = np.where(covered, material, -1).astype(np.int32)
    return Sample(lights, normals, depth, alpha, material, lit, recipe, renderer)


def _planes(path: Path) -> dict[str, F32]:
    """All channels of all parts of a file, by name without the view layer."""
    source, reason = image_input_or_reason(path)
    if source is None:
        raise FormatError(f"{path} is not a render, or cut short ({reason}); make the sample again")
    planes: dict[str, F32] = {}
    try:
        part = 0
        while source.seek_subimage(part, 0):
            names = channel_names(source.spec(), path)
            with silence_libraries():
                values = source.read_image(part, 0, 0, len(names), oiio.FLOAT)
            reason = pending_error(source)
            if values is None or reason:
                raise FormatError(f"{path} is damaged or cut short ({reason or 'no pixels'}); make the sample again")
            planes |= {name.partition(".")[2]: values[..., number] for number, name in enumerate(names)}
            part += 1
    finally:
        source.close()
    return planes


def _checked(values: F32, what: str, camera: Camera, path: Path) -> F32:
    height, width = values.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise FormatError(f"{path} is {width} x {height}, not {camera.width} x {camera.height}; make it again")
    if not np.isfinite(values).all():
        raise FormatError(f"{path} holds values that are not finite in its {what}; make the sample again")
    return values


def _traced(
    recipe: SceneDescription,
    scene: RayScene,
    vertices: Floats,
    triangles: NDArray[np.integer[Any]],
    normals: F32,
    covered: Bools,
) -> tuple[F32, F32]:
    """Depth (H, W), and `lit` (3, H, W), of the covered pixels."""
    camera = recipe.camera
    depth = np.zeros(covered.shape, np.float32)
    lit = np.zeros((3, *covered.shape), np.float32)
    rows, columns = np.nonzero(covered)
    middles = np.stack([columns, rows], axis=1) + 0.5
    origins, directions = camera.rays(middles)
    hits = scene.hits(origins, directions)
    triangle, distance = hits.triangle.copy(), hits.distance.astype(np.float64)
    for step in _ELSEWHERE:
        missed = np.flatnonzero(triangle < 0)
        if not len(missed):
            break
        origins[missed], directions[missed] = camera.rays(middles[missed] + step)
        hits = scene.hits(origins[missed], directions[missed])
        triangle[missed], distance[missed] = hits.triangle, hits.distance
    met = triangle >= 0
    rows, columns, directions = rows[met], columns[met], directions[met]
    points = origins[met] + distance[met, None] * directions
    depth[rows, columns] = points @ camera.depth_row()[:3] + camera.depth_row()[3]

    faces = normalised(triangle_normals(vertices[triangles[triangle[met]]]))
    faces *= -np.sign(dot(faces, directions))[:, None]
    starts = points + OFFSET * scene.size * faces
    shading = normals[rows, columns]
    for light, direction, size in zip(lit, recipe.light_directions, recipe.light_sizes, strict=True):
        towards = Light(direction, size).towards(disc(SHADOW_RAYS if size else 1)[0])
        seen = [(shading @ one > 0) & ~scene.occluded(starts, one[None]) for one in towards]
        light[rows, columns] = np.mean(seen, axis=0)
    return depth, lit
