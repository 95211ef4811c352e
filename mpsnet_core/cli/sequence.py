"""The verb estimate for more than one picture: several photos, numbered frames, a video."""

import argparse
import logging
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from mpsnet_core.capture.capture import Capture, capture_from
from mpsnet_core.capture.masks import Notes
from mpsnet_core.cli.arguments import parse_correction, parse_estimator, parse_viewpoint, read_files
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.errors import InputError
from mpsnet_core.estimate.registry import (
    AVERAGED_MODEL,
    DEFAULT_MODEL,
    LAMBERTIAN,
    LAMBERTIAN_GREY_WORLD,
    STILL_PASSES,
    find_network,
)
from mpsnet_core.estimate.sequence.run import Outcome, estimate_sequence
from mpsnet_core.estimate.sequence.smoothing import MAX_REACH
from mpsnet_core.estimate.sequence.source import Frame, frame_masks, photo_frames
from mpsnet_core.estimate.sequence.video import is_video, read_video_header, video_frames, video_outputs
from mpsnet_core.io.files import resolved
from mpsnet_core.io.frames import check_apart, numbering, output_files
from mpsnet_core.io.provenance import content, identity
from mpsnet_core.scene.rig import LightRig

log = logging.getLogger(__name__)

# Options that change nothing in the normals, are refused, or that the frames themselves tell of; all others make other
# normals.
NOT_IN_RECIPE = (
    "albedo",
    "confidence",
    "image",
    "mask",
    "model",
    "output",
    "progress",
    "provider",
    "threads",
    "verb",
    "white",
    "white_light",
)


def estimate_frames(
    options: argparse.Namespace, photos: list[Path], rig: LightRig, reporter: Reporter
) -> dict[str, Any]:
    """Normals of several photos, or of a video's frames."""
    if options.confidence:
        raise InputError("--confidence takes one photo at a time; leave it out or give one photo")
    if options.white:
        raise InputError("--white is a second photo of one still pose; leave it out, or give one photo")
    if not 0 <= options.smooth <= MAX_REACH:
        raise InputError(f"--smooth {options.smooth} cannot be; choose 0 to {MAX_REACH} frames")
    if not any(is_video(photo) for photo in photos):
        return _photos(options, photos, rig, reporter)
    if len(photos) > 1:
        raise InputError(f"{next(filter(is_video, photos))} is a video; give it alone, and each video on its own")
    return _video(options, photos[0], rig, reporter)


def _photos(options: argparse.Namespace, photos: list[Path], rig: LightRig, reporter: Reporter) -> dict[str, Any]:
    outputs = output_files(photos, options.output, f".{options.format.lstrip('.')}")
    check_apart([*photos, options.rig, *read_files(options)], outputs)
    numbered = numbering(photos)
    masks = frame_masks(options.mask)
    if numbered is None and (options.smooth or masks.by_number):
        what = "--smooth" if options.smooth else f"--mask {options.mask}"
        raise InputError(f"{what} takes the frames of one sequence: photos whose names differ in one number alone")
    for number in numbered.numbers if numbered else ():
        masks.of(number)  # one that is missing is told before any work
    frames = photo_frames(
        photos, outputs, masks=masks, reach=options.smooth, encoding=options.encoding, layer=options.layer
    )
    step = numbered.step if numbered else 1
    outcome, result = _run(options, frames, len(photos), rig, reporter, step)
    if numbered is None or outputs == [Path(options.output)]:
        listed = [str(output) for output in outputs]
        return {**result, "outputs": listed, "text": f"{options.output}: {_summary(outcome, options)}"}
    if numbered.gaps:
        log.warning("frame(s) %s missing; the others are estimated", numbered.gaps)
    number, first = min(zip(numbered.numbers, outputs, strict=True))
    padded = len({len(digits) for digits in numbered.digits}) == 1
    return {**result, **_sequence(outcome, options, first, (number, max(numbered.numbers)), padded, None)}


def _video(options: argparse.Namespace, path: Path, rig: LightRig, reporter: Reporter) -> dict[str, Any]:
    if options.layer:
        raise InputError(f"{path} is a video, which has no layers; leave --layer out")
    outputs = video_outputs(path, options.output, f".{options.format.lstrip('.')}")
    taken = [path, Path(options.rig), *read_files(options)]
    # How many frames there are is not known; a result's name ends in its number, so these are all that can be meant.
    numbers = {int(digits) for file in taken for digits in re.findall("[0-9]+", resolved(file).stem)}
    check_apart(taken, map(outputs, numbers))
    video = read_video_header(path, encoding=options.encoding)
    frames = video_frames(
        video, outputs, masks=frame_masks(options.mask), reach=options.smooth, encoding=options.encoding
    )
    outcome, result = _run(options, frames, video.count, rig, reporter)
    first_and_last = (1, outcome.made + outcome.there)
    return {**result, **_sequence(outcome, options, outputs(1), first_and_last, True, video.frame_rate)}


def _run(
    options: argparse.Namespace, frames: Iterable[Frame], count: int, rig: LightRig, reporter: Reporter, step: int = 1
) -> tuple[Outcome, dict[str, Any]]:
    correction, (camera, depth) = parse_correction(options), parse_viewpoint(options)

    notes: Notes = "doubts"

    def take(frame: Frame) -> Capture:
        nonlocal notes
        image = frame.read()
        try:
            capture = capture_from(
                image,
                rig,
                mask=frame.mask,
                encoding=options.encoding,
                layer=options.layer,
                camera=camera,
                depth=depth,
                correction=correction,
                notes=notes,
            )
        except InputError as error:
            raise InputError(f"{frame.name}: {error}") from None
        notes = "none"  # the other frames are much like the first
        return capture

    outcome = estimate_sequence(
        frames,
        take,
        parse_estimator(options, passes=_passes(options)),
        recipe=_recipe(options),
        smooth=options.smooth,
        step=step,
        convention=options.convention,
        count=count,
        progress=reporter.progress,
    )
    return outcome, {
        "folder": options.output,
        "made": outcome.made,
        "there": outcome.there,
        "pixels": outcome.pixels,
    }


def _sequence(
    outcome: Outcome,
    options: argparse.Namespace,
    first: Path,
    numbers: tuple[int, int],
    padded: bool,
    rate: float | None,
) -> dict[str, Any]:
    """What a program needs to load the results as one image sequence."""
    *_, digits = re.finditer("[0-9]+", first.stem)
    run = "#" * len(digits[0]) if padded else "*"
    pattern = f"{first.stem[: digits.start()]}{run}{first.stem[digits.end() :]}{first.suffix}"
    return {
        "first_output": str(first),
        "pattern": pattern,
        "first": numbers[0],
        "last": numbers[1],
        "count": outcome.made + outcome.there,
        "frame_rate": rate,
        "text": f"{Path(options.output) / pattern}: {_summary(outcome, options)}",
    }


def _summary(outcome: Outcome, options: argparse.Namespace) -> str:
    there = f", {outcome.there} there already" if outcome.there else ""
    return f"normals by {options.model or DEFAULT_MODEL}, {outcome.made} made{there}"


def _passes(options: argparse.Namespace) -> Literal[1, 3]:
    """Each pass takes as long as the first: where nobody asks for more, frames get one."""
    passes: Literal[1, 3] = options.passes or (STILL_PASSES if options.model == AVERAGED_MODEL else 1)
    return passes


def _recipe(options: argparse.Namespace) -> str:
    """Text that changes with every setting that the normals depend on."""
    model = options.model or DEFAULT_MODEL
    facts = {name: repr(value) for name, value in vars(options).items() if name not in NOT_IN_RECIPE}
    facts |= {name: identity(getattr(options, name)) for name in ("dark", "flat")}
    # Files that are small and often written anew count by what they hold.
    facts |= {name: content(getattr(options, name)) for name in ("rig", "camera", "mesh") if getattr(options, name)}
    facts["passes"] = str(_passes(options))
    facts["model"] = model if model in (LAMBERTIAN, LAMBERTIAN_GREY_WORLD) else content(find_network(model).path)
    return "\n".join(f"{name}: {fact}" for name, fact in sorted(facts.items()))
