"""The work of the operations of calibration: from photos of balls and cards to rig files."""

import contextlib
import logging
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.types import F32
from mpsnet_core.calibrate import mixing as mixing
from mpsnet_core.calibrate import operations, report
from mpsnet_core.calibrate.ball import Circle
from mpsnet_core.calibrate.lights import LightsFound, Sighting, find_lights
from mpsnet_core.calibrate.lights_on_mesh import LightsOnMesh, lights_of_photo
from mpsnet_core.calibrate.photos import BallPhotos, lit_surface, mean_photo, read_lit, read_sightings, seen_balls
from mpsnet_core.capture.decode import warn_of_other_exposures
from mpsnet_core.errors import FileError, InputError, SettingsError
from mpsnet_core.io import files as disk
from mpsnet_core.io.frames import expand_images, in_order_of_lights
from mpsnet_core.io.image import CHANNELS, Image
from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.operation import Result
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.camera import read_camera
from mpsnet_core.scene.pictures import contact_sheet
from mpsnet_core.scene.rig import LightRig, near_rig, read_lp, read_rig, write_lp, write_rig

log = logging.getLogger(__name__)

# Most files to name in a sentence.
MAX_NAMED = 16
# Crosstalk below this share of a channel's own light is not written.
LEAST_CROSSTALK = 0.02


def _inputs(options: operations.UsesBall, given: Sequence[str], output: str, rig: str | None = None) -> list[Path]:
    """The photos, after checking that the results can be written and overwrite no input."""
    if options.radius is not None and not 0 < options.radius < math.inf:
        raise SettingsError(f"--radius is the ball's radius, a number above 0, not {options.radius:g}")
    files = _without_masks(expand_images(given))
    outputs = [file for file in (output, options.overlay, options.json) if file]
    others = options.inputs(options.camera, mask=options.mask)
    for number, one in enumerate(outputs):
        disk.writable_path(one)
        # The rig is read completely before it is written again; no other output may replace it.
        to_keep = [rig] if number and rig else []
        disk.check_no_overwrite([*files, *others, *to_keep, *outputs[:number]], [one])
    if options.overlay:
        disk.checked_bits(Path(options.overlay), 8)
    return files


def _photos(options: operations.UsesBall, files: Sequence[Path], *, balls: int = 1, mirror: bool = True) -> BallPhotos:
    if options.circle and options.mask:
        raise SettingsError("--circle and --mask both define where the ball or card is; give one of them")
    circles = [Circle(*_numbers(text, "--circle")) for text in options.circle]
    mask, radius = Path(options.mask) if options.mask else None, 1.0 if options.radius is None else options.radius
    return BallPhotos(files, circles, mask, balls, radius, options.lens(), options.read_options(), mirror)


def _write_json(options: operations.UsesBall, result: Result) -> None:
    if options.json:
        disk.write_json(options.json, result.metrics())


@dataclass(frozen=True)
class _Chosen:
    """The chosen lights in the photos."""

    places: int
    """Number of places of the ball."""
    numbers: list[int]
    """Numbers of the lights, from 0."""
    names: list[str]
    """Names of the lights."""
    files: list[Path] | None
    """Photo of each light at the first place; None if a photo shows all lights."""


def calibrate_lights(options: operations.CalibrateLights, progress: Progress = silent) -> operations.LightsCalibrated:
    """Write the rig, and the other outputs if requested."""
    if Path(options.ball[0]).suffix.lower() == ".lp":
        return _choose_of_lp(options)
    files = _inputs(options, options.ball, options.output)
    if options.per_light:
        files = in_order_of_lights(files)
    chosen = _choose(options, files)
    sightings, pictured = _sightings(options, files, chosen, progress)
    found = find_lights(sightings)
    progress(0.9, "drawing what was found")
    lights = report.lights_by_balls(found, chosen.names, chosen.files)
    balls = [report.ball_facts(sighting.ball) for sighting in found.sightings]
    lines = [f"{options.output}:", *map(str, lights), *map(str, balls)]
    target = found.target.tolist()
    result = operations.LightsCalibrated(options.output, options.overlay, lights, balls, target, text="\n".join(lines))
    with disk.write_transaction():
        _write_rig(options, found, chosen)
        if options.overlay:
            _draw(options.overlay, found, chosen, pictured)
        _write_json(options, result)
    progress(1.0, "done")
    return result


def _is_lp(options: operations.CalibrateLights) -> bool:
    return Path(options.output).suffix.lower() == ".lp"


def _choose(options: operations.CalibrateLights, files: Sequence[Path]) -> _Chosen:
    if not options.per_light and (options.places > 1 or options.lights):
        raise SettingsError("--places and --lights are for photos of one light each; add --per-light")
    if len(files) % options.places:
        raise SettingsError(f"{len(files)} photos cannot be divided among {options.places} places; give as many each")
    places = options.places if options.per_light else len(files)
    count = len(files) // places if options.per_light else 3
    numbers = _three_of(options.lights, count) if options.lights else list(range(count))
    if len(numbers) != 3 and not _is_lp(options):
        raise SettingsError(
            f"there are photos of {count} light(s) where a rig has three; choose them with --lights 1,2,3, or "
            f"write an .lp file{_numbered(files[:count])}"
        )
    if options.per_light and count < 2:
        raise SettingsError("--per-light takes a photo for each light; leave it out for one photo under all")
    names = [*CHANNELS] if len(numbers) == 3 else [str(number + 1) for number in numbers]
    return _Chosen(places, numbers, names, [files[k] for k in numbers] if options.per_light else None)


def _sightings(
    options: operations.CalibrateLights, files: Sequence[Path], chosen: _Chosen, progress: Progress
) -> tuple[list[Sighting], list[BallPhotos]]:
    """Each ball's highlights of the chosen lights, and the photos that show the ball."""
    sightings, pictured = [], []
    for number, photos in enumerate(_by_place(options, files, chosen.places)):
        step = part(progress, 0.9 * number / chosen.places, 0.9 * (number + 1) / chosen.places)
        try:
            seen = read_sightings(photos, step)
        except InputError as error:
            hint = f"; {options.overlay} shows the ball that was found" if _ball_drawn(photos, options.overlay) else ""
            raise type(error)(f"{error}{hint}") from None
        for sighting in seen:
            highlights = tuple(sighting.highlights[light] for light in chosen.numbers)
            sightings.append(replace(sighting, highlights=highlights))
            pictured.append(photos)
    return sightings, pictured


def _by_place(options: operations.CalibrateLights, files: Sequence[Path], places: int) -> list[BallPhotos]:
    if options.mask and not options.circle and (places > 1 or options.balls > 1):
        raise SettingsError("--mask shows one ball at one place; give circles instead")
    photos = _photos(options, files, balls=options.balls)
    circles: Sequence[Circle] = photos.circles
    if len(circles) % places:
        raise SettingsError(f"there are {len(circles)} circles for {places} places; give as many for each")
    share, each = len(files) // places, len(circles) // places
    of_place = [(slice(k * share, (k + 1) * share), slice(k * each, (k + 1) * each)) for k in range(places)]
    return [replace(photos, files=files[own], circles=circles[drawn]) for own, drawn in of_place]


def _write_rig(options: operations.CalibrateLights, found: LightsFound, chosen: _Chosen) -> None:
    if _is_lp(options):
        names = [file.stem for file in chosen.files] if chosen.files else chosen.names
        write_lp(options.output, found.directions, names)
        return
    _log_replaced_rig(Path(options.output))
    if found.positions is not None and not options.distant:
        write_rig(options.output, near_rig(found.positions, found.target))
    else:
        write_rig(options.output, LightRig(found.directions))


def _draw(overlay: str, found: LightsFound, chosen: _Chosen, pictured: Sequence[BallPhotos]) -> None:
    labels = chosen.names
    if chosen.files:
        labels = [f"{name} {file.stem}" for name, file in zip(labels, chosen.files, strict=True)]
    tiles = [
        report.lights_picture(mean_photo(photos), sighting, found.directions, labels)
        for photos, sighting in zip(pictured, found.sightings, strict=True)
    ]
    titled = [(f"{place}", tile) for place, tile in enumerate(tiles, 1)]
    picture = tiles[0] if len(tiles) == 1 else contact_sheet(titled, 2, tile_height=tiles[0].shape[0])
    write_picture(overlay, picture)


def _choose_of_lp(options: operations.CalibrateLights) -> operations.LightsCalibrated:
    """A rig from three lights of an .lp file."""
    if len(options.ball) > 1 or options.overlay or options.json:
        raise SettingsError("an .lp file works alone, with --lights and -o only; leave the rest out")
    [file] = options.ball
    names, directions = read_lp(file)
    if not options.lights:
        raise SettingsError(f"{file} has {len(names)} light(s); choose --lights 1,2,3{_numbered(map(Path, names))}")
    numbers = _three_of(options.lights, len(names))
    disk.check_no_overwrite([file], [options.output])
    if disk.writable_path(options.output).suffix.lower() != ".json":
        raise FileError(f"{options.output}: a rig of three lights is written as .json; give such a file name")
    rig = LightRig(directions[numbers])
    _log_replaced_rig(Path(options.output))
    write_rig(options.output, rig)
    lights = report.lights_facts(rig.directions, CHANNELS, file=[names[k] for k in numbers])
    text = "\n".join([f"{options.output}:", *map(str, lights)])
    return operations.LightsCalibrated(options.output, None, lights, text=text)


def calibrate_mixing(options: operations.CalibrateMixing, progress: Progress = silent) -> operations.MixingCalibrated:
    """Write the rig with its mixing, and the other outputs if requested."""
    files = in_order_of_lights(_inputs(options, options.photo, options.output, options.rig))
    rig = read_rig(options.rig)
    _check(options, files, rig)
    photos = _photos(options, files, mirror=False)
    progress(0.0, "reading the photos")
    if options.card and not (photos.circles or photos.mask):
        raise SettingsError("--card needs the card's outline; give --mask FILE, or --circle X,Y,R for a part of it")
    read = read_lit(photos, rig)
    warn_of_other_exposures(files, read)
    image = mean_photo(photos, read)
    found = _by_card(options, photos, read, rig) if options.card else _by_ball(photos, read, image, rig, progress)
    calibrated = replace(rig, mixing=found.mixing, is_ground_truth=False)
    off = None if found.ball is None else mixing.lambertian_error(read, found.ball, calibrated)
    result = _result(options, found, off)
    with disk.write_transaction():
        write_rig(options.output, calibrated)
        if options.overlay and found.ball is not None:
            picture = report.ball_picture(image, found.ball, f"{found.residual:.1%} unexplained")
            write_picture(options.overlay, picture)
        _write_json(options, result)
    progress(1.0, "done")
    return result


def _check(options: operations.CalibrateMixing, files: Sequence[Path], rig: LightRig) -> None:
    if Path(options.output).suffix.lower() != ".json":
        raise FileError(f"{options.output}: a rig with its mixing is written as .json; give such a file name")
    if rig.near is not None and not options.card and options.radius is None:
        raise SettingsError("the rig's lights are near, so the ball's size counts; give --radius in the rig's unit")
    if len(options.circle) > 1:
        raise SettingsError(f"a photo for the mixing shows one {'card' if options.card else 'ball'}; give one circle")
    if options.normal and not options.card:
        raise SettingsError("--normal is for a card; add --card, or leave it out")
    if len(files) not in ((3,) if options.card else (1, 3)):
        wanted = "a card takes three photos, one" if options.card else "give one photo of a grey ball, or three, one"
        raise SettingsError(f"there are {len(files)} photo(s): {wanted} under each light alone, in the rig's order")


def _by_ball(
    photos: BallPhotos, read: Sequence[Image], image: "F32", rig: "LightRig", progress: Progress
) -> mixing.MixingFound:
    ball = seen_balls(photos, image)[0]
    # Before the fit, which may refuse such lights without knowing where they are.
    mixing.check_lights(image, ball, replace(rig, mixing=np.eye(3)))
    progress(0.4, "solving for the mixing")
    return (
        mixing.mixing_from_ball(read[0], ball, rig)
        if len(read) == 1
        else mixing.mixing_from_ball_by_light(read, ball, rig)
    )


def _by_card(
    options: operations.CalibrateMixing, photos: BallPhotos, read: Sequence[Image], rig: LightRig
) -> mixing.MixingFound:
    if options.overlay:
        raise SettingsError("--overlay shows a ball; leave it out with --card")
    normal = _numbers(options.normal, "--normal") if options.normal else [0.0, 0.0, 1.0]
    return mixing.mixing_from_card(read, lit_surface(photos, read[0]), rig, normal)


def _result(
    options: operations.CalibrateMixing, found: mixing.MixingFound, off: float | None
) -> operations.MixingCalibrated:
    balls = [] if found.ball is None else [report.ball_facts(found.ball)]
    same = {name: getattr(found, name) for name in ("residual", "pixels", "left_out", "determined", "uncertainty")}
    same |= {"mixing": found.mixing.tolist(), "ambient": found.ambient.tolist(), "equation_2_error": off}
    text = "\n".join([f"{options.output}:", *report.mixing_lines(found, off), *map(str, balls)])
    return operations.MixingCalibrated(options.output, options.overlay, balls=balls, text=text, **same)


def _without_masks(files: list[Path]) -> list[Path]:
    """The files matched by a pattern, without masks, which are recognised by name."""
    photos = [file for file in files if not re.search(r"(^|[^a-z])mask$", file.stem.lower())]
    if not photos or len(photos) == len(files):
        return files
    masks = ", ".join(file.name for file in files if file not in photos)
    log.info("%s is left out, a mask by its name; --mask shows where the ball is", masks)
    return photos


def _numbers(text: str, option: str, wanted: str = "three numbers, such as 250,148,119") -> list[float]:
    """The three numbers, separated by commas, that an option gives."""
    with contextlib.suppress(ValueError):
        numbers = [float(number) for number in text.split(",")]
        if len(numbers) == 3:
            return numbers
    raise SettingsError(f"{option} {text} is not {wanted}")


def _three_of(text: str, count: int) -> list[int]:
    wanted = f"three different lights, numbers from 1 to {count}: 1,5,9 for one"
    numbers = _numbers(text, "--lights", wanted)
    if len({*numbers} & {*range(1, count + 1)}) != 3:
        raise SettingsError(f"--lights {text} is not {wanted}")
    return [int(number) - 1 for number in numbers]


def _numbered(files: Iterable[Path]) -> str:
    """The files with their numbers, for the end of a sentence; only the first ones if there are many."""
    numbered = [f"{number} {file.name}" for number, file in enumerate(files, 1)]
    return f" ({', '.join(numbered[:MAX_NAMED] + ['...'] * (len(numbered) > MAX_NAMED))})"


def _ball_drawn(photos: BallPhotos, overlay: str | None) -> bool:
    """Draw the first ball if its highlights were not found: it is often something else."""
    if not overlay:
        return False
    try:
        image = mean_photo(photos)
        ball = seen_balls(photos, image)[0]
    except InputError:  # there is no ball to draw
        return False
    write_picture(overlay, report.ball_picture(image, ball, "no lights found"))
    return True


def _log_replaced_rig(file: Path) -> None:
    """Report that overwriting the rig file discards its mixing, which belongs to other lights."""
    with contextlib.suppress(InputError):
        if file.is_file() and not np.array_equal(read_rig(file).mixing, np.eye(3)):
            log.warning("the mixing that %s held was of its old lights and is dropped; calibrate it again", file.name)


# --- a mesh -----------------------------------------------------------------------------------------------------------


def calibrate_mesh(options: operations.CalibrateMesh, progress: Progress = silent) -> operations.MeshCalibrated:
    """Write the rig of the lights that fit a photo of a known mesh."""
    files = options.photos(options.image, options.mesh, options.camera)
    camera, mesh = read_camera(options.camera), options.read_mesh(options.mesh, shape_only=True)
    source, *others = options.sources(files, options.mask)
    if others:
        raise SettingsError(f"{len(files)} photos where one is needed; with --per-light, three of one light each")
    image, mask, _ = options.photo_and_mask(source, progress)
    progress(0.3, "fitting the lights")
    with disk.prefix_errors(source):
        found = lights_of_photo(image, mask, camera, mesh, mixed=not options.per_light)
        # Under these lights, the shading may show another encoding.
        again, mask, _ = options.photo_and_mask(replace(source, rig=_rig_of(found)), progress)
        if not np.array_equal(again.pixels, image.pixels):
            found = lights_of_photo(again, mask, camera, mesh, mixed=not options.per_light)
        rig = _rig_of(found)
    write_rig(options.output, rig)
    lights = report.lights_facts(rig.directions, CHANNELS, uncertainty=found.errors.tolist())
    if found.residual > operations.POOR:
        words = "the mesh explains the photo badly (typical difference %.0f%%): check the camera and the mesh, and "
        log.warning(words + "that the object is matt [mesh-misfit]", 100 * found.residual)
    text = "\n".join([*map(str, lights), f"{options.output}: the rig"])
    result = operations.MeshCalibrated(options.output, lights, round(found.residual, 4), found.paints, text=text)
    if options.json:
        disk.write_json(options.json, result.metrics())
    progress(1.0, "done")
    return result


def _rig_of(found: LightsOnMesh) -> LightRig:
    crosstalk = found.mixing * (1 - np.eye(3))
    return LightRig(found.directions, found.mixing if crosstalk.max() > LEAST_CROSSTALK else np.eye(3))
