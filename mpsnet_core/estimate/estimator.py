"""Normals of a capture, by the Lambertian baselines or a network: one interface for all models."""

import logging
import os
from dataclasses import replace
from typing import Literal

import numpy as np

from mpsnet_core.arrays.resampling import grid_step
from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools, Indices
from mpsnet_core.capture.capture import Capture
from mpsnet_core.errors import SettingsError
from mpsnet_core.estimate.albedo_removal import divide_out_grain, estimate_with_albedo_removed
from mpsnet_core.estimate.distant_lights import convert_to_distant_lights
from mpsnet_core.estimate.features import divide_by_means
from mpsnet_core.estimate.registry import BASELINES, DEFAULT_MODEL, DEFAULT_TILE, LAMBERTIAN_GREY_WORLD, find_network
from mpsnet_core.estimate.uniform_albedo import refine_normals
from mpsnet_core.estimate.white_photo import normalise_by_white_photo
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.normal_map import NormalMap

# --- remove fireflies: single pixels of a path-traced render that are hundreds of times too bright --------------------
# A network sees the photo divided by its mean, and its coarse scales are means of blocks. One firefly among 1,000
# pixels can be as bright as all the others together. A highlight is not a firefly, however bright: the pixels around it
# are bright, too.


# A firefly is brighter than its neighbours, and than the object's bright pixels, by more than this factor.
TIMES = 4.0
# The channel's percentile that counts as bright; no renderer leaves more fireflies than lie above it.
BRIGHT = 90
# The neighbour to compare with is the third brightest of eight: two may be fireflies themselves.
RANK = 3
SAMPLED = 100_000  # pixels of a large photo
AROUND = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]


def remove_fireflies(capture: Capture) -> Capture:
    """Replace each firefly by its third brightest neighbour, channel by channel.

    A capture without fireflies, or from a sensor, is returned unchanged: a sensor clips.
    """
    if np.isfinite(capture.clip) or capture.clipped is not None:
        return capture
    image, mask = capture.image, capture.mask
    step = grid_step(np.count_nonzero(mask), SAMPLED)
    some = image[::step, ::step][mask[::step, ::step]]
    if not len(some):
        return capture
    bright = np.percentile(some.astype(np.float32), BRIGHT, axis=0)
    least = TIMES * np.where(bright > 0, bright, np.inf)  # skip a light that reaches few pixels
    for band in bands(len(image)):
        rows, columns, channels = np.nonzero((image[band] > least) & mask[band, :, None])
        rows += band.start
        around = []
        for down, right in AROUND:
            y, x = _mirrored_indices(rows + down, image.shape[0]), _mirrored_indices(columns + right, image.shape[1])
            around.append(capture.image[y, x, channels])
        usual = np.sort(around, axis=0)[-RANK]
        found = image[rows, columns, channels] > TIMES * usual
        if found.any():
            image = image.copy() if image is capture.image else image
            image[rows[found], columns[found], channels[found]] = usual[found]
    return capture if image is capture.image else replace(capture, image=image)


def _mirrored_indices(places: Indices, length: int) -> Indices:
    """Indices along a side, mirrored at its ends."""
    return np.asarray(length - 1 - np.abs(length - 1 - np.abs(places)))


log = logging.getLogger(__name__)

# A light does not reach a pixel that is darker than this share of its channel's 99th percentile inside the mask.
SHADOW_SHARE = 0.02


class Estimator:
    """A model, loaded once for any number of captures.

    Parameters
    ----------
    model : str or path
        A name that `mpsnet models` lists, or the path of an ONNX file.
    passes : {1, 3}, optional
        3 averages the network's outputs on the scene rotated and mirrored. A pyramid then also makes a second estimate
        of a surface of many colours. By default the registry's number for stills, else the one on the model's card.
    provider : {"cpu", "cuda", "directml", "coreml"}
        The onnxruntime execution provider.
    threads : int
        CPU threads of the network, 0 for all.
    tile : int
        Side of a dense network's tiles in pixels; memory grows with its square.

    Raises
    ------
    InputError
        If there is no such model, its file is no MPS-Net model, or an option is out of range.

    Notes
    -----
    The baselines ignore all options.
    """

    def __init__(
        self,
        model: AnyPath = DEFAULT_MODEL,
        *,
        passes: Literal[1, 3] | None = None,
        provider: str = "cpu",
        threads: int = 0,
        tile: int = DEFAULT_TILE,
    ) -> None:
        self.name = os.fspath(model)
        self._network = None
        if passes not in (None, 1, 3) or isinstance(passes, bool):
            raise SettingsError(f"an estimate takes 1 pass or 3, not {passes!r}")
        if self.name not in BASELINES:
            from mpsnet_core.estimate.onnx_model import OnnxModel  # onnxruntime takes a while to load

            network = find_network(self.name)
            count = int(passes) if passes else network.passes
            self._network = OnnxModel(network.path, provider=provider, threads=threads, tile=tile, passes=count)
        else:
            unused = [f"provider {provider}"] * (provider != "cpu") + [f"{passes} passes"] * ((passes or 1) > 1)
            if unused:
                log.info("%s is not a network and runs without %s", self.name, " and ".join(unused))

    def __call__(self, capture: Capture, progress: Progress = silent) -> NormalMap:
        """Estimate the normals of `capture`, in camera space. Raises Cancelled if `progress` does."""
        photo = remove_fireflies(capture)
        capture = normalise_by_white_photo(photo)
        if photo.white is not None and capture.white is None:
            log.warning(
                "the white photo is NOT USED: a channel of it is black, or it is clipped nearly everywhere; "
                "take it again [white-photo-unused]"
            )
        if self._network is None:
            normals = lambertian_normals(capture, grey_world=self.name == LAMBERTIAN_GREY_WORLD)
        elif self._network.card.kind == "pyramid":  # other networks, such as the paper's, predict no error
            seen = part(progress, 0.0, 0.8)
            capture = divide_out_grain(capture)
            if self._network.card.passes > 1:
                normals = estimate_with_albedo_removed(self._network, photo, capture, seen)
            else:
                normals = self._network(capture, seen)
            normals = refine_normals(capture, normals, part(progress, 0.8, 1.0))
        else:
            normals = self._network(capture, progress)
        progress(1.0, "normals estimated")
        return normals


@takes_files
def estimate_normals(
    capture: Capture,
    model: AnyPath = DEFAULT_MODEL,
    *,
    passes: Literal[1, 3] | None = None,
    provider: str = "cpu",
    threads: int = 0,
    tile: int = DEFAULT_TILE,
    progress: Progress = silent,
) -> NormalMap:
    """Estimate the surface normal of every pixel inside the capture's mask.

    Parameters
    ----------
    capture : Capture
        The photo with its mask, lights and camera.
    model, passes, provider, threads, tile
        As in :class:`Estimator`. For many captures, keep an `Estimator` instead: it loads the model once.
    progress : callable
        Called with the share done, 0 to 1, and a message.

    Returns
    -------
    NormalMap
        In camera space: x right, y up, z towards the camera.

    Raises
    ------
    InputError
        As in :class:`Estimator`.
    Cancelled
        If `progress` raises it.

    Examples
    --------
    A matt plane facing the camera, by equation 2:

    >>> import numpy as np
    >>> from mpsnet_core import Capture, estimate_normals, published_rig
    >>> rig = published_rig()
    >>> image = np.broadcast_to(rig.directions @ [0.0, 0.0, 1.0], (2, 2, 3))
    >>> normals = estimate_normals(Capture(image, np.ones((2, 2), bool), rig), "lambertian")
    >>> np.allclose(normals.vectors, [0.0, 0.0, 1.0], atol=1e-6)
    True
    """
    estimator = Estimator(model, passes=passes, provider=provider, threads=threads, tile=tile)
    return estimator(capture, progress)


def usable_channels(capture: Capture) -> Bools:
    """(H, W, 3) whether a light reaches the pixel and its channel is not saturated."""
    everywhere, usable = bands(len(capture.mask)), np.empty(capture.image.shape, bool)

    def light(rows: slice) -> F32:
        return capture.rig.unmixed(capture.image[rows])

    bright = []
    for channel in range(3):
        values = np.concatenate([light(rows)[..., channel][capture.mask[rows]] for rows in everywhere])
        bright.append(np.percentile(values, 99, overwrite_input=True))
    least = SHADOW_SHARE * np.array(bright)
    for rows in everywhere:
        usable[rows] = (light(rows) > least) & ~capture.saturated_lights_in(rows)
    return usable


def lambertian_normals(capture: Capture, grey_world: bool = False) -> NormalMap:
    """Normals by equation 2, with or without grey-world. Confidence is the share of usable channels (0, ⅓, ⅔, 1).

    Near lights have their own directions and strengths at each pixel. Perspective needs no correction: the radiance of
    a matt surface does not depend on the viewing direction.
    """
    confidence = usable_channels(capture).mean(axis=-1, dtype=np.float32)
    if capture.rig.near is not None:
        capture = convert_to_distant_lights(capture)
    mask, rig = capture.mask, capture.rig
    inverse = np.linalg.inv(rig.directions).T.astype(np.float32)
    everywhere, means = bands(len(mask)), np.ones(3)
    if grey_world:
        sums = [rig.unmixed(capture.image[rows])[mask[rows]].sum(axis=0, dtype=np.float64) for rows in everywhere]
        means = np.sum(sums, axis=0) / np.count_nonzero(mask)
    solution = np.empty((*mask.shape, 3), np.float32)
    for rows in everywhere:
        light = rig.unmixed(capture.image[rows])
        solution[rows] = (divide_by_means(light, means) if grey_world else light) @ inverse
    return NormalMap(solution, mask, confidence, in_place=True)
