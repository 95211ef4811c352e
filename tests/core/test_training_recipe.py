"""Training recipes: those that ship, and that what is written is what is read."""

import json
import shlex
from pathlib import Path

import pytest

torch = pytest.importorskip("torch")

from small_networks import recipe_data

from mpsnet_core.cli.command import argument_parser
from mpsnet_core.errors import SettingsError
from mpsnet_core.learning.training.loop import _check_fit
from mpsnet_core.learning.training.networks import NETWORKS, build_network
from mpsnet_core.learning.training.recipe import capture_model, read_recipe, recipe_from_data, recipe_names
from mpsnet_core.synthesis.capture_model import CaptureModel


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
        parts.add(argument_parser().parse_args(arguments).merl_part)
    assert parts == {"training", "validation"}


def test_a_recipe_is_read_as_it_was_written(tmp_path: Path) -> None:
    recipe = recipe_from_data(
        recipe_data("multiscale", samples=["mpsnet synthesize"], seed=9, ema=0.5, capture={"blur": [0, 1.0]})
    )
    assert recipe_from_data(json.loads(json.dumps(recipe.to_json()))) == recipe
    lines = [
        f"{key} = {json.dumps(value)}" for key, value in recipe.to_json().items() if key not in ("options", "capture")
    ]
    for table in ("options", "capture"):
        lines += [f"[{table}]", *(f"{key} = {json.dumps(value)}" for key, value in getattr(recipe, table).items())]
    (tmp_path / "a.toml").write_text("\n".join(lines))
    assert read_recipe(tmp_path / "a.toml") == recipe


@pytest.mark.parametrize("name", ["augment", "frozen_norms"])
def test_a_switch_is_true_or_false(name: str) -> None:
    with pytest.raises(SettingsError, match=f"{name} must be true or false, not 1"):
        recipe_from_data(recipe_data("multiscale", **{name: 1}))


def test_the_capture_model_s_own_numbers_may_stand_in_a_recipe() -> None:
    own = CaptureModel()
    assert recipe_from_data(recipe_data("multiscale", capture=vars(own))).capture == vars(own)
    assert capture_model(vars(own)) == own


@pytest.mark.parametrize(
    ("capture", "words"),
    [
        ({"crostalk": [0, 0]}, "has no 'crostalk'; choose crosstalk, "),
        ({"crosstalk": 0.1}, "crosstalk must be the least and the most, each from 0 to 0.9, not 0.1"),
        ({"blur": [1.2, 0.3]}, "blur must be the least and the most"),
        ({"light_strengths": [0, 1]}, "light_strengths must be"),
        ({"light_strengths": [1.0, float("nan")]}, "light_strengths must be"),
        ({"bits": []}, "bits must be a whole number"),
        ({"exact": -1}, "exact must be"),
    ],
)
def test_a_capture_that_no_model_has_is_refused(capture: object, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        recipe_from_data(recipe_data("multiscale", capture=capture))
