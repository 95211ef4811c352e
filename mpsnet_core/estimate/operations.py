"""The operations on photos: their normals, the lights in them, and the models that estimate them."""

import json
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from mpsnet_core.capture.operations import HasViewpoint, ReadsPhotos, TakesLightPhotos
from mpsnet_core.defaults import MASK, MAX_SMOOTHING
from mpsnet_core.estimate.registry import BASELINES, DEFAULT_MODEL, DEFAULT_TILE, find_network, known_models
from mpsnet_core.operation import Operation, Result, convention_option, option, optional, output_option
from mpsnet_core.progress import Progress, silent

if TYPE_CHECKING:
    from mpsnet_core.estimate.estimator import Estimator
    from mpsnet_core.estimate.lights.find import LightFound


@dataclass(frozen=True)
class RunsModel(Operation):
    """Which model estimates the normals, and how networks run."""

    heading: ClassVar[str] = "the model"

    model: str = option(
        default=DEFAULT_MODEL, help="model that estimates the normals, by name or as an .onnx file", provenance="none"
    )
    provider: str = option(
        default="cpu",
        choices={"cpu": "", "cuda": "NVIDIA", "directml": "Windows", "coreml": "Apple"},
        help="where networks run",
        provenance="none",
    )
    threads: int = option(default=0, low=0, high=1024, help="CPU threads for networks, 0 for all", provenance="none")
    tile: int = option(default=DEFAULT_TILE, help="side of the tiles that networks work on, in pixels")

    def model_facts(self, passes: Literal[1, 3] | None = None) -> dict[str, str]:
        """Facts of the model for :func:`mpsnet_core.io.provenance.operation_facts`: a network's file may change.

        Raises SettingsError if there is no such model, FileError if its file is missing.
        """
        from mpsnet_core.io.metadata import content_fingerprint

        if self.model in BASELINES:
            return {"model": self.model}
        network = find_network(self.model)
        return {"model": content_fingerprint(network.path), "passes": str(passes or network.passes)}

    def estimator(self, passes: Literal[1, 3] | None = None) -> "Estimator":
        """The loaded model. passes: as in :class:`mpsnet_core.estimate.estimator.Estimator`."""
        from mpsnet_core.estimate.estimator import Estimator

        return Estimator(self.model, passes=passes, provider=self.provider, threads=self.threads, tile=self.tile)


@dataclass(frozen=True)
class NormalsMade(Result):
    """The normal map of one photo."""

    outputs: list[str]
    """The normal map's file."""
    pixels: int
    """Number of pixels with a normal."""
    albedo: str | None = None
    """File of the albedo, if requested."""
    lights: "list[LightFound] | None" = None
    """The lights that were found in the photo; None if a rig was given."""


@dataclass(frozen=True)
class FramesMade(Result):
    """The normal maps of several photos, of numbered frames or of a video."""

    folder: str
    """Folder of the normal maps."""
    made: int
    """Number of normal maps made now."""
    there: int
    """Number of normal maps that existed already."""
    pixels: int
    """Number of pixels with a normal."""
    left_out: int = 0
    """Number of photos without an object."""
    outputs: list[str] | None = None
    """Files of the normal maps; None for a sequence, which `pattern` describes."""
    first_output: str | None = None
    """File of the sequence's first normal map. This and the following fields are what a program needs to load it."""
    pattern: str | None = None
    """File name of the sequence's normal maps, with # for each digit of the frame number."""
    first: int | None = None
    """First frame number."""
    last: int | None = None
    """Last frame number."""
    count: int | None = None
    """Number of frames."""
    frame_rate: float | None = None
    """Frames per second of a video."""
    lights: "list[LightFound] | None" = None
    """The lights that were found in the photos; None if a rig was given."""


@dataclass(frozen=True)
class Estimate(RunsModel, HasViewpoint, ReadsPhotos):
    """Estimate a camera-space normal map from a photo."""

    command: ClassVar[str] = "estimate"

    image: tuple[str, ...] = option(
        positional=True,
        help="photo(s), a folder of them, a pattern (frame_####.png, `*.tif`), or a video",
        provenance="none",
    )
    rig: str | None = optional(
        "rig file (.json, or .lp with three lights)", unset="the lights are found in the photo", path="file"
    )
    mask: str = option(
        default=MASK,
        help="where the object is: a mask file, alpha, none, auto, alpha-or-auto, background:FILE or "
        "threshold:0.05, see `mpsnet mask`; for frames also a folder or pattern of masks",
        provenance="none",  # in each frame's own line
    )
    passes: Literal[1, 3] | None = optional(
        "passes of the network",
        choices={
            1: "",
            3: "averages the results for the scene rotated and mirrored, and estimates a second time without the "
            "albedo",
        },
        unset="with the default model 3 for one photo, 1 for several photos or a video",
        provenance="none",
    )
    white: tuple[str, ...] = option(
        default=(),
        metavar="PHOTO",
        help="second photo of the same pose under white light (the three lights turned white), which shows "
        "the colour of the surface. Photos of one light each (a folder or pattern) are added up. For one still "
        "photo only",
        path="file",
        provenance="none",
    )
    albedo: str | None = output_option(
        "also write the surface's colour without light and shadow on it, made from the photo under white light"
    )
    white_light: str | None = optional(
        "what lit the white photo: the rig's three lights turned white, or one lamp in this direction in degrees",
        metavar="rig|SLANT,TILT",
        unset="rig",
        provenance="none",
        numbers=True,
    )
    convention: Literal["opengl", "directx"] = convention_option(default="opengl", of="the normal map")
    confidence: str | None = output_option("also write a map of how far each normal can be trusted, for one photo")
    format: str | None = optional("png, tif or exr, if the output is a folder", unset="png")
    smooth: int = option(
        default=0,
        metavar="N",
        low=0,
        high=MAX_SMOOTHING,
        help="frames of a sequence or video before and after each one to average it with, where they show the same "
        "surface",
    )
    output: str = option(
        help="normal map to write: .png, .tif or .exr; a folder for several photos, where frames that are "
        "already there are skipped",
        path="file",
        provenance="none",
    )

    def run(self, progress: Progress = silent) -> NormalsMade | FramesMade:
        """Write the normal map of one photo, or those of several, of numbered frames or of a video."""
        return resolve_name("mpsnet_core.estimate.estimate_photos:estimate")(self, progress)


@dataclass(frozen=True)
class PhotoCalibrated(Result):
    """The lights that were found in photos, and the file of their rig."""

    output: str
    """The rig file."""
    lights: "list[LightFound]"
    """The lights, in the order of the camera's channels."""


@dataclass(frozen=True)
class CalibratePhoto(TakesLightPhotos):
    """Find the lights' directions in photos of any object, without a ball.

    They are less exact than those of a mirror ball: several photos or frames under the same lights help.
    """

    command: ClassVar[str] = "calibrate photo"

    image: tuple[str, ...] = option(
        positional=True, help="photo(s) under the same three lights, a folder of them, or a pattern (frame_####.png)"
    )

    def run(self, progress: Progress = silent) -> PhotoCalibrated:
        """Write the rig file."""
        return resolve_name("mpsnet_core.estimate.estimate_photos:calibrate_photo")(self, progress)


@dataclass(frozen=True)
class ModelListed:
    """A model."""

    name: str
    """Name that the options take."""
    title: str
    """What it is, in a line."""
    comparison: bool
    """Whether it is for comparison only."""
    installed: bool
    """Whether its file is installed."""


@dataclass(frozen=True)
class ModelsListed(Result):
    """The known models, or the card and training record of one network."""

    models: list[ModelListed] | None = None
    """The known models; None if one network was asked for."""
    card: dict[str, Any] | None = None
    """The network's card, see :class:`mpsnet_core.ModelCard`."""
    training: dict[str, Any] | None = None
    """How the network was trained, if its file says so."""


@dataclass(frozen=True)
class ListModels(Operation):
    """List the models that are known by name."""

    command: ClassVar[str] = "models"

    model: str | None = optional("name or .onnx file of a network, to show its card", positional=True)

    def run(self, progress: Progress = silent) -> ModelsListed:
        """List the models, or read one's card."""
        if self.model:
            return _card(self.model)
        entries = known_models()
        width = max(len(entry.name) for entry in entries)
        lists: dict[bool, list[str]] = {False: [], True: ["", "to compare with, and for scripts:"]}
        for entry in entries:
            missing = "" if entry.installed else f"; not installed: {entry.how_to_install}"
            lists[entry.comparison].append(f"{entry.name.ljust(width)}  {entry.title}{missing}")
        models = [ModelListed(entry.name, entry.title, entry.comparison, entry.installed) for entry in entries]
        return ModelsListed(models, text="\n".join(lists[False] + lists[True]))


def _card(model: str) -> ModelsListed:
    from mpsnet_core.estimate.onnx_model import OnnxModel

    network = OnnxModel(find_network(model).path, threads=1)
    card = json.loads(network.card.to_json())
    text = json.dumps({"card": card, "training": network.record}, indent=2)
    return ModelsListed(card=card, training=network.record, text=text)
