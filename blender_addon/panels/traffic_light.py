"""What a step has to say, in one line: a light for good, look or stop. The sentences are behind a fold.

Below a sentence are the fields of the options that it names, so that it can be acted on where it stands.
"""

import inspect
from collections.abc import Iterable, Sequence
from typing import Any

import bpy
from bpy.props import StringProperty

from mpsnet_core.errors import NOTE_LEVELS, Note

from ..manual import explanation
from ..settings.declared import option_of_setting
from ..settings.messages import options_in
from .text import across_popup, sentence, text_width, wrapped
from .text import lines as broken

# The word and the icon of each level.
LIGHTS = {
    "good": ("All Is Well", "STRIP_COLOR_04"),
    "look": ("Have a Look", "STRIP_COLOR_03"),
    "stop": ("Stop", "STRIP_COLOR_01"),
}
# Options that help with what a note is about, where it names none.
_MENDED_BY = {"doubtful-mask": ["mask"], "no-mask": ["mask"]}


def worst(notes: Iterable[Note]) -> str:
    """The level of the line that stands for these notes."""
    return max((note.level for note in notes), key=NOTE_LEVELS.index)


def traffic_light(layout: Any, name: str, notes: Sequence[Note], groups: Sequence[Any] = (), *, folded: bool) -> None:
    """Draw the line of some notes. The mouse over it shows the sentences.

    name: by which Blender stores whether it is folded. groups: the settings whose fields may be shown. folded: whether
    the sentences are at first.
    """
    if not notes:
        return
    word, icon = LIGHTS[worst(notes)]
    header, body = layout.panel(f"MPS_told_{name}", default_closed=folded)
    row = header.row()
    row.alignment = "LEFT"
    read = row.operator("mps.read_notes", text=word, icon=icon, emboss=False)
    read.sentences = "\n".join(map(sentence, notes))
    for note in notes if body else ():
        page = explanation(note.code)
        words = sentence(note).replace(f" [{note.code}]", "") if page else sentence(note)
        wrapped(body, words, icon=LIGHTS[note.level][1])
        column = body.column()
        column.use_property_split, column.use_property_decorate = True, False
        for group, setting in _fields(note, groups):
            column.prop(group, setting)
        if note.level != "good" and page:
            body.operator("wm.url_open", text="Read More", icon="HELP").url = page


def _fields(note: Note, groups: Sequence[Any]) -> Iterable[tuple[Any, str]]:
    for option in (*options_in(note), *_MENDED_BY.get(note.code, ())):
        places = ((group, option_of_setting(group, option)) for group in groups)
        yield from [(group, setting) for group, setting in places if setting][:1]


class MPS_OT_read_notes(bpy.types.Operator):
    """Read what there is to say of this step"""

    bl_idname = "mps.read_notes"
    bl_label = "Read Notes"
    bl_options = {"INTERNAL"}

    sentences: StringProperty(name="Sentences", description="What there is to say, a line each", options={"SKIP_SAVE"})

    @classmethod
    def description(cls, context: Any, properties: Any) -> str:
        return properties.sentences or inspect.getdoc(cls) or ""

    def execute(self, context: Any) -> set[Any]:
        return {"FINISHED"}

    def invoke(self, context: Any, event: Any) -> set[Any]:
        context.window_manager.popup_menu(self._draw, title=self.bl_label)
        return {"FINISHED"}

    def _draw(self, menu: Any, context: Any) -> None:
        for one in self.sentences.splitlines():
            for line in broken(one, across_popup(), text_width):
                menu.layout.label(text=line, translate=False)
            menu.layout.separator()
