"""Meshes as the .npz files that the add-on writes."""

from pathlib import Path

import numpy as np

from mpsnet_core import Mesh


def write_mesh(path: Path, mesh: Mesh) -> None:
    arrays = {}
    if mesh.materials is not None:
        arrays |= {"materials": np.array(mesh.materials.names, str), "triangle_material": mesh.materials.number}
    if mesh.objects is not None:
        arrays |= {"objects": np.array(mesh.objects.names, str), "triangle_object": mesh.objects.number}
    np.savez(
        path,
        format=np.array("mpsnet-mesh"),
        version=np.array(1),
        vertices=mesh.vertices,
        triangles=mesh.triangles,
        corner_normals=mesh.corner_normals,
        uvs=mesh.uvs,
        tangents=mesh.tangents,
        world_from_object=mesh.world_from_object,
        **arrays,
    )
