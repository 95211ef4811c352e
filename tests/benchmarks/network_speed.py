"""How quick the default network is beside the published ones, and beside a plain matrix product.

python tests/benchmarks/network_speed.py [--rounds 3] [--patches 64] [--large]

All on the same cores, in turns, on an object that fills 512 x 512 pixels, in processor time, which tells more where
other programs run. The default is also timed under lights that stand at other angles. PS-FCN and MPS-Net have their
published widths and fresh weights (which do not change the time). MPS-Net is timed on a few patches and multiplied,
also as it is shipped, and beside that with its layers as they stand.
--large measures the peak memory of `mpsnet estimate` on photos of 16, 36 and 100 megapixels, too.
Needs torch and onnx (pip install '.[train]').
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import mpsnet_core  # noqa: F401 - before onnxruntime, which sends telemetry otherwise

# isort: split
import onnx
import onnxruntime
from memory import peak_of_estimate
from onnx import TensorProto, helper

from mpsnet_core import Capture, LightRig, published_rig, write_image, write_rig
from mpsnet_core.estimate.card import CARD_KEY
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.estimate.onnx_model import OnnxModel
from mpsnet_core.estimate.registry import find_network
from mpsnet_core.learning.training.export import card_of, onnx_of
from mpsnet_core.learning.training.networks import Network, build_network

THREADS, SIDE, LARGE = 1, 512, (4096, 6000, 10_000)
# Degrees of the first light in the picture, which stands straight up (90) in what the networks see.
TILTS = (20, 57, 135, 250)


def fresh(network: Network, path: Path) -> Path:
    """The ONNX file of a network with random weights."""
    model = onnx_of(network.eval())
    helper.set_model_props(model, {CARD_KEY: card_of(network, path.stem).to_json()})
    onnx.save(model, path)
    return path


def multiply_adds(path: Path, side: int) -> int:
    """Of one run on side x side pixels: its convolutions, whose maps are looked at as they run."""
    model = onnx.load(path)
    shapes = {weight.name: list(weight.dims) for weight in model.graph.initializer}
    layers = [node for node in model.graph.node if node.op_type in ("Conv", "ConvTranspose")]
    # Every pixel of the convolution's small side meets every weight but those of the channels on that side.
    small = {node.output[0]: node.output[0] if node.op_type == "Conv" else node.input[0] for node in layers}
    told = {value.name for value in model.graph.output}
    model.graph.output.extend(onnx.ValueInfoProto(name=name) for name in small.values() if name not in told)
    run = session(model.SerializeToString())
    given = {
        value.name: np.ones(
            [
                size if isinstance(size, int) else wanted
                for size, wanted in zip(value.shape, (1, 0, side, side), strict=True)
            ],
            np.float32,
        )
        for value in run.get_inputs()
    }
    names = list(dict.fromkeys(small.values()))
    sizes = {name: found.shape for name, found in zip(names, run.run(names, given), strict=True)}
    return sum(int(np.prod(sizes[small[node.output[0]]])) * int(np.prod(shapes[node.input[1]][1:])) for node in layers)


def session(model: bytes | str) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = THREADS
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def matrix_product() -> Callable[[], object]:
    side = 1024
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, (side, side)) for name in "abc"]
    graph = helper.make_graph([helper.make_node("MatMul", ["a", "b"], ["c"])], "product", values[:2], values[2:])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    run = session(model.SerializeToString())
    given = {name: np.random.default_rng(0).random((side, side), np.float32) for name in "ab"}
    return lambda: run.run(None, given)


def alone(path: Path) -> Callable[[], object]:
    """The network without what the program does around it."""
    run = session(str(path))
    random = np.random.default_rng(0)
    given = {}
    for value in run.get_inputs():
        size = [SIDE if isinstance(length, str) else length for length in value.shape[2:]]
        given[value.name] = random.random((1, value.shape[1], *size), np.float32)
    return lambda: run.run(None, given)


def capture(side: int, rig: LightRig) -> Capture:
    random = np.random.default_rng(1)
    return Capture(random.random((side, side, 3), np.float32) + 0.1, np.ones((side, side), bool), rig)


def painted(colours: int) -> Capture:
    """A matt sphere under the published rig, in squares of so many paints."""
    rows, columns = np.mgrid[:SIDE, :SIDE]
    x, y = 2 * (columns + 0.5) / SIDE - 1, 1 - 2 * (rows + 0.5) / SIDE
    mask, paints = x**2 + y**2 < 0.99, np.random.default_rng(3).uniform(0.05, 0.8, (colours, 3))
    normals = np.stack([x, y, np.sqrt(np.maximum(1 - x**2 - y**2, 0))], axis=-1)
    light = np.maximum(normals @ published_rig().directions.T, 0)
    return Capture(paints[(rows // 40 + 2 * (columns // 40)) % colours] * light, mask, published_rig())


def peak_memory(side: int, model: Path, rig: LightRig, folder: Path) -> float:
    """Megabytes (10^6 bytes) that `mpsnet estimate` takes at most."""
    write_image(folder / "large.png", capture(side, rig).image)
    write_rig(folder / "rig.json", rig)
    outputs = ["--confidence", folder / "c.png", "-o", folder / "n.png"]
    return peak_of_estimate(
        folder / "large.png", "--rig", folder / "rig.json", "--mask", "none", "--model", model, *outputs
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the networks beside each other.")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--patches", type=int, default=64, help="how many MPS-Net is timed on")
    parser.add_argument("--large", action="store_true", help="also measure the peak memory on large photos")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        ours = find_network("multiscale").path
        few = round(arguments.patches**0.5)
        shipped = OnnxModel(find_network("mpsnet").path).record["recipe"]["options"]
        up, odd = published_rig(), {tilt: published_rig(first_tilt=tilt) for tilt in TILTS}
        models = {
            name: Estimator(path, threads=THREADS)
            for name, path in (
                ("default", ours),  # one pass, as sequences have
                ("psfcn", fresh(build_network("psfcn"), folder / "psfcn.onnx")),
                ("mpsnet", find_network("mpsnet").path),
                ("mpsnet, its layers as they stand", fresh(build_network("mpsnet", shipped), folder / "layers.onnx")),
            )
        }
        whole, part = capture(SIDE, up), capture(few, up)
        cases: dict[str, tuple[Callable[[], object], float]] = {
            "default": (lambda: models["default"](whole), 1),
            **{
                f"default, lights at {tilt}°": (partial(models["default"], capture(SIDE, rig)), 1)
                for tilt, rig in odd.items()
            },
            "psfcn": (lambda: models["psfcn"](whole), 1),
            **{
                name: (partial(model, part), SIDE**2 / few**2)
                for name, model in models.items()
                if name.startswith("mpsnet")
            },
            "network alone": (alone(ours), 1),
            "matrix product": (matrix_product(), 1),
        }
        still = Estimator(ours, threads=THREADS, passes=3)
        for colours in (1, 5):
            photo = painted(colours)
            cases[f"sphere of {colours} paints, one pass"] = (partial(models["default"], photo), 1)
            cases[f"sphere of {colours} paints, all passes"] = (partial(still, photo), 1)
        seconds: dict[str, list[float]] = {name: [] for name in cases}
        for _ in range(arguments.rounds):
            for name, (work, factor) in cases.items():
                start = time.process_time()
                work()
                seconds[name].append((time.process_time() - start) * factor)
        for name, times in seconds.items():
            ratio = statistics.median(t / d for t, d in zip(times, seconds["default"], strict=True))
            print(f"{name:32} {ratio:9.2f} times the default (median {statistics.median(times):.3f} s)")
        for colours in (1, 5):
            one, all_passes = (seconds[f"sphere of {colours} paints, {name}"] for name in ("one pass", "all passes"))
            ratio = statistics.median(a / o for a, o in zip(all_passes, one, strict=True))
            print(f"a still of {colours} paints takes {ratio:.2f} times one pass")
        done = multiply_adds(ours, SIDE)
        share = statistics.median(
            (done / net) / (1024**3 / product)
            for net, product in zip(seconds["network alone"], seconds["matrix product"], strict=True)
        )
        print(f"{done / SIDE**2 / 1e3:.1f} thousand multiply-adds a pixel, at {share:.0%} of a matrix product's rate")
        for side in LARGE if arguments.large else ():
            print(f"{peak_memory(side, ours, odd[57], folder):.0f} MB at most for {side} x {side} pixels")


if __name__ == "__main__":
    main()
