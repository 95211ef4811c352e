"""The operation align: find the camera of a photo from a mesh."""

from dataclasses import dataclass
from pkgutil import resolve_name
from typing import ClassVar

from mpsnet_core.capture.operations import ReadsPhotos
from mpsnet_core.defaults import MASK, MAX_FOCAL, MIN_FOCAL
from mpsnet_core.errors import Note
from mpsnet_core.estimate.operations import RunsModel
from mpsnet_core.operation import Result, option
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.operations import TakesMesh


@dataclass(frozen=True)
class CameraFound(Result):
    """The camera of a photo."""

    output: str
    """The camera file."""
    outline_pixels: float
    """Median distance of the mesh's outline from the mask's, in the photo's pixels."""
    normals_degrees: float
    """Median angle between the mesh's normals and the photo's."""
    overlap: float
    """Intersection over union of mesh and mask."""
    poor: bool
    """Whether the fit is too poor to bake with."""
    mirrored: bool
    """Whether the mirror image of the mesh fits better; such a fit is poor."""
    residuals: list[float] | None = None
    """Reprojection error of each pair, in the photo's pixels."""
    left_out: list[int] | None = None
    """Numbers of the pairs that contradict the others, from 1."""
    others: list[str] | None = None
    """Camera files of the next best views, if there was no start."""


@dataclass(frozen=True)
class Align(RunsModel, TakesMesh, ReadsPhotos):
    """Find the camera that took a photo, from a mesh of the object."""

    command: ClassVar[str] = "align"

    image: str = option(positional=True, help="the photo", path="file", provenance="files")
    mesh: str = option(
        help="mesh of the object in the photo, whose unit and axes the camera file will use unless they are changed",
        path="file",
    )
    rig: str | None = option(
        default=None,
        help="rig file (.json, or .lp with three lights)",
        unset="the lights are found in the photo",
        path="file",
    )
    mask: str = option(default=MASK, help="mask of the photo, as `mpsnet estimate` takes it")
    points: str | None = option(
        default=None,
        metavar="FILE",
        help="JSON file of 4 or more pairs of points in the photo and on the mesh: "
        '{"pairs": [{"pixel": [x, y], "point": [X, Y, Z]}, ...]}, in pixels from the top left corner and the mesh '
        "file's own axes",
        path="file",
    )
    start: str | None = option(
        default=None,
        metavar="FILE",
        help="camera file of a rough start, within about 10 degrees of the photo's view",
        unset="without pairs, views all around the mesh are tried",
        path="file",
    )
    focal: float | None = option(
        default=None,
        metavar="MM",
        low=MIN_FOCAL,
        high=MAX_FOCAL,
        help="35 mm equivalent focal length of the lens, in millimetres",
        unset="estimated too, starting from the one in the photo's EXIF data",
    )
    lens: str | None = option(
        default=None,
        metavar="CAMERA",
        help="camera file of the lens, in place of --focal: sets the focal length and principal point, not "
        "the pose; its photo must have the same aspect ratio, at any size",
        unset="the principal point is the photo's centre, or that of the start",
        path="file",
    )
    overlay: str | None = option(
        default=None,
        metavar="FILE",
        help="also write the photo cropped to the object, with the outlines of mask (orange) and mesh (green) "
        "and the pairs drawn over it",
        path="file",
        provenance="none",
    )
    output: str = option(help="the camera file (.json)", path="file", provenance="none")

    def run(self, progress: Progress = silent) -> CameraFound:
        """Write the camera file, and the overlay if requested."""
        return resolve_name("mpsnet_core.estimate.alignment.align:align")(self, progress)


def fit_in_words(outline_pixels: float, normals_degrees: float, overlap: float, poor: bool) -> Note:
    """How well the mesh fits the photo, by these facts of a :class:`CameraFound`.

    The normals of a good fit differ, too, by what the mesh lacks and the estimate errs: their angle tells of poor ones.
    """
    if not poor:
        return Note("good fit: outlines %.1f pixels apart, %.0f%% shared", outline_pixels, 100 * overlap)
    words = "poor fit: outlines %.1f pixels and normals %.0f° apart, %.0f%% shared"
    return Note(words, outline_pixels, normals_degrees, 100 * overlap, level="stop")
