"""The estimate: the photo becomes a normal map in camera space, in the core's process."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from mpsnet_core.camera import write_camera
from mpsnet_core.errors import InputError
from mpsnet_core.rig import LightRig, read_rig, write_rig

from .bake import named_object, write_mesh
from .operators import RunsCore, idle
from .outputs import image_file, load_image, output_path, remember, remembered
from .preferences import preference
from .properties import MODELS, EstimateSettings, take_given
from .rig import light_rig, rig_camera, scene_camera


class MPS_OT_estimate(RunsCore, EstimateSettings, bpy.types.Operator):
    """Estimate the surface normals that the photo shows"""

    bl_idname = "mps.estimate"
    bl_label = "Estimate Normals"
    bl_options = {"UNDO"}

    surface: StringProperty(
        name="Surface",
        description="Name of the mesh object that tells how far each pixel is from near lights. Empty: the panel's",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def poll(cls, context: Any) -> bool:
        if context.scene.mps.photo.image is None:
            cls.poll_message_set("Render or open a photo first")
            return False
        return idle(cls, context)

    def prepare(self, context: Any, folder: Path) -> tuple[list[str], Sequence[Path]]:
        scene = context.scene
        take_given(self, EstimateSettings, scene.mps.estimate)
        image = scene.mps.photo.image
        photo = image_file(image, "photo", "render or open one first")
        output = output_path(self.output, f"{scene.name}_normals", self.file_format)
        rig = Path(bpy.path.abspath(self.rig_file)) if self.rig_file else folder / "rig.json"
        if not self.rig_file:
            taken_with = remembered(image, "rig")
            if taken_with is None:
                write_rig(rig, light_rig(scene))
            else:
                rig.write_text(taken_with, encoding="utf-8")
        arguments = ["estimate", str(photo), "--rig", str(rig), "--output", str(output)]
        arguments += ["--encoding", self.encoding.lower(), "--model", self._model()]
        arguments += ["--provider", preference("provider").lower(), "--threads", str(preference("threads"))]
        arguments += self._mask()
        arguments += self._place(context, image, read_rig(rig), folder)
        outputs = [output]
        if self.confidence:
            outputs.append(output.with_name(f"{output.stem}_confidence{output.suffix}"))
            arguments += ["--confidence", str(outputs[1])]
        self._scene, self._output, self._camera = scene.name, output, remembered(image, "camera")
        return arguments, outputs

    def _model(self) -> str:
        if self.model != "FILE":
            return MODELS[self.model].name
        if not self.model_file:
            raise InputError("the model is a file but none is named; choose an .onnx file")
        return bpy.path.abspath(self.model_file)

    def _place(self, context: Any, image: Any, rig: LightRig, folder: Path) -> list[str]:
        """The camera that took the photo, and for near lights the mesh that tells how far each pixel is from them."""
        scene = context.scene
        camera, taken_with = folder / "camera.json", remembered(image, "camera")
        if taken_with is not None:
            camera.write_text(taken_with, encoding="utf-8")
        elif scene.mps.rig.lights:
            write_camera(camera, scene_camera(rig_camera(scene), scene, tuple(image.size)))
        elif rig.near is not None:
            raise InputError(
                "the rig's lights stand near the object, so the photo's camera counts; add a rig, whose camera is taken"
            )
        else:
            return []
        settings = scene.mps.estimate
        if self.surface:
            settings.surface = named_object(scene, self.surface)
        if rig.near is None or settings.surface is None:
            return ["--camera", str(camera)]
        context.view_layer.update()
        write_mesh(folder / "surface.npz", settings.surface, context.evaluated_depsgraph_get(), None)
        return ["--camera", str(camera), "--mesh", str(folder / "surface.npz")]

    def _mask(self) -> list[str]:
        if self.mask == "AUTO":
            return []
        if self.mask == "THRESHOLD":
            return ["--mask", f"threshold:{self.threshold:g}"]
        if self.mask != "FILE":
            return ["--mask", self.mask.lower()]
        if not self.mask_file:
            raise InputError("the mask is a file but none is named; choose a picture")
        return ["--mask", bpy.path.abspath(self.mask_file)]

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        scene = bpy.data.scenes.get(self._scene)
        if scene is None:
            raise InputError(f'the scene "{self._scene}" is gone; its normals are in {self._output}')
        image = load_image(self._output, "MPS Normals", is_data=True)
        # The bake takes the camera as it stood for this photo, not for one that was estimated here before.
        remember(image, "camera", self._camera)
        scene.mps.estimate.image = image
        for note in result.get("notes", []):
            self.report({"INFO"}, note)
        self.report({"INFO"}, f"Normals written to {self._output}")


def register() -> None:
    bpy.utils.register_class(MPS_OT_estimate)


def unregister() -> None:
    bpy.utils.unregister_class(MPS_OT_estimate)
