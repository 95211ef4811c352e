"""Angular errors of estimated normals, pixel by pixel."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.defaults import Convention
from mpsnet_core.errors import FormatError, GeometryError, SettingsError
from mpsnet_core.io.files import check_no_overwrite, writable_image
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image_reading import image_layers, read_data
from mpsnet_core.io.image_writing import write_picture_bands
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.shown import Shown
from mpsnet_core.progress import Progress
from mpsnet_core.scene import operations
from mpsnet_core.scene.camera import read_camera
from mpsnet_core.scene.normal_map import NormalMap, read_normals
from mpsnet_core.scene.pictures import scaled_error_bands


@dataclass(frozen=True, eq=False, repr=False)
class NormalErrors(Shown):
    """Angular errors between two normal maps."""

    array_name: ClassVar[str] = "degrees"

    degrees: F32
    """(H, W) float32. Angles in degrees."""
    mask: Bools
    """(H, W) bool. Where both normals are known; not empty."""

    def facts(self) -> str:
        return f"mean {self.mean:.2f}°, median {self.median:.2f}°, over {self.mask.sum():,} pixels"

    def picture(self, step: int = 1) -> F32:
        from mpsnet_core.scene.pictures import scaled_error_bands

        return scaled_error_bands(self.degrees[::step, ::step], self.mask[::step, ::step])[1](slice(None))

    @property
    def mean(self) -> float:
        return float(self.degrees[self.mask].mean(dtype=np.float64))

    @property
    def median(self) -> float:
        return float(np.median(self.degrees[self.mask], overwrite_input=True))


def read_true_normals(path: AnyPath, camera: AnyPath | None = None, *, convention: Convention = "opengl") -> NormalMap:
    """True normals in camera space, from a normal map or, with a camera file, from a render's passes in world space.

    convention: of the normal map's green channel.

    Such a render is an OpenEXR file with the layers Normal and Combined, as Blender writes it. Pixels that the object
    covers only partly are left out, because the pass is averaged with the background there. Non-finite values are left
    out, too.

    Raises InputError if a file cannot be read or lacks a layer.
    """
    if camera is None:
        try:
            return read_normals(path, convention=convention)
        except FormatError:
            if any(layer.split(".")[-1] == "Normal" for layer in image_layers(path)):
                raise SettingsError(
                    f"{path} is a render whose pass Normal is in the world's axes; give the view's camera file too "
                    "(--camera)"
                ) from None
            raise
    if convention != "opengl":
        raise SettingsError(f"{path} with a camera is a render's passes, without a convention; leave one of them out")
    world, _ = read_data(path, layer="Normal")
    _, alpha = read_data(path, layer="Combined")
    if alpha is None:
        raise GeometryError(f"{path}: its layer Combined has no alpha, which shows the object; render it again")
    known = (alpha > 0.99) & world.any(axis=-1) & np.isfinite(world).all(axis=-1)
    return NormalMap(world @ read_camera(camera).rotation.astype(np.float32), known)


@takes_files
def normal_errors(estimate: NormalMap, truth: NormalMap) -> NormalErrors:
    """The angles between two normal maps of one view.

    Raises
    ------
    GeometryError
        If they cannot be of the same view.
    """
    return errors_inside(estimate.mask, estimate.vectors[estimate.mask], truth)


def errors_inside(mask: Bools, inside: F32, truth: NormalMap) -> NormalErrors:
    """:func:`normal_errors` of an estimate of which only the normals inside its mask, (N, 3), are available."""
    sizes = [f"{shown.shape[1]} x {shown.shape[0]}" for shown in (mask, truth.mask)]
    if sizes[0] != sizes[1]:
        raise GeometryError(f"the normals are {sizes[0]} but the true ones {sizes[1]}; they must show one view")
    both = mask & truth.mask
    if not both.any():
        raise GeometryError("no pixel has both a normal and a true one; they must show the same object in one view")
    degrees, done = np.zeros(both.shape, np.float32), 0
    for rows in bands(len(both)):
        count, shared = np.count_nonzero(mask[rows]), both[rows]
        estimated = inside[done : done + count][shared[mask[rows]]]
        degrees[rows][shared] = angular_error(estimated, truth.vectors[rows][shared])
        done += count
    return NormalErrors(degrees, both)


def compare_normals(options: operations.CompareNormals, progress: Progress) -> operations.NormalsCompared:
    """Compare them, and write the error image if requested."""
    if options.output:
        writable_image(options.output)
        check_no_overwrite(
            [file for file in (options.normals, options.truth, options.camera) if file], [options.output]
        )
    progress(0.0, "reading the normals")
    estimate = read_normals(options.normals, convention=options.convention)
    mask, inside = estimate.mask, estimate.vectors[estimate.mask]
    del estimate  # two large photos' normals take much memory
    truth = read_true_normals(options.truth, options.camera, convention=options.truth_convention)
    errors = errors_inside(mask, inside, truth)
    if options.output:
        progress(0.6, f"writing {Path(options.output).name}")
        write_picture_bands(options.output, *scaled_error_bands(errors.degrees, errors.mask))
    progress(1.0, "done")
    share = float(errors.mask.sum() / mask.sum())
    text = f"{options.normals}: mean {errors.mean:.2f}°, median {errors.median:.2f}°, over {share:.1%} of its pixels"
    return operations.NormalsCompared(
        options.output, round(errors.mean, 3), round(errors.median, 3), round(share, 4), text=text
    )
