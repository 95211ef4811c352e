"""Mesh files of other programs, by trimesh."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpsnet_core.errors import FormatError, InputError


@contextmanager
def read_scene(path: Path) -> Iterator[Any]:
    """What trimesh reads from a file of the format that its suffix names, with vertices and UVs as they stand there.

    The file stands alone: nothing that it names is opened.

    Raises InputError, which does not name the file, where it cannot be read, or used as it is read.
    """
    import trimesh  # takes a while to load

    try:
        with path.open("rb") as file:  # of a path trimesh would take what stands beside it
            # process=False: merging vertices would lose UV seams and sharp edges.
            scene = trimesh.load_scene(
                file, file_type=path.suffix.lower().lstrip("."), process=False, maintain_order=True
            )
        yield scene
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001  # of damaged files trimesh raises whatever comes
        raise FormatError(f"it cannot be read ({type(error).__name__}: {error}); export it again") from None
