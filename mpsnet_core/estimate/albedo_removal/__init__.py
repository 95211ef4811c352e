"""Divide varying albedo out of a photo: grain before the estimate, several colours for a second estimate."""

from mpsnet_core.estimate.albedo_removal.grain import without_grain
from mpsnet_core.estimate.albedo_removal.second_estimate import estimate_without_albedo

__all__ = ["estimate_without_albedo", "without_grain"]
