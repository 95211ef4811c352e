"""Which photos are meant by files, folders and frame patterns, and what their results are called."""

import glob
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from mpsnet_core.errors import InputError
from mpsnet_core.files import writable_path
from mpsnet_core.images import IMAGE_SUFFIXES, PHOTO_SUFFIXES, RAW_SUFFIXES, checked_bits

# What a photo's name is given to name its normals.
RESULT = "_normals"


def expand_images(inputs: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """The photos meant by `inputs`, in order: files as they are, a folder's or a pattern's images sorted by name.

    A run of # in a pattern stands for as many digits; * and ? as in a shell. Where a camera wrote a photo both as raw
    and as JPEG, folders and patterns mean the raw file.

    Raises InputError where something is missing or matches no image.
    """
    photos: list[Path] = []
    for given in inputs:
        path = Path(given)
        if path.is_dir():
            # A folder may hold the results of an earlier run beside the photos.
            found = _photos(file for file in path.iterdir() if not _is_result(file))
            if not found:
                kinds = ", ".join(IMAGE_SUFFIXES)
                raise InputError(f"folder {path} holds no images ({kinds}, or camera raw); choose another")
        elif path.is_file():
            found = [path]
        elif any(sign in path.name for sign in "#*?"):
            pattern = re.sub("#", "[0-9]", glob.escape(path.name).replace("[*]", "*").replace("[?]", "?"))
            found = _photos(path.parent.glob(pattern))
            if not found:
                raise InputError(f"no image matches {path}; check the pattern")
        else:
            raise InputError(f"image {path} does not exist; check the path")
        photos += found
    return photos


def output_files(photos: Sequence[Path], output: str | os.PathLike[str], suffix: str) -> list[Path]:
    """Where each photo's normals go: `output` itself for one photo, NAME_normals in the folder `output` for several.

    Raises InputError where two results would share a name, or a result would overwrite a photo.
    """
    target = Path(output)
    if len(photos) == 1 and not target.is_dir() and (target.suffix or target.is_file()):
        checked_bits(target)
        check_apart(photos, [target])
        return [writable_path(target)]
    if not target.is_dir():
        if target.is_file() or target.suffix.lower() in PHOTO_SUFFIXES:
            raise InputError(f"{target} is one file, but there are {len(photos)} photos; give a folder")
        if not target.parent.is_dir():
            raise InputError(f"cannot make folder {target}: {target.parent} does not exist; create it first")
    checked_bits(Path(f"normals{suffix}"))
    files = [target / f"{photo.stem}{RESULT}{suffix}" for photo in photos]
    if len(set(files)) < len(files):
        twice = next(file for file in files if files.count(file) > 1)
        raise InputError(f"two photos would both be written to {twice}; rename one or estimate them apart")
    check_apart(photos, files)
    return files


def check_apart(taken: Iterable[str | os.PathLike[str]], outputs: Iterable[str | os.PathLike[str]]) -> None:
    """Raises InputError where one of `outputs` is among the files that are `taken` already, as input or output."""
    files = {Path(file).resolve() for file in taken}
    for output in outputs:
        if Path(output).resolve() in files:
            raise InputError(f"the result would overwrite {output}, a file that it needs; choose another output")


def _is_result(file: Path) -> bool:
    return file.stem.endswith(RESULT)


def _photos(files: Iterable[Path]) -> list[Path]:
    found = sorted(file for file in files if _is_image(file))
    raw = {file.with_suffix("") for file in found if file.suffix.lower() in RAW_SUFFIXES}
    return [file for file in found if file.suffix.lower() not in (".jpg", ".jpeg") or file.with_suffix("") not in raw]


def _is_image(file: Path) -> bool:
    return file.suffix.lower() in PHOTO_SUFFIXES and not file.name.startswith(".") and file.is_file()
