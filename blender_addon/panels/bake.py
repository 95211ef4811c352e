"""Step 4: the bake."""

from pathlib import Path
from typing import Any

from mpsnet_core.errors import InputError

from ..bake.bake import NO_CAMERA, POOR_FIT
from ..bake.bake_operator import check_shows_normals
from ..bake.base_maps import usable_maps
from ..bake.before_after import comparing
from ..bake.coverage import hides_materials
from ..bake.texture_sets import BakeTarget, with_tokens
from ..bake.unwrap import lacks_uvs
from ..image_records import remembered
from ..photo.camera import chosen_camera
from ..rig.rig import rig_camera
from ..scene.mesh_file import slot_labels
from ..scene.objects import check_in_scene, target_of
from ..settings.record import error_of, notes_of
from .photo_inputs import lacks_file, lacks_named
from .step import Step, target_name


class MPS_PT_bake(Step):
    bl_label = "4  Bake"
    verbs = ("bake",)
    shows = "bake"

    @classmethod
    def lacks(cls, context: Any) -> str:
        return super().lacks(context) or _lacks_view(context.scene) or lacks_targets(context) or lacks_base_map(context)

    def draw(self, context: Any) -> None:
        bake = context.scene.mps.bake
        normals = context.scene.mps.estimate.image
        moves = normals is not None and normals.source == "SEQUENCE" and "animated"
        target = bake.objects == "ACTIVE" and "target"
        several = len(context.scene.mps.rigs) > 1 and "all_rigs"
        self.column(bake, "objects", target, "preset", "size", moves, several, target=target_name(context))
        if lacks_uvs(target_of(context)):
            self.layout.operator("mps.unwrap", icon="UV")
            self.failure(context.scene, "unwrap")
        photo = context.scene.mps.estimate.image and context.scene.mps.estimate.image.mps.photo
        if photo and photo.mps.poor and not notes_of(context.scene, "bake"):
            self.told(context, "fit", [POOR_FIT])
        self.progress_or(context, "bake", "TEXTURE")
        offer_anyway(self.layout, context.scene, "bake")
        if bake.image and hides_materials(context.space_data):
            show = self.layout.operator("wm.context_set_enum", text="Show in Viewport", icon="SHADING_TEXTURE")
            show.data_path, show.value = "space_data.shading.type", "MATERIAL"
        lit = context.scene.mps.relight.lamp is not None
        if bake.image or lit or bake.overlays:
            row = self.layout.row(align=True)
            row.operator("mps.relight", icon="LIGHT_SUN", depress=lit)
            row.operator("mps.show_coverage", icon="OVERLAY", depress=bool(bake.overlays))
            self.layout.operator("mps.before_after", icon="SPLIT_VERTICAL", depress=comparing())
            if not lit:
                self.column(context.scene.mps.relight, "neutral")
            for verb in ("relight", "show_coverage", "before_after"):
                self.failure(context.scene, verb)
        self.picture(bake.image)


def offer_anyway(layout: Any, scene: Any, verb: str) -> None:
    """A button that bakes although much less is seen than before, where that was refused."""
    if "[less-seen]" in error_of(scene, verb):
        layout.operator(f"mps.{verb}", icon="TEXTURE", text="Bake Anyway").anyway = True


def _lacks_view(scene: Any) -> str:
    """A sentence if the normals cannot be read, or their camera is unknown; otherwise ""."""
    normals, bake = scene.mps.estimate.image, scene.mps.bake
    if normals.source == "SEQUENCE" and (bake.objects == "SELECTED" or bake.split != "ONE" or bake.tiles):
        return "A sequence goes onto the target alone: set Objects to Target, Textures to One for All, UDIM Tiles off"
    if lacking := lacks_file(normals, "normal map"):
        return lacking
    if remembered(normals, "camera") is None and chosen_camera(scene, normals) is None:
        try:
            rig_camera(scene)
        except InputError:
            return NO_CAMERA
    return ""


def lacks_targets(context: Any, *, alone: bool = False) -> str:
    """Why the chosen objects cannot get a texture; "" if they can. alone: check the target alone in any case."""
    meshes = _meshes(context, alone=alone)
    if not meshes:
        return "Choose the target, the mesh object that gets the texture"
    return next(filter(None, (_lacks_target(context.scene, obj) for obj in meshes)), "")


def _meshes(context: Any, *, alone: bool = False) -> list[Any]:
    bake, objects = context.scene.mps.bake, context.view_layer.objects
    selected = bake.objects == "SELECTED" and not alone
    chosen = objects.selected if selected else [target_of(context)]
    return sorted((obj for obj in chosen if obj is not None and obj.type == "MESH"), key=lambda obj: obj.name)


def lacks_base_map(context: Any) -> str:
    """Why the detail cannot go on top of the objects' base maps; "" if it can, or need not."""
    bake, meshes = context.scene.mps.bake, _meshes(context)
    if bake.onto and bake.onto_file:
        return "" if "<" in bake.onto_file else lacks_named(bake, "onto_file", optional=True)  # a pattern
    if not bake.onto or any(obj.modifiers or obj.mode == "EDIT" for obj in meshes):  # these may create UVs
        return ""
    onto = [_bake_target(obj, bake.uv_map) for obj in meshes]
    file = with_tokens(Path(Path(bake.output).stem or "texture"), bake.split, bake.tiles)
    try:
        maps = usable_maps(meshes, onto, file)
    except InputError as error:
        return str(error)
    return next(filter(None, (lacks_file(one, "normal map") for one in maps if one.source != "TILED")), "")


def _lacks_target(scene: Any, obj: Any) -> str:
    try:
        check_in_scene(scene, obj, "target")
        if scene.mps.bake.assign:
            check_shows_normals(obj)
    except InputError as error:
        return str(error)
    if obj.modifiers or obj.mode == "EDIT":  # these may create faces and UVs
        return ""
    if not obj.data.polygons:
        return f'"{obj.name}" has no faces; choose an object with a surface'
    if not obj.data.uv_layers:
        return f'"{obj.name}" has no UV map; press Unwrap, or unwrap it by hand'
    uv_map = scene.mps.bake.uv_map
    if uv_map and uv_map not in obj.data.uv_layers:
        return f'"{obj.name}" has no UV map "{uv_map}"; choose another in Texture'
    return ""


def _bake_target(obj: Any, uv_map: str) -> BakeTarget:
    rendered = next((layer.name for layer in obj.data.uv_layers if layer.active_render), "")
    return BakeTarget(obj.session_uid, obj.name, uv_map or rendered, tuple(slot_labels(obj)), frozenset())


class MPS_PT_texture(Step):
    bl_label = "Texture"
    bl_parent_id = "MPS_PT_bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        self.layout.popover("MPS_PT_bake_presets", text="Presets", icon="PRESET")
        bake = context.scene.mps.bake
        target = target_of(context)
        column = self.column()
        if bake.objects == "ACTIVE" and target is not None and target.type == "MESH":
            column.prop_search(bake, "uv_map", target.data, "uv_layers")
        else:
            column.prop(bake, "uv_map")
        margin, mark = bake.padding == "NEAREST" and "margin", bake.assign and "mark_asset"
        surface = ("split", "tiles", "space", "convention", "samples", "fill", "padding", margin)
        self.column(bake, "output", *surface, "file_format", "bits", "assign", mark)
        self.layout.template_ID(bake, "image", open="image.open")
        self.layout.operator("mps.make_node_group", icon="NODETREE")
        self.failure(context.scene, "make_node_group")


class MPS_PT_detail(Step):
    bl_label = "Detail"
    bl_parent_id = "MPS_PT_bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        bake = context.scene.mps.bake
        self.column().prop(bake, "strength", slider=True)
        onto = (bake.onto and name for name in ("onto_file", bake.onto_file and "onto_convention", "onto_shown"))
        self.column(bake, "level", "level_scale" if bake.level else "agreed", "onto", *onto, onto_file="The material's")
