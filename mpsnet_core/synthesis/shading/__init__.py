"""Shading: what a camera sees of a shape under each of three lights, by rays and reflectance, without Blender."""
