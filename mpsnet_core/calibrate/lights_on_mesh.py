"""Lights fitted to a photo of an object whose normals are known: its mesh is the calibration target.

A pixel's channels are sums over the lights of mixing x max(normal · light, 0) x visibility, plus ambient light. The
brightness of the albedo may vary from pixel to pixel, and the object may have several paints: each has a mixing of its
own. The fit is robust: residuals of the channels' logarithms have a multivariate t-distribution, whose covariance is
estimated, too; it finds out how much the brightness varies, which is common to the three channels.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.resampling import block_means
from mpsnet_core.arrays.types import F64, Bools, Floats, Indices
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.image import Image
from mpsnet_core.scene.camera import Camera, camera_for
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.rays import RayScene, mesh_hits

# Maps light directions (3, 3) to (P, 3) which lights reach each point, shadows of the mesh included.
Reached = Callable[[F64], Bools]

# The photo is reduced to about this many blocks on the object's longer side, and at most MOST are used.
BLOCKS, MOST = 200, 6000
SUBPIXELS = np.array([(-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)])  # of a block, from its middle
SMOOTH = 0.95  # least length of a block's mean normal
LEAST_FACING = 0.15  # least z of a normal: steeper ones are seen at a grazing angle
FEWEST, COVERED = 100, 0.3  # blocks, and share of those of the mask
OFFSET = 2e-3  # of the shadow rays' origins from the surface, as a share of the mesh's size
# Added to brightness as a share of the channel's 98th percentile, so that the logarithm of shadows stays finite.
FLOOR = 0.03
ROUNDS = 30  # of Gauss-Newton
FREEDOM = 2.0  # degrees of the t-distribution
# Prior standard deviations: crosstalk and ambient light as shares of a channel's own light, and steps of a light.
CROSSTALK, NONE, AMBIENT = 0.15, 1e-3, 0.05
LONGEST_STEP, SETTLED = 0.15, 2e-4  # radians
# A second paint must make the residuals' scale smaller by this factor, and cover this share of the pixels.
PAINT_GAIN, PAINT_SHARE = 0.8, 0.05
MAX_PAINTS = 3
# Neighbouring pixels err alike: this many count as one.
CORRELATED = 30.0


@dataclass(frozen=True, eq=False)
class LightsOnMesh:
    """Lights that were fitted to a photo of a known mesh."""

    directions: F64
    """(3, 3) unit vectors from the object to the lights, one per row."""
    mixing: F64
    """(3, 3) mixing matrix of the most frequent paint, its diagonal 1."""
    errors: F64
    """(3,) standard deviations of the directions, in degrees."""
    residual: float
    """Median relative difference between photo and fit."""
    paints: int
    """Number of paints that were told apart."""


def fit_lights(colours: Floats, normals: Floats, reached: Reached, *, mixed: bool = True) -> LightsOnMesh:
    """Fit three distant lights and the mixing of their colours.

    Parameters
    ----------
    colours : (P, 3) array
        Linear pixels.
    normals : (P, 3) array
        Their unit normals, in the space of the result.
    reached : callable
        Which lights of given directions reach the pixels' surface points; those facing away count as reached.
    mixed : bool
        Whether channels may show lights other than their own, and paints differ in hue; not so in photos of one white
        light each.
    """
    scale = np.maximum(np.percentile(colours, 98, axis=0), 1e-12)
    fit = _Fit(np.asarray(colours / scale, np.float64), np.asarray(normals, np.float64), reached)
    fit.crosstalk = CROSSTALK if mixed else NONE
    fit.start()
    fit.run()
    for _ in range(MAX_PAINTS - 1 if mixed else 0):
        split = fit.split()
        if split is None:
            break
        fit = split
    return fit.result()


def lights_of_photo(image: Image, mask: Bools, camera: Camera, mesh: Mesh, *, mixed: bool = True) -> LightsOnMesh:
    """The lights of a photo of a mesh. mask: (H, W) the object. camera: of the photo, possibly of another size.

    mixed: as in :func:`fit_lights`.

    Raises GeometryError if the camera and the photo differ in aspect ratio, or the mesh covers too little of the mask.
    """
    height, width = mask.shape
    fitted = camera_for(camera, width, height)
    assert isinstance(fitted, Camera)
    scene, box = RayScene.of(mesh), bounding_box(mask)
    # A mesh shows no more than that: means over blocks of the photo, and of the mesh's normals at four points of each.
    size = -(-max(mask[box].shape) // BLOCKS)
    good = mask & ~image.saturated.any(axis=-1)
    means = block_means(np.concatenate([np.where(good[..., None], image.pixels, 0), good[..., None]], axis=-1), size)
    rows, columns = np.nonzero(means[..., 3] > 0.99)
    middles = (np.stack([columns, rows], axis=-1) + 0.5) * size
    normals, points = np.zeros((len(rows), 3)), np.full((len(rows), 3), np.nan)
    for shift in SUBPIXELS:
        seen = mesh_hits(mesh, fitted, scene, middles + shift * size)
        normals[seen.hit] += seen.in_camera(seen.at(mesh.corner_normals)) * seen.from_front[:, None]
        points[seen.hit] = seen.points
    normals /= len(SUBPIXELS)
    # Shorter means have creases or outlines in them.
    sure = np.flatnonzero((np.linalg.norm(normals, axis=1) > SMOOTH) & (normals[:, 2] > LEAST_FACING))
    if len(sure) < max(FEWEST, COVERED * len(rows)):
        raise GeometryError("the camera sees the mesh in too little of the mask; check camera, mesh and mask")
    sure = sure[:: -(-len(sure) // MOST)]
    normals, points = normalised(normals[sure]), points[sure]
    starts = (points + OFFSET * scene.size * normals @ fitted.rotation.T).astype(np.float32)
    far = np.full(len(sure), 2 * scene.size, np.float32)

    def reached(lights: F64) -> Bools:
        towards = (lights @ fitted.rotation.T).astype(np.float32)
        rays = [np.ascontiguousarray(np.broadcast_to(light, starts.shape)) for light in towards]
        return ~np.stack([scene.occluded_within(starts, ray, far) for ray in rays], axis=1)

    return fit_lights(means[rows[sure], columns[sure], :3], normals, reached, mixed=mixed)


class _Fit:
    """The present state of a fit. colours: (P, 3) with the 98th percentile of each channel at 1."""

    def __init__(self, colours: F64, normals: F64, reached: Reached) -> None:
        self.colours, self.normals, self.reached = colours, normals, reached
        self.logs = np.log(np.maximum(colours, 0) + FLOOR)
        self.paint = np.zeros(len(colours), np.intp)  # (P,) number of each pixel's paint
        self.lights = np.eye(3)
        self.mixings = np.zeros((1, 3, 4))  # of each paint: channels x lights and ambient light
        self.covariance = np.full((3, 3), 0.05) + 0.05 * np.eye(3)
        self.scale = np.inf
        self.crosstalk = CROSSTALK  # prior standard deviation
        self.information = np.eye(6)

    def start(self) -> None:
        """Each channel alone: trimmed least squares on what is bright."""
        for channel in range(3):
            values = self.colours[:, channel]
            lit = values > 0.08
            for _ in range(6):
                found = np.linalg.lstsq(self.normals[lit], values[lit], rcond=None)[0]
                residual = np.abs(self.normals @ found - values)
                bright = values > 0.08
                lit = bright & (residual <= np.quantile(residual[bright], 0.7))
            length = float(np.linalg.norm(found))
            self.lights[channel] = found / max(length, 1e-12)
            self.mixings[0, channel, channel] = max(length, 0.1)
        self.mixings[0, :, 3] = 0.01

    def shading(self) -> F64:
        """(P, 4) brightness by each light at unit strength, and by ambient light."""
        lit = np.maximum(self.normals @ self.lights.T, 0) * self.reached(self.lights)
        return np.concatenate([lit, np.ones((len(lit), 1))], axis=1)

    def residuals(self, shading: F64) -> F64:
        """(paints, P, 3) differences of the logarithms, by the mixing of each paint."""
        fitted = np.einsum("pj,qkj->qpk", shading, self.mixings)
        return np.asarray(self.logs - np.log(np.maximum(fitted, 0) + FLOOR))

    def run(self, rounds: int = ROUNDS) -> None:
        every = np.arange(len(self.logs))
        for _ in range(rounds):
            before = self.lights.copy()
            shading = self.shading()
            residuals = self.residuals(shading)
            precision = np.linalg.inv(self.covariance)
            distances = np.einsum("qpi,ij,qpj->qp", residuals, precision, residuals)
            if len(self.mixings) > 1:
                self.paint = distances.argmin(axis=0)
            error, distance = residuals[self.paint, every], distances[self.paint, every]
            weight = (FREEDOM + 3) / (FREEDOM + distance)
            self.covariance = np.einsum("p,pi,pj->ij", weight, error, error) / len(error) + 1e-5 * np.eye(3)
            self.scale = float(np.linalg.det(self.covariance) ** (1 / 6))
            self._step(shading, error, weight)
            if np.abs(self.lights - before).max() < SETTLED:
                break

    def _step(self, shading: F64, error: F64, weight: F64) -> None:
        """A step of Gauss-Newton. Unknowns: two angles of each light, then each paint's mixing."""
        mixing = self.mixings[self.paint]
        slope = 1 / (np.einsum("pj,pkj->pk", shading, mixing) + FLOOR)
        tangents = np.array([np.linalg.svd(light[None])[2][1:] for light in self.lights])
        # How the shading by each light changes with its angles.
        turned = np.einsum("pi,jai->pja", self.normals, tangents) * (shading[:, :3, None] > 0)
        jacobian = np.zeros((len(error), 3, 6 + 12 * len(self.mixings)))
        jacobian[:, :, :6] = np.einsum("pk,pkj,pja->pkja", slope, mixing[..., :3], turned).reshape(len(error), 3, 6)
        for number in range(len(self.mixings)):
            of_paint = np.where((self.paint == number)[:, None], slope, 0)
            for channel in range(3):
                first = 6 + 12 * number + 4 * channel
                jacobian[:, channel, first : first + 4] = of_paint[:, channel, None] * shading
        precision = np.linalg.inv(self.covariance)
        weighted = np.einsum("p,ij,pja->pia", weight, precision, jacobian)
        matrix = np.einsum("pia,pib->ab", weighted, jacobian)
        right = np.einsum("pia,pi->a", weighted, error)
        matrix, right = matrix / CORRELATED, right / CORRELATED
        own = np.einsum("qkk->qk", self.mixings[..., :3])
        widths = np.where(np.eye(3, 4, dtype=bool), np.inf, np.array([self.crosstalk] * 3 + [AMBIENT])) * own[..., None]
        prior = np.zeros(len(right))
        prior[6:] = 1 / widths.ravel() ** 2
        right[6:] -= prior[6:] * self.mixings.ravel()
        matrix += np.diag(prior) + 1e-6 * np.diag(np.diag(matrix)) + 1e-9 * np.eye(len(right))
        step = np.linalg.solve(matrix, right)
        for light in range(3):
            turn = step[2 * light : 2 * light + 2]
            turn = turn * min(1.0, LONGEST_STEP / max(float(np.linalg.norm(turn)), 1e-12))
            self.lights[light] = normalised(self.lights[light] + turn @ tangents[light])
        changed = np.maximum(self.mixings + step[6:].reshape(self.mixings.shape), 0)
        for channel in range(3):
            changed[:, channel, channel] = np.maximum(changed[:, channel, channel], own[:, channel] / 2)
        self.mixings = changed
        self.information = matrix

    def _by_paint(self, values: F64) -> list[F64]:
        return [values[self.paint == paint] for paint in range(len(self.mixings))]

    def split(self) -> "_Fit | None":
        """The fit with one more paint; None if that does not explain the photo better."""
        residuals = self.residuals(self.shading())[self.paint, np.arange(len(self.paint))]
        spread = [np.abs(one - np.median(one, axis=0)).sum() for one in self._by_paint(residuals)]
        worst = int(np.argmax(spread))
        inside = np.flatnonzero(self.paint == worst)
        groups = _two_groups(residuals[inside])
        other = _Fit(self.colours, self.normals, self.reached)
        other.lights, other.covariance = self.lights.copy(), self.covariance.copy()
        factors = np.exp([np.median(residuals[inside][groups == side], axis=0) for side in (0, 1)])
        both = self.mixings[worst] * factors[..., None]
        other.mixings = np.concatenate([np.delete(self.mixings, worst, axis=0), both])
        other.run()
        shares = np.bincount(other.paint, minlength=len(other.mixings)) / len(other.paint)
        return other if other.scale < PAINT_GAIN * self.scale and shares.min() > PAINT_SHARE else None

    def result(self) -> LightsOnMesh:
        own = self.mixings[np.bincount(self.paint, minlength=len(self.mixings)).argmax(), :, :3]
        inverse = np.linalg.inv(self.information)[:6, :6]
        spread = np.sqrt(np.maximum(np.diag(inverse), 0).reshape(3, 2).sum(axis=1))
        residuals = self.residuals(self.shading())[self.paint, np.arange(len(self.paint))]
        mixing, residual = own / np.diag(own)[:, None], float(np.median(np.abs(residuals)))
        return LightsOnMesh(self.lights, mixing, np.degrees(spread), residual, len(self.mixings))


def _two_groups(values: F64) -> Indices:
    """(N,) 0 or 1: values (N, 3) in two groups about two medians."""
    axis = np.linalg.svd(values - np.median(values, axis=0), full_matrices=False)[2][0]
    group = (values @ axis > np.median(values @ axis)).astype(np.intp)
    for _ in range(20):
        middles = np.array([np.median(values[group == side], axis=0) for side in (0, 1)])
        group = np.abs(values[:, None] - middles).sum(axis=2).argmin(axis=1)
        if group.min() == group.max():
            break
    return np.asarray(group)
