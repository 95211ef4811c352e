"""Whether a view fits the mesh: its mask and normals are compared with those of the mesh through its camera."""

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.upsample import chosen_pixels, reduced_shape
from mpsnet_core.bake.projection import View
from mpsnet_core.errors import Note
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh, world_from_file
from mpsnet_core.scene.mesh_hits import mesh_hits
from mpsnet_core.scene.rays import RayScene

log = logging.getLogger(__name__)

# Pixels that are compared on the longer side.
PIXELS = 256
# A mask that covers more of the image has no outline to compare.
WHOLE_IMAGE = 0.95
# A mesh that covers less of a view than this is too small to be meant.
TINY = 0.003
# A view above this cost does not fit. Of right views of 26 meshes, 1% is above it, also with decimated meshes and masks
# of a half; of views under a wrong axis 91%, of cameras on the other side 78%, and the second choices of align.
POOR = 0.62
# Above this cost, other axes and units are tried. One whose cost is below this multiple is meant, if it explains more
# than this share of the normals' variance.
DOUBTFUL, BETTER, EXPLAINED = 0.35, 0.5, 0.1
# Lengths of units in each other: mm, cm, in, ft and m.
UNITS = (0.001, 0.01, 0.0254, 0.1, 0.3048, 1 / 0.3048, 10.0, 1 / 0.0254, 100.0, 1000.0)


@dataclass(frozen=True)
class ViewFit:
    """How well a mesh fits a view."""

    covered: float
    """The share of the view's mask that shows the mesh. The mesh may go on beyond the mask and the image."""
    degrees: float
    """Median angle between the mesh's facets and the view's normals there; 180 if there is no such pixel."""
    explained: float
    """The share of the normals' variance there that the mesh explains, at most 1."""
    outlined: bool
    """Whether the mask has an outline."""

    @property
    def cost(self) -> float:
        """Smaller is better."""
        return (1 - self.covered if self.outlined else 0.0) + self.degrees / 60

    @property
    def poor(self) -> bool:
        return self.covered < TINY or self.cost > POOR


def view_fit(view: View, camera: Camera, mesh: Mesh, scene: RayScene) -> ViewFit:
    """How well a mesh, seen by a camera, fits a view. scene: of the same mesh."""
    height, width = view.normals.mask.shape
    rows, columns = chosen_pixels(*reduced_shape(height, width, PIXELS), height, width)
    shown = view.normals.mask[np.ix_(rows, columns)]
    row, column = np.nonzero(shown)
    seen = mesh_hits(mesh, camera, scene, np.stack([columns[column], rows[row]], axis=1) + 0.5)
    facets = mesh.outwards[seen.triangle] @ camera.rotation
    facets[(facets * seen.directions).sum(axis=1) > 0] *= -1  # the mesh may be open
    normals = view.normals.vectors[rows[row], columns[column]][seen.hit]
    outlined = bool(shown.mean() < WHOLE_IMAGE)
    if not len(normals):
        return ViewFit(0.0, 180.0, 0.0, outlined)
    cosine = np.clip((facets * normals).sum(axis=1), -1, 1)
    unlike = float(((facets - normals) ** 2).sum())
    variance = float(((normals - normals.mean(axis=0)) ** 2).sum())
    explained = 1 - unlike / max(variance, 1e-9)
    return ViewFit(len(normals) / len(row), float(np.degrees(np.median(np.arccos(cosine)))), explained, outlined)


def warn_of_misfit(name: str, view: View, mesh: Mesh, scene: RayScene) -> None:
    """Warn if a mesh does not fit a view, or would fit far better with another axis up or in another unit."""
    found = view_fit(view, view.camera, mesh, scene)
    if found.cost < DOUBTFUL and found.covered >= TINY:
        return
    remedy = _remedy(found, view, mesh, scene)
    if not (remedy or found.poor):
        return
    log.warning(
        "view %s does not fit the mesh, which covers %s of what the view shows, with normals that differ by %.0f° "
        "(median): %s [misfit-view]",
        name,
        f"{100 * found.covered:.2g}%" if found.covered < 0.1 else f"{found.covered:.0%}",
        found.degrees,
        remedy
        or Note("check that camera, photo and mesh belong together, and the mesh's axes and unit (--up, --unit)"),
    )


def _remedy(found: ViewFit, view: View, mesh: Mesh, scene: RayScene) -> Note:
    """The change of the mesh's axes or unit with which it fits, "" if there is none."""
    turn = world_from_file("y", 1.0)
    tried = [
        (Note("it fits if its y axis points up (--up y)"), _moved(view.camera, turn, 1.0)),
        (Note("it fits if its z axis points up, not y (--up z)"), _moved(view.camera, np.linalg.inv(turn), 1.0)),
        *(
            (Note("it fits if its unit is %.4g times as long (--unit)", unit), _moved(view.camera, np.eye(4), unit))
            for unit in UNITS
        ),
    ]
    fits = [(view_fit(view, camera, mesh, scene), words) for words, camera in tried]
    best, words = min(fits, key=lambda one: one[0].cost)
    # Without an outline, any size fits a flat mesh.
    is_clear = best.outlined and best.explained > max(EXPLAINED, found.explained)
    return words if is_clear and best.covered > TINY and best.cost < BETTER * found.cost else Note("")


def _moved(camera: Camera, turn: NDArray[np.float64], unit: float) -> Camera:
    """The camera that sees the mesh as `camera` would see it, turned and scaled about the world's origin."""
    pose = np.linalg.inv(turn) @ camera.world_from_camera
    pose[:3, 3] /= unit
    focal = camera.focal * unit if camera.projection == "orthographic" else camera.focal
    return replace(camera, world_from_camera=pose, focal=focal)
