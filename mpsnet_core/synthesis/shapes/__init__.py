"""Shapes: procedural closed surfaces, and meshes from files, normalised in size.

Drawing a shape gives a small JSON description with a character and a seed. The shape is built from it when needed: the
same description gives the same shape.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.errors import FormatError, InputError, SettingsError, check_choice
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.synthesis.noise import gradient_noise
from mpsnet_core.synthesis.random_sampling import chance, choice, generator, integer, new_seed, uniform
from mpsnet_core.synthesis.shapes import blobs, drapery, hollows, reliefs
from mpsnet_core.synthesis.shapes.meshes import load_mesh, mesh_files
from mpsnet_core.synthesis.shapes.shape import Shape, bent, fitted

__all__ = ["KINDS", "Shape", "build_shape", "draw_shape", "mesh_files"]

KINDS = ("blobs", "drapery", "reliefs", "groups", "hollows", "meshes")
# Grid cells along the longest side of a body, alone and in a group.
CELLS, CELLS_IN_GROUP = 72, 44
# Characters and how frequent they are, the pose of most, and that of the others.
_CHARACTERS: dict[str, tuple[Sequence[str], Sequence[float] | None, str, dict[str, str]]] = {
    "blobs": (blobs.CHARACTERS, (2, 4, 1, 1, 1, 1), "any", {"hollowed": "front"}),
    "drapery": (drapery.CHARACTERS, (4, 3, 3, 2), "front", {"draped": "upright"}),
    "reliefs": (reliefs.CHARACTERS, (2, 2, 2, 2, 1), "front", {}),
    "hollows": (hollows.CHARACTERS, None, "front", {}),
}


def draw_shape(rng: np.random.Generator, kind: str, meshes: Sequence[str] = ()) -> dict[str, Any]:
    """Draw the description of a shape.

    Parameters
    ----------
    rng
        Random generator.
    kind
        One of KINDS.
    meshes
        Names of mesh files to choose from, for the kind "meshes".

    Returns
    -------
    dict
        Plain JSON for :func:`build_shape`. Its "pose" states which rotations suit the shape: "any"; "upright": z up,
        seen from the side to above, the front at -y; "front": +z towards the camera, within about 40 degrees.

    Raises
    ------
    SettingsError
        If the kind is unknown, or is "meshes" and there are none.

    Examples
    --------
    >>> draw_shape(np.random.default_rng(3), "reliefs")["pose"]
    'front'
    """
    check_choice("kind of shape", kind, KINDS)
    description: dict[str, Any] = {"kind": kind, "seed": new_seed(rng)}
    if kind == "groups":
        return {**description, "pose": "upright"}
    if kind in _CHARACTERS:
        characters, weights, pose, others = _CHARACTERS[kind]
        character = choice(rng, characters, weights)
        return {**description, "pose": others.get(character, pose), "character": character}
    if not meshes:
        raise SettingsError("there are no mesh files to draw shapes from; name a folder of meshes")
    alone = chance(rng, 0.6)
    files = [choice(rng, meshes) for _ in range(1 if alone else integer(rng, 2, 3))]
    pose = "any" if alone and chance(rng, 0.5) else "upright"
    return {**description, "pose": pose, "files": files, "deformed": chance(rng, 0.5)}


def build_shape(description: dict[str, Any], meshes: AnyPath = "") -> Shape:
    """Build a shape from its description.

    Parameters
    ----------
    description
        From :func:`draw_shape`.
    meshes
        The folder of mesh files.

    Returns
    -------
    Shape
        Centred at the origin, with a bounding sphere of radius 1.

    Raises
    ------
    SettingsError
        If the kind is unknown.
    FormatError
        If the description is incomplete, or a mesh file is damaged.
    FileError
        If a mesh file is missing.
    GeometryError
        If a mesh file has no surface.

    Examples
    --------
    >>> shape = build_shape({"kind": "reliefs", "seed": 1, "character": "letters"})
    >>> float(np.linalg.norm(shape.vertices, axis=1).max().round(6))
    1.0
    """
    try:
        kind, rng = description["kind"], generator(int(description["seed"]))
        check_choice("kind of shape", kind, KINDS)
        if kind == "blobs":
            return fitted(blobs.build_blob(description["character"], rng, CELLS))
        if kind == "drapery":
            return fitted(drapery.build_drapery(description["character"], rng))
        if kind == "reliefs":
            return fitted(reliefs.build_relief(description["character"], rng))
        if kind == "groups":
            return fitted(blobs.build_group(rng, CELLS_IN_GROUP))
        if kind == "hollows":
            return fitted(hollows.build_hollow(description["character"], rng, CELLS))
        shapes = [load_mesh(str(Path(meshes) / Path(name).name)) for name in description["files"]]
        if description["deformed"]:
            shapes = [_deformed(shape, rng) for shape in shapes]
        return fitted(shapes[0] if len(shapes) == 1 else blobs.on_ground(shapes, rng))
    except InputError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"{description!r} does not describe a shape that this program knows ({error!r})") from None


def _deformed(shape: Shape, rng: np.random.Generator) -> Shape:
    """The shape, slightly inflated, compressed and bent."""
    seed, scale, amount = new_seed(rng), uniform(rng, 0.8, 2.0), uniform(rng, 0.05, 0.2)
    stretch = np.array([uniform(rng, 0.8, 1.1) for _ in range(3)])

    def bend(points: F64) -> F64:
        swells = np.stack([gradient_noise(points * scale, seed + k) for k in range(3)], axis=1)
        return (points + amount / scale * swells) * stretch

    return bent(shape, bend)
