"""Steps of the sidebar: panels whose header shows the state of a step, and whose body shows what to do.

A step is a subclass with ``verbs``, its operators' names without "mps."; ``shows`` or ``result``, the resulting image,
or True if it is done; and ``draw``, which shows settings, ``progress_or`` (the button) for each verb, and ``picture``
of the result. If more can be missing than its operators' ``lacks`` reports, it has a ``lacks`` of its own. Errors,
notes, progress, time left and the inputs of a result come from the operators (``ReportingOperator``, ``RunsCore``,
``provenance``).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import bpy
from bpy.app.translations import pgettext_iface as iface

from mpsnet_core.errors import Note

from ..image_records import cached_file_sizes, changed_since, made_by, made_when, origin
from ..operators.reporting import ReportingOperator, verb_of
from ..outputs import is_safe_to_open
from ..rig.several_rigs import OnEachRig
from ..scene.objects import target_of
from ..settings.messages import OWN_SENSE, in_blender
from ..settings.record import all_notes, error_of, notes_of
from .text import across_sidebar, fitted, sentence, wrapped
from .traffic_light import traffic_light

FOLDED = True  # whether the notes of steps are folded at first


class Kind(Enum):
    """The states of a step: the word and the icon in its header."""

    TO_DO = ("To Do", "RADIOBUT_OFF")
    READY = ("Ready", "RADIOBUT_ON")
    RUNNING = ("Running", "SORTTIME")
    DONE = ("Done", "CHECKMARK")
    OUT_OF_DATE = ("Out of Date", "FILE_REFRESH")
    STOP = ("Stop", "STRIP_COLOR_01")
    FAILED = ("Failed", "ERROR")

    @property
    def word(self) -> str:
        return self.value[0]

    @property
    def icon(self) -> str:
        return self.value[1]


@dataclass(frozen=True)
class State:
    """The state of a step."""

    kind: Kind
    """Done, ready, failed and so on."""
    why: str = ""
    """A sentence, or ""."""


class Step(bpy.types.Panel):
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "MPS"

    way = ""  # the way to a photo that shows it, see MPS_PG_scene; "" for both
    verbs: tuple[str, ...] = ()
    shows = ""  # name of the settings group whose image is the result
    codes: tuple[str, ...] = ()  # notes with these are shown here alone, whichever run they are of
    optional = False  # an optional step shows no state until it is done

    @classmethod
    def poll(cls, context: Any) -> bool:
        return cls.way in ("", context.scene.mps.way)

    @classmethod
    def result(cls, context: Any) -> Any:
        """The step's resulting image, or whether it is done; None if it is not."""
        return getattr(context.scene.mps, cls.shows).image if cls.shows else None

    @classmethod
    def verb(cls, context: Any) -> str:
        """The operator that makes the result, without "mps."."""
        return cls.verbs[0]

    @classmethod
    def lacks(cls, context: Any) -> str:
        """What the step is missing, as a sentence without a full stop; "" if nothing is."""
        return _operator(cls.verb(context)).lacks(context)

    @classmethod
    def state(cls, context: Any) -> State:
        """The state of the step."""
        if verb_of(context.window_manager.mps.running) in cls.verbs:
            return State(Kind.RUNNING)
        for verb in cls.verbs:
            if error := error_of(context.scene, verb):
                return State(Kind.FAILED, error)
        result = cls.result(context)
        if not result:
            lacking = cls.lacks(context)
            pressed = cls.verb(context)
            works = not lacking and _operator(pressed).poll(context)
            return State(Kind.READY) if works else State(Kind.TO_DO, lacking)
        changed = _changed(context, result) if isinstance(result, bpy.types.Image) else []
        if changed:
            return State(Kind.OUT_OF_DATE, f"Changed since: {', '.join(changed)}")
        if stops := [note for verb in cls.verbs for note in notes_of(context.scene, verb) if note.level == "stop"]:
            return State(Kind.STOP, sentence(stops[0]))
        return State(Kind.DONE)

    def draw_header_preset(self, context: Any) -> None:
        if not self.verbs:
            return
        with cached_file_sizes():
            kind = self.state(context).kind
        if self.optional and kind in {Kind.TO_DO, Kind.READY}:
            return
        row = self.layout.row()
        row.alert = kind in {Kind.FAILED, Kind.STOP}
        # Greyed out: it needs no attention.
        row.active = kind is not Kind.TO_DO
        row.label(text=kind.word, text_ctxt=OWN_SENSE, icon=kind.icon)

    def column(self, group: Any = None, *names: str | bool, heading: str = "", **placeholders: str) -> Any:
        """A column with a row for each of these settings of a group; False stands for none."""
        column = self.layout.column(heading=heading)
        column.use_property_split = True
        column.use_property_decorate = False
        for name in map(str, filter(None, names)):
            row: dict[str, Any] = {"placeholder": placeholders[name]} if name in placeholders else {}
            if name == "target":  # the placeholder is an object's name, and no word
                row |= {"text": iface(group.bl_rna.properties[name].name), "translate": False}
            if name == "output":  # "Texture File" is "File" in its own step
                row = {"placeholder": "Automatic", "text": group.bl_rna.properties[name].name.split()[-1], **row}
            self.field(column, group, name, **row)
        return column

    @staticmethod
    def field(column: Any, group: Any, name: str, **row: Any) -> None:
        """A setting in a row of a column; of a file that is read, with the list of the files that it takes."""
        if group.bl_rna.properties[name].subtype != "FILE_NAME":
            column.prop(group, name, **row)
            return
        column = column.row(align=True)
        column.prop(group, name, **row)
        choose = column.operator("mps.choose_file", text="", icon="FILEBROWSER")
        choose.group, choose.setting = group.path_from_id(), name

    def progress_or(self, context: Any, verb: str, icon: str, text: str = "", lacks: str = "") -> None:
        """The button of an operator of the step, with what is missing above it and errors below.

        While it runs, its progress, the time left and a cancel button. lacks: what is missing, if neither the step nor
        the operator itself reports it.
        """
        if self.progress_of(context, verb):
            return
        scene = context.scene
        with cached_file_sizes():
            own = bool(self.verbs) and self.verb(context) == verb
            lacking = lacks or (self.lacks(context) if own else _operator(verb).lacks(context))
        if lacking and not error_of(scene, verb):  # the error below says so
            wrapped(self.layout, lacking, icon="INFO")
        row = self.layout.row(align=True)
        row.scale_y = 1.3
        row.active = not lacking
        if text:
            row.operator(f"mps.{verb}", icon=icon, text=text)
        else:
            row.operator(f"mps.{verb}", icon=icon)
        if len(scene.mps.rigs) > 1 and issubclass(_operator(verb), OnEachRig):
            row.operator(f"mps.{verb}", text="All Rigs").all_rigs = True
        self.failure(scene, verb)
        if not lacking:  # no notes on a result whose inputs are missing
            self.told(context, verb, notes_of(scene, verb))

    def told(self, context: Any, name: str, notes: Sequence[Note] = ()) -> None:
        """Show a light for these notes and all others that belong here. name: of the fold."""
        groups = [getattr(context.scene.mps, step) for step in ("estimate", "bake", "views", "heights", "align")]
        traffic_light(self.layout, name, self.notes_here(context, notes), groups, folded=FOLDED)

    @classmethod
    def notes_here(cls, context: Any, notes: Sequence[Note] = ()) -> list[Note]:
        """These notes, but for those that another step shows, and all that this step shows whatever run they are of."""
        others = {code for step in Step.__subclasses__() if step.poll(context) for code in step.codes}
        here = [note for note in all_notes(context.scene.mps) if note.code in cls.codes]
        kept = [note for note in notes if note.code not in others.difference(cls.codes)]
        return list({note.code or note: note for note in (*here, *kept)}.values())

    def progress_of(self, context: Any, verb: str) -> bool:
        """Show the progress of a running operator. Returns whether it runs."""
        job = context.window_manager.mps
        if verb not in map(verb_of, (job.running, job.chain)):
            return False
        row = self.layout.row(align=True)
        row.scale_y = 1.3
        row.progress(factor=job.progress, text=f"{job.progress:.0%}  {in_blender(job.left)}".strip())
        row.operator("mps.cancel", text="", icon="X")
        part = verb_of(job.running) if verb == verb_of(job.chain) else verb
        label = f"{_operator(part).bl_label}: " if part not in ("", verb) else ""
        wrapped(self.layout, f"{label}{job.message}")
        return True

    def failure(self, scene: Any, verb: str) -> None:
        """Show why the operator's last run failed, until the next one or until it is dismissed."""
        error = error_of(scene, verb)
        if not error:
            return
        box = self.layout.box()
        row = box.row()
        failed = row.row()
        failed.alert = True
        failed.label(text=Kind.FAILED.word, text_ctxt=OWN_SENSE, icon=Kind.FAILED.icon)
        row.operator("mps.dismiss", text="", icon="X", emboss=False).verb = verb
        wrapped(box, error)

    def picture(self, image: Any) -> None:
        """Show an image that a step made, as wide as the sidebar: whether it is out of date, its time and its file.

        It can be folded, and unfolds when it is made anew.
        """
        if image is None:
            return
        with cached_file_sizes():
            changed = _changed(bpy.context, image)
        if changed:
            names = ", ".join(map(in_blender, changed))
            wrapped(self.layout, f"Out of date. Changed since: {names}", icon="FILE_REFRESH")
        path = origin(image)
        row, body = self.layout.panel_prop(image.mps, "shown")
        if body:
            body.template_icon(icon_value=image.preview_ensure().icon_id, scale=across_sidebar())
        when = made_when(image)
        # Rather a part that is whole than all with its middle left out.
        texts = [text for text in (f"{when}  {path.name}" if when else "", path.name, when) if text]
        row.label(text=next((text for text in texts if fitted(text, take=4) == text), fitted(texts[-1], take=4)))
        row.operator("mps.show_image", text="", icon="IMAGE_DATA", emboss=False).image = image.session_uid
        if is_safe_to_open(path.parent):
            row.operator("wm.path_open", text="", icon="FILE_FOLDER", emboss=False).filepath = str(path.parent)


def target_name(context: Any) -> str:
    """The name of the target of the step Bake, or of what stands for it; "" if there is none."""
    target = target_of(context)
    return target.name if target else ""


def _operator(verb: str) -> Any:
    return getattr(bpy.types, f"MPS_OT_{verb}")


def _changed(context: Any, image: Any) -> list[str]:
    """The inputs of an image that have changed since it was made."""
    operator = getattr(bpy.types, f"MPS_OT_{made_by(image)}", None)
    if operator is None or not issubclass(operator, ReportingOperator):
        return []
    return changed_since(image, operator.provenance(context))
