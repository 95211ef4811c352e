"""The whole job without a window: through bpy.ops, and through `blender --command mpsnet`."""

import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from synthetic import degrees_between, shaded_sphere, write_file

from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.scene.rig import published_rig, write_rig


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


def test_a_photo_is_opened_with_blenders_own_openimageio(by_script, blender):
    """On Windows the extension's would get Blender's DLLs, of another version."""
    _, report = by_script
    assert report["openimageio"] and not Path(report["openimageio"]).is_relative_to(blender.user)


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


@pytest.fixture
def rig(tmp_path):
    write_rig(tmp_path / "rig.json", published_rig())
    return tmp_path / "rig.json"


def opened_photo(photo, rig):
    """Blender's arguments that open a photo and name its rig."""
    settings = f"bpy.context.scene.mps.estimate.rig_file = {str(rig)!r}"
    return ["--python-expr", f"import bpy; bpy.ops.mps.open_photo(filepath={str(photo)!r}); {settings}"]


def test_a_video_is_decoded_by_blender_itself(blender, rig, tmp_path):
    """The extension brings no PyAV; what that encodes here comes out, the sphere's normals."""
    av = pytest.importorskip("av")
    sphere = shaded_sphere(96)
    with av.open(str(tmp_path / "turn.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.height, stream.width = sphere.image.shape[:2]
        stream.pix_fmt = "gbrp16le"
        for strength in (0.5, 0.7, 0.9):
            values = np.rint(np.clip(linear_to_srgb(strength * sphere.image), 0, 1) * 65535).astype(np.uint16)
            container.mux(
                stream.encode(av.VideoFrame.from_ndarray(values, format="rgb48le").reformat(format="gbrp16le"))
            )
        container.mux(stream.encode(None))
    flags = ["--model=LAMBERTIAN", "--mask=THRESHOLD", f"--output={tmp_path / 'normals'}"]
    done = blender.run("-b", *opened_photo(tmp_path / "turn.mkv", rig), "--command", "mpsnet", "estimate", *flags)
    assert done.returncode == 0, done.stdout + done.stderr
    found = sorted((tmp_path / "normals").iterdir())
    assert [path.name for path in found] == [f"turn_{number:06d}_normals.png" for number in (1, 2, 3)]
    for path in found:
        assert degrees_between(2 * read(path)[..., :3] - 1, sphere.normals)[sphere.lit].mean() < 0.5


def test_a_network_that_is_only_to_compare_with_is_not_there(blender, rig, tmp_path):
    write_file(tmp_path / "front.exr", shaded_sphere(96).image, "float")
    photo = opened_photo(tmp_path / "front.exr", rig)
    done = blender.run("-b", *photo, "--command", "mpsnet", "estimate", "--model=PSFCN", f"--output={tmp_path}/n.png")
    assert done.returncode == 2, done.stdout + done.stderr
    assert "the network psfcn, to compare with, is not installed: put psfcn.onnx" in done.stderr


def test_a_file_that_cannot_be_opened_is_no_success(blender, scene, tmp_path):
    (tmp_path / "cut.blend").write_bytes(scene.read_bytes()[:1000])
    for file in (tmp_path / "nosuch.blend", tmp_path / "cut.blend"):
        done = blender.run("-b", file, "--command", "mpsnet", "add-rig", "--save", tmp_path / "bad.blend")
        assert done.returncode == 2 and f"mpsnet: cannot open {file}" in done.stderr, done.stdout + done.stderr
    assert not (tmp_path / "bad.blend").exists()


FACTORY = """
import bpy, addon_utils
bpy.ops.wm.read_factory_settings()
assert not hasattr(bpy.types, "MPS_OT_bake"), "the page says that this unloads extensions"
addon_utils.enable({name!r})
assert hasattr(bpy.types, "MPS_OT_bake")
bpy.ops.mps.estimate()
"""


def test_a_farm_starts_it_as_the_page_says(blender, scene, tmp_path):
    name = "bl_ext.user_default.mpsnet"
    plain = ["--factory-startup", "--addons", name]
    verb = [
        "--command",
        "mpsnet",
        "add-rig",
        "--object",
        "Sphere",
        "--progress",
        "json",
        "--save",
        tmp_path / "r.blend",
    ]
    done = blender.run(*plain, "-b", scene, *verb)
    assert done.returncode == 0, done.stdout + done.stderr
    told = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    assert told[0]["progress"] == 0 and told[-1]["result"]["saved"] == str(tmp_path / "r.blend")
    # A script's error, here of a missing photo, is an exit code where one is asked for.
    done = blender.run("-b", scene, "--python-exit-code", "7", "--python-expr", FACTORY.format(name=name))
    assert done.returncode == 7 and "open a photo first" in done.stderr, done.stdout + done.stderr


EXPORT = """
import bpy
bpy.ops.wm.open_mainfile(filepath={scene!r})
bpy.data.objects["Sphere"].data.materials.clear()  # glTF knows no diffuse shader
bpy.ops.mps.add_rig()
bpy.ops.mps.render_photo(width=64, height=64, samples=4, output={folder!r} + "/photo.exr")
bpy.ops.mps.estimate(model="LAMBERTIAN", output={folder!r} + "/normals.png")
bpy.ops.mps.bake(target="Sphere", preset="UNREAL", size=64, output={folder!r} + "/directx.png")
bpy.ops.export_scene.gltf(filepath={folder!r} + "/export/scene.gltf", export_format="GLTF_SEPARATE")
"""


def test_a_directx_texture_is_turned_in_blenders_gltf(blender, scene, tmp_path):
    (tmp_path / "export").mkdir()
    script = EXPORT.format(scene=str(scene), folder=str(tmp_path))
    done = blender.run("-b", "--python-exit-code", "3", "--python-expr", script)
    assert done.returncode == 0, done.stdout + done.stderr
    (exported,) = (tmp_path / "export").glob("*.png")
    ours, theirs = (np.rint(65535 * read(file)[..., :3]) for file in (tmp_path / "directx.png", exported))
    assert np.array_equal(theirs[..., [0, 2]], ours[..., [0, 2]])
    assert np.array_equal(theirs[..., 1], np.minimum(65536 - ours[..., 1], 65535)) and ours[..., 1].std() > 100
