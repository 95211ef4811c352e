"""Denoising of each light group by OpenImageDenoise in the compositor: Cycles denoises the combined image alone."""

from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.synthesis.cycles import LIGHT_GROUPS
from mpsnet_core.synthesis.scene_description import SceneDescription

from ...outputs import with_escaped_braces

LAYER = "ViewLayer"  # the view layer's name, which the names of a render's passes begin with
_FRAME = 1  # Blender 4.5 appends its number to the name of the compositor's file


def denoising_helps(recipe: SceneDescription) -> bool:
    """Whether denoising brings the light closer to the converged render.

    Direct light has hardly any noise: denoising would remove its texture and highlights. Indirect light is noisy.
    """
    return recipe.bounces > 0


def add_denoising(scene: Any, passes: list[str], path: Path) -> Path:
    """Have the compositor write the scene's next render with its light groups denoised. Returns that file's path.

    The file is like a render's own multi-layer EXR. Its path is `path`, with a number that Blender 4.5 appends. passes:
    its passes in addition to Combined and Normal.
    """
    scene.frame_set(_FRAME)
    scene.view_layers[0].cycles.denoising_store_passes = True
    render = scene.render
    render.use_compositing, render.use_file_extension = True, True
    render.compositor_device, render.compositor_precision = "CPU", "FULL"
    if bpy.app.version >= (5, 0):
        scene.compositing_node_group = tree = bpy.data.node_groups.new("MPS Denoising", "CompositorNodeTree")
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
    rendered = tree.nodes.new("CompositorNodeRLayers")
    rendered.scene = scene
    written = _Written(tree, path)
    written.add("RGBA", "Combined", rendered.outputs["Image"])
    written.add("VECTOR", "Normal", rendered.outputs["Normal"])
    for one in passes:
        output = rendered.outputs[one]
        written.add("FLOAT" if output.type == "VALUE" else "RGBA", one, output)
    for group in LIGHT_GROUPS:
        denoise = tree.nodes.new("CompositorNodeDenoise")
        # The guide passes have almost no noise, and prefiltering would remove fine texture.
        if bpy.app.version >= (5, 0):
            denoise.inputs["Prefilter"].default_value, denoise.inputs["Quality"].default_value = "None", "High"
        else:
            denoise.prefilter, denoise.quality = "NONE", "HIGH"
        combined = f"Combined_{group}"
        tree.links.new(rendered.outputs[combined], denoise.inputs["Image"])
        tree.links.new(rendered.outputs["Denoising Normal"], denoise.inputs["Normal"])
        tree.links.new(rendered.outputs["Denoising Albedo"], denoise.inputs["Albedo"])
        written.add("RGBA", combined, denoise.outputs[0])
    return written.path


class _Written:
    """The compositor's File Output node, as a multi-layer EXR."""

    def __init__(self, tree: Any, path: Path) -> None:
        self.tree, self.node = tree, tree.nodes.new("CompositorNodeOutputFile")
        settings = self.node.format
        if bpy.app.version >= (5, 0):
            settings.media_type = "MULTI_LAYER_IMAGE"
            self.node.directory, self.node.file_name = with_escaped_braces(path.parent), path.stem
            self.path = path
        else:
            self.node.base_path = with_escaped_braces(path.with_suffix(""))
            self.path = path.with_name(f"{path.stem}{_FRAME:04d}{path.suffix}")
        settings.file_format = "OPEN_EXR_MULTILAYER"
        settings.color_mode, settings.color_depth, settings.exr_codec = "RGBA", "32", "ZIPS"
        if bpy.app.version < (5, 0):
            self.node.layer_slots.clear()

    def add(self, kind: str, name: str, image: Any) -> None:
        """Write an image as a layer. kind: RGBA, VECTOR or FLOAT."""
        name = f"{LAYER}.{name}"
        if bpy.app.version >= (5, 0):
            self.node.file_output_items.new(kind, name)
        else:
            self.node.layer_slots.new(name)
        self.tree.links.new(image, self.node.inputs[name])
