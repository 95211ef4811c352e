"""A mesh as alignment sees it: its faces' normals, and where rays meet them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.scene.mesh import Mesh, triangle_normals
from mpsnet_core.scene.rays import RayScene


@dataclass(frozen=True)
class MeshFaces:
    """A mesh made ready.

    Parameters
    ----------
    scene
        For rays, in world space.
    normals
        (T, 3) unit normals of the triangles, in world space; zero where one has no area.
    """

    scene: RayScene
    normals: NDArray[np.float64]

    @classmethod
    def of(cls, mesh: Mesh) -> "MeshFaces":
        across = triangle_normals(mesh.world_vertices[mesh.triangles])
        length = np.linalg.norm(across, axis=1, keepdims=True)
        return cls(RayScene.of(mesh), across / np.where(length > 0, length, 1))
