"""A height map as a mesh, with the photo's own UVs, and its files."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.defaults import FACES, MAX_FACES
from mpsnet_core.errors import InputError
from mpsnet_core.io.files import writable_path, written_whole
from mpsnet_core.progress import Progress, silent
from mpsnet_core.relief.adaptive_triangles import adaptive_triangles
from mpsnet_core.relief.height_map import HeightMap
from mpsnet_core.relief.parallel_projection import parallel_heights, pixel_size
from mpsnet_core.relief.sizes import check_size
from mpsnet_core.scene.normal_map import NormalMap

Up = Literal["y", "z"]
MESH_SUFFIXES = (".ply", ".glb", ".obj")


class NoFaceError(InputError):
    """No triangle is left of a surface."""


@dataclass(frozen=True)
class SurfaceMesh:
    """A surface in the camera's world, as the photo shows it.

    vertices: (V, 3). triangles: (T, 3) vertex numbers, counter-clockwise seen from the camera. normals: (V, 3) unit,
    for smooth shading. uvs: (V, 2), (0, 0) the photo's lower left and (1, 1) its upper right corner.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    normals: NDArray[np.float32]
    uvs: NDArray[np.float32]


def surface_mesh(
    heights: HeightMap,
    normals: NormalMap,
    *,
    faces: int = FACES,
    open_from: float | None = None,
    progress: Progress = silent,
) -> SurfaceMesh:
    """The surface as at most `faces` triangles, small ones where it bends and large ones where it does not.

    Each vertex is a pixel's own point and has its normal. normals: in camera space, of the same size as the heights.
    open_from: in degrees; triangles that face away from the ray of sight by that or more are left out, so that a step
    between a thing and what is behind it stays open. Closed unless given.

    Raises InputError where the sizes do not agree or an option is out of range, NoFaceError where no triangle is left.
    """
    check_size("height map", heights.mask.shape, normals)
    check_surface_mesh(faces, open_from)
    check_has_faces(heights.mask)
    corners = adaptive_triangles(parallel_heights(heights), heights.mask, pixel_size(heights), faces, progress)
    pixels, triangles = np.unique(corners, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    camera = heights.camera
    rows, columns = np.divmod(pixels, camera.width)
    origins, rays = camera.rays(np.stack([columns, rows], axis=-1) + 0.5)
    along = rays @ -camera.rotation[:, 2]
    points = origins - rays * (heights.values[rows, columns] / along)[:, None]
    if open_from is not None:
        one, other, third = points[triangles].swapaxes(0, 1)
        across = np.cross(other - one, third - one)
        facing = -np.einsum("ti,ti->t", across, rays[triangles[:, 0]])
        triangles = triangles[facing > np.cos(np.radians(open_from)) * np.linalg.norm(across, axis=1)]
    if not len(triangles):
        raise NoFaceError("no face is left of the surface; allow more faces, or leave fewer steps open")
    used, triangles = np.unique(triangles, return_inverse=True)
    size = np.array([camera.width, camera.height])
    return SurfaceMesh(
        points[used],
        triangles.reshape(-1, 3).astype(np.int32),
        (normals.vectors[rows[used], columns[used]] @ camera.rotation.T).astype(np.float32),
        ((np.stack([columns[used], size[1] - 1 - rows[used]], axis=-1) + 0.5) / size).astype(np.float32),
    )


def check_surface_mesh(faces: int, open_from: float | None = None) -> None:
    """Raises InputError where :func:`surface_mesh` would make none with these options."""
    if not 1 <= faces <= MAX_FACES:
        raise InputError(f"a mesh of {faces} faces cannot be made; choose 1 to {MAX_FACES}")
    if open_from is not None and not 0 < open_from <= 90:
        raise InputError(f"steps are left open from an angle between 0 and 90 degrees on, not {open_from:g}")


def check_has_faces(mask: NDArray[np.bool_]) -> None:
    """Raises InputError where no triangle of neighbouring pixels is within the mask, (H, W)."""
    ones = mask.astype(np.int8)
    if not (ones[:-1, :-1] + ones[:-1, 1:] + ones[1:, :-1] + ones[1:, 1:] >= 3).any():
        raise InputError("the surface is nowhere two pixels wide and high, so it has no face; leave the mesh out")


def writable_mesh(path: str | os.PathLike[str]) -> Path:
    """`path` as a Path, or InputError where no mesh can be written there."""
    path = writable_path(path)
    if path.suffix.lower() not in MESH_SUFFIXES:
        kind = path.suffix or "no suffix"
        raise InputError(f"cannot write {path}: {kind} is not a mesh format of ours; use {', '.join(MESH_SUFFIXES)}")
    return path


def write_surface_mesh(path: str | os.PathLike[str], mesh: SurfaceMesh, *, up: Up = "z") -> None:
    """Write a mesh with normals and UVs as PLY, GLB or OBJ, whole or not at all.

    PLY keeps the world's axes. GLB and OBJ are y up by their conventions: where `up` says that z is up in the world, as
    in Blender, (x, y, z) is written as (x, z, -y), which Blender's importers turn back. "y" writes all as it stands.
    The object is called as the file is.

    Raises InputError where the suffix is another, or the file cannot be written.
    """
    path = writable_mesh(path)
    if up not in ("y", "z"):
        raise InputError(f'the axis that points up is "y" or "z", not {up!r}')
    vertices, normals = mesh.vertices, mesh.normals
    if up == "z" and path.suffix.lower() != ".ply":
        vertices, normals = (values[:, [0, 2, 1]] * np.array([1, 1, -1]) for values in (vertices, normals))
    with written_whole(path) as unfinished:
        if path.suffix.lower() == ".obj":
            _write_obj(unfinished, vertices, normals, mesh)
        else:
            _write_with_trimesh(unfinished, path.stem, vertices, normals, mesh)


def _write_obj(path: Path, vertices: NDArray[np.floating], normals: NDArray[np.floating], mesh: SurfaceMesh) -> None:
    """By hand: trimesh writes 8 decimals, too few for small units, and names a material file that is not there."""
    corners = np.repeat(mesh.triangles + 1, 3, axis=1)
    blocks = (("v %.9g %.9g %.9g", vertices), ("vt %.7g %.7g", mesh.uvs), ("vn %.5g %.5g %.5g", normals))
    with path.open("w", encoding="ascii") as file:
        for form, values in (*blocks, ("f" + " %d/%d/%d" * 3, corners)):
            np.savetxt(file, values, form)


def _write_with_trimesh(
    path: Path, name: str, vertices: NDArray[np.floating], normals: NDArray[np.floating], mesh: SurfaceMesh
) -> None:
    """name: what the object in the file is called; PLY has no place for it."""
    import trimesh  # takes a while to load

    material = trimesh.visual.material.PBRMaterial(name="Surface", metallicFactor=0.0, roughnessFactor=0.8)
    made = trimesh.Trimesh(
        vertices,
        mesh.triangles,
        vertex_normals=normals,
        visual=trimesh.visual.TextureVisuals(uv=mesh.uvs, material=material),
        process=False,
    )
    if path.suffix.lower() == ".ply":
        path.write_bytes(trimesh.exchange.ply.export_ply(made, vertex_normal=True))
    else:
        scene = trimesh.Scene()
        scene.add_geometry(made, node_name=name, geom_name=name)
        path.write_bytes(trimesh.exchange.gltf.export_glb(scene, include_normals=True))
