"""Wavefront OBJ files.

trimesh ignores smoothing groups, splits vertices at seams, and loses the UVs of files with quads or many materials.
"""

import logging
import re
from itertools import pairwise
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.types import F64, I64
from mpsnet_core.errors import FormatError, GeometryError
from mpsnet_core.io.polygons import Polygons

log = logging.getLogger(__name__)

# Faces made by people have fewer corners; ear clipping takes quadratic time.
MAX_CORNERS = 4096
# The least numbers that a line of each kind needs, and those that are read.
_NUMBERS = {"v": (3, 3), "vt": (1, 2), "vn": (3, 3)}
# Statements that add surfaces, here or from other files.
_SURFACES = {"surf", "curv", "curv2", "call", "csh"}


def read_obj(path: Path) -> Polygons:
    """The polygons of a file.

    Faces are flat unless a smoothing group (s) is on; a new object (o) ends it. Corners without a normal in a file that
    has normals are smooth whatever the groups say. This is how Blender imports OBJ, except that it smooths across
    groups of different numbers.

    Raises FormatError, without the file's name, if a line cannot be read.
    """
    values: dict[str, list[list[float]]] = {"v": [], "vt": [], "vn": []}
    corners: list[tuple[int, ...]] = []
    sizes: list[int] = []
    # By OBJ keyword, the names with the first face that each applies to.
    named: dict[str, list[tuple[int, str]]] = {"usemtl": [], "o": [], "s": []}
    left_out = set[str]()
    # A backslash continues a line, except a comment, which may end with a Windows path.
    joined = re.sub(r"^([^#\n]*)\\\n", r"\1 ", _text_of(path), flags=re.MULTILINE)
    for number, line in enumerate(joined.split("\n"), 1):
        key, *words = line.partition("#")[0].split() or [""]
        try:
            if key in values:
                least, most = _NUMBERS[key]
                row = [float(word) for word in words[:most]]
                if len(row) < least:
                    raise ValueError
                values[key].append(row + [0.0] * (most - len(row)))
            elif key == "f":
                if len(words) > MAX_CORNERS:
                    raise FormatError(
                        f"line {number} is a face of {len(words)} corners, more than {MAX_CORNERS}; triangulate it"
                    )
                counts = [len(values[kind]) for kind in ("v", "vt", "vn")]
                face = [_corner(word, counts) for word in words]
                if len(face) > 2:
                    corners += face
                    sizes.append(len(face))
            elif key in named:  # names may contain a #, as those of 3ds Max do
                named[key].append((len(sizes), line.strip().removeprefix(key).strip()))
                if key == "o":
                    named["s"].append((len(sizes), ""))
            elif key in _SURFACES:
                left_out.add(key)
        except FormatError:
            raise
        except ValueError:
            raise FormatError(f"line {number} cannot be read ({line.strip()[:60]!r}); export it again") from None
    if left_out:
        log.warning(
            "mesh file %s: its statements %s are not read; convert its surfaces to polygons in this file",
            path,
            ", ".join(sorted(left_out)),
        )
    if not corners:
        raise GeometryError("it has no faces; choose a mesh with a surface")
    v, vt, vn = np.array(corners).T
    of_faces = {key: _runs(starts, len(sizes)) for key, starts in named.items()}
    return Polygons(
        np.array(values["v"]),
        v,
        np.array(sizes),
        None if (vt < 0).all() else _of_corners(values["vt"], vt),
        _of_corners(values["vn"], vn) if values["vn"] else None,
        smoothing=_smoothing(of_faces["s"], of_faces["o"], bool(values["vn"])),
        materials=of_faces["usemtl"] if named["usemtl"] else None,
        objects=of_faces["o"] if named["o"] else None,
    )


def _text_of(path: Path) -> str:
    """The text of an OBJ file: UTF-8, with or without a byte order mark, or the encoding of older programs."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        return path.read_text(encoding="latin-1")


def _runs(starts: list[tuple[int, str]], count: int) -> list[tuple[str, int]]:
    """Names with the number of faces of each, from the first face of each name."""
    return [(name, stop - start) for (start, name), (stop, _) in pairwise([(0, ""), *starts, (count, "")])]


def _of_corners(values: list[list[float]], numbers: I64) -> F64:
    """The values of these numbers, NaN for negative ones."""
    found: F64 = np.array(values)[np.maximum(numbers, 0)]
    found[numbers < 0] = np.nan
    return found


def _smoothing(groups: list[tuple[str, int]], objects: list[tuple[str, int]], everywhere: bool) -> I64:
    """(F,) as in :class:`Polygons`. everywhere: whether all faces are smooth, within their objects."""
    words = [word.split()[:1] for word, _ in groups]
    numbers = [int(word[0]) if word and re.fullmatch(r"[+-]?\d{1,9}", word[0]) else 0 for word in words]
    group = np.repeat(numbers, [count for _, count in groups])
    of_object = np.repeat(np.arange(len(objects)), [count for _, count in objects])
    if everywhere:
        return of_object + 1
    _, together = np.unique(np.stack([of_object, group], axis=1), axis=0, return_inverse=True)
    return np.where(group != 0, together.reshape(-1) + 1, 0)


def _corner(word: str, counts: list[int]) -> tuple[int, ...]:
    """Zero-based indices of vertex, UV and normal in "5/7/2", -1 if not given. Negative ones count from the end."""
    given = [int(part) if part else 0 for part in word.split("/")]
    numbers = [-1, -1, -1]
    for place, (number, count) in enumerate(zip(given, counts, strict=False)):
        if not -count <= number <= count:
            raise ValueError
        if number:
            numbers[place] = number - 1 if number > 0 else count + number
    if len(given) > 3 or numbers[0] < 0:
        raise ValueError
    return tuple(numbers)
