"""Heights over the photo: as a file, as a mesh at its place before the camera, and as images."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from mpsnet_core.errors import FileError, InputError
from mpsnet_core.relief.height_names import height_names
from mpsnet_core.relief.operations import Integrate
from mpsnet_core.scene.camera import read_camera

from ..image_records import remembered
from ..images import image_file, load_image
from ..operators.core_run import RunsCore
from ..outputs import output_path, overruled_format
from ..photo.align import mesh_of_photo
from ..photo.options import seen_through
from ..rig.several_rigs import result_name
from ..scene.objects import select
from ..scene.surfaces import middle_of
from ..settings.declared import options_of, round_as_typed
from ..settings.heights import HeightsSettings

PICTURES = {"curvature": "Curvature", "occlusion": "Ambient Occlusion", "relit": "Relit"}


class MPS_OT_integrate(RunsCore, HeightsSettings, bpy.types.Operator):
    """Make heights of the estimated normals: a file, a mesh where the camera saw the object, pictures of its shape"""

    bl_label = "Make Height"
    requires, step = "estimate", "heights"

    def prepare(self, context: Any, folder: Path) -> tuple[Integrate, Sequence[Path]]:
        scene = context.scene
        image = scene.mps.estimate.image
        if image.source == "SEQUENCE":
            raise InputError("the normals are a sequence, and heights are made of one photo's; estimate one photo")
        normals = image_file(image, "normal map", "estimate the normals first")
        self._output = output_path(self.output, result_name(scene, "height"), self.file_format)
        self._notes = overruled_format(self._output, scene.mps.heights)
        self._pictures = {
            what: self._output.with_name(f"{self._output.stem}_{what}.png") for what in PICTURES if getattr(self, what)
        }
        self._mesh = self._output.with_suffix(".ply") if self.mesh else None
        made: dict[str, Any] = {what: str(picture) for what, picture in self._pictures.items()}
        if self._mesh is not None:
            made["mesh"] = str(self._mesh)
        unused = ("distance",) if self._mesh else ("distance", "faces")
        operation = Integrate(
            normals=str(normals),
            height=str(self._output),
            **options_of(Integrate, self, without=unused),
            **self._viewpoint(context, image, folder),
            **made,
        )
        outputs = [self._output, *self._pictures.values(), *([self._mesh] if self._mesh else [])]
        # Heights have a scale file. Without one, the existing files do not belong to earlier heights.
        foreign = [file for file in outputs[1:] if file.exists()]
        if foreign and not height_names(self._output)[1].exists():
            raise FileError(
                f"{foreign[0]} is there already and was not made with {self._output.name}; move it, or give the "
                "heights another name"
            )
        return operation, outputs

    def _viewpoint(self, context: Any, image: Any, folder: Path) -> dict[str, Any]:
        """The core's options for the photo's camera, and its distance to the object."""
        scene = context.scene
        lens = scene.mps.estimate.lens
        with suppress(ValueError):
            lens = float(remembered(image, "lens") or lens)
        seen = seen_through(scene, image, lens, folder)
        if self.distance:
            return {**seen, "distance": round_as_typed(self.distance)}
        target = mesh_of_photo(context)
        if "camera" in seen and target is not None:
            depth = float(read_camera(seen["camera"]).depth_row() @ np.array([*middle_of(target), 1]))
            if depth > 0:
                seen["distance"] = depth
        return seen

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        result_is = f"its heights are in {self._output}"
        scene, estimate = self.scene(result_is), self.rig(result_is).estimate
        scene.mps.heights.image = self.loaded(self._output, "MPS Height", is_data=True, stretched=True)
        for what, picture in self._pictures.items():
            shown = load_image(picture, f"MPS {PICTURES[what]}", is_data=what != "relit")
            shown.use_fake_user = True  # it has no other user when the file is saved
        if self._mesh is not None:
            estimate.mesh = _import_surface(scene, self._mesh, estimate.mesh)
        self.tell(f"Heights written to {self._output}")


def _import_surface(scene: Any, file: Path, earlier: Any) -> Any:
    """Import the mesh as an object of the scene. It replaces that of an earlier run, and keeps its materials."""
    name = "MPS Surface"
    known, layer = set(bpy.data.objects), bpy.context.view_layer
    selected, active = list(layer.objects.selected), layer.objects.active
    bpy.ops.wm.ply_import(filepath=str(file), forward_axis="Y", up_axis="Z", import_colors="NONE")
    (made,) = set(bpy.data.objects) - known
    made.data.shade_smooth()
    # The importer uses the open scene and changes the selection, which the next step needs.
    for collection in made.users_collection:
        collection.objects.unlink(made)
    scene.collection.objects.link(made)
    select(layer, selected, active)
    if earlier is None or scene.objects.get(earlier.name) != earlier or earlier.type != "MESH":
        made.name = made.data.name = name
        return made
    before, earlier.data = earlier.data, made.data
    for material in before.materials:
        earlier.data.materials.append(material)
    bpy.data.objects.remove(made)
    if not before.users:
        bpy.data.meshes.remove(before)
    earlier.data.name = name
    return earlier
