"""The verb calibrate: where the lights are, and how their colours mix, by photos of balls and cards."""

import argparse
import contextlib
import logging
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpsnet_core.capture.operations import files_read
from mpsnet_core.cli.arguments import Help, Verbs, add_reading, parse_correction
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.errors import InputError

if TYPE_CHECKING:
    from mpsnet_core.capture.calibrate.ball import Ball, Circle
    from mpsnet_core.capture.calibrate.lights import LightsFound
    from mpsnet_core.capture.calibrate.mixing import MixingFound
    from mpsnet_core.capture.calibrate.photos import BallPhotos
    from mpsnet_core.io.image import Image
    from mpsnet_core.scene.rig import LightRig

log = logging.getLogger(__name__)

COLOURS = ("red", "green", "blue")
# So many files are named in a sentence.
MOST_NAMED = 16


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    parser = verbs.add_parser("calibrate", help="where the lights are and how their colours mix, by photos of balls")
    what = parser.add_subparsers(metavar="WHAT", required=True)
    _add_lights(
        what.add_parser("lights", parents=[common], formatter_class=Help, help="a mirror ball tells where lights are")
    )
    _add_mixing(
        what.add_parser("mixing", parents=[common], formatter_class=Help, help="a grey ball or card tells the mixing")
    )


def _add_shared(parser: argparse.ArgumentParser) -> None:
    """Options of both: where the ball is in the photo, and how the camera sees."""
    parser.add_argument(
        "--circle",
        action="append",
        metavar="X,Y,R",
        help="the ball's outline by hand: its middle from the photo's top left corner and its radius, in pixels; "
        "repeatable, in the balls' order; it is looked for unless given",
    )
    parser.add_argument("--mask", help="mask file of what the photo is of")
    camera = parser.add_mutually_exclusive_group()
    camera.add_argument("--camera", metavar="FILE", help="camera file; without it the camera is taken as far away")
    camera.add_argument("--focal", type=float, metavar="MM", help="in its place the lens, in mm on a 36 mm sensor")
    parser.add_argument(
        "--radius",
        type=float,
        help="of the ball, in the unit of the lights' positions, best the mesh's; without it they count in radii",
    )
    add_reading(parser)
    parser.add_argument("--overlay", metavar="PNG", help="write a picture of what was found, drawn over the photo")
    parser.add_argument("--json", metavar="FILE", help="write what was found as JSON")


# --- lights -----------------------------------------------------------------------------------------------------------


def _add_lights(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "ball",
        nargs="+",
        help="photo(s) of a mirror ball under the red, green and blue light at once, one for each place of the ball, "
        "or an .lp file, of which --lights chooses three",
    )
    _add_shared(parser)
    parser.add_argument(
        "--per-light",
        action="store_true",
        help="the photos show one light each, in the order red, green, blue (any number of lights for an .lp file)",
    )
    parser.add_argument(
        "--places",
        type=int,
        default=1,
        help="with --per-light: at how many places the ball stood, first all photos of the first place",
    )
    parser.add_argument("--balls", type=int, default=1, help="how many mirror balls each photo shows")
    parser.add_argument(
        "--lights",
        metavar="R,G,B",
        help="with --per-light or an .lp file: which of the lights, counted from 1 in the order of the table, are the "
        "rig's red, green and blue one",
    )
    parser.add_argument("--distant", action="store_true", help="write directions, though positions could be told")
    parser.add_argument(
        "-o", "--output", required=True, metavar="RIG", help="rig file (.json), or .lp with any number of directions"
    )
    parser.set_defaults(verb=_lights)


def _lights(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    if Path(options.ball[0]).suffix.lower() == ".lp":
        return _lights_of_lp(options)
    from mpsnet_core.capture.calibrate.lights import find_lights, write_lp
    from mpsnet_core.capture.calibrate.overlay import lights_picture
    from mpsnet_core.capture.calibrate.photos import mean_photo, read_sightings
    from mpsnet_core.io.files import written_together
    from mpsnet_core.io.images import write_image
    from mpsnet_core.progress import part
    from mpsnet_core.scene.pictures import sheet
    from mpsnet_core.scene.rig import LightRig, near_rig, write_rig

    files = _inputs(options.ball, options)
    is_lp = Path(options.output).suffix.lower() == ".lp"
    for name in ("places", "balls"):
        if getattr(options, name) < 1:
            raise InputError(f"--{name} is a number from 1 up, not {getattr(options, name)}")
    if not options.per_light and (options.places > 1 or options.lights):
        raise InputError("--places and --lights are for photos of one light each; add --per-light, or leave them out")
    if len(files) % options.places:
        raise InputError(
            f"{len(files)} photos cannot be shared out to {options.places} places; give as many for each place"
        )
    places = options.places if options.per_light else len(files)
    count = len(files) // places if options.per_light else 3
    chosen = _chosen(options.lights, count) if options.lights else list(range(count))
    if len(chosen) != 3 and not is_lp:
        raise InputError(
            f"there are photos of {count} light(s) where a rig has three; choose them with --lights 1,2,3, or write an "
            f".lp file{_numbered(files[:count])}"
        )
    if options.per_light and count < 2:
        raise InputError("--per-light takes a photo for each light; leave it out for one photo under all of them")
    names = [*COLOURS] if len(chosen) == 3 else [str(number + 1) for number in chosen]
    shown_by = [files[k].name for k in chosen] if options.per_light else None
    labels = [f"{name} {files[k].stem}" for name, k in zip(names, chosen, strict=True)] if options.per_light else names
    sightings, pictured = [], []
    for number, photos in enumerate(_by_place(files, places, options)):
        step = part(reporter.progress, 0.9 * number / places, 0.9 * (number + 1) / places)
        try:
            seen = read_sightings(photos, step)
        except InputError as error:
            shown = f"; {options.overlay} shows the ball that was found" if _ball_drawn(photos, options.overlay) else ""
            raise InputError(f"{error}{shown}") from None
        for sighting in seen:
            kept = tuple(sighting.highlights[light] for light in chosen)
            sightings.append(replace(sighting, highlights=kept))
            pictured.append(photos)
    found = find_lights(sightings)
    near = found.positions is not None and not options.distant
    reporter.progress(0.9, "drawing what was found")
    with written_together():
        if is_lp:
            write_lp(options.output, found.directions, [files[k].stem for k in chosen] if options.per_light else names)
        else:
            _note_replaced(Path(options.output))
            if near:
                assert found.positions is not None
                write_rig(options.output, near_rig(found.positions, found.target))
            else:
                write_rig(options.output, LightRig(found.directions))
        if options.overlay:
            tiles = [
                lights_picture(mean_photo(photos), sighting, found.directions, labels)
                for photos, sighting in zip(pictured, sightings, strict=True)
            ]
            titled = [(f"{place}", tile) for place, tile in enumerate(tiles, 1)]
            picture = tiles[0] if len(tiles) == 1 else sheet(titled, 2, tile_height=tiles[0].shape[0])
            write_image(options.overlay, picture, bits=8, color_space="sRGB")
        told = _written_result(options, _lights_data(found, names, shown_by))
    reporter.progress(1.0, "done")
    return told


def _lights_of_lp(options: argparse.Namespace) -> dict[str, Any]:
    """A rig of three of an .lp file's lights."""
    from mpsnet_core.io.files import writable_path
    from mpsnet_core.io.frames import check_apart
    from mpsnet_core.scene.rig import LightRig, angles_of, read_lp, write_rig

    if len(options.ball) > 1 or options.overlay or options.json:
        raise InputError("an .lp file is taken by itself, with --lights and -o alone; leave the rest out")
    [file] = options.ball
    try:
        names, directions = read_lp(file)
    except InputError as error:
        raise InputError(str(error) if file in str(error) else f"{file}: {error}") from None
    if not options.lights:
        raise InputError(
            f"{file} holds {len(names)} light(s); choose three with --lights 1,2,3{_numbered(map(Path, names))}"
        )
    chosen = _chosen(options.lights, len(names))
    check_apart([file], [options.output])
    if writable_path(options.output).suffix.lower() != ".json":
        raise InputError(f"{options.output}: a rig of three lights is a .json file; name one")
    rig = LightRig(directions[chosen])
    _note_replaced(Path(options.output))
    write_rig(options.output, rig)
    slants, tilts = angles_of(rig.directions)
    lights = [
        {"name": name, "file": names[k], "direction": direction.tolist(), "slant": float(slant), "tilt": float(tilt)}
        for name, k, direction, slant, tilt in zip(COLOURS, chosen, rig.directions, slants, tilts, strict=True)
    ]
    lines = [
        f"{one['name'].rjust(6)} ({one['file']}): slant {one['slant']:.2f}°, tilt {one['tilt']:.2f}°" for one in lights
    ]
    return {"output": options.output, "lights": lights, "text": "\n".join([f"{options.output}:", *lines])}


def _numbered(files: Iterable[Path]) -> str:
    """The files with their numbers, for the end of a sentence; the first of them, where there are many."""
    told = [f"{number} {file.name}" for number, file in enumerate(files, 1)]
    return f" ({', '.join(told[:MOST_NAMED] + ['...'] * (len(told) > MOST_NAMED))})"


def _ball_drawn(photos: "BallPhotos", overlay: str | None) -> bool:
    """Draw at least the first ball, where its highlights were not found: most often it is none."""
    from mpsnet_core.capture.calibrate.overlay import ball_picture
    from mpsnet_core.capture.calibrate.photos import mean_photo, seen_balls
    from mpsnet_core.io.images import write_image

    if not overlay:
        return False
    try:
        image = mean_photo(photos)
        ball = seen_balls(photos, image)[0]
    except InputError:  # there is no ball to draw
        return False
    write_image(overlay, ball_picture(image, ball, "no lights found"), bits=8, color_space="sRGB")
    return True


def _note_replaced(file: Path) -> None:
    """Tell of a mixing that goes with the rig file that is written over: it was that of other lights."""
    import numpy as np

    from mpsnet_core.scene.rig import read_rig

    with contextlib.suppress(InputError):
        if file.is_file() and not np.array_equal(read_rig(file).mixing, np.eye(3)):
            log.info("the mixing that %s held is gone with its lights; find it again", file.name)


def _chosen(text: str, count: int) -> list[int]:
    try:
        numbers = [int(number) for number in text.split(",")]
    except ValueError:
        numbers = []
    if len(set(numbers)) != 3 or len(numbers) != 3 or not all(1 <= number <= count for number in numbers):
        raise InputError(f"--lights {text} must be three different lights, numbers from 1 to {count}: 1,5,9 for one")
    return [number - 1 for number in numbers]


def _by_place(files: Sequence[Path], places: int, options: argparse.Namespace) -> list["BallPhotos"]:
    circles = _circles(options)
    if len(circles) % places:
        raise InputError(f"there are {len(circles)} circles for {places} places of the ball; give as many for each")
    if options.mask and (places > 1 or options.balls > 1):
        raise InputError("--mask shows one ball at one place; give circles instead")
    photos = _photos(options, files, circles, balls=options.balls)
    share, each = len(files) // places, len(circles) // places
    return [
        replace(
            photos,
            files=files[place * share : (place + 1) * share],
            circles=circles[place * each : (place + 1) * each],
        )
        for place in range(places)
    ]


def _lights_data(found: "LightsFound", names: Sequence[str], files: Sequence[str] | None) -> dict[str, Any]:
    from mpsnet_core.scene.rig import angles_of

    lights = []
    lines = []
    for k, name in enumerate(names):
        slant, tilt = (float(angle) for angle in angles_of(found.directions[k]))
        light = {
            "name": name,
            "direction": found.directions[k].tolist(),
            "slant": slant,
            "tilt": tilt,
            "uncertainty": float(found.uncertainties[k]),
            "highlights": [
                {
                    "ball": number,
                    "x": spot.x,
                    "y": spot.y,
                    "radius": spot.radius,
                    "clipped": spot.clipped,
                    "rival": spot.rival,
                    "colour": list(spot.colour),
                }
                for number, spot in enumerate(sighting.highlights[k] for sighting in found.sightings)
            ],
        }
        shown = ""
        if files is not None:
            light["file"] = files[k]
            shown = f" ({files[k]})"
        line = f"{name.rjust(6)}{shown}: slant {slant:.2f}°, tilt {tilt:.2f}°, ± {found.uncertainties[k]:.2f}°"
        if found.positions is not None and found.position_uncertainties is not None and found.gaps is not None:
            light |= {
                "position": found.positions[k].tolist(),
                "position_uncertainty": float(found.position_uncertainties[k]),
                "gap": float(found.gaps[k]),
            }
            place = ", ".join(f"{value:.4g}" for value in found.positions[k])
            line += f"; at {place}, ± {found.position_uncertainties[k]:.2g}, rays meet to {found.gaps[k]:.2g}"
        clipped = any(sighting.highlights[k].clipped for sighting in found.sightings)
        lines.append(line + (" (clipped)" if clipped else ""))
        lights.append(light)
    balls = [_ball_data(sighting.ball) for sighting in found.sightings]
    lines += [_ball_line(sighting.ball) for sighting in found.sightings]
    return {"lights": lights, "balls": balls, "target": found.target.tolist(), "text": "\n".join(lines)}


# --- mixing -----------------------------------------------------------------------------------------------------------


def _add_mixing(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "photo",
        nargs="+",
        help="a photo of a matt grey ball under all three lights, or three, each under one light, in the rig's order",
    )
    parser.add_argument("--rig", required=True, help="rig file with the lights' directions or positions")
    _add_shared(parser)
    parser.add_argument("--card", action="store_true", help="the photos show a flat grey card: one photo a light")
    parser.add_argument("--normal", metavar="X,Y,Z", help="where the card faces, in camera space (default: 0,0,1)")
    parser.add_argument("-o", "--output", required=True, metavar="RIG", help="rig file with the mixing (.json)")
    parser.set_defaults(verb=_mixing)


def _mixing(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.capture.calibrate.mixing import mixing_from_ball, mixing_from_ball_by_light
    from mpsnet_core.capture.calibrate.overlay import ball_picture
    from mpsnet_core.capture.calibrate.photos import mean_photo, seen_balls
    from mpsnet_core.io.files import written_together
    from mpsnet_core.io.images import write_image
    from mpsnet_core.scene.rig import read_rig, write_rig

    files = _inputs(options.photo, options)
    rig = read_rig(options.rig)
    if Path(options.output).suffix.lower() != ".json":
        raise InputError(f"{options.output}: a rig with its mixing is a .json file; name one")
    if rig.near is not None and not options.card and options.radius is None:
        raise InputError("the rig's lights stand near the ball, so its size counts; give --radius, in the rig's unit")
    if options.normal and not options.card:
        raise InputError("--normal is a card's; add --card, or leave it out")
    if len(files) not in ((3,) if options.card else (1, 3)):
        wanted = "a card takes three photos, one" if options.card else "give one photo of a grey ball, or three, one"
        raise InputError(f"there are {len(files)} photo(s): {wanted} under each light alone, in the rig's order")
    photos = _photos(options, files, _circles(options), mirror=False)
    reporter.progress(0.0, "reading the photos")
    read = [photos.read(file) for file in files]
    image = mean_photo(photos, read)
    picture = None
    if options.card:
        found = _card(photos, read, options, rig)
    else:
        ball = seen_balls(photos, image)[0]
        reporter.progress(0.4, "solving for the mixing")
        one = len(files) == 1
        found = mixing_from_ball(read[0], ball, rig) if one else mixing_from_ball_by_light(read, ball, rig)
        assert found.ball is not None
        picture = ball_picture(image, found.ball, f"{found.residual:.1%} unexplained")
    with written_together():
        write_rig(options.output, replace(rig, mixing=found.mixing))
        if options.overlay and picture is not None:
            write_image(options.overlay, picture, bits=8, color_space="sRGB")
        told = _written_result(options, _mixing_data(found))
    reporter.progress(1.0, "done")
    return told


def _card(photos: "BallPhotos", read: Sequence["Image"], options: argparse.Namespace, rig: "LightRig") -> "MixingFound":
    import numpy as np

    from mpsnet_core.capture.calibrate.mixing import mixing_from_card
    from mpsnet_core.io.images import read_mask

    if options.overlay:
        raise InputError("--overlay shows a ball; leave it out with --card")
    height, width = read[0].pixels.shape[:2]
    if photos.mask is not None:
        mask = read_mask(photos.mask)
        if mask.shape != (height, width):
            raise InputError(f"the mask {photos.mask} is not of the photo's size, {width} x {height}; make it so")
    elif photos.circles:
        x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
        mask = np.hypot(x - photos.circles[0].x, y - photos.circles[0].y) < photos.circles[0].radius
    else:
        raise InputError("where is the card? Give --mask FILE, or --circle X,Y,R for a part of it")
    normal = _numbers(options.normal, "--normal") if options.normal else [0.0, 0.0, 1.0]
    return mixing_from_card(read, mask, rig, normal)


def _mixing_data(found: "MixingFound") -> dict[str, Any]:
    rows = [
        f"{channel.rjust(6)}: " + "  ".join(f"{value:6.3f}" for value in row)
        for channel, row in zip(COLOURS, found.mixing, strict=True)
    ]
    data: dict[str, Any] = {
        "mixing": found.mixing.tolist(),
        "residual": found.residual,
        "ambient": found.ambient.tolist(),
        "pixels": found.pixels,
        "left_out": found.left_out,
        "determined": found.determined,
        "uncertainty": found.uncertainty,
        "balls": [] if found.ball is None else [_ball_data(found.ball)],
    }
    if not found.determined:
        rows.append("the lights' strengths alone: the photo does not tell how their colours mix")
    left_out = f"{found.left_out:.1%} of {found.pixels} pixels left out"
    rows.append(f"{found.residual:.2%} of the brightness unexplained, {left_out}")
    if found.ball is not None:
        rows.append(_ball_line(found.ball))
    return {**data, "text": "\n".join(rows)}


# --- both -------------------------------------------------------------------------------------------------------------


def _inputs(given: Sequence[str], options: argparse.Namespace) -> list[Path]:
    """The photos, once it is sure that the results can be written and overwrite none of what is read."""
    from mpsnet_core.io.files import writable_path
    from mpsnet_core.io.frames import check_apart, expand_images, natural_order
    from mpsnet_core.io.images import checked_bits

    if options.radius is not None and not 0 < options.radius < math.inf:
        raise InputError(f"--radius is the ball's radius, a number above 0, not {options.radius:g}")
    files = _without_masks(expand_images(given))
    if files == sorted(files, key=lambda file: str(file)):
        files = sorted(files, key=natural_order)  # a shell puts 10 before 2
    outputs = [file for file in (options.output, options.overlay, options.json) if file]
    for number, output in enumerate(outputs):
        writable_path(output)
        # The rig may be read whole and then written anew; nothing else may take its place.
        rig = [options.rig] if number and "rig" in options else []
        check_apart([*files, *files_read(options), *rig, *outputs[:number]], [output])
    if options.overlay:
        checked_bits(Path(options.overlay), 8)
    return files


def _without_masks(files: list[Path]) -> list[Path]:
    """The photos among files that a pattern took in; masks are told by their names."""
    photos = [file for file in files if not re.search(r"(^|[^a-z])mask$", file.stem.lower())]
    if not photos or len(photos) == len(files):
        return files
    masks = ", ".join(file.name for file in files if file not in photos)
    log.info("%s is left out, a mask by its name; --mask says where the ball is", masks)
    return photos


def _photos(
    options: argparse.Namespace, files: Sequence[Path], circles: Sequence["Circle"], **more: Any
) -> "BallPhotos":
    from mpsnet_core.capture.calibrate.photos import BallPhotos
    from mpsnet_core.scene.camera import read_camera

    return BallPhotos(
        files,
        circles,
        Path(options.mask) if options.mask else None,
        camera=read_camera(options.camera) if options.camera else options.focal,
        radius=1.0 if options.radius is None else options.radius,
        encoding=options.encoding,
        layer=options.layer,
        correction=parse_correction(options),
        **more,
    )


def _circles(options: argparse.Namespace) -> list["Circle"]:
    from mpsnet_core.capture.calibrate.ball import Circle

    if options.circle and options.mask:
        raise InputError("--circle and --mask both say where it is; give one of them")
    return [Circle(*_numbers(text, "--circle")) for text in options.circle or []]


def _numbers(text: str, option: str) -> list[float]:
    try:
        numbers = [float(number) for number in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3:
        raise InputError(f"{option} {text} is not three numbers with commas between them, such as 250,148,119")
    return numbers


def _ball_data(ball: "Ball") -> dict[str, Any]:
    circle = ball.circle
    return {
        "by_hand": ball.by_hand,
        "circle": [circle.x, circle.y, circle.radius],
        "residual": ball.residual,
        "seen": ball.seen,
        "centre": ball.centre.tolist(),
        "radius": ball.radius,
    }


def _ball_line(ball: "Ball") -> str:
    x, y, radius = ball.circle.x, ball.circle.y, ball.circle.radius
    if ball.by_hand:
        return f"  ball: {x:.1f},{y:.1f},{radius:.1f} pixels, given by hand"
    return (
        f"  ball: {x:.1f},{y:.1f},{radius:.1f} pixels, {ball.seen:.0%} of its outline seen, fits to "
        f"{ball.residual:.2f} pixels"
    )


def _written_result(options: argparse.Namespace, data: dict[str, Any]) -> dict[str, Any]:
    """The result, with where it was written; also as a JSON file where that is asked for."""
    from mpsnet_core.io.files import write_json

    text = data.pop("text")
    result = {"output": options.output, "overlay": options.overlay, **data}
    if options.json:
        write_json(options.json, result)
    return {**result, "text": f"{options.output}:\n{text}"}
