"""A second estimate, of the photo with the changes of its surface's albedo divided out."""

from mpsnet_core.estimate.even_albedo.second_look import estimate_with_second_look

__all__ = ["estimate_with_second_look"]
