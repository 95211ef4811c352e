"""Coverage: which texels of a texture some view saw, as a picture."""

from pathlib import Path

import numpy as np

from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.bake.texture import Texture
from mpsnet_core.io.image_writing import write_mask

# What the picture holds where a texel was filled; 1 where a view saw it, 0 elsewhere.
FILLED = 0.5


def write_coverage(path: Path, texture: Texture) -> None:
    """Write what was seen of a texture, continued by a texel beyond the islands. Raises FileError."""
    seen = texture.seen.astype(np.float32)
    if texture.filled is not None:
        seen[texture.filled] = FILLED
    around = extend_to_nearest(seen[..., None], texture.covered, 1)[..., 0]
    write_mask(path, around)
