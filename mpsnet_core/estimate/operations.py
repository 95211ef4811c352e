"""The operation estimate: photos, frames and videos to camera-space normal maps."""

import json
import logging
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from mpsnet_core.capture.operations import HasViewpoint, ReadsPhotos
from mpsnet_core.defaults import CONVENTIONS, MASK, MAX_SMOOTHING
from mpsnet_core.errors import SettingsError
from mpsnet_core.estimate.registry import BASELINES, DEFAULT_MODEL, DEFAULT_TILE, find_network, known_models
from mpsnet_core.operation import Operation, Result, option
from mpsnet_core.progress import Progress, part, silent

if TYPE_CHECKING:
    from mpsnet_core.arrays.types import F64
    from mpsnet_core.estimate.estimator import Estimator
    from mpsnet_core.estimate.lights.find import LightFound
    from mpsnet_core.estimate.sequence.run import Outcome
    from mpsnet_core.estimate.sequence.source import Frame

log = logging.getLogger(__name__)

LIGHTS_FRAMES = 50  # of a video without a rig, in which the lights are found


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
    rig: str | None = option(
        default=None,
        help="rig file (.json, or .lp with three lights)",
        unset="the lights are found in the photo",
        path="file",
    )
    mask: str = option(
        default=MASK,
        help="where the object is: a mask file, alpha, none, auto, alpha-or-auto, background:FILE or "
        "threshold:0.05, see `mpsnet mask`; for frames also a folder or pattern of masks",
        provenance="none",  # in each frame's own line
    )
    passes: Literal[1, 3] | None = option(
        default=None,
        choices={
            1: "",
            3: "averages the results for the scene rotated and mirrored, and estimates a second time without the "
            "albedo",
        },
        help="passes of the network",
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
    albedo: str | None = option(
        default=None,
        metavar="FILE",
        help="also write the surface's colour without light and shadow on it, made from the photo under white light",
        provenance="none",
    )
    white_light: str | None = option(
        default=None,
        metavar="rig|SLANT,TILT",
        help="what lit the white photo: the rig's three lights turned white, or one lamp in this direction in degrees",
        unset="rig",
        provenance="none",
        numbers=True,
    )
    convention: Literal["opengl", "directx"] = option(
        default="opengl", choices=CONVENTIONS, help="which way the green channel of the normal map points"
    )
    confidence: str | None = option(
        default=None,
        metavar="FILE",
        help="also write a map of how far each normal can be trusted, for one photo",
        provenance="none",
    )
    format: str | None = option(default=None, help="png, tif or exr, if the output is a folder", unset="png")
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
        from mpsnet_core.io.files import check_no_overwrite, writable_image
        from mpsnet_core.io.frames import expand_images, is_folder_or_pattern, is_video, output_files

        white_light, photos = self._white_light(), expand_images(self.image)
        inputs = [*photos, *self.inputs(self.rig, self.camera, self.mesh, *self.white, mask=self.mask)]
        # A folder with one frame is a sequence, too, unless its confidence is requested: sequences have none.
        if (
            len(photos) > 1
            or is_video(photos[0])
            or (any(map(is_folder_or_pattern, self.image)) and not self.confidence)
        ):
            return self._frames(photos, inputs, progress)
        if self.smooth:
            raise SettingsError("--smooth needs the frames of a sequence, but there is one photo; leave it out")
        [output] = output_files(photos, self.output, self.format)
        maps = [writable_image(path) for path in (self.confidence, self.albedo) if path]
        check_no_overwrite(inputs, [output, *maps])
        return self._photo(photos[0], output, white_light, progress)

    def _photo(self, photo: Path, output: Path, white_light: "F64 | None", progress: Progress) -> NormalsMade:
        from mpsnet_core.capture.open import open_captures
        from mpsnet_core.estimate.albedo import albedo_from_white, write_albedo
        from mpsnet_core.estimate.ambient_light import warn_of_ambient_light
        from mpsnet_core.estimate.lights.find import with_lights
        from mpsnet_core.io.files import ensure_folder, write_transaction
        from mpsnet_core.io.image_writing import write_image
        from mpsnet_core.io.marks import made
        from mpsnet_core.scene.normal_map import stating_the_error, write_normals

        estimator = self.estimator(self.passes)
        source = replace(self.source(photo, self.rig, self.mask), white=self.white, white_light=white_light)
        options = self.read_options()
        progress(0.0, f"reading {photo.name}")
        source, lights = with_lights(source, [source], options)
        [capture] = open_captures([source], options)

        progress(0.1, f"normals by {self.model}")
        normals = estimator(capture, part(progress, 0.1, 0.9))
        warn_of_ambient_light(capture, normals)

        progress(0.9, f"writing {output.name}")
        ensure_folder(output.parent, "normals")
        with write_transaction():
            # A baseline's confidence is no expected error.
            told = None if estimator.name in BASELINES else stating_the_error(normals)
            write_normals(output, normals, convention=self.convention, description=told)
            if self.confidence:
                write_image(self.confidence, normals.confidence, description=made("confidence"))
            if self.albedo:
                write_albedo(self.albedo, albedo_from_white(capture, normals), capture.mask)
        progress(1.0, "done")
        text = f"{output}: normals by {self.model}" + (f"\n{self.albedo}: albedo" if self.albedo else "")
        return NormalsMade([str(output)], int(normals.mask.sum()), self.albedo, lights, text=text)

    def _white_light(self) -> "F64 | None":
        """(3,) direction of the one lamp that lit the white photo; None if the rig's lights did."""
        if self.albedo and not self.white:
            raise SettingsError("--albedo is made from a photo under white light; give it with --white")
        if self.white_light and not self.white:
            raise SettingsError("--white-light describes the light on the --white photo; give both, or neither")
        if self.white_light in (None, "rig"):
            return None
        from mpsnet_core.scene.rig import direction_from_angles, slant_and_tilt

        return direction_from_angles(*slant_and_tilt("--white-light", self.white_light))

    def _frames(self, photos: list[Path], inputs: list[Path], progress: Progress) -> FramesMade:
        from mpsnet_core.io.frames import is_video

        if self.confidence:
            raise SettingsError("--confidence takes one photo at a time; leave it out or give one photo")
        if self.white:
            raise SettingsError("--white is a second photo of a single photo's pose; leave it out, or give one photo")
        if not any(map(is_video, photos)):
            return self._photos(photos, inputs, progress)
        if len(photos) > 1:
            raise SettingsError(f"{next(filter(is_video, photos))} is a video; give it alone, each video on its own")
        return self._video(photos[0], inputs, progress)

    def _photos(self, photos: list[Path], inputs: list[Path], progress: Progress) -> FramesMade:
        from mpsnet_core.estimate.lights.find import with_lights
        from mpsnet_core.estimate.sequence.source import frame_masks, photo_frames
        from mpsnet_core.io.files import check_no_overwrite
        from mpsnet_core.io.frames import numbering, output_files

        outputs = output_files(photos, self.output, self.format)
        check_no_overwrite(inputs, outputs)
        numbered = numbering(photos)
        masks = frame_masks(self.mask)
        if numbered is None and (self.smooth or masks.by_number):
            what = "--smooth" if self.smooth else f"--mask {self.mask}"
            raise SettingsError(f"{what} takes the frames of one sequence: photos whose names differ in one number")
        for number in numbered.numbers if numbered else ():
            masks.of(number)  # report a missing mask before any work
        like, lights = self.source(photos[0], self.rig), None
        if like.rig is None:
            unlit = photo_frames(photos, outputs, masks=masks, like=like)
            like, lights = with_lights(like, [frame.source for frame in unlit], self.read_options())
        frames = photo_frames(photos, outputs, masks=masks, like=like, reach=self.smooth)
        step = numbered.step if numbered else None
        outcome = self._sequence(frames, len(photos), progress, step, continue_on_error=not self.smooth)
        numbers = numbered.numbers if numbered else range(1, len(photos) + 1)
        without = {*outcome.left_out, *outcome.failed}
        made = {number: output for number, output in zip(numbers, outputs, strict=True) if number not in without}
        if numbered is None or outputs == [Path(self.output)]:
            return self._made(outcome, self.output, outputs=[*map(str, made.values())], lights=lights)
        if numbered.gaps:
            log.warning("frame(s) %s missing; the others are estimated", numbered.gaps)
        padded = len({len(digits) for digits in numbered.digits}) == 1
        return self._made_of_sequence(outcome, made[min(made)], (min(made), max(made)), padded, None, lights)

    def _video(self, path: Path, inputs: list[Path], progress: Progress) -> FramesMade:
        from mpsnet_core.estimate.lights.find import with_lights
        from mpsnet_core.estimate.sequence.source import frame_masks
        from mpsnet_core.estimate.sequence.video import read_video_header, video_frames, video_outputs
        from mpsnet_core.io.files import check_no_overwrite, resolved

        if self.layer:
            raise SettingsError(f"{path} is a video, which has no layers; leave --layer out")
        outputs = video_outputs(path, self.output, self.format)
        # The number of frames is not known before the video is read. An output's name ends in its frame number, so an
        # input can be overwritten only by the frames whose numbers are in the inputs' names.
        numbers = {int(digits) for file in inputs for digits in re.findall("[0-9]+", resolved(file).stem)}
        check_no_overwrite(inputs, map(outputs, numbers))
        video = read_video_header(path, encoding=self.encoding)
        like, masks = self.source(path, self.rig), frame_masks(self.mask)
        lights = None
        if like.rig is None:
            unlit = video_frames(video, outputs, masks=masks, like=like, encoding=self.encoding)
            first = islice(unlit, 0, LIGHTS_FRAMES, LIGHTS_FRAMES // 5)
            like, lights = with_lights(like, [frame.source for frame in first], self.read_options())
        frames = video_frames(video, outputs, masks=masks, like=like, reach=self.smooth, encoding=self.encoding)
        outcome = self._sequence(frames, video.count, progress, 1)
        total = outcome.made + outcome.there + len(outcome.left_out)
        made = [number for number in range(1, total + 1) if number not in outcome.left_out]
        return self._made_of_sequence(outcome, outputs(made[0]), (made[0], made[-1]), True, video.frame_rate, lights)

    def _sequence(
        self,
        frames: "Iterable[Frame]",
        count: int,
        progress: Progress,
        step: int | None,
        *,
        continue_on_error: bool = False,
    ) -> "Outcome":
        """Estimate photos. step: between the numbers of a sequence's frames; None if the photos are not a sequence.
        continue_on_error: as in `estimate_sequence`."""
        from mpsnet_core.capture.open import PhotoSet
        from mpsnet_core.estimate.sequence.run import estimate_sequence
        from mpsnet_core.io.provenance import operation_facts

        known = [frame.source for frame in frames] if isinstance(frames, list) else []
        photos = PhotoSet(known, self.read_options(), moving=step is not None)
        # One pass per frame unless more are requested: three take three times as long.
        passes = self.passes or 1
        return estimate_sequence(
            frames,
            lambda frame: photos.open(frame.source),
            self.estimator(passes),
            recipe=operation_facts(self, **self.model_facts(passes)),
            smooth=self.smooth,
            step=step or 1,
            continue_on_error=continue_on_error,
            convention=self.convention,
            count=count,
            progress=progress,
        )

    def _made_of_sequence(
        self,
        outcome: "Outcome",
        first: Path,
        numbers: tuple[int, int],
        padded: bool,
        rate: float | None,
        lights: "list[LightFound] | None",
    ) -> FramesMade:
        *_, digits = re.finditer("[0-9]+", first.stem)
        run = "#" * len(digits[0]) if padded else "*"
        pattern = f"{first.stem[: digits.start()]}{run}{first.stem[digits.end() :]}{first.suffix}"
        facts = {"pattern": pattern, "first": numbers[0], "last": numbers[1], "frame_rate": rate, "lights": lights}
        count = outcome.made + outcome.there
        return self._made(outcome, Path(self.output) / pattern, first_output=str(first), count=count, **facts)

    def _made(self, outcome: "Outcome", where: str | Path, **facts: Any) -> FramesMade:
        made, left_out, failed = outcome.made, len(outcome.left_out), [*outcome.failed.values()]
        text = f"{where}: normals by {self.model}, {made} made"
        for count, words in ((outcome.there, "there already"), (left_out, "left out"), (len(failed), "failed")):
            text += f", {count} {words}" if count else ""
        done = self.output, made, outcome.there, outcome.pixels, left_out
        return FramesMade(*done, **facts, text=text, failed=failed or None)


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

    model: str | None = option(default=None, positional=True, help="name or .onnx file of a network, to show its card")

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
