"""The displacement: the baked texture's heights move the target's surface, by its material or by modifiers."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix

from mpsnet_core.errors import InputError

from .bake import BakesOnto
from .made_from import Ingredients, chosen, stamp
from .mesh_file import DISPLACE, SUBDIVISION, write_mesh
from .nodes import DISPLACEMENT_NODE, HEIGHT_NODE, NORMAL_NODE, TEXTURE_NODE, UV_NODE, own_node
from .operators import same
from .outputs import fine_preview, image_file, load_image, output_path, remembered
from .settings.declared import take_given
from .settings.displace import DisplaceSettings
from .textures import Worn, own_materials

# Vertices of a subdivided mesh lie on the limit surface at any level; a finer one tells hardly more.
MOST_BASE_LEVELS = 3


class MPS_OT_displace(BakesOnto, DisplaceSettings, bpy.types.Operator):
    """Make the baked texture's heights on the target's UVs and displace its surface by them"""

    bl_idname = "mps.displace"
    bl_label = "Displace Object"
    bl_options = {"UNDO"}

    @classmethod
    def lacks(cls, context: Any) -> str:
        return "" if context.scene.mps.bake.image else "Bake the texture first"

    @classmethod
    def made_from(cls, context: Any) -> Ingredients:
        scene = context.scene.mps
        return {"Texture": stamp(scene.bake.image), **chosen(DisplaceSettings, scene.displace)}

    def prepare(self, context: Any, folder: Path) -> tuple[list[str], Sequence[Path]]:
        bake = context.scene.mps.bake
        take_given(self, DisplaceSettings, context.scene.mps.displace)
        target = self.baked_object(context)
        image = _texture_of(target) or bake.image
        if image.source in {"SEQUENCE", "TILED"}:
            raise InputError("heights are made of one texture, not of a sequence or of UDIM tiles; bake a single one")
        texture = image_file(image, "texture", "bake it first")
        self._target = target.session_uid
        self._output = output_path(self.output, f"{target.name}_height", self.file_format)
        self._size = _size(target)
        context.view_layer.update()
        # In the object's own axes, as large as in the world: modifiers move vertices there, however it is stretched.
        turn = Matrix.Scale(self._size, 4) @ target.matrix_world.inverted()
        depsgraph = context.evaluated_depsgraph_get()
        self._uv_map = write_mesh(folder / "mesh.npz", target, depsgraph, bake.uv_map, turn)
        self._space = remembered(image, "space") or bake.space
        convention = remembered(image, "convention") or bake.convention
        arguments = ["integrate", str(texture), "--onto", str(folder / "mesh.npz"), "--height", str(self._output)]
        arguments += ["--space", self._space.lower(), "--convention", convention.lower()]
        arguments += ["--scale", f"{self.scale:g}", "--margin", str(bake.margin)]
        if self.levels:
            with _subdivided(target, self.subdivision, min(self.levels, MOST_BASE_LEVELS)):
                write_mesh(folder / "base.npz", target, context.evaluated_depsgraph_get(), self._uv_map, turn)
            arguments += ["--base", str(folder / "base.npz")]
        return arguments, [self._output]

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        scene = self.scene(f"its heights are in {self._output}")
        target = same(bpy.data.objects, self._target)
        if target is None:
            raise InputError(f"the target is gone; its heights are in {self._output}")
        image = load_image(self._output, f"MPS {target.name} Height", is_data=True)
        self.made(image)
        fine_preview(image, stretched=True)
        scene.mps.displace.image = image
        height = result["height"]
        strength, midlevel = height["strength"] / self._size, height["midlevel"]
        _subdivide(target, self.subdivision, self.levels)
        by_material = self.method == "MATERIAL"
        if by_material:
            _remove_modifier(target, DISPLACE)
        else:
            _displace(target, image, self._uv_map, strength, midlevel)
        normals = self.keep_normals or self._space == "OBJECT"
        taken_off = False
        for material in own_materials([Worn(target, (image,), self._uv_map)]):
            if by_material:
                wear_heights(material, image, self._uv_map, strength, midlevel)
            else:
                _take_heights_off(material)
            taken_off |= _show_normals(material, normals)
        told = "; the normal map is off, it would show the relief twice" if taken_off else ""
        self.report(
            {"INFO"},
            f"Displaced by {height['lowest']:.3g} to {height['highest']:.3g}; heights written to {self._output}{told}",
        )


def _texture_of(target: Any) -> Any:
    """The baked texture that an object wears, None where it wears none.

    Raises InputError where it wears several, or none while others wear those that there are.
    """
    worn = _textures(slot.material for slot in target.material_slots)
    if len(worn) > 1:
        raise InputError(f'the materials of "{target.name}" wear several textures; bake them into one')
    if not worn and _textures(bpy.data.materials):
        raise InputError(f'"{target.name}" wears no baked texture; choose the object that it was baked onto')
    return next(iter(worn), None)


def _textures(materials: Iterable[Any]) -> set[Any]:
    trees = (material.node_tree for material in materials if material and material.node_tree)
    return {tree.nodes[TEXTURE_NODE].image for tree in trees if TEXTURE_NODE in tree.nodes} - {None}


def _size(target: Any) -> float:
    """How much larger than itself the object stands in the world; the mean where it is stretched."""
    size: float = abs(target.matrix_world.to_3x3().determinant()) ** (1 / 3)
    if size < 1e-9:
        raise InputError(f'"{target.name}" is scaled to nothing in one direction; give it a scale above 0')
    return size


# --- modifiers --------------------------------------------------------------------------------------------------------


def _subdivide(target: Any, kind: str, levels: int, name: str = SUBDIVISION) -> None:
    """Give the object a Subdivision modifier, or the one of an earlier run these settings; none for no levels."""
    if not levels:
        _remove_modifier(target, name)
        return
    modifier = target.modifiers.get(name) or target.modifiers.new(name, "SUBSURF")
    modifier.subdivision_type = kind
    modifier.levels = modifier.render_levels = levels
    # The texture was baked onto the UVs as they are.
    modifier.uv_smooth = "NONE"
    modifier.use_custom_normals = False


@contextmanager
def _subdivided(target: Any, kind: str, levels: int) -> Iterator[None]:
    _subdivide(target, kind, levels, "MPS Trial")
    try:
        yield
    finally:
        _remove_modifier(target, "MPS Trial")


def _displace(target: Any, image: Any, uv_map: str, strength: float, midlevel: float) -> None:
    """Give the object a Displace modifier after all others, or the one of an earlier run these heights."""
    modifier = target.modifiers.get(DISPLACE) or target.modifiers.new(DISPLACE, "DISPLACE")
    texture = modifier.texture
    if texture is None or texture.type != "IMAGE":
        texture = modifier.texture = bpy.data.textures.new(f"MPS {target.name} Height", "IMAGE")
    texture.image, texture.extension = image, "EXTEND"
    texture.use_clamp = False  # heights go below 0
    # As the file is, not smoothed; newer Blenders have no such settings.
    for setting, value in (("use_mipmap", False), ("filter_size", 0.1)):
        if hasattr(texture, setting):
            setattr(texture, setting, value)
    modifier.texture_coords, modifier.uv_layer = "UV", uv_map
    modifier.direction, modifier.space = "NORMAL", "LOCAL"
    modifier.strength, modifier.mid_level = strength, midlevel


def _remove_modifier(target: Any, name: str) -> None:
    modifier = target.modifiers.get(name)
    if modifier is not None:
        target.modifiers.remove(modifier)


# --- materials --------------------------------------------------------------------------------------------------------


def wear_heights(material: Any, image: Any, uv_map: str, strength: float, midlevel: float) -> None:
    """Give a material the heights as its displacement, in the object's own units; nodes of an earlier run are used
    again.

    Raises InputError where the material has no output.
    """
    tree = material.node_tree
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if output is None:
        raise InputError(f'material "{material.name}" has no Material Output; add one to it')
    left, top = output.location.x, output.location.y - 700

    def node(name: str, kind: str, steps: int) -> Any:
        return own_node(tree, name, kind, left - 300 * steps, top)

    uv, heights = node(UV_NODE, "ShaderNodeUVMap", 3), node(HEIGHT_NODE, "ShaderNodeTexImage", 2)
    displacement = node(DISPLACEMENT_NODE, "ShaderNodeDisplacement", 1)
    uv.uv_map, heights.image = uv_map, image
    # As modifiers do: along the object's own normals, turned and stretched with it.
    displacement.space = "OBJECT"
    displacement.inputs["Midlevel"].default_value = midlevel
    displacement.inputs["Scale"].default_value = strength
    tree.links.new(uv.outputs["UV"], heights.inputs["Vector"])
    tree.links.new(heights.outputs["Color"], displacement.inputs["Height"])
    tree.links.new(displacement.outputs["Displacement"], output.inputs["Displacement"])
    material.displacement_method = "BOTH"


def _take_heights_off(material: Any) -> None:
    for name in (DISPLACEMENT_NODE, HEIGHT_NODE):
        node = material.node_tree.nodes.get(name)
        if node is not None:
            material.node_tree.nodes.remove(node)


def _show_normals(material: Any, shown: bool) -> bool:
    """Link the baked normal map to the material's shaders, or take it off; True where it was there and is off now."""
    tree = material.node_tree
    normal = tree.nodes.get(NORMAL_NODE)
    if normal is None:
        return False
    for shader in tree.nodes:
        if not shader.type.startswith("BSDF") or "Normal" not in shader.inputs:
            continue
        socket = shader.inputs["Normal"]
        if shown and not socket.is_linked:
            tree.links.new(normal.outputs["Normal"], socket)
        for link in [link for link in socket.links if link.from_node == normal and not shown]:
            tree.links.remove(link)
    return not shown


register, unregister = bpy.utils.register_classes_factory((MPS_OT_displace,))
