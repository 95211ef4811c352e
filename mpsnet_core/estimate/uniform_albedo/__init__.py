"""Matt surfaces of one colour: found in the photo itself, and solved exactly where the three lights say enough."""

from mpsnet_core.estimate.uniform_albedo.refine import refined

__all__ = ["refined"]
