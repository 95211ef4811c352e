"""What the add-on's operators share: bad input becomes one sentence, and the core runs beside a live window."""

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import bpy

from mpsnet_core.errors import Cancelled, InputError

from .core_process import CoreCrashed, CoreProcess, run

TICK_SECONDS = 0.1


class SaysWhy(bpy.types.Operator):
    """An operator whose :meth:`act` raises InputError on bad input.

    The sentence appears in Blender's window; a script that called the operator gets it as a RuntimeError.
    """

    def act(self, context: Any) -> None:
        raise NotImplementedError

    def execute(self, context: Any) -> set[Any]:
        try:
            self.act(context)
        except (InputError, CoreCrashed) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        except Cancelled:
            self.report({"ERROR"}, "cancelled")
            return {"CANCELLED"}
        return {"FINISHED"}


class RunsCore(SaysWhy):
    """An operator whose work is one run of the core.

    From a button the run is modal: the window stays live, the panel shows progress, Esc or ``mps.cancel`` ends it.
    From a script it returns when the work is done. Between the two calls below anything may happen to the file, so
    they share names and paths, never Blender's data.
    """

    def prepare(self, context: Any, folder: Path) -> tuple[list[str], Sequence[Path]]:
        """Write what the core reads into `folder`; give its arguments and the files it will write."""
        raise NotImplementedError

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        """Take the core's result into Blender."""
        raise NotImplementedError

    def act(self, context: Any) -> None:
        manager = context.window_manager
        with TemporaryDirectory(prefix="mpsnet-") as folder:
            arguments, outputs = self.prepare(context, Path(folder))
            manager.progress_begin(0, 100)
            try:
                result = run(arguments, outputs, lambda done, _: manager.progress_update(int(100 * done)))
            finally:
                manager.progress_end()
        self.finish(context, result)

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if bpy.app.background:
            return self.execute(context)
        self._folder = TemporaryDirectory(prefix="mpsnet-")
        try:
            arguments, outputs = self.prepare(context, Path(self._folder.name))
        except InputError as error:
            self._folder.cleanup()
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._process = CoreProcess(arguments, outputs)
        manager = context.window_manager
        manager.mps.running, manager.mps.cancel = self.bl_idname, False  # MPS_OT_..., as Blender writes it
        self._show(context)
        self._timer = manager.event_timer_add(TICK_SECONDS, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if context.window_manager.mps.cancel or (event.type == "ESC" and event.value == "PRESS"):
            self.cancel(context)
            self.report({"INFO"}, "Cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if self._process.running():
            self._show(context)
            return {"PASS_THROUGH"}
        self._leave(context)
        try:
            self.finish(context, self._process.result())
        except (InputError, CoreCrashed) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        except Cancelled:
            self.report({"INFO"}, "Cancelled")
            return {"CANCELLED"}
        return {"FINISHED"}

    def cancel(self, context: Any) -> None:
        """Also called by Blender, when another file is opened in the middle of the work."""
        self._process.cancel()
        self._leave(context)

    def _leave(self, context: Any) -> None:
        manager = context.window_manager
        manager.event_timer_remove(self._timer)
        manager.mps.running = ""
        self._folder.cleanup()
        _redraw(context)

    def _show(self, context: Any) -> None:
        job = context.window_manager.mps
        if (job.progress, job.message) != (self._process.progress, self._process.message):
            job.progress, job.message = self._process.progress, self._process.message
            _redraw(context)


def _redraw(context: Any) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


class MPS_OT_cancel(bpy.types.Operator):
    """Stop the running estimate or bake; nothing half-written is left"""

    bl_idname = "mps.cancel"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return bool(context.window_manager.mps.running)

    def execute(self, context: Any) -> set[Any]:
        context.window_manager.mps.cancel = True
        return {"FINISHED"}


def idle(cls: Any, context: Any) -> bool:
    """Poll of what runs the core: one at a time."""
    if context.window_manager.mps.running:
        cls.poll_message_set("Wait for the running work, or cancel it")
        return False
    return True


def register() -> None:
    bpy.utils.register_class(MPS_OT_cancel)


def unregister() -> None:
    bpy.utils.unregister_class(MPS_OT_cancel)
