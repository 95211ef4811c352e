"""Agreement: how much of the surface each view sees, and its angle to the other views, with and without levelling.

It is measured at points spread evenly over the surface, independently of UVs and texture size, and while each view is
in memory: none needs to be read again.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mpsnet_core.arrays.types import F32
from mpsnet_core.arrays.unit_vectors import angular_error, normalised
from mpsnet_core.bake.projection import Projector, View
from mpsnet_core.bake.texel_surface import SurfacePoints
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.rays import RayScene

log = logging.getLogger(__name__)

POINTS = 20_000
# Degrees. Estimates of the same surface differ by less, with any network.
MAX_DIFFERENCE = 20.0
# Roberts' additive sequence for two dimensions, from the plastic number.
_STEPS = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True)
class ViewAgreement:
    """What one view contributes. Angles are in degrees, NaN if no other view sees the same surface."""

    name: str
    """Name of the view."""
    seen: float
    """Fraction of the surface's area that it sees."""
    level: float
    """Mean angle of its low-frequency correction."""
    before: float
    """Mean angle between its normals and the mean of the others, weighted as in the bake, without low-frequency
    correction of any view."""
    after: float
    """The same with low-frequency correction of all views."""
    gain: Sequence[float] | None = None
    """Factors on the channels of its colours, if it has any."""


@dataclass
class Agreement:
    """The views' samples at points of the surface."""

    scene: RayScene
    """The scene of the meshes."""
    feather: float
    """Distance over which views fade, as in :class:`.settings.BakeSettings`."""
    points: SurfacePoints
    """N points, relative to the scene's centre."""
    colours: list[F32] = field(default_factory=list)
    """For each view, (N, 4) its colour times its weight, and the weight; (N, 0) for views without colours."""
    _views: list[tuple[str, float]] = field(default_factory=list)
    _samples: list[tuple[F32, F32]] = field(default_factory=list)

    def add(self, name: str, estimated: View, levelled: View, level: float) -> None:
        """Add a view, as estimated and as levelled by `level` degrees on average."""
        self._views.append((name, level))
        sampled = self._sample(estimated)
        self._samples.append((sampled[:, :4], (sampled if levelled is estimated else self._sample(levelled))[:, :4]))
        self.colours.append(sampled[:, 4:])

    def _sample(self, view: View) -> F32:
        projector = Projector(view, self.scene, self.feather)
        sampled = np.zeros((self.points.positions.shape[1], projector.samples.shape[2]), np.float32)
        seen, samples = projector.sample_points(self.points)
        sampled[seen] = samples
        return sampled

    def views(self, gains: Sequence[Sequence[float]] | None = None) -> list[ViewAgreement]:
        """What each view contributes, in the order in which they were added. gains: of their colours."""
        before, after = (_angles_to_the_others([samples[place] for samples in self._samples]) for place in (0, 1))
        return [
            ViewAgreement(
                name, float((samples[1][:, 3] > 0).mean()), level, one, other, gains[number] if gains else None
            )
            for number, ((name, level), samples, one, other) in enumerate(
                zip(self._views, self._samples, before, after, strict=True)
            )
        ]


def agreement(mesh: Mesh, scene: RayScene, feather: float = 0.0, count: int = POINTS) -> Agreement:
    """An Agreement without views, at `count` points spread over the mesh by area, the same ones every time.

    feather: as for :func:`mpsnet_core.bake.bake.bake_normals`.
    """
    areas = np.cumsum(mesh.world_areas)
    number = np.arange(count)
    triangle = np.searchsorted(areas, (number + 0.5) / count * areas[-1]).clip(max=len(areas) - 1)
    u, v = ((number[:, None] + 0.5) * _STEPS % 1).T
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    weights = np.stack([1 - u - v, u, v], axis=1)[..., None]
    points = (mesh.world_vertices[mesh.triangles[triangle]] * weights).sum(axis=1) - scene.middle
    normals = (mesh.corner_normals[triangle] * weights).sum(axis=1) @ mesh.normals_to_world
    own = (points, normalised(normals), mesh.outwards[triangle])
    return Agreement(scene, feather, SurfacePoints(*(one.T.astype(np.float32, order="C") for one in own)))


def _angles_to_the_others(samples: Sequence[F32]) -> list[float]:
    """Each view's mean angle in degrees to the mean of the others, weighted as in the bake."""
    total = np.sum(samples, axis=0)
    departures = []
    for sampled in samples:
        others = total - sampled
        # Where no other view sees the point, the subtraction leaves rounding errors.
        shared = np.flatnonzero((sampled[:, 3] > 0) & (others[:, 3] > 1e-5 * total[:, 3]))
        own, rest = normalised(sampled[shared, :3]), normalised(others[shared, :3])
        weights = sampled[shared, 3]
        mean = float(np.average(angular_error(own, rest), weights=weights)) if len(shared) else float("nan")
        departures.append(mean)
    return departures


def warn_of_doubts(views: Sequence[ViewAgreement]) -> None:
    """Warn of views whose angle to the others, or to the mesh, exceeds that between estimates."""
    for view in views:
        if max(np.nan_to_num(view.before), view.level) > MAX_DIFFERENCE:
            difference = "" if np.isnan(view.before) else f"is {view.before:.0f}° apart from the others and "
            log.warning(
                "view %s %swas levelled by %.0f°: check that rig, camera and mesh belong together, and "
                "check --lights-in [views-apart]",
                view.name,
                difference,
                view.level,
            )


def table_rows(views: Sequence[ViewAgreement]) -> list[dict[str, Any]]:
    """The views as plain data for JSON: None instead of NaN, angles rounded to a thousandth of a degree."""
    return [
        {
            "view": view.name,
            "seen_area": round(view.seen, 4),
            "level_deg": _rounded(view.level),
            "before_deg": _rounded(view.before),
            "after_deg": _rounded(view.after),
            **({} if view.gain is None else {"gain": [round(float(one), 4) for one in view.gain]}),
        }
        for view in views
    ]


def _rounded(value: float) -> float | None:
    return round(value, 3) if np.isfinite(value) else None
