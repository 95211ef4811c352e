"""Training recipes: those that ship, and that what is written is what is read."""

import json
import shlex
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

from small_networks import recipe_data

from mpsnet_core.cli.command import _parser
from mpsnet_core.learning.training.loop import _check_fit
from mpsnet_core.learning.training.networks import NETWORKS, build_network
from mpsnet_core.learning.training.recipe import read_recipe, recipe_from_data, recipe_names


def test_there_is_a_recipe_for_every_network() -> None:
    assert {read_recipe(name).network for name in recipe_names()} == set(NETWORKS)


@pytest.mark.parametrize("name", recipe_names())
def test_a_shipped_recipe_can_be_followed(name: str) -> None:
    recipe = read_recipe(name)
    assert recipe.name == name
    with torch.device("meta"):
        _check_fit(recipe, build_network(recipe.network, dict(recipe.options)))
    assert recipe.warm_up < recipe.steps
    parts = set()
    for command in recipe.samples:
        program, *arguments = shlex.split(command)
        assert program == "mpsnet"
        parts.add(_parser().parse_args(arguments).merl_part)
    assert parts == {"training", "validation"}


def test_a_recipe_is_read_as_it_was_written(tmp_path: Path) -> None:
    recipe = recipe_from_data(recipe_data("multiscale", samples=["mpsnet synthesize"], seed=9, ema=0.5))
    assert recipe_from_data(json.loads(json.dumps(recipe.to_json()))) == recipe
    lines = [f"{key} = {json.dumps(value)}" for key, value in recipe.to_json().items() if key != "options"]
    lines += ["[options]", *(f"{key} = {json.dumps(value)}" for key, value in recipe.options.items())]
    (tmp_path / "a.toml").write_text("\n".join(lines))
    assert read_recipe(tmp_path / "a.toml") == recipe
