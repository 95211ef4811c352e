"""How a step's last run ended."""

import json
from collections.abc import Mapping
from typing import Any

import bpy
from bpy.props import StringProperty

from ..image_records import from_json


class MPS_PG_record(bpy.types.PropertyGroup):
    """How the last run of an operator ended. Its `name` is the operator's: "estimate" for ``mps.estimate``."""

    error: StringProperty(name="Error", description="Why the last run failed and how to mend it. Empty: it did not")
    notes: StringProperty(name="Notes", description="What the last run had to say, a line each")
    result: StringProperty(
        name="Result", description="What the last run made, as JSON: its files, and what there is to say of them"
    )


def error_of(scene: bpy.types.Scene, verb: str) -> str:
    """Why the last run of an operator failed; "" if it did not."""
    record = scene.mps.records.get(verb)
    return record.error if record else ""


def notes_of(scene: bpy.types.Scene, verb: str) -> list[str]:
    """The notes of the last run of an operator."""
    record = scene.mps.records.get(verb)
    return record.notes.splitlines() if record else []


def result_of(mps: Any, verb: str) -> dict[str, Any]:
    """What the last run of an operator made on a rig, or in the scene; empty if there is nothing.

    mps: the group of settings with the records. The keys are "written" (full paths of all files) and those of the
    core's result.
    """
    record = mps.records.get(verb)
    return from_json(record.result, dict) if record else {}


def store_record(
    scene: bpy.types.Scene,
    verb: str,
    *,
    error: str = "",
    notes: list[str] | None = None,
    result: Mapping[str, Any] | None = None,
) -> None:
    """Store how a run ended, in place of the previous record. Without anything to say, nothing is stored."""
    records = scene.mps.records
    place = records.find(verb)
    if not (error or notes or result):
        if place >= 0:
            records.remove(place)
        return
    record = records[place] if place >= 0 else records.add()
    record.name, record.error, record.notes = verb, error, "\n".join(notes or [])
    record.result = json.dumps(result) if result else ""
