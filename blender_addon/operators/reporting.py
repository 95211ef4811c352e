"""Operators that report bad input in one sentence, which stays in their step of the panel until the next run."""

import inspect
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import bpy
from bpy.props import FloatProperty, IntProperty

from mpsnet_core.errors import Cancelled, InputError, Note, SettingsError
from mpsnet_core.io.crash_log import describe_unexpected_error

from ..child_process.core_process import CoreCrashed
from ..errors import system_report
from ..image_records import Provenance, chosen, stamp, store_provenance
from ..images import fine_preview, load_image
from ..scene.objects import by_session_uid
from ..settings.declared import StringSetting
from ..settings.messages import in_blender
from ..settings.record import store_record

log = logging.getLogger(__name__)

CANCELLED = "cancelled"
# The bounds of a number that a slider keeps, for those that Blender enforces.
_SOFT = {"min": "soft_min", "max": "soft_max"}
# Steps whose image an operator may require: what the panel calls it, and what is said where it is missing.
_REQUIRED = {
    "photo": ("Photo", "Render or open a photo first"),
    "estimate": ("Normals", "Estimate the normals first"),
    "bake": ("Texture", "Bake the texture first"),
}


class ReportingOperator(bpy.types.Operator):
    """An operator whose :meth:`act` raises InputError on bad input, or OSError on a disk error.

    The sentence appears in Blender's window, and stays in the operator's step of the panel until the next run. A script
    that called the operator gets it as a RuntimeError.
    """

    bl_options = {"UNDO"}
    requires = ""  # the step in _REQUIRED whose image is required
    step = ""  # the step whose settings it has
    _scene_uid = 0
    _rig_place = 0  # position of the chosen rig in the scene's list
    _whose = ""  # prefix of messages on one of several rigs: its name
    _made_from: Provenance
    _given: set[str]  # names of the properties that its caller has set

    def __init_subclass__(cls) -> None:
        """Let numbers keep their bounds for the mouse alone: Blender would clamp a script's silently."""
        super().__init_subclass__()
        softened = {}
        for part in reversed(cls.__mro__):
            for name, declared in inspect.get_annotations(part).items():
                if getattr(declared, "function", None) in {IntProperty, FloatProperty}:
                    facts = {_SOFT.get(fact, fact): value for fact, value in declared.keywords.items()}
                    softened[name] = declared.function(**facts)
        cls.__annotations__ = {**inspect.get_annotations(cls), **softened}

    def tell(self, message: str, kind: str = "INFO") -> None:
        """Report a note, to Blender and to the log: without a window, nobody sees Blender's reports."""
        message = in_blender(message)
        self.report({kind}, message)
        log.log(logging.INFO if kind == "INFO" else logging.WARNING, "%s%s", self._whose, message)

    @classmethod
    def lacks(cls, context: Any) -> str:
        """What is missing to run it, as a sentence without a full stop; "" if nothing is."""
        lacking = cls.requires and not getattr(context.scene.mps, cls.requires).image
        return _REQUIRED[cls.requires][1] if lacking else ""

    def refuse_lacking(self, context: Any) -> None:
        """Raise InputError if something is missing; for operators that a script may give it, so that they can begin."""
        if lacking := self.lacks(context):
            raise InputError(f"{lacking[0].lower()}{lacking[1:]}")

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        """The current inputs of a result. If they change later, the panel shows that the result is out of date.

        By default, they are the image that it requires and the settings of its step.
        """
        mps = context.scene.mps
        required = {_REQUIRED[cls.requires][0]: stamp(getattr(mps, cls.requires).image)} if cls.requires else {}
        return {**required, **(chosen(getattr(mps, cls.step)) if cls.step else {})}

    @classmethod
    def poll(cls, context: Any) -> bool:
        obstacle = cls.lacks(context)
        if obstacle:
            cls.poll_message_set(in_blender(obstacle))
        return not obstacle

    def act(self, context: Any) -> None:
        raise NotImplementedError

    def scene(self, result: object) -> Any:
        """The scene that the operator was started in, even if it was renamed or another one is shown.

        Raises InputError if it was removed. result: what it would have received, and where that is now.
        """
        scene = by_session_uid(bpy.data.scenes, self._scene_uid)
        if scene is None:
            raise InputError(f"the scene that this was made for is gone; {result}")
        return scene

    def rig(self, result: object) -> Any:
        """The settings group with ``rig``, ``photo`` and ``estimate`` of the rig that was chosen when it was started.

        Raises InputError if it no longer exists. result: as of :meth:`scene`.
        """
        rigs = self.scene(result).mps.every_rig
        if self._rig_place >= len(rigs):
            raise InputError(f"the rig that this was made for is gone; {result}")
        return rigs[self._rig_place]

    def loaded(self, path: Path, name: str, *, is_data: bool, stretched: bool = False) -> Any:
        """The image of a resulting file: see :func:`.load_image` and :meth:`made`."""
        image = load_image(path, name, is_data=is_data)
        self.made(image, stretched=stretched)
        return image

    def made(self, image: bpy.types.Image, *, stretched: bool = False) -> None:
        """Store its inputs with the resulting image, and unfold it in the panel; called once it exists.

        stretched: see :func:`.fine_preview`.
        """
        store_provenance(image, verb_of(self.bl_idname), self._made_from)
        image.mps.shown = True
        if image.source == "FILE" and (stretched or not bpy.app.background):
            fine_preview(image, stretched=stretched)

    def begin(self, context: Any) -> None:
        """Called first: clear the record of an earlier run."""
        self._scene_uid, self._rig_place = context.scene.session_uid, context.scene.mps.chosen_rig
        names = {one.identifier for one in self.properties.bl_rna.properties} - {"rna_type"}
        self._given = set(filter(self.properties.is_property_set, names))
        self._store_record()

    def execute(self, context: Any) -> set[Any]:
        self.begin(context)
        return {"FINISHED"} if self.done(lambda: self._act_in_range(context)) else {"CANCELLED"}

    def _act_in_range(self, context: Any) -> None:
        for name in self._given:
            one, value = self.properties.bl_rna.properties[name], getattr(self, name)
            if one.type in {"INT", "FLOAT"} and not one.is_array and not one.soft_min <= value <= one.soft_max:
                raise SettingsError(
                    f"{one.name} {value:g} is out of range; choose {one.soft_min:g} to {one.soft_max:g}"
                )
        self.act(context)

    def start_modal(self, context: Any, start: Callable[[Any], None]) -> set[Any]:
        """Start what goes on in a window. Without one, :meth:`act` runs, which says what a script does instead."""
        if bpy.app.background:
            return self.execute(context)
        self.begin(context)
        return {"RUNNING_MODAL"} if self.done(lambda: start(context)) else {"CANCELLED"}

    def done(self, step: Callable[[], None]) -> bool:
        """Run a step. If it fails, report why in one sentence and return False."""
        try:
            step()
        except (InputError, CoreCrashed) as error:
            self._failed(str(error))
        except OSError as error:
            self._failed(system_report(error))
        except (Cancelled, KeyboardInterrupt):
            self.report({"ERROR"}, CANCELLED)
        except Exception as error:  # noqa: BLE001
            self._failed(describe_unexpected_error(error))
        else:
            return True
        return False

    def _failed(self, sentence: str) -> None:
        sentence = f"{self._whose}{in_blender(sentence)}"
        self._store_record(error=sentence)
        self.report({"ERROR"}, sentence)

    def _store_record(
        self, *, error: str = "", notes: Sequence[Note] = (), result: Mapping[str, Any] | None = None
    ) -> None:
        scene = by_session_uid(bpy.data.scenes, self._scene_uid)
        if scene is not None:
            store_record(scene, verb_of(self.bl_idname), error=error, notes=notes, result=result)


def verb_of(idname: str) -> str:
    """ "estimate" for "mps.estimate" and for Blender's own form "MPS_OT_estimate"."""
    return idname.removeprefix("MPS_OT_").removeprefix("mps.")


class MPS_OT_dismiss(bpy.types.Operator):
    """Dismiss this message; you can run the step again"""

    bl_label = "Dismiss Message"
    bl_options = {"INTERNAL", "UNDO"}

    verb: StringSetting("Operator", 'Whose message to take away: "estimate" for mps.estimate')

    def execute(self, context: Any) -> set[Any]:
        store_record(context.scene, self.verb)
        return {"FINISHED"}
