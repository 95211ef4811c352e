"""The scene: cameras, light rigs, meshes, normal maps, and the cameras of photogrammetry."""
