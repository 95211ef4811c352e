"""Flat materials: a photo of cloth or leather becomes a seamless Blender material on a plane of true size."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import FileError, InputError, Note, SettingsError
from mpsnet_core.io.files import creatable_folder
from mpsnet_core.relief.operations import MakeMaterial
from mpsnet_core.scene.camera import read_camera

from .appearance.modifiers import FACES, remove_modifier, subdivide
from .appearance.nodes import ensure_node, new_material
from .appearance.shader_graph import output_of, shaders_of
from .image_records import Provenance, chosen, origin, remember, remembered
from .images import image_file, load_image, picture_size
from .operators.core_run import RunsCore
from .outputs import requested_path
from .photo.options import network, reading_without_mask, rig_and_camera_options
from .photo.studio import FLAT_PLANE
from .preferences import output_folder
from .scene.surfaces import SURFACES, box_of
from .settings.declared import options_of
from .settings.estimate import MaterialSettings

# Whether each texture is non-colour data.
_IS_DATA = {"albedo": False, "normal": True, "height": True}
# Levels of the modifier that subdivides the displaced plane: 2 ** level faces on a side.
_SHOWN_LEVELS, _RENDERED_LEVELS = 6, 9
# Stored with a material that this step made: its normals, which identify it when they are updated.
_MADE_OF = "mpsnet_flat_normals"
# Stored with the normals: the file of their photo.
_PHOTO = "flat_photo"


class MPS_OT_make_material(RunsCore, MaterialSettings, bpy.types.Operator):
    """Make a seamless material of the photo, which shows cloth, leather or bark that lies flat and fills it.

    Writes normals, height, curvature and albedo, and shows the material on a plane of its true size"""

    bl_label = "Make Flat Material"
    requires, step = "photo", "material"

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        read = chosen(context.scene.mps.estimate, only=("encoding", "dark", "flat", "rig_file", "lens"))
        return {**super().provenance(context), **read}

    def prepare(self, context: Any, folder: Path) -> tuple[MakeMaterial, Sequence[Path]]:
        scene = context.scene
        image = scene.mps.photo.image
        if image.source in {"SEQUENCE", "MOVIE"}:
            raise InputError("a flat material is made of one photo, and this is a sequence; open one of its frames")
        photo = image_file(image, "photo", "render or open one first")
        output = requested_path(self.output) if self.output else output_folder() / f"{photo.stem}_material"
        creatable_folder(output, "material")
        self._photo = str(photo)
        _check_own(output, self._photo)
        width, height = picture_size(image)
        across, down = width - self.crop_left - self.crop_right, height - self.crop_top - self.crop_bottom
        if min(across, down) < 1:
            raise SettingsError(f"the crop leaves nothing of the photo's {width} x {height} pixels; leave out less")
        lit = rig_and_camera_options(context, image, folder, self.write_mesh)
        if lit["rig"] is None:
            raise SettingsError("nothing says where this photo's lights are; choose their rig file, or find them")
        cropped = (across, down) != (width, height)
        self._output = output
        operation = MakeMaterial(
            image=str(photo),
            **lit,
            **reading_without_mask(scene.mps.estimate),
            **network(self),
            **options_of(MakeMaterial, self, without=("model",)),
            width=f"{self._width(scene, image, folder):.9g}m",
            crop=f"{self.crop_left},{self.crop_top},{across},{down}" if cropped else None,
            output=str(output),
        )
        return operation, [output / "pictures"]

    def _width(self, scene: Any, image: Any, folder: Path) -> float:
        """The width that the photo covers, in metres."""
        width = self.width
        taken_with = remembered(image, "camera")
        self._notes = [] if width else [Note("no width is given; the material's size follows from the photo's camera")]
        if not width and taken_with is not None:
            (folder / "taken.json").write_text(taken_with, encoding="utf-8")
            camera = read_camera(folder / "taken.json")
            width = camera.width / float(camera.focal[0]) if camera.projection == "orthographic" else 0.0
        if not width:
            raise SettingsError("the material's size is not known; enter what the photo's width measures")
        return float(width * scene.unit_settings.scale_length)

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        scene = self.scene(f"its material is in {self._output}")
        settings = scene.mps.material
        files = {what: Path(file) for what, file in result["files"].items()}
        name = files["material"].stem.removesuffix("_material")
        made = json.loads(files["material"].read_text(encoding="utf-8"))
        images = {what: load_image(files[what], f"{name} {what}", is_data=data) for what, data in _IS_DATA.items()}
        millimetre = 0.001 / scene.unit_settings.scale_length
        size = made["width_mm"] * millimetre, made["height_mm"] * millimetre
        remember(images["normal"], _PHOTO, self._photo)
        material = _material_of(images["normal"], f"MPS {name}")
        plane = settings.plane
        if plane is None or scene not in plane.users_scene or not _is_unedited_plane(plane.data, material):
            settings.plane = plane = _new_plane(scene, material, (self.repeats * size[0], self.repeats * size[1]))
        _make_plane(plane.data, size, self.repeats)
        black, white = made["height_of_black_mm"] * millimetre, made["height_of_white_mm"] * millimetre
        assign_pictures(material, images, black, white, self.relief)
        if self.relief != "DISPLACEMENT":
            remove_modifier(plane, FACES)
        elif FACES not in plane.modifiers:  # otherwise the user may have reduced the levels
            subdivide(plane, "SIMPLE", _SHOWN_LEVELS, _RENDERED_LEVELS, FACES)
        settings.image = self.loaded(files["preview"], f"{name} preview", is_data=False)
        words = "%.4g x %.4g mm, %.3g mm deep. Seam %.2f, where 1 is none"
        settings.summary = Note(words, made["width_mm"], made["height_mm"], result["relief_mm"], result["seam"])
        self.tell(f"Material written to {self._output}: {settings.summary}")


def _check_own(folder: Path, photo: str) -> None:
    """Raise FileError if a folder contains the material of another photo with the same name."""
    for image in bpy.data.images:
        if image.users and folder in origin(image).parents and remembered(image, _PHOTO) not in (None, photo):
            raise FileError(f"{folder} holds the material of another photo; name another folder")


def _is_unedited_plane(mesh: Any, material: Any) -> bool:
    """Whether a mesh is as :func:`_make_plane` made it, for this material alone, and was not edited since."""
    return (
        list(mesh.materials) == [material] and mesh.users == 1 and len(mesh.vertices) == 4 and len(mesh.polygons) == 1
    )


def _material_of(normals: Any, name: str) -> Any:
    """The material that this step made from these normals, or a new one. All others are the user's."""
    for material in bpy.data.materials:
        if material.get(_MADE_OF) == normals and not material.library:
            return material
    material = new_material(name)
    material.node_tree.nodes.clear()
    material[_MADE_OF] = normals
    return material


def _new_plane(scene: Any, material: Any, size: tuple[float, float]) -> Any:
    """A plane at the 3D cursor, or to the right of what is there. size: its width and height."""
    plane = bpy.data.objects.new(material.name, bpy.data.meshes.new(material.name))
    plane[FLAT_PLANE] = True
    plane.location = scene.cursor.location
    boxes = [box_of(other) for other in scene.objects if other.type in SURFACES and not other.hide_get()]
    half = np.array([*size, 0]) / 2

    def in_the_way(box: NDArray[np.float64]) -> bool:
        low, high = np.array(plane.location) - half, np.array(plane.location) + half
        return bool((low < box[1] - 1e-6).all() and (high > box[0] + 1e-6).all()) or bool(
            np.allclose(box.mean(axis=0), plane.location, atol=1e-6)
        )

    while (box := next(filter(in_the_way, boxes), None)) is not None:
        plane.location.x = box[1, 0] + 0.05 * (box[1, 0] - box[0, 0]) + 0.55 * size[0]
    plane.data.materials.append(material)
    scene.collection.objects.link(plane)
    return plane


def _make_plane(mesh: Any, size: tuple[float, float], repeats: int) -> None:
    """Make a mesh a rectangle of `repeats` tiles each way, with one tile per UV unit."""
    across, down = (repeats * length / 2 for length in size)
    mesh.clear_geometry()
    mesh.from_pydata([(-across, -down, 0), (across, -down, 0), (across, down, 0), (-across, down, 0)], [], [range(4)])
    layer = mesh.uv_layers.new(name="UVMap")
    layer.uv.foreach_set("vector", [0, 0, repeats, 0, repeats, repeats, 0, repeats])
    # With flat shading, Cycles would add the bump to the displacement.
    mesh.polygons.foreach_set("use_smooth", [True])
    mesh.update()


def assign_pictures(material: Any, images: dict[str, Any], black: float, white: float, relief: str) -> None:
    """Assign the textures "albedo", "normal" and "height" to a material that this step made. Other nodes are kept.

    black, white: heights of the height texture, in scene units. relief: "NORMAL" or "DISPLACEMENT".
    """
    links = material.node_tree.links

    def node(kind: str, name: str, x: float, y: float) -> Any:
        return ensure_node(material.node_tree, name, x, y, kind)

    output = output_of(material) or node("ShaderNodeOutputMaterial", "Material Output", 400, 0)
    shader = node("ShaderNodeBsdfPrincipled", "Principled BSDF", 0, 0)
    if all(shown.node != shader for shown in shaders_of(material)):  # else it may be mixed with another
        links.new(shader.outputs["BSDF"], output.inputs["Surface"])
    uv = node("ShaderNodeUVMap", "MPS Flat UV", -1000, 0)
    uv.uv_map = "UVMap"
    pictures = {}
    for row, (what, image) in enumerate(images.items()):
        pictures[what] = texture = node("ShaderNodeTexImage", f"MPS Flat {what.title()}", -700, -320 * row)
        texture.image = image
        texture.interpolation = "Cubic" if what == "height" else "Linear"
        links.new(uv.outputs["UV"], texture.inputs["Vector"])
    links.new(pictures["albedo"].outputs["Color"], shader.inputs["Base Color"])
    normal = node("ShaderNodeNormalMap", "MPS Flat Normal Map", -300, -320)
    normal.uv_map = "UVMap"
    links.new(pictures["normal"].outputs["Color"], normal.inputs["Color"])
    displacement = node("ShaderNodeDisplacement", "MPS Flat Displacement", 0, -640)
    displacement.inputs["Scale"].default_value = white - black
    displacement.inputs["Midlevel"].default_value = -black / (white - black) if white > black else 0.5
    links.new(pictures["height"].outputs["Color"], displacement.inputs["Height"])
    # Only one of them: both would show the relief twice.
    for shown, end in (
        (normal.outputs["Normal"], shader.inputs["Normal"]),
        (displacement.outputs["Displacement"], output.inputs["Displacement"]),
    ):
        if (shown.node == normal) == (relief == "NORMAL"):
            links.new(shown, end)
        else:
            for link in end.links:
                links.remove(link)
    material.displacement_method = "BUMP" if relief == "NORMAL" else "BOTH"
