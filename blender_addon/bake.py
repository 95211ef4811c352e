"""The bake: normals seen by the camera become a texture on the target's UVs, and its material wears it."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.props import StringProperty
from mathutils import Matrix
from numpy.typing import NDArray

from mpsnet_core.camera import write_camera
from mpsnet_core.errors import InputError

from .operators import RunsCore, idle
from .outputs import (
    FORMATS,
    frame_pattern,
    image_file,
    load_frames,
    load_image,
    output_frames,
    output_path,
    picture_size,
    remember,
    remembered,
)
from .rig import rig_camera, scene_camera
from .settings.bake import BakeSettings
from .settings.declared import take_given

# What a modifier shows in the viewport, and what in a render.
_SHOWN_AND_RENDERED = (
    ("show_viewport", "show_render"),
    ("levels", "render_levels"),
    ("steps", "render_steps"),
    ("viewport_resolution", "resolution"),
)
TEXTURE_NODE = "MPS Texture"
NORMAL_NODE, UV_NODE = "MPS Normal", "MPS UV"
# What `mps.displace` gives an object. Textures are baked onto the object without them, and heights are of that.
SUBDIVISION, DISPLACE = "MPS Subdivision", "MPS Displace"
BITS = {".png": "16", ".tif": "16", ".tiff": "16", ".exr": "32"}


class BakesOnto:
    """What the operators share that bake: the object that gets the texture."""

    target: StringProperty(
        name="Target",
        description="Name of the mesh object that gets the texture. Empty: the panel's target, else the active object",
        options={"SKIP_SAVE"},
    )

    def onto(self, context: Any) -> Any:
        """The object to bake onto. Raises InputError where there is none, or it is another file's."""
        settings = context.scene.mps.bake
        if self.target:
            settings.target = named_object(context.scene, self.target)
        target = settings.target or context.view_layer.objects.active  # `--command` has no context.object
        if target is None:
            raise InputError("there is no target to bake onto; choose a mesh object")
        _refuse_linked(target)
        return target


class MPS_OT_bake(RunsCore, BakesOnto, BakeSettings, bpy.types.Operator):
    """Bake the estimated normals into a texture on the target's UV map and give its material a Normal Map node"""

    bl_idname = "mps.bake"
    bl_label = "Bake Texture"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        if context.scene.mps.estimate.image is None:
            cls.poll_message_set("Estimate the normals first")
            return False
        return idle(cls, context)

    def prepare(self, context: Any, folder: Path) -> tuple[list[str], Sequence[Path]]:
        scene = context.scene
        take_given(self, BakeSettings, scene.mps.bake)
        normals_image = scene.mps.estimate.image
        normals = image_file(normals_image, "normal map", "estimate the normals first")
        target = self.onto(context)
        self._scene, self._target = scene.name, target.name
        self._frames = range(0)
        suffix = f".{FORMATS[self.file_format]}"
        if normals_image.source == "SEQUENCE":
            estimate = scene.mps.estimate
            self._frames = range(estimate.first_frame, estimate.last_frame + 1)
            normals = frame_pattern(normals)
            self._output = output_frames(self.output, f"{target.name}_normal")
            arguments = ["bake", "--format", suffix[1:]]
        else:
            self._output = output_path(self.output, f"{target.name}_normal", self.file_format)
            suffix = self._output.suffix.lower()
            arguments = ["bake"]
        mesh, camera = self._write_place(context, folder, target, normals_image)
        arguments += ["--mesh", mesh, "--view", f"{camera}={normals}", "--output", str(self._output)]
        arguments += ["--size", str(self.size), "--margin", str(self.margin), "--bits", BITS[suffix]]
        arguments += ["--space", self.space.lower(), "--convention", self.convention.lower()]
        return arguments, [self._output / "frames" if self._frames else self._output]

    def _write_place(self, context: Any, folder: Path, target: Any, normals_image: Any) -> tuple[str, str]:
        """Write mesh and camera as they stand, or for each frame of a sequence where they shall move along."""
        scene, taken_with = context.scene, remembered(normals_image, "camera")
        if taken_with is not None:
            (folder / "camera.json").write_text(taken_with, encoding="utf-8")

        def write(mesh: str, camera: str) -> None:
            context.view_layer.update()
            self._uv_map = write_mesh(folder / mesh, target, context.evaluated_depsgraph_get(), self.uv_map)
            if taken_with is None:
                write_camera(folder / camera, scene_camera(rig_camera(scene), scene, picture_size(normals_image)))

        if not (self._frames and self.animated):
            write("mesh.npz", "camera.json")
            return str(folder / "mesh.npz"), str(folder / "camera.json")
        current = scene.frame_current
        try:
            for number in self._frames:
                scene.frame_set(number)
                write(f"mesh_{number:06d}.npz", f"camera_{number:06d}.json")
        finally:
            scene.frame_set(current)
        camera = "camera.json" if taken_with is not None else "camera_######.json"
        return str(folder / "mesh_######.npz"), str(folder / camera)

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        scene, target = bpy.data.scenes.get(self._scene), bpy.data.objects.get(self._target)
        if scene is None or target is None:
            raise InputError(f'"{self._target}" is gone or renamed; its texture is in {self._output}')
        if self._frames:
            image = load_frames(Path(result["first_output"]), f"MPS {target.name} Frames")
        else:
            image = load_image(self._output, f"MPS {target.name}", is_data=True)
        scene.mps.bake.image = image
        for sentence in wear_texture(target, image, self._uv_map, self.space, self.convention, self._frames):
            self.report({"INFO"}, sentence)
        for note in result.get("notes", []):
            self.report({"INFO"}, note)
        turned = "; DirectX, so the material turns its green round for Blender" if self.convention == "DIRECTX" else ""
        if self._frames:
            self.report(
                {"INFO"}, f"{result['count']} textures are in {self._output}, {result['made']} made now{turned}"
            )
            return
        self.report({"INFO"}, f"Texture written to {self._output}; {result['seen']:.0%} of the surface seen{turned}")


def named_object(scene: Any, name: str) -> Any:
    """The scene's object of that name. Raises InputError where there is none."""
    target = scene.objects.get(name)
    if target is None:
        raise InputError(f'there is no object "{name}" in the scene; check its name')
    return target


def _refuse_linked(target: Any) -> None:
    """What another file holds cannot be given a material. A linked material can: a copy of it is worn."""
    for datablock, what in ((target, "object"), (target.data, "mesh")):
        if datablock is not None and datablock.library is not None:
            raise InputError(
                f'the {what} "{datablock.name}" is linked from {datablock.library.filepath}; make it local first'
            )


def write_mesh(path: Path, obj: Any, depsgraph: Any, uv_map: str | None, turn: Matrix | None = None) -> str:
    """Write an object as the render sees it, modifiers applied, as the core's mesh file; give the UV map's name.

    Normals and tangents of each corner are Blender's own. uv_map: "" for the one that is active for rendering, None
    where only the shape counts. turn: brings Blender's world into that of the cameras, where they differ.

    Raises InputError where the object is no mesh, has no faces, lacks the UV map or is disabled in viewports.
    """
    if obj.type != "MESH":
        raise InputError(f'"{obj.name}" is not a mesh but {obj.type.lower()}; convert it to a mesh first')
    if obj.mode == "EDIT":
        obj.update_from_editmode()
    obj.data.update_tag()
    with as_rendered(obj):
        depsgraph.update()
        evaluated = obj.evaluated_get(depsgraph)
        if not evaluated.is_evaluated:
            raise InputError(f'"{obj.name}" is disabled in viewports or excluded from the view layer; enable it first')
        mesh = bpy.data.meshes.new_from_object(evaluated, preserve_all_data_layers=True, depsgraph=depsgraph)
    try:
        if uv_map is not None:
            uv_map = _uv_map(obj, mesh, uv_map)
        if not mesh.polygons:
            raise InputError(f'"{obj.name}" has no faces; choose an object with a surface')
        corners = _read(mesh.loop_triangles, "loops", 3, np.int32)
        normals = _read(mesh.corner_normals, "vector", 3)[corners]
        triangles = _read(mesh.loop_triangles, "vertices", 3, np.int32)
        vertices = _read(mesh.vertices, "co", 3)
        layout: dict[str, NDArray[Any]] = {}
        if uv_map is None:
            layout["uvs"] = np.tile(np.array([[0, 0], [1, 0], [0, 1]], np.float32), (len(triangles), 1, 1))
        else:
            layout["uvs"] = _read(mesh.uv_layers[uv_map].uv, "vector", 2)[corners]
            if _read(mesh.polygons, "loop_total", 1, np.int32).max() > 4:
                layout["tangents"] = _tangents_of_triangles(vertices, triangles, normals, layout["uvs"])
            else:
                mesh.calc_tangents(uvmap=uv_map)
                layout["tangents"] = _tangents(mesh)[corners]
        np.savez(
            path,
            format=np.array("mpsnet-mesh"),
            version=np.array(1),
            vertices=vertices,
            triangles=triangles,
            corner_normals=normals,
            world_from_object=np.array(turn @ obj.matrix_world if turn else obj.matrix_world, dtype=np.float64),
            **layout,
        )
    finally:
        bpy.data.meshes.remove(mesh)
    return uv_map or ""


@contextmanager
def as_rendered(obj: Any) -> Iterator[None]:
    """Within, the object's modifiers show in the viewport, and so in the dependency graph, what a render shows; without
    the displacement that the add-on made."""
    kept = []
    try:
        for modifier in obj.modifiers:
            if modifier.name in (SUBDIVISION, DISPLACE):
                kept.append((modifier, "show_viewport", modifier.show_viewport))
                modifier.show_viewport = False
                continue
            for shown, rendered in _SHOWN_AND_RENDERED:
                if hasattr(modifier, shown) and hasattr(modifier, rendered):
                    kept.append((modifier, shown, getattr(modifier, shown)))
                    setattr(modifier, shown, getattr(modifier, rendered))
        yield
    finally:
        for modifier, shown, value in kept:
            setattr(modifier, shown, value)


def _uv_map(obj: Any, mesh: Any, name: str) -> str:
    if not mesh.uv_layers:
        raise InputError(f'"{obj.name}" has no UV map; unwrap it first')
    if not name:
        return next((layer.name for layer in mesh.uv_layers if layer.active_render), mesh.uv_layers[0].name)
    if name not in mesh.uv_layers:
        there = ", ".join(f'"{layer.name}"' for layer in mesh.uv_layers)
        raise InputError(f'"{obj.name}" has no UV map "{name}"; choose {there}')
    return name


def _read(elements: Any, attribute: str, width: int, kind: type = np.float32) -> NDArray[Any]:
    values: NDArray[Any] = np.empty(len(elements) * width, kind)
    elements.foreach_get(attribute, values)
    return values.reshape(-1, width)


def _tangents(mesh: Any) -> NDArray[np.float32]:
    """(loops, 4): tangent and bitangent sign, once ``calc_tangents`` has run."""
    return np.hstack([_read(mesh.loops, "tangent", 3), _read(mesh.loops, "bitangent_sign", 1)])


def _tangents_of_triangles(
    vertices: NDArray[Any], triangles: NDArray[Any], normals: NDArray[Any], uvs: NDArray[Any]
) -> NDArray[np.float32]:
    """(T, 3, 4): Blender has no tangents for faces with five sides and more, so they come from a triangulated copy."""
    mesh = bpy.data.meshes.new("MPS Triangles")
    try:
        mesh.from_pydata(vertices.tolist(), [], triangles.tolist())
        layer = mesh.uv_layers.new(name="UVMap")
        layer.uv.foreach_set("vector", uvs.ravel())
        mesh.normals_split_custom_set(normals.reshape(-1, 3).tolist())
        mesh.calc_tangents(uvmap="UVMap")
        return _tangents(mesh).reshape(-1, 3, 4)
    finally:
        bpy.data.meshes.remove(mesh)


def own_materials(target: Any) -> list[Any]:
    """The target's materials, made where there are none, and copied where other meshes wear them too."""
    if not target.material_slots:
        target.data.materials.append(None)
    for slot in target.material_slots:
        if slot.material is None:
            slot.material = bpy.data.materials.new(f"MPS {target.name}")
        elif slot.material.library or any(
            other.data != target.data and slot.material in [worn.material for worn in other.material_slots]
            for other in bpy.data.objects
        ):
            slot.material = slot.material.copy()
        if bpy.app.version < (5, 0):
            slot.material.use_nodes = True
    return list(dict.fromkeys(slot.material for slot in target.material_slots))


def wear_texture(
    target: Any, image: Any, uv_map: str, space: str, convention: str, frames: range = range(0)
) -> list[str]:
    """Give all materials of an object the texture; gives a sentence for each node whose place it took.

    frames: of the timeline, where the texture is an image sequence whose files have their numbers.
    """
    sentences = []
    # Whoever reads the texture later needs to know, whatever the panel says by then.
    remember(image, "space", space)
    remember(image, "convention", convention)
    for material in own_materials(target):
        for name in wear(material, image, uv_map, space, convention):
            sentences.append(f'The texture took the place of "{name}" in material "{material.name}"')
        if frames:
            shown = material.node_tree.nodes[TEXTURE_NODE].image_user
            shown.frame_start, shown.frame_offset, shown.frame_duration = frames[0], frames[0] - 1, len(frames)
            shown.use_auto_refresh = True
    return sentences


def wear(material: Any, image: Any, uv_map: str, space: str, convention: str) -> list[str]:
    """Give every shader of a material the texture as its normal; nodes of an earlier bake are used again.

    Gives the names of the nodes that were the shaders' normals until now, an earlier bake's apart.

    Raises InputError where no shader of the material takes a normal.
    """
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shaders = [node for node in nodes if node.type.startswith("BSDF") and "Normal" in node.inputs]
    if not shaders:
        raise InputError(f'material "{material.name}" has no shader with a Normal input; add a Principled BSDF to it')
    left, top = min(node.location.x for node in shaders), min(node.location.y for node in shaders) - 300

    def node(name: str, kind: str, steps: int) -> Any:
        found = nodes.get(name)
        if found is None:
            found = nodes.new(kind)
            found.name = found.label = name
            found.location = (left - 200 * steps, top)
        return found

    uv, texture = node(UV_NODE, "ShaderNodeUVMap", 5), node(TEXTURE_NODE, "ShaderNodeTexImage", 4)
    normal = node(NORMAL_NODE, "ShaderNodeNormalMap", 1)
    uv.uv_map = normal.uv_map = uv_map
    texture.image, normal.space = image, space
    links.new(uv.outputs["UV"], texture.inputs["Vector"])
    colour = texture.outputs["Color"]
    if convention == "DIRECTX":
        # Blender 4.5's Normal Map node knows OpenGL only; a node that turns green round works in every version.
        turn = node("MPS Green", "ShaderNodeVectorMath", 2)
        turn.operation = "MULTIPLY_ADD"
        turn.inputs[1].default_value, turn.inputs[2].default_value = (1, -1, 1), (0, 1, 0)
        links.new(colour, turn.inputs[0])
        colour = turn.outputs["Vector"]
    elif "MPS Green" in nodes:
        nodes.remove(nodes["MPS Green"])
    links.new(colour, normal.inputs["Color"])
    before = [link.from_node for shader in shaders for link in shader.inputs["Normal"].links]
    for shader in shaders:
        links.new(normal.outputs["Normal"], shader.inputs["Normal"])
    return list(dict.fromkeys(other.name for other in before if other != normal))


def register() -> None:
    bpy.utils.register_class(MPS_OT_bake)


def unregister() -> None:
    bpy.utils.unregister_class(MPS_OT_bake)
