"""glTF 2.0 files in one piece (.glb, or .gltf with embedded data): their triangles, placed and shaded as stored.

trimesh is no help here: it drops tangents, morph targets, instances, skins, and the UVs of parts without material.
"""

import base64
import json
import logging
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.polygon_triangulation import strip_triangles
from mpsnet_core.arrays.types import F64, I64
from mpsnet_core.arrays.unit_vectors import quaternion_matrix
from mpsnet_core.errors import FormatError, InputError, Note
from mpsnet_core.io.npz import unpacked_limit
from mpsnet_core.io.opening import DAMAGED

log = logging.getLogger(__name__)

# Components per element, and NumPy's types.
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
# Components of attributes of vertices, and of instances.
_WIDTHS = {"POSITION": 3, "NORMAL": 3, "TANGENT": 4, "TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}
# Modes of a primitive; lower ones are points and lines.
TRIANGLES, STRIP, FAN = 4, 5, 6
INSTANCES = "EXT_mesh_gpu_instancing"
TEXTURE_TRANSFORM = "KHR_texture_transform"
_UNMOVED = {"offset": [0, 0], "rotation": 0, "scale": [1, 1]}
VISIBILITY = "KHR_node_visibility"
COMPRESSED = {"EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_draco_mesh_compression"}
# Extensions that change no vertex, normal or UV, or that are read here.
_TEXTURES = ("KHR_texture_", "EXT_texture_", "MSFT_texture_")
HARMLESS = (*_TEXTURES, "KHR_materials_", "KHR_lights_", "KHR_mesh_quantization", VISIBILITY)
MAX_BYTES = 4 << 30
# Limit of vertices over all instances of all meshes, and of these instances.
MAX_VERTICES = 1 << 26
MAX_PARTS = 1 << 16
# Joints whose transforms differ by less, relative to the largest entry, move the mesh as one: files hold float32.
SAME_PLACE = 1e-4
# Tangents whose lengths differ from 1 by more are wrong. Quantised ones differ by less.
NEARLY_UNIT = 0.02


@dataclass(frozen=True, eq=False)
class Part:
    """The triangles of one material in one instance of a mesh."""

    name: str
    """Name of its object, "" if it has none. Objects with the same name are numbered as Blender does."""
    material: str
    """Name of its material, "" if it has none."""
    pose: F64
    """(4, 4) float64. Transform to world space."""
    triangles: I64
    """(T, 3) int64. Vertex indices."""
    vertices: F64
    """(V, 3) float64. Positions before `pose`, with the morph targets' default weights applied, as are the normals and
    tangents."""
    normals: F64 | None
    """(V, 3) float64. Normals before `pose`; None if the file gives none."""
    tangents: F64 | None
    """(V, 4) float64. Unit tangents and the sign of the bitangent, NaN where the file's are no unit vectors with a
    sign; None if the file gives none or the part has no normals."""
    uvs: F64 | None
    """(V, 2) float64. UV coordinates with v up; None if the file gives none."""


def read_gltf(path: Path) -> list[Part]:
    """The parts of a file's default scene.

    What the file says and is not applied is logged: a posed skeleton, animations, other UVs of the normal map.

    Raises FormatError, without the file's name, if it is damaged, compressed or too large, or refers to other files.
    """
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are refused by their readers
            return _Document(path).parts()
    except InputError:
        raise
    except DAMAGED as error:
        raise FormatError(f"it cannot be read ({type(error).__name__}: {error}); export it again") from None


class _Document:
    def __init__(self, path: Path) -> None:
        self.path, self.limit, self.unpacked = path, unpacked_limit(path, MAX_BYTES), 0
        data = path.read_bytes()
        self.binary, self.embedded, self.hidden = b"", dict[int, bytes](), set[int]()
        if data[:4] == b"glTF":
            version, _, length = struct.unpack_from("<III", data, 4)
            if version != 2:
                raise FormatError(f"it is glTF of version {version}, not 2; export it again")
            self.binary = data[28 + length :]
            data = data[20 : 20 + length]
        self.json: dict[str, Any] = json.loads(data, parse_constant=_no_number)
        self.materials: list[dict[str, Any]] = self.json.get("materials", [])
        self.nodes: list[dict[str, Any]] = self.json.get("nodes", [])
        required = set(self.json.get("extensionsRequired", ()))
        if packed := required & COMPRESSED:
            raise FormatError(f"it is compressed ({', '.join(sorted(packed))}); export it without compression")
        for name in sorted(map(str, required - {INSTANCES})):
            if not name.startswith(HARMLESS):
                self.warn("it says that %s is needed to read it, which is not known; the mesh may differ", name[:99])

    def warn(self, sentence: str, *words: object) -> None:
        log.warning("mesh file %s: %s", self.path, Note(sentence, *words))

    def parts(self) -> list[Part]:
        places = self.places()
        found, vertices = list[Part](), 0
        # Each mesh with its weights is read once, however often it is placed.
        known: dict[tuple[int, tuple[float, ...]], list[Part]] = {}
        skins: dict[int, F64] = {}
        names = set[str]()
        shown = [number for number in places if "mesh" in self.nodes[number] and number not in self.hidden]
        for number, node in ((number, self.nodes[number]) for number in shown):
            mesh = self.json["meshes"][node["mesh"]]
            weights = tuple(float(one) for one in node.get("weights", mesh.get("weights", ())))
            key = node["mesh"], weights
            if key not in known:
                known[key] = list(self.primitives(mesh, weights))
            name = _distinct(str(node.get("name") or mesh.get("name") or ""), names)
            if "skin" in node:
                skin = node["skin"]
                if skin not in skins:
                    skins[skin] = self.common_transform(self.json["skins"][skin], places, name or str(number))
                poses = [skins[skin]]
            else:
                poses = [places[number] @ one for one in self.instances(node)]
            found += [replace(part, name=name, pose=pose) for pose in poses for part in known[key]]
            vertices += len(poses) * sum(len(part.vertices) for part in known[key])
            if vertices > MAX_VERTICES or len(found) > MAX_PARTS:
                raise FormatError(f"it has more than {MAX_VERTICES} vertices or {MAX_PARTS} parts; reduce it first")
        if not all(np.isfinite(part.pose).all() for part in found):
            raise FormatError("a transform of it is not finite; export it again")
        self._say_what_is_left_out()
        return found

    def places(self) -> dict[int, F64]:
        """(4, 4) transform to world space of each node of the default scene; fills `hidden`."""
        scenes = self.json.get("scenes")
        if scenes:
            roots = scenes[self.json.get("scene", 0)].get("nodes", [])
        else:
            inner = {child for node in self.nodes for child in node.get("children", ())}
            roots = [number for number in range(len(self.nodes)) if number not in inner]
        places = dict[int, F64]()
        todo = [(root, np.eye(4), False) for root in reversed(roots)]
        while todo:
            number, parent, hidden = todo.pop()
            if number in places:  # a damaged file may name a node any number of times
                continue
            node = self.nodes[number]
            if hidden or node.get("extensions", {}).get(VISIBILITY, {}).get("visible") is False:
                hidden = True
                self.hidden.add(number)
            places[number] = parent @ _own_transform(node)
            todo += [(child, places[number], hidden) for child in reversed(node.get("children", ()))]
        return places

    def instances(self, node: dict[str, Any]) -> Sequence[F64]:
        """(4, 4) transforms of a node's instances relative to it."""
        attributes = node.get("extensions", {}).get(INSTANCES, {}).get("attributes")
        if not attributes:
            return [np.eye(4)]
        given = {name.lower(): self.values(attributes[name], _WIDTHS[name]) for name in attributes if name in _WIDTHS}
        (count,) = {len(values) for values in given.values()}
        if count > MAX_PARTS:
            raise FormatError(f"it has {count} instances of a mesh, more than {MAX_PARTS}; reduce it first")
        return [_own_transform(dict(zip(given, rows, strict=True))) for rows in zip(*given.values(), strict=True)]

    def primitives(self, mesh: dict[str, Any], weights: Sequence[float]) -> Iterator[Part]:
        """A mesh's parts that are of triangles, at the origin."""
        for one in mesh["primitives"]:
            mode, attributes = one.get("mode", TRIANGLES), one["attributes"]
            if mode < TRIANGLES or "POSITION" not in attributes:
                continue
            names = "POSITION", "NORMAL", "TANGENT"
            vertices, normals, tangents = (self.morphed(one, name, weights) for name in names)
            assert vertices is not None
            uvs = self.values(attributes["TEXCOORD_0"], 2) if "TEXCOORD_0" in attributes else None
            indices = one.get("indices")
            order = np.arange(len(vertices)) if indices is None else self.values(indices, 1).astype(np.int64).ravel()
            for what in (normals, tangents, uvs):
                if what is not None and len(what) != len(vertices):
                    raise ValueError("attributes of different counts")
            if tangents is not None:
                tangents = None if normals is None else self.checked(tangents)
            number = one.get("material")
            material = "" if number is None else str(self.materials[number].get("name", ""))
            uvs = None if uvs is None else uvs * (1, -1) + (0, 1)
            yield Part("", material, np.eye(4), _triangles(order, mode), vertices, normals, tangents, uvs)

    def morphed(self, primitive: dict[str, Any], name: str, weights: Sequence[float]) -> F64 | None:
        """An attribute plus the weighted offsets of its morph targets, None if there is no such attribute."""
        if name not in primitive["attributes"]:
            return None
        values = self.values(primitive["attributes"][name], _WIDTHS[name])
        for weight, target in zip(weights, primitive.get("targets", ()), strict=False):
            if weight and name in target:
                values[:, :3] += weight * self.values(target[name], 3)
        return values

    def checked(self, tangents: F64) -> F64:
        """Tangents, NaN where they are wrong."""
        length, sign = np.linalg.norm(tangents[:, :3], axis=1), tangents[:, 3]
        right = (np.abs(length - 1) < NEARLY_UNIT) & (np.abs(np.abs(sign) - 1) < NEARLY_UNIT)
        if not right.all():
            self.warn(
                "%d of its %d tangents are not of length 1 with a handedness of 1 or -1; those of MikkTSpace replace "
                "them",
                np.count_nonzero(~right),
                len(right),
            )
        return np.where(right[:, None], tangents, np.nan)

    def values(self, number: int, components: int) -> F64:
        """(N, K) the values of an accessor of K components; of normalised integers, the numbers that they stand for."""
        accessor = self.json["accessors"][number]
        if _NUMBERS[accessor["type"]] != components:
            raise ValueError(f"a {accessor['type']} for {components} components")
        count, width, kind = accessor["count"], _NUMBERS[accessor["type"]], np.dtype(_TYPES[accessor["componentType"]])
        self.unpacked += 8 * abs(count) * width
        if not self.unpacked <= self.limit:
            raise FormatError(f"it unpacks to more than {self.limit >> 20} MiB; reduce it first")
        values = self._rows(accessor, count, width, kind) if "bufferView" in accessor else np.zeros((count, width))
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            which, some = sparse["indices"], min(sparse["count"], count)
            rows = self._rows(which, some, 1, np.dtype(_TYPES[which["componentType"]])).astype(np.int64).ravel()
            values[rows] = self._rows(sparse["values"], some, width, kind)
        if accessor.get("normalized") and kind.kind in "iu":
            values = np.maximum(values / np.iinfo(kind).max, -1)
        return values

    def _rows(self, place: dict[str, Any], count: int, width: int, kind: np.dtype[Any]) -> F64:
        """(N, K) numbers in a buffer."""
        view = self.json["bufferViews"][place["bufferView"]]
        start, length = view.get("byteOffset", 0), view["byteLength"]
        window = memoryview(self._buffer(view["buffer"]))[start : start + length]
        if start < 0 or len(window) < length:
            raise ValueError("a buffer is shorter than it says")
        strides = view.get("byteStride") or width * kind.itemsize, kind.itemsize
        rows: NDArray[Any] = np.ndarray((count, width), kind, window, place.get("byteOffset", 0), strides)
        return rows.astype(np.float64)

    def _buffer(self, number: int) -> bytes:
        uri = self.json["buffers"][number].get("uri")
        if uri is None:
            return self.binary
        if not uri.startswith("data:"):
            raise FormatError(f"it refers to the file {uri[:99]!r}, which is not read; export everything into one file")
        if number not in self.embedded:
            self.embedded[number] = base64.b64decode(uri.partition(",")[2])
        return self.embedded[number]

    def common_transform(self, skin: dict[str, Any], places: dict[int, F64], name: str) -> F64:
        """(4, 4) from a skinned mesh's vertices to world space by the first joint. Warns if the joints disagree.

        A vertex is moved by its joints, each by its own global transform times its inverse bind matrix. The transform
        of the node that holds the mesh is ignored (glTF 2.0, section 3.7.3.3).
        """
        joints = np.array([places.get(joint, np.eye(4)) for joint in skin["joints"]])
        if "inverseBindMatrices" in skin:  # which are stored column by column
            bound = self.values(skin["inverseBindMatrices"], 16).reshape(-1, 4, 4).transpose(0, 2, 1)
            joints = joints @ bound[: len(joints)]
        first: F64 = joints[0].copy()
        first[3] = (0, 0, 0, 1)
        if not np.abs(joints[:, :3] - first[:3]).max() <= SAME_PLACE * np.abs(first).max():
            self.warn(
                "the skeleton of object %r is posed, which is not applied; export it in its rest pose, or apply its "
                "Armature modifier",
                name[:99],
            )
        return first

    def _say_what_is_left_out(self) -> None:
        for material in self.materials:
            # The texture that the baked one goes beside, or in the place of.
            texture = material.get("normalTexture") or material.get("pbrMetallicRoughness", {}).get("baseColorTexture")
            moved = {**_UNMOVED, **(texture or {}).get("extensions", {}).get(TEXTURE_TRANSFORM, {})}
            elsewhere = moved.pop("texCoord", texture.get("texCoord", 0)) if texture else 0
            if elsewhere or moved != _UNMOVED:
                self.warn(
                    "material %r uses other UVs than the first, or transforms them; textures are baked onto the first "
                    "UVs as they are",
                    str(material.get("name", ""))[:99],
                )
        if self.json.get("animations"):
            log.info("mesh file %s: its animations are not applied; it is read as it stands without them", self.path)
        if len(self.json.get("scenes", ())) > 1:
            log.info("mesh file %s: of its scenes, only the one that it shows first is read", self.path)


def _no_number(text: str) -> float:
    raise FormatError(f"it holds {text} in place of a number; export it again")


def _distinct(name: str, names: set[str]) -> str:
    """The name, numbered as Blender does if another object has it."""
    found, number = name, 0
    while name and found in names:
        number += 1
        found = f"{name}.{number:03}"
    names.add(found)
    return found


def _own_transform(node: dict[str, Any]) -> F64:
    """(4, 4) transform of a node relative to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    transform = np.eye(4)
    x, y, z, w = (float(one) for one in node.get("rotation", (0, 0, 0, 1)))
    transform[:3, :3] = np.array(quaternion_matrix(w, x, y, z)) * np.asarray(node.get("scale", (1, 1, 1)), float)
    transform[:3, 3] = node.get("translation", (0, 0, 0))
    return transform


def _triangles(order: I64, mode: int) -> I64:
    """(T, 3) the vertices of a primitive's triangles from those of its list, strip or fan."""
    if mode == TRIANGLES:
        return order[: len(order) // 3 * 3].reshape(-1, 3)
    if mode == STRIP:
        return strip_triangles(order)
    if mode != FAN:
        raise ValueError(f"mode {mode}")
    first = np.arange(max(len(order) - 2, 0))
    return order[np.stack([first + 1, first + 2, 0 * first], axis=1)]
