"""Training data from the operator and the command line: real renders, as small as they can be."""

import logging
import os
import shutil
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import OpenImageIO as oiio
import pytest

from blender_addon.commands import main
from blender_addon.training.training_data import samples_status
from mpsnet_core.synthesis.job import SampleJob, place_job, read_job, sample_path
from mpsnet_core.synthesis.sample import read_sample
from mpsnet_core.synthesis.scene_sampling import draw_scene

SMALL = {"size": 32, "samples": 4, "kinds": {"BLOBS"}, "denoise": False}


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """A folder of two samples of generated blobs, rendered by the operator."""
    folder = tmp_path_factory.mktemp("rendered") / "samples"
    bpy.ops.mps.render_samples(count=2, seed=3, processes=2, output=str(folder), **SMALL)
    return folder


@pytest.fixture
def folder(rendered, tmp_path):
    """A copy of it."""
    return Path(shutil.copytree(rendered, tmp_path / "samples"))


def test_what_is_rendered_is_what_the_seed_says(rendered):
    job = read_job(rendered)
    assert (job.renderer, job.shapes, job.count, job.size) == ("cycles", ("blobs",), 2, 32)
    for number in range(2):
        sample = read_sample(sample_path(rendered, number))
        assert sample.recipe.data() == draw_scene(job, number).data()
        assert sample.renderer == f"Cycles {bpy.app.version_string}"
        assert sample.lights.shape == (3, 32, 32, 3)
        # Each light reaches something, and none reaches what is not there.
        assert (sample.lights[:, sample.mask].mean(axis=(1, 2)) > 0.01).all()
        assert not sample.lights[:, sample.alpha == 0].any()
        assert 0.1 < sample.mask.mean() < 0.95
    assert not [path.name for path in rendered.iterdir() if "unfinished" in path.name]


def test_it_goes_on_where_it_stopped(folder, scene, capfd, monkeypatch):
    monkeypatch.setattr("blender_addon.operators.progress.LOG_SECONDS", 0)
    first, second = sample_path(folder, 0), sample_path(folder, 1)
    kept = first.stat().st_mtime_ns
    pixels = read_sample(second).lights
    second.unlink()
    assert samples_status(folder) == "1 of 2 samples"
    flags = ["--count", "3", "--seed", "3", "--size", "32", "--samples", "4", "--kinds", "blobs", "--no-denoise"]
    assert main(["render-samples", *flags, "--output", str(folder)]) == 0
    assert samples_status(folder) == "3 of 3 samples"
    assert first.stat().st_mtime_ns == kept
    # Cycles' noise comes from its own seed, which is the sample's.
    assert np.abs(read_sample(second).lights - pixels).mean() < 1e-3
    image = scene.mps.samples.image
    assert Path(bpy.path.abspath(image.filepath)) == folder / "contact_sheet.png" and image.size[0] > 32

    told = capfd.readouterr()
    assert f"mpsnet: render-samples done: {folder}" in told.out and f"note: 3 of 3 samples: {folder}" in told.err
    assert "the scene is not saved" not in told.out
    assert "mpsnet: 33%: 1 of 3" in told.err and "mpsnet: 100%: 3 of 3" in told.err
    assert not logging.getLogger("blender_addon").handlers


def paint_green(obj, folder):
    """Give the object a green image texture, and save the scene so that the image's path is relative."""
    buffer = oiio.ImageBuf(oiio.ImageSpec(4, 4, 3, oiio.UINT8))
    oiio.ImageBufAlgo.fill(buffer, (0.05, 0.8, 0.05))
    buffer.write(str(folder / "green.png"))
    tree = obj.data.materials[0].node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.load(str(folder / "green.png"))
    tree.links.new(texture.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    texture.image.filepath = "//green.png"


def test_the_scenes_own_objects(scene, sphere, tmp_path):
    paint_green(sphere, tmp_path)
    folder = tmp_path / "elsewhere" / "samples"
    folder.parent.mkdir()
    settings = {"source": "SCENE", "size": 32, "samples": 4, "denoise": False, "seed": 23, "output": str(folder)}
    bpy.ops.mesh.primitive_cube_add(location=(9, 0, 0))
    bpy.context.object.select_set(False)
    sphere.select_set(True)
    before = (bpy.data.filepath, len(bpy.data.objects))
    bpy.ops.mps.render_samples(count=1, **settings)
    assert (bpy.data.filepath, len(bpy.data.objects)) == before
    assert read_job(folder).objects == ("Sphere",)
    assert not [path.name for path in folder.iterdir() if "unfinished" in path.name]
    sample = read_sample(sample_path(folder, 0))
    assert sample.recipe.shape["kind"] == "scene"
    # The sphere alone, whose normals are its own: every direction that faces the camera equally often.
    assert 0.2 < sample.mask.mean() < 0.9
    z = sample.normals[sample.mask][:, 2]
    assert z.min() < 0.5 and z.max() > 0.97
    # In its own green, from a file whose path is relative to the scene's; Blender shows what is missing in magenta.
    red, green, blue = sample.lights[:, sample.mask].mean(axis=(0, 1))
    assert green > 5 * red and green > 5 * blue

    # The samples go on showing the scene as it was, though nothing is selected any more and the sphere is gone.
    bpy.data.objects.remove(sphere)
    bpy.ops.object.select_all(action="DESELECT")
    bpy.ops.mps.render_samples(count=2, **settings)
    again = read_sample(sample_path(folder, 1))
    assert 0.2 < again.mask.mean() < 0.9
    with pytest.raises(RuntimeError, match="its objects is Sphere, not Cube"):
        bpy.data.objects["Cube"].select_set(True)
        bpy.ops.mps.render_samples(count=2, **settings)


@pytest.fixture
def online():
    """Lets Blender go online, or not, until the test ends."""
    system = bpy.context.preferences.system
    before = system.use_online_access
    yield lambda allowed: setattr(system, "use_online_access", allowed)
    system.use_online_access = before


def test_no_file_says_which_cluster_this_machine_listens_to(scene, tmp_path):
    scene.mps.samples["cluster"] = "tcp://10.0.0.1:8786"
    bpy.ops.mps.render_samples(count=1, output=str(tmp_path / "here"), **SMALL)
    assert samples_status(tmp_path / "here") == "1 of 1 samples"


@pytest.mark.parametrize("way", ["caller", "preferences"])
def test_a_cluster_elsewhere_is_reached_online_alone_and_where_it_proves_who_it_is(tmp_path, online, monkeypatch, way):
    """pip's bpy has no preferences of add-ons, so what they would say is put in their place."""
    named = {"cluster": "tcp://10.0.0.1:8786", "cluster_trusted": False}
    if way == "preferences":
        monkeypatch.setattr("blender_addon.training.training_data.preference", named.get)
    settings = {**SMALL, **(named if way == "caller" else {}), "count": 1, "output": str(tmp_path / "samples")}
    online(False)
    with pytest.raises(RuntimeError, match=r"may not go online, .* to the cluster at tcp://10.0.0.1:8786; tick"):
        bpy.ops.mps.render_samples(**settings)
    assert not (tmp_path / "samples").exists()
    online(True)
    with pytest.raises(RuntimeError, match=r"anyone who answers at tcp://10.0.0.1:8786 could run code here; give a"):
        bpy.ops.mps.render_samples(**settings)
    assert not (tmp_path / "samples").exists()


@pytest.mark.parametrize("begun", [False, True])
def test_a_refused_run_takes_back_the_job_that_it_began(scene, tmp_path, online, begun):
    """And the scene that it stored; not a job that was there before."""
    folder = tmp_path / "samples"
    online(True)
    bpy.ops.mesh.primitive_cube_add()
    settings = {**SMALL, "count": 1, "output": str(folder), "source": "SCENE"}
    if begun:
        bpy.ops.mps.render_samples(**settings)
        for sample in folder.glob("sample_*"):
            sample.unlink()
    before = {path.name for path in folder.glob("*")}
    with pytest.raises(RuntimeError, match="could run code here"):
        bpy.ops.mps.render_samples(**settings, cluster="tcp://10.0.0.1:8786")
    assert folder.exists() == begun and {path.name for path in folder.glob("*")} == before


def test_a_scene_that_is_not_there_is_one_sentence(tmp_path):
    command = [sys.executable, "-m", "blender_addon", tmp_path / "nowhere.blend", "render-samples"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, env=os.environ)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("mpsnet: ")]
    assert "nowhere.blend" in line and line.endswith("check the path")


def test_how_a_folder_stands(tmp_path):
    assert samples_status(tmp_path / "nowhere") == samples_status(tmp_path) == ""
    place_job(tmp_path, SampleJob("cycles", count=20))
    for number in (0, 7, 25):
        sample_path(tmp_path, number).write_bytes(b"whole")
    sample_path(tmp_path, 3).touch()  # what a power cut leaves
    (tmp_path / ".sample_000004.9.unfinished.exr").write_bytes(b"half")
    assert samples_status(tmp_path) == "2 of 20 samples"
    (tmp_path / "job.json").replace(tmp_path / "other.json")
    assert samples_status(tmp_path) == ""
    (tmp_path / "spoilt").mkdir()
    (tmp_path / "spoilt" / "job.json").write_text("{")
    assert samples_status(tmp_path / "spoilt") == ""
