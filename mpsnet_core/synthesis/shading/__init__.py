"""The synthesis renderer: images of a shape under each of three lights, by ray casting, without Blender."""
