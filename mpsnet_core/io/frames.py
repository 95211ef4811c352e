"""Photos by files, folders and frame patterns; frame numbers; names of results."""

import glob
import itertools
import logging
import re
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mpsnet_core.errors import FileError
from mpsnet_core.io import files as disk
from mpsnet_core.io.marks import says_made
from mpsnet_core.io.opening import AnyPath

log = logging.getLogger(__name__)

# Suffix of a photo's name for its normals.
RESULT = "_normals"

# Number of gaps in a sequence that a message names.
NAMED_GAPS = 5


@dataclass(frozen=True)
class Numbering:
    """Frame numbers of a sequence: files whose names differ in one run of digits alone, or one file by its last run."""

    head: str
    """What precedes the digits in the names without suffix."""
    tail: str
    """What follows the digits in the names without suffix."""
    digits: tuple[str, ...]
    """The digits of each file's name, as written."""

    @property
    def numbers(self) -> tuple[int, ...]:
        """The frame number of each file."""
        return tuple(map(int, self.digits))

    @property
    def stems(self) -> list[str]:
        """The file names without suffix, with the frame number moved behind all other digits, as Blender expects."""
        if not re.search("[0-9]", self.tail):
            return [f"{self.head}{digits}{self.tail}" for digits in self.digits]
        return [f"{self.head.rstrip('_.- ')}{self.tail}_{digits}" for digits in self.digits]

    @property
    def step(self) -> int:
        """The smallest difference of two frame numbers."""
        return min((b - a for a, b in itertools.pairwise(sorted(self.numbers))), default=1)

    @property
    def gaps(self) -> str:
        """The frame numbers that are missing between the first and the last, as text; "" if there are none."""
        step, gaps = self.step, []
        for a, b in itertools.pairwise(sorted(self.numbers)):
            first, last = a + step, a + (b - a - 1) // step * step
            if first <= last:
                gaps.append(str(first) if first == last else f"{first} to {last}")
        return ", ".join(gaps[:NAMED_GAPS] + ["and more"] * (len(gaps) > NAMED_GAPS))


def numbering(files: Sequence[Path]) -> Numbering | None:
    """The numbering of `files`; None if they are not a sequence: names differ in more than a number, or one repeats."""
    names = [re.split("([0-9]+)", file.stem) for file in files]
    if len({len(name) for name in names}) != 1:
        return None
    columns = list(zip(*names, strict=True))
    differing = [place for place, column in enumerate(columns) if len(set(column)) > 1]
    if len(files) == 1 and len(columns) > 1:
        differing = [len(columns) - 2]
    if len(differing) != 1 or differing[0] % 2 == 0:  # text is at even places, digits between
        return None
    place = differing[0]
    found = Numbering("".join(names[0][:place]), "".join(names[0][place + 1 :]), columns[place])
    return found if len(set(found.numbers)) == len(files) else None


def natural_order(file: Path) -> tuple[list[str | int], str]:
    """A sort key that orders frame_2 before frame_10: runs of digits are compared as numbers."""
    words = re.split("([0-9]+)", file.name)
    return [int(word) if place % 2 else word for place, word in enumerate(words)], file.name


def in_order_of_lights(photos: Sequence[Path]) -> list[Path]:
    """Photos of one light each: three in the given order, which is red, green, blue.

    Warns if these are in a shell's order (10 before 2), which may be unintended. More than three in that order are put
    in natural order.
    """
    natural = sorted(photos, key=natural_order)
    if natural == list(photos) or list(photos) != sorted(photos, key=str):
        return list(photos)
    if len(photos) != 3:
        return natural
    red, green, blue = (photo.name for photo in photos)
    log.warning(
        "red is %s, green %s, blue %s, the order in which a shell sorts them; for another order name the "
        "photos one by one",
        red,
        green,
        blue,
    )
    return list(photos)


def expand_images(inputs: Sequence[AnyPath]) -> list[Path]:
    """The photos of `inputs`: files in order, those of folders and patterns in natural order (frame_2, frame_10).

    A run of # in a pattern matches as many digits; * and ? are as in a shell. If a photo exists as raw and JPEG,
    folders and patterns match the raw file.

    Raises FileError if a file is missing, or a folder or pattern matches no image.
    """
    photos: list[Path] = []
    for given in inputs:
        path = Path(given)
        if path.is_dir():
            found = _without_results(_photos(path.iterdir()), path)
            if not found:
                kinds = ", ".join(disk.IMAGE_SUFFIXES)
                raise FileError(f"folder {path} holds no images ({kinds}, or camera raw); choose another")
        elif path.is_file():
            found = [path]
        elif any(sign in path.name for sign in "#*?"):
            found = _photos(matching_files(path))
            if RESULT not in path.stem:
                found = _without_results(found, path)
            if not found:
                raise FileError(f"no image matches {path}; check the pattern")
        else:
            pattern = re.sub("%0([1-9])d|[$]F([1-9])", lambda count: "#" * int(count[1] or count[2]), path.name)
            hint = f"numbered frames are {path.with_name(pattern)}" if pattern != path.name else "check the path"
            raise FileError(f"image {path} does not exist; {hint}")
        photos += found
    return photos


def is_folder_or_pattern(given: AnyPath) -> bool:
    """Whether a path is a folder or a pattern, not a single file."""
    path = Path(given)
    return path.is_dir() or (bool(set("#*?") & set(path.name)) and not path.is_file())


def is_video(path: AnyPath) -> bool:
    """Whether a file has the suffix of a video."""
    return Path(path).suffix.lower() in disk.VIDEO_SUFFIXES


def expand_file_options(options: Iterable[str | None]) -> list[Path]:
    """The files that options name, with folders and patterns expanded: results must not overwrite them.

    Raises FileError if a folder or a pattern matches none.
    """
    given = [one for one in options if one]
    return [file for one in given for file in (expand_images([one]) if is_folder_or_pattern(one) else [Path(one)])]


def matching_files(given: AnyPath, what: str = "image") -> list[Path]:
    """The files in a folder, or those that match a pattern, in natural order; see :func:`expand_images`.

    what: their name in messages. Raises FileError if there are none.
    """
    path = Path(given)
    if path.is_dir():
        found = list(path.iterdir())
    else:
        pattern = glob.escape(path.name).replace("[*]", "*").replace("[?]", "?")
        found = list(path.parent.glob(pattern.replace("#", "[0-9]")))
    files = sorted((file for file in found if file.is_file() and not _of_the_system(file.name)), key=natural_order)
    if not files:
        raise FileError(f"no {what} matches {path}; check the pattern")
    return files


def _of_the_system(name: str) -> bool:
    """Whether a file is hidden, or one that Windows or macOS creates in folders."""
    return name.startswith(".") or name.lower() in {"thumbs.db", "desktop.ini", "icon\r"}


def output_files(photos: Sequence[Path], output: AnyPath, kind: str | None = None) -> list[Path]:
    """The file of each photo's normals: `output` itself for one photo, NAME_normals in the folder `output` for several.

    kind: format of the files in a folder; "png" by default.

    Raises FileError if two results would share a name, or cannot be written; SettingsError if `output` is a file
    of another format.
    """
    target, suffix = Path(output), disk.file_suffix(kind or "png")
    if len(photos) == 1 and not target.is_dir() and (target.suffix or target.exists()):
        if kind:
            disk.check_ending(target, suffix)
        return [disk.writable_image(target)]
    results_folder(target, f"there are {len(photos)} photos")
    disk.checked_bits(Path(f"normals{suffix}"))
    numbered = numbering(photos)
    stems = numbered.stems if numbered else [photo.stem for photo in photos]
    files = [target / f"{stem}{RESULT}{suffix}" for stem in stems]
    times = Counter(file.name.casefold() for file in files)  # Windows and macOS ignore case
    twice = next((file for file in files if times[file.name.casefold()] > 1), None)
    if twice:
        raise FileError(f"two photos would both be written to {twice}; rename one or estimate them apart")
    for file in files:
        disk.check_own(file)
    return files


def results_folder(output: AnyPath, given: str, what: str = "normals") -> Path:
    """The folder for the normals of several photos, which is created with the first of them.

    given: why it must be a folder, for messages. what: its content, normals by default.

    Raises FileError if `output` is a file, or cannot be created.
    """
    target = Path(output)
    if not target.is_dir() and (target.exists() or target.suffix.lower() in disk.PHOTO_SUFFIXES):
        raise FileError(f"{target} is one file, but {given}; give a folder")
    return disk.creatable_folder(target, what)


def _without_results(photos: Sequence[Path], given: Path) -> list[Path]:
    """The photos of a folder or pattern, without what earlier runs of this program made of others in it."""
    results = [file for file in photos if file.stem.endswith(RESULT) or _says_made(file)]
    others = [file.name for file in results if not file.stem.endswith(RESULT)]
    if others:
        named = ", ".join(others[:NAMED_GAPS] + ["..."] * (len(others) > NAMED_GAPS))
        log.info("%d file(s) of %s are results of this program, no photos, and left out: %s", len(others), given, named)
    return [file for file in photos if file not in set(results)]


def _says_made(file: Path) -> bool:
    from mpsnet_core.io.image_reading import image_description

    return file.suffix.lower() in disk.WRITABLE_BITS and says_made(image_description(file))


def _photos(files: Iterable[Path]) -> list[Path]:
    found = sorted(filter(_is_image, files), key=natural_order)
    raw = {file.with_suffix("") for file in found if file.suffix.lower() in disk.RAW_SUFFIXES}
    beside = (".jpg", ".jpeg", *disk.HEIF_SUFFIXES)
    return [file for file in found if file.suffix.lower() not in beside or file.with_suffix("") not in raw]


def _is_image(file: Path) -> bool:
    return file.suffix.lower() in disk.PHOTO_SUFFIXES and not file.name.startswith(".") and file.is_file()


# ----------------------------------------------------------------------------------------------------------------------
# Folders of photos, looked up by name without suffix.


class PhotoFolder:
    """A folder of photos or masks, with or without subfolders. Each folder is listed once.

    Raises FileError if it is no folder.
    """

    def __init__(self, path: AnyPath, what: str = "photos") -> None:
        self.path = Path(path)
        if not self.path.is_dir():
            raise FileError(f"{path} is not a folder; name the folder of the {what}")
        self._listed: dict[Path, dict[str, list[Path]]] = {}

    def find(
        self, stems: Collection[str], who: str, where: Path | None = None, *, raw_only: bool = False
    ) -> Path | None:
        """The image in the folder `where` (this one by default) that has one of these names without suffix.

        If a photo exists both as raw and in another format, the raw file is returned. Case matters only if it
        distinguishes images. raw_only: return None unless it is a raw file.

        Raises FileError if several match. who: the photo's name in the message.
        """
        folder = self.path if where is None else where
        if folder not in self._listed:
            self._listed[folder] = _by_stem(folder)
        alike = [file for stem in {stem.lower() for stem in stems} for file in self._listed[folder].get(stem, [])]
        found = sorted([file for file in alike if file.stem in stems] or alike)
        raw = [file for file in found if file.suffix.lower() in disk.RAW_SUFFIXES]
        if len(raw) == 1 or raw_only:
            return raw[0] if len(raw) == 1 else None
        if len(found) > 1:
            names = ", ".join(file.name for file in found)
            raise FileError(f"{who} may be any of {names} in {folder}; keep one of them")
        return found[0] if found else None


def _by_stem(folder: Path) -> dict[str, list[Path]]:
    """The images of a folder by lower-case name without suffix; empty if the folder cannot be listed."""
    found: dict[str, list[Path]] = {}
    try:
        for file in folder.iterdir():
            if file.suffix.lower() in disk.PHOTO_SUFFIXES and file.is_file():
                found.setdefault(file.stem.lower(), []).append(file)
    except (OSError, ValueError):  # missing, or a name that is too long or has a null character
        return {}
    return found
