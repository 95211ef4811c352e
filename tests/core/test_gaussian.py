"""Gaussian smoothing against NumPy's convolution."""

import numpy as np
import pytest

from mpsnet_core.arrays.resampling import gaussian


@pytest.mark.parametrize(("shape", "sigma"), [((150, 70, 2), 2.3), ((40, 3, 1), 6.0)])
def test_it_is_a_convolution_along_each_axis(shape: tuple[int, ...], sigma: float) -> None:
    """More and fewer rows than are smoothed at once, and fewer than the kernel has."""
    values = np.random.default_rng(0).random(shape)
    reach = int(np.ceil(3 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    expected = values
    for axis in (0, 1):
        expected = np.apply_along_axis(lambda line: np.convolve(line, kernel)[reach:-reach], axis, expected)
    np.testing.assert_allclose(gaussian(values, sigma, (0, 1)), expected, atol=1e-12)
    found = gaussian(values.astype(np.float32), sigma, (0, 1))
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=1e-6)
