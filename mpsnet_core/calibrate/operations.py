"""Operations of calibration: light directions, positions and mixing from photos of balls and cards."""

from dataclasses import dataclass
from pkgutil import resolve_name
from typing import TYPE_CHECKING, ClassVar

from mpsnet_core.capture.operations import HasLens, ReadsPhotos, TakesLightPhotos
from mpsnet_core.operation import Result, option, optional, output_option
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.operations import TakesMesh

if TYPE_CHECKING:
    from mpsnet_core.calibrate.report import BallFacts, LightFacts

# Above this median difference between photo and fit, the mesh is probably not where the camera says.
POOR = 0.25


@dataclass(frozen=True)
class UsesBall(ReadsPhotos, HasLens):
    """The ball in the photo, the camera, and outputs besides the rig."""

    heading: ClassVar[str] = "the ball, and extra output files"

    circle: tuple[str, ...] = option(
        default=(),
        metavar="X,Y,R",
        help="the ball's outline, set by hand: centre from the photo's top left corner, and radius, in "
        "pixels; one for each ball, in order",
        unset="detected in the photo",
        numbers=True,
    )
    mask: str | None = optional("mask file, white on the ball or the card", provenance="files")
    radius: float | None = optional(
        "radius of the ball, in the unit wanted for the lights' positions, ideally the mesh's. Also needed "
        "for a grey ball, if the lights have positions",
        unset="positions are in radii of the ball",
    )
    overlay: str | None = output_option("write an image of the results, drawn over the photo", metavar="PNG")
    json: str | None = output_option("write the results as JSON")


# --- lights -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LightsCalibrated(Result):
    """File of the rig, and results."""

    output: str
    """File of the rig."""
    overlay: str | None
    """File of the photo with the results drawn over it, if requested."""
    lights: "list[LightFacts]"
    """Each light as it was found."""
    balls: "list[BallFacts] | None" = None
    """Each ball as it was found; None for lights from an .lp file."""
    target: list[float] | None = None
    """(3,) Centre of the lights' positions in camera space; None for lights from an .lp file."""


@dataclass(frozen=True)
class CalibrateLights(UsesBall):
    """Find the lights' directions or positions from photos of a mirror ball."""

    command: ClassVar[str] = "calibrate lights"

    ball: tuple[str, ...] = option(
        positional=True,
        help="photo(s) of a mirror ball under the red, green and blue light at once, one for each place of "
        "the ball, or an .lp file, from which --lights chooses three",
        provenance="files",
    )
    per_light: bool = option(
        default=False,
        help="each photo shows one light: three photos in the order red, green, blue, more in the order of "
        "their numbers (an .lp file takes any number of lights)",
    )
    places: int = option(
        default=1,
        low=1,
        help="with --per-light: number of places where the ball stood; give all photos of the first place first",
    )
    balls: int = option(default=1, low=1, help="how many mirror balls each photo shows")
    lights: str | None = optional(
        "with --per-light or an .lp file: numbers of the rig's red, green and blue light, counted from 1 "
        "in the order of the table",
        metavar="R,G,B",
        numbers=True,
    )
    distant: bool = option(default=False, help="write directions even where positions could be found")
    output: str = option(metavar="RIG", help="rig file (.json), or .lp of any number of lights", provenance="none")

    def run(self, progress: Progress = silent) -> LightsCalibrated:
        """Write the rig, and the other outputs if requested."""
        return resolve_name("mpsnet_core.calibrate.calibration:calibrate_lights")(self, progress)


# --- mixing -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MixingCalibrated(Result):
    """File of the rig with its mixing, and results as in :class:`mpsnet_core.MixingFound`."""

    output: str
    """File of the rig."""
    overlay: str | None
    """File of the photo with the results drawn over it, if requested."""
    mixing: list[list[float]]
    """3 x 3. The mixing matrix: a row for each camera channel, a column for each light."""
    residual: float
    """RMS residual of the fit, as a share of the mean brightness."""
    ambient: list[float]
    """(3,) Ambient light, in the unit of the matrix."""
    pixels: int
    """Number of pixels used."""
    left_out: float
    """Share of these that are outliers."""
    determined: bool
    """Whether the photo determines the whole matrix, not only the lights' strengths."""
    uncertainty: float
    """Largest standard deviation of the off-diagonal entries."""
    equation_2_error: float | None
    """Mean angular error of the Lambertian model (equation 2) on the ball, in degrees; None for a card."""
    balls: "list[BallFacts]"
    """Each ball as it was found; empty for a card."""


@dataclass(frozen=True)
class CalibrateMixing(UsesBall):
    """Find the mixing matrix from photos of a grey ball or card."""

    command: ClassVar[str] = "calibrate mixing"

    photo: tuple[str, ...] = option(
        positional=True,
        help="a photo of a matt grey ball under all three lights, or three, each under one light, in the rig's order",
        provenance="files",
    )
    rig: str = option(help="rig file with the lights' directions or positions", provenance="content")
    card: bool = option(default=False, help="the photos show a flat grey card, one photo per light")
    normal: str | None = optional(
        "direction that the card faces, in camera space", metavar="X,Y,Z", unset="towards the camera", numbers=True
    )
    output: str = option(metavar="RIG", help="rig file with the mixing (.json)", provenance="none")

    def run(self, progress: Progress = silent) -> MixingCalibrated:
        """Write the rig with its mixing, and the other outputs if requested."""
        return resolve_name("mpsnet_core.calibrate.calibration:calibrate_mixing")(self, progress)


# --- words and files --------------------------------------------------------------------------------------------------


# --- a mesh -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MeshCalibrated(Result):
    """The lights that fit a photo of a known mesh, and the file of their rig."""

    output: str
    """The rig file."""
    lights: "list[LightFacts]"
    """The lights, in the order of the camera's channels."""
    residual: float
    """Median relative difference between the photo and its fit."""
    paints: int
    """Number of paints of the object that were told apart."""


@dataclass(frozen=True)
class CalibrateMesh(TakesMesh, TakesLightPhotos):
    """Find the lights' directions and crosstalk from a photo of an object whose mesh is known.

    Any matt object with a scan, or a model that was printed, is a calibration target. Its paint may vary.
    """

    command: ClassVar[str] = "calibrate mesh"

    image: tuple[str, ...] = option(
        positional=True, help="photo of the object under the three lights, or three with --per-light"
    )
    mesh: str = option(help="the object's mesh in the camera's world", path="file")
    camera: str = option(help="camera file of the photo, as `mpsnet align` writes it", path="file")

    def run(self, progress: Progress = silent) -> MeshCalibrated:
        """Write the rig file."""
        return resolve_name("mpsnet_core.calibrate.calibration:calibrate_mesh")(self, progress)
