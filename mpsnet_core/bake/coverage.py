"""Coverage: which texels of a texture some view saw, as an image."""

from pathlib import Path

import numpy as np

from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.bake.texture import Texture
from mpsnet_core.io.image_writing import write_mask

# Value of filled texels; seen ones are 1, all others 0.
FILLED = 0.5


def write_coverage(path: Path, texture: Texture) -> None:
    """Write a texture's coverage, dilated by one texel beyond the islands. Raises FileError."""
    seen = texture.seen.astype(np.float32)
    if texture.filled is not None:
        seen[texture.filled] = FILLED
    around = extend_to_nearest(seen[..., None], texture.covered, 1)[..., 0]
    write_mask(path, around)
