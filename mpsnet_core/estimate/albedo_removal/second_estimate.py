"""Estimate normals, then again from the photo with the albedo that the first estimate reveals divided out."""

import numpy as np

from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.albedo_removal.chromaticity import divide_out_chromaticity_albedo
from mpsnet_core.estimate.albedo_removal.clusters import divide_out_clustered_albedo
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.progress import Progress, part
from mpsnet_core.scene.normal_map import NormalMap

# Weights of two estimates are this power of the ratio of their expected errors, where the second's error is increased
# by this factor because its photo is a guess.
POWER, CAUTION = 8, 1.05
MIN_ERROR = 0.003  # as a share of a right angle


def estimate_with_albedo_removed(network: OnnxModel, photo: Capture, grey: Capture, progress: Progress) -> NormalMap:
    """Normals by a network that predicts its error, in camera space.

    Parameters
    ----------
    network : OnnxModel
    photo : Capture
        The capture as given.
    grey : Capture
        The same, normalised by its white photo if it has one.
    progress : callable
        Called with the share done, 0 to 1, and a message.

    Notes
    -----
    With a white photo, the result is the second estimate, and one pass is enough for the first. Without one, a second
    estimate of one pass finds the colours more accurately than the first. The result blends the first and the third
    estimate by confidence. A surface of one colour needs only one estimate.
    """
    if grey.white is not None:
        first = network(grey, _run_progress("first estimate", progress, 0.0, 0.25), passes=1)
        flattened = divide_out_chromaticity_albedo(photo, grey, first)
        del first  # a large photo takes much memory
        return network(flattened, _run_progress("second estimate", progress, 0.25, 1.0))
    first = network(grey, _run_progress("first estimate", progress, 0.0, 0.4))
    one_colour = divide_out_clustered_albedo(grey, first)
    if one_colour is None:
        return first
    second = network(one_colour, _run_progress("second estimate", progress, 0.4, 0.6), passes=1, rough=True)
    better = blend_by_confidence(first, second)
    del one_colour, second
    one_colour = divide_out_clustered_albedo(grey, better)
    if one_colour is None:
        return better
    del better
    return blend_by_confidence(first, network(one_colour, _run_progress("third estimate", progress, 0.6, 1.0)))


def _run_progress(name: str, progress: Progress, start: float, end: float) -> Progress:
    """Progress of one run of the network, which prefixes messages with the run's name."""
    return part(lambda fraction, message: progress(fraction, f"{name}: {message}"), start, end)


def blend_by_confidence(first: NormalMap, second: NormalMap) -> NormalMap:
    """Mean of both, weighted by confidence; overwrites the second."""

    def weigh(rows: slice) -> None:
        sure = (estimate.confidence[rows].astype(np.float32) for estimate in (first, second))
        one, two = (np.maximum(1 - confidence, MIN_ERROR) for confidence in sure)
        share = 1 / (1 + (one / (CAUTION * two)) ** POWER)  # of the first
        vectors = second.vectors[rows] + (first.vectors[rows] - second.vectors[rows]) * share[..., None]
        second.vectors[rows] = np.where(second.mask[rows, :, None], normalised(vectors), 0)
        second.confidence[rows] += (first.confidence[rows] - second.confidence[rows]) * share

    on_all_cores(weigh, bands(len(first.mask)))
    return second
