"""examples/average_networks.py: the mean of networks' weights, and the record of how it came about."""

import json
from pathlib import Path

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")

from average_networks import average
from onnx import numpy_helper

from mpsnet_core.estimate.card import CARD_KEY, TRAINING_KEY
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.estimate.registry import find_network


def scaled(factor: float) -> "onnx.ModelProto":
    """The default with all its weights times a factor."""
    model = onnx.load(str(find_network("multiscale").path))
    for one in model.graph.initializer:
        values = numpy_helper.to_array(one)
        if values.dtype.kind == "f":
            one.CopyFrom(numpy_helper.from_array(values * np.float32(factor), one.name))
    return model


def test_the_mean_of_weights_by_their_shares(tmp_path: Path) -> None:
    mean, expected = average([scaled(1), scaled(5)], [0.25, 0.75]), scaled(4)
    for one, other in zip(mean.graph.initializer, expected.graph.initializer, strict=True):
        np.testing.assert_allclose(numpy_helper.to_array(one), numpy_helper.to_array(other), rtol=1e-6)
    onnx.save(mean, str(tmp_path / "mean.onnx"))
    record = OnnxModel(tmp_path / "mean.onnx").record
    assert record and [leg["share"] for leg in record["mean_of"]] == [0.25, 0.75]


def test_a_networks_own_errors_are_not_those_of_the_mean() -> None:
    psfcn = onnx.load(str(find_network("psfcn").path))
    entry = next(entry for entry in psfcn.metadata_props if entry.key == TRAINING_KEY)
    entry.value = json.dumps(json.loads(entry.value) | {"validation_mae_deg": 11.3})
    record = {entry.key: entry.value for entry in average([psfcn, psfcn], [0.5, 0.5]).metadata_props}[TRAINING_KEY]
    assert json.loads(record)["validation_mae_deg"] is None


def test_cards_may_leave_out_what_has_a_default() -> None:
    network = find_network("psfcn")
    first, older = onnx.load(str(network.path)), onnx.load(str(network.path))
    for model, magnified in ((first, {"magnified": 1.0}), (older, {})):
        card = next(entry for entry in model.metadata_props if entry.key == CARD_KEY)
        stated = json.loads(card.value)
        stated.pop("magnified", None)
        card.value = json.dumps(stated | magnified)
    average([first, older], [0.5, 0.5])


def test_the_shipped_default_says_what_it_is_the_mean_of() -> None:
    own = {entry.key: entry.value for entry in scaled(1).metadata_props}
    legs = json.loads(own[TRAINING_KEY])["mean_of"]
    assert sum(leg["share"] for leg in legs) == pytest.approx(1) and len({leg["seed"] for leg in legs}) == len(legs)


def test_other_networks_and_shares_are_refused() -> None:
    with pytest.raises(SystemExit, match="sum of 0\\.9"):
        average([scaled(1), scaled(1)], [0.5, 0.4])
    other = scaled(1)
    del other.graph.initializer[0]
    with pytest.raises(SystemExit, match="different networks"):
        average([scaled(1), other], [0.5, 0.5])
