"""How a step's last run ended."""

import bpy
from bpy.props import StringProperty


class MPS_PG_record(bpy.types.PropertyGroup):
    """How the last run of an operator ended. Its `name` is the operator's: "estimate" for ``mps.estimate``."""

    error: StringProperty(name="Error", description="Why the last run failed and how to mend it. Empty: it did not")
    notes: StringProperty(name="Notes", description="What the last run had to say, a line each")


def error_of(scene: bpy.types.Scene, verb: str) -> str:
    """Why the last run of an operator failed; "" if it did not."""
    record = scene.mps.records.get(verb)
    return record.error if record else ""


def notes_of(scene: bpy.types.Scene, verb: str) -> list[str]:
    """The notes of the last run of an operator."""
    record = scene.mps.records.get(verb)
    return record.notes.splitlines() if record else []


def store_record(scene: bpy.types.Scene, verb: str, *, error: str = "", notes: list[str] | None = None) -> None:
    """Store how a run ended, in place of the previous record. Without an error or notes, nothing is stored."""
    records = scene.mps.records
    place = records.find(verb)
    if not error and not notes:
        if place >= 0:
            records.remove(place)
        return
    record = records[place] if place >= 0 else records.add()
    record.name, record.error, record.notes = verb, error, "\n".join(notes or [])
