"""Divide varying albedo out of a photo: grain before the estimate, several colours for a second estimate."""

from mpsnet_core.estimate.albedo_removal.grain import divide_out_grain
from mpsnet_core.estimate.albedo_removal.second_estimate import estimate_with_albedo_removed

__all__ = ["divide_out_grain", "estimate_with_albedo_removed"]
