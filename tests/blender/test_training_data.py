"""Training data by a real Blender: those that it starts find the extension."""

from dataclasses import replace

import numpy as np

from mpsnet_core.synthesis.job import read_job, sample_path, samples_there
from mpsnet_core.synthesis.sample import read_sample
from mpsnet_core.synthesis.scene_sampling import draw_scene

SMALL = ["--kinds", "blobs", "--size", "32", "--samples", "2", "--no-denoise", "--processes", "2"]


def check_samples(folder, count):
    """They are whole, what the seed says, and show something under every light."""
    job = read_job(folder)
    assert samples_there(folder) == set(range(count))
    for number in range(count):
        sample = read_sample(sample_path(folder, number))
        recipe = draw_scene(job, number)
        assert sample.recipe.shape == recipe.shape
        # Blender's NumPy may be another than ours, and round otherwise.
        assert np.allclose(sample.recipe.rotation, recipe.rotation, rtol=0, atol=1e-12)
        assert np.allclose(sample.recipe.light_directions, recipe.light_directions, rtol=0, atol=1e-12)
        assert sample.lights.shape == (3, 32, 32, 3) and sample.mask.any()
        assert (sample.lights[:, sample.mask].mean(axis=(1, 2)) > 0.001).all()
    assert not list(folder.glob(".*"))


def test_command_line_renders_the_scenes_own_objects(blender, tmp_path):
    scene, folder = tmp_path / "sphere.blend", tmp_path / "samples"
    assert blender.script("sphere.py", tmp_path / "report.json", scene) == ["Sphere"]
    flags = ["--source", "scene", "--object", "Sphere", "--count", "1", "--seed", "23", *SMALL, "--output", folder]
    done = blender.run("-b", scene, "--command", "mpsnet", "render-samples", *flags)
    assert done.returncode == 0, done.stdout + done.stderr
    check_samples(folder, 1)
    # A sphere: its normals lean away from the camera as its outline is neared, in every direction.
    sample = read_sample(sample_path(folder, 0))
    normals = sample.normals[sample.mask]
    assert normals[:, 2].max() > 0.98 and (np.abs(normals).max(axis=0) > 0.7).all()


def test_an_extension_that_the_preferences_do_not_know_yet(extension_zip, blender, tmp_path):
    """Enabled in the window a moment ago, that is: the preferences are saved when Blender quits."""
    fresh = replace(blender, user=tmp_path / "user")
    done = fresh.run("--command", "extension", "install-file", "-r", "user_default", extension_zip)
    assert done.returncode == 0, done.stdout + done.stderr
    folder = tmp_path / "samples"
    flags = ["--count", "1", *SMALL, "--output", folder]
    done = fresh.run("-b", "--addons", "bl_ext.user_default.mpsnet", "--command", "mpsnet", "render-samples", *flags)
    assert done.returncode == 0, done.stdout + done.stderr
    check_samples(folder, 1)
