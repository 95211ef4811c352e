"""The light preview: a small photo of the rig's object, updated whenever a light, the camera or the object moves.

A timer compares the scene's state with the one that the preview shows. If they differ, a child process of the core ray
traces the scene. Only one runs at a time, so the next one shows the newest state. Nothing is stored in the .blend file:
the images are icons of the panel, and the files are in a temporary folder.
"""

import json
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import bpy
import bpy.utils.previews
import numpy as np
from bpy.app.handlers import persistent
from numpy.typing import NDArray

from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.io.files import temporary_folder
from mpsnet_core.scene.camera import write_camera
from mpsnet_core.scene.operations import PreviewLights
from mpsnet_core.scene.rig import write_rig

from ..child_process.core_process import CoreCrashed, CoreProcess
from ..errors import system_report
from ..operators.progress import redraw_panels
from ..operators.reporting import ReportingOperator
from ..scene.camera import scene_camera
from ..scene.mesh_file import write_surfaces
from ..scene.objects import by_session_uid, rendered, view_layer
from ..scene.surfaces import SURFACES
from .rig import last_evaluated_rig, light_rig, rig_camera

TICK_SECONDS = 0.3
PIXELS = 256
PICTURES = ("Photo", "Normals")


class MPS_OT_light_preview(ReportingOperator, bpy.types.Operator):
    """Show what the three lights reach while you move them, the camera or the object. Press again to leave it"""

    bl_label = "Light Preview"
    bl_options = {"REGISTER"}

    @classmethod
    def lacks(cls, context: Any) -> str:
        return "" if _open or context.scene.mps.rig.lights else "Add a rig first"

    def act(self, context: Any) -> None:
        if _open:
            end()
            return
        light_rig(context.scene)
        _open.append(LightPreview(context.scene.session_uid))
        if not (bpy.app.background or bpy.app.timers.is_registered(tick)):
            bpy.app.timers.register(tick, first_interval=0)


@dataclass(eq=False)
class LightPreview:
    """A preview that is switched on."""

    scene_uid: int
    """Session UID of the scene that it shows."""
    error: str = ""
    """Why there is no newer image."""
    moved: bool = False
    """Whether a shape changed since the last tick."""
    mesh_of: str = ""
    """The objects in the mesh file with their transforms, as JSON."""
    shown: str = ""
    """The complete state that the last child was started with, as text."""
    process: CoreProcess | None = None
    """The child that is tracing."""
    resources: ExitStack = field(default_factory=ExitStack)
    """Released when it is switched off."""

    def __post_init__(self) -> None:
        self.folder = self.resources.enter_context(temporary_folder())
        self.icons = bpy.utils.previews.new()
        self.resources.callback(bpy.utils.previews.remove, self.icons)

    @property
    def scene(self) -> Any:
        """The scene, None if it was removed or no longer has a rig."""
        scene = by_session_uid(bpy.data.scenes, self.scene_uid)
        return scene if scene is not None and scene.mps.rig.lights else None

    def update(self, scene: Any) -> None:
        """Show the child's result, and start the next one if something moved."""
        if self.process is not None:
            if self.process.running():
                return
            process, self.process = self.process, None
            process.result()
            self._show(np.load(self.folder / "preview.npy"))
            self.error = ""
            redraw_panels(bpy.context.window_manager)
        if scene != bpy.context.scene or scene.mps.way != "RENDER":  # the preview is not visible
            return
        if self.moved:  # wait for the end of a movement: the mesh may be large
            self.moved, self.mesh_of, self.shown = False, "", ""
            return
        try:
            objects, rig = _objects(scene), last_evaluated_rig(scene)
            camera = scene_camera(rig_camera(scene), scene, (scene.mps.photo.width, scene.mps.photo.height))
        except InputError:
            self.shown = ""  # trace again once the error is mended
            raise
        mesh_of = json.dumps([(obj.session_uid, [list(row) for row in obj.matrix_world]) for obj in objects])
        shown = f"{mesh_of} {rig} {camera}"
        if shown == self.shown:
            return
        self.shown = shown  # even if the rest fails: try again after the next change
        files: dict[str, Any] = {name: str(self.folder / file) for name, file in _FILES.items()}
        if mesh_of != self.mesh_of:
            self.mesh_of = ""
            write_surfaces(Path(files["mesh"]), bpy.context.evaluated_depsgraph_get(), objects)
            self.mesh_of = mesh_of
        write_rig(files["rig"], rig)
        write_camera(files["camera"], camera)
        self.process = CoreProcess(PreviewLights(**files, size=PIXELS), [Path(files["output"])])

    def _show(self, picture: NDArray[np.float32]) -> None:
        """Show (H, 2 W, 4), two images side by side, as icons."""
        for name, half in zip(PICTURES, np.split(picture, 2, axis=1), strict=True):
            height, width = half.shape[:2]
            square = np.zeros((PIXELS, PIXELS, 4), np.float32)
            top, left = (PIXELS - height) // 2, (PIXELS - width) // 2
            square[top : top + height, left : left + width] = half
            icon = self.icons.get(name) or self.icons.new(name)
            icon.image_size = PIXELS, PIXELS
            icon.image_pixels_float.foreach_set(np.ascontiguousarray(square[::-1]).ravel())  # the lowest row is first

    def fail(self, sentence: str) -> None:
        if sentence != self.error:
            self.error = sentence
            redraw_panels(bpy.context.window_manager)

    def close(self) -> None:
        if self.process is not None:
            self.process.cancel()
        self.resources.close()
        redraw_panels(bpy.context.window_manager)


_FILES = {"mesh": "mesh.npz", "rig": "rig.json", "camera": "camera.json", "output": "preview.npy"}
_open: list[LightPreview] = []  # the one that is switched on


def light_preview() -> LightPreview | None:
    """The preview, None if it is switched off."""
    return _open[0] if _open else None


def _objects(scene: Any) -> list[Any]:
    """The objects in the photo: without a bake target that is separate from the photographed object."""
    target, surface = scene.mps.bake.target, scene.mps.estimate.surface
    left_out = target if surface not in (None, target) else None
    return [
        obj
        for obj in rendered(view_layer(scene).layer_collection)
        if (obj.type in SURFACES or (obj.type == "EMPTY" and obj.instance_type != "NONE")) and obj != left_out
    ]


def tick() -> float | None:
    """Update the preview, or end it if its scene or rig was removed."""
    for preview in list(_open):
        try:
            if (scene := preview.scene) is None:
                raise Cancelled
            preview.update(scene)
        except (InputError, CoreCrashed) as error:
            preview.fail(str(error))
        except OSError as error:
            preview.fail(system_report(error))
        except Cancelled:
            end()
    return TICK_SECONDS if _open else None


@persistent
def end(*_: Any) -> None:
    """Switch the preview off, and free its resources. The timer ends by itself."""
    while _open:
        _open.pop().close()


@persistent
def _shape_changed(_scene: Any, depsgraph: Any) -> None:
    for preview in _open:
        preview.moved = preview.moved or any(
            update.is_updated_geometry
            and isinstance(update.id, bpy.types.Object)
            and (update.id.type in SURFACES or update.id.type == "EMPTY")
            for update in depsgraph.updates
        )


@persistent
def _undone(*_: Any) -> None:
    for preview in _open:
        preview.moved = True


TIMERS = (tick,)
HANDLERS = {"load_pre": end, "depsgraph_update_post": _shape_changed, "undo_post": _undone, "redo_post": _undone}


def unregister() -> None:
    end()
