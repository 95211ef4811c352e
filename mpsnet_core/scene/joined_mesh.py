"""Several meshes joined for occlusion and world positions, where only their shape matters."""

import itertools
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F32
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.scene.mesh import Mesh

T = TypeVar("T", bound=np.generic)


@takes_files
def join_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Join meshes into one in world space, with their triangles in order.

    Parameters
    ----------
    meshes : sequence of Mesh
        A single mesh is returned unchanged. Of several, labels and given tangents are dropped.

    Raises
    ------
    GeometryError
        If the joined arrays are not a valid :class:`Mesh`.
    """
    if len(meshes) == 1:
        return meshes[0]
    starts = itertools.accumulate((len(mesh.vertices) for mesh in meshes[:-1]), initial=0)
    triangles = [_outwards(mesh, mesh.triangles) + start for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh(
        np.concatenate([mesh.world_vertices for mesh in meshes]),
        np.concatenate(triangles),
        np.concatenate([_outwards(mesh, _world_normals(mesh)) for mesh in meshes]),
        np.concatenate([_outwards(mesh, mesh.uvs) for mesh in meshes]),
    )


def _outwards(mesh: Mesh, at_corners: NDArray[T]) -> NDArray[T]:
    """Corner values (T, 3, ...) in counter-clockwise order in world space: reversed for a mirrored object."""
    return at_corners[:, ::-1] if mesh.is_mirrored else at_corners


def _world_normals(mesh: Mesh) -> F32:
    return normalised(mesh.corner_normals @ mesh.normals_to_world.astype(np.float32))
