"""Agreement: how much of the surface each view sees, and its angle to the other views, with and without levelling.

It is measured at points spread evenly over the surface, independently of UVs and texture size, and while each view is
in memory: none needs to be read again.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mpsnet_core.arrays.resampling import chosen_pixels, reduced_shape
from mpsnet_core.arrays.types import F32, F64, Bools, Floats
from mpsnet_core.arrays.unit_vectors import angular_error, normalised
from mpsnet_core.bake.projection import Projector, View
from mpsnet_core.bake.texel_surface import SurfacePoints
from mpsnet_core.errors import Note
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh, join_meshes, world_from_file
from mpsnet_core.scene.rays import RayScene, mesh_hits

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
        seen = [float((levelled[:, 3] > 0).mean()) for _, levelled in self._samples]
        names, levels = zip(*self._views, strict=True)
        of_colours: Sequence[Sequence[float] | None] = gains or [None] * len(seen)
        known = zip(names, seen, levels, before, after, of_colours, strict=True)
        return [ViewAgreement(*facts) for facts in known]


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


# ----------------------------------------------------------------------------------------------------------------------
# Whether a view fits the mesh: its mask and normals are compared with those of the mesh through its camera.


# Pixels that are compared on the longer side.
PIXELS = 256
TOGETHER = Note("check that camera, photo and mesh belong together, and the mesh's axes and unit (--up, --unit)")
# A mask that covers more of the image has no outline to compare.
WHOLE_IMAGE = 0.95
# A mesh that covers less of a view than this is too small to be meant.
TINY = 0.003
# A view above this cost does not fit. Of right views of 26 meshes, 1% is above it, also with decimated meshes and masks
# of a half; of views under a wrong axis 91%, of cameras on the other side 78%, and the second choices of align.
POOR = 0.62
# Above this cost, other axes and units are tried. One whose cost is below this multiple is meant, if it explains more
# than this share of the normals' variance.
DOUBTFUL, BETTER, EXPLAINED = 0.35, 0.5, 0.1
# Lengths of units in each other: mm, cm, in, ft and m.
UNITS = (0.001, 0.01, 0.0254, 0.1, 0.3048, 1 / 0.3048, 10.0, 1 / 0.0254, 100.0, 1000.0)


@dataclass(frozen=True)
class ViewFit:
    """How well a mesh fits a view."""

    covered: float
    """The share of the view's mask that shows the mesh. The mesh may go on beyond the mask and the image."""
    degrees: float
    """Median angle between the mesh's facets and the view's normals there; 180 if there is no such pixel."""
    explained: float
    """The share of the normals' variance there that the mesh explains, at most 1."""
    outlined: bool
    """Whether the mask has an outline."""

    @property
    def cost(self) -> float:
        """Smaller is better."""
        return (1 - self.covered if self.outlined else 0.0) + self.degrees / 60

    @property
    def poor(self) -> bool:
        return self.covered < TINY or self.cost > POOR


def view_fit(view: View, camera: Camera, mesh: Mesh, scene: RayScene) -> ViewFit:
    """How well a mesh, seen by a camera, fits a view. scene: of the same mesh."""
    height, width = view.normals.mask.shape
    rows, columns = chosen_pixels(*reduced_shape(height, width, PIXELS), height, width)
    shown = view.normals.mask[np.ix_(rows, columns)]
    row, column = np.nonzero(shown)
    seen = mesh_hits(mesh, camera, scene, np.stack([columns[column], rows[row]], axis=1) + 0.5)
    facets = mesh.outwards[seen.triangle] @ camera.rotation
    facets[(facets * seen.directions).sum(axis=1) > 0] *= -1  # the mesh may be open
    normals = view.normals.vectors[rows[row], columns[column]][seen.hit]
    outlined = bool(shown.mean() < WHOLE_IMAGE)
    if not len(normals):
        return ViewFit(0.0, 180.0, 0.0, outlined)
    cosine = np.clip((facets * normals).sum(axis=1), -1, 1)
    unlike = float(((facets - normals) ** 2).sum())
    variance = float(((normals - normals.mean(axis=0)) ** 2).sum())
    explained = 1 - unlike / max(variance, 1e-9)
    return ViewFit(len(normals) / len(row), float(np.degrees(np.median(np.arccos(cosine)))), explained, outlined)


def warn_of_misfit(name: str, view: View, mesh: Mesh, scene: RayScene) -> None:
    """Warn if a mesh does not fit a view, or would fit far better with another axis up or in another unit."""
    found = view_fit(view, view.camera, mesh, scene)
    if found.cost < DOUBTFUL and found.covered >= TINY:
        return
    remedy = _remedy(found, view, mesh, scene)
    if not (remedy or found.poor):
        return
    covered = f"{100 * found.covered:.2g}%" if found.covered < 0.1 else f"{found.covered:.0%}"
    log.warning(
        "view %s does not fit the mesh, which covers %s of what the view shows, with normals that differ by %.0f° "
        "(median): %s [misfit-view]",
        *(name, covered, found.degrees, remedy or TOGETHER),
    )


def _remedy(found: ViewFit, view: View, mesh: Mesh, scene: RayScene) -> Note:
    """The change of the mesh's axes or unit with which it fits, "" if there is none."""
    turn = world_from_file("y", 1.0)
    tried = [
        (Note("it fits if its y axis points up (--up y)"), _moved(view.camera, turn, 1.0)),
        (Note("it fits if its z axis points up, not y (--up z)"), _moved(view.camera, np.linalg.inv(turn), 1.0)),
        *(
            (Note("it fits if its unit is %.4g times as long (--unit)", unit), _moved(view.camera, np.eye(4), unit))
            for unit in UNITS
        ),
    ]
    fits = [(view_fit(view, camera, mesh, scene), words) for words, camera in tried]
    best, words = min(fits, key=lambda one: one[0].cost)
    # Without an outline, any size fits a flat mesh.
    is_clear = best.outlined and best.explained > max(EXPLAINED, found.explained)
    return words if is_clear and best.covered > TINY and best.cost < BETTER * found.cost else Note("")


def _moved(camera: Camera, turn: F64, unit: float) -> Camera:
    """The camera that sees the mesh as `camera` would see it, turned and scaled about the world's origin."""
    pose = np.linalg.inv(turn) @ camera.world_from_camera
    pose[:3, 3] /= unit
    focal = camera.focal * unit if camera.projection == "orthographic" else camera.focal
    return replace(camera, world_from_camera=pose, focal=focal)


# ----------------------------------------------------------------------------------------------------------------------
# Colour matching across views: a gain for each view and channel, from points that several views see.
#
# The scale of an albedo differs between views, because a photo's exposure is unknown. So does its tint, if
# white balance or light changed. The ratio of the colours of two views at a common point shows by how much.


# Two views need this many common points to be matched.
MIN_SHARED = 30
# Colours darker than this fraction of the channel's 99th percentile are too dark for a ratio.
DARK = 0.02
# Gains must not lift this percentile above 1, where PNG clips.
BRIGHTEST_PERCENTILE = 99.5


def colour_gains(samples: Sequence[F32]) -> F32:
    """(V, 3) gains for the channels of V views that make them agree where they see the same surface.

    samples: for each view (N, 4) what it sees at N points of the surface: the colour times its weight, and the weight.

    Each pair of views contributes the median ratio at the points that both see well: highlights and wrong normals are
    outliers. In each group of overlapping views the gains' logarithms have mean 0 in each channel, which keeps the
    overall tint. All gains are reduced if the brightest colours would clip.
    """
    count = len(samples)
    values = np.stack([sampled[:, :3] / np.maximum(sampled[:, 3:], 1e-12) for sampled in samples])
    weights = np.stack([sampled[:, 3] for sampled in samples])
    seen = weights > 0
    known = np.stack([_bright(value, mask) for value, mask in zip(values, seen, strict=True)])
    logarithms = np.log(np.where(known, values, 1))
    # The normal equations of least squares over all pairs, channel by channel.
    left, right, alone = np.zeros((3, count, count)), np.zeros((3, count)), np.ones(count, bool)
    for one in range(count):
        for other in range(one):
            shared = np.flatnonzero(seen[one] & seen[other])
            if len(shared) < MIN_SHARED:
                continue
            least = np.minimum(weights[one, shared], weights[other, shared])
            well = shared[least >= np.median(least)]
            for channel in range(3):
                both = well[known[one, well, channel] & known[other, well, channel]]
                if len(both) < MIN_SHARED / 2:
                    continue
                log_ratio = np.median(logarithms[one, both, channel] - logarithms[other, both, channel])
                left[channel][[one, other], [one, other]] += len(both)
                left[channel][[one, other], [other, one]] -= len(both)
                right[channel][[one, other]] += -len(both) * log_ratio, len(both) * log_ratio
                alone[[one, other]] = False
    # The minimum-norm solution: its mean is 0 in each group of overlapping views.
    gains = np.exp([np.linalg.lstsq(*equations, rcond=1e-9)[0] for equations in zip(left, right, strict=True)]).T
    gains *= _darkening(values[seen], (values * gains[:, None])[seen])
    _log_gains(gains, alone)
    return gains.astype(np.float32)


def matched_views(views: Sequence[View], meshes: Sequence[Mesh], feather: float) -> list[View]:
    """The views with matched colours. All views must have colours. meshes, feather: as the bake takes them."""
    mesh = join_meshes(meshes)
    looked = agreement(mesh, RayScene.of(mesh), feather)
    for view in views:
        looked.add("", view, view, 0.0)
    gains = colour_gains(looked.colours)
    return [matched(view, gain) for view, gain in zip(views, gains, strict=True)]


def matched(view: View, gain: F32) -> View:
    """The view with its colours times the gain (3,)."""
    return view if view.colours is None else replace(view, colours=view.colours * gain)


def _bright(values: F32, seen: Bools) -> Bools:
    """(N, 3) where a view's colours (N, 3) are bright enough for ratios."""
    least = DARK * np.percentile(values[seen], 99, axis=0) if seen.any() else np.zeros(3)
    return seen[:, None] & (values > np.maximum(least, 1e-9))


def _darkening(before: Floats, after: Floats) -> float:
    """The factor, at most 1, on all gains that prevents clipping."""
    if not len(before):
        return 1.0
    was, now = (float(np.percentile(values.max(axis=-1), BRIGHTEST_PERCENTILE)) for values in (before, after))
    return min(1.0, max(1.0, was) / max(now, 1e-12))


def _log_gains(gains: F64, alone: Bools) -> None:
    if len(gains) < 2:
        return
    log.info("the views' colours are matched, by gains of %.3g to %.3g", gains.min(), gains.max())
    if alone.any():
        log.warning(
            "%s of %s views share too little of the surface with the others for their colours to be matched",
            alone.sum(),
            len(alone),
        )
