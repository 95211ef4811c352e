"""What the add-on's operators share: bad input becomes one sentence, and the core runs beside a live window."""

import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import bpy

from mpsnet_core.errors import Cancelled, InputError

from .core_process import CoreCrashed, CoreProcess, run

TICK_SECONDS = 0.1
TELL_SECONDS = 10.0
CANCELLED = "cancelled"

log = logging.getLogger(__name__)


class SaysWhy(bpy.types.Operator):
    """An operator whose :meth:`act` raises InputError on bad input, or OSError where the disk fails it.

    The sentence appears in Blender's window; a script that called the operator gets it as a RuntimeError.
    """

    def act(self, context: Any) -> None:
        raise NotImplementedError

    def execute(self, context: Any) -> set[Any]:
        return {"FINISHED"} if self.done(lambda: self.act(context)) else {"CANCELLED"}

    def done(self, step: Callable[[], None]) -> bool:
        """Take a step. Where it fails, report why in one sentence and give False."""
        try:
            step()
        except (InputError, CoreCrashed) as error:
            self.report({"ERROR"}, str(error))
        except OSError as error:
            self.report({"ERROR"}, _sentence(error))
        except (Cancelled, KeyboardInterrupt):
            self.report({"ERROR"}, CANCELLED)
        else:
            return True
        return False


def _sentence(error: OSError) -> str:
    where = f"{error.filename}: " if error.filename else "a file could not be read or written: "
    return f"{where}{error.strerror or error}; make room on the disk or check the permissions"


@dataclass(eq=False)
class _Job:
    """A run of the core beside the live window. It outlives Blender's operator, whose data goes when it is removed."""

    process: CoreProcess
    folder: "TemporaryDirectory[str]"
    timer: Any

    def leave(self, manager: Any) -> None:
        """Give back what the run held; a child that still runs is ended. Once is enough."""
        if self not in _jobs:
            return
        _jobs.remove(self)
        self.process.cancel()
        manager.event_timer_remove(self.timer)
        manager.mps.running = ""
        self.folder.cleanup()
        _redraw(manager)


_jobs: list[_Job] = []


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

    def look(self) -> None:
        """Take what the core has written so far into Blender; asked ten times a second beside a live window."""

    def act(self, context: Any) -> None:
        manager = context.window_manager
        with TemporaryDirectory(prefix="mpsnet-") as folder:
            arguments, outputs = self.prepare(context, Path(folder))
            manager.progress_begin(0, 100)
            try:
                result = run(arguments, outputs, _Teller(manager))
            finally:
                manager.progress_end()
        self.finish(context, result)

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if bpy.app.background:
            return self.execute(context)
        return {"RUNNING_MODAL"} if self.done(lambda: self._begin(context)) else {"CANCELLED"}

    def _begin(self, context: Any) -> None:
        folder = TemporaryDirectory(prefix="mpsnet-")
        try:
            arguments, outputs = self.prepare(context, Path(folder.name))
            process = CoreProcess(arguments, outputs)
        except BaseException:
            folder.cleanup()
            raise
        manager = context.window_manager
        self._job = _Job(process, folder, manager.event_timer_add(TICK_SECONDS, window=context.window))
        _jobs.append(self._job)
        manager.mps.running, manager.mps.cancel = self.bl_idname, False  # MPS_OT_..., as Blender writes it
        self._show(context)
        manager.modal_handler_add(self)

    def modal(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if context.window_manager.mps.cancel or (event.type == "ESC" and event.value == "PRESS"):
            self.cancel(context)
            self.report({"INFO"}, "Cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        process = self._job.process
        if process.running():
            self._show(context)
            self.look()
            return {"PASS_THROUGH"}
        self._job.leave(context.window_manager)
        return {"FINISHED"} if self.done(lambda: self.finish(context, process.result())) else {"CANCELLED"}

    def cancel(self, context: Any) -> None:
        """Also called by Blender, when another file is opened in the middle of the work."""
        self._job.leave(context.window_manager)

    def _show(self, context: Any) -> None:
        shown, process = context.window_manager.mps, self._job.process
        if (shown.progress, shown.message) != (process.progress, process.message):
            shown.progress, shown.message = process.progress, process.message
            _redraw(context.window_manager)


@dataclass
class _Teller:
    """Tells a script's progress: at the mouse pointer, and now and then as a line in the log."""

    manager: Any
    told: float = field(default_factory=time.monotonic)

    def __call__(self, done: float, message: str) -> None:
        self.manager.progress_update(int(100 * done))
        if time.monotonic() - self.told >= TELL_SECONDS:
            log.info("%.0f%%: %s", 100 * done, message)
            self.told = time.monotonic()


def _redraw(manager: Any) -> None:
    for window in manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


class MPS_OT_cancel(bpy.types.Operator):
    """Stop what is running; nothing half-written is left"""

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
    for job in list(_jobs):
        job.leave(bpy.context.window_manager)
    bpy.utils.unregister_class(MPS_OT_cancel)
