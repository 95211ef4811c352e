"""What the command line prints where JSON is requested."""

import json
from typing import Any


def events(stdout: str) -> tuple[list[float], dict[str, Any]]:
    """The fractions told, and the last object; every line of stdout must be one JSON object."""
    lines = [json.loads(line) for line in stdout.splitlines()]
    assert all(set(line) == {"progress", "message", "time"} for line in lines[:-1])
    return [line["progress"] for line in lines[:-1]], lines[-1]
