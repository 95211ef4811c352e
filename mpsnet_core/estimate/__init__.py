"""From a capture to a normal map: the Lambertian baseline and the networks, one call for all."""

import logging
import os
from typing import TYPE_CHECKING, Any, Literal

from mpsnet_core.estimate.registry import DEFAULT_MODEL, LAMBERTIAN, LAMBERTIAN_GREY_WORLD, find_network
from mpsnet_core.progress import Progress, silent

if TYPE_CHECKING:  # Blender imports the shelf beside this file, and shall not wait for OpenImageIO
    from mpsnet_core.capture.capture import Capture
    from mpsnet_core.scene.normal_map import NormalMap

log = logging.getLogger(__name__)

__all__ = ["Estimator", "estimate_normals"]


class Estimator:
    """A model made ready once, for any number of captures.

    model: a name of `mpsnet models` or the path of an ONNX file.
    passes: 1, or 3 to average the answers on the scene turned and mirrored; None for what the shelf says of stills,
        else the network's card. The baselines take none.
    options: provider ("cpu", "cuda", "directml", "coreml"), threads and tile for ONNX models, see
        :class:`mpsnet_core.estimate.onnx_model.OnnxModel`; the baselines take none.

    Raises InputError where there is no such model or its file is not one of ours.
    """

    def __init__(
        self, model: str | os.PathLike[str] = DEFAULT_MODEL, *, passes: Literal[1, 3] | None = None, **options: Any
    ) -> None:
        self.name = os.fspath(model)
        self._network = None
        if self.name not in (LAMBERTIAN, LAMBERTIAN_GREY_WORLD):
            from mpsnet_core.estimate.onnx_model import OnnxModel  # onnxruntime takes a while to load

            network = find_network(self.name)
            self._network = OnnxModel(network.path, passes=passes or network.passes, **options)
        elif options.get("provider", "cpu") != "cpu":
            log.info("%s is no network and runs without provider %s", self.name, options["provider"])

    def __call__(self, capture: "Capture", progress: Progress = silent) -> "NormalMap":
        """Normals of `capture`, in camera space. Raises Cancelled where `progress` does."""
        if self._network is not None:
            return self._network(capture, progress)
        from mpsnet_core.estimate.lambertian import lambertian_normals

        progress(0.0, "solving equation 2")
        normals = lambertian_normals(capture, grey_world=self.name == LAMBERTIAN_GREY_WORLD)
        progress(1.0, "normals estimated")
        return normals


def estimate_normals(
    capture: "Capture",
    model: str | os.PathLike[str] = DEFAULT_MODEL,
    *,
    progress: Progress = silent,
    **options: Any,
) -> "NormalMap":
    """Estimate the surface normal of every pixel inside the capture's mask.

    Model and options as in :class:`Estimator`, which is the one to keep when there are many captures.
    """
    return Estimator(model, **options)(capture, progress)
