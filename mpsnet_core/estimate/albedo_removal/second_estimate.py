"""An estimate, and another one of the photo with its surface's albedo evened out by the first."""

import numpy as np

from mpsnet_core.arrays.row_bands import bands, on_all_cores
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.capture.capture import Capture
from mpsnet_core.estimate.albedo_removal.chromaticity import without_chromaticity_albedo
from mpsnet_core.estimate.albedo_removal.clusters import without_clustered_albedo
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.progress import Progress, part
from mpsnet_core.scene.normal_map import NormalMap

# How the expected errors of two estimates decide which counts: this power of their ratio, and by how much more the
# second one's counts, as its photo is a guess.
POWER, CAUTION = 8, 1.05
LEAST_ERROR = 0.003  # as a share of a right angle


def estimate_without_albedo(network: OnnxModel, photo: Capture, painted: Capture, progress: Progress) -> NormalMap:
    """Normals by a network that expects its error, in camera space.

    Parameters
    ----------
    network : OnnxModel
    photo : Capture
        As given.
    painted : Capture
        The same, painted grey where it has a white photo.
    progress : callable
        Receives the share that is done, 0 to 1, and what is being done.

    Notes
    -----
    With a white photo, the second estimate is the answer, and one pass is enough for the first. Without one, a quick
    second estimate finds the colours better than the first, and after the third each pixel takes the estimate of which
    the network is surer, the first or the last. A surface of one colour needs no further ones.
    """
    if painted.white is not None:
        first = network(painted, _look("first estimate", progress, 0.0, 0.25), passes=1)
        even = without_chromaticity_albedo(photo, painted, first)
        del first  # a large photo takes much memory
        return network(even, _look("second estimate", progress, 0.25, 1.0))
    first = network(painted, _look("first estimate", progress, 0.0, 0.4))
    evened = without_clustered_albedo(painted, first)
    if evened is None:
        return first
    better = combined(first, network(evened, _look("second estimate", progress, 0.4, 0.6), passes=1))
    del evened
    evened = without_clustered_albedo(painted, better)
    if evened is None:
        return better
    del better
    return combined(first, network(evened, _look("third estimate", progress, 0.6, 1.0)))


def _look(name: str, progress: Progress, start: float, end: float) -> Progress:
    """Progress of a run of the network, whose messages begin with its name."""
    return part(lambda fraction, message: progress(fraction, f"{name}, {message}"), start, end)


def combined(first: NormalMap, second: NormalMap) -> NormalMap:
    """Both, weighed by their confidence; written into the second."""

    def weigh(rows: slice) -> None:
        one, two = (
            np.maximum(1 - estimate.confidence[rows].astype(np.float32), LEAST_ERROR) for estimate in (first, second)
        )
        share = 1 / (1 + (one / (CAUTION * two)) ** POWER)  # of the first
        vectors = second.vectors[rows] + (first.vectors[rows] - second.vectors[rows]) * share[..., None]
        second.vectors[rows] = np.where(second.mask[rows, :, None], normalised(vectors), 0)
        second.confidence[rows] += (first.confidence[rows] - second.confidence[rows]) * share

    on_all_cores(weigh, bands(len(first.mask)))
    return second
