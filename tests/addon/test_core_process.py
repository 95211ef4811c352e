"""The core as a child process: results, sentences, cancelling and crashes. The children are real."""

import gc
import os
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest

from blender_addon.child_process.core_process import CoreCrashed, CoreProcess, _environment, run
from blender_addon.operators import core_run
from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.estimate.operations import Estimate, ListModels
from mpsnet_core.scene.rig import published_rig, write_rig

# The child takes its last step, the renaming of what it wrote, only when the test is over.
BLOCK = """
import os, time
rename = os.replace
def replace(source, target, **more):
    while "unfinished" in str(source):
        open(os.path.join(os.path.dirname(source), "..", "writes"), "w").close()
        time.sleep(0.01)
    rename(source, target, **more)
os.replace = replace
"""


def at_the_childs_start(monkeypatch, folder, code):
    """Have the child run `code` first: Python imports sitecustomize at its start."""
    folder.mkdir(exist_ok=True)
    (folder / "sitecustomize.py").write_text(code)
    environment = _environment()
    environment["PYTHONPATH"] = os.pathsep.join([str(folder), environment["PYTHONPATH"]])
    monkeypatch.setattr("blender_addon.child_process.core_process._environment", lambda: environment)


@pytest.fixture
def job(tmp_path, monkeypatch):
    """An estimate that stops in the middle of writing, and its output."""
    folder = tmp_path / "job"
    folder.mkdir()
    buffer = oiio.ImageBuf(oiio.ImageSpec(8, 8, 3, oiio.FLOAT))
    buffer.set_pixels(oiio.ROI.All, np.random.default_rng(0).uniform(0.1, 1, (8, 8, 3)).astype(np.float32))
    buffer.write(str(folder / "photo.exr"))
    write_rig(folder / "rig.json", published_rig())
    at_the_childs_start(monkeypatch, tmp_path / "start", BLOCK)
    output = folder / "normals.png"
    photo, rig = str(folder / "photo.exr"), str(folder / "rig.json")
    return Estimate(image=(photo,), rig=rig, output=str(output)), output


def wait_for_writing(process, folder):
    """Until the child is about to rename what it wrote, which is when something could stay behind."""
    while process.running() and not (folder.parent / "writes").exists():
        time.sleep(0.005)
    assert process.running(), "the child ended before it wrote anything"


def only_the_inputs(folder):
    return sorted(path.name for path in folder.iterdir()) == ["photo.exr", "rig.json"]


def test_result_and_progress():
    seen = []
    result = run(ListModels(), on_progress=lambda fraction, message: seen.append(fraction))
    assert "lambertian" in [model["name"] for model in result["models"]]
    assert seen and all(0 <= fraction <= 1 for fraction in seen)


def test_bad_input_is_the_cores_own_sentence(tmp_path):
    with pytest.raises(InputError, match=r"nowhere\.png does not exist"):
        rig, output = str(tmp_path / "rig.json"), str(tmp_path / "out.png")
        run(Estimate(image=(str(tmp_path / "nowhere.png"),), rig=rig, output=output))


def test_cancelling_leaves_nothing_half_written(job):
    operation, output = job
    process = CoreProcess(operation, [output])
    wait_for_writing(process, output.parent)
    process.cancel()
    assert not process.running()
    assert only_the_inputs(output.parent)


def test_a_dropped_run_ends_its_child_and_leaves_nothing(job):
    operation, output = job
    process = CoreProcess(operation, [output])
    wait_for_writing(process, output.parent)
    child = process._child
    del process
    gc.collect()
    assert child.wait(60) != 0
    assert only_the_inputs(output.parent)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_a_child_that_does_not_listen_is_killed_and_cleared_up_after(job, monkeypatch):
    monkeypatch.setattr("blender_addon.child_process.core_process.CANCEL_SECONDS", 0.05)
    operation, output = job
    process = CoreProcess(operation, [output])
    wait_for_writing(process, output.parent)
    os.kill(process.pid, signal.SIGSTOP)  # a stopped process cannot answer the request to end
    process.cancel()
    assert process._child.wait() == -signal.SIGKILL
    assert only_the_inputs(output.parent)


@pytest.mark.skipif(sys.platform == "win32", reason="there it goes on")
def test_a_child_whose_parent_is_gone_ends_and_leaves_nothing(job):
    operation, output = job
    process = CoreProcess(operation, [])  # clears no folder
    wait_for_writing(process, output.parent)
    process._child._close_stdin()  # as at the parent's end
    with pytest.raises(Cancelled):
        process.result()
    assert only_the_inputs(output.parent)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize(("number", "error"), [(signal.SIGTERM, Cancelled), (signal.SIGKILL, CoreCrashed)])
def test_a_child_that_is_ended_by_others(job, number, error):
    operation, output = job
    process = CoreProcess(operation, [output])
    wait_for_writing(process, output.parent)
    os.kill(process.pid, number)
    with pytest.raises(error):
        process.result()
    assert only_the_inputs(output.parent)


def test_a_crash_is_reported_with_the_last_words(tmp_path, monkeypatch):
    # The child breaks before the core can catch anything.
    at_the_childs_start(monkeypatch, tmp_path, "import os, sys\nsys.stderr.write('out of memory\\n')\nos._exit(9)\n")
    with pytest.raises(CoreCrashed, match=r"exit code 9.*out of memory"):
        run(ListModels())


def test_much_output_does_not_block_the_child(tmp_path, monkeypatch):
    flood = "import sys\nfor _ in range(20000):\n    sys.stderr.write('warning ' * 20 + '\\n')\n"
    at_the_childs_start(monkeypatch, tmp_path, flood)
    assert run(ListModels())["models"]


def test_the_child_imports_nothing_from_the_current_folder(tmp_path, monkeypatch):
    (tmp_path / "json.py").write_text("raise SystemExit('the wrong json')\n")
    monkeypatch.chdir(tmp_path)
    assert run(ListModels())["models"]


def test_taking_the_add_on_away_ends_what_it_runs(job, tmp_path):
    operation, output = job
    held = ExitStack()
    folder = Path(held.enter_context(TemporaryDirectory(dir=tmp_path)))
    manager = bpy.context.window_manager
    running = core_run._Job(held, [core_run._Run([], lambda: CoreProcess(operation, [output]))])
    running.advance()
    core_run._jobs.append(running)
    manager.mps.running = "MPS_OT_estimate"
    wait_for_writing(running.process, output.parent)
    core_run.unregister()
    assert not running.process.running()
    assert only_the_inputs(output.parent) and not folder.exists()
    assert manager.mps.running == ""
    running.leave(manager)  # Blender may ask for it once more


def test_what_a_killed_blender_left_goes_with_the_next_run(tmp_path):
    script = """
import os, sys
import bpy
import blender_addon
from blender_addon.operators.core_run import RunsCore
from mpsnet_core.errors import InputError
blender_addon.register()
class MPS_OT_ends(RunsCore, bpy.types.Operator):
    bl_idname, bl_label = "mps.ends", "Ends"
    def prepare(self, context, folder):
        (folder / "mesh.npz").write_bytes(b"much")
        if sys.argv[1] == "killed":
            os._exit(9)
        raise InputError("refused")
bpy.utils.register_class(MPS_OT_ends)
try:
    bpy.ops.mps.ends()
finally:
    bpy.utils.unregister_class(MPS_OT_ends)  # bpy 4.5 hangs at its end where such a class is left
"""
    folders = []
    for ends in ("killed", "refused"):
        environment = {**os.environ, "TMPDIR": str(tmp_path), "TEMP": str(tmp_path)}
        subprocess.run([sys.executable, "-c", script, ends], env=environment, capture_output=True, timeout=60)
        folders.append(len(list(tmp_path.glob("*/mesh.npz"))))
    assert folders == [1, 0]
