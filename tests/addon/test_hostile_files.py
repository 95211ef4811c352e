"""What a .blend file holds by the add-on's names, and what Blender would do of itself for its data: hostile files."""

import json
import math
import os
import shutil
import sys
from pathlib import Path

import bpy
import pytest

from blender_addon.appearance.modifiers import move_by_modifier, subdivide
from blender_addon.child_process.core_process import CoreProcess
from blender_addon.child_process.simulation_caches import simulations_write_into
from blender_addon.image_records import made_when
from blender_addon.outputs import is_safe_to_open
from blender_addon.panels.step import Kind
from blender_addon.panels.text import lines, shortened
from blender_addon.photo.background_render import rendering_blender, written_job
from blender_addon.settings.scene import STEPS
from blender_addon.training.samples.render import _make
from blender_addon.training.training_data import SCENE_FILE
from mpsnet_core.synthesis.job import SampleJob

from .test_steps import kinds

# A shader, compiled, that is a camera and says so on stdout.
SHADER = """OpenShadingLanguage 1.00
shader camera
oparam\tpoint\tposition\t0 0 0\t\t%read{2147483647,-1} %write{1,1}
oparam\tvector\tdirection\t0 0 1\t\t%read{2147483647,-1} %write{2147483647,-1}
oparam\tcolor\tthroughput\t1 1 1\t\t%read{2147483647,-1} %write{2147483647,-1}
const\tstring\t$const1\t"the shader runs\\n"\t\t%read{0,0} %write{2147483647,-1}
const\tpoint\t$const2\t0 0 0\t\t%read{1,1} %write{2147483647,-1}
code ___main___
\tprintf\t\t$const1 \t%filename{"camera.osl"} %line{1} %argrw{"r"}
\tassign\t\tposition $const2 \t%argrw{"wr"}
\tend
"""


def rigged(scene):
    bpy.ops.mps.add_rig()
    photo = scene.mps.photo
    photo.width, photo.height, photo.samples = 24, 16, 1
    return scene.mps.rig


# --- what runs --------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(bpy.app.version < (5, 0), reason="Blender 4.5 has no custom cameras")
@pytest.mark.parametrize("animated", [False, True])
@pytest.mark.parametrize("verb", ["render_photo", "render_truth"])
def test_a_cameras_own_shader_does_not_run(sphere, scene, tmp_path, capfd, verb, animated):
    camera = rigged(scene).camera.data
    camera.custom_mode, camera.custom_bytecode, camera.custom_bytecode_hash = "EXTERNAL", SHADER, "0"
    camera.type = "CUSTOM"
    if animated:  # Blender sets the open scene's camera; ours has to look at the one that it renders
        camera.keyframe_insert("type", frame=scene.frame_current)
        camera.type = "PERSP"
    with pytest.raises(RuntimeError, match="a shader of its own; make it orthographic or perspective"):
        getattr(bpy.ops.mps, verb)(output=str(tmp_path / "rendered.exr"))
    assert "the shader runs" not in capfd.readouterr().out
    assert not list(tmp_path.glob("*.exr"))


def test_nothing_that_the_system_may_run_is_opened(tmp_path, monkeypatch):
    bundle, program, page = tmp_path / "Normals.app", tmp_path / "report.exe", tmp_path / "report.html"
    bundle.mkdir()
    program.touch()
    page.touch()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert is_safe_to_open(page) and is_safe_to_open("//report.html") and is_safe_to_open(tmp_path)
    assert not any(
        map(is_safe_to_open, [program, "//report.exe", tmp_path / "none.html", "https://x.org/a.html", "x" * 9999])
    )
    monkeypatch.setattr(sys, "platform", "darwin")
    assert not is_safe_to_open(bundle)


def test_the_copy_that_is_rendered_packs_nothing_into_the_open_file(sphere, scene, tmp_path):
    rigged(scene)
    for name in ("there", "gone"):
        image = bpy.data.images.new(name, 8, 8)
        image.filepath_raw, image.file_format, image.use_fake_user = str(tmp_path / f"{name}.png"), "PNG", True
        image.save()
        image.source = "FILE"
    (tmp_path / "gone.png").unlink()
    bpy.data.use_autopack = True
    try:
        written_job(bpy.context, "normals", tmp_path / "truth.exr", tmp_path)
        assert bpy.data.use_autopack and not any(image.packed_file for image in bpy.data.images)
    finally:
        bpy.data.use_autopack = False


@pytest.mark.skipif(sys.platform == "win32", reason="no pipes in folders")
def test_of_a_cache_beside_the_file_plain_files_alone_are_copied(sphere, scene, tmp_path):
    rigged(scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    caches = tmp_path / "blendcache_scene"
    (caches / "bakes").mkdir(parents=True)
    (caches / "bakes" / "frame.json").write_text("{}")
    (caches / "device").symlink_to(os.devnull)
    (caches / "round").symlink_to(caches)
    os.mkfifo(caches / "pipe")
    job = tmp_path / "job"
    job.mkdir()
    written_job(bpy.context, "normals", tmp_path / "truth.exr", job)
    copied = [path.relative_to(job) for path in (job / caches.name).rglob("*") if path.is_file()]
    assert copied == [Path("blendcache_scene/bakes/frame.json")]


# --- what settings are ------------------------------------------------------------------------------------------------


def preset(scene, step, name, value):
    """Put a setting into the scene's data as a file holds it, whatever the setting may be."""
    held = scene.bl_system_properties_get(do_create=True) if bpy.app.version >= (5, 0) else scene
    for part in ("mps", step):
        if part not in held:
            held[part] = {}
        held = held[part]
        if part == "mps" and step in STEPS:
            held = held["rigs"][0]
    held[name] = value


@pytest.mark.parametrize(
    ("step", "name", "value"),
    [
        ("rig", "light_type", 99),
        ("estimate", "model", -7),
        ("bake", "file_format", 99),
        ("photo", "width", -1000),
        ("rig", "distance", math.nan),
        ("rig", "tilt", math.inf),
    ],
)
def test_what_nobody_could_have_set_is_as_new_in_an_opened_file(scene, tmp_path, step, name, value):
    group = getattr(scene.mps, step)
    new = group.bl_rna.properties[name].default
    preset(scene, step, name, value)
    assert getattr(group, name) != new
    scene.mps.chosen_rig = 5
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hostile.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "hostile.blend"))
    opened = bpy.context.scene.mps
    assert getattr(getattr(opened, step), name) == new
    assert opened.chosen_rig == 0


# --- what images and nodes hold ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [5, [1, 2], {"a": 1}, b"\xff", "{", "[" * 100_000, "5", "--help"], ids=lambda _: "")
def test_what_an_image_remembers_may_be_anything(photographed, scene, tmp_path, value):
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.png"))
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
    for image in (scene.mps.photo.image, scene.mps.estimate.image, scene.mps.bake.image):
        for what in ("source", "made", "made_by", "made_from", "onto", "lens", "base", "base_convention"):
            image[f"mpsnet_{what}"] = value
        assert made_when(image) == ""
    assert Kind.FAILED not in kinds()
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.png"))
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
    scene.mps.photo.image["mpsnet_rig"] = value
    if not isinstance(value, str):  # it has none then, and the rig as it stands is taken
        bpy.ops.mps.estimate(output=str(tmp_path / "normals.png"))


def test_nodes_and_modifiers_that_have_the_names_of_ours_by_chance_stay(estimated, scene, tmp_path):
    tree = estimated.data.materials[0].node_tree
    strangers = {}
    for name in ("MPS Texture", "MPS Normal", "MPS UV", "MPS Green", "MPS Height", "MPS Displacement", "MPS Before"):
        strangers[name] = node = tree.nodes.new("ShaderNodeMath")
        node.name, node.label = name, name
    for name in ("MPS Subdivision", "MPS Displace"):
        estimated.modifiers.new(name, "WELD")
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "texture.png"))
    bpy.ops.mps.displace(output=str(tmp_path / "heights.exr"))
    assert {node.label for node in tree.nodes if node.type == "MATH"} == {*strangers}
    assert tree.nodes["MPS Height"].image and tree.nodes["MPS Texture"].image
    subdivide(estimated, "SIMPLE", 1, 1)
    move_by_modifier(estimated, scene.mps.bake.image, "UVMap", 1, 0.5)
    kinds = {modifier.name: modifier.type for modifier in estimated.modifiers}
    assert kinds.pop("MPS Subdivision") == "SUBSURF" and kinds.pop("MPS Displace") == "DISPLACE"
    assert list(kinds.values()) == ["WELD", "WELD"]


@pytest.mark.parametrize("kept", ["{", "[]", json.dumps({"type": "NONE", "studiolight_intensity": "x"})])
def test_relight_ends_whatever_the_file_says_of_the_shading_before(sphere, scene, kept):
    view = next(area for area in bpy.context.window.screen.areas if area.type == "VIEW_3D")
    with bpy.context.temp_override(area=view):
        bpy.ops.mps.relight()
        scene.mps.relight.shading = kept
        bpy.ops.mps.relight()
    assert scene.mps.relight.lamp is None and scene.mps.relight.shading == ""


def test_a_very_long_text_is_cut_before_it_is_measured():
    longest = 0

    def measure(text):
        nonlocal longest
        longest = max(longest, len(text))
        return len(text)

    assert sum(map(len, lines("x" * 5000, 30, measure))) <= 500
    assert len(shortened("x" * 5000, 30, measure)) == 30
    assert longest <= 501


# --- what a render does -----------------------------------------------------------------------------------------------


def test_a_scenes_own_outputs_and_freestyle_modules_are_not_in_the_render(sphere, scene, tmp_path):
    """The compositor of the file's scene would write, its Freestyle run a module."""
    rigged(scene)
    scene.name = "MPS Studio"  # as ours
    scene.render.engine = "CYCLES"
    scene.cycles.shading_system = True
    ran = tmp_path / "ran"
    ran.mkdir()
    scene.render.filepath = str(ran / "still")
    scene.render.use_freestyle = scene.render.use_multiview = scene.render.use_compositing = True
    text = bpy.data.texts.new("module.py")
    text.write(f"open({str(ran / 'freestyle')!r}, 'w')\n")
    freestyle = scene.view_layers[0].freestyle_settings
    freestyle.mode = "SCRIPT"
    freestyle.modules.new().script = text
    if bpy.app.version >= (5, 0):
        scene.compositing_node_group = tree = bpy.data.node_groups.new("Outputs", "CompositorNodeTree")
    else:
        scene.use_nodes = True
        tree = scene.node_tree
    output, layers = tree.nodes.new("CompositorNodeOutputFile"), tree.nodes.new("CompositorNodeRLayers")
    if bpy.app.version >= (5, 0):
        output.directory, output.file_name = str(ran), "composited"
        output.file_output_items.new("RGBA", "Image")
    else:
        output.base_path = str(ran)
    tree.links.new(layers.outputs[0], output.inputs[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hostile.blend"))
    job = tmp_path / "job"
    job.mkdir()
    truth = tmp_path / "truth.exr"
    CoreProcess(written_job(bpy.context, "normals", truth, job), [truth], rendering_blender(job)).result()
    assert truth.is_file() and not list(ran.iterdir())


@pytest.fixture
def theirs(sphere, scene, tmp_path):
    """A folder that nobody may change, as the place of a fluid's, a cloth's and particles' caches in the open file."""
    rigged(scene)
    theirs = tmp_path / "theirs"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hostile.blend"))
    for kind, size in (("DOMAIN", 4), ("FLOW", 1)):
        bpy.ops.mesh.primitive_cube_add(size=size)
        fluid = bpy.context.object.modifiers.new("Fluid", "FLUID")
        fluid.fluid_type = kind
        if kind == "DOMAIN":
            fluid.domain_settings.resolution_max, fluid.domain_settings.cache_directory = 8, str(theirs)
    bpy.ops.mesh.primitive_plane_add()
    cloth = bpy.context.object.modifiers.new("Cloth", "CLOTH").point_cache
    bpy.context.object.modifiers.new("Particles", "PARTICLE_SYSTEM")
    for name, cache in (("cloth", cloth), ("../particles", bpy.context.object.particle_systems[0].point_cache)):
        cache.use_disk_cache = True
        cache.filepath = str(theirs / "points")
        cache.use_external = True
        cache.name = name
    bpy.ops.wm.save_mainfile()
    yield theirs
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)  # nothing simulates any longer


@pytest.mark.parametrize("what", ["photo", "sample"])
def test_no_simulation_writes_or_clears_where_the_file_says(theirs, tmp_path, what):
    folder, output = tmp_path / "job", tmp_path / "output"
    for made in (folder, output):
        made.mkdir()
    if what == "sample":
        bpy.ops.wm.save_as_mainfile(filepath=str(output / SCENE_FILE), copy=True)
        job = SampleJob("cycles", 1, seed=1, size=16, samples=4, shapes=("scene",), objects=("Sphere",), views=1)
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    else:
        output = output / "photo.exr"
        arguments = written_job(bpy.context, "photo", output, folder)
    shutil.rmtree(theirs, ignore_errors=True)  # what this Blender has written there
    for name in ("data", "points"):
        (theirs / name).mkdir(parents=True)
        (theirs / name / "mine.txt").write_text("mine")
    if what == "sample":
        _make(job, 0, output / "sample_000000.exr")
    else:
        CoreProcess(arguments, [output], rendering_blender(folder)).result()
    assert sorted(path.name for path in theirs.rglob("*")) == ["data", "mine.txt", "mine.txt", "points"]


def test_what_a_fluid_has_on_disk_is_in_the_render(theirs, tmp_path):
    (theirs / "data").mkdir(parents=True, exist_ok=True)
    kept = theirs / "data" / "fluid_data_0001.vdb"
    kept.write_bytes(b"kept")
    for name in ("fluid_data_0009.vdb", "letter.txt"):
        (theirs / "data" / name).touch()
    os.mkfifo(theirs / "data" / "smoke_0001.vdb")
    with simulations_write_into(tmp_path / "caches"):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "hostile.blend"))
    domain = bpy.data.objects["Cube"].modifiers["Fluid"].domain_settings
    copied = Path(domain.cache_directory) / "data"
    assert (copied / kept.name).read_bytes() == b"kept" and kept.read_bytes() == b"kept"
    assert not any((copied / name).exists() for name in ("fluid_data_0009.vdb", "letter.txt", "smoke_0001.vdb"))
