"""The object's surface: its mesh and tangents, and the baking of normals onto its UVs."""
