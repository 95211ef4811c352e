"""Light directions from highlights in a mirror ball, and positions from balls at two or more places."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.types import F64
from mpsnet_core.arrays.unit_vectors import angular_error, normalised
from mpsnet_core.calibrate.ball import Ball, fit_ball, mirrored
from mpsnet_core.calibrate.highlights import Highlight
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.scene.camera import camera_of_lens

log = logging.getLogger(__name__)

# A position is used only if its uncertainty is below this share of its distance.
UNSURE = 0.25
# Another spot with this share of a highlight's light may be a light, too.
RIVAL = 0.5
# In a mirror ball, lights are spots smaller than this share of its radius, even lamps of 30° on a side.
BROAD = 0.3
# Rays that miss each other by more than this multiple of their uncertainty do not belong to the same light.
MISSED = 4.0
ROUNDS = 4
# Focal length in millimetres on a sensor 36 mm wide. If the lens is unknown, its effect on a direction counts as one
# standard deviation: of lenses distributed log-uniformly between 24 and 200 mm, two in three are longer.
USUAL_LENS = 45.0


@dataclass(frozen=True)
class Sighting:
    """A mirror ball at one place, and each light's highlight in it."""

    ball: Ball
    """The ball."""
    highlights: tuple[Highlight, ...]
    """Each light's highlight, in the lights' order."""
    lens_known: bool = True
    """Whether the ball's camera is known. If not, it is assumed to be far away, which may be wrong."""

    def rays(self) -> tuple[F64, F64]:
        """Positions on the ball where the lights are mirrored, and unit directions from there to them; each (N, 3)."""
        return mirrored(self.ball, [spot.point for spot in self.highlights])

    def uncertainties(self) -> F64:
        """(N,) standard deviation of each direction in degrees, propagated from outline and highlight."""
        _, directions = self.rays()
        points = np.array([spot.point for spot in self.highlights])
        step = 0.1
        jacobian = [mirrored(self.ball.nudged(*nudge), points)[1] - directions for nudge in step * np.eye(3)]
        by_ball = np.stack(jacobian, axis=-1) / step
        variance = np.einsum("nij,jk,nik->n", by_ball, self.ball.covariance, by_ball)
        blur = np.array([spot.uncertainty for spot in self.highlights])
        for shift in ((step, 0.0), (0.0, step)):
            moved = (mirrored(self.ball, points + shift)[1] - directions) / step
            variance += (moved**2).sum(axis=1) * blur**2
        return np.degrees(np.sqrt(variance))

    def by_lens(self) -> F64:
        """(N,) change of each direction in degrees if the camera had a usual lens; 0 if its lens is known."""
        if self.lens_known:
            return np.zeros(len(self.highlights))
        camera = camera_of_lens(USUAL_LENS, self.ball.camera.width, self.ball.camera.height)
        near = fit_ball(self.ball.outline(), camera)
        return angular_error(mirrored(near, [spot.point for spot in self.highlights])[1], self.rays()[1])


@dataclass(frozen=True, eq=False)
class LightsFound:
    """Directions or positions of N lights, in camera space."""

    sightings: tuple[Sighting, ...]
    """The balls they were computed from."""
    directions: F64
    """(N, 3) float64. Unit vectors to the lights, from the target if lights are near."""
    uncertainties: F64
    """(N,) float64. One standard deviation in degrees, including the effect of perspective if the lens is unknown."""
    target: F64
    """(3,) float64. Centre of the ball, or mean of its places."""
    positions: F64 | None = None
    """(N, 3) float64. Positions in the unit of the balls' radius, if the lights were seen from two places and are near
    enough."""
    position_uncertainties: F64 | None = None
    """(N,) float64. One standard deviation of the positions, in the same unit."""
    gaps: F64 | None = None
    """(N,) float64. RMS distance of the rays to a light from their best intersection, in the same unit."""


@takes_files
def find_lights(sightings: Sequence[Sighting]) -> LightsFound:
    """Directions or positions of lights from mirror balls.

    Parameters
    ----------
    sightings : sequence of Sighting
        One per place of the ball, with the highlights of the same lights in the same order.

    Returns
    -------
    LightsFound

    Raises
    ------
    GeometryError
        If there is no sighting, or they show different numbers of lights.

    Notes
    -----
    One sighting determines directions. Several ones of a perspective camera also determine positions: the best
    intersections of the rays from the balls, by least squares weighted by each ray's precision at that distance. If
    lights are so distant that the rays are nearly parallel, only directions are returned, with a log message.
    """
    if not sightings:
        raise GeometryError("there is no photo of a mirror ball; give at least one")
    counts = {len(sighting.highlights) for sighting in sightings}
    if len(counts) != 1:
        raise GeometryError("the ball's places show different numbers of lights; give as many photos for each")
    origins, rays = (np.stack(parts) for parts in zip(*(sighting.rays() for sighting in sightings), strict=True))
    blur = np.stack([sighting.uncertainties() for sighting in sightings])
    target = np.mean([sighting.ball.centre for sighting in sightings], axis=0)
    _warn_of_doubts(sightings)
    precision = 1 / blur**2
    mean = normalised(np.einsum("pni,pn->ni", rays, precision))
    # The effect of the lens is the same at all places, so averaging does not reduce it.
    by_lens = np.mean([sighting.by_lens() for sighting in sightings], axis=0)
    unsure = np.hypot(1 / np.sqrt(precision.sum(axis=0)), by_lens)
    found = LightsFound(tuple(sightings), mean, unsure, target)
    if len(sightings) == 1:
        return found
    if sightings[0].ball.camera.projection == "orthographic":
        log.info("positions need the camera's focal length, which is unknown; only directions were found")
        return _with_spread(found, rays)
    return _with_positions(found, origins, rays, np.radians(blur))


def _with_positions(found: LightsFound, origins: F64, rays: F64, spreads: F64) -> LightsFound:
    """Add positions where the rays (P, N, 3) of P places meet; directions only if any light is too far away.

    spreads: (P, N) standard deviations of the rays' directions, in radians.
    """
    meetings = [meeting_point(origins[:, k], rays[:, k], spreads[:, k]) for k in range(rays.shape[1])]
    points, errors, gaps = (np.array(values) for values in zip(*meetings, strict=True))
    away = points - found.target
    distance = np.linalg.norm(away, axis=1)
    ahead = np.einsum("pni,pni->n", points - origins, rays) > 0
    unsure_lights = ~ahead | (errors > UNSURE * distance)
    if unsure_lights.any():
        names = ", ".join(str(k + 1) for k in np.flatnonzero(unsure_lights))
        log.info("light %s is far away: its rays are nearly parallel, so only directions were found", names)
        return _with_spread(found, rays)
    for k in np.flatnonzero(gaps > MISSED * errors):
        words = "light %d: the rays to it miss each other by %.3g, more than they should; did camera or light move "
        words += "between the photos, is the focal length right, and are the balls of one size?"
        log.warning(words, k + 1, gaps[k])
    turn = np.degrees(errors / distance)
    return LightsFound(found.sightings, normalised(away), turn, found.target, points, errors, gaps)


def meeting_point(origins: ArrayLike, directions: ArrayLike, spreads: ArrayLike) -> tuple[F64, float, float]:
    """Best intersection of rays: the point, its standard deviation, and its RMS distance from the rays.

    origins, directions: (P, 3). spreads: (P,) standard deviations of the directions, in radians.
    """
    origins, directions = np.asarray(origins, np.float64), np.asarray(directions, np.float64)
    spreads = np.asarray(spreads, np.float64)
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    weight = 1 / spreads**2
    for _ in range(ROUNDS):
        normal = np.einsum("pij,p->ij", across, weight)
        # Parallel rays do not intersect: use the minimum-norm solution, whose error is large.
        point = np.linalg.lstsq(normal, np.einsum("pij,pj,p->i", across, origins, weight), rcond=None)[0]
        reach = np.maximum(np.linalg.norm(point - origins, axis=1), 1e-9)
        weight = 1 / (spreads * reach) ** 2
    values = np.linalg.eigvalsh(np.einsum("pij,p->ij", across, weight))
    error = float(np.sqrt((1 / np.maximum(values, 1e-18)).sum()))
    missed = np.einsum("pij,pj->pi", across, point - origins)
    return point, error, float(np.sqrt((missed**2).sum(axis=1).mean()))


def _with_spread(found: LightsFound, rays: F64) -> LightsFound:
    """Report a distant light whose direction differs between places: it is near, or something moved."""
    deviations = angular_error(rays, np.broadcast_to(found.directions, rays.shape)).max(axis=0)
    worst = int(deviations.argmax())
    if deviations[worst] > MISSED * found.uncertainties[worst]:
        log.info("light %d: its directions from the places differ by up to %.2g°", worst + 1, 2 * deviations[worst])
    return found


def _warn_of_doubts(sightings: Sequence[Sighting]) -> None:
    for sighting in sightings:
        ball = sighting.ball
        if ball.residual > 0.004 * ball.circle.radius or ball.seen < 0.5:
            words = "the ball's outline was seen to %.0f%% and fits to %.2g pixels: look at the overlay, and give the "
            log.warning(words + "circle by hand (x,y,r) if it is not the ball's", 100 * ball.seen, ball.residual)
        for number, spot in enumerate(sighting.highlights, 1):
            if spot.radius > BROAD * ball.circle.radius:
                words = (
                    "light %d: its highlight is %.0f%% as wide as the ball, as on a matt one: is it the mirror ball, "
                )
                words += "and exposed so briefly that highlights are not burnt out?"
                log.warning(words, number, 100 * spot.radius / ball.circle.radius)
            if spot.rival > RIVAL:
                words = "light %d: another spot on the ball has %.0f%% as much light: a window? Look at the overlay"
                log.warning(words, number, 100 * spot.rival)
    by_lens = max(float(sighting.by_lens().max()) for sighting in sightings)
    if by_lens:
        words = "the camera is assumed far away; give its lens (--focal, --camera): one of %g mm would make these "
        log.warning(words + "directions wrong by up to %.1f°, which their uncertainty includes", USUAL_LENS, by_lens)
