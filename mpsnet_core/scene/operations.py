"""The operations ``cameras`` (import from photogrammetry), ``compare`` (normals with true ones) and ``preview`` (the
three lights on a mesh)."""

from dataclasses import dataclass
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, ClassVar, Literal

from mpsnet_core.defaults import ENCODINGS
from mpsnet_core.errors import SettingsError
from mpsnet_core.operation import Operation, Result, convention_option, option, optional
from mpsnet_core.progress import Progress, silent

if TYPE_CHECKING:
    from mpsnet_core.scene.mesh import Mesh


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
        return resolve_name("mpsnet_core.scene.view_photos:write_cameras")(self, progress)


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
        return resolve_name("mpsnet_core.scene.normal_errors:compare_normals")(self, progress)


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
        return resolve_name("mpsnet_core.scene.light_preview:preview_lights")(self, progress)
