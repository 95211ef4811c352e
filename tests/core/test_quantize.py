"""The int8 version of a model: what is in eight bits, what is not, and that it answers as the model does."""

import json
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")

import onnx
from conftest import Mpsnet
from small_networks import SMALL, recipe_data
from sphere_sample import RED, sphere_sample
from synthetic import degrees_between, listing, shaded_sphere

from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.estimate.card import TRAINING_KEY
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.learning.training.export import export_onnx
from mpsnet_core.learning.training.loop import Trained
from mpsnet_core.learning.training.networks import Network, build_network
from mpsnet_core.learning.training.packed import PackedSamples
from mpsnet_core.learning.training.photo_simulation import PhotoSimulator
from mpsnet_core.learning.training.quantize import CROP, SEED, QuantizationErrors, quantise
from mpsnet_core.learning.training.recipe import recipe_from_data
from mpsnet_core.learning.training.validation import validation_errors
from mpsnet_core.synthesis.job import sample_path
from mpsnet_core.synthesis.sample import write_sample

pytestmark = pytest.mark.long

OPTIONS = {**SMALL, "multiscale": {"widths": [8, 8, 8, 8]}}


def untrained(name: str) -> Network:
    torch.manual_seed(2)
    network = build_network(name, OPTIONS[name])
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.normal_(module.bias, std=0.2)
    return network.eval()


def exported(name: str, path: Path) -> Path:
    recipe = recipe_from_data(recipe_data(name, options=OPTIONS[name]))
    export_onnx(Trained(untrained(name), recipe, 6, 90.0, None, 2, "", "a machine", "float32"), path)
    return path


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("samples")
    for number, left in enumerate(((0.6, 0.6, 0.6), (0.2, 0.5, 0.3))):
        write_sample(sample_path(folder, number), sphere_sample(48, left=left, right=RED, number=number))
    return folder


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported("multiscale", tmp_path_factory.mktemp("model") / "multiscale.onnx")


@pytest.fixture(scope="module")
def made(model: Path, samples: Path) -> tuple[Path, QuantizationErrors]:
    path = model.with_name("int8.onnx")
    return path, quantise(model, [samples], path, count=3)


def convolutions(path: Path) -> dict[str, np.ndarray]:
    """The weights of each convolution, as they are stored: by the name of its node."""
    graph = onnx.load(path).graph
    stored = {value.name: onnx.numpy_helper.to_array(value) for value in graph.initializer}
    behind = {node.output[0]: node.input[0] for node in graph.node if node.op_type == "DequantizeLinear"}
    return {
        node.name: stored[behind.get(node.input[1], node.input[1])] for node in graph.node if node.op_type == "Conv"
    }


def test_all_but_the_ends_and_the_lights_is_in_eight_bits(model: Path, made: tuple[Path, QuantizationErrors]) -> None:
    before, after = convolutions(model), convolutions(made[0])
    assert before.keys() == after.keys()
    plain = {name for name, weights in after.items() if weights.dtype == np.float32}
    lights = {name for name in before if "/rig/" in name or "/told/" in name}
    assert len(lights) == 5
    # What sees the picture's own values, at both ends of the U-Net, and what says directions.
    own = {name for name in before if name.startswith(("/down1/shrink/", "/joined/", "/answer/"))}
    assert plain == {*lights, *own} and len(before) - len(plain) == 21
    for name in before.keys() - plain:
        assert after[name].dtype == np.int8
        assert np.abs(after[name].astype(int)).max() in (63, 64), "seven bits"
        # Every map has a scale of its own: the largest weight of each is the largest there is.
        assert (np.abs(after[name].astype(int)).reshape(len(after[name]), -1).max(axis=1) >= 62).all()


def test_the_formula_s_arithmetic_is_not(made: tuple[Path, QuantizationErrors]) -> None:
    graph = onnx.load(made[0]).graph
    rounded = {node.output[0] for node in graph.node if node.op_type == "DequantizeLinear"}
    arithmetic = {"Mul", "Div", "Sqrt", "Log", "Exp", "Tanh", "Sigmoid", "Softplus", "Reciprocal"}
    seen = {node.op_type for node in graph.node if node.op_type in arithmetic and rounded & set(node.input)}
    assert seen <= {"Mul"}, "the rig's scale and shift take what convolutions in eight bits give"


def test_the_twin_answers_as_the_model_does(model: Path, made: tuple[Path, QuantizationErrors]) -> None:
    float32, int8, sphere = OnnxModel(model), OnnxModel(made[0]), shaded_sphere(50)
    for image in (sphere.image, sphere.image * np.float32([0.5, 1, 2])):
        expected, found = float32(sphere.capture(image=image)), int8(sphere.capture(image=image))
        off = degrees_between(found.vectors, expected.vectors)[sphere.mask]
        assert 0 < off.mean() < 1
        assert np.abs(found.confidence - expected.confidence)[sphere.mask].mean() < 0.02


def test_the_twin_says_what_it_is(model: Path, made: tuple[Path, QuantizationErrors]) -> None:
    before, after = OnnxModel(model).card, OnnxModel(made[0]).card
    assert after.name == "tiny-int8"
    assert {**after.__dict__, "name": "tiny"} == before.__dict__
    records = [
        json.loads({entry.key: entry.value for entry in onnx.load(path).metadata_props}[TRAINING_KEY])
        for path in (model, made[0])
    ]
    told = records[1].pop("int8")
    assert records[0] == records[1]
    assert (told["of"], told["photographs"]) == ("tiny", 3)
    assert told["mae_deg"] == pytest.approx(made[1].mae_deg, abs=1e-3)
    assert told["mae_deg_of_model"] == pytest.approx(made[1].model_mae_deg, abs=1e-3)


def test_what_it_costs_is_measured_on_photographs_that_did_not_calibrate(
    model: Path, made: tuple[Path, QuantizationErrors], samples: Path
) -> None:
    """The model's part of it; on all scales, each with the model's own answer on the scale before."""
    network, simulator = untrained("multiscale"), PhotoSimulator(PackedSamples([samples]), seed=SEED, window=CROP)
    with torch.no_grad():
        # Three of two samples calibrated: epochs 0 and 1.
        found = [validation_errors(network, network.inputs, simulator.batch(number, 1)) for number in (4, 5, 6)]
    errors = np.concatenate([missed for scales in found for missed, _ in scales])
    assert errors.mean(dtype=float) == pytest.approx(made[1].model_mae_deg, abs=1e-2)
    assert 0 < abs(made[1].mae_deg - made[1].model_mae_deg) < 0.5


def test_the_command_reports_what_it_costs(mpsnet: Mpsnet, model: Path, samples: Path, tmp_path: Path) -> None:
    path = tmp_path / "twin.onnx"
    done = mpsnet("quantize", model, "--samples", samples, "--count", "2", "-o", path)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"wrote {path}: ") and "° on the samples, the model itself " in done.stdout
    assert listing(tmp_path) == ["twin.onnx"]


def test_who_stops_it_finds_nothing(model: Path, samples: Path, tmp_path: Path) -> None:
    def stop(fraction: float, message: str) -> None:
        if fraction > 0.5:
            raise Cancelled

    with pytest.raises(Cancelled):
        quantise(model, [samples], tmp_path / "twin.onnx", count=2, progress=stop)
    assert not listing(tmp_path)


def test_what_has_no_int8_version_is_reported(
    made: tuple[Path, QuantizationErrors], model: Path, samples: Path, tmp_path: Path
) -> None:
    out = tmp_path / "twin.onnx"
    with pytest.raises(InputError, match="quantized to int8 already; give the model that it was made from"):
        quantise(made[0], [samples], out)
    with pytest.raises(InputError, match="works patch by patch; only those that do not have int8 versions"):
        quantise(exported("mpsnet", tmp_path / "mpsnet.onnx"), [samples], out)
    with pytest.raises(InputError, match=r"folder of samples .* does not exist"):
        quantise(model, [tmp_path / "no"], out)
    elsewhere = onnx.load(model)
    weights = elsewhere.graph.initializer.add(name="unused", data_type=1, dims=[4], data_location=1)
    weights.external_data.add(key="location", value="/dev/zero")
    (tmp_path / "elsewhere.onnx").write_bytes(elsewhere.SerializeToString())
    with pytest.raises(InputError, match=r"elsewhere.onnx has weights in another file"):
        quantise(tmp_path / "elsewhere.onnx", [samples], out)
    assert listing(tmp_path) == ["elsewhere.onnx", "mpsnet.onnx"]
