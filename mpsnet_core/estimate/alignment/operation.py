"""The operation align: find the camera of a photo from a mesh."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from mpsnet_core.capture.operations import ReadsPhotos
from mpsnet_core.defaults import MASK, MAX_FOCAL, MIN_FOCAL
from mpsnet_core.errors import GeometryError, Note, SettingsError
from mpsnet_core.estimate.operations import RunsModel
from mpsnet_core.operation import Result, option
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.operations import TakesMesh

if TYPE_CHECKING:
    from mpsnet_core.arrays.types import F32, F64, Bools
    from mpsnet_core.capture.capture import Capture
    from mpsnet_core.estimate.alignment.points import PointFit
    from mpsnet_core.estimate.alignment.pose import MeshFaces
    from mpsnet_core.estimate.alignment.refine import Fit
    from mpsnet_core.scene.camera import Camera

log = logging.getLogger(__name__)

# Longer side in pixels of the cropped photo to fit to. More pixels would not help: errors of the estimate dominate.
LONGEST = 1024
# A fit is poor if the outlines differ by this share of the object's longer side, or the normals by this many degrees,
# or if mesh and mask overlap less than this.
POOR_OUTLINE, POOR_DEGREES, POOR_OVERLAP = 0.005, 35.0, 0.9
# Another view whose cost is below this multiple of the best might be the right one.
AMBIGUOUS = 1.3
MIN_SIDE = 4  # pixels of the object's shorter side on the coarsest scale
CANDIDATES = 3
# Focal lengths along x and y that differ by at most this factor count as equal: photogrammetry fits both.
SQUARE = 1.005


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
        from mpsnet_core.estimate.alignment.pose import MeshFaces
        from mpsnet_core.io.files import check_no_overwrite, writable_image, writable_path

        if self.points and self.start:
            raise SettingsError("points and start both place the camera; give one of them")
        if self.lens and self.focal is not None:
            raise SettingsError("--lens and --focal both define the lens; give one of them")
        outputs = [Path(self.output), *([Path(self.overlay)] if self.overlay else []), *self._others()]
        inputs = self.inputs(self.image, self.rig, self.mesh, self.points, self.lens, mask=self.mask)
        check_no_overwrite(inputs, outputs)  # the start may be overwritten, to refine it in place
        writable_path(self.output)
        if self.overlay:
            writable_image(self.overlay)
        pairs = self._pairs()
        progress(0.0, f"reading {Path(self.image).name}")
        capture = self._capture()
        _check_size(capture.mask)
        faces = MeshFaces.of(self.read_mesh(self.mesh, shape_only=True))
        fits, point_fit, turned_over = self._fits(capture, faces, pairs, progress)
        return self._written(capture, faces, fits, pairs, point_fit, turned_over, progress)

    def _pairs(self) -> "tuple[F64, F64] | None":
        """The pairs of points, those on the mesh in world space."""
        from mpsnet_core.estimate.alignment.points import read_pairs
        from mpsnet_core.scene.mesh import world_from_file

        if not self.points:
            return None
        pixels, points = read_pairs(self.points)
        return pixels, points @ world_from_file(self.up, self.unit_length())[:3, :3].T

    def _capture(self) -> "Capture":
        from mpsnet_core.capture.open import Source, open_captures
        from mpsnet_core.estimate.lights.find import with_lights
        from mpsnet_core.scene.camera import read_camera
        from mpsnet_core.scene.rig import read_rig

        lens = read_camera(self.lens) if self.lens else None
        focal = self.focal if lens is None else lens.focal_35mm  # provisional, until the photo's size is known
        source = Source(Path(self.image), read_rig(self.rig) if self.rig else None, self.mask, camera=focal)
        source, _ = with_lights(source, [source], self.read_options())
        [capture] = open_captures([source], self.read_options())
        if lens is None:
            return capture
        height, width = capture.mask.shape
        return replace(capture, camera=_of_size(lens, width, height, "lens"))

    def _stated_focal(self) -> float | None:
        """The 35 mm equivalent focal length that the photo's EXIF data state, None if they state none of use."""
        from mpsnet_core.io.focal_length import stated_focal

        focal = stated_focal(self.image)
        if focal is not None:
            name = Path(self.image).name
            log.info(
                "%s states a lens of %.0f mm, where the search starts; give the lens if it is another", name, focal
            )
        return focal

    def _fits(
        self, capture: "Capture", faces: "MeshFaces", pairs: "tuple[F64, F64] | None", progress: Progress
    ) -> "tuple[list[Fit], PointFit | None, bool]":
        """The best fits, the fit of the pairs alone, and whether the mirror image of the mesh fits better."""
        import numpy as np

        from mpsnet_core.estimate.alignment.points import USUAL_FOCAL, camera_from_points
        from mpsnet_core.estimate.alignment.refine import PhotoPyramid, measure_fit, refine_camera
        from mpsnet_core.estimate.alignment.search import find_better_mirrored, move_onto_mask, search_cameras
        from mpsnet_core.scene.camera import FULL_FRAME, Camera, read_camera

        height, width = capture.mask.shape
        lens, fixed = capture.camera, capture.camera is not None
        stated = None if fixed or self.start else self._stated_focal()
        likely = stated / FULL_FRAME if stated else USUAL_FOCAL
        by_points = None if pairs is None else camera_from_points(*pairs, width, height, lens, usual_focal=likely)
        rough = by_points.camera if by_points else None
        if self.start is not None:
            rough = _of_size(read_camera(self.start), width, height, "start")
            if lens is not None:
                rough = replace(rough, focal=lens.focal, centre=lens.centre if self.lens else rough.centre)
        crop = _ObjectCrop.of(capture.mask)
        small = crop.capture(capture)
        # The shares of the time after which the normals are estimated and the camera is found: a search takes longest.
        estimated, found = (0.12, 0.955) if rough is None else (0.4, 0.9)
        estimate = PhotoPyramid(self.estimator(1)(small, part(progress, 0.05, estimated)))
        rest = part(progress, estimated, found)
        if rough is None:
            free = Camera("perspective", width, height, np.full(2, max(height, width) * likely))
            begin = crop.camera(lens or free)
            usual = float(begin.focal[0]) * USUAL_FOCAL / likely if stated else None
            fits = search_cameras(estimate, faces, begin, CANDIDATES, fix_focal=fixed, usual_focal=usual, progress=rest)
        else:
            begin = crop.camera(rough)
            if by_points is None:
                begin = move_onto_mask(estimate, faces, begin)
            fits = [refine_camera(estimate, faces, begin, fix_focal=fixed, progress=rest)]
        best = fits[0]
        if by_points and pairs and _contradicts(crop.whole(fits[0]).camera, by_points, *pairs):
            log.warning("the mesh contradicts the pairs of points; the camera is found from the pairs alone")
            fits = [measure_fit(estimate, faces, begin)]
            best = min(best, fits[0], key=lambda fit: fit.cost)
        mirrored = part(progress, found, 0.98, "comparing with the mirrored mesh")
        image = find_better_mirrored(estimate, faces, best, mirrored)
        turned_over = image is not None and not _is_poor(image, small.mask)
        return [crop.whole(fit) for fit in fits], by_points, turned_over

    def _written(
        self,
        capture: "Capture",
        faces: "MeshFaces",
        fits: "list[Fit]",
        pairs: "tuple[F64, F64] | None",
        by_points: "PointFit | None",
        turned_over: bool,
        progress: Progress,
    ) -> CameraFound:
        from mpsnet_core.estimate.alignment.points import reprojection_errors
        from mpsnet_core.io.files import write_transaction
        from mpsnet_core.io.image_writing import write_picture
        from mpsnet_core.scene.camera import write_camera

        best = fits[0]
        poor, quality = _is_poor(best, capture.mask), _quality(best, capture.mask)
        self._warn(fits, quality, turned_over, poor)
        left_out = by_points.left_out if by_points else ()
        if left_out:
            log.warning("pair %d contradicts the others and was left out", left_out[0] + 1)
        others = list(zip(self._others(), fits[1:], strict=False))
        progress(0.98, "writing")
        with write_transaction():
            write_camera(self.output, best.camera)
            for path, fit in others:
                write_camera(path, fit.camera)
            if self.overlay:
                write_picture(self.overlay, self._picture(capture, faces, fits, pairs, left_out))
        progress(1.0, "done")
        residuals = None if pairs is None else reprojection_errors(best.camera, *pairs).round(2).tolist()
        text = f"{self.output}: {quality}; lens of {best.camera.focal_35mm:.0f} mm"
        facts = round(best.outline, 2), round(best.degrees, 1), round(best.overlap, 4), poor or turned_over, turned_over
        numbers, files = [number + 1 for number in left_out] or None, [str(path) for path, _ in others] or None
        return CameraFound(self.output, *facts, residuals, numbers, files, text=text)

    def _warn(self, fits: "list[Fit]", quality: Note, turned_over: bool, poor: bool) -> None:
        """Warn of a fit that may be wrong."""
        if turned_over:
            log.error(
                "the mirror image of the mesh fits better than the mesh; if an export or import turned one of its axes "
                "over, so that its left is on the right, mirror it [mirrored-mesh]"
            )
        elif poor:
            log.error("%s; look at the overlay, and give points, or another mask or mesh [poor-alignment]", quality)
        elif len(fits) > 1 and fits[1].cost < AMBIGUOUS * fits[0].cost:
            words = "another view fits nearly as well, that of %s; look at the overlay, give points if it is wrong "
            log.warning(words + "[poor-alignment]", self._others()[0].name)

    def _picture(
        self,
        capture: "Capture",
        faces: "MeshFaces",
        fits: "list[Fit]",
        pairs: "tuple[F64, F64] | None",
        left_out: tuple[int, ...],
    ) -> "F32":
        import numpy as np

        from mpsnet_core.estimate.alignment.overlay import overlay
        from mpsnet_core.scene.pictures import contact_sheet

        crop = replace(_ObjectCrop.of(capture.mask), factor=1)
        here = crop.rows, crop.columns
        image, mask = capture.image[here].astype(np.float32, copy=False), capture.mask[here]
        if pairs is not None:
            pairs = pairs[0] - (crop.columns.start, crop.rows.start), pairs[1]
        pictures = [overlay(image, mask, faces.scene, crop.camera(fit.camera), pairs, left_out) for fit in fits]
        if len(fits) == 1:
            return pictures[0]
        titles = [f"{number}: {_quality(fit, capture.mask)}" for number, fit in enumerate(fits, 1)]
        titled = list(zip(titles, pictures, strict=True))
        return contact_sheet(titled, CANDIDATES, 720)

    def _others(self) -> list[Path]:
        """Camera files of the next best views."""
        if self.points or self.start:
            return []
        output = Path(self.output)
        return [output.with_name(f"{output.stem}_{number}{output.suffix}") for number in range(2, CANDIDATES + 1)]


def _check_size(mask: "Bools") -> None:
    """Raise GeometryError if the object is too small on the coarsest scale."""
    from mpsnet_core.arrays.mask_regions import bounding_box
    from mpsnet_core.estimate.alignment.refine import SCALES

    height, width = (side.stop - side.start for side in bounding_box(mask))
    if min(height, width) * min(1.0, SCALES[0][0] / max(height, width)) < MIN_SIDE:
        raise GeometryError(f"the object is {width} x {height} pixels, too few to align a mesh; take a larger photo")


def _is_poor(fit: "Fit", mask: "Bools") -> bool:
    from mpsnet_core.arrays.mask_regions import bounding_box

    longer = max(side.stop - side.start for side in bounding_box(mask))
    return fit.outline > POOR_OUTLINE * longer or fit.degrees > POOR_DEGREES or fit.overlap < POOR_OVERLAP


def fit_in_words(outline_pixels: float, normals_degrees: float, overlap: float, poor: bool) -> Note:
    """How well the mesh fits the photo, by these facts of a :class:`CameraFound`.

    The normals of a good fit differ, too, by what the mesh lacks and the estimate errs: their angle tells of poor ones.
    """
    if not poor:
        return Note("good fit: outlines %.1f pixels apart, %.0f%% shared", outline_pixels, 100 * overlap)
    words = "poor fit: outlines %.1f pixels and normals %.0f° apart, %.0f%% shared"
    return Note(words, outline_pixels, normals_degrees, 100 * overlap, level="stop")


def _quality(fit: "Fit", mask: "Bools") -> Note:
    return fit_in_words(fit.outline, fit.degrees, fit.overlap, _is_poor(fit, mask))


@dataclass(frozen=True)
class _ObjectCrop:
    """The part of a photo with the object and a margin, reduced by an integer factor."""

    rows: slice
    """Its rows in the photo."""
    columns: slice
    """Its columns in the photo."""
    factor: int
    """The factor."""
    width: int
    """Width of the photo."""
    height: int
    """Height of the photo."""

    @classmethod
    def of(cls, mask: "Bools") -> "_ObjectCrop":
        from mpsnet_core.arrays.mask_regions import bounding_box
        from mpsnet_core.estimate.alignment.refine import MARGIN

        margin = round(MARGIN * max(side.stop - side.start for side in bounding_box(mask)))
        box = zip(bounding_box(mask, margin), mask.shape, strict=True)
        rows, columns = (slice(*side.indices(length)) for side, length in box)
        longer = max(rows.stop - rows.start, columns.stop - columns.start)
        return cls(rows, columns, -(-longer // LONGEST), mask.shape[1], mask.shape[0])

    def capture(self, capture: "Capture") -> "Capture":
        import numpy as np

        from mpsnet_core.arrays.resampling import block_means

        factor, here = self.factor, (self.rows, self.columns)
        image, mask, clipped, depth = capture.image[here], capture.mask[here], capture.clipped, capture.depth
        if factor > 1:
            image = block_means(image, factor)
            mask = block_means(mask[..., None].astype(np.float32), factor)[..., 0] >= 0.5
        if clipped is not None:
            clipped = block_means(clipped[here].astype(np.float32), factor) > 0
        if depth is not None:  # of a plane, so subsampling is exact enough
            depth = depth[here][::factor, ::factor]
        camera = None if capture.camera is None else self.camera(capture.camera)
        return replace(capture, image=image, mask=mask, camera=camera, depth=depth, clipped=clipped)

    def camera(self, camera: "Camera") -> "Camera":
        """The camera of the part, from the camera of the photo."""
        width, height = (side.stop - side.start for side in (self.columns, self.rows))
        return camera.cropped(self.columns.start, self.rows.start, width, height, self.factor)

    def whole(self, fit: "Fit") -> "Fit":
        """The fit in the photo, from the fit in the part."""
        centre = fit.camera.centre * self.factor + (self.columns.start, self.rows.start)
        focal = fit.camera.focal * self.factor
        camera = replace(fit.camera, width=self.width, height=self.height, focal=focal, centre=centre)
        return replace(fit, camera=camera, outline=fit.outline * self.factor)


def _of_size(camera: "Camera", width: int, height: int, what: Literal["start", "lens"]) -> "Camera":
    """A given perspective camera, scaled to the photo's size.

    If the aspect ratios are equal, the principal point is kept, for example of a cropped photo. If not, a start, such
    as a viewport's view, gets the photo's centre, and a lens is rejected.
    """
    import numpy as np

    if camera.projection != "perspective":
        raise GeometryError(f"the {what} is an orthographic camera; give a perspective camera")
    if camera.focal.max() > SQUARE * camera.focal.min():
        along_x, along_y = camera.focal
        raise GeometryError(
            f"the {what}'s focal lengths are {along_x:g} along x and {along_y:g} along y, but align supports "
            f"square pixels only; resize the photo so that they are square, and give a {what} with one focal length"
        )
    scale = max(width, height) / max(camera.width, camera.height)
    size = np.array([width, height])
    one_shape = np.abs(size - scale * np.array([camera.width, camera.height])).max() <= max(1, scale)
    if what == "lens" and not one_shape:
        raise GeometryError(
            f"the lens is that of a photo of {camera.width} x {camera.height} pixels, but this one has {width} x "
            f"{height}; give the camera file of a photo with the same size, crop and orientation"
        )
    centre = camera.centre * scale if one_shape else size / 2
    return replace(camera, width=width, height=height, focal=np.full(2, camera.focal.mean() * scale), centre=centre)


def _contradicts(camera: "Camera", by_points: "PointFit", pixels: "F64", points: "F64") -> bool:
    """Whether a refined camera's reprojection error of the pairs is larger than errors of clicking explain."""
    import numpy as np

    from mpsnet_core.estimate.alignment.points import PIXEL_ERROR, reprojection_errors

    used = np.array([number not in by_points.left_out for number in range(len(points))])
    before = float(np.sqrt(np.mean(by_points.residuals[used] ** 2)))
    after = float(np.sqrt(np.mean(reprojection_errors(camera, pixels, points)[used] ** 2)))
    return after > 3 * max(before, PIXEL_ERROR * max(camera.width, camera.height) / 1024)
