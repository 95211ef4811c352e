"""Clicked positions: in a photo, in a viewport, and on the mesh in it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from mathutils import Matrix, Vector

# In pixels of a region from its lower left corner, or of the photo from its upper left corner.
Place = tuple[float, float]


def photo_pixel(place: Place, size: tuple[int, int]) -> Place:
    """The photo's pixel, from its upper left corner, at Blender's image coordinates, from 0 to 1 with y up."""
    return place[0] * size[0], (1 - place[1]) * size[1]


def photo_place(pixel: Sequence[float], size: tuple[int, int]) -> Place:
    """The inverse of :func:`photo_pixel`."""
    return pixel[0] / size[0], 1 - pixel[1] / size[1]


def seen_at(point: Sequence[float], view: Matrix, size: tuple[int, int]) -> Place | None:
    """The position of a world-space point in a region; None if it is behind the viewer.

    view: projection from world space to the region, from -1 to 1 along each side. size: of the region in pixels.
    """
    x, y, _, w = view @ Vector((*point, 1))
    return None if w <= 0 else ((1 + x / w) * size[0] / 2, (1 + y / w) * size[1] / 2)


def mesh_point(target: Any, depsgraph: Any, view: Matrix, size: tuple[int, int], place: Place) -> Vector | None:
    """The point of an object's surface, in world space, at a position in a region; None if there is none.

    view, size: see :func:`seen_at`. Other objects in front of it are ignored.
    """
    inverse = np.linalg.inv(np.array(view, np.float64))
    across = [2 * at / length - 1 for at, length in zip(place, size, strict=True)]
    near, far = (Vector(end[:3] / end[3]) for end in (inverse @ [*across, depth, 1] for depth in (-1, 1)))
    evaluated = target.evaluated_get(depsgraph)
    into = evaluated.matrix_world.inverted_safe()
    start = into @ near
    try:
        hit, there, _, _ = evaluated.ray_cast(start, into @ far - start)
    except RuntimeError:  # it has no evaluated mesh
        return None
    return evaluated.matrix_world @ there if hit else None
