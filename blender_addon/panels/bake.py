"""Step 4: the bake."""

from typing import Any

from .step import Step


class MPS_PT_bake(Step):
    bl_label = "4  Bake"
    verbs = ("bake",)

    @classmethod
    def result(cls, context: Any) -> Any:
        return context.scene.mps.bake.image

    @classmethod
    def lacks(cls, context: Any) -> str:
        bake = context.scene.mps.bake
        selected = context.view_layer.objects.selected if bake.objects == "SELECTED" else []
        chosen = [*selected] or [bake.target or context.view_layer.objects.active]
        if super().lacks(context) or any(obj is not None and obj.type == "MESH" for obj in chosen):
            return super().lacks(context)
        return "Choose the target, the mesh object that gets the texture"

    def draw(self, context: Any) -> None:
        self.layout.popover("MPS_PT_bake_presets", text="Presets", icon="PRESET")
        bake = context.scene.mps.bake
        target = bake.target or context.view_layer.objects.active
        column = self.column()
        column.prop(bake, "objects")
        if bake.objects == "ACTIVE":
            column.prop(bake, "target", placeholder=target.name if target else "")
        if bake.objects == "ACTIVE" and target is not None and target.type == "MESH":
            column.prop_search(bake, "uv_map", target.data, "uv_layers")
        else:
            column.prop(bake, "uv_map")
        column.prop(bake, "preset")
        column.prop(bake, "size")
        column.prop(bake, "output", text="File", placeholder="Automatic")
        column.prop(bake, "mark_asset")
        normals = context.scene.mps.estimate.image
        if normals is not None and normals.source == "SEQUENCE":
            column.prop(bake, "animated")
        if context.scene.mps.rigs:
            column.prop(bake, "all_rigs")
        self.progress_or(context, "bake", "TEXTURE")
        self.layout.template_ID(bake, "image", open="image.open")
        self.picture(bake.image)
        self.layout.operator("mps.show_coverage", icon="OVERLAY", depress=bool(bake.overlays))
        lit = context.scene.mps.relight.lamp is not None
        self.layout.operator("mps.relight", icon="LIGHT_SUN", depress=lit)
        self.layout.operator("mps.make_node_group", icon="NODETREE")


class MPS_PT_texture(Step):
    bl_label = "Texture"
    bl_parent_id = "MPS_PT_bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        bake = context.scene.mps.bake
        column = self.column()
        column.prop(bake, "split")
        column.prop(bake, "tiles")
        column.prop(bake, "space")
        column.prop(bake, "convention")
        column.prop(bake, "samples")
        column.prop(bake, "fill")
        column.prop(bake, "padding")
        if bake.padding == "NEAREST":
            column.prop(bake, "margin")
        column.prop(bake, "file_format")
        column.prop(bake, "bits")


class MPS_PT_detail(Step):
    bl_label = "Detail"
    bl_parent_id = "MPS_PT_bake"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: Any) -> None:
        bake = context.scene.mps.bake
        column = self.column()
        column.prop(bake, "strength", slider=True)
        column.prop(bake, "level")
        if bake.level:
            column.prop(bake, "level_scale")
        column.prop(bake, "onto")
        if bake.onto:
            column.prop(bake, "onto_file", placeholder="The material's")
            if bake.onto_file:
                column.prop(bake, "onto_convention")
            column.prop(bake, "onto_shown")


CLASSES = (MPS_PT_bake, MPS_PT_texture, MPS_PT_detail)
