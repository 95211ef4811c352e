"""Operators that run the core: modal from a button, blocking from a script."""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix

from mpsnet_core.errors import FileError, Note
from mpsnet_core.io.files import resolved, temporary_folder

from ..child_process.core_process import CORE, CoreProcess, Program, Work, run
from ..image_records import refuse_to_overwrite
from ..outputs import is_permanent
from ..scene.mesh_file import BegunMesh, Slices, begin_mesh
from ..settings.declared import apply_given_settings
from ..settings.messages import in_blender
from .progress import Pace, cursor_progress, redraw_panels, time_left_text
from .reporting import ReportingOperator, verb_of

TICK_SECONDS = 0.1
SLICE_SECONDS = 0.03

# Returns the context in which an operator prepares and finishes one of its runs.
RunContext = Callable[[], AbstractContextManager[None]]


@dataclass(frozen=True, eq=False)
class _Run:
    """A prepared run of a child process."""

    slices: list[Slices]
    """Work in this process before the child can start."""
    start: Callable[[], CoreProcess]
    """Starts the child."""
    run_context: RunContext = nullcontext
    """In which it was prepared and is finished."""
    known: dict[str, Any] = field(default_factory=dict)
    """The operator's attributes."""


@dataclass(eq=False)
class _Job:
    """Work in the background. It outlives Blender's operator, whose data is lost when it is removed."""

    resources: ExitStack
    """Released at its end."""
    runs: list[_Run]
    """The remaining ones, of which the first is active."""
    finished: int = 0
    """Number of those before."""
    process: CoreProcess | None = None
    """The active run's child, once it has started."""
    pace: Pace = field(default_factory=Pace)
    """For the time left."""

    def advance(self) -> None:
        """Do as many slices as fit between two redraws of the window. After the last slice, start the process."""
        run, until = self.runs[0], time.monotonic() + SLICE_SECONDS
        while run.slices:
            for is_long in run.slices[0]:
                if is_long or time.monotonic() > until:
                    return
            del run.slices[0]
        self.process = run.start()

    def leave(self, manager: Any) -> None:
        """Release the run's resources, and end a running child. Further calls do nothing."""
        if self not in _jobs:
            return
        _jobs.remove(self)
        if self.process is not None:
            self.process.cancel()
        manager.mps.running = manager.mps.left = ""
        self.resources.close()
        redraw_panels(manager)


_jobs: list[_Job] = []


class RunsCore(ReportingOperator):
    """An operator whose work is a run of the core, or several one after the other, see :meth:`run_contexts`.

    From a button the run is modal: the window stays responsive, the panel shows progress, and Esc or ``mps.cancel``
    ends it. From a script it returns when the work is done. Between :meth:`prepare` and :meth:`finish`, anything may
    happen to the file. So they share paths and session UIDs (:func:`by_session_uid`), never Blender's data or names,
    which users change.
    """

    _notes: Sequence[Note] = ()  # of `prepare`, in addition to the core's
    _omitted_notes: Sequence[str] = ()  # redundant notes of the core
    _slices: list[Slices]
    _outputs: set[Path]

    @classmethod
    def poll(cls, context: Any) -> bool:
        return idle(cls, context) and super().poll(context)

    def begin(self, context: Any) -> None:
        super().begin(context)
        self._slices, self._outputs = [], set()

    def run_contexts(self) -> Sequence[RunContext]:
        """For each run of the core, the context in which it is prepared and finished.

        All are prepared before the first one starts, from the scene as it is then. Each is finished as soon as it ends;
        its result is kept even if later ones fail.
        """
        return [nullcontext]

    def schedule(self, slices: Slices) -> None:
        """Called by `prepare` to schedule long work, which is done slice by slice before the core starts."""
        self._slices.append(slices)

    def write_mesh(
        self, context: Any, path: Path, obj: Any, uv_map: str | None = None, turn: Matrix | None = None
    ) -> BegunMesh:
        """Called by `prepare` to write an object's mesh file before the core starts: see :func:`.begin_mesh`."""
        context.view_layer.update()
        begun = begin_mesh(path, obj, context.evaluated_depsgraph_get(), uv_map, turn)
        self.schedule(begun.slices)
        return begun

    def take_settings(self, context: Any) -> None:
        """Take the settings of the operator's step from the scene, and store there what was given."""
        if self.step:
            apply_given_settings(self, getattr(context.scene.mps, self.step))

    def program(self, folder: Path) -> Program:
        """The program that does the work that `prepare` returned, in the background. folder: that of `prepare`."""
        return CORE

    def prepare(self, context: Any, folder: Path) -> tuple[Work, Sequence[Path]]:
        """Write the core's inputs into `folder`. Returns its operation, and the files that this will write.

        Raises InputError, also from the operation itself if its options are invalid.
        """
        raise NotImplementedError

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        """Load the core's result into Blender. Its notes are reported and stored already."""
        raise NotImplementedError

    def remarks(self, result: dict[str, Any]) -> Sequence[Note]:
        """Remarks on the core's result, as sentences that stay with the step."""
        return ()

    def refresh_results(self) -> None:
        """Show what the core has written so far; called ten times a second during a modal run."""

    def act(self, context: Any) -> None:
        for run_context in self.run_contexts():
            with run_context():
                self.run_here(context)

    def run_here(self, context: Any) -> None:
        """Prepare a run, wait for it and finish it."""
        manager = context.window_manager
        with ExitStack() as resources:
            folder = resources.enter_context(temporary_folder())
            resources.callback(_close, self._slices)
            work, outputs = self._prepared(context, folder)
            for _ in chain.from_iterable(self._slices):
                pass
            with cursor_progress(manager) as progress:
                result = run(work, outputs, progress)
        self._finished(context, result)

    def _prepared(self, context: Any, folder: Path) -> tuple[Work, Sequence[Path]]:
        self.take_settings(context)
        work, outputs = self.prepare(context, folder)
        self.check_outputs(outputs)
        self._made_from = self.provenance(context)
        return work, outputs

    def check_outputs(self, outputs: Sequence[Path]) -> None:
        """Raise InputError if an output would overwrite an input, or the output of another run of this operator."""
        refuse_to_overwrite(verb_of(self.bl_idname), outputs)
        meant = {resolved(path) for path in outputs}
        for path in self._outputs.intersection(meant):
            raise FileError(f"another rig's result is {path}, too; leave the output empty, and each gets its own")
        self._outputs.update(meant)

    def _finished(self, context: Any, result: dict[str, Any]) -> None:
        self._stored: list[Note] = []
        told = [note for note in map(Note.from_facts, result.get("told", ())) if note not in self._omitted_notes]
        failed = [Note(sentence, level="look") for sentence in result.get("failed", ())]
        for note in [*self._notes, *told, *failed, *self.remarks(result)]:
            self.note(note)
        self.finish(context, result)
        facts = {name: value for name, value in result.items() if name not in {"text", "notes", "told", "failed"}}
        facts["written"] = [file for file in result.get("written", []) if is_permanent(Path(file))]
        self._store_record(notes=self._stored, result=facts)

    def note(self, note: Note) -> None:
        """Report a note that stays with the step; called by `finish`."""
        self.tell(note, "INFO" if note.level == "good" else "WARNING")
        self._stored.append(note)

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        return self.start_modal(context, self._start)

    def _start(self, context: Any) -> None:
        begun = time.monotonic()
        manager = context.window_manager
        with ExitStack() as resources:
            runs = [self._run(context, run_context, resources) for run_context in self.run_contexts()]
            resources.callback(manager.event_timer_remove, manager.event_timer_add(TICK_SECONDS, window=context.window))
            self._job = _Job(resources.pop_all(), runs)
        self.__dict__.update(runs[0].known)
        _jobs.append(self._job)
        manager.mps.running, manager.mps.cancel = self.bl_idname, False  # MPS_OT_..., as Blender writes it
        if time.monotonic() - begun < SLICE_SECONDS:
            self._go_on(context)
        self._show(context)
        manager.modal_handler_add(self)

    def _run(self, context: Any, run_context: RunContext, resources: ExitStack) -> _Run:
        folder, self._slices = resources.enter_context(temporary_folder()), []
        resources.callback(_close, self._slices)
        with run_context():
            work, outputs = self._prepared(context, folder)
        program = self.program(folder)
        return _Run(self._slices, lambda: CoreProcess(work, outputs, program), run_context, {**self.__dict__})

    def _go_on(self, context: Any) -> None:
        try:
            self._job.advance()
        except BaseException:
            self._job.leave(context.window_manager)
            raise

    def modal(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if context.window_manager.mps.cancel or (event.type == "ESC" and event.value == "PRESS"):
            self.cancel(context)
            self.tell("Cancelled")
            return self._ended() | {"PASS_THROUGH"}  # Esc ends what began it, too, as the picking of points
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        job, process = self._job, self._job.process
        if process is None or process.running():
            if process is None and not self.done(lambda: self._go_on(context)):
                return self._ended()
            self._show(context)
            self.refresh_results()
            return {"PASS_THROUGH"}
        run = job.runs.pop(0)
        if not job.runs:
            job.leave(context.window_manager)
        if self.done(lambda: self._end_run(context, run, process)):
            job.finished, job.process = job.finished + 1, None
            if job.runs:
                self.__dict__.update(job.runs[0].known)
                return {"PASS_THROUGH"}
        job.leave(context.window_manager)
        return self._ended()

    def _end_run(self, context: Any, run: _Run, process: CoreProcess) -> None:
        with run.run_context():
            self._finished(context, process.result())

    def _ended(self) -> set[Any]:
        """The operator's return value. Undo reverts finished runs even if others failed or were cancelled."""
        return {"FINISHED"} if self._job.finished else {"CANCELLED"}

    def cancel(self, context: Any) -> None:
        """Also called by Blender if another file is opened during the work."""
        self._job.leave(context.window_manager)

    def _show(self, context: Any) -> None:
        shown, job, process = context.window_manager.mps, self._job, self._job.process
        progress, message = (process.progress, process.message) if process else (0.0, Note("starting"))
        progress, message = (job.finished + progress) / (job.finished + len(job.runs)), f"{self._whose}{message}"
        left = time_left_text(job.pace.left(time.monotonic(), progress))
        if (shown.progress, shown.message, shown.left) != (progress, message, left):
            shown.progress, shown.message, shown.left = progress, message, left
            redraw_panels(context.window_manager)


class MPS_OT_cancel(bpy.types.Operator):
    """Stop what is running; nothing half-written is left"""

    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return bool(context.window_manager.mps.running)

    def execute(self, context: Any) -> set[Any]:
        context.window_manager.mps.cancel = True
        return {"FINISHED"}


def _close(slices: list[Slices]) -> None:
    """End unfinished slices, which lets them clean up."""
    for one in slices:
        one.close()
    slices.clear()


def idle(cls: Any, context: Any) -> bool:
    """The poll of operators that run the core: only one at a time."""
    if context.window_manager.mps.running:
        cls.poll_message_set(in_blender("Wait for the running work, or cancel it"))
        return False
    return True


def unregister() -> None:
    for job in list(_jobs):
        job.leave(bpy.context.window_manager)
