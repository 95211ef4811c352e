"""Estimation of normal maps from captures, sequences and videos; alignment of meshes with photos."""
