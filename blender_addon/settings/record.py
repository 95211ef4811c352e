"""How a step's last run ended."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import bpy
from bpy.props import StringProperty

from mpsnet_core.errors import FormatError, Note

from ..image_records import from_json

# The operators of whose last run each rig has a record of its own.
OF_ONE_RIG = {
    *("add_rig", "render_photo", "open_photo", "superpose", "check_photo"),
    *("show_mask", "paint_mask", "align_photo", "estimate", "error_map"),
}


class MPS_PG_record(bpy.types.PropertyGroup):
    """How the last run of an operator ended. Its `name` is the operator's: "estimate" for ``mps.estimate``."""

    error: StringProperty(name="Error", description="Why the last run failed and how to mend it. Empty: it did not")
    notes: StringProperty(name="Notes", description="What the last run had to say, as JSON: sentences and their levels")
    result: StringProperty(
        name="Result", description="What the last run made, as JSON: its files, and what there is to say of them"
    )


def _records(mps: Any, verb: str) -> Any:
    """The records among which an operator's is: of the scene, or of a rig, which `mps` may be itself."""
    return mps.chosen.records if verb in OF_ONE_RIG and hasattr(mps, "chosen") else mps.records


def error_of(scene: bpy.types.Scene, verb: str) -> str:
    """Why the last run of an operator failed; "" if it did not."""
    record = _records(scene.mps, verb).get(verb)
    return record.error if record else ""


def notes_of(scene: bpy.types.Scene, verb: str) -> list[Note]:
    """The notes of the last run of an operator."""
    record = _records(scene.mps, verb).get(verb)
    return read_notes(record) if record else []


def all_notes(mps: Any) -> list[Note]:
    """The notes of the last runs of all operators."""
    return [note for record in (*mps.records, *mps.chosen.records) for note in read_notes(record)]


def read_notes(record: MPS_PG_record) -> list[Note]:
    """The notes of a record. What is none, as in a hostile file or one of an earlier version, is left out."""
    notes = []
    for facts in from_json(record.notes, list):
        with suppress(FormatError):
            notes.append(Note.from_facts(facts))
    return notes


def result_of(mps: Any, verb: str) -> dict[str, Any]:
    """What the last run of an operator made on a rig, or in the scene; empty if there is nothing.

    mps: the group of settings with the records. The keys are "written" (full paths of all files) and those of the
    core's result.
    """
    record = _records(mps, verb).get(verb)
    return from_json(record.result, dict) if record else {}


def store_record(
    scene: bpy.types.Scene,
    verb: str,
    *,
    error: str = "",
    notes: Sequence[Note] = (),
    result: Mapping[str, Any] | None = None,
) -> None:
    """Store how a run ended, in place of the previous record. Without anything to say, nothing is stored."""
    records = _records(scene.mps, verb)
    place = records.find(verb)
    if not (error or notes or result):
        if place >= 0:
            records.remove(place)
        return
    record = records[place] if place >= 0 else records.add()
    record.name, record.error = verb, error
    record.notes = json.dumps([note.facts() for note in notes]) if notes else ""
    record.result = json.dumps(result) if result else ""
