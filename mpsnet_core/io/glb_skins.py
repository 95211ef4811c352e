"""Skinned meshes of GLB files, whose place is that of their skeleton.

glTF 2.0, section 3.7.3.3: a vertex is moved by its joints, each by its own global transform times its inverse bind
matrix. The transform of the node that holds the mesh is ignored.
"""

import logging
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.rotations import quaternion_matrix
from mpsnet_core.errors import FormatError

log = logging.getLogger(__name__)

FLOAT = 5126
# Joints whose transforms differ by less, relative to the largest entry, move the mesh as one: files hold float32.
SAME_PLACE = 1e-4


def place_skinned(header: dict[str, Any], binary: bytes, path: Path) -> None:
    """Move each skinned mesh of a GLB file to a root node with the transform that its joints have in common.

    header: JSON part of the file, modified. binary: its buffer. Warns of a mesh whose joints
    move its parts differently: it stays in its bind pose, moved by the first joint.
    """
    if not header.get("skins"):
        return
    roots = header.get("scenes", [{}])[header.get("scene", 0)].get("nodes", [])
    nodes, places = header.get("nodes", []), dict[int, NDArray[np.float64]]()
    todo = [(root, np.eye(4)) for root in roots]
    while todo:
        number, parent = todo.pop()
        if number in places:  # a damaged file may name a node any number of times
            continue
        places[number] = parent @ _own_transform(nodes[number])
        todo += [(child, places[number]) for child in nodes[number].get("children", ())]
    of_skins: dict[int, tuple[NDArray[np.float64], bool]] = {}
    for number in sorted(places):
        node = nodes[number]
        if "skin" not in node or "mesh" not in node:
            continue
        skin = node.pop("skin")
        if skin not in of_skins:
            of_skins[skin] = _common_transform(header, header["skins"][skin], places, binary)
        transform, is_common = of_skins[skin]
        name = {"name": node.pop("name")} if "name" in node else {}
        if not is_common:
            log.warning(
                "%s: the skeleton of object %r is posed, which is not applied; export it in its rest pose, or apply "
                "its Armature modifier",
                path,
                str(name.get("name", number))[:99],
            )
        roots.append(len(nodes))
        nodes.append({"mesh": node.pop("mesh"), "matrix": transform.T.ravel().tolist(), **name})


def _own_transform(node: dict[str, Any]) -> NDArray[np.float64]:
    """(4, 4) transform of a node relative to its parent."""
    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    transform = np.eye(4)
    x, y, z, w = node.get("rotation", (0, 0, 0, 1))
    transform[:3, :3] = np.array(quaternion_matrix(w, x, y, z)) * node.get("scale", (1, 1, 1))
    transform[:3, 3] = node.get("translation", (0, 0, 0))
    return transform


def _common_transform(
    header: dict[str, Any], skin: dict[str, Any], places: dict[int, NDArray[np.float64]], binary: bytes
) -> tuple[NDArray[np.float64], bool]:
    """(4, 4) from a skinned mesh's vertices to world space by the first joint, and whether all joints agree."""
    joints = np.array([places.get(joint, np.eye(4)) for joint in skin["joints"]])
    if "inverseBindMatrices" in skin:
        joints = joints @ _matrices(header, skin["inverseBindMatrices"], binary)[: len(joints)]
    first = joints[0].copy()
    first[3] = (0, 0, 0, 1)
    return first, bool(np.abs(joints[:, :3] - first[:3]).max() <= SAME_PLACE * np.abs(first).max())


def _matrices(header: dict[str, Any], number: int, binary: bytes) -> NDArray[np.float64]:
    """(N, 4, 4) matrices of an accessor."""
    accessor = header["accessors"][number]
    if accessor["type"] != "MAT4" or accessor["componentType"] != FLOAT or "sparse" in accessor:
        raise FormatError("its inverse bind matrices are no matrices of floats; export it again")
    start = header["bufferViews"][accessor["bufferView"]].get("byteOffset", 0) + accessor.get("byteOffset", 0)
    values = np.frombuffer(binary, "<f4", 16 * accessor["count"], start)
    # glTF stores columns.
    return values.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
