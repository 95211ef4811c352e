"""The whole job without a window: through bpy.ops, and through `blender --command mpsnet`."""

import numpy as np
import OpenImageIO as oiio
import pytest


def read(path):
    """(H, W, C) float32 as it is in the file."""
    pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)
    assert pixels.ndim == 3, path
    return pixels


@pytest.fixture(scope="module")
def scene(blender, tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    assert blender.script("sphere.py", folder / "report.json", folder / "sphere.blend") == ["Sphere"]
    return folder / "sphere.blend"


@pytest.fixture(scope="module")
def by_script(blender, scene, tmp_path_factory):
    """The folder with photo.exr, normals.png and texture.png, and the script's report."""
    folder = tmp_path_factory.mktemp("script")
    report = tmp_path_factory.mktemp("report") / "report.json"
    return folder, blender.script("pipeline.py", report, scene, folder)


def test_normals_of_a_rendered_sphere(by_script):
    folder, _ = by_script
    normals = read(folder / "normals.png")
    alpha = read(folder / "photo.exr")[..., 3]
    encoded, mask = normals[..., :3], normals[..., 3] > 0.5
    assert np.count_nonzero(mask ^ (alpha > 0.5)) < 0.01 * mask.size

    # The sphere seen along its axis: a disc around the picture's middle with the alpha's area.
    radius = np.sqrt(alpha.sum() / np.pi)
    rows, columns = np.indices(mask.shape) + 0.5
    x, y = (columns - mask.shape[1] / 2) / radius, (mask.shape[0] / 2 - rows) / radius
    z = np.sqrt(np.clip(1 - x**2 - y**2, 0, None))
    found = 2 * encoded - 1
    found /= np.linalg.norm(found, axis=-1, keepdims=True)
    error = np.degrees(np.arccos(np.clip(found[..., 0] * x + found[..., 1] * y + found[..., 2] * z, -1, 1)))
    # Within 60° of the camera every light 30° off its axis shines on the surface.
    lit = mask & (z > 0.55)
    assert lit.sum() > 0.4 * mask.sum()
    assert error[lit].mean() < 0.5


def test_texture_of_a_smooth_sphere_is_flat(by_script):
    folder, report = by_script
    texture = read(folder / "texture.png")
    assert texture.shape[:2] == (256, 256)
    # Camera at -Y: the middle of Blender's UV sphere is seen from the front, u = 0.25 faces -Y.
    normals = 2 * texture[96:160, 48:80, :3] - 1
    assert np.degrees(np.arccos(np.clip(normals[..., 2].mean(), -1, 1))) < 5
    assert np.abs(normals[..., :2]).mean() < 0.05
    assert report["worn"] == [str(folder / "texture.png")]


def test_errors_reach_the_script_as_sentences(by_script):
    _, report = by_script
    errors = report["errors"]
    assert "Render or open a photo first" in errors["estimate without photo"]
    assert "nothing is selected" in errors["rig around nothing"]
    assert "none.png" in errors["photo that does not exist"] and "does not exist" in errors["photo that does not exist"]
    assert "none.png" in errors["mask that does not exist"] and "does not exist" in errors["mask that does not exist"]
    assert "has no UV map" in errors["bake without UVs"]
    assert not [message for message in errors.values() if "Traceback" in message]
    # Nor did any of them leave a file behind: these are the steps' own.
    beside = ["photo.camera.json", "photo.rig.json"]
    assert report["left"] == sorted(["normals.png", "photo.exr", "texture.png", *beside])


def test_command_line_does_the_same(blender, scene, by_script, tmp_path):
    current = scene
    for step, (verb, *flags) in enumerate(
        [
            ["add-rig", "--object", "Sphere"],
            ["render-photo", "--width=160", "--height=160", "--samples=32", "--output=photo.exr"],
            ["estimate", "--model=LAMBERTIAN", "--output=normals.png"],
            ["bake", "--target=Sphere", "--size=256", "--output=texture.png"],
        ]
    ):
        saved = tmp_path / f"{step}.blend"
        flags = [flag.replace("--output=", f"--output={tmp_path}/") for flag in flags]
        done = blender.run("-b", current, "--command", "mpsnet", verb, *flags, "--save", saved)
        assert done.returncode == 0, done.stdout + done.stderr
        current = saved
    # The same but for the render's noise.
    for name in ("normals.png", "texture.png"):
        assert np.abs(read(tmp_path / name) - read(by_script[0] / name)).mean() < 0.01


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["estimate"], "open a photo first"),
        (["add-rig", "--object", "Monkey"], 'no object "Monkey"'),
        (["add-rig", "--slant", "95"], "95 is outside 1 to 89"),
        (["fly"], "invalid choice: 'fly'"),
    ],
)
def test_command_line_refuses_in_one_line(blender, scene, arguments, sentence):
    done = blender.run("-b", scene, "--command", "mpsnet", *arguments)
    assert done.returncode == 2, done.stdout + done.stderr
    lines = [line for line in done.stderr.splitlines() if sentence in line]
    assert len(lines) == 1, done.stderr
    assert "Traceback" not in done.stdout + done.stderr
