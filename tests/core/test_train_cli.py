"""The command train: what it refuses."""

import json
import os
import pickle
import sys
import zipfile
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from bad_input import Bench, cut, gets_one_clear_sentence
from sphere_sample import sphere_sample

from mpsnet_core import FileError, Train
from mpsnet_core.estimate.card import TRAINING_KEY
from mpsnet_core.synthesis.sample import write_sample

NEEDS_TORCH = pytest.mark.skipif(find_spec("torch") is None, reason="needs PyTorch")


def recipe(b: Bench, **changes: Any) -> Path:
    """A training recipe of one short step; None takes a key out."""
    good = {"name": "tiny", "title": "a test", "network": "demultiplexer", "steps": 1, "batch": 1, "crop": 16}
    good["warm_up"] = 0
    lines = [f"{key} = {json.dumps(value)}" for key, value in (good | changes).items() if value is not None]
    return b.text("tiny.toml", "\n".join([*lines, ""]))


def sample_folder(b: Bench, name: str = "samples", light: float = 1.0) -> Path:
    sample = sphere_sample(16)
    (b / name).mkdir()
    write_sample(b / name / "sample_000000.exr", replace(sample, lights=light * sample.lights))
    return b / name


def train(b: Bench, *arguments: str | Path, samples: Path | None = None, **changes: Any) -> None:
    """`mpsnet train` with good values for what is not given; later arguments win. changes: of the recipe."""
    good = ["--recipe", recipe(b, **changes), "--samples", samples or sample_folder(b), "-o", b / "out.onnx"]
    b.run("train", *good, *arguments)


def checkpoint(b: Bench, name: str = "c", **changes: Any) -> Path:
    """What a run leaves that had the good samples and, with these changes, the good recipe."""
    from mpsnet_core.learning.training.loop import TrainingPaths, train
    from mpsnet_core.learning.training.recipe import read_recipe

    train(read_recipe(recipe(b, **changes)), [sample_folder(b)], [], paths=TrainingPaths(b / name))
    return b / name


def resume(b: Bench, checkpoint: Path, **changes: Any) -> None:
    train(b, "--resume", checkpoint, samples=b / "samples", **changes)


def without(library: str, run: Callable[[], Any]) -> None:
    """Run this where a library is not installed."""
    with pytest.MonkeyPatch.context() as patch:
        paths = ("mpsnet_core.learning.training", "mpsnet_core.learning.evaluation.samples")
        for name in [name for name in sys.modules if name.startswith(paths)]:
            patch.delitem(sys.modules, name)
        patch.setitem(sys.modules, library, None)
        run()


def with_code(b: Bench, archived: bool) -> Path:
    """A checkpoint that would run code if it were unpickled."""

    class Danger:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(b / "unpickled"),)

    data = pickle.dumps({"format": "mpsnet-checkpoint", "step": Danger()}, protocol=2)
    if not archived:
        return b.bytes("c", data)
    with zipfile.ZipFile(b / "c", "w") as archive:
        for name, content in (("data.pkl", data), ("version", b"3\n"), ("byteorder", b"little")):
            archive.writestr(f"c/{name}", content)
    return b / "c"


def spoilt(path: Path) -> Path:
    """The same file with some of its weights changed."""
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 200] = bytes(255 - byte for byte in data[middle : middle + 200])  # more than is padding
    path.write_bytes(data)
    return path


def torch_file(path: Path, data: Any) -> Path:
    import torch

    torch.save(data, path)
    return path


def outside(path: Path) -> Path:
    """An ONNX file whose weights are in a file above its folder."""
    from onnx import TensorProto, helper, save

    weights = TensorProto(name="w", data_type=TensorProto.FLOAT, dims=[1], data_location=TensorProto.EXTERNAL)
    weights.external_data.add(key="location", value="../w")
    model = helper.make_model(helper.make_graph([], "g", [], [], [weights]))
    helper.set_model_props(model, {TRAINING_KEY: "{}"})
    save(model, path)
    return path


def renamed(path: Path) -> Path:
    """A checkpoint whose network has a layer of another name."""
    from mpsnet_core.learning.training.checkpoint import read_checkpoint, write_checkpoint

    found = read_checkpoint(path)
    write_checkpoint(path, found._replace(weights={f"{name}s": value for name, value in found.weights.items()}))
    return path


@NEEDS_TORCH
def test_the_threads_of_a_training_are_its_own(tmp_path: Path) -> None:
    import torch

    before = torch.get_num_threads()
    with pytest.raises(FileError, match="folder of samples"):
        Train(recipe="psfcn", samples=[tmp_path / "no"], threads=before + 1, output=tmp_path / "m.onnx").run()
    assert torch.get_num_threads() == before


test_a_missing_library_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("without PyTorch", lambda b: without("torch", lambda: train(b)), "needs PyTorch: pip install '.[train]' in a"),
        (lambda b: without("torch", lambda: b.run("evaluate", "samples", b.folder)), "needs PyTorch: pip install"),
    ]
)


test_a_bad_training_run_gets_one_clear_sentence = NEEDS_TORCH(
    gets_one_clear_sentence(
        [
            ("without ONNX", lambda b: without("onnx", lambda: train(b)), "needs ONNX: pip install"),
            ("without TensorBoard", lambda b: without("tensorboard", lambda: train(b)), "needs TensorBoard: pip"),
            (lambda b: b.run("train", "--samples", b.folder, "-o", b / "m.onnx"), "--recipe; see mpsnet train"),
            ("recipe that is no TOML", lambda b: train(b, "--recipe", b.text("a.toml", "steps: 3")), "a.toml is not"),
            (lambda b: train(b, "--recipe", b.text("a.toml", "steps = " + "1" * 5000)), "a.toml is not valid TOML"),
            (lambda b: train(b, "--recipe", b.text("a.toml", f"a{'.a' * 5000} = 1")), "a.toml is larger than 8 KiB"),
            ("misspelled key", lambda b: train(b, stesp=3), "tiny.toml: the recipe's 'stesp' is not known"),
            ("no steps", lambda b: train(b, steps=None), 'the recipe lacks "steps"; add it'),
            ("rate beyond reason", lambda b: train(b, learning_rate=3.0), "learning_rate must be from 1e-08 to 1, not"),
            ("unknown option", lambda b: train(b, **{"options.widht": 1}), "'widht'; correct the recipe"),
            (lambda b: train(b, network="mpsnet", patches=4, gradient_weight=0.3), "network mpsnet sees patches, not"),
            (
                lambda b: train(b, network="mpsnet", patches=4, hard_share=0.5),
                "many samples at once; leave out",
            ),
            (
                "a damaged sample",
                lambda b: (cut(sample_folder(b) / "sample_000000.exr"), train(b, samples=b / "samples")),
                "sample_000000.exr…--skip-damaged",
            ),
            ("another format", lambda b: train(b, "-o", b / "m.pth"), "m.pth: models are written as .onnx"),
            ("checkpoint in no folder", lambda b: train(b, "--checkpoint", b / "no" / "c"), "no does not exist"),
            ("model over the checkpoint", lambda b: train(b, "--checkpoint", b / "out.onnx"), "out.onnx, a file that"),
        ]
    )
)


test_a_bad_checkpoint_gets_one_clear_sentence = NEEDS_TORCH(
    gets_one_clear_sentence(
        [
            ("checkpoint of another recipe", lambda b: resume(b, checkpoint(b, seed=5)), "c is of another recipe"),
            (lambda b: train(b, "--resume", b.text("c.onnx", "hello")), "c.onnx is damaged or was not trained here"),
            ("ONNX with weights elsewhere", lambda b: train(b, "--resume", outside(b / "c.onnx")), "c.onnx is damaged"),
            (lambda b: resume(b, b.bytes("c", b"hello" + checkpoint(b).read_bytes())), "c is damaged, or is not a"),
            ("spoilt checkpoint", lambda b: resume(b, spoilt(checkpoint(b))), "c is damaged, or is not a checkpoint"),
            ("checkpoint with code", lambda b: train(b, "--resume", with_code(b, True)), "c is damaged, or is not a"),
            (
                "checkpoint of the optimiser alone",
                lambda b: (torch_file(b / "c", {"format": "mpsnet-checkpoint"}), train(b, "--resume", b / "c")),
                "c is damaged, or is not a checkpoint",
            ),
            ("checkpoint of another network", lambda b: resume(b, renamed(checkpoint(b))), "resume from another"),
        ]
    )
)


@NEEDS_TORCH
@pytest.mark.usefixtures("process_settings_restored")
def test_the_training_run_that_is_spoilt_above_is_good_before(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match=r"^exit code 0: "):
        train(Bench(tmp_path))
