"""Export: what goes out as ONNX answers as the network in PyTorch does, and says what it is."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

import onnx
from small_networks import SMALL, recipe_data

from mpsnet_core.errors import InputError
from mpsnet_core.estimate.card import CARD_KEY
from mpsnet_core.estimate.features import CONSTANTS, FEATURE_CHANNELS
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.learning.training import export
from mpsnet_core.learning.training.export import TRAINING_KEY, export_onnx
from mpsnet_core.learning.training.fine_tune import load_exported_weights, read_exported
from mpsnet_core.learning.training.loop import Trained
from mpsnet_core.learning.training.networks import NETWORKS, Network, build_network
from mpsnet_core.learning.training.recipe import recipe_from_data
from mpsnet_core.learning.training.validation import Metrics


def untrained(name: str) -> Trained:
    """As if trained: batch norms have statistics of their own, and the network a validation behind it."""
    torch.manual_seed(1)
    network = build_network(name, SMALL[name])
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.normal_(module.running_mean, std=0.2)
            torch.nn.init.uniform_(module.running_var, 0.5, 1.5)
    metrics = Metrics(12.3456, 80.0, 0.71) if name == "multiscale" else None
    return Trained(
        network, recipe_from_data(recipe_data(name)), 6, 90.0, metrics, 3, "a fingerprint", "a machine", "float32"
    )


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Trained, Path]]:
    folder, made = tmp_path_factory.mktemp("models"), {}
    for name in NETWORKS:
        made[name] = (untrained(name), folder / f"{name}.onnx")
        export_onnx(*made[name])
    return made


def inputs_of(network: Network, count: int, *size: int) -> dict[str, np.ndarray]:
    random = np.random.default_rng(4)
    return {
        name: random.random(
            (count, sum(FEATURE_CHANNELS[f] for f in features), *((1, 1) if features[0] in CONSTANTS else size))
        ).astype(np.float32)
        for name, features in network.inputs.items()
    }


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_the_file_answers_as_the_network_does(name: str, models: dict[str, tuple[Trained, Path]]) -> None:
    trained, path = models[name]
    session = OnnxModel(path).session
    network = trained.network.eval()
    sizes = [(network.patch,) * 2] if network.kind == "patch" else [(32, 48), (160, 112), (48, 16)]
    for count, size in zip((1, 7, 2), sizes, strict=False):
        inputs = inputs_of(network, count, *size)
        with torch.no_grad():
            prediction = network(*map(torch.from_numpy, inputs.values()))
        answers = dict(zip([node.name for node in session.get_outputs()], session.run(None, inputs), strict=True))
        np.testing.assert_allclose(answers["normals"], prediction.normals.numpy(), atol=1e-4)
        assert set(answers) == ({"normals", "confidence"} if name == "multiscale" else {"normals"})
        if name == "multiscale":
            expected = np.clip(1 - np.degrees(prediction.expected_error.numpy()) / 90, 0, 1)
            np.testing.assert_allclose(answers["confidence"], expected, atol=1e-4)


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_the_file_says_what_it_is(name: str, models: dict[str, tuple[Trained, Path]]) -> None:
    trained, path = models[name]
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    assert model.opset_import[0].version >= 17
    assert {value.name for value in model.graph.value_info} >= {
        out for node in model.graph.node for out in node.output
    } - {value.name for value in model.graph.output}, "shapes are inferred"
    network, card = trained.network, OnnxModel(path).card
    assert (card.name, card.kind, card.frame) == ("tiny", network.kind, network.frame)
    assert (card.halo, card.multiple, card.patch) == (network.halo, network.multiple, network.patch)
    assert card.inputs == network.inputs
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    assert set(metadata) == {CARD_KEY, TRAINING_KEY}
    record = json.loads(metadata[TRAINING_KEY])
    assert recipe_from_data(record["recipe"]) == trained.recipe
    assert (record["steps"], record["minutes"], record["hardware"]) == (6, 1.5, "a machine")
    if trained.metrics:
        assert (record["validation_mae_deg"], record["validation_rank_correlation"]) == (12.346, 0.71)
    else:
        assert (record["validation_mae_deg"], record["validation_rank_correlation"]) == (None, None)


def test_a_file_that_differs_from_the_network_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trained, made = untrained("psfcn"), export.onnx_of

    def wrong(network: Network) -> Any:
        model = made(network)
        weight = model.graph.initializer[0]
        values = onnx.numpy_helper.to_array(weight) * 1.5
        weight.CopyFrom(onnx.numpy_helper.from_array(values, weight.name))
        return model

    monkeypatch.setattr(export, "onnx_of", wrong)
    with pytest.raises(InputError, match="the exported model differs from the trained by"):
        export_onnx(trained, tmp_path / "model.onnx")
    assert not list(tmp_path.iterdir())


def test_weights_that_are_no_numbers_are_not_exported(tmp_path: Path) -> None:
    trained = untrained("demultiplexer")
    torch.nn.init.constant_(next(trained.network.parameters()), float("nan"))
    with pytest.raises(InputError, match="not finite"):
        export_onnx(replace(trained, metrics=None), tmp_path / "model.onnx")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_an_exported_network_can_be_trained_further(name: str, models: dict[str, tuple[Trained, Path]]) -> None:
    """Batch norms that export folded away are put back: the network answers as the file does, also while it learns."""
    path = models[name][1]
    network = build_network(name, SMALL[name])
    given = inputs_of(network, 8, *((network.patch,) * 2 if network.kind == "patch" else (64, 64)))
    exported = read_exported(path)
    load_exported_weights(network, exported, tuple(map(torch.from_numpy, given.values())))
    assert network.training and exported.step == 6
    for layer in network.modules():
        if isinstance(layer, torch.nn.Dropout):
            layer.p = 0.0
    expected = OnnxModel(path).session.run(None, given)[0]
    for training in (False, True):  # no map changes its place as the network learns
        network.train(training)
        with torch.no_grad():
            answer = network(*map(torch.from_numpy, given.values())).normals.numpy()
        np.testing.assert_allclose(answer, expected, atol=1e-3)


def test_weights_of_another_network_are_refused(models: dict[str, tuple[Trained, Path]]) -> None:
    network = build_network("psfcn", SMALL["psfcn"])
    inputs = tuple(map(torch.from_numpy, inputs_of(network, 2, 64, 64).values()))
    with pytest.raises(InputError, match="is not of the recipe's network; resume from another"):
        load_exported_weights(network, read_exported(models["multiscale"][1]), inputs)
