"""Operators that run other operators, one after the other: modal from a button, blocking from a script."""

from collections.abc import Callable, Sequence
from typing import Any

import bpy

from mpsnet_core.errors import Cancelled, InputError, Note

from ..errors import operator_report
from ..settings.record import error_of, result_of
from .core_run import TICK_SECONDS, idle
from .progress import redraw_panels
from .reporting import ReportingOperator

# An operator that runs the core, without "mps.", and its settings.
Call = tuple[str, dict[str, Any]]


class RunsSteps(ReportingOperator):
    """An operator whose work is a chain of other operators, each of which leaves its result in its own step.

    From a button, each of them is modal, and the panel shows its progress with the button of this one. The chain ends
    at the first one that fails or is cancelled.
    """

    first_message = Note("starting")
    drawn: Callable[[], None]  # draws over the viewports meanwhile; a static method
    _called = ""  # the operator whose result is awaited

    @classmethod
    def poll(cls, context: Any) -> bool:
        return idle(cls, context) and super().poll(context)

    def steps(self) -> Sequence[Callable[[Any], Call | None]]:
        """Functions of the context. Each does short work itself, and returns the operator to run, None for none."""
        raise NotImplementedError

    def take_away(self, context: Any) -> None:
        """Undo what must not stay if the chain ends early."""

    def act(self, context: Any) -> None:
        self._left = list(self.steps())
        while self._left or self._called:
            self._step(context, "EXEC_DEFAULT")

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if bpy.app.background:
            return self.execute(context)
        self.begin(context)
        manager = context.window_manager
        manager.mps.running = manager.mps.chain = self.bl_idname
        manager.mps.progress, manager.mps.message, manager.mps.cancel = 0.0, self.first_message, False
        self._left = list(self.steps())
        self._ticks = 0
        self._timer = manager.event_timer_add(TICK_SECONDS, window=context.window)
        self._drawing = bpy.types.SpaceView3D.draw_handler_add(self.drawn, (), "WINDOW", "POST_PIXEL")
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: bpy.types.Event) -> set[Any]:
        manager = context.window_manager
        running = manager.mps.running
        if running not in {"", self.bl_idname}:
            return {"PASS_THROUGH"}
        if manager.mps.cancel or (event.type == "ESC" and event.value == "PRESS"):
            self.tell("Cancelled")
            self.take_away(context)
            return self._end(context, "CANCELLED")
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        redraw_panels(manager)
        self._ticks += 1
        if running and self._ticks % 3:  # let the window redraw first, to show the next step
            return {"PASS_THROUGH"}
        try:
            went_well = self.done(lambda: self._step(context, "INVOKE_DEFAULT"))
        except BaseException:  # otherwise all operators would wait for this one for ever
            self._end(context, "CANCELLED")
            raise
        if not went_well:
            return self._end(context, "CANCELLED")
        return {"PASS_THROUGH"} if self._left or self._called else self._end(context, "FINISHED")

    def cancel(self, context: Any) -> None:
        self._end(context, "CANCELLED")

    def _step(self, context: Any, how: str) -> None:
        """Check the result of the last operator, and begin the next step."""
        try:
            if self._called and not result_of(context.scene.mps, self._called):
                error = error_of(context.scene, self._called)
                raise InputError(error) if error else Cancelled()
            self._called = ""
            call = self._left.pop(0)(context) if self._left else None
            if call is not None:
                self._called, settings = call
                context.window_manager.mps.running = ""
                run_operator(getattr(bpy.ops.mps, self._called), how, **settings)
        except BaseException:
            self.take_away(context)
            raise

    def _end(self, context: Any, how: str) -> set[Any]:
        manager = context.window_manager
        manager.event_timer_remove(self._timer)
        bpy.types.SpaceView3D.draw_handler_remove(self._drawing, "WINDOW")
        if manager.mps.running == self.bl_idname:
            manager.mps.running = ""
        manager.mps.chain = ""
        redraw_panels(manager)
        return {how}


def run_operator(operator: Callable[..., Any], *how: str, **settings: Any) -> None:
    """Call one of the add-on's operators. Raises InputError if it fails, with its report."""
    try:
        operator(*how, **settings)
    except RuntimeError as error:
        raise InputError(operator_report(error)) from None
