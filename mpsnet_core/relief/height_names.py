"""Names of a height map's sidecar files: its scale ``NAME.json`` and its mask ``NAME.mask.png``, NAME with suffix.

So ``height.png`` and ``height.exr`` in one folder have separate ones. Needs no image library, for Blender.
"""

from pathlib import Path

from mpsnet_core.io.opening import AnyPath


def height_names(path: AnyPath) -> list[Path]:
    """The files of a height map: the heights, their scale, their mask."""
    path = Path(path)
    return [path, path.with_name(f"{path.name}.json"), path.with_name(f"{path.name}.mask.png")]
