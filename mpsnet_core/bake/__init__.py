"""Baking of normals and colours onto a mesh's UVs."""
