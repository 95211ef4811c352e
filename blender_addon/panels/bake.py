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
        chosen = context.scene.mps.bake.target or context.view_layer.objects.active
        if super().lacks(context) or (chosen is not None and chosen.type == "MESH"):
            return super().lacks(context)
        return "Choose the target, the mesh object that gets the texture"

    def draw(self, context: Any) -> None:
        bake = context.scene.mps.bake
        target = bake.target or context.view_layer.objects.active
        column = self.column()
        column.prop(bake, "target", placeholder=target.name if target else "")
        if target is not None and target.type == "MESH":
            column.prop_search(bake, "uv_map", target.data, "uv_layers")
        else:
            column.prop(bake, "uv_map")
        column.prop(bake, "size")
        column.prop(bake, "space")
        column.prop(bake, "convention")
        column.prop(bake, "margin")
        column.prop(bake, "file_format")
        column.prop(bake, "output", text="File", placeholder="Automatic")
        normals = context.scene.mps.estimate.image
        if normals is not None and normals.source == "SEQUENCE":
            column.prop(bake, "animated")
        if context.scene.mps.rigs:
            column.prop(bake, "all_rigs")
        self.progress_or(context, "bake", "TEXTURE")
        self.layout.template_ID(bake, "image", open="image.open")
        self.picture(bake.image)
        lit = context.scene.mps.relight.lamp is not None
        self.layout.operator("mps.relight", icon="LIGHT_SUN", depress=lit)


CLASSES = (MPS_PT_bake,)
