"""Colours matched across views: a gain for each view and channel, from the places that several views see.

Each view's albedo has a scale of its own, as no photo states its exposure, and a tint of its own, where the white
balance or the light was another. Where two views see one place, the ratio of their colours shows by how much.
"""

import logging
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.bake.projection import View
from mpsnet_core.bake.view_agreement import agreement
from mpsnet_core.scene.joined_mesh import join_meshes
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.rays import RayScene

log = logging.getLogger(__name__)

# Fewer places than this, of those that two views share, are no measure.
LEAST_SHARED = 30
# Below this share of the channel's 99th percentile a colour is too dark for a ratio.
DARK = 0.02
# The brightest colour, by this percentile, does not become brighter than 1, where PNG clips.
BRIGHTEST_PERCENTILE = 99.5


def colour_gains(looks: Sequence[NDArray[np.float32]]) -> NDArray[np.float32]:
    """(V, 3) what to multiply the channels of V views by, so that they agree where they see the same.

    looks: for each view (N, 4) what it sees at N points of the surface: the colour times its weight, and the weight.

    Of each two views it takes the median ratio at the points that both see well: highlights and wrong normals are
    outliers. The mean over views that overlap, of the gains' logarithms, is 0 in each channel, so that no channel gains
    on another; all gains are smaller where the brightest colours would be clipped.
    """
    count = len(looks)
    values = np.stack([look[:, :3] / np.maximum(look[:, 3:], 1e-12) for look in looks])
    weights = np.stack([look[:, 3] for look in looks])
    seen = weights > 0
    known = np.stack([_bright(value, mask) for value, mask in zip(values, seen, strict=True)])
    logarithms = np.log(np.where(known, values, 1))
    # The normal equations of least squares over all pairs, channel by channel.
    left, right, alone = np.zeros((3, count, count)), np.zeros((3, count)), np.ones(count, bool)
    for one in range(count):
        for other in range(one):
            shared = np.flatnonzero(seen[one] & seen[other])
            if len(shared) < LEAST_SHARED:
                continue
            least = np.minimum(weights[one, shared], weights[other, shared])
            well = shared[least >= np.median(least)]
            for channel in range(3):
                both = well[known[one, well, channel] & known[other, well, channel]]
                if len(both) < LEAST_SHARED / 2:
                    continue
                apart = np.median(logarithms[one, both, channel] - logarithms[other, both, channel])
                left[channel][[one, other], [one, other]] += len(both)
                left[channel][[one, other], [other, one]] -= len(both)
                right[channel][[one, other]] += -len(both) * apart, len(both) * apart
                alone[[one, other]] = False
    # The solution of least norm: its mean is 0 in each group of views that overlap.
    gains = np.exp([np.linalg.lstsq(*equations, rcond=1e-9)[0] for equations in zip(left, right, strict=True)]).T
    gains *= _darkening(values[seen], (values * gains[:, None])[seen])
    _note(gains, alone)
    return gains.astype(np.float32)


def matched_views(views: Sequence[View], meshes: Sequence[Mesh], feather: float) -> list[View]:
    """The views, all of which have colours, with these matched. meshes, feather: as the bake takes them."""
    mesh = join_meshes(meshes)
    looked = agreement(mesh, RayScene.of(mesh), feather)
    for view in views:
        looked.add("", view, view, 0.0)
    gains = colour_gains(looked.colours)
    return [matched(view, gain) for view, gain in zip(views, gains, strict=True)]


def matched(view: View, gain: NDArray[np.float32]) -> View:
    """The view with its colours times the gain (3,)."""
    return view if view.colours is None else replace(view, colours=view.colours * gain)


def _bright(values: NDArray[np.float32], seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(N, 3) where a view's colours (N, 3) are bright enough for ratios."""
    least = DARK * np.percentile(values[seen], 99, axis=0) if seen.any() else np.zeros(3)
    return seen[:, None] & (values > np.maximum(least, 1e-9))


def _darkening(before: NDArray[np.floating[Any]], after: NDArray[np.floating[Any]]) -> float:
    """By how much all gains have to be smaller."""
    if not len(before):
        return 1.0
    was, now = (float(np.percentile(values.max(axis=-1), BRIGHTEST_PERCENTILE)) for values in (before, after))
    return min(1.0, max(1.0, was) / max(now, 1e-12))


def _note(gains: NDArray[np.float64], alone: NDArray[np.bool_]) -> None:
    if len(gains) < 2:
        return
    log.info("the views' colours are matched, by gains of %.3g to %.3g", gains.min(), gains.max())
    if alone.any():
        log.warning(
            "%d of %d views share too little of the surface with the others for their colours to be matched",
            alone.sum(),
            len(alone),
        )
