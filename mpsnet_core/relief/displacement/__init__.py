"""Displacement: from baked normals to heights on a mesh's UVs."""
