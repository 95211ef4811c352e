"""Bad input becomes one sentence, which stays in the operator's step of the panel until the next run."""

from collections.abc import Callable
from typing import Any

import bpy
from bpy.props import StringProperty

from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.io.crash_log import describe_unexpected_error

from ..child_process.core_process import CoreCrashed
from ..errors import system_report
from ..provenance import Provenance, store_provenance
from ..scene.objects import by_session_uid
from ..settings.record import store_record

CANCELLED = "cancelled"
_MISSING = {
    "photo": "Render or open a photo first",
    "estimate": "Estimate the normals first",
    "bake": "Bake the texture first",
}


class ReportingOperator(bpy.types.Operator):
    """An operator whose :meth:`act` raises InputError on bad input, or OSError if the disk fails it.

    The sentence appears in Blender's window and stays in the operator's step of the panel until the next run; a script
    that called the operator gets it as a RuntimeError.
    """

    requires = ""  # the step whose image has to be there first, of those in _MISSING
    _scene_uid = 0
    _rig_place = 0  # of the rig that was chosen, in the scene's list
    _whose = ""  # before what is said of one of several rigs: its name
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

        Raises InputError if it was removed. result: what it would have got, and where that is now.
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
            self._failed(describe_unexpected_error(error))
        else:
            return True
        return False

    def _failed(self, sentence: str) -> None:
        sentence = f"{self._whose}{sentence}"
        self._store_record(error=sentence)
        self.report({"ERROR"}, sentence)

    def _store_record(self, *, error: str = "", notes: list[str] | None = None) -> None:
        scene = by_session_uid(bpy.data.scenes, self._scene_uid)
        if scene is not None:
            store_record(scene, verb_of(self.bl_idname), error=error, notes=notes)


def verb_of(idname: str) -> str:
    """ "estimate" for "mps.estimate" as well as for "MPS_OT_estimate", which is how Blender writes it itself."""
    return idname.removeprefix("MPS_OT_").removeprefix("mps.")


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


register, unregister = bpy.utils.register_classes_factory((MPS_OT_dismiss,))
