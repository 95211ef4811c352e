"""A flat weave whose height, normals and period are known by formula, and its photo by the image formation."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from mpsnet_core import Capture, LightRig, NormalMap, published_rig


@dataclass(frozen=True)
class Weave:
    """``h = A (cos(2πu / P) + cos(2πv / P))`` in millimetres, u and v the pixel's place turned by some degrees.

    P is the period in pixels. shape: (H, W).
    """

    shape: tuple[int, int] = (260, 330)
    period: float = 23.7
    amplitude_mm: float = 0.12
    pixel_mm: float = 0.2
    degrees: float = 0.0

    @property
    def axes(self) -> np.ndarray:
        """Rows: the directions (columns, rows) along which it repeats."""
        angle = np.radians(self.degrees)
        return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])

    @property
    def _waves(self) -> np.ndarray:
        rows, columns = np.indices(self.shape) + 0.5
        return 2 * np.pi / self.period * np.einsum("ai,ihw->ahw", self.axes, np.stack([columns, rows]))

    @property
    def height(self) -> np.ndarray:
        return self.amplitude_mm * np.cos(self._waves).sum(axis=0)

    @property
    def gradients(self) -> np.ndarray:
        """(H, W, 2) along columns and rows, in mm a mm."""
        steep = -self.amplitude_mm * 2 * np.pi / (self.period * self.pixel_mm) * np.sin(self._waves)
        return np.einsum("ahw,ai->hwi", steep, self.axes)

    @property
    def normals(self) -> np.ndarray:
        across, down = np.moveaxis(self.gradients, -1, 0)
        vectors = np.stack([-across, down, np.ones_like(down)], axis=-1)
        return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)

    def normal_map(self) -> NormalMap:
        return NormalMap(self.normals, np.ones(self.shape, bool))

    def capture(self, albedo: np.ndarray | float = 0.6, rig: LightRig | None = None, **changes: Any) -> Capture:
        """The photo ``c = M (albedo * max(n·l, 0))``; all of it is the object."""
        rig = rig or published_rig()
        light = np.maximum(np.einsum("hwi,ki->hwk", self.normals, rig.directions), 0) * albedo
        photo = np.einsum("hwk,ik->hwi", light, rig.mixing)
        return Capture(photo.astype(np.float32), np.ones(self.shape, bool), rig, **changes)
