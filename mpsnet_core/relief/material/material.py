"""Flat materials: seamless textures of known size, made from one photo."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mpsnet_core import defaults
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.capture.capture import Capture
from mpsnet_core.defaults import MAX_MATERIAL_SIZE, MAX_OVERLAP, MIN_MATERIAL_SIZE, MIN_OVERLAP
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.progress import Progress, silent
from mpsnet_core.relief.curvature import curvature
from mpsnet_core.relief.height_map import check_size
from mpsnet_core.relief.material import flatten
from mpsnet_core.relief.material.tiling import MIN_JOINED, Seam, Tiling, find_tiling, measure_seam, sampled, seamless
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap

# Brighter albedos do not occur in nature. If some do in a photo, all are darkened.
BRIGHTEST = 0.95


@dataclass(frozen=True, eq=False)
class Material:
    """A tile of a flat material. All its textures are periodic."""

    normals: F32
    """(H, W, 3) float32. Unit vectors: x right, y up, z out of the material. Their gradients have mean 0."""
    height: F32
    """(H, W) float32. In millimetres, mean 0."""
    curvature: F32
    """(H, W) float32. Sum of the principal curvatures in 1 / mm, above 0 where the material is convex."""
    albedo: F32
    """(H, W, 3) float32. Linear, 0 to 1."""
    width_mm: float
    """Width of the tile in millimetres."""
    height_mm: float
    """Height of the tile in millimetres."""
    tiling: Tiling
    """The tile's steps in the photo."""
    seam: Seam
    """How visible the tile's joins are."""
    tilt: float
    """Tilt of the photo in degrees."""


@takes_files
def flat_material(
    capture: Capture,
    normals: NormalMap,
    pixel_mm: float,
    *,
    size: int | None = None,
    overlap: float = defaults.OVERLAP,
    bend: int = defaults.BEND,
    grey: bool = False,
    progress: Progress = silent,
) -> Material:
    """Make a seamless tile from a photo that a flat material fills.

    Parameters
    ----------
    capture : Capture
        The photo, (H, W) pixels.
    normals : NormalMap
        Normals estimated from the photo, in camera space, (H, W). Their mask is not used.
    pixel_mm : float
        Size of a pixel on the material, in millimetres.
    size : int, optional
        Side of the square textures in pixels; by default they have the photo's resolution.
    overlap : float
        Fraction of the tile over which opposite borders are blended.
    bend : int
        Half waves across photo and tile up to which bends and uneven brightness are removed; 0 removes the tilt alone.
    grey : bool
        Whether the albedo has no colour.
    progress : callable
        Receives the fraction done and a message.

    Raises
    ------
    SettingsError
        If a size, fraction or bend is out of range.
    GeometryError
        If the photo is too small or not filled, or the normals have another size.

    Notes
    -----
    Opposite borders are joined along the line where they differ least, the same in all textures (Efros and Freeman,
    "Image Quilting", 2001). Gradients are joined, which keeps normals unit vectors, and integrated afterwards.
    """
    check_material(size, overlap, bend)
    if not pixel_mm > 0:
        raise SettingsError(f"a pixel measures some millimetres above 0, not {pixel_mm:g}")
    capture = crop_to_filled_part(capture)
    check_size("photo", capture.mask.shape, normals)
    features, tilt = _flatten(capture, normals, bend, grey, progress)
    progress(0.3, "looking for what repeats")
    tiling = find_tiling(_features_to_compare(features), overlap)
    tile = _tile_size(tiling, size)
    joined = round(overlap * tile[0]), round(overlap * tile[1])
    _check_overlap(min(joined), overlap)
    progress(0.5, "joining the borders")
    features = sampled(features, tiling, tile, joined)  # frees those of the whole photo, which are large
    features, cut = seamless(features, joined)
    progress(0.7, "integrating the height")
    return _material(flatten.remove_low_frequencies(features, bend), cut, tiling, tilt, pixel_mm)


def _material(pictures: F32, cut: Bools, tiling: Tiling, tilt: float, pixel_mm: float) -> Material:
    """The material from (h, w, 5) features of the tile: gradients and the albedo's logarithm."""
    gradients = pictures[..., :2] - pictures[..., :2].mean(axis=(0, 1))
    normals = flatten.normals_of(gradients)
    width_mm, height_mm = (float(np.linalg.norm(step)) * pixel_mm for step in (tiling.right, tiling.down))
    pitch = width_mm / cut.shape[1], height_mm / cut.shape[0]
    height, bent = flatten.periodic_height(gradients, pitch), _repeated_curvature(normals, pitch)
    albedo, seam = _within_range(np.exp(pictures[..., 2:])), measure_seam(normals, cut)
    return Material(normals, height, bent, albedo, width_mm, height_mm, tiling, seam, tilt)


def check_material(size: int | None, overlap: float, bend: int) -> None:
    """Raise SettingsError if a material of this size, overlap and bend cannot be made."""
    if size is not None and not MIN_MATERIAL_SIZE <= size <= MAX_MATERIAL_SIZE:
        raise SettingsError(f"a material has {MIN_MATERIAL_SIZE} to {MAX_MATERIAL_SIZE} pixels a side, not {size}")
    if not MIN_OVERLAP <= overlap <= MAX_OVERLAP:
        raise SettingsError(f"borders overlap by {MIN_OVERLAP:g} to {MAX_OVERLAP:g} of the tile, not {overlap:g}")
    if size is not None:
        _check_overlap(round(overlap * size), overlap)
    if not 0 <= bend <= defaults.MAX_BEND:
        raise SettingsError(f"a bend of {bend} half waves cannot be taken out; choose 0 to {defaults.MAX_BEND}")


def _check_overlap(pixels: int, overlap: float) -> None:
    if pixels < MIN_JOINED:
        raise SettingsError(
            f"borders that overlap by {overlap:g} of the tile are joined over {pixels} pixels, and need "
            f"{MIN_JOINED}; choose a larger overlap, size or photo"
        )


def crop_to_filled_part(capture: Capture, crop: tuple[int, int, int, int] | None = None) -> Capture:
    """The capture of a part of the photo, which the material must fill.

    crop: left, top, width and height in pixels, from the photo's upper left corner; the whole photo by default.

    Raises InputError if the part is not within the photo, is not entirely in the mask, or is too small.
    """
    rows, columns = capture.mask.shape
    left, top, width, height = crop or (0, 0, columns, rows)
    if min(width, height) < 1:
        raise SettingsError(
            f"the crop leaves nothing of the photo's {columns} x {rows} pixels: its width and height are {width} and "
            f"{height}; give 1 or more"
        )
    if min(left, top) < 0 or left + width > columns or top + height > rows:
        raise SettingsError(
            f"the crop of {width} x {height} pixels from {left} on across and from {top} on down is not within "
            f"the photo, which is {columns} x {rows}; choose a crop within it"
        )
    if min(width, height) < MIN_MATERIAL_SIZE:
        raise GeometryError(f"{width} x {height} pixels are too few for a material; take {MIN_MATERIAL_SIZE} or more")
    part = slice(top, top + height), slice(left, left + width)
    missing = 1 - float(capture.mask[part].mean())
    if missing:
        raise GeometryError(f"a flat material fills the photo, but {missing:.1%} of it is transparent; crop it")
    camera = capture.camera and capture.camera.cropped(left, top, width, height)
    arrays = {name: getattr(capture, name) for name in ("image", "mask", "depth", "clipped")}
    cropped: dict[str, Any] = {name: None if one is None else one[part] for name, one in arrays.items()}
    return replace(capture, camera=camera, **cropped)


def _flatten(capture: Capture, normals: NormalMap, bend: int, grey: bool, progress: Progress) -> tuple[F32, float]:
    """(H, W, 5) gradients along columns and rows and the albedo's logarithm, and the tilt that was removed."""
    progress(0.0, "laying the material flat")
    gradients, tilt = flatten.flatten_normals(normals.vectors, bend)
    progress(0.15, "estimating the albedo")
    albedo = flatten.flatten_albedo(flatten.estimated_albedo(capture, flatten.normals_of(gradients), grey=grey), bend)
    return np.concatenate([gradients, np.log(albedo)], axis=-1), tilt


def _features_to_compare(features: F32) -> F32:
    """Features for the comparison of places: gradients, and the logarithm of brightness, scaled to match."""
    brightness = features[..., 2:].mean(axis=-1, keepdims=True)
    return np.concatenate([features[..., :2], brightness - brightness.mean()], axis=-1)


def _tile_size(tiling: Tiling, size: int | None) -> tuple[int, int]:
    """Rows and columns of the tile."""
    if size is not None:
        return size, size
    across, down = (max(1, round(float(np.linalg.norm(step)))) for step in (tiling.right, tiling.down))
    return down, across


def _repeated_curvature(normals: F32, pitch: tuple[float, float]) -> F32:
    """(H, W) the curvature of a periodic tile, computed with enough repetition around it."""
    around = defaults.CURVATURE_RADIUS + 1
    vectors = np.pad(normals, ((around, around), (around, around), (0, 0)), mode="wrap")
    shape = vectors.shape[:2]
    found = curvature(NormalMap(vectors, np.ones(shape, bool)), _camera(shape, pitch))
    return found[around:-around, around:-around]


def _camera(shape: tuple[int, ...], pitch: tuple[float, float]) -> Camera:
    """An orthographic camera in millimetres."""
    return Camera("orthographic", shape[1], shape[0], 1 / np.array(pitch))


def _within_range(albedo: F32) -> F32:
    """Albedos of at most 1. All are darkened if one in a hundred exceeds BRIGHTEST."""
    bright = float(np.percentile(albedo[::4, ::4], 99))
    return np.clip(albedo * np.float32(min(1.0, BRIGHTEST / max(bright, 1e-6))), 0, 1)
