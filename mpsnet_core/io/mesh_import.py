"""Mesh files of other programs, by trimesh."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mpsnet_core.errors import FormatError, InputError


@contextmanager
def read_scene(path: Path) -> Iterator[Any]:
    """The trimesh scene of a file, its format by its suffix, with vertices and UVs unmerged.

    Files that it refers to are not opened.

    Raises FormatError, without the file's name, where it cannot be read, or the block fails on its content.
    """
    import trimesh  # takes a while to load

    try:
        with path.open("rb") as file:  # by a path trimesh would open the files beside it
            # process=False: merging vertices would lose UV seams and sharp edges.
            scene = trimesh.load_scene(
                file, file_type=path.suffix.lower().lstrip("."), process=False, maintain_order=True
            )
        yield scene
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001  # trimesh raises anything for damaged files
        raise FormatError(f"it cannot be read ({type(error).__name__}: {error}); export it again") from None
