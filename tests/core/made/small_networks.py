"""Each network at a width that takes no time, and how little of a recipe trains it."""

from typing import Any

SMALL: dict[str, dict[str, Any]] = {
    "demultiplexer": {"width": 0.1},
    "mpsnet": {"width": 0.02},
    "multiscale": {"widths": [4, 6, 8, 10]},
    "psfcn": {"width": 0.05},
}


def recipe_data(network: str, **changes: Any) -> dict[str, Any]:
    """A recipe of a few short steps, as plain data."""
    seen = {"crop": 0, "patches": 4} if network == "mpsnet" else {"crop": 32}
    facts = {"name": "tiny", "title": "a test", "network": network, "options": SMALL[network], "steps": 6}
    return {**facts, **seen, "batch": 2, "warm_up": 2, **changes}
