"""What a mesh file says of its polygons, before it is checked."""

import logging
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.polygon_triangulation import strip_triangles
from mpsnet_core.arrays.types import F64, I64
from mpsnet_core.errors import FormatError, GeometryError


@dataclass(frozen=True, eq=False)
class Polygons:
    """Polygons of any number of corners, and what the file says of these."""

    vertices: F64
    """(V, 3) float64. Positions."""
    corners: I64
    """(C,) int64. Vertex index of each corner, polygon after polygon."""
    sizes: I64
    """(F,) int64. Number of corners of each polygon."""
    uvs: F64 | None = None
    """(C, 2) float64. UV coordinates with v up, NaN where the file gives none; None if it gives none at all."""
    normals: F64 | None = None
    """(C, 3) float64. Normals of any length, NaN or zero where the file gives none; None if it gives none at all."""
    tangents: F64 | None = None
    """(C, 4) float64. Unit tangent and the sign of the bitangent, NaN where the file gives none; None if it gives none
    at all."""
    smoothing: I64 | None = None
    """(F,) int64. For corners without a normal: polygons of the same number share one at each common vertex. A polygon
    of number 0 is flat. None: all are flat."""
    materials: Sequence[tuple[str, int]] | None = None
    """Names of materials, each with the number of polygons that it applies to, in order."""
    objects: Sequence[tuple[str, int]] | None = None
    """Names of objects, each with the number of polygons that it applies to, in order."""


def checked_indices(numbers: NDArray[Any], count: int) -> I64:
    """Vertex indices as integers. Raises GeometryError if one is not below `count`, the number of vertices."""
    if numbers.size and not 0 <= numbers.min() <= numbers.max() < count:
        raise GeometryError("the mesh's triangles name vertices that it does not have; export it again")
    return numbers.astype(np.int64)


# ----------------------------------------------------------------------------------------------------------------------
# Wavefront OBJ files.
#
# trimesh ignores smoothing groups, splits vertices at seams, and loses the UVs of files with quads or many materials.


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
    known: dict[str, tuple[int, ...]] = {}
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
                        f"line {number}: a face of {len(words)} corners, above {MAX_CORNERS}; triangulate it"
                    )
                counts = [*map(len, values.values())]
                face = [known[word] if word in known else _corner(word, counts, known) for word in words]
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
    uvs = None if (vt < 0).all() else _of_corners(values["vt"], vt)
    normals = _of_corners(values["vn"], vn) if values["vn"] else None
    smoothing = _smoothing(of_faces["s"], of_faces["o"], bool(values["vn"]))
    labels = (of_faces[what] if named[what] else None for what in ("usemtl", "o"))
    return Polygons(np.array(values["v"]), v, np.array(sizes), uvs, normals, None, smoothing, *labels)


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


def _corner(word: str, counts: list[int], known: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Zero-based indices of vertex, UV and normal in "5/7/2", -1 if not given. Negative ones count from the end.

    known: remembers words that always mean the same; faces share most of their corners.
    """
    given = [int(part) if part else 0 for part in word.split("/")]
    if len(given) > 3 or not given[0] or any(abs(number) > count for number, count in zip(given, counts, strict=False)):
        raise ValueError
    numbers = [number + (count if number < 0 else -1) for number, count in zip(given, counts, strict=False)]
    corner = (*numbers, *[-1] * (3 - len(numbers)))
    if min(given) >= 0:
        known[word] = corner
    return corner


# ----------------------------------------------------------------------------------------------------------------------
# PLY files.
#
# trimesh cannot read binary files with faces of different sizes, and knows neither texture pages nor triangle strips.


# By the type names of both versions of the format.
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
MAX_HEAD = 1 << 20
BROKEN = "it cannot be read as PLY ({}); export it again"


# A name, a type, and the type of a list's length, "" for scalars.
_Column = tuple[str, str, str]


@dataclass
class _Element:
    """An element of a file, such as "vertex"."""

    count: int
    """How many of it the file holds."""
    columns: list[_Column] = field(default_factory=list)
    """Its properties, in the order of the file."""


@dataclass(frozen=True)
class Values:
    """The values of an element."""

    numbers: dict[str, F64]
    """(N,) float64 by property name. The values; those of a list property are concatenated."""
    lengths: dict[str, I64]
    """(N,) int64 by the name of a list property. The length of each list."""

    def columns(self, names: Sequence[str]) -> F64 | None:
        """(N, K) the properties of these names as columns, None if one is missing."""
        if any(name not in self.numbers or name in self.lengths for name in names):
            return None
        return np.stack([self.numbers[name] for name in names], axis=-1)

    def list(self, names: Sequence[str]) -> tuple[F64, I64]:
        """The values of the first list that exists of these names, concatenated, and (N,) their lengths, else none."""
        name = next((name for name in names if name in self.lengths), "")
        return self.numbers.get(name, np.empty(0)), self.lengths.get(name, NO_LENGTHS)


NOTHING = Values({}, {})
NO_LENGTHS = np.empty(0, np.int64)
# The names of vertices' UVs by MeshLab, others and Blender. The last pair that exists applies.
UVS = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"))
# Elements that are read, or of which nothing is missed.
KNOWN = {"vertex", "face", "tristrips", "edge", "camera", "range_grid", "material"}
_INDICES, _FACE_UVS = ("vertex_indices", "vertex_index"), ("texcoord", "texcoords", "texture_uvs")
# Numbers of the texture images of faces (MeshLab's, and others').
_PAGES = ("texnumber", "texture_index", "material_index")


def read_ply(path: Path) -> Polygons:
    """The polygons of a file, with a material for each texture page.

    Without normals they are flat, as Blender imports PLY. Elements that are not known are logged.

    Raises FormatError, without the file's name, if it is damaged.
    """
    elements, textures = _values_of(path)
    vertex, face = (elements.get(name, NOTHING) for name in ("vertex", "face"))
    vertices = vertex.columns("xyz")
    if vertices is None:
        raise FormatError("it has no vertices with x, y and z; export it again")
    if unknown := sorted(elements.keys() - KNOWN):
        log.warning(
            "mesh file %s: its elements %s are not read; export UVs and texture numbers with its faces",
            path,
            ", ".join(unknown)[:99],
        )
    lists, sizes = face.list(_INDICES)
    corners = checked_indices(lists, len(vertices))
    strips = _strips(elements.get("tristrips", NOTHING), len(vertices))
    corners, sizes = np.concatenate([corners, strips.ravel()]), np.concatenate([sizes, np.full(len(strips), 3)])
    found, uvs = vertex.columns(("nx", "ny", "nz")), _uvs(vertex, face, corners, sizes, len(strips))
    normals, smooth = (None, None) if found is None else (found[corners], np.ones(len(sizes), np.int64))
    return Polygons(vertices, corners, sizes, uvs, normals, None, smooth, _pages(face, textures, len(sizes)))


def _uvs(vertex: Values, face: Values, corners: I64, sizes: I64, strips: int) -> F64 | None:
    """(C, 2) UVs of the corners: those of the faces, else of the vertices, else none."""
    values, lengths = face.list(_FACE_UVS)
    if lengths.any() and len(lengths) + strips == len(sizes):
        lengths = np.concatenate([lengths, np.zeros(strips, np.int64)])
        has_them = lengths == 2 * sizes
        uvs = np.full((len(corners), 2), np.nan)
        uvs[np.repeat(has_them, sizes)] = values[np.repeat(has_them, lengths)].reshape(-1, 2)
        return uvs
    pairs = [pair for names in UVS if (pair := vertex.columns(names)) is not None]
    return pairs[-1][corners] if pairs else None


def _pages(face: Values, textures: Sequence[str], count: int) -> list[tuple[str, int]] | None:
    """Runs of faces with a texture page, named like its file; None if all have the same."""
    numbers = next((face.numbers[name] for name in _PAGES if name in face.numbers and name not in face.lengths), None)
    if numbers is None or (numbers == numbers[:1]).all():
        return None
    names = {number: Path(name.replace("\\", "/")).stem for number, name in enumerate(textures)}
    runs = [(names.get(page, f"page_{page:g}"), len(list(same))) for page, same in groupby(numbers.tolist())]
    return [*runs, ("", count - len(numbers))]


def _strips(element: Values, count: int) -> I64:
    """(T, 3) the triangles of triangle strips."""
    numbers, lengths = element.list(_INDICES)
    checked_indices(numbers[numbers != -1], count)
    return strip_triangles(np.insert(numbers, np.cumsum(lengths), -1).astype(np.int64))


def _values_of(path: Path) -> tuple[dict[str, Values], list[str]]:
    """The values of a file's elements, such as "vertex" and "face", and the names of its texture files."""
    data = path.read_bytes()
    head, end, _ = data[:MAX_HEAD].partition(b"end_header")
    line_end = data.find(b"\n", len(head))
    if not (data.startswith(b"ply") and end and line_end >= 0):
        raise FormatError(BROKEN.format("it has no header"))
    try:
        order, elements, textures = _header(head.decode("latin-1"))
        at = line_end + 1
        if not order:
            data, at, order = np.array([float(word) for word in data[at:].split()]).tobytes(), 0, "="
            elements = {name: _of_text(element) for name, element in elements.items()}
        found = {}
        for name, element in elements.items():
            parts = list(_parts(data, at, element, order))
            at += sum(part.nbytes for part in parts)
            found[name] = _values(parts, element)
    except (ValueError, OverflowError, KeyError, IndexError) as error:
        raise FormatError(BROKEN.format(str(error)[:99])) from None
    return found, textures


def _header(text: str) -> tuple[str, dict[str, _Element], list[str]]:
    """The byte order, "" for text, the elements by name, and the names of texture files."""
    order, elements, last, textures = None, dict[str, _Element](), _Element(0), list[str]()
    for line in text.splitlines()[1:]:
        match line.split():
            case ["format", kind, _]:
                order = _ORDERS[kind]
            case ["element", name, count]:
                elements[name] = last = _Element(int(count))
            case ["property", "list", length, kind, name]:
                last.columns.append((name, _TYPES[kind], _TYPES[length]))
            case ["property", kind, name]:
                last.columns.append((name, _TYPES[kind], ""))
            case ["comment", "TextureFile", *_]:
                textures.append(line.split(maxsplit=2)[-1])
            case [] | ["comment" | "obj_info", *_]:
                pass
            case _:
                raise ValueError(f"the line {line[:50]!r}")
    if order is None:
        raise ValueError("no format")
    return order, elements, textures


def _of_text(element: _Element) -> _Element:
    """The element of a text file, in which every value is a word."""
    return _Element(element.count, [(name, "f8", length and "f8") for name, _, length in element.columns])


def _parts(data: bytes, at: int, element: _Element, order: str) -> Iterator[NDArray[np.void]]:
    """Yield rows of an element, in runs with lists of equal length. Raises ValueError if the file is truncated."""
    columns = tuple(element.columns)
    left, ahead = element.count if columns else 0, 1
    while left > 0:
        kind = _layout(columns, order, _lengths(data, at, columns, order))
        rows = np.frombuffer(data, kind, min(left, ahead, max((len(data) - at) // kind.itemsize, 1)), at)
        count = len(rows)
        for name in kind.names or () if count > 1 else ():
            if name.startswith("length"):
                unlike = rows[name][:, 0] != rows[name][0, 0]
                count = min(count, int(unlike.argmax())) if unlike.any() else count
        ahead = 2 * count
        yield rows[:count]
        at, left = at + count * kind.itemsize, left - count


def _lengths(data: bytes, at: int, columns: tuple[_Column, ...], order: str) -> tuple[int, ...]:
    """Lengths of the lists in the row that starts at `at`; 1 for scalars."""
    lengths = []
    for _, kind, length in columns:
        count = 1
        if length:
            count = int(np.frombuffer(data, order + length, 1, at)[0])
            if not 0 <= count <= len(data):
                raise ValueError(f"a list of {count}")
            at += int(length[1])
        at += count * int(kind[1])
        lengths.append(count)
    return tuple(lengths)


@lru_cache(1024)
def _layout(columns: tuple[_Column, ...], order: str, lengths: tuple[int, ...]) -> np.dtype[np.void]:
    """The dtype of rows with lists of these lengths."""
    fields: list[tuple[str, str, tuple[int]]] = []
    for number, ((_, kind, length), count) in enumerate(zip(columns, lengths, strict=True)):
        fields += [(f"length{number}", order + length, (1,))] if length else []
        fields.append((f"value{number}", order + kind, (count,)))
    return np.dtype(fields)


def _values(parts: list[NDArray[np.void]], element: _Element) -> Values:
    numbers, lengths = {}, {}
    for number, (name, _, length) in enumerate(element.columns if parts else ()):
        numbers[name] = np.concatenate([part[f"value{number}"].reshape(-1) for part in parts]).astype(np.float64)
        if length:
            counts = [part[f"length{number}"].reshape(-1) for part in parts]
            lengths[name] = np.concatenate(counts).astype(np.int64)
    return Values(numbers, lengths)


# ----------------------------------------------------------------------------------------------------------------------
# Mesh files that trimesh reads rightly: STL and OFF, which hold shapes alone.


SUFFIXES = (".stl", ".off")


def read_shape(path: Path) -> Polygons:
    """The triangles of a file, all flat. Raises FormatError, without the file's name, if it cannot be read."""
    import trimesh  # slow to import

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # keep its log messages off stderr
    try:
        with path.open("rb") as file:
            mesh = trimesh.load_mesh(file, file_type=path.suffix.lower().lstrip("."), process=False)
        vertices, triangles = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces)
    except Exception as error:  # noqa: BLE001  # trimesh raises anything for damaged files
        raise FormatError(f"it cannot be read ({type(error).__name__}: {error}); export it again") from None
    return Polygons(vertices, checked_indices(triangles, len(vertices)).ravel(), np.full(len(triangles), 3))
