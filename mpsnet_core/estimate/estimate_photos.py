"""The work of the operations estimate and calibrate photo: from photos, frames and videos to normal maps, or a rig."""

import logging
import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any

from mpsnet_core.arrays.types import F64
from mpsnet_core.capture.open import PhotoSet, open_captures
from mpsnet_core.errors import SettingsError
from mpsnet_core.estimate.albedo import albedo_from_white, write_albedo
from mpsnet_core.estimate.ambient_light import warn_of_ambient_light
from mpsnet_core.estimate.lights.find import find_lights_of, with_lights
from mpsnet_core.estimate.operations import CalibratePhoto, Estimate, FramesMade, NormalsMade, PhotoCalibrated
from mpsnet_core.estimate.registry import BASELINES
from mpsnet_core.estimate.sequence.run import Outcome, estimate_sequence
from mpsnet_core.estimate.sequence.source import Frame, frame_masks, photo_frames
from mpsnet_core.estimate.sequence.video import read_video_header, video_frames, video_outputs
from mpsnet_core.io import files as disk
from mpsnet_core.io.frames import expand_images, is_folder_or_pattern, is_video, numbering, output_files
from mpsnet_core.io.image_writing import write_image
from mpsnet_core.io.marks import made
from mpsnet_core.io.provenance import operation_facts
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.normal_map import stating_the_error, write_normals
from mpsnet_core.scene.rig import direction_from_angles, slant_and_tilt, write_rig

log = logging.getLogger(__name__)

LIGHTS_FRAMES = 50  # of a video without a rig, in which the lights are found


def estimate(options: Estimate, progress: Progress = silent) -> NormalsMade | FramesMade:
    """Write the normal map of one photo, or those of several, of numbered frames or of a video."""
    white_light, photos = _white_light(options), expand_images(options.image)
    inputs = [*photos, *options.inputs(options.rig, options.camera, options.mesh, *options.white, mask=options.mask)]
    # A folder with one frame is a sequence, too, unless its confidence is requested: sequences have none.
    if (
        len(photos) > 1
        or is_video(photos[0])
        or (any(map(is_folder_or_pattern, options.image)) and not options.confidence)
    ):
        return _frames(options, photos, inputs, progress)
    if options.smooth:
        raise SettingsError("--smooth needs the frames of a sequence, but there is one photo; leave it out")
    [output] = output_files(photos, options.output, options.format)
    maps = [disk.writable_image(path) for path in (options.confidence, options.albedo) if path]
    disk.check_no_overwrite(inputs, [output, *maps])
    return _photo(options, photos[0], output, white_light, progress)


def _photo(options: Estimate, photo: Path, output: Path, white_light: F64 | None, progress: Progress) -> NormalsMade:
    estimator = options.estimator(options.passes)
    source = replace(options.source(photo, options.rig, options.mask), white=options.white, white_light=white_light)
    progress(0.0, f"reading {photo.name}")
    source, lights = with_lights(source, [source], options.read_options())
    [capture] = open_captures([source], options.read_options())

    progress(0.1, f"normals by {options.model}")
    normals = estimator(capture, part(progress, 0.1, 0.9))
    warn_of_ambient_light(capture, normals)

    progress(0.9, f"writing {output.name}")
    disk.ensure_folder(output.parent, "normals")
    with disk.write_transaction():
        # A baseline's confidence is no expected error.
        told = None if estimator.name in BASELINES else stating_the_error(normals)
        write_normals(output, normals, convention=options.convention, description=told)
        if options.confidence:
            write_image(options.confidence, normals.confidence, description=made("confidence"))
        if options.albedo:
            write_albedo(options.albedo, albedo_from_white(capture, normals), capture.mask)
    progress(1.0, "done")
    text = f"{output}: normals by {options.model}" + (f"\n{options.albedo}: albedo" if options.albedo else "")
    return NormalsMade([str(output)], int(normals.mask.sum()), options.albedo, lights, text=text)


def _white_light(options: Estimate) -> F64 | None:
    """(3,) direction of the one lamp that lit the white photo; None if the rig's lights did."""
    if options.albedo and not options.white:
        raise SettingsError("--albedo is made from a photo under white light; give it with --white")
    if options.white_light and not options.white:
        raise SettingsError("--white-light describes the light on the --white photo; give both, or neither")
    if options.white_light in (None, "rig"):
        return None
    return direction_from_angles(*slant_and_tilt("--white-light", options.white_light))


def _frames(options: Estimate, photos: list[Path], inputs: list[Path], progress: Progress) -> FramesMade:
    if options.confidence:
        raise SettingsError("--confidence takes one photo at a time; leave it out or give one photo")
    if options.white:
        raise SettingsError("--white is a second photo of a single photo's pose; leave it out, or give one photo")
    if not any(map(is_video, photos)):
        return _photos(options, photos, inputs, progress)
    if len(photos) > 1:
        raise SettingsError(f"{next(filter(is_video, photos))} is a video; give it alone, each video on its own")
    return _video(options, photos[0], inputs, progress)


def _photos(options: Estimate, photos: list[Path], inputs: list[Path], progress: Progress) -> FramesMade:
    outputs = output_files(photos, options.output, options.format)
    disk.check_no_overwrite(inputs, outputs)
    numbered = numbering(photos)
    masks = frame_masks(options.mask)
    if numbered is None and (options.smooth or masks.by_number):
        what = "--smooth" if options.smooth else f"--mask {options.mask}"
        raise SettingsError(f"{what} takes the frames of one sequence: photos whose names differ in one number")
    for number in numbered.numbers if numbered else ():
        masks.of(number)  # report a missing mask before any work
    like, lights = options.source(photos[0], options.rig), None
    if like.rig is None:
        unlit = photo_frames(photos, outputs, masks=masks, like=like)
        like, lights = with_lights(like, [frame.source for frame in unlit], options.read_options())
    frames = photo_frames(photos, outputs, masks=masks, like=like, reach=options.smooth)
    step = numbered.step if numbered else None
    outcome = _sequence(options, frames, len(photos), progress, step, continue_on_error=not options.smooth)
    numbers = numbered.numbers if numbered else range(1, len(photos) + 1)
    without = {*outcome.left_out, *outcome.failed}
    made = {number: output for number, output in zip(numbers, outputs, strict=True) if number not in without}
    if numbered is None or outputs == [Path(options.output)]:
        return _made(options, outcome, options.output, outputs=[*map(str, made.values())], lights=lights)
    if numbered.gaps:
        log.warning("frame(s) %s missing; the others are estimated", numbered.gaps)
    padded = len({len(digits) for digits in numbered.digits}) == 1
    return _made_of_sequence(options, outcome, made[min(made)], (min(made), max(made)), padded, lights=lights)


def _video(options: Estimate, path: Path, inputs: list[Path], progress: Progress) -> FramesMade:
    if options.layer:
        raise SettingsError(f"{path} is a video, which has no layers; leave --layer out")
    outputs = video_outputs(path, options.output, options.format)
    # The number of frames is not known before the video is read. An output's name ends in its frame number, so an
    # input can be overwritten only by the frames whose numbers are in the inputs' names.
    numbers = {int(digits) for file in inputs for digits in re.findall("[0-9]+", disk.resolved(file).stem)}
    disk.check_no_overwrite(inputs, map(outputs, numbers))
    video = read_video_header(path, encoding=options.encoding)
    like, masks = options.source(path, options.rig), frame_masks(options.mask)
    lights = None
    if like.rig is None:
        unlit = video_frames(video, outputs, masks=masks, like=like, encoding=options.encoding)
        first = islice(unlit, 0, LIGHTS_FRAMES, LIGHTS_FRAMES // 5)
        like, lights = with_lights(like, [frame.source for frame in first], options.read_options())
    frames = video_frames(video, outputs, masks=masks, like=like, reach=options.smooth, encoding=options.encoding)
    outcome = _sequence(options, frames, video.count, progress, 1)
    total = outcome.made + outcome.there + len(outcome.left_out)
    made = [number for number in range(1, total + 1) if number not in outcome.left_out]
    more = {"frame_rate": video.frame_rate, "lights": lights}
    return _made_of_sequence(options, outcome, outputs(made[0]), (made[0], made[-1]), True, **more)


def _sequence(
    options: Estimate, frames: Iterable[Frame], count: int, progress: Progress, step: int | None, **how: bool
) -> Outcome:
    """Estimate photos. step: between the numbers of a sequence's frames; None if the photos are not a sequence.
    how: as for `estimate_sequence`."""
    known = [frame.source for frame in frames] if isinstance(frames, list) else []
    photos = PhotoSet(known, options.read_options(), moving=step is not None)
    # One pass per frame unless more are requested: three take three times as long.
    passes = options.passes or 1
    return estimate_sequence(
        frames,
        lambda frame: photos.open(frame.source),
        options.estimator(passes),
        recipe=operation_facts(options, **options.model_facts(passes)),
        smooth=options.smooth,
        step=step or 1,
        **how,
        convention=options.convention,
        count=count,
        progress=progress,
    )


def _made_of_sequence(
    options: Estimate, outcome: Outcome, first: Path, numbers: tuple[int, int], padded: bool, **more: Any
) -> FramesMade:
    """The result of a sequence's frames, named like the first one. numbers: of the first and the last frame."""
    *_, digits = re.finditer("[0-9]+", first.stem)
    run = "#" * len(digits[0]) if padded else "*"
    pattern = f"{first.stem[: digits.start()]}{run}{first.stem[digits.end() :]}{first.suffix}"
    facts = {"pattern": pattern, "first": numbers[0], "last": numbers[1], **more}
    count = outcome.made + outcome.there
    return _made(options, outcome, Path(options.output) / pattern, first_output=str(first), count=count, **facts)


def _made(options: Estimate, outcome: Outcome, where: str | Path, **facts: Any) -> FramesMade:
    made, left_out, failed = outcome.made, len(outcome.left_out), [*outcome.failed.values()]
    text = f"{where}: normals by {options.model}, {made} made"
    for count, words in ((outcome.there, "there already"), (left_out, "left out"), (len(failed), "failed")):
        text += f", {count} {words}" if count else ""
    done = options.output, made, outcome.there, outcome.pixels, left_out
    return FramesMade(*done, **facts, text=text, failed=failed or None)


def calibrate_photo(options: CalibratePhoto, progress: Progress) -> PhotoCalibrated:
    """Find the lights in photos, and write the rig file."""
    files = options.photos(options.image)
    progress(0.0, f"looking for the lights in {files[0].name}")
    found = find_lights_of(options.sources(files, options.mask), options.read_options())
    write_rig(options.output, found.rig)
    lines = "\n".join(map(str, found.facts()))
    result = PhotoCalibrated(options.output, found.facts(), text=f"{lines}\n{options.output}: the rig")
    if options.json:
        disk.write_json(options.json, result.metrics())
    progress(1.0, "done")
    return result
