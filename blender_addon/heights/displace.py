"""Displacement of the target's surface by the baked texture's heights, by its material or by modifiers."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from mpsnet_core.errors import InputError, Note
from mpsnet_core.relief.operations import Integrate

from ..appearance.displacement import (
    assign_displacement,
    disable_bump_correction,
    remove_heights,
    remove_object_normals,
    show_normals,
    show_object_normals,
)
from ..appearance.modifiers import DISPLACE, TRIAL, keep_smoothness, move_by_modifier, remove_modifier, subdivide
from ..appearance.nodes import NORMAL_NODE, TEXTURE_NODE, find_node, image_in, trees_of
from ..appearance.shader_graph import output_of
from ..bake.bake_operator import BakeOperator
from ..bake.texture_sets import (
    AssignedTexture,
    ensure_own_materials,
    keep_materials_to_itself,
    store_owners,
    with_tokens,
)
from ..image_records import Provenance, chosen, remembered, stamp
from ..images import image_file, load_image, load_tiles, tile_files
from ..outputs import output_path, overruled_format
from ..scene.objects import by_session_uid
from ..scene.surfaces import values_of, world_scale
from ..settings.declared import options_of, round_as_typed
from ..settings.heights import DisplaceSettings

# A relief lower than this, as a fraction of the object's size, hardly shows.
_INVISIBLE = 2e-3
# Automatic: a face measures about so many texels, within so many faces; bumps up to so many edges of the mesh, and
# within these fractions of its size.
_TEXELS_A_FACE, _MOST_FACES, _MOST_LEVELS, _MATERIAL_LEVELS = 3, 400_000, 6, 2
_EDGES_A_BUMP, _BROADEST = 4, (0.01, 0.25)
# Vertices of a subdivided mesh lie on the limit surface at any level; a finer one adds hardly anything.
MAX_BASE_LEVELS = 3

_DERIVED = "%d subdivisions, and bumps up to %.1f%% of its size"
_FLAT = (
    "the relief is %.2f%% of the object's size: it hardly shows; choose a larger Broadest, a larger Strength in the "
    "step Bake, or keep the normal map"
)


class MPS_OT_displace(BakeOperator, DisplaceSettings, bpy.types.Operator):
    """Make the baked texture's heights on the target's UVs and displace its surface by them"""

    bl_label = "Displace Object"
    requires, step = "bake", "displace"

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        scene = context.scene.mps
        target = scene.bake.target
        assigned = _textures(trees_of(target)) if target is not None else set()
        texture = assigned.pop() if len(assigned) == 1 else scene.bake.image
        return {"Texture": stamp(texture), **chosen(scene.displace)}

    def prepare(self, context: Any, folder: Path) -> tuple[Integrate, Sequence[Path]]:
        bake = context.scene.mps.bake
        target = self.baked_object(context)
        image = _texture_of(target) or bake.image
        if image.source == "SEQUENCE":
            raise InputError("heights are made of one texture, not of a sequence; bake a single one")
        tiled = image.source == "TILED"
        texture = (tile_files if tiled else image_file)(image, "texture", "bake it first")
        self._target = target.session_uid
        path = output_path(self.output, f"{target.name}_height", self.file_format)
        self._output = with_tokens(path, "ONE", tiled)
        self._normals: Path | None = None
        self._notes = overruled_format(self._output, context.scene.mps.displace)
        self._size = world_scale(target)
        # In object axes, but at world size: modifiers displace in object space, even under non-uniform scale.
        turn = Matrix.Scale(self._size, 4) @ target.matrix_world.inverted()
        uv_map = _uv_map_of(target) or bake.uv_map
        self._uv_map = self.write_mesh(context, folder / "mesh.npz", target, uv_map, turn).uv_map
        if self.automatic and not self._given & {"levels", "scale"}:
            self.levels, self.scale = _suited(target, self._uv_map, max(image.size))
            if self.method == "MATERIAL":  # renders bumps between the vertices; facets show more in finer shadows
                self.levels = min(self.levels, _MATERIAL_LEVELS)
            self._notes = [*self._notes, Note(_DERIVED, self.levels, 100 * self.scale)]
        known: dict[str, Any] = {
            what: remembered(image, what) or getattr(bake, what) for what in ("space", "convention")
        }
        self._space = known["space"]
        # A subdivided mesh has other tangents, and needs normals in object space. Without subdivision, the existing map
        # works, even where UVs overlap, which an object-space map does not support.
        if self.keep_normals and self._space == "TANGENT" and self.levels:
            self._normals = with_tokens(path.with_name(f"{path.stem}_normal{path.suffix}"), "ONE", tiled)
        # Catmull-Clark changes the surface. Otherwise facets keep their smooth shading, unless all bumps are kept.
        self._smooth = self.subdivision == "SIMPLE" and round_as_typed(self.scale) > 0
        base = folder / "base.npz" if self.levels and not self._smooth else None
        if base:
            levels = min(self.levels, MAX_BASE_LEVELS)
            subdivide(target, self.subdivision, levels, levels, TRIAL)
            try:
                self.write_mesh(context, base, target, self._uv_map, turn)
            finally:
                remove_modifier(target, TRIAL)
        operation = Integrate(
            normals=str(texture),
            height=str(self._output),
            uvs=str(folder / "mesh.npz"),
            base=str(base) if base else None,
            object_space=str(self._normals) if self._normals else None,
            space=known["space"].lower(),
            convention=known["convention"].lower(),
            **options_of(Integrate, self),
            margin=bake.margin,
        )
        return operation, self._files()

    def _files(self) -> list[Path]:
        return [self._output, *([self._normals] if self._normals else [])]

    def result_owners(self) -> dict[Path, list[Any]]:
        return {file: [by_session_uid(bpy.data.objects, self._target)] for file in self._files()}

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        scene = self.scene(f"its heights are in {self._output}")
        target = by_session_uid(bpy.data.objects, self._target)
        if target is None:
            raise InputError(f"the target is gone; its heights are in {self._output}")
        image = _loaded(self._output, result["tiles"], f"MPS {target.name} Height")
        self.made(image, stretched=True)
        normals = None
        if self._normals:
            normals = _loaded(self._normals, result["tiles"], f"MPS {target.name} Object Normal")
        scene.mps.displace.image = image
        height = result["height"]
        normals_off = self._assign(target, image, normals, height["strength"] / self._size, height["midlevel"])
        off = "; the normal map is off, the displaced surface alone is shaded" if normals_off else ""
        size = max(target.dimensions)
        if height["highest"] - height["lowest"] < _INVISIBLE * size:
            relief = 100 * (height["highest"] - height["lowest"]) / max(size, 1e-12)
            self.note(Note(_FLAT, relief, level="look"))
        self.tell(
            f"Displaced by {height['lowest']:.3g} to {height['highest']:.3g}; heights written to {self._output}{off}"
        )

    def _assign(self, target: Any, image: Any, normals: Any, strength: float, midlevel: float) -> bool:
        """Displace the object by the heights in the chosen way. Returns whether its normal map was unlinked.

        normals: image of the normals in object space, None if there is none.
        """
        subdivide(target, self.subdivision, self.levels, self.levels)
        keep_smoothness(target, self._smooth)
        by_material = self.method == "MATERIAL"
        if by_material:
            remove_modifier(target, DISPLACE)
        else:
            move_by_modifier(target, image, self._uv_map, strength, midlevel)
        assigned = [AssignedTexture(target, (image,), self._uv_map)]
        store_owners(assigned)
        keep_materials_to_itself(target)
        normals_off = False
        for material in ensure_own_materials(assigned):
            if by_material and output_of(material) is None:
                words = 'Material "%s" has no Material Output and is not displaced'
                self.note(Note(words, material.name, level="look"))
            elif by_material:
                for name in assign_displacement(material, image, self._uv_map, strength, midlevel):
                    self.tell(f'The heights took the place of "{name}" in material "{material.name}"')
            else:
                for name in remove_heights(material):
                    self.tell(f'Material "{material.name}" is displaced by "{name}" again')
            if normals is not None:
                show_object_normals(material, normals, self._uv_map)
            else:
                remove_object_normals(material)
                kept = self.keep_normals and not self.levels
                normals_off |= show_normals(material, kept or self._space == "OBJECT")
                if kept:
                    disable_bump_correction(material)
        return normals_off


def _suited(target: Any, uv_map: str, pixels: int) -> tuple[int, float]:
    """Subdivisions and broadest bumps, as a fraction of its size, for a mesh with a texture of so many pixels."""
    mesh = target.data
    areas, layer = values_of(mesh.polygons, "area", 1), mesh.uv_layers.get(uv_map)
    across = np.ones(2)
    if layer is not None and len(layer.uv):  # a modifier's map is not there, nor any in Edit Mode
        across = np.ptp(np.clip(values_of(layer.uv, "vector", 2), 0, 1), axis=0)
    edge, texel = np.sqrt(areas.mean()), np.sqrt(areas.sum() / max(float(across.prod()), 1e-6)) / max(pixels, 1)
    most = np.log(_MOST_FACES / max(len(areas), 1)) / np.log(4)
    levels = int(np.clip(np.floor(min(np.log2(edge / (_TEXELS_A_FACE * texel)), most)), 0, _MOST_LEVELS))
    size = np.linalg.norm(np.ptp(np.array(target.bound_box), axis=0))
    return levels, float(f"{np.clip(_EDGES_A_BUMP * edge / size, *_BROADEST):.2g}")


def _loaded(file: Path, tiles: Sequence[int], name: str) -> Any:
    return load_tiles(file, tiles, name, is_data=True) if tiles else load_image(file, name, is_data=True)


def _texture_of(target: Any) -> Any:
    """The baked texture of an object, None if there is no baked texture at all.

    Raises InputError if the object has several, or if only other objects have one.
    """
    assigned = _textures(trees_of(target))
    if len(assigned) > 1:
        raise InputError(f'the materials of "{target.name}" use several textures; bake them into one')
    if not assigned and _textures(one.node_tree for one in bpy.data.materials if one.node_tree):
        raise InputError(f'"{target.name}" uses no baked texture; choose the object that it was baked onto')
    return next(iter(assigned), None)


def _uv_map_of(target: Any) -> str:
    """The UV map of an object's baked texture; "" if there is no texture, or the UV map was removed."""
    trees = trees_of(target)
    assigned = (
        node.uv_map for tree in trees if (node := find_node(tree, NORMAL_NODE)) and find_node(tree, TEXTURE_NODE)
    )
    return next((name for name in assigned if name in target.data.uv_layers), "")


def _textures(trees: Iterable[Any]) -> set[Any]:
    return {image_in(tree) for tree in trees} - {None}
