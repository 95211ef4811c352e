"""Operations evaluate: one for each test of the models."""

from dataclasses import dataclass
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, ClassVar

from mpsnet_core.estimate.registry import DEFAULT_MODEL
from mpsnet_core.learning.evaluation import Measured
from mpsnet_core.learning.evaluation.published import OBJECTS
from mpsnet_core.operation import Operation, option, output_option
from mpsnet_core.progress import Progress, silent
from mpsnet_core.synthesis.job import MAX_BOUNCES

if TYPE_CHECKING:
    from mpsnet_core.learning.evaluation.evaluation import Evaluation


# The work is imported when it is done, and takes the operation.
_HERE = "mpsnet_core.learning.evaluation"

# Weights of a light's red, green and blue in a channel of the photo.
PROTOCOLS = {"separated": "its own alone", "published": "5/9 its own, 2/9 each of the others", "white": "all alike"}


def size_option(default: int) -> Any:
    """The option for the size of synthetic images."""
    return option(default=default, low=16, high=8192, help="side of a picture in pixels")


def white_option() -> Any:
    """The option to measure with a white photo as well."""
    return option(default=False, help="measure each once more with a white photo beside it")


def blobs_option() -> Any:
    """The option for the number of shapes in a synthetic test."""
    return option(default=1, low=1, help="how many blobs, each of another shape")


def views_option() -> Any:
    """The option for the number of views of each mesh."""
    return option(default=2, low=1, high=360, help="views of each mesh, from all around")


@dataclass(frozen=True)
class MeasuresModels(Operation):
    """The models that a test measures, and its outputs."""

    heading: ClassVar[str] = "the models, and output files"

    model: tuple[str, ...] = option(default=(DEFAULT_MODEL,), metavar="MODEL", help="a model's name or file, or all")
    json: str | None = output_option("write the rows as JSON")
    output: str | None = output_option("write a report with pictures", metavar="REPORT")

    # Module and class of the test, which takes the operation.
    test: ClassVar[str]

    def evaluation(self) -> "Evaluation":
        """The test. Raises InputError if its data is missing or an option is unusable."""
        return resolve_name(f"{_HERE}.{self.test}")(self)

    def run(self, progress: Progress = silent) -> Measured:
        """Run the test, and write rows and report if requested."""
        from mpsnet_core.io.files import check_no_overwrite, writable_path
        from mpsnet_core.io.html_page import page_path
        from mpsnet_core.learning.evaluation.evaluation import evaluate

        # Check output paths first: searching a test's data may take a while.
        if self.json:
            writable_path(self.json)
        if self.output:
            page_path(self.output)
        check_no_overwrite([], [file for file in (self.json, self.output) if file])
        return evaluate(self.evaluation(), self.model, json=self.json, report=self.output, progress=progress)


@dataclass(frozen=True)
class PhotographsSynthetic(MeasuresModels):
    """How synthetic scenes are photographed."""

    heading: ClassVar[str] = "the photographs"

    protocol: tuple[str, ...] = option(
        default=("published",), choices=PROTOCOLS, help="how much each channel sees of each colour"
    )
    size: int = size_option(256)


@dataclass(frozen=True)
class EvaluateDiligent(MeasuresModels):
    """The DiLiGenT photographs, multiplexed."""

    command: ClassVar[str] = "evaluate diligent"
    test: ClassVar[str] = "diligent:Diligent"

    folder: str = option(positional=True, help="DiLiGenT's pmsData folder; missing objects are reported and skipped")
    object: tuple[str, ...] = option(
        default=(), metavar="NAME", choices=dict.fromkeys(OBJECTS, ""), help="object of DiLiGenT", unset="all ten"
    )
    lights: tuple[str, ...] = option(
        default=(), metavar="R,G,B", help="numbers of the lights that give red, green and blue", numbers=True
    )
    protocol: tuple[str, ...] = option(
        default=(), choices=PROTOCOLS, help="how much each channel sees of each colour", unset="all three"
    )
    white: bool = white_option()


@dataclass(frozen=True)
class EvaluateMaterials(PhotographsSynthetic):
    """Blobs under each measured material."""

    command: ClassVar[str] = "evaluate materials"
    test: ClassVar[str] = "materials:Materials"

    merl: str = option(metavar="PATH", help="a folder of MERL .binary files, or .npz of fits")
    blobs: int = blobs_option()


@dataclass(frozen=True)
class EvaluateRendered(PhotographsSynthetic):
    """Rendered mesh files with one and with several materials."""

    command: ClassVar[str] = "evaluate rendered"
    test: ClassVar[str] = "rendered:Rendered"

    mesh: tuple[str, ...] = option(positional=True, help="mesh files, or folders of them")
    merl: str = option(default="", metavar="PATH", help="measured materials in place of principled ones")
    views: int = views_option()


@dataclass(frozen=True)
class EvaluateStatues(MeasuresModels):
    """Matt grey meshes: errors in shadow, and how much fine relief is kept."""

    command: ClassVar[str] = "evaluate statues"
    test: ClassVar[str] = "statues:Statues"

    mesh: tuple[str, ...] = option(positional=True, help="mesh files, or folders of them")
    views: int = views_option()
    slant: float = option(default=30.0, metavar="DEGREES", help="slant of the three lights")
    tilt: tuple[float, ...] = option(
        default=(90.0, 107.0, 131.0),  # straight up, where networks do not rotate the image, and two odd angles
        metavar="DEGREES",
        help="tilt of the first light, from which the others stand 120° apart",
    )
    bounces: int = option(default=0, low=0, high=MAX_BOUNCES, help="number of light bounces between surfaces: 0 to 3")
    size: int = size_option(640)


@dataclass(frozen=True)
class EvaluateColour(PhotographsSynthetic):
    """Blobs in many colours: errors at colour edges, and the effect of colour alone."""

    command: ClassVar[str] = "evaluate colour"
    test: ClassVar[str] = "colour:ColourChanges"

    white: bool = white_option()
    blobs: int = blobs_option()


@dataclass(frozen=True)
class EvaluateSamples(MeasuresModels):
    """Held-out samples, photographed (needs PyTorch)."""

    command: ClassVar[str] = "evaluate samples"
    test: ClassVar[str] = "samples:Samples"

    folder: tuple[str, ...] = option(positional=True, help="folders of held-out samples")
    count: int = option(default=0, low=0, help="how many samples to use, evenly spread; 0 for all")
    by: tuple[str, ...] = option(
        default=(),
        choices={
            "lights": "how many reach a pixel",
            "curvature": "hollow, flat or convex",
            "sky": "how much the object occludes",
            "slant": "of the surface",
            "material": "matt, glossy, metal or measured",
        },
        unset="the whole object alone",
        help="also tell errors by kind of pixel",
    )
    white: bool = white_option()


@dataclass(frozen=True)
class EvaluatePatchSizes(Operation):
    """Train MPS-Net with patches of five sizes (table 1)."""

    command: ClassVar[str] = "evaluate patch-sizes"

    samples: tuple[str, ...] = option(metavar="DIR", help="folder of samples to train on")
    validation: tuple[str, ...] = option(metavar="DIR", help="folder of held-out samples")
    runs: str = option(metavar="DIR", help="folder of checkpoints, to resume a cancelled run from", provenance="none")
    width: float = option(default=0.125, help="fraction of the published numbers of feature maps")
    steps: int = option(default=600, help="steps of each of the ten trainings, 512 patches each")
    patches: int = option(default=500_000, low=1, help="how many patches to measure on")
    json: str | None = output_option("write the rows as JSON")
    output: str | None = output_option("write a report with a chart", metavar="REPORT")

    def run(self, progress: Progress = silent) -> Measured:
        """Train and measure the ten networks, and write rows and report if requested."""
        return resolve_name(f"{_HERE}.patch_sizes:evaluate_patch_sizes")(self, progress)
