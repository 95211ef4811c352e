"""Files and folders of results."""

import re
import sys
from collections.abc import Sequence
from pathlib import Path

import bpy

from mpsnet_core.errors import FileError, Note, SettingsError
from mpsnet_core.io.files import PHOTO_SUFFIXES, ensure_folder, writable_path

from .image_records import images_of, is_own
from .preferences import output_folder

_NOT_IN_NAMES = re.compile(r"[^\w-]")
FORMATS = {"PNG": "png", "TIFF": "tif", "EXR": "exr"}
FORMAT_OF = {".png": "PNG", ".tif": "TIFF", ".tiff": "TIFF", ".exr": "EXR"}


def output_path(given: str, name: str, file_format: str) -> Path:
    """The file to write: `given`, or `name` in the output folder, with the format's suffix unless it has one.

    given: a file, or a folder for `name`: an existing one, or a path that ends in a slash, which is created.

    Raises InputError if no file can be written there, the suffix is of no writable format, or a default name is that of
    one of the user's own images.
    """
    folder = requested_folder(given)
    path = requested_path(given) if folder is None else folder / file_name(name)
    if not path.suffix:
        path = path.with_name(f"{path.name}.{FORMATS[file_format]}")
    if folder is not None:
        for image in images_of([path]):
            if not is_own(image):  # but the user's
                raise FileError(f'the result would overwrite {path}, the image "{image.name}"; choose another output')
    if path.suffix.lower() not in FORMAT_OF:
        raise SettingsError(f"cannot write {path}: the ending {path.suffix} is not known; use .png, .tif or .exr")
    return writable_path(path)


def requested_path(given: str) -> Path:
    """The requested file or folder, with what its tokens stand for: <SHOT>, <VERSION> and <FRAME>.

    Raises FileError if it is relative to a .blend file that was never saved, or that file's name lacks what a token
    stands for. In a file that was never saved, Blender resolves "//" to the folder that it was started in.
    """
    given = _without_tokens(given)
    if given.startswith("//") and not bpy.data.filepath:
        raise FileError(f"{given} is beside this file, which was never saved; save it, or give a path in full")
    return Path(bpy.path.abspath(given))


def _without_tokens(given: str) -> str:
    """A path with the names of this file and the number of its frame for its tokens: "statue" and "v003" are those of
    statue_v003.blend."""
    stem = Path(bpy.data.filepath).stem
    shot, version = re.fullmatch(r"(.*?)(?:[._-]?(v\d+))?", stem).groups()  # type: ignore[union-attr]
    frame = f"{bpy.context.scene.frame_current:04}"
    for token, value in (("<SHOT>", shot), ("<VERSION>", version), ("<FRAME>", frame)):
        if token in given and not value:
            raise FileError(
                f"{given}: nothing stands for {token}; save this file under a name such as statue_v003.blend"
            )
        given = given.replace(token, value or "")
    return given


def file_name(name: str) -> str:
    """`name` as a valid file name. Letters are kept (`bpy.path.clean_name` turns "ä" and "ö" into the same character).

    Dots are replaced: what follows one would be the suffix.
    """
    return _NOT_IN_NAMES.sub("_", name)


def unique_name(names: Sequence[str], number: int) -> str:
    """One of several names, with its number if, as a file name, it equals another one on some system."""
    in_files = [file_name(name).casefold() for name in names]
    if in_files.count(in_files[number]) == 1:
        return names[number]
    numbered = f"{names[number]}_{number + 1}"
    while file_name(numbered).casefold() in in_files:  # a third name may be the same
        numbered += "_"
    return numbered


def requested_folder(given: str) -> Path | None:
    """The folder for results that `given` names; None if it names a file.

    An existing folder, or a path that ends in a slash, which is created, is a folder; "" is the output folder.

    Raises InputError if the folder cannot be created, or as :func:`requested_path` does.
    """
    if not given:
        return output_folder()
    path = requested_path(given)
    if given.endswith(("/", "\\")):
        return ensure_folder(path, "files")
    return path if path.is_dir() else None


def overruled_format(path: Path, settings: bpy.types.PropertyGroup) -> list[Note]:
    """A sentence if the file's suffix overrules the format in a step's settings; otherwise nothing."""
    written = FORMAT_OF[path.suffix.lower()]
    if written == settings.file_format or not settings.is_property_set("file_format"):
        return []
    chosen = settings.bl_rna.properties["file_format"].enum_items[settings.file_format].name
    return [Note("%s is written as its ending says, not as %s", path.name, chosen, level="look")]


def output_frames(given: str, name: str) -> Path:
    """The folder for a sequence's frames: `given`, or `name` in the output folder.

    Raises InputError if `given` is the name of an image, or the folder is a temporary one of Blender: frames of a
    sequence cannot be packed into the .blend file.
    """
    folder = requested_path(given) if given else output_folder() / file_name(name)
    if folder.suffix.lower() in PHOTO_SUFFIXES and not folder.is_dir():
        raise SettingsError(
            f"{folder.name} is a picture's name, and frames go into a folder; name one, or ask for one frame"
        )
    if not is_permanent(folder):
        raise FileError("no folder is named for the frames; name one, or save this file and they go beside it")
    return ensure_folder(folder, "frames")


def is_safe_to_open(given: str | Path) -> bool:
    """Whether a path is a folder or a page. The system may execute other files, and the path may come from a file."""
    path = Path(bpy.path.abspath(str(given)))
    try:
        if path.is_dir():
            return sys.platform != "darwin" or not path.suffix  # macOS runs folders with a suffix
        return path.suffix.lower() == ".html" and path.is_file()
    except OSError:  # a name may be too long
        return False


def is_permanent(path: Path) -> bool:
    """Whether a file or a folder outlives this run of Blender."""
    return Path(bpy.app.tempdir) not in path.parents


def render_path(path: Path) -> Path:
    """`path`, checked before a render. Raises InputError if Blender cannot render to it."""
    if path.suffix.lower() != ".exr":
        raise SettingsError(f"cannot write {path}: renders are written as OpenEXR; give a name that ends in .exr")
    return writable_path(path)


def with_escaped_braces(path: Path) -> str:
    """A path for Blender's render settings, which expand expressions in single braces."""
    return str(path).replace("{", "{{").replace("}", "}}")
