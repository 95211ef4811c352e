"""Shapes: closed surfaces drawn from a seed, and meshes from files, brought to one size.

A shape is drawn as a small description of plain JSON, which names a character and holds a seed, and is built from that
when it is needed: the same description gives the same shape to the last bit.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.synthesis.noise import gradient_noise
from mpsnet_core.synthesis.shapes import blobs, composites, drapery, groups, reliefs
from mpsnet_core.synthesis.shapes.draws import between, chance, count, generator, new_seed, picked
from mpsnet_core.synthesis.shapes.meshes import load_mesh, mesh_files
from mpsnet_core.synthesis.shapes.shape import Shape, fitted
from mpsnet_core.synthesis.shapes.surfaces import bent

KINDS = ("blobs", "drapery", "reliefs", "composites", "groups", "meshes")
# Cells of the grid along the longest side of a body, alone and as one of several.
CELLS, CELLS_IN_GROUP = 72, 44


def draw_shape(rng: np.random.Generator, kind: str, meshes: Sequence[str] = ()) -> dict[str, Any]:
    """A description, plain JSON, of a shape of the kind (one of KINDS); meshes: names of mesh files to choose from.

    Its "pose" says how it may be turned: "any"; "upright": z up, seen from the side to above, the front at -y; "front":
    +z to the camera, within some 40 degrees.

    Raises InputError where the kind is not known, or is "meshes" and there are none.
    """
    seed = new_seed(rng)
    if kind == "blobs":
        character = picked(rng, blobs.CHARACTERS, (2, 4, 1, 1, 1, 1))
        pose = "front" if character == "hollowed" else "any"
        return {"kind": kind, "seed": seed, "pose": pose, "character": character}
    if kind == "drapery":
        character = picked(rng, drapery.CHARACTERS, (4, 3, 3, 2))
        pose = "upright" if character == "draped" else "front"
        return {"kind": kind, "seed": seed, "pose": pose, "character": character}
    if kind == "reliefs":
        return {
            "kind": kind,
            "seed": seed,
            "pose": "front",
            "character": picked(rng, reliefs.CHARACTERS, (2, 2, 2, 2, 1, 3)),
        }
    if kind == "composites":
        character = composites.draw_character(rng)
        pose = "any" if character in composites.WEIGHTLESS and chance(rng, 0.7) else "upright"
        return {"kind": kind, "seed": seed, "pose": pose, "character": character}
    if kind == "groups":
        return {"kind": kind, "seed": seed, "pose": "upright"}
    if kind == "meshes":
        if not meshes:
            raise InputError("there are no mesh files to draw shapes from; name a folder of meshes")
        alone = chance(rng, 0.6)
        files = [picked(rng, meshes) for _ in range(1 if alone else count(rng, 2, 3))]
        pose = "any" if alone and chance(rng, 0.5) else "upright"
        return {"kind": kind, "seed": seed, "pose": pose, "files": files, "deformed": chance(rng, 0.5)}
    raise InputError(f"shapes of the kind {kind!r} are not known; choose from {', '.join(KINDS)}")


def build_shape(description: dict[str, Any], meshes: str | os.PathLike[str] = "") -> Shape:
    """The shape that a description from :func:`draw_shape` says; meshes: the folder that its files lie in.

    Raises InputError where the description is none, or a mesh file is missing or cannot be used.
    """
    try:
        kind, rng = description["kind"], generator(int(description["seed"]))
        if kind == "blobs":
            return fitted(blobs.build_blob(description["character"], rng, CELLS))
        if kind == "drapery":
            return fitted(drapery.build_drapery(description["character"], rng))
        if kind == "reliefs":
            return fitted(reliefs.build_relief(description["character"], rng, CELLS_IN_GROUP))
        if kind == "composites":
            return fitted(composites.build_composite(description["character"], rng, CELLS))
        if kind == "groups":
            return fitted(groups.build_group(rng, CELLS_IN_GROUP))
        if kind == "meshes":
            files = [Path(meshes) / Path(name).name for name in description["files"]]
            return _from_files(files, description["deformed"], rng)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{description!r} describes no shape that this program knows ({error!r})") from None
    raise InputError(f"shapes of the kind {kind!r} are not known; choose from {', '.join(KINDS)}")


def _from_files(files: Sequence[Path], deformed: bool, rng: np.random.Generator) -> Shape:
    shapes = [load_mesh(str(file)) for file in files]
    if deformed:
        shapes = [_deformed(shape, rng) for shape in shapes]
    return fitted(shapes[0] if len(shapes) == 1 else groups.on_ground(shapes, rng))


def _deformed(shape: Shape, rng: np.random.Generator) -> Shape:
    """The shape swollen, pressed and bent a little."""
    seed, scale, amount = new_seed(rng), between(rng, 0.8, 2.0), between(rng, 0.05, 0.2)
    stretch = np.array([between(rng, 0.8, 1.1) for _ in range(3)])

    def bend(points: NDArray[np.float64]) -> NDArray[np.float64]:
        swells = np.stack([gradient_noise(points * scale, seed + k) for k in range(3)], axis=1)
        return (points + amount / scale * swells) * stretch

    return bent(shape, bend)


__all__ = ["KINDS", "Shape", "build_shape", "draw_shape", "mesh_files"]
