"""Which photos are meant by files, folders and frame patterns, and what their results are called."""

import glob
import os
import re
from collections.abc import Sequence
from pathlib import Path

from mpsnet_core.errors import InputError
from mpsnet_core.images import IMAGE_SUFFIXES, checked_bits


def expand_images(inputs: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """The photos meant by `inputs`, in order: files as they are, a folder's or a pattern's images sorted by name.

    A run of # in a pattern stands for as many digits; * and ? as in a shell.

    Raises InputError where something is missing or matches no image.
    """
    photos: list[Path] = []
    for given in inputs:
        path = Path(given)
        if path.is_dir():
            found = [file for file in sorted(path.iterdir()) if _is_image(file)]
            if not found:
                raise InputError(f"folder {path} holds no images ({', '.join(IMAGE_SUFFIXES)}); choose another")
        elif path.is_file():
            found = [path]
        elif any(sign in path.name for sign in "#*?"):
            pattern = re.sub("#", "[0-9]", glob.escape(path.name).replace("[*]", "*").replace("[?]", "?"))
            found = [file for file in sorted(path.parent.glob(pattern)) if _is_image(file)]
            if not found:
                raise InputError(f"no image matches {path}; check the pattern")
        else:
            raise InputError(f"image {path} does not exist; check the path")
        photos += found
    return photos


def output_files(photos: Sequence[Path], output: str | os.PathLike[str], suffix: str) -> list[Path]:
    """Where each photo's normals go: `output` itself for one photo, NAME_normals in the folder `output` for several.

    The folder is made where it is missing.

    Raises InputError where two results would share a name, or a result would overwrite a photo.
    """
    target = Path(output)
    if len(photos) == 1 and target.suffix and not target.is_dir():
        checked_bits(target)
        files = [target]
    else:
        if target.is_file() or target.suffix.lower() in IMAGE_SUFFIXES:
            raise InputError(f"{target} is one file, but there are {len(photos)} photos; give a folder")
        checked_bits(Path(f"normals{suffix}"))
        files = [target / f"{photo.stem}_normals{suffix}" for photo in photos]
        if len(set(files)) < len(files):
            twice = next(file for file in files if files.count(file) > 1)
            raise InputError(f"two photos would both be written to {twice}; rename one or estimate them apart")
        if not target.parent.is_dir():
            raise InputError(f"cannot make folder {target}: {target.parent} does not exist; create it first")
        target.mkdir(exist_ok=True)
    for photo in photos:
        if photo.resolve() in [file.resolve() for file in files]:
            raise InputError(f"the result would overwrite the photo {photo}; choose another output")
    return files


def _is_image(file: Path) -> bool:
    return file.suffix.lower() in IMAGE_SUFFIXES and not file.name.startswith(".")
