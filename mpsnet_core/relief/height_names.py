"""What stands beside a height map: its scale as ``NAME.json`` and its mask as ``NAME.mask.png``, NAME with its ending.

So ``height.png`` and ``height.exr`` in one folder each have their own. Needs no image library, for Blender.
"""

import os
from pathlib import Path


def height_names(path: str | os.PathLike[str]) -> list[Path]:
    """The files of a height map: the heights, their scale, their mask."""
    path = Path(path)
    return [path, path.with_name(f"{path.name}.json"), path.with_name(f"{path.name}.mask.png")]


def earlier_scale(path: str | os.PathLike[str]) -> Path:
    """Where earlier versions put the scale, the same for all endings."""
    return Path(path).with_suffix(".json")


def scale_sidecar(path: str | os.PathLike[str]) -> Path:
    """The scale that stands beside a height map, be it an earlier version's; where none does, the place for it."""
    scale, earlier = height_names(path)[1], earlier_scale(path)
    return earlier if earlier.is_file() and not scale.exists() else scale
