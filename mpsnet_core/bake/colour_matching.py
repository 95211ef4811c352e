"""Colour matching across views: a gain for each view and channel, from points that several views see.

The scale of an albedo differs between views, because a photo's exposure is unknown. So does its tint, if white balance
or light changed. The ratio of the colours of two views at a common point shows by how much.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mpsnet_core.arrays.types import F32, F64, Bools, Floats
from mpsnet_core.bake.projection import View
from mpsnet_core.bake.view_agreement import agreement
from mpsnet_core.scene.joined_mesh import join_meshes
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.rays import RayScene

log = logging.getLogger(__name__)

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
            "%d of %d views share too little of the surface with the others for their colours to be matched",
            alone.sum(),
            len(alone),
        )
