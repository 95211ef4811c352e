"""The operations ``cameras`` (import from photogrammetry), ``compare`` (normals with true ones) and ``preview`` (the
three lights on a mesh)."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from mpsnet_core.defaults import ENCODINGS
from mpsnet_core.errors import SettingsError
from mpsnet_core.operation import Operation, Result, convention_option, option, optional
from mpsnet_core.progress import Progress, silent

if TYPE_CHECKING:
    from mpsnet_core.scene.mesh import Mesh
    from mpsnet_core.scene.view_photos import ViewPhoto


# Lengths in metres.
UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254, "ft": 0.3048}


@dataclass(frozen=True)
class TakesMesh(Operation):
    """Where mesh files stand in the cameras' world."""

    heading: ClassVar[str] = "the mesh in the camera's world"

    up: Literal["z", "y"] = option(
        default="z",
        choices={
            "z": "its axes are those of the camera's world",
            "y": "turned to z up, as Blender imports OBJ and glTF",
        },
        help="which axis of the mesh file points up",
    )
    unit: str = option(
        default="1",
        metavar="LENGTH|mm|cm|m|in|ft",
        help="length of the mesh file's unit, in the camera's unit; or a name, if the camera's unit is the metre",
        numbers=True,
    )

    def unit_length(self) -> float:
        """The length of the mesh file's unit. Raises SettingsError if it is invalid."""
        try:
            length = UNITS[self.unit] if self.unit in UNITS else float(self.unit)
        except ValueError:
            length = 0.0
        if not 1e-9 <= length <= 1e9:
            raise SettingsError(f"--unit {self.unit} is not a length; give {', '.join(UNITS)}, or a number above 0")
        return length

    def read_mesh(self, path: "str | Path", *, shape_only: bool = False) -> "Mesh":
        """See :func:`mpsnet_core.scene.mesh.read_mesh`."""
        from mpsnet_core.scene.mesh import read_mesh

        return read_mesh(path, shape_only=shape_only, up=self.up, unit=self.unit_length())


@dataclass(frozen=True)
class CamerasWritten(Result):
    """Cameras of photogrammetry as camera files."""

    folder: str
    """Folder of the files."""
    cameras: list[str]
    """The camera files."""
    photos: int
    """Number of photos that were undistorted."""


@dataclass(frozen=True)
class ReadsPictures(Operation):
    """How the values of images are interpreted."""

    heading: ClassVar[str] = "how photos are read"

    encoding: Literal["auto", "linear", "srgb"] = option(
        default="auto", choices=ENCODINGS, help="how the photo's values encode light"
    )


@dataclass(frozen=True)
class WriteCameras(ReadsPictures):
    """Convert cameras from photogrammetry to camera files, and undistort their photos."""

    command: ClassVar[str] = "cameras"

    cameras: str = option(
        positional=True, help="COLMAP's folder, Metashape's .xml, Meshroom's .sfm", provenance="files"
    )
    photos: str = option(metavar="FOLDER", help="the photos, one for each camera", provenance="files")
    output: str = option(
        metavar="FOLDER",
        help="folder for NAME.camera.json and, where the lens distorts, the undistorted photo NAME.exr",
        provenance="none",
    )

    def run(self, progress: Progress = silent) -> CamerasWritten:
        """Write a camera file for each photo, and the undistorted photo if its lens has distortion."""
        from mpsnet_core.io.files import check_no_overwrite, ensure_folder
        from mpsnet_core.scene.camera import write_camera
        from mpsnet_core.scene.view_photos import CAMERA_SUFFIX, posed_photos

        views = posed_photos(self.cameras, self.photos)
        folder = ensure_folder(self.output, "cameras")
        check_no_overwrite([view.photo for view in views], [folder / f"{view.name}.exr" for view in views])
        corrected_photos = 0
        for number, view in enumerate(views):
            progress(number / len(views), view.name)
            camera = folder / f"{view.name}{CAMERA_SUFFIX}"
            if view.lens is None:
                write_camera(camera, view.camera)
                continue
            self._undistort(view, camera, folder / f"{view.name}.exr")
            corrected_photos += 1
        progress(1.0, "done")
        lenses = f", {corrected_photos} photo(s) undistorted" if corrected_photos else ", without distortion"
        names, text = [f"{view.name}{CAMERA_SUFFIX}" for view in views], f"{folder}: {len(views)} camera(s){lenses}"
        return CamerasWritten(str(folder), names, corrected_photos, text=text)

    def _undistort(self, view: "ViewPhoto", camera: Path, photo: Path) -> None:
        """Write the camera and the undistorted photo, both or neither."""
        import numpy as np

        from mpsnet_core.io.files import prefix_errors, write_transaction
        from mpsnet_core.io.image import Image, warn_of_saturation
        from mpsnet_core.io.image_reading import read_image
        from mpsnet_core.io.image_writing import write_photo
        from mpsnet_core.scene.camera import write_camera
        from mpsnet_core.scene.photogrammetry.posed_photo import undistorted, undistorted_mask

        assert view.lens is not None
        with prefix_errors(view.photo):
            image = read_image(view.photo, encoding=self.encoding)
            warn_of_saturation(view.photo, image)
            pixels = undistorted(image.pixels, view.camera, view.lens)
            shown = np.ones(image.pixels.shape[:2], bool) if image.alpha is None else image.alpha > 0.5
            alpha = undistorted_mask(shown, view.camera, view.lens)
        with write_transaction():
            write_camera(camera, view.camera)
            write_photo(photo, Image(pixels, alpha.astype(np.float32), np.inf, assumed=image.assumed), bits=16)


@dataclass(frozen=True)
class NormalsCompared(Result):
    """The angles between two normal maps."""

    output: str | None
    """File of the error image, if requested."""
    mean: float
    """Mean error, in degrees."""
    median: float
    """Median error, in degrees."""
    share: float
    """Fraction of the pixels with a normal that were compared."""


@dataclass(frozen=True)
class CompareNormals(Operation):
    """Compare normals with the true ones of the same view, and write an image of the angles between them."""

    command: ClassVar[str] = "compare"

    normals: str = option(positional=True, help="estimated normal map, in camera space")
    truth: str = option(
        help="the true normal map; with --camera, Blender's OpenEXR with the passes Normal and Combined"
    )
    camera: str | None = optional(
        "camera file of the view, if the true normals are in world space", unset="they are in camera space"
    )
    convention: Literal["opengl", "directx"] = convention_option(default="opengl", of="the normal map")
    truth_convention: Literal["opengl", "directx"] = convention_option(default="opengl", of="the true normal map")
    output: str | None = optional("image of the errors: .png, .tif or .exr", metavar="FILE")

    def run(self, progress: Progress = silent) -> NormalsCompared:
        """Compare them, and write the error image if requested."""
        from mpsnet_core.io.files import check_no_overwrite, writable_image
        from mpsnet_core.io.image_writing import write_picture_bands
        from mpsnet_core.scene.normal_errors import errors_inside, read_true_normals
        from mpsnet_core.scene.normal_map import read_normals
        from mpsnet_core.scene.pictures import scaled_error_bands

        if self.output:
            writable_image(self.output)
            check_no_overwrite([file for file in (self.normals, self.truth, self.camera) if file], [self.output])
        progress(0.0, "reading the normals")
        estimate = read_normals(self.normals, convention=self.convention)
        mask, inside = estimate.mask, estimate.vectors[estimate.mask]
        del estimate  # two large photos' normals take much memory
        truth = read_true_normals(self.truth, self.camera, convention=self.truth_convention)
        errors = errors_inside(mask, inside, truth)
        if self.output:
            progress(0.6, f"writing {Path(self.output).name}")
            write_picture_bands(self.output, *scaled_error_bands(errors.degrees, errors.mask))
        progress(1.0, "done")
        share = float(errors.mask.sum() / mask.sum())
        text = f"{self.normals}: mean {errors.mean:.2f}°, median {errors.median:.2f}°, over {share:.1%} of its pixels"
        return NormalsCompared(self.output, round(errors.mean, 3), round(errors.median, 3), round(share, 4), text=text)


@dataclass(frozen=True)
class LightsPreviewed(Result):
    """The lights on a mesh."""

    output: str
    """File of the image."""
    shares: list[float]
    """(4,). Fractions of the mesh's pixels that no light, one, two and three lights reach."""


@dataclass(frozen=True)
class PreviewLights(TakesMesh):
    """The three lights on a mesh: its photo if it were matt and white, beside it how many lights reach each pixel.

    On the right are the normals as colours where three lights reach, orange where two do, red where one does, and black
    elsewhere.
    """

    command: ClassVar[str] = "preview"
    listed: ClassVar[bool] = False  # Blender's panel shows it

    mesh: str = option(help="the object's mesh in the camera's world", path="file", provenance="content")
    rig: str = option(help="rig file (.json, or .lp with three lights)", path="file", provenance="content")
    camera: str = option(help="camera file", path="file", provenance="content")
    size: int = option(default=256, low=1, high=4096, metavar="PIXELS", help="the photo's longer side, at most")
    output: str = option(metavar="FILE", help="picture: .png or .tif; .npy for NumPy's arrays", provenance="none")

    def run(self, progress: Progress = silent) -> LightsPreviewed:
        """Ray trace the mesh, and write the image."""
        import numpy as np

        from mpsnet_core.arrays.resampling import reduced_shape
        from mpsnet_core.io.files import atomic_write, check_no_overwrite, prefix_errors, writable_image, writable_path
        from mpsnet_core.io.image_writing import write_picture
        from mpsnet_core.scene.camera import read_camera
        from mpsnet_core.scene.light_preview import lit_view
        from mpsnet_core.scene.rig import read_rig

        as_array = Path(self.output).suffix.lower() == ".npy"
        output = writable_path(self.output) if as_array else writable_image(self.output, 8)
        check_no_overwrite([self.mesh, self.rig, self.camera], [output])
        camera, rig = read_camera(self.camera), read_rig(self.rig)
        height, width = reduced_shape(camera.height, camera.width, self.size)
        progress(0.0, "reading the mesh")
        mesh = self.read_mesh(self.mesh, shape_only=True)
        progress(0.5, "tracing the lights")
        with prefix_errors(f"camera {self.camera}"):
            view = lit_view(camera.resized(width, height), rig, mesh)
        if as_array:
            with atomic_write(output) as unfinished, unfinished.open("wb") as file:
                np.save(file, view.picture())
        else:
            write_picture(output, view.picture())
        progress(1.0, "done")
        text = f"{self.output}: three lights reach {view.shares[3]:.1%} of what the camera sees"
        return LightsPreviewed(self.output, [round(share, 4) for share in view.shares], text=text)
