"""Notes carry a level, a code, and what they are made of, so that a program can show them in its own way."""

import json

import numpy as np
import pytest

from mpsnet_core import Check, write_image
from mpsnet_core.cli.command import run
from mpsnet_core.errors import FormatError, Note


def test_a_note_comes_back_as_it_was() -> None:
    part = Note("the %s light", "red")
    note = Note("%s is %.0f%% too dark [black-channel]", part, np.float32(12.4), level="stop")
    again = Note.from_facts(json.loads(json.dumps(note.facts())))
    assert again == note == "the red light is 12% too dark [black-channel]"
    assert (again.level, again.code, again.values[0].template) == ("stop", "black-channel", "the %s light")


@pytest.mark.parametrize(
    "facts",
    [
        None,
        7,
        {"level": "good"},
        {"level": "best", "template": "x", "values": []},
        {"level": "good", "template": "%d", "values": ["x"]},
        {"level": "good", "template": 3, "values": []},
        {"level": "good", "template": "%999999999d", "values": [1]},
        {"level": "good", "template": "%*d", "values": [999999999, 1]},
        {"level": "good", "template": "x", "values": 5},
    ],
)
def test_what_is_no_note_is_refused(facts: object) -> None:
    with pytest.raises(FormatError):
        Note.from_facts(facts)


def test_programs_are_told_levels_codes_and_values(tmp_path, capsys) -> None:
    photo = np.full((64, 64, 3), 0.5)
    photo[16:48, 16:48] = 1.0
    write_image(tmp_path / "photo.exr", photo)
    assert not run(["mask", str(tmp_path / "photo.exr"), "-o", str(tmp_path / "mask.png"), "--progress", "json"])
    result = json.loads(capsys.readouterr().out.splitlines()[-1])["result"]
    told = [Note.from_facts(facts) for facts in result["told"]]
    assert told == result["notes"] and {note.level for note in told} <= {"good", "look"}
    (covers,) = [note for note in told if note.template.startswith("the mask covers")]
    assert covers.values[0] == pytest.approx(25, abs=1)


def test_a_check_s_findings_are_notes_with_its_levels(tmp_path) -> None:
    light = np.random.default_rng(0).uniform(0.2, 0.7, (64, 64, 3))
    write_image(tmp_path / "photo.exr", light * [1, 1, 0.01])
    checked = Check(image=str(tmp_path / "photo.exr"), mask="none").run()
    told = [Note.from_facts(facts) for facts in checked.facts()["told"]]
    levels = {"good": "good", "watch": "look", "bad": "stop"}
    assert [note.level for note in told] == [levels[one.level] for one in checked.findings]
    assert "stop" in {note.level for note in told}
