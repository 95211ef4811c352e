"""Files: images, camera raw, JSON and NPZ, that appear whole or not at all; where results came from."""
