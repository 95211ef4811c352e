"""The ONNX path with networks whose answer is known. And files that are refused."""

import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
from bad_input import SPHERE, Bench, gets_one_clear_sentence
from networks import DENSE, card, conv, pass_through, random_weights, write_model
from onnx import TensorProto, helper, numpy_helper
from synthetic import Sphere, listing, shaded_sphere

from mpsnet_core import Capture, InputError, estimate_normals
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.estimate.card import CARD_VERSION
from mpsnet_core.estimate.dense import PATCHES_A_BATCH
from mpsnet_core.estimate.features import feature_maps
from mpsnet_core.estimate.onnx_model import OnnxModel


@pytest.fixture(scope="module")
def odd() -> Capture:
    """A capture whose mask is an ellipse with ragged edges, odd in size and away from the image's corner."""
    y, x = np.mgrid[:173, :211]
    mask = ((x - 107) / 88) ** 2 + ((y - 82) / 66) ** 2 < 1
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    assert (len(rows) % 2, len(columns) % 2, rows[0] > 0, columns[0] > 0) == (1, 1, True, True)
    random = np.random.default_rng(5)
    return Capture(random.random((173, 211, 3)), mask & (random.random(mask.shape) < 0.98), shaded_sphere(8).rig)


def difference(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.abs(a - b).max())


def test_onnxruntime_says_nothing_of_a_graph_whose_names_are_no_text(tmp_path, capfd) -> None:
    path = tmp_path / "net.onnx"
    pass_through(path)
    path.write_bytes(path.read_bytes().replace(b"normals", b"normal\x80"))
    with pytest.raises(InputError, match="cannot be used"):
        OnnxModel(path)
    assert capfd.readouterr() == ("", "")


def test_passing_the_initial_normals_through_is_the_lambertian_baseline(tmp_path: Path, sphere: Sphere) -> None:
    network = estimate_normals(sphere.capture(), pass_through(tmp_path / "identity.onnx"))
    baseline = estimate_normals(sphere.capture(), "lambertian")
    assert difference(network.vectors, baseline.vectors) < 1e-6
    np.testing.assert_array_equal(network.mask, baseline.mask)
    np.testing.assert_array_equal(network.confidence, sphere.mask)


def plain(path: Path, halo: int) -> Path:
    """A 3x3 and a 5x5 convolution: an output pixel sees three pixels around it."""
    weights = random_weights(1, a=(8, 6, 3, 3), b=(3, 8, 5, 5))
    nodes = [
        conv("x", "h", "a", pads=[1] * 4),
        helper.make_node("Relu", ["h"], ["r"]),
        conv("r", "normals", "b", pads=[2] * 4),
    ]
    seen = card(inputs={"x": ("photo", "initial_normals_grey_world")}, halo=halo)
    return write_model(path, nodes, weights, seen, inputs={"x": ("n", 6, "h", "w")})


def pooled(path: Path, halo: int) -> Path:
    """Twice pooled and brought back by interpolation, with 3x3 and 5x5 convolutions between.

    Around an output pixel: 1 for the last 3x3, 5 for the interpolation, 2 · 4 for the 5x5 at a quarter of the size, 1
    for the first 3x3; 15, so 16 on the grain of 4.
    """
    weights = random_weights(2, a=(8, 3, 3, 3), b=(8, 8, 5, 5), c=(3, 8, 3, 3))
    nodes = [
        conv("x", "h1", "a", pads=[1] * 4),
        helper.make_node("MaxPool", ["h1"], ["h2"], kernel_shape=[2, 2], strides=[2, 2]),
        helper.make_node("AveragePool", ["h2"], ["h3"], kernel_shape=[2, 2], strides=[2, 2]),
        conv("h3", "h4", "b", pads=[2] * 4),
        helper.make_node("Resize", ["h4", "", "s"], ["h5"], mode="linear", coordinate_transformation_mode="half_pixel"),
        conv("h5", "normals", "c", pads=[1] * 4),
    ]
    weights["s"] = np.float32([1, 1, 4, 4])
    return write_model(path, nodes, weights, card(halo=halo, multiple=4))


# Network and its halo.
NETWORKS = [pytest.param(plain, 3, id="plain"), pytest.param(pooled, 16, id="pooled")]


@pytest.mark.parametrize(("network", "halo"), NETWORKS)
def test_tiled_and_untiled_agree(tmp_path: Path, odd: Capture, network, halo: int) -> None:
    untiled, tiled = (estimate_normals(odd, network(tmp_path / "n.onnx", halo), tile=tile) for tile in (1024, 64))
    assert difference(tiled.vectors, untiled.vectors) < 1e-4
    assert np.ptp(untiled.vectors[odd.mask], axis=0).min() > 0.1


def test_patches_are_centred_and_zero_outside_the_mask(tmp_path: Path) -> None:
    """Against loops over every pixel; more pixels than one batch holds."""
    capture, side = shaded_sphere(49).capture(), 5
    assert capture.mask.sum() > PATCHES_A_BATCH
    weights = random_weights(3, w=(3, 7, side, side))
    nodes = [conv("x", "h", "w"), helper.make_node("Flatten", ["h"], ["normals"])]
    features = ("initial_normals", "photo", "mask")
    model = write_model(
        tmp_path / "patch.onnx",
        nodes,
        weights,
        card(kind="patch", patch=side, inputs={"x": features}),
        inputs={"x": ("n", 7, side, side)},
        outputs={"normals": ("n", 3)},
    )
    maps = feature_maps(capture, features)
    seen = np.pad(np.concatenate([maps[name] for name in features]), [(0, 0), (2, 2), (2, 2)]).astype(float)
    expected = np.zeros((*capture.mask.shape, 3))
    for y, x in np.argwhere(capture.mask):
        patch = seen[:, y : y + side, x : x + side]
        expected[y, x] = [(kernel * patch).sum() for kernel in weights["w"]]
        expected[y, x] /= np.linalg.norm(expected[y, x])
    assert difference(estimate_normals(capture, model).vectors, expected) < 1e-4


@pytest.mark.parametrize("kind", ["dense", "patch"])
def test_confidence_is_the_networks_own_where_it_gives_one(tmp_path: Path, sphere: Sphere, kind: str) -> None:
    side = 1 if kind == "patch" else None
    pick = np.float32([[[[0.7]], [[0]], [[0]]]])
    model = write_model(
        tmp_path / "two.onnx",
        [conv("x", "normals", "w"), conv("light", "confidence", "p")],
        {"w": np.eye(3, dtype=np.float32)[..., None, None], "p": pick},
        card(kind=kind, inputs={"x": ("initial_normals",), "light": ("photo",)}),
        inputs={"x": ("n", 3, side, side), "light": ("n", 3, side, side)},
        outputs={"confidence": ("n", 1, side, side), "normals": ("n", 3, side, side)},
    )
    normals = estimate_normals(sphere.capture(), model, tile=64)
    red = 0.7 * sphere.image[..., 0] / sphere.image[sphere.mask].mean()
    assert red.max() > 1 > red[sphere.mask].min()
    np.testing.assert_allclose(normals.confidence, np.where(sphere.mask, np.clip(red, 0, 1), 0), atol=1e-5)
    assert difference(normals.vectors, estimate_normals(sphere.capture(), "lambertian").vectors) < 1e-6


def test_what_the_photo_holds_outside_the_mask_does_not_matter(tmp_path: Path, odd: Capture) -> None:
    model = plain(tmp_path / "n.onnx", 3)
    loud = np.where(odd.mask[..., None], odd.image, np.nan)
    again = estimate_normals(Capture(loud, odd.mask, odd.rig), model)
    np.testing.assert_array_equal(again.vectors, estimate_normals(odd, model).vectors)


@pytest.mark.parametrize(
    ("asked", "full_name"),
    [("cuda", "CUDAExecutionProvider"), ("directml", "DmlExecutionProvider"), ("coreml", "CoreMLExecutionProvider")],
)
def test_a_provider_that_is_not_there_is_refused_with_those_that_are(tmp_path, asked: str, full_name: str) -> None:
    if full_name in onnxruntime.get_available_providers():
        pytest.skip(f"this onnxruntime has {full_name}")
    with pytest.raises(InputError, match=f"provider '{asked}' is not in this onnxruntime; choose .*cpu"):
        OnnxModel(pass_through(tmp_path / "identity.onnx"), provider=asked)


@pytest.mark.parametrize("kind", ["dense", "patch"])
def test_lights_reach_the_network_as_one_pixel(tmp_path: Path, odd: Capture, kind: str) -> None:
    """A network that adds the second light's direction to the initial normals."""
    side = 1 if kind == "patch" else None
    nodes = [
        helper.make_node("Slice", ["lights", "three", "six", "axis"], ["second"]),
        helper.make_node("Add", ["x", "second"], ["normals"]),
    ]
    weights = {"three": np.int64([3]), "six": np.int64([6]), "axis": np.int64([1])}
    model = write_model(
        tmp_path / "lights.onnx",
        nodes,
        weights,
        card(kind=kind, inputs={"x": ("initial_normals",), "lights": ("lights",)}),
        inputs={"x": ("n", 3, side, side), "lights": ("n", 9, 1, 1)},
        outputs={"normals": ("n", 3, side, side)},
    )
    expected = normalised(estimate_normals(odd, "lambertian").vectors + odd.rig.directions[1].astype(np.float32))
    given = estimate_normals(odd, model, tile=64).vectors
    assert difference(given[odd.mask], expected[odd.mask]) < 1e-5


def dense(output: str = "normals", **changes: Any) -> Callable[[Path], Path]:
    """A one-convolution network with something wrong in it."""
    count, shape = changes.pop("channels", 3), changes.pop("shape", DENSE)
    weights = random_weights(0, w=(changes.pop("answers", 3), count, 1, 1))
    nodes = changes.pop("nodes", [conv("x", output, "w")])
    model_card = changes.pop("card", card())

    def write(path: Path) -> Path:
        inputs, outputs = {"x": shape}, {output: (None,) * 4}
        return write_model(path, nodes, weights, model_card, inputs=inputs, outputs=outputs, **changes)

    return write


def use(model: Callable[[Path], Path]) -> Callable[[Bench], Any]:
    return lambda b: estimate_normals(SPHERE.capture(), model(b / "m.onnx"))


def card_with(**changes: Any) -> Callable[[Bench], Any]:
    """The good card's text with some values changed; None takes a key out."""
    data = json.loads(card().to_json()) | changes
    return use(dense(card={key: value for key, value in data.items() if value is not None}))


BODY = helper.make_graph(
    [helper.make_node("Identity", ["in"], ["more"]), helper.make_node("Identity", ["of_loop"], ["out"])],
    "endless",
    [
        helper.make_tensor_value_info("turn", TensorProto.INT64, []),
        helper.make_tensor_value_info("in", TensorProto.BOOL, []),
        helper.make_tensor_value_info("of_loop", TensorProto.FLOAT, None),
    ],
    [
        helper.make_tensor_value_info("more", TensorProto.BOOL, []),
        helper.make_tensor_value_info("out", TensorProto.FLOAT, None),
    ],
)
ENDLESS = [
    helper.make_node("Constant", [], ["yes"], value=helper.make_tensor("v", TensorProto.BOOL, [], [True])),
    helper.make_node("Loop", ["", "yes", "x"], ["normals"], body=BODY),
]
# One number of 2^40.
MOSTLY_ZERO = helper.make_sparse_tensor(
    helper.make_tensor("few", TensorProto.FLOAT, [1], [1.0]),
    helper.make_tensor("at", TensorProto.INT64, [1], [0]),
    [1 << 40],
)


def own_operator(path: Path) -> Path:
    """A network whose "Relu" is of its own making."""
    model = onnx.load(pass_through(path))
    inner = [helper.make_node("Identity", ["a"], ["b"])]
    model.functions.append(helper.make_function("", "Relu", ["a"], ["b"], inner, model.opset_import))
    onnx.save(model, path)
    return path


test_a_bad_network_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("an endless loop", use(dense(nodes=ENDLESS)), 'm.onnx has the operator "Loop"'),
        (
            "operators of another domain",
            use(dense(nodes=[helper.make_node("Identity", ["x"], ["normals"], domain="com.microsoft")])),
            'm.onnx has operators of "com.microsoft"',
        ),
        ("operators of its own", use(own_operator), "m.onnx has functions of its own"),
        (
            "a constant of any size",
            use(dense(nodes=[helper.make_node("Constant", [], ["normals"], sparse_value=MOSTLY_ZERO)])),
            "m.onnx has sparse weights",
        ),
        (
            "32 GiB of ones",
            use(
                dense(
                    nodes=[
                        helper.make_node("Constant", [], ["k"], value_ints=[1 << 33]),
                        helper.make_node("ConstantOfShape", ["k"], ["ones"]),
                        helper.make_node("ReduceSum", ["ones"], ["sum"]),
                        helper.make_node("Add", ["x", "sum"], ["normals"]),
                    ]
                )
            ),
            "m.onnx failed on x (1, 3, 16, 16): it needs more memory than there is, or than…GiB; use smaller tiles",
        ),
        (
            "a card that is no UTF-8",
            lambda b: b.run("models", b.replaced(pass_through(b / "m.onnx"), b'"licence"', b'"lic\xff\xfece"')),
            "m.onnx cannot be used: its metadata are not UTF-8 text; export it again",
        ),
        ("unknown name", lambda b: estimate_normals(SPHERE.capture(), "mpsnet9"), "no model 'mpsnet9'"),
        (lambda b: estimate_normals(SPHERE.capture(), b.bytes("m.onnx", bytes(range(256)))), "no ONNX model"),
        ("no card", use(dense(card=None)), "m.onnx…no card (metadata 'mpsnet.card')"),
        ("card not JSON", use(dense(card="{")), "m.onnx…card…not valid JSON"),
        ("card of a newer version", card_with(version=CARD_VERSION + 1), "version 2, this program reads version 1"),
        ("card without a licence", card_with(licence=None), 'm.onnx…card lacks "licence"'),
        ("card with an unknown kind", card_with(kind="sparse"), "m.onnx…\"kind\" is 'sparse'"),
        ("card with an unknown feature", card_with(inputs={"x": ["depth"]}), "m.onnx…requests 'depth'"),
        ("card that stacks the lights with maps", card_with(inputs={"x": ["photo", "lights"]}), "card stacks lights"),
        ("card without features", card_with(inputs={"x": []}), "m.onnx…no list of features for input 'x'"),
        ("card with a negative halo", card_with(halo=-1), 'm.onnx…"halo" is -1; expected a whole number from 0'),
        ("card with an even patch", card_with(kind="patch", patch=4), 'm.onnx…"patch" is 4; expected an odd number'),
        ("card with an unknown frame", card_with(frame="world"), "m.onnx…\"frame\" is 'world'"),
        ("a dense network that magnifies", card_with(magnified=2.0), '"magnified" needs the "kind" "pyramid", not'),
        ("a magnification beyond memory", card_with(kind="pyramid", magnified=1e6), 'm.onnx…"magnified" is 1000000.0'),
        ("three passes in the camera's frame", card_with(passes=3), '"passes" is 3, which needs the "frame"'),
        ("card with other inputs", card_with(inputs={"y": ["photo"]}), "m.onnx…inputs ['x'], its card describes ['y']"),
        ("wrong channel count", use(dense(channels=4, shape=("n", 4, "h", "w"))), "not tensor(float) ['any', 3"),
        ("fixed size", use(dense(shape=("n", 3, 64, 64))), "m.onnx…64, 64]…export it so"),
        ("a patch of another size", use(dense(shape=("n", 3, 7, 7), card=card(kind="patch", patch=5))), "m.onnx…7, 7]"),
        ("no output called normals", use(dense("depth")), 'm.onnx…no output called "normals"'),
        ("four channels out", use(dense(answers=4)), 'm.onnx…"normals" is (1, 4,…expected (1, 3,'),
        (
            "patches that give too much",
            use(lambda path: pass_through(path, card(kind="patch", patch=3), inputs={"x": ("n", 3, 3, 3)})),
            'm.onnx…"normals" is (128, 3, 3, 3), expected (128, 3)',
        ),
        (
            "NaN out",
            use(
                dense(
                    nodes=[
                        conv("x", "h", "w"),
                        helper.make_node("Sub", ["h", "h"], ["z"]),
                        helper.make_node("Div", ["z", "z"], ["normals"]),
                    ]
                )
            ),
            "m.onnx returned values that are not finite",
        ),
        (
            "confidence of another shape",
            use(
                lambda path: write_model(
                    path,
                    [
                        helper.make_node("Identity", ["x"], ["normals"]),
                        helper.make_node("Identity", ["x"], ["confidence"]),
                    ],
                    {},
                    card(),
                    outputs={"normals": DENSE, "confidence": DENSE},
                )
            ),
            'm.onnx…"confidence" is (1, 3, 16, 16), expected (1, 1, 16, 16)',
        ),
        (lambda b: estimate_normals(SPHERE.capture(), pass_through(b / "m.onnx"), tile=8), "tile of 8 pixels is too"),
        (lambda b: estimate_normals(SPHERE.capture(), pass_through(b / "m.onnx"), threads=-1), "-1 threads is out of"),
    ]
)


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="/proc")
@pytest.mark.parametrize("constant", [True, False], ids=["while it is opened", "while it runs"])
def test_a_network_that_takes_minutes_hears_signals(photo_file: Path, rig_file: Path, tmp_path: Path, constant: bool):
    """A few bytes that ask for a product of two large matrices."""
    nodes = [
        helper.make_node("ReduceMean", ["x"], ["mean"], keepdims=0),
        helper.make_node("ConstantOfShape", ["side"], ["ones"], value=numpy_helper.from_array(np.ones(1, np.float32))),
        helper.make_node("Identity" if constant else "Mul", ["ones"] if constant else ["ones", "mean"], ["one"]),
        helper.make_node("MatMul", ["one", "ones"], ["product"]),
        helper.make_node("ReduceMean", ["product"], ["level"], keepdims=0),
        helper.make_node("Mul", ["x", "level"], ["normals"]),
    ]
    slow = write_model(tmp_path / "slow.onnx", nodes, {"side": np.array([12_000, 12_000])}, card())
    line = ["estimate", photo_file, "--rig", rig_file, "--model", slow, "-o", tmp_path / "o.png", "--threads", "1"]
    import resource  # which Windows lacks

    child = subprocess.Popen([sys.executable, "-m", "mpsnet_core", *map(str, line)])
    while int(Path(f"/proc/{child.pid}/statm").read_text().split()[1]) < 1e9 / resource.getpagesize():  # the matrices
        assert child.poll() is None
        time.sleep(0.1)
    child.terminate()
    assert child.wait(20) == 130
    assert listing(tmp_path) == sorted([photo_file.name, rig_file.name, slow.name])


# A signal that comes while the thread starts; exit code 3 would unload the libraries under it.
STOPPED_AT_THE_START = """
import sys, threading, time
from mpsnet_core.estimate import onnx_model
class Thread(threading.Thread):
    def start(self):
        super().start()
        raise KeyboardInterrupt
threading.Thread = Thread
try:
    onnx_model._in_a_thread(lambda: time.sleep(60))
except KeyboardInterrupt:
    sys.exit(3)
"""


def test_a_run_that_is_stopped_while_its_thread_starts_does_not_unload_the_libraries_under_it() -> None:
    assert subprocess.run([sys.executable, "-c", STOPPED_AT_THE_START], timeout=60).returncode == 130
