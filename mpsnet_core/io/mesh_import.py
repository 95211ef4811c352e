"""Mesh files of other programs, by trimesh."""

import json
import logging
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import IO, Any

from mpsnet_core.errors import FormatError, InputError
from mpsnet_core.io.glb_skins import FLOAT, place_skinned
from mpsnet_core.io.npz import unpacked_limit

log = logging.getLogger(__name__)

# glTF: components per element, and bytes per component.
_NUMBERS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
FAN = 6  # mode of a glTF primitive
TRANSFORM = "KHR_texture_transform"
INSTANCES = "EXT_mesh_gpu_instancing"
# The attributes of a mesh that are read, and extensions that compress them.
PLAIN = {"POSITION", "NORMAL", "TEXCOORD_0", "indices"}
PACKED = {"EXT_meshopt_compression", "KHR_meshopt_compression", "KHR_draco_mesh_compression"}
MAX_BYTES = 4 << 30
# Limit of vertices over all instances of all meshes.
MAX_VERTICES = 1 << 26
# Limit of a GLB file's nodes and meshes. Each node counts once for itself and once for each of its ancestors.
MAX_PARTS = 1 << 16


@contextmanager
def read_scene(path: Path) -> Iterator[Any]:
    """The trimesh scene of a file, whose suffix determines its format, with vertices and UVs unmerged.

    Files that it refers to are not opened.

    Raises FormatError, without the file's name, if it cannot be read, or the with block fails on its content.
    """
    import trimesh  # slow to import

    logging.getLogger("trimesh").addHandler(logging.NullHandler())  # keep its log messages off stderr

    class Alone(trimesh.resolvers.ZipResolver):
        """Replaces the resolver that opens the files next to the mesh that it refers to."""

        def get(self, name: str) -> bytes:
            raise InputError(f"it refers to the file {name[:99]!r}, which is not read; export everything into one file")

    try:
        with path.open("rb") as file:  # given a path, trimesh would open the files next to it
            content: IO[bytes] = file
            if path.suffix.lower() == ".glb":
                header = _glb_header(file)
                _check_size(header, unpacked_limit(path, MAX_BYTES))
                _check_parts(header)
                _check_plain(header)
                _warn_of_other_uvs(header, path)
                rest = file.read()
                place_skinned(header, rest[8:], path)
                content = _with_plain_materials(header, rest)
            # process=False: merging vertices would lose UV seams and sharp edges.
            scene = trimesh.load_scene(
                content,
                file_type=path.suffix.lower().lstrip("."),
                resolver=Alone({}),
                process=False,
                maintain_order=True,
            )
        vertices = sum(len(scene.geometry[name].vertices) * len(at) for name, at in scene.graph.geometry_nodes.items())
        if vertices > MAX_VERTICES:
            raise InputError(f"it has {vertices} vertices, more than {MAX_VERTICES}; reduce it first")
        yield scene
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001  # trimesh raises anything for damaged files
        raise FormatError(f"it cannot be read ({type(error).__name__}: {error}); export it again") from None


def _glb_header(file: IO[bytes]) -> dict[str, Any]:
    """The JSON part of a GLB file."""
    length, _ = struct.unpack("<II", file.read(20)[12:])
    header: dict[str, Any] = json.loads(file.read(length), parse_constant=_no_number)
    return header


def _no_number(text: str) -> float:
    raise FormatError(f"it holds {text} in place of a number; export it again")


def _with_plain_materials(header: dict[str, Any], rest: bytes) -> IO[bytes]:
    """A GLB file whose materials have only names. rest: what follows its JSON part.

    Images are not needed, and trimesh may decode them. trimesh drops the UVs of a part without a material, so such
    parts get one without a name.
    """
    kept = {name: part for name, part in header.items() if name not in ("images", "textures", "samplers")}
    named = [{"name": str(one.get("name", ""))} if "name" in one else {} for one in header.get("materials", ())]
    kept["materials"] = [*named, {}]
    for one in (one for mesh in header.get("meshes", ()) for one in mesh["primitives"]):
        one.setdefault("material", len(named))
    text = json.dumps(kept).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    return BytesIO(head + text + rest)


def _check_size(header: dict[str, Any], limit: int) -> None:
    """Raise FormatError if a GLB file claims more than `limit` bytes.

    trimesh trusts the sizes of arrays in the file, and copies an array for each reference to it.
    """
    arrays = [
        _NUMBERS[one["type"]] * _BYTES[one["componentType"]] * abs(one["count"]) for one in header.get("accessors", ())
    ]
    primitives = [one for mesh in header.get("meshes", ()) for one in mesh["primitives"]]
    named = [number for one in primitives for number in (*one["attributes"].values(), one.get("indices"))]
    needed = sum(arrays) + sum(abs(view["byteLength"]) for view in header.get("bufferViews", ()))
    needed += sum(arrays[number] for number in named if number is not None)
    if not needed <= limit:
        raise FormatError(
            f"it unpacks to {needed / (1 << 20):.0f} MiB, more than the limit of {limit >> 20}; reduce it first"
        )


def _check_parts(header: dict[str, Any]) -> None:
    """Raise FormatError if a GLB file exceeds :data:`MAX_PARTS`: trimesh follows each node to the root."""
    nodes = header.get("nodes", ())
    meshes = [len(mesh["primitives"]) for mesh in header.get("meshes", ())]
    parts = sum(meshes) + sum(meshes[node["mesh"]] for node in nodes if "mesh" in node)
    level = nodes
    while level and parts <= MAX_PARTS:  # a cycle of nodes never ends
        parts += len(level)
        inner = (nodes[child] for node in level for child in node.get("children", ()))
        level = list(islice(inner, MAX_PARTS))
    if parts > MAX_PARTS:
        raise FormatError("it has too many objects, or nests them too deeply; join them first")


def _warn_of_other_uvs(header: dict[str, Any], path: Path) -> None:
    """Warn if a material's normal map uses another UV set than the first, the only one that is read."""
    for material in header.get("materials", ()):
        texture = material.get("normalTexture", {})
        if texture.get("texCoord", 0) or TRANSFORM in texture.get("extensions", {}):
            log.warning(
                "%s: the normal map of material %r uses other UVs than the first, or transforms them; "
                "textures are baked onto the first UVs as they are",
                path,
                str(material.get("name", ""))[:99],
            )


def _check_plain(header: dict[str, Any]) -> None:
    """Raise FormatError if a GLB file's vertices are stored in a form that trimesh mistakes for plain values, or its
    triangles or instances in one that it ignores."""
    packed = PACKED & set(header.get("extensionsRequired", ()))
    if any(INSTANCES in node.get("extensions", {}) for node in header.get("nodes", ())):
        raise FormatError("it holds GPU instances, which are not supported; export it without them")
    for one in (one for mesh in header.get("meshes", ()) for one in mesh["primitives"]):
        if one.get("mode") == FAN:
            raise FormatError("it holds triangle fans, which are not supported; export it with plain triangles")
        numbers = one["attributes"] | ({"indices": one["indices"]} if one.get("indices") is not None else {})
        for name in PLAIN & set(numbers):
            accessor = header["accessors"][numbers[name]]
            if "sparse" in accessor:
                packed.add("sparse accessors")
            # Normalised integers do not change the direction of normals.
            shares = name == "POSITION" and accessor.get("normalized")
            if shares or (name == "TEXCOORD_0" and accessor["componentType"] != FLOAT):
                packed.add("whole numbers for UVs or vertices")
    if packed:
        raise FormatError(f"it is compressed ({', '.join(sorted(packed))}); export it without compression")
