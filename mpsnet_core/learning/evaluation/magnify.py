"""Magnified photographs: a model's error on images with more pixels than detail."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.capture.capture import Capture
from mpsnet_core.errors import SettingsError
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.normal_map import NormalMap

MAX_SIDE = 8192  # pixels of a magnified object
MARGIN = 2  # pixels around the mask to magnify with it


def magnified_name(name: str, times: int) -> str:
    """`name`, of a model or a photo, with the magnification if there is one."""
    return name if times == 1 else f"{name} ×{times}"


def estimate_magnified(
    estimator: Callable[[Capture, Progress], NormalMap], capture: Capture, times: int, progress: Progress = silent
) -> NormalMap:
    """Normals at the capture's own pixels (H, W), estimated from the photograph magnified by an integer factor.

    Magnification is bilinear, and every `times`-th pixel is an unchanged pixel of the photograph. Only those are
    scored: the same pixels are compared with the same true normals at any magnification, and the result of equation 2
    does not change. Magnified true normals would be interpolated across depth discontinuities.

    Only the mask's bounding box is magnified. Lights are distant, and the camera is dropped.

    Raises SettingsError if a side would have more than :data:`MAX_SIDE` pixels.
    """
    if times == 1:
        return estimator(capture, progress)
    box = bounding_box(capture.mask, MARGIN)
    rows, columns = capture.mask[box].shape
    if times * max(rows, columns) > MAX_SIDE:
        raise SettingsError(
            f"the object's {columns} x {rows} pixels cannot be magnified {times} times: that is more than {MAX_SIDE} "
            "a side; magnify less"
        )
    large = Capture(
        _magnified(capture.image[box], times),
        _magnified(capture.mask[box], times) > 0.5,
        capture.rig,
        clip=capture.clip,
        clipped=None if capture.clipped is None else _magnified(capture.clipped[box], times) > 0,
        white=None if capture.white is None else _magnified(capture.white[box], times),
        white_clipped=None if capture.white_clipped is None else _magnified(capture.white_clipped[box], times) > 0,
    )
    estimate = estimator(large, progress)
    vectors, confidence = np.zeros(capture.image.shape, np.float32), np.zeros(capture.mask.shape, np.float32)
    vectors[box], confidence[box] = estimate.vectors[::times, ::times], estimate.confidence[::times, ::times]
    return NormalMap(vectors, capture.mask, confidence)


def _magnified(values: NDArray[np.floating[Any] | np.bool_], times: int) -> NDArray[np.float32]:
    """Values (h, w, ...) with times - 1 bilinearly interpolated ones between neighbours."""
    for axis in (0, 1):
        lines = np.moveaxis(values.astype(np.float32), axis, 0)
        low, share = np.divmod(np.arange((len(lines) - 1) * times + 1), times)
        share = (share / times).astype(np.float32).reshape(-1, *[1] * (values.ndim - 1))
        high = np.minimum(low + 1, len(lines) - 1)
        values = np.moveaxis(lines[low] + share * (lines[high] - lines[low]), 0, axis)
    return np.ascontiguousarray(values)
