"""Detect matt surfaces of one colour in a photo, and solve their normals where the lights determine them."""

from mpsnet_core.estimate.uniform_albedo.refine import refine_normals

__all__ = ["refine_normals"]
