"""The core as a child process: results, sentences, cancelling and crashes. The children are real."""

import os
import signal
import sys
import time

import numpy as np
import OpenImageIO as oiio
import pytest

from blender_addon.core_process import CoreCrashed, CoreProcess, run
from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.rig import published_rig, write_rig


@pytest.fixture
def job(tmp_path):
    """Arguments and output of an estimate that takes a few seconds."""
    photo = np.random.default_rng(0).uniform(0.1, 1, (3000, 3000, 3)).astype(np.float32)
    buffer = oiio.ImageBuf(oiio.ImageSpec(3000, 3000, 3, oiio.FLOAT))
    buffer.set_pixels(oiio.ROI.All, photo)
    buffer.write(str(tmp_path / "photo.exr"))
    write_rig(tmp_path / "rig.json", published_rig())
    output = tmp_path / "normals.png"
    return ["estimate", str(tmp_path / "photo.exr"), "--rig", str(tmp_path / "rig.json"), "-o", str(output)], output


def test_result_and_progress():
    seen = []
    result = run(["models"], on_progress=lambda fraction, message: seen.append(fraction))
    assert "lambertian" in [model["name"] for model in result["models"]]
    assert seen and all(0 <= fraction <= 1 for fraction in seen)


def test_bad_input_is_the_cores_own_sentence(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.json does not exist"):
        run(["estimate", "photo.png", "--rig", str(tmp_path / "nowhere.json"), "-o", str(tmp_path / "out.png")])


def wait_for_writing(process, folder):
    """Until the child has begun to write, which is when something could stay behind."""
    while process.running() and not list(folder.glob(".*.unfinished*")):
        time.sleep(0.005)
    assert process.running(), "the child was done before it could be caught writing"


def test_cancelling_leaves_nothing_half_written(job, tmp_path):
    arguments, output = job
    process = CoreProcess(arguments, [output])
    wait_for_writing(process, tmp_path)
    start = time.monotonic()
    process.cancel()
    assert time.monotonic() - start < 1
    assert not process.running()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["photo.exr", "rig.json"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_child_that_does_not_listen_is_killed_and_cleared_up_after(job, tmp_path):
    arguments, output = job
    process = CoreProcess(arguments, [output])
    wait_for_writing(process, tmp_path)
    os.kill(process.pid, signal.SIGSTOP)  # a stopped process cannot answer the request to end
    start = time.monotonic()
    process.cancel()
    assert time.monotonic() - start < 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["photo.exr", "rig.json"]


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize(("number", "error"), [(signal.SIGTERM, Cancelled), (signal.SIGKILL, CoreCrashed)])
def test_a_child_that_is_ended_by_others(job, tmp_path, number, error):
    arguments, output = job
    process = CoreProcess(arguments, [output])
    wait_for_writing(process, tmp_path)
    os.kill(process.pid, number)
    with pytest.raises(error):
        process.result()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["photo.exr", "rig.json"]


def test_a_crash_is_reported_with_the_last_words(tmp_path, monkeypatch):
    # Python imports sitecustomize at its start: the child breaks before the core can catch anything.
    (tmp_path / "sitecustomize.py").write_text("import os, sys\nsys.stderr.write('out of memory\\n')\nos._exit(9)\n")
    monkeypatch.setattr("blender_addon.core_process._environment", lambda: {**os.environ, "PYTHONPATH": str(tmp_path)})
    with pytest.raises(CoreCrashed, match=r"exit code 9.*out of memory"):
        run(["models"])


def test_much_output_does_not_block_the_child(tmp_path, monkeypatch):
    flood = "import sys\nfor _ in range(20000):\n    sys.stderr.write('warning ' * 20 + '\\n')\n"
    (tmp_path / "sitecustomize.py").write_text(flood)
    paths = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    monkeypatch.setattr("blender_addon.core_process._environment", lambda: {**os.environ, "PYTHONPATH": paths})
    assert run(["models"])["models"]
