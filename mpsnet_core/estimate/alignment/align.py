"""Finding the camera of a photo from a mesh: the work of :class:`mpsnet_core.Align`."""

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from mpsnet_core.arrays.mask_regions import bounding_box
from mpsnet_core.arrays.resampling import block_means
from mpsnet_core.arrays.types import F32, F64, Bools
from mpsnet_core.capture.capture import Capture
from mpsnet_core.capture.open import Source, open_captures
from mpsnet_core.errors import GeometryError, Note, SettingsError
from mpsnet_core.estimate.alignment.operations import Align, CameraFound, fit_in_words
from mpsnet_core.estimate.alignment.overlay import overlay
from mpsnet_core.estimate.alignment.points import (
    PIXEL_ERROR,
    USUAL_FOCAL,
    PointFit,
    camera_from_points,
    read_pairs,
    reprojection_errors,
)
from mpsnet_core.estimate.alignment.pose import MeshFaces
from mpsnet_core.estimate.alignment.refine import MARGIN, SCALES, Fit, PhotoPyramid, measure_fit, refine_camera
from mpsnet_core.estimate.alignment.search import find_better_mirrored, move_onto_mask, search_cameras
from mpsnet_core.estimate.lights.find import with_lights
from mpsnet_core.io.files import check_no_overwrite, writable_image, writable_path, write_transaction
from mpsnet_core.io.focal_length import stated_focal
from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.progress import Progress, part
from mpsnet_core.scene.camera import FULL_FRAME, Camera, read_camera, write_camera
from mpsnet_core.scene.mesh import world_from_file
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.pictures import contact_sheet
from mpsnet_core.scene.rig import read_rig

log = logging.getLogger(__name__)

# Pixels of the object's longer side to fit to, at most. More would not help: errors of the estimate dominate.
LONGEST = 640
# A fit is poor if the outlines differ by this share of the object's longer side, or the normals by this many degrees,
# or if mesh and mask overlap less than this.
POOR_OUTLINE, POOR_DEGREES, POOR_OVERLAP = 0.005, 35.0, 0.9
# Another view whose cost is below this multiple of the best might be the right one.
AMBIGUOUS = 1.3
MIN_SIDE = 4  # pixels of the object's shorter side on the coarsest scale
CANDIDATES = 3
# Focal lengths along x and y that differ by at most this factor count as equal: photogrammetry fits both.
SQUARE = 1.005


def align(options: Align, progress: Progress) -> CameraFound:
    """Write the camera file, and the overlay if requested."""
    if options.points and options.start:
        raise SettingsError("points and start both place the camera; give one of them")
    if options.lens and options.focal is not None:
        raise SettingsError("--lens and --focal both define the lens; give one of them")
    outputs = [Path(options.output), *([Path(options.overlay)] if options.overlay else []), *_others(options)]
    inputs = options.inputs(options.image, options.rig, options.mesh, options.points, options.lens, mask=options.mask)
    check_no_overwrite(inputs, outputs)  # the start may be overwritten, to refine it in place
    writable_path(options.output)
    if options.overlay:
        writable_image(options.overlay)
    pairs = _pairs(options)
    progress(0.0, f"reading {Path(options.image).name}")
    capture = _capture(options)
    _check_size(capture.mask)
    faces = MeshFaces.of(options.read_mesh(options.mesh, shape_only=True))
    fits, point_fit, turned_over = _fits(options, capture, faces, pairs, progress)
    return _written(options, capture, faces, fits, pairs, point_fit, turned_over, progress)


def _pairs(options: Align) -> tuple[F64, F64] | None:
    """The pairs of points, those on the mesh in world space."""
    if not options.points:
        return None
    pixels, points = read_pairs(options.points)
    return pixels, points @ world_from_file(options.up, options.unit_length())[:3, :3].T


def _capture(options: Align) -> Capture:
    lens = read_camera(options.lens) if options.lens else None
    focal = options.focal if lens is None else lens.focal_35mm  # provisional, until the photo's size is known
    source = Source(Path(options.image), read_rig(options.rig) if options.rig else None, options.mask, camera=focal)
    source, _ = with_lights(source, [source], options.read_options())
    [capture] = open_captures([source], options.read_options())
    if lens is None:
        return capture
    height, width = capture.mask.shape
    return replace(capture, camera=_of_size(lens, width, height, "lens"))


def _stated_focal(options: Align) -> float | None:
    """The 35 mm equivalent focal length that the photo's EXIF data state, None if they state none of use."""
    focal = stated_focal(options.image)
    if focal is not None:
        name = Path(options.image).name
        log.info("%s states a lens of %.0f mm, where the search starts; give the lens if it is another", name, focal)
    return focal


def _fits(
    options: Align, capture: Capture, faces: MeshFaces, pairs: tuple[F64, F64] | None, progress: Progress
) -> tuple[list[Fit], PointFit | None, bool]:
    """The best fits, the fit of the pairs alone, and whether the mirror image of the mesh fits better."""
    height, width = capture.mask.shape
    lens, fixed = capture.camera, capture.camera is not None
    stated = None if fixed or options.start else _stated_focal(options)
    likely = stated / FULL_FRAME if stated else USUAL_FOCAL
    by_points = None if pairs is None else camera_from_points(*pairs, width, height, lens, usual_focal=likely)
    rough = by_points.camera if by_points else None
    if options.start is not None:
        rough = _of_size(read_camera(options.start), width, height, "start")
        if lens is not None:
            rough = replace(rough, focal=lens.focal, centre=lens.centre if options.lens else rough.centre)
    crop = _ObjectCrop.of(capture.mask)
    mask = crop.mask(capture.mask)
    # The shares of the time after which the normals are estimated and the camera is found: a search takes longest.
    estimated, found = (0.12, 0.955) if rough is None else (0.4, 0.9)
    estimate = PhotoPyramid(_estimate(options, capture, crop, mask, part(progress, 0.05, estimated)))
    rest = part(progress, estimated, found)
    if rough is None:
        free = Camera("perspective", width, height, np.full(2, max(height, width) * likely))
        begin = crop.camera(lens or free)
        usual = float(begin.focal[0]) * USUAL_FOCAL / likely if stated else None
        fits = search_cameras(estimate, faces, begin, CANDIDATES, fix_focal=fixed, usual_focal=usual, progress=rest)
    else:
        begin = crop.camera(rough)
        if by_points is None:
            begin = move_onto_mask(estimate, faces, begin).camera
        fits = [refine_camera(estimate, faces, begin, fix_focal=fixed, progress=rest)]
    best = fits[0]
    if by_points and pairs and _contradicts(crop.whole(fits[0]).camera, by_points, *pairs):
        log.warning("the mesh contradicts the pairs of points; the camera is found from the pairs alone")
        fits = [measure_fit(estimate, faces, begin)]
        best = min(best, fits[0], key=lambda fit: fit.cost)
    mirrored = part(progress, found, 0.98, "comparing with the mirrored mesh")
    image = find_better_mirrored(estimate, faces, best, mirrored)
    turned_over = image is not None and not _is_poor(image, mask)
    return [crop.whole(fit) for fit in fits], by_points, turned_over


def _estimate(options: Align, capture: Capture, crop: "_ObjectCrop", mask: Bools, progress: Progress) -> NormalMap:
    """The normals of a part with this mask; of a large one at half its size, as only outlines need each pixel."""
    ratio = 2 if _longer_side(mask) > SCALES[-1][0] else 1
    vectors = options.estimator(1)(replace(crop, factor=ratio * crop.factor).capture(capture), progress).vectors
    height, width = mask.shape
    return NormalMap(vectors.repeat(ratio, axis=0).repeat(ratio, axis=1)[:height, :width], mask)


def _written(
    options: Align,
    capture: Capture,
    faces: MeshFaces,
    fits: list[Fit],
    pairs: tuple[F64, F64] | None,
    by_points: PointFit | None,
    turned_over: bool,
    progress: Progress,
) -> CameraFound:
    best = fits[0]
    poor, quality = _is_poor(best, capture.mask), _quality(best, capture.mask)
    _warn(options, fits, quality, turned_over, poor)
    left_out = by_points.left_out if by_points else ()
    if left_out:
        log.warning("pair %d contradicts the others and was left out", left_out[0] + 1)
    others = list(zip(_others(options), fits[1:], strict=False))
    progress(0.98, "writing")
    with write_transaction():
        write_camera(options.output, best.camera)
        for path, fit in others:
            write_camera(path, fit.camera)
        if options.overlay:
            write_picture(options.overlay, _picture(options, capture, faces, fits, pairs, left_out))
    progress(1.0, "done")
    residuals = None if pairs is None else reprojection_errors(best.camera, *pairs).round(2).tolist()
    text = f"{options.output}: {quality}; lens of {best.camera.focal_35mm:.0f} mm"
    facts = round(best.outline, 2), round(best.degrees, 1), round(best.overlap, 4), poor or turned_over, turned_over
    numbers, files = [number + 1 for number in left_out] or None, [str(path) for path, _ in others] or None
    return CameraFound(options.output, *facts, residuals, numbers, files, text=text)


def _warn(options: Align, fits: list[Fit], quality: Note, turned_over: bool, poor: bool) -> None:
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
        log.warning(words + "[poor-alignment]", _others(options)[0].name)


def _picture(
    options: Align,
    capture: Capture,
    faces: MeshFaces,
    fits: list[Fit],
    pairs: tuple[F64, F64] | None,
    left_out: tuple[int, ...],
) -> F32:
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


def _others(options: Align) -> list[Path]:
    """Camera files of the next best views."""
    if options.points or options.start:
        return []
    output = Path(options.output)
    return [output.with_name(f"{output.stem}_{number}{output.suffix}") for number in range(2, CANDIDATES + 1)]


def _check_size(mask: Bools) -> None:
    """Raise GeometryError if the object is too small on the coarsest scale."""
    height, width = (side.stop - side.start for side in bounding_box(mask))
    if min(height, width) * min(1.0, SCALES[0][0] / max(height, width)) < MIN_SIDE:
        raise GeometryError(f"the object is {width} x {height} pixels, too few to align a mesh; take a larger photo")


def _longer_side(mask: Bools) -> int:
    """Pixels of the object's longer side."""
    return max(side.stop - side.start for side in bounding_box(mask))


def _is_poor(fit: Fit, mask: Bools) -> bool:
    longer = _longer_side(mask)
    return fit.outline > POOR_OUTLINE * longer or fit.degrees > POOR_DEGREES or fit.overlap < POOR_OVERLAP


def _quality(fit: Fit, mask: Bools) -> Note:
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
    def of(cls, mask: Bools) -> "_ObjectCrop":
        longer = _longer_side(mask)
        box = zip(bounding_box(mask, round(MARGIN * longer)), mask.shape, strict=True)
        rows, columns = (slice(*side.indices(length)) for side, length in box)
        return cls(rows, columns, -(-longer // LONGEST), mask.shape[1], mask.shape[0])

    def mask(self, mask: Bools) -> Bools:
        """The part of the photo's mask: the pixels of which half are inside."""
        part = mask[self.rows, self.columns]
        return block_means(part[..., None].astype(np.float32), self.factor)[..., 0] >= 0.5

    def capture(self, capture: Capture) -> Capture:
        """The part of the photo."""
        factor, here = self.factor, (self.rows, self.columns)
        image, mask, clipped, depth = capture.image[here], self.mask(capture.mask), capture.clipped, capture.depth
        if factor > 1:
            image = block_means(image, factor)
        if clipped is not None:
            clipped = block_means(clipped[here].astype(np.float32), factor) > 0
        if depth is not None:  # of a plane, so subsampling is exact enough
            depth = depth[here][::factor, ::factor]
        camera = None if capture.camera is None else self.camera(capture.camera)
        return replace(capture, image=image, mask=mask, camera=camera, depth=depth, clipped=clipped)

    def camera(self, camera: Camera) -> Camera:
        """The camera of the part, from the camera of the photo."""
        width, height = (side.stop - side.start for side in (self.columns, self.rows))
        return camera.cropped(self.columns.start, self.rows.start, width, height, self.factor)

    def whole(self, fit: Fit) -> Fit:
        """The fit in the photo, from the fit in the part."""
        centre = fit.camera.centre * self.factor + (self.columns.start, self.rows.start)
        focal = fit.camera.focal * self.factor
        camera = replace(fit.camera, width=self.width, height=self.height, focal=focal, centre=centre)
        return replace(fit, camera=camera, outline=fit.outline * self.factor)


def _of_size(camera: Camera, width: int, height: int, what: Literal["start", "lens"]) -> Camera:
    """A given perspective camera, scaled to the photo's size.

    If the aspect ratios are equal, the principal point is kept, for example of a cropped photo. If not, a start, such
    as a viewport's view, gets the photo's centre, and a lens is rejected.
    """
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


def _contradicts(camera: Camera, by_points: "PointFit", pixels: "F64", points: "F64") -> bool:
    """Whether a refined camera's reprojection error of the pairs is larger than errors of clicking explain."""
    used = np.array([number not in by_points.left_out for number in range(len(points))])
    before = float(np.sqrt(np.mean(by_points.residuals[used] ** 2)))
    after = float(np.sqrt(np.mean(reprojection_errors(camera, pixels, points)[used] ** 2)))
    return after > 3 * max(before, PIXEL_ERROR * max(camera.width, camera.height) / 1024)
