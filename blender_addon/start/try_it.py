"""Try It: the four steps on a new scene, without any files, and what they are worth."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import bpy
from bpy.props import IntProperty
from mathutils import Euler, Quaternion, Vector

from mpsnet_core.errors import Cancelled, Note
from mpsnet_core.io.files import ensure_folder

from ..bake.before_after import draw_results
from ..operators.chain import Call, RunsSteps, run_operator
from ..operators.core_run import idle
from ..outputs import file_name, requested_path
from ..scene.objects import by_session_uid
from ..settings.declared import FolderSetting
from .demo import make_demo, remove_demo

# The view from the front, a little to the right and above, at a distance that shows the whole object.
_LOOK = Euler((math.radians(82), 0, math.radians(14))).to_quaternion()
_AWAY = 3.6

# Stored with the demo: the scene that was shown before.
_BEFORE = "mpsnet_before"


class MPS_OT_try_it(RunsSteps, bpy.types.Operator):
    """See all steps in a new scene: an object, its photo under three coloured lights, the normals estimated
    from it, and a low-poly copy before and after. Takes seconds to half a minute and changes nothing of yours"""

    bl_idname = "mps.try_it"
    bl_label = "Try It"
    drawn = staticmethod(draw_results)
    first_message = Note("making an object")

    pixels: IntProperty(
        name="Photo Size", description="Width and height of the demo's photo in pixels", default=400, min=32, max=4096
    )
    samples: IntProperty(
        name="Samples", description="Cycles samples a pixel for each of the three lights", default=6, min=1, max=4096
    )
    size: IntProperty(
        name="Texture Size",
        description="Width and height of the demo's texture in pixels",
        default=1024,
        min=16,
        max=8192,
    )
    output: FolderSetting(
        "Folder", "Folder for the demo's photo, normal map and texture. Empty: only the .blend file keeps them"
    )

    _before = 0  # session UID of the scene that was shown before

    def steps(self) -> Sequence[Callable[[Any], Call | None]]:
        return self._build, self._photograph, self._estimate, self._bake, self._present

    def take_away(self, context: Any) -> None:
        """Remove an unfinished demo, and return to the scene in which Try It was pressed, which shows the error."""
        demo, before = by_session_uid(bpy.data.scenes, self._scene_uid), by_session_uid(bpy.data.scenes, self._before)
        if demo is None or before in (None, demo) or context.scene != demo:
            return  # the user has switched scenes, and may be using its objects
        self._scene_uid = self._before
        context.window.scene = before
        remove_demo(
            demo, [one for one in (by_session_uid(demo.objects, uid) for uid in self._shown) if one is not None]
        )

    def _build(self, context: Any) -> None:
        if self.output:  # report a folder that cannot be created before making a scene
            ensure_folder(requested_path(self.output), "files")
        self._before = context.scene.session_uid
        scene, detailed, low = make_demo()
        self._scene_uid, self._shown = scene.session_uid, {detailed.session_uid: False, low.session_uid: True}
        scene[_BEFORE] = context.scene
        context.window.scene = scene
        scene.mps.photo.width = scene.mps.photo.height = self.pixels
        detailed.select_set(True)
        run_operator(bpy.ops.mps.add_rig)
        scene.mps.bake.target = low
        look_at(context, Vector(), _AWAY, _LOOK)

    def _photograph(self, context: Any) -> Call:
        return "render_photo", {"samples": self.samples, "white": True, "output": self._file(context, "photo.exr")}

    def _estimate(self, context: Any) -> Call:
        return "estimate", {"output": self._file(context, "normals.png")}

    def _bake(self, context: Any) -> Call:
        return "bake", {"size": self.size, "output": self._file(context, "texture.png")}

    def _present(self, context: Any) -> None:
        scene = self._demo(context)
        for uid, shown in self._shown.items():
            obj = by_session_uid(scene.objects, uid)
            if obj is None:
                raise Cancelled
            obj.hide_render = not shown
            obj.hide_set(not shown)
            obj.select_set(shown)
            context.view_layer.objects.active = obj
        if not bpy.app.background:
            run_operator(bpy.ops.mps.relight)
            run_operator(bpy.ops.mps.before_after, "INVOKE_DEFAULT")
        self.tell("The low-poly copy uses the photo's normals. Esc ends Before / After; press Relight to stop the lamp")

    def _demo(self, context: Any) -> Any:
        """The demo's scene, if the window still shows it."""
        if context.scene.session_uid != self._scene_uid:
            raise Cancelled
        return context.scene

    def _file(self, context: Any, name: str) -> str:
        """Images from Blender's temporary folder are packed into the .blend file."""
        folder = ensure_folder(requested_path(self.output), "files") if self.output else Path(bpy.app.tempdir)
        return str(folder / f"{file_name(self._demo(context).name)}_{name}")


def scene_before(scene: Any) -> Any:
    """The scene that was shown before Try It made this one; None for others."""
    before = scene.get(_BEFORE)
    return before if isinstance(before, bpy.types.Scene) else None  # a hostile file may hold anything


class MPS_OT_back_to_scene(bpy.types.Operator):
    """Show the scene again in which Try It was pressed. The demo's scene stays in the file"""

    bl_idname = "mps.back_to_scene"
    bl_label = "Back to My Scene"
    bl_options = {"UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return idle(cls, context) and scene_before(context.scene) is not None and context.window is not None

    def execute(self, context: Any) -> set[Any]:
        before = scene_before(context.scene)
        if context.scene.mps.relight.lamp is not None:
            run_operator(bpy.ops.mps.relight)
        context.window.scene = before
        return {"FINISHED"}


def look_at(context: Any, centre: Vector, away: float, rotation: Quaternion) -> None:
    """Let the window's 3D viewports look at a point from a distance, turned as a camera is."""
    for area in context.window.screen.areas if context.window else ():
        if area.type == "VIEW_3D":
            view = area.spaces.active.region_3d
            view.view_location, view.view_distance, view.view_rotation = centre, away, rotation
            view.view_perspective = "PERSP"
