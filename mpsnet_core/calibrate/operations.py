"""Operations of calibration: light directions, positions and mixing from photos of balls and cards."""

import contextlib
import logging
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from mpsnet_core.capture.operations import HasLens, ReadsPhotos
from mpsnet_core.errors import FileError, InputError, SettingsError
from mpsnet_core.operation import Result, option
from mpsnet_core.progress import Progress, part, silent

if TYPE_CHECKING:
    from mpsnet_core.arrays.types import F32
    from mpsnet_core.calibrate.ball import Circle
    from mpsnet_core.calibrate.lights import LightsFound, Sighting
    from mpsnet_core.calibrate.mixing import MixingFound
    from mpsnet_core.calibrate.photos import BallPhotos
    from mpsnet_core.calibrate.report import BallFacts, LightFacts
    from mpsnet_core.io.image import Image
    from mpsnet_core.scene.rig import LightRig

log = logging.getLogger(__name__)

# Most files to name in a sentence.
MAX_NAMED = 16


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
    mask: str | None = option(default=None, help="mask file, white on the ball or the card", provenance="files")
    radius: float | None = option(
        default=None,
        help="radius of the ball, in the unit wanted for the lights' positions, ideally the mesh's. Also needed "
        "for a grey ball, if the lights have positions",
        unset="positions are in radii of the ball",
    )
    overlay: str | None = option(
        default=None, metavar="PNG", help="write an image of the results, drawn over the photo", provenance="none"
    )
    json: str | None = option(default=None, metavar="FILE", help="write the results as JSON", provenance="none")

    def _inputs(self, given: Sequence[str], output: str, rig: str | None = None) -> list[Path]:
        """The photos, after checking that the results can be written and overwrite no input."""
        from mpsnet_core.io.files import check_no_overwrite, checked_bits, writable_path
        from mpsnet_core.io.frames import expand_images

        if self.radius is not None and not 0 < self.radius < math.inf:
            raise SettingsError(f"--radius is the ball's radius, a number above 0, not {self.radius:g}")
        files = _without_masks(expand_images(given))
        outputs = [file for file in (output, self.overlay, self.json) if file]
        others = self.inputs(self.camera, mask=self.mask)
        for number, one in enumerate(outputs):
            writable_path(one)
            # The rig is read completely before it is written again; no other output may replace it.
            to_keep = [rig] if number and rig else []
            check_no_overwrite([*files, *others, *to_keep, *outputs[:number]], [one])
        if self.overlay:
            checked_bits(Path(self.overlay), 8)
        return files

    def _photos(self, files: Sequence[Path], *, balls: int = 1, mirror: bool = True) -> "BallPhotos":
        from mpsnet_core.calibrate.ball import Circle
        from mpsnet_core.calibrate.photos import BallPhotos

        if self.circle and self.mask:
            raise SettingsError("--circle and --mask both define where the ball or card is; give one of them")
        circles = [Circle(*_numbers(text, "--circle")) for text in self.circle]
        mask, radius = Path(self.mask) if self.mask else None, 1.0 if self.radius is None else self.radius
        return BallPhotos(files, circles, mask, balls, radius, self.lens(), self.read_options(), mirror)

    def _write_json(self, result: Result) -> None:
        from mpsnet_core.io.files import write_json

        if self.json:
            write_json(self.json, result.metrics())


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
    lights: str | None = option(
        default=None,
        metavar="R,G,B",
        help="with --per-light or an .lp file: numbers of the rig's red, green and blue light, counted from 1 "
        "in the order of the table",
        numbers=True,
    )
    distant: bool = option(default=False, help="write directions even where positions could be found")
    output: str = option(metavar="RIG", help="rig file (.json), or .lp of any number of lights", provenance="none")

    def run(self, progress: Progress = silent) -> LightsCalibrated:
        """Write the rig, and the other outputs if requested."""
        if Path(self.ball[0]).suffix.lower() == ".lp":
            return self._choose_of_lp()
        from mpsnet_core.calibrate.lights import find_lights
        from mpsnet_core.calibrate.report import ball_facts, lights_facts
        from mpsnet_core.io.files import write_transaction
        from mpsnet_core.io.frames import in_order_of_lights

        files = self._inputs(self.ball, self.output)
        if self.per_light:
            files = in_order_of_lights(files)
        chosen = self._choose(files)
        sightings, pictured = self._sightings(files, chosen, progress)
        found = find_lights(sightings)
        progress(0.9, "drawing what was found")
        lights = lights_facts(found, chosen.names, chosen.files)
        balls = [ball_facts(sighting.ball) for sighting in found.sightings]
        lines = [f"{self.output}:", *map(str, lights), *map(str, balls)]
        target = found.target.tolist()
        result = LightsCalibrated(self.output, self.overlay, lights, balls, target, text="\n".join(lines))
        with write_transaction():
            self._write_rig(found, chosen)
            if self.overlay:
                self._draw(self.overlay, found, chosen, pictured)
            self._write_json(result)
        progress(1.0, "done")
        return result

    @property
    def _is_lp(self) -> bool:
        return Path(self.output).suffix.lower() == ".lp"

    def _choose(self, files: Sequence[Path]) -> _Chosen:
        from mpsnet_core.io.image import CHANNELS

        if not self.per_light and (self.places > 1 or self.lights):
            raise SettingsError("--places and --lights are for photos of one light each; add --per-light")
        if len(files) % self.places:
            raise SettingsError(f"{len(files)} photos cannot be divided among {self.places} places; give as many each")
        places = self.places if self.per_light else len(files)
        count = len(files) // places if self.per_light else 3
        numbers = _three_of(self.lights, count) if self.lights else list(range(count))
        if len(numbers) != 3 and not self._is_lp:
            raise SettingsError(
                f"there are photos of {count} light(s) where a rig has three; choose them with --lights 1,2,3, or "
                f"write an .lp file{_numbered(files[:count])}"
            )
        if self.per_light and count < 2:
            raise SettingsError("--per-light takes a photo for each light; leave it out for one photo under all")
        names = [*CHANNELS] if len(numbers) == 3 else [str(number + 1) for number in numbers]
        return _Chosen(places, numbers, names, [files[k] for k in numbers] if self.per_light else None)

    def _sightings(
        self, files: Sequence[Path], chosen: _Chosen, progress: Progress
    ) -> tuple[list["Sighting"], list["BallPhotos"]]:
        """Each ball's highlights of the chosen lights, and the photos that show the ball."""
        from mpsnet_core.calibrate.photos import read_sightings

        sightings, pictured = [], []
        for number, photos in enumerate(self._by_place(files, chosen.places)):
            step = part(progress, 0.9 * number / chosen.places, 0.9 * (number + 1) / chosen.places)
            try:
                seen = read_sightings(photos, step)
            except InputError as error:
                hint = f"; {self.overlay} shows the ball that was found" if _ball_drawn(photos, self.overlay) else ""
                raise type(error)(f"{error}{hint}") from None
            for sighting in seen:
                highlights = tuple(sighting.highlights[light] for light in chosen.numbers)
                sightings.append(replace(sighting, highlights=highlights))
                pictured.append(photos)
        return sightings, pictured

    def _by_place(self, files: Sequence[Path], places: int) -> list["BallPhotos"]:
        if self.mask and not self.circle and (places > 1 or self.balls > 1):
            raise SettingsError("--mask shows one ball at one place; give circles instead")
        photos = self._photos(files, balls=self.balls)
        circles: Sequence[Circle] = photos.circles
        if len(circles) % places:
            raise SettingsError(f"there are {len(circles)} circles for {places} places; give as many for each")
        share, each = len(files) // places, len(circles) // places
        of_place = [(slice(k * share, (k + 1) * share), slice(k * each, (k + 1) * each)) for k in range(places)]
        return [replace(photos, files=files[own], circles=circles[drawn]) for own, drawn in of_place]

    def _write_rig(self, found: "LightsFound", chosen: _Chosen) -> None:
        from mpsnet_core.scene.rig import LightRig, near_rig, write_lp, write_rig

        if self._is_lp:
            names = [file.stem for file in chosen.files] if chosen.files else chosen.names
            write_lp(self.output, found.directions, names)
            return
        _log_replaced_rig(Path(self.output))
        if found.positions is not None and not self.distant:
            write_rig(self.output, near_rig(found.positions, found.target))
        else:
            write_rig(self.output, LightRig(found.directions))

    @staticmethod
    def _draw(overlay: str, found: "LightsFound", chosen: _Chosen, pictured: Sequence["BallPhotos"]) -> None:
        from mpsnet_core.calibrate.photos import mean_photo
        from mpsnet_core.calibrate.report import lights_picture
        from mpsnet_core.io.image_writing import write_picture
        from mpsnet_core.scene.pictures import contact_sheet

        labels = chosen.names
        if chosen.files:
            labels = [f"{name} {file.stem}" for name, file in zip(labels, chosen.files, strict=True)]
        tiles = [
            lights_picture(mean_photo(photos), sighting, found.directions, labels)
            for photos, sighting in zip(pictured, found.sightings, strict=True)
        ]
        titled = [(f"{place}", tile) for place, tile in enumerate(tiles, 1)]
        picture = tiles[0] if len(tiles) == 1 else contact_sheet(titled, 2, tile_height=tiles[0].shape[0])
        write_picture(overlay, picture)

    def _choose_of_lp(self) -> LightsCalibrated:
        """A rig from three lights of an .lp file."""
        from mpsnet_core.calibrate.report import directions_facts
        from mpsnet_core.io.files import check_no_overwrite, writable_path
        from mpsnet_core.io.image import CHANNELS
        from mpsnet_core.scene.rig import LightRig, read_lp, write_rig

        if len(self.ball) > 1 or self.overlay or self.json:
            raise SettingsError("an .lp file works alone, with --lights and -o only; leave the rest out")
        [file] = self.ball
        names, directions = read_lp(file)
        if not self.lights:
            raise SettingsError(f"{file} has {len(names)} light(s); choose --lights 1,2,3{_numbered(map(Path, names))}")
        numbers = _three_of(self.lights, len(names))
        check_no_overwrite([file], [self.output])
        if writable_path(self.output).suffix.lower() != ".json":
            raise FileError(f"{self.output}: a rig of three lights is written as .json; give such a file name")
        rig = LightRig(directions[numbers])
        _log_replaced_rig(Path(self.output))
        write_rig(self.output, rig)
        lights = directions_facts(rig.directions, CHANNELS, [names[k] for k in numbers])
        text = "\n".join([f"{self.output}:", *map(str, lights)])
        return LightsCalibrated(self.output, None, lights, text=text)


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
    normal: str | None = option(
        default=None,
        metavar="X,Y,Z",
        help="direction that the card faces, in camera space",
        unset="towards the camera",
        numbers=True,
    )
    output: str = option(metavar="RIG", help="rig file with the mixing (.json)", provenance="none")

    def run(self, progress: Progress = silent) -> MixingCalibrated:
        """Write the rig with its mixing, and the other outputs if requested."""
        from mpsnet_core.calibrate.mixing import lambertian_error
        from mpsnet_core.calibrate.photos import mean_photo, read_lit
        from mpsnet_core.calibrate.report import ball_picture
        from mpsnet_core.capture.decode import warn_of_other_exposures
        from mpsnet_core.io.files import write_transaction
        from mpsnet_core.io.frames import in_order_of_lights
        from mpsnet_core.io.image_writing import write_picture
        from mpsnet_core.scene.rig import read_rig, write_rig

        files = in_order_of_lights(self._inputs(self.photo, self.output, self.rig))
        rig = read_rig(self.rig)
        self._check(files, rig)
        photos = self._photos(files, mirror=False)
        progress(0.0, "reading the photos")
        if self.card and not (photos.circles or photos.mask):
            raise SettingsError("--card needs the card's outline; give --mask FILE, or --circle X,Y,R for a part of it")
        read = read_lit(photos, rig)
        warn_of_other_exposures(files, read)
        image = mean_photo(photos, read)
        found = self._by_card(photos, read, rig) if self.card else self._by_ball(photos, read, image, rig, progress)
        calibrated = replace(rig, mixing=found.mixing, is_ground_truth=False)
        off = None if found.ball is None else lambertian_error(read, found.ball, calibrated)
        result = self._result(found, off)
        with write_transaction():
            write_rig(self.output, calibrated)
            if self.overlay and found.ball is not None:
                picture = ball_picture(image, found.ball, f"{found.residual:.1%} unexplained")
                write_picture(self.overlay, picture)
            self._write_json(result)
        progress(1.0, "done")
        return result

    def _check(self, files: Sequence[Path], rig: "LightRig") -> None:
        if Path(self.output).suffix.lower() != ".json":
            raise FileError(f"{self.output}: a rig with its mixing is written as .json; give such a file name")
        if rig.near is not None and not self.card and self.radius is None:
            raise SettingsError("the rig's lights are near, so the ball's size counts; give --radius in the rig's unit")
        if len(self.circle) > 1:
            raise SettingsError(f"a photo for the mixing shows one {'card' if self.card else 'ball'}; give one circle")
        if self.normal and not self.card:
            raise SettingsError("--normal is for a card; add --card, or leave it out")
        if len(files) not in ((3,) if self.card else (1, 3)):
            wanted = "a card takes three photos, one" if self.card else "give one photo of a grey ball, or three, one"
            raise SettingsError(f"there are {len(files)} photo(s): {wanted} under each light alone, in the rig's order")

    @staticmethod
    def _by_ball(
        photos: "BallPhotos", read: Sequence["Image"], image: "F32", rig: "LightRig", progress: Progress
    ) -> "MixingFound":
        import numpy as np

        from mpsnet_core.calibrate.mixing import check_lights, mixing_from_ball, mixing_from_ball_by_light
        from mpsnet_core.calibrate.photos import seen_balls

        ball = seen_balls(photos, image)[0]
        # Before the fit, which may refuse such lights without knowing where they are.
        check_lights(image, ball, replace(rig, mixing=np.eye(3)))
        progress(0.4, "solving for the mixing")
        return mixing_from_ball(read[0], ball, rig) if len(read) == 1 else mixing_from_ball_by_light(read, ball, rig)

    def _by_card(self, photos: "BallPhotos", read: Sequence["Image"], rig: "LightRig") -> "MixingFound":
        from mpsnet_core.calibrate.mixing import mixing_from_card
        from mpsnet_core.calibrate.photos import lit_surface

        if self.overlay:
            raise SettingsError("--overlay shows a ball; leave it out with --card")
        normal = _numbers(self.normal, "--normal") if self.normal else [0.0, 0.0, 1.0]
        return mixing_from_card(read, lit_surface(photos, read[0]), rig, normal)

    def _result(self, found: "MixingFound", off: float | None) -> MixingCalibrated:
        from mpsnet_core.calibrate.report import ball_facts, mixing_lines

        balls = [] if found.ball is None else [ball_facts(found.ball)]
        same = {name: getattr(found, name) for name in ("residual", "pixels", "left_out", "determined", "uncertainty")}
        same |= {"mixing": found.mixing.tolist(), "ambient": found.ambient.tolist(), "equation_2_error": off}
        text = "\n".join([f"{self.output}:", *mixing_lines(found, off), *map(str, balls)])
        return MixingCalibrated(self.output, self.overlay, balls=balls, text=text, **same)


# --- words and files --------------------------------------------------------------------------------------------------


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


def _ball_drawn(photos: "BallPhotos", overlay: str | None) -> bool:
    """Draw the first ball if its highlights were not found: it is often something else."""
    from mpsnet_core.calibrate.photos import mean_photo, seen_balls
    from mpsnet_core.calibrate.report import ball_picture
    from mpsnet_core.io.image_writing import write_picture

    if not overlay:
        return False
    try:
        image = mean_photo(photos)
        ball = seen_balls(photos, image)[0]
    except InputError:  # there is no ball to draw
        return False
    write_picture(overlay, ball_picture(image, ball, "no lights found"))
    return True


def _log_replaced_rig(file: Path) -> None:
    """Report that overwriting the rig file discards its mixing, which belongs to other lights."""
    import numpy as np

    from mpsnet_core.scene.rig import read_rig

    with contextlib.suppress(InputError):
        if file.is_file() and not np.array_equal(read_rig(file).mixing, np.eye(3)):
            log.warning("the mixing that %s held was of its old lights and is dropped; calibrate it again", file.name)
