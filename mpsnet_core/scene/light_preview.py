"""A preview of the three lights on a mesh before the photo is taken: its shading, and how many lights reach each pixel.

Three lights are needed for a normal.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.resampling import reduced_shape
from mpsnet_core.arrays.types import F32, F64, Bools
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.errors import GeometryError
from mpsnet_core.io.files import atomic_write, check_no_overwrite, prefix_errors, writable_image, writable_path
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.progress import Progress
from mpsnet_core.scene import operations
from mpsnet_core.scene.camera import Camera, read_camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.normal_encoding import encode
from mpsnet_core.scene.rays import OFFSET, Hits, RayScene, lift_to_curve
from mpsnet_core.scene.rig import LightRig, read_rig

# Colours of pixels that no light, one and two lights reach. Where three do, the normal's colour is shown.
TOO_FEW = np.array([(0, 0, 0), (0.75, 0.05, 0.05), (1, 0.6, 0)], np.float32)


@dataclass(frozen=True)
class LitView:
    """A matt white mesh under a rig, as a camera sees it."""

    photo: F32
    """(H, W, 3) float32. Linear; 1 where the surface faces a light of full strength."""
    normals: F32
    """(H, W, 3) float32. The mesh's normals, in camera space."""
    mask: Bools
    """(H, W) bool. Where the mesh is."""
    reached: Bools
    """(H, W, 3) bool. Which lights reach the pixel."""

    @property
    def shares(self) -> list[float]:
        """Fractions of the mesh's pixels that no light, one, two and three lights reach."""
        counts = np.bincount(self.reached.sum(axis=-1)[self.mask], minlength=4)
        return [float(count) for count in counts / counts.sum()]

    def picture(self) -> F32:
        """(H, 2 W, 4) display values and opacity: the photo on the left, on the right the normals as colours where
        three lights reach, :data:`TOO_FEW` elsewhere."""
        count = self.reached.sum(axis=-1)
        right = np.where((count == 3)[..., None], encode(self.normals), TOO_FEW[np.minimum(count, 2)])
        colours = np.concatenate([linear_to_srgb(self.photo), right], axis=1)
        opacity = np.concatenate([self.mask, self.mask], axis=1)[..., None]
        return np.concatenate([colours * opacity, opacity], axis=-1).astype(np.float32)


def lit_view(camera: Camera, rig: LightRig, mesh: Mesh) -> LitView:
    """Shade the mesh as a matt white surface, with cast and attached shadows.

    Lights are points: shadows have hard edges. There are no interreflections.

    Parameters
    ----------
    camera : Camera
    rig : LightRig
        The lights in the camera's space.
    mesh : Mesh
        The mesh, in the camera's world space.

    Raises
    ------
    GeometryError
        If the camera does not see the mesh.
    """
    scene = RayScene.of(mesh)
    row, column = np.mgrid[: camera.height, : camera.width].reshape(2, -1)
    origins, directions, _ = scene.rays_of(camera, np.stack([column, row], axis=1) + 0.5)
    hits = scene.hits(origins, directions)
    seen = np.flatnonzero(hits.triangle >= 0)
    if not len(seen):
        raise GeometryError("the camera does not see the mesh; check that it faces the mesh")
    points = origins[seen] + hits.distance[seen, None] * directions[seen]
    normals, starts = _surface(mesh, hits.subset(seen), points, -directions[seen], OFFSET * scene.size)
    irradiance = _irradiance(camera, rig, scene, points, normals, starts)

    def image(values: NDArray[Any]) -> NDArray[Any]:
        whole = np.zeros((len(origins), *values.shape[1:]), values.dtype)
        whole[seen] = values
        return whole.reshape(camera.height, camera.width, *values.shape[1:])

    return LitView(
        image((irradiance @ rig.mixing.T).astype(np.float32)),
        image((normals @ camera.rotation).astype(np.float32)),
        image(np.ones(len(seen), bool)),
        image(irradiance > 0),
    )


def _surface(mesh: Mesh, hits: Hits, points: F64, view: F64, offset: float) -> tuple[F64, F64]:
    """Unit normals at points (N, 3) that rays hit, in world space, and the origins of rays that leave the surface.

    view: (N, 3) towards the viewer. Normals of back faces are flipped.
    """
    weights = hits.weights.astype(np.float64)
    corners = mesh.world_vertices[mesh.triangles[hits.triangle]]
    at_corners = normalised(mesh.corner_normals[hits.triangle] @ mesh.normals_to_world)
    at_corners[dot(mesh.outwards[hits.triangle], view) < 0] *= -1
    normals = normalised((weights * at_corners).sum(axis=1))
    lift = offset * normals
    lift_to_curve(lift, points, *(part.swapaxes(0, 1) for part in (weights, corners, at_corners)))
    return normals, points + lift


def _irradiance(camera: Camera, rig: LightRig, scene: RayScene, points: F64, normals: F64, starts: F64) -> F64:
    """(N, 3) irradiance by each light at points (N, 3) in world space; 1 where a surface faces one of full strength."""
    if rig.near is None:
        arriving = np.broadcast_to(rig.directions @ camera.rotation.T, (len(points), 3, 3))
    else:
        arriving = rig.near.lights_at((points - camera.world_from_camera[:3, 3]) @ camera.rotation) @ camera.rotation.T
    irradiance: F64 = np.maximum(np.einsum("nki,ni->nk", arriving, normals), 0)
    for number in range(3):
        facing = np.flatnonzero(irradiance[:, number])
        towards = normalised(np.ascontiguousarray(arriving[facing, number]))
        if rig.near is None:
            hidden = scene.occluded(starts[facing], towards)
        else:  # surfaces behind the light cast no shadow
            place = camera.world_from_camera[:3, 3] + camera.rotation @ rig.near.positions[number]
            hidden = scene.distances(starts[facing], towards) < np.linalg.norm(place - starts[facing], axis=1)
        irradiance[facing[hidden], number] = 0
    return irradiance


def preview_lights(options: operations.PreviewLights, progress: Progress) -> operations.LightsPreviewed:
    """Ray trace the mesh, and write the image."""
    as_array = Path(options.output).suffix.lower() == ".npy"
    output = writable_path(options.output) if as_array else writable_image(options.output, 8)
    check_no_overwrite([options.mesh, options.rig, options.camera], [output])
    camera, rig = read_camera(options.camera), read_rig(options.rig)
    height, width = reduced_shape(camera.height, camera.width, options.size)
    progress(0.0, "reading the mesh")
    mesh = options.read_mesh(options.mesh, shape_only=True)
    progress(0.5, "tracing the lights")
    with prefix_errors(f"camera {options.camera}"):
        view = lit_view(camera.resized(width, height), rig, mesh)
    if as_array:
        with atomic_write(output) as unfinished, unfinished.open("wb") as file:
            np.save(file, view.picture())
    else:
        write_picture(output, view.picture())
    progress(1.0, "done")
    text = f"{options.output}: three lights reach {view.shares[3]:.1%} of what the camera sees"
    return operations.LightsPreviewed(options.output, [round(share, 4) for share in view.shares], text=text)
