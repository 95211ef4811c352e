"""The scene: cameras, light rigs, meshes, normal maps, and photogrammetry that tells where photos were taken."""
