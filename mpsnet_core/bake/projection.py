"""One view against the surface: what it sees at given points, and how much that counts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.upsample import upsampled
from mpsnet_core.bake.feather import feathered
from mpsnet_core.errors import GeometryError
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.scene.visibility import Visibility

# Surfaces turned further from the camera than this (cosine) show too few pixels to be trusted.
MIN_FACING = 0.1
# A view counts with the cosine between surface and camera to this power: views from ahead win over glancing ones.
FACING_POWER = 4


@dataclass(frozen=True)
class View:
    """One photo's normals and the camera that took it.

    Parameters
    ----------
    camera : Camera
        In the world.
    normals : NormalMap
        In camera space, (H, W).
    colours : (H, W, 3) float32 array, optional
        Linear values to bake beside the normals, such as an albedo; NaN where they are not known.

    Raises
    ------
    GeometryError
        Where their sizes differ.
    """

    camera: Camera
    normals: NormalMap
    colours: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        height, width = self.normals.mask.shape
        if self.colours is not None and self.colours.shape != (height, width, 3):
            raise GeometryError(
                f"the colours are {self.colours.shape[1]} x {self.colours.shape[0]} but the normal map is {width} x "
                f"{height}; they must be the same size"
            )
        if (self.camera.width, self.camera.height) != (width, height):
            raise GeometryError(
                f"the camera is {self.camera.width} x {self.camera.height} but its normal map is {width} x {height}; "
                "they must be the same size"
            )


class Projector:
    """One view, prepared for samples at points of the surface.

    feather: how far from the view's borders it counts in full, as a share of the mesh's size; 0 to let it end sharply.
    """

    def __init__(self, view: View, scene: RayScene, feather: float = 0.0) -> None:
        self.camera, self.middle = view.camera, scene.middle
        self.visibility = Visibility(view.camera, scene)
        self.projection = view.camera.projection_rows()
        self.depth = view.camera.depth_row()
        normals = view.normals
        # A little weight where the confidence is zero: a doubtful normal is better than none.
        weight = np.where(normals.mask, np.maximum(normals.confidence, 0.01), 0).astype(np.float32)
        if feather > 0:
            share = feathered(self.visibility, normals.mask, feather * scene.size)
            for rows in bands(len(weight)):
                weight[rows] *= upsampled(share, weight.shape, rows) ** FACING_POWER
        world = normals.vectors @ view.camera.rotation.T.astype(np.float32)
        layers = [world, np.ones_like(world[..., :1])]
        if view.colours is not None:
            known = np.all(np.isfinite(view.colours), axis=-1, keepdims=True)
            layers += [np.where(known, view.colours, 0), known.astype(np.float32)]
        # (H + 2, W + 2, 4): world normals and a 1, times their weight; with colours (..., 8), these and a 1 likewise.
        # The border of nothing spares sampling at the image's edge a special case.
        self.samples = np.pad(
            np.concatenate(layers, axis=-1, dtype=np.float32) * weight[..., None], [(1, 1), (1, 1), (0, 0)]
        )

    def look(
        self, points: NDArray[np.float32], normals: NDArray[np.float32]
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Which of the surface's points (N, 3), of unit normals (N, 3), the view sees: (M,) their numbers.

        And (M, 4) what it sees there: the weighted normal in world space and its weight; (M, 8) of views with colours,
        the weighted colour and its weight behind them. The points are relative to the scene's middle, the normals in
        world space.
        """
        if self.camera.projection == "orthographic":
            facing = normals @ self.camera.rotation[:, 2].astype(np.float32)
        else:
            towards = (self.camera.world_from_camera[:3, 3] - self.middle).astype(np.float32) - points
            facing = np.einsum("ni,ni->n", normals, towards) / np.linalg.norm(towards, axis=1)
        candidate = np.flatnonzero(facing > MIN_FACING)
        world = points[candidate] + self.middle
        depth = world @ self.depth[:3] + self.depth[3]
        projected = world @ self.projection[:, :3].T + self.projection[:, 3]
        ahead = (depth > 0) | (self.camera.projection == "orthographic")
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = projected[:, :2] / projected[:, 2:]
        inside = (
            ahead
            & (pixels > -0.5).all(axis=1)
            & (pixels < [self.camera.width + 0.5, self.camera.height + 0.5]).all(axis=1)
        )
        candidate, world, pixels, depth = candidate[inside], world[inside], pixels[inside], depth[inside]
        sampled = self._sample(pixels)
        hit = sampled[:, 3] > 0
        candidate, sampled = candidate[hit], sampled[hit]
        visible = self.visibility.seen(world[hit], pixels[hit], depth[hit])
        seen = candidate[visible]
        return seen, sampled[visible] * (facing[seen] ** FACING_POWER)[:, None]

    def _sample(self, pixels: NDArray[np.float64]) -> NDArray[np.float32]:
        """Bilinear, between pixel centres; pixels outside the mask take no part."""
        place = pixels + 0.5  # the border adds one pixel, pixel centres stand at one half
        corner = np.floor(place).astype(np.int64)
        x, y = (place - corner).astype(np.float32).T[..., None]
        stride = self.samples.shape[1]
        index = corner[:, 1] * stride + corner[:, 0]
        flat = self.samples.reshape(-1, self.samples.shape[2])
        above = flat[index] * (1 - x) + flat[index + 1] * x
        below = flat[index + stride] * (1 - x) + flat[index + stride + 1] * x
        result: NDArray[np.float32] = above * (1 - y) + below * y
        return result
