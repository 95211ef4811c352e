"""Fine relief: how much of the surface's detail an estimate keeps, regardless of its low-frequency errors."""

import numpy as np
from numpy.typing import NDArray

# Least share of a pixel's neighbourhood, weighted by the Gaussian, that must be inside the object.
MIN_INSIDE = 0.999


def fine_relief(
    estimate: NDArray[np.float32],
    truth: NDArray[np.float32],
    mask: NDArray[np.bool_],
    lit: NDArray[np.bool_],
    sigma: float,
) -> float | None:
    """Regression coefficient of the estimate's detail on the true detail: 1 if all is kept, 0 if none is.

    estimate, truth: (H, W, 3) unit normals. mask, lit: (H, W) the object's pixels, and those that all lights reach.
    sigma: of the Gaussian in pixels.

    Detail is the difference of the normals' x and y from their Gaussian mean. Both are over lit pixels only, because
    errors in shadow would spread, and pixels near the outline are ignored. The coefficient is the least-squares slope
    through the origin: noise does not bias it, and above 1 detail is exaggerated. None if the truth has no detail.
    """
    lit = lit & mask
    counted = lit & (_blurred(mask[..., None], sigma)[..., 0] > MIN_INSIDE)
    weight = np.maximum(_blurred(lit[..., None], sigma), 1e-6)

    def detail(normals: NDArray[np.float32]) -> NDArray[np.float64]:
        across = np.where(lit[..., None], normals[..., :2], 0)
        high: NDArray[np.float64] = across - _blurred(across, sigma) / weight
        return high[counted]

    found, true = detail(estimate), detail(truth)
    size = float((true**2).sum())
    return float((found * true).sum()) / size if size > 1e-9 else None


def _blurred(values: NDArray[np.generic], sigma: float) -> NDArray[np.float64]:
    """Values (H, W, C) convolved with a Gaussian, zero-padded."""
    height, width, _ = values.shape
    size = [side + int(np.ceil(4 * sigma)) for side in (height, width)]
    frequency = np.hypot(np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1]))
    passed = np.exp(-2 * (np.pi * sigma * frequency) ** 2)[..., None]
    spectrum = np.fft.rfft2(values.astype(np.float64), size, axes=(0, 1))
    return np.fft.irfft2(spectrum * passed, size, axes=(0, 1))[:height, :width]
