"""Files: images, camera raw, JSON and NPZ, written atomically; provenance of results."""
