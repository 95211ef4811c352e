"""What the add-on's operators share: bad input becomes one sentence, and the core runs beside a live window."""

import logging
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import bpy
from bpy.props import StringProperty

from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.io.crash_log import unforeseen
from mpsnet_core.io.files import temporary_folder
from mpsnet_core.progress import Progress

from .child_process.core_process import CORE, CoreCrashed, CoreProcess, Program, Work, run
from .errors import system_report
from .provenance import Provenance, refuse_to_overwrite, store_provenance
from .scene.objects import by_session_uid
from .settings.record import store_record
from .slices import Slices
from .time_left import Pace, in_words

TICK_SECONDS = 0.1
SLICE_SECONDS = 0.03
LOG_SECONDS = 10.0
CANCELLED = "cancelled"
_MISSING = {
    "photo": "Render or open a photo first",
    "estimate": "Estimate the normals first",
    "bake": "Bake the texture first",
}

log = logging.getLogger(__name__)


class ReportingOperator(bpy.types.Operator):
    """An operator whose :meth:`act` raises InputError on bad input, or OSError where the disk fails it.

    The sentence appears in Blender's window and stays in the operator's step of the panel until the next run; a script
    that called the operator gets it as a RuntimeError.
    """

    requires = ""  # the step whose image has to be there first, of those in _MISSING
    _scene_uid = 0
    _rig_place = 0  # of the rig that was chosen, in the scene's list
    _made_from: Provenance

    @classmethod
    def lacks(cls, context: Any) -> str:
        """What has to be there first and is not, as a sentence without a full stop; "" where nothing is missing."""
        return _MISSING[cls.requires] if cls.requires and not getattr(context.scene.mps, cls.requires).image else ""

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        """What a result would be made of now; where that has changed since, the panel says it is out of date."""
        return {}

    @classmethod
    def poll(cls, context: Any) -> bool:
        obstacle = cls.lacks(context)
        if obstacle:
            cls.poll_message_set(obstacle)
        return not obstacle

    def act(self, context: Any) -> None:
        raise NotImplementedError

    def scene(self, result: object) -> Any:
        """The scene that the operator began in, whatever it is called by now, and whichever is open.

        Raises InputError where it was removed. result: what it would have got, and where that is now.
        """
        scene = by_session_uid(bpy.data.scenes, self._scene_uid)
        if scene is None:
            raise InputError(f"the scene that this was made for is gone; {result}")
        return scene

    def made(self, image: bpy.types.Image) -> None:
        """Note with the image that is the result what it was made of; called once it is there."""
        store_provenance(image, verb_of(self.bl_idname), self._made_from)

    def begin(self, context: Any) -> None:
        """Called before anything else; the record of an earlier run goes."""
        self._scene_uid, self._rig_place = context.scene.session_uid, context.scene.mps.chosen_rig
        self._store_record()

    def execute(self, context: Any) -> set[Any]:
        self.begin(context)
        return {"FINISHED"} if self.done(lambda: self.act(context)) else {"CANCELLED"}

    def done(self, step: Callable[[], None]) -> bool:
        """Take a step; where it fails, report why in one sentence and return False."""
        try:
            step()
        except (InputError, CoreCrashed) as error:
            self._failed(str(error))
        except OSError as error:
            self._failed(system_report(error))
        except (Cancelled, KeyboardInterrupt):
            self.report({"ERROR"}, CANCELLED)
        except Exception as error:  # noqa: BLE001
            self._failed(unforeseen(error))
        else:
            return True
        return False

    def _failed(self, sentence: str) -> None:
        self._store_record(error=sentence)
        self.report({"ERROR"}, sentence)

    def _store_record(self, *, error: str = "", notes: list[str] | None = None) -> None:
        scene = by_session_uid(bpy.data.scenes, self._scene_uid)
        if scene is not None:
            store_record(scene, verb_of(self.bl_idname), error=error, notes=notes)


def verb_of(idname: str) -> str:
    """ "estimate" for "mps.estimate" as well as for "MPS_OT_estimate", which is how Blender writes it itself."""
    return idname.removeprefix("MPS_OT_").removeprefix("mps.")


@dataclass(eq=False)
class _Job:
    """Work beside the live window. It outlives Blender's operator, whose data goes when it is removed.

    folder: goes with it. slices: what is to be done here before the child process can start. start: starts it.
    """

    folder: ExitStack
    slices: list[Slices]
    start: Callable[[], CoreProcess]
    timer: Any
    process: CoreProcess | None = None
    pace: Pace = field(default_factory=Pace)

    def go_on(self) -> None:
        """Do what fits between two redraws of the window; after the last slice the process starts."""
        until = time.monotonic() + SLICE_SECONDS
        while self.slices:
            for is_long in self.slices[0]:
                if is_long or time.monotonic() > until:
                    return
            del self.slices[0]
        self.process = self.start()

    def leave(self, manager: Any) -> None:
        """Release what the run holds and end a child that still runs. Once is enough."""
        if self not in _jobs:
            return
        _jobs.remove(self)
        _give_up(self.slices)
        if self.process is not None:
            self.process.cancel()
        manager.event_timer_remove(self.timer)
        manager.mps.running = manager.mps.left = ""
        self.folder.close()
        redraw_panels(manager)


def _give_up(slices: list[Slices]) -> None:
    """Let what was begun take away what it has made."""
    for one in slices:
        one.close()
    slices.clear()


_jobs: list[_Job] = []


class RunsCore(ReportingOperator):
    """An operator whose work is one run of the core.

    From a button the run is modal: the window stays live, the panel shows progress, Esc or ``mps.cancel`` ends it.
    From a script it returns when the work is done. Between the two calls below anything may happen to the file, so
    they share paths and session numbers (:func:`by_session_uid`), never Blender's data or names, which people change.
    """

    bl_options = {"UNDO"}
    _notes: Sequence[str] = ()  # of `prepare`, beside the core's notes
    _slices: list[Slices]

    @classmethod
    def poll(cls, context: Any) -> bool:
        return idle(cls, context) and super().poll(context)

    def begin(self, context: Any) -> None:
        super().begin(context)
        self._slices = []

    def later(self, slices: Slices) -> None:
        """Called by `prepare` with work that takes long; it is done a slice at a time before the core starts."""
        self._slices.append(slices)

    def program(self, folder: Path) -> Program:
        """What does the work that `prepare` returned, beside a live window. folder: that of `prepare`."""
        return CORE

    def prepare(self, context: Any, folder: Path) -> tuple[Work, Sequence[Path]]:
        """Write what the core reads into `folder`; return its operation and the files that this will write.

        Raises InputError, as the operation itself does where its options cannot be.
        """
        raise NotImplementedError

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        """Take the core's result into Blender. Its notes are reported and stored already."""
        raise NotImplementedError

    def remarks(self, result: dict[str, Any]) -> Sequence[str]:
        """What there is to say of the core's result, in sentences; they stay with the step."""
        return ()

    def look(self) -> None:
        """Take what the core has written so far into Blender; called ten times a second beside a live window."""

    def act(self, context: Any) -> None:
        manager = context.window_manager
        with temporary_folder() as folder:
            try:
                work, outputs = self._prepared(context, folder)
                for _ in chain.from_iterable(self._slices):
                    pass
            finally:
                _give_up(self._slices)
            with at_the_pointer(manager) as progress:
                result = run(work, outputs, progress)
        self._finished(context, result)

    def _prepared(self, context: Any, folder: Path) -> tuple[Work, Sequence[Path]]:
        work, outputs = self.prepare(context, folder)
        refuse_to_overwrite(verb_of(self.bl_idname), outputs)
        self._made_from = self.provenance(context)
        return work, outputs

    def _finished(self, context: Any, result: dict[str, Any]) -> None:
        notes = [*self._notes, *result.get("notes", []), *self.remarks(result)]
        for note in notes:
            self.report({"INFO"}, note)
        self.finish(context, result)
        self._store_record(notes=notes)

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if bpy.app.background:
            return self.execute(context)
        self.begin(context)
        return {"RUNNING_MODAL"} if self.done(lambda: self._start(context)) else {"CANCELLED"}

    def _start(self, context: Any) -> None:
        begun = time.monotonic()
        with ExitStack() as held:
            folder = held.enter_context(temporary_folder())
            try:
                work, outputs = self._prepared(context, folder)
            except BaseException:
                _give_up(self._slices)
                raise
            program, manager = self.program(folder), context.window_manager
            timer = manager.event_timer_add(TICK_SECONDS, window=context.window)
            kept = held.pop_all()
        self._job = _Job(kept, self._slices, lambda: CoreProcess(work, outputs, program), timer)
        _jobs.append(self._job)
        manager.mps.running, manager.mps.cancel = self.bl_idname, False  # MPS_OT_..., as Blender writes it
        if time.monotonic() - begun < SLICE_SECONDS:
            self._go_on(context)
        self._show(context)
        manager.modal_handler_add(self)

    def _go_on(self, context: Any) -> None:
        try:
            self._job.go_on()
        except BaseException:
            self._job.leave(context.window_manager)
            raise

    def modal(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if context.window_manager.mps.cancel or (event.type == "ESC" and event.value == "PRESS"):
            self.cancel(context)
            self.report({"INFO"}, "Cancelled")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        process = self._job.process
        if process is None or process.running():
            if process is None and not self.done(lambda: self._go_on(context)):
                return {"CANCELLED"}
            self._show(context)
            self.look()
            return {"PASS_THROUGH"}
        self._job.leave(context.window_manager)
        return {"FINISHED"} if self.done(lambda: self._finished(context, process.result())) else {"CANCELLED"}

    def cancel(self, context: Any) -> None:
        """Also called by Blender, when another file is opened in the middle of the work."""
        self._job.leave(context.window_manager)

    def _show(self, context: Any) -> None:
        shown, process = context.window_manager.mps, self._job.process
        progress, message = (process.progress, process.message) if process else (0.0, "starting")
        left = in_words(self._job.pace.left(time.monotonic(), progress))
        if (shown.progress, shown.message, shown.left) != (progress, message, left):
            shown.progress, shown.message, shown.left = progress, message, left
            redraw_panels(context.window_manager)


@dataclass
class _PointerProgress:
    """Shows a script's progress: at the mouse pointer, and now and then as a line in the log."""

    manager: Any
    logged: float = field(default_factory=time.monotonic)

    def __call__(self, done: float, message: str) -> None:
        self.manager.progress_update(int(100 * done))
        if time.monotonic() - self.logged >= LOG_SECONDS:
            log.info("%.0f%%: %s", 100 * done, message)
            self.logged = time.monotonic()


@contextmanager
def at_the_pointer(manager: Any) -> Iterator[Progress]:
    """Progress for a script's work: at the mouse pointer, and in the log."""
    manager.progress_begin(0, 100)
    try:
        yield _PointerProgress(manager)
    finally:
        manager.progress_end()


def redraw_panels(manager: Any) -> None:
    """Draw the sidebars of all 3D viewports anew, and not the viewports, which may take seconds."""
    for window in manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


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


class MPS_OT_dismiss(bpy.types.Operator):
    """Take this message away; the step may be run again"""

    bl_idname = "mps.dismiss"
    bl_label = "Dismiss Message"
    bl_options = {"INTERNAL", "UNDO"}

    verb: StringProperty(
        name="Operator", description='Whose message to take away: "estimate" for mps.estimate', options={"SKIP_SAVE"}
    )

    def execute(self, context: Any) -> set[Any]:
        store_record(context.scene, self.verb)
        return {"FINISHED"}


def idle(cls: Any, context: Any) -> bool:
    """Poll of what runs the core: one at a time."""
    if context.window_manager.mps.running:
        cls.poll_message_set("Wait for the running work, or cancel it")
        return False
    return True


CLASSES = (MPS_OT_cancel, MPS_OT_dismiss)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister() -> None:
    for job in list(_jobs):
        job.leave(bpy.context.window_manager)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
