"""Mesh files that trimesh reads rightly: STL and OFF, which hold shapes alone."""

import logging
from pathlib import Path

import numpy as np

from mpsnet_core.errors import FormatError
from mpsnet_core.io.polygons import Polygons, checked_indices

SUFFIXES = (".stl", ".off")


def read_shape(path: Path) -> Polygons:
    """The triangles of a file, all flat. Raises FormatError, without the file's name, if it cannot be read."""
    import trimesh  # slow to import

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # keep its log messages off stderr
    try:
        with path.open("rb") as file:
            mesh = trimesh.load_mesh(file, file_type=path.suffix.lower().lstrip("."), process=False)
        vertices, triangles = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    except Exception as error:  # noqa: BLE001  # trimesh raises anything for damaged files
        raise FormatError(f"it cannot be read ({type(error).__name__}: {error}); export it again") from None
    return Polygons(vertices, checked_indices(triangles, len(vertices)).ravel(), np.full(len(triangles), 3))
