"""Operations as JSON: they arrive as they were sent, and everything else is refused in one sentence."""

import json
import subprocess
import sys
from typing import Any

import pytest

from mpsnet_core import BakeViews, CalibrateLights, Estimate, SettingsError
from mpsnet_core.cli.command import OPERATIONS
from mpsnet_core.operation import Operation, from_json, to_json

SENT: list[tuple[Operation, dict[str, Any]]] = [
    (
        Estimate(image=("a b.png", "-ü\udcff.png"), rig="rig.json", output="out", passes=3, distance=2, tile=512),
        {"image": ["a b.png", "-ü\udcff.png"], "rig": "rig.json", "output": "out", "passes": 3, "distance": 2},
    ),
    (
        CalibrateLights(ball=("ball.png",), circle=("1,2,3", "4,5,6"), distant=True, radius=0.1, output="rig.lp"),
        {"ball": ["ball.png"], "circle": ["1,2,3", "4,5,6"], "distant": True, "radius": 0.1, "output": "rig.lp"},
    ),
    (
        BakeViews(mesh=("mesh.npz",), cameras="views.json", rig="rig.json", level="off", output="texture.png"),
        {"mesh": ["mesh.npz"], "cameras": "views.json", "rig": "rig.json", "level": "off", "output": "texture.png"},
    ),
]


@pytest.mark.parametrize(("operation", "options"), SENT)
def test_an_operation_arrives_as_it_was_sent(operation: Operation, options: dict[str, Any]) -> None:
    sent = json.loads(json.dumps(to_json(operation)))
    assert sent["operation"] == operation.command
    assert options.items() <= sent["options"].items()
    assert from_json(sent, OPERATIONS) == operation


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"operation": "estimat"}, "operation 'estimat' is not known; choose estimate, superpose, mask"),
        ({"options": ["rig.json"]}, "the request for estimate holds more than its options; send"),
        ({"options": {}}, "estimate lacks its option image; give it"),
        ({"colour": "red"}, "option of estimate 'colour' is not known; choose image"),
        ({"image": "photo.png"}, "image of estimate must be a list of values, not 'photo.png'; give one or more"),
        ({"image": ["photo.png", None]}, "image of estimate must be a text, not None"),
        ({"rig": ""}, "rig of estimate must be a text, not ''"),
        ({"rig": "a\0b"}, r"rig of estimate must be a text, not 'a\x00b'"),
        ({"threads": True}, "threads of estimate must be a whole number, not True"),
        ({"distance": float("nan")}, "distance of estimate must be a number, not nan"),
        ({"passes": 2}, "passes 2 is not known; choose 1 or 3"),
    ],
)
def test_what_is_no_operation_is_refused(changes: dict[str, Any], sentence: str) -> None:
    request = {"operation": "estimate", "options": {"image": ["photo.png"], "rig": "rig.json", "output": "out.png"}}
    of_request = changes.keys() & {"operation", "options", "verb"}
    (request if of_request else request["options"]).update(changes)  # type: ignore[attr-defined]
    with pytest.raises(SettingsError) as caught:
        from_json(request, OPERATIONS)
    assert str(caught.value).startswith(sentence)


def test_the_command_line_runs_an_operation_from_stdin() -> None:
    def job(text: str) -> tuple[int, dict[str, Any]]:
        """Exit code and message."""
        command = [sys.executable, "-m", "mpsnet_core", "job", "--progress", "json"]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdin and child.stdout
            child.stdin.write(f"{text}\n")
            child.stdin.flush()
            return child.wait(60), json.loads(child.stdout.read())

    code, message = job('{"operation": "models"}')
    assert code == 0 and "lambertian" in [model["name"] for model in message["result"]["models"]]
    for text, sentence in (
        ('{"options": {}}', "operation '' is not known; choose estimate"),
        ("models", "'models' is not a request; give a JSON object a line"),
        ('{"operation": "models", "options": {"count": 1}}', "option of models 'count' is not known; choose model"),
    ):
        code, message = job(text)
        assert code == 2 and message["error"].startswith(sentence)
    help_text = subprocess.run([sys.executable, "-m", "mpsnet_core", "--help"], capture_output=True, text=True).stdout
    assert "estimate" in help_text and "job" not in help_text
