"""examples/average_networks.py: the mean of networks' weights, and the record of how it came about."""

from pathlib import Path

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")

from average_networks import average
from onnx import numpy_helper

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


def test_other_networks_and_shares_are_refused() -> None:
    with pytest.raises(SystemExit, match="sum of 0\\.9"):
        average([scaled(1), scaled(1)], [0.5, 0.4])
    other = scaled(1)
    del other.graph.initializer[0]
    with pytest.raises(SystemExit, match="different networks"):
        average([scaled(1), other], [0.5, 0.5])
