"""Settings live in the scene: they outlast the session, and do not depend on what anything is called."""

import json
import subprocess
import sys

import bpy
import pytest

from blender_addon.settings.declared import options_of
from blender_addon.settings.messages import in_blender
from mpsnet_core import Bake, BakeViews, CalibrateLights, Estimate, InputError, Superpose, Synthesize
from mpsnet_core.operation import settings as options
from mpsnet_core.relief.operations import Integrate, MakeMaterial

# Run by a process of its own: what it finds in the file is what was saved, not what this process still knows.
READS = """
import json, runpy, sys
import bpy, blender_addon
blender_addon.register()
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
values = runpy.run_path(sys.argv[2])["values"]
print("found:" + json.dumps(values(bpy.context.scene)))
"""


def settings(scene):
    """(group, property) of every setting of every step."""
    for step in scene.mps.bl_rna.properties:
        if step.type == "POINTER" and step.identifier != "rna_type":
            group = getattr(scene.mps, step.identifier)
            for one in group.bl_rna.properties:
                if one.identifier not in {"rna_type", "name"} and not one.is_readonly:
                    yield group, one


def values(scene):
    found = {}
    for group, one in settings(scene):
        value = getattr(group, one.identifier)
        value = sorted(value) if isinstance(value, set) else value
        found[f"{group.bl_rna.identifier}.{one.identifier}"] = value.name if hasattr(value, "session_uid") else value
    return found


def another(one, things):
    """A value of a property that is not its default."""
    if one.type == "POINTER":
        return things[one.fixed_type.identifier, one.identifier == "camera"]
    if one.type == "STRING":
        return f"//{one.identifier}"
    if one.type == "BOOLEAN":
        return not one.default
    if one.type == "ENUM":
        if one.is_enum_flag:
            return {next(iter(one.default_flag))}
        return next(item.identifier for item in one.enum_items if item.identifier != one.default)
    step = 1 if one.type == "INT" else (one.hard_max - one.default) / 1e4 or 1
    return one.default + step if one.default + step <= one.hard_max else one.default - step


def test_every_setting_survives_saving_and_loading(sphere, scene, tmp_path):
    camera = bpy.data.objects.new("Some Camera", bpy.data.cameras.new("Some Camera"))
    scene.collection.objects.link(camera)
    image = bpy.data.images.new("Some Image", 4, 4)
    image.pack()
    things = {
        ("Object", False): sphere,
        ("Object", True): camera,
        ("Image", False): image,
        ("Collection", False): bpy.data.collections.new("Some Collection"),
    }
    before = values(scene)
    for group, one in settings(scene):
        setattr(group, one.identifier, another(one, things))
    changed = values(scene)
    assert [name for name in changed if changed[name] == before[name]] == []
    assert len(changed) > 80
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    done = subprocess.run(
        [sys.executable, "-c", READS, tmp_path / "scene.blend", __file__], capture_output=True, text=True
    )
    (line,) = [line for line in done.stdout.splitlines() if line.startswith("found:")] or [done.stderr]
    assert json.loads(line.removeprefix("found:")) == json.loads(json.dumps(changed))


def rename_everything():
    for datablocks in (bpy.data.objects, bpy.data.images, bpy.data.scenes, bpy.data.collections, bpy.data.materials):
        for datablock in datablocks:
            datablock.name = f"renamed {datablock.name}"


def test_each_step_goes_on_after_everything_was_renamed(sphere, scene, tmp_path):
    bpy.ops.mps.add_rig()
    rename_everything()
    bpy.ops.mps.render_photo(width=32, height=32, samples=1, output=str(tmp_path / "photo.exr"))
    rename_everything()
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.png"))
    rename_everything()
    scene.mps.bake.target = sphere
    rename_everything()
    bpy.ops.mps.bake(size=32, output=str(tmp_path / "texture.png"))
    rename_everything()
    texture = scene.mps.bake.image
    assert texture in [node.image for node in sphere.active_material.node_tree.nodes if node.type == "TEX_IMAGE"]
    bpy.ops.mps.remove_rig()
    assert list(bpy.data.objects) == [sphere]


@pytest.mark.parametrize("verb", ["estimate", "bake_views"])
def test_what_runs_networks_honours_the_preferences(photographed, scene, tmp_path, monkeypatch, verb):
    """pip's bpy has no preferences of add-ons, so what they would say is put in their place."""
    chosen = {"threads": 3, "provider": "CUDA"}
    monkeypatch.setattr("blender_addon.photo.options.preference", chosen.get)
    given = []

    def run(operation, *_):
        given.append(operation)
        raise InputError("far enough")

    monkeypatch.setattr("blender_addon.operators.core_run.run", run)
    scene.mps.rig.camera.data.background_images.new().image = scene.mps.photo.image
    with pytest.raises(RuntimeError, match="far enough"):
        getattr(bpy.ops.mps, verb)()
    [operation] = given
    assert (operation.threads, operation.provider) == (3, "cuda")


@pytest.mark.parametrize(
    ("operation", "step", "own"),
    [
        (Bake, "bake", {"margin": 16, "convention": "opengl"}),
        (BakeViews, "views", {}),
        (CalibrateLights, "calibrate", {"radius": 1.0}),
        (Estimate, "estimate", {"model": "MULTISCALE"}),
        (Integrate, "displace", {"scale": 0.01}),
        (Integrate, "heights", {}),
        (MakeMaterial, "material", {"model": "AUTO"}),
        (Superpose, "superpose", {}),
        (Synthesize, "samples", {"count": 100, "bounces": 3}),
    ],
)
def test_untouched_settings_are_the_core_s_defaults_but_for_a_few(scene, operation, step, own):
    defaults = {setting.name: setting.default for setting in options(operation)}
    given = options_of(operation, getattr(scene.mps, step))
    assert given and {name: value for name, value in given.items() if value != defaults[name]} == own


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("say where that was (--white-light)", "say where that was (White Light)"),
        ("set the encoding to linear (--encoding linear)", "set the encoding to linear (Encoding: Linear)"),
        ("it fits if its y axis points up (--up y)", "it fits if its y axis points up"),
        ("combine them with mpsnet superpose --channels [alike]", "combine them with Make One Photo [alike]"),
        ("find them by mpsnet calibrate lights", "find them by Find Lights"),
        ("see mpsnet estimate. Then", "see Estimate Normals. Then"),
        *(("choose them: mpsnet calibrate lights a.lp --lights 1,2,3 -o rig.json",) * 2,),
        *(("run mpsnet estimate photo.exr",) * 2, ("mpsnet only",) * 2),
        ("choose another output, or give --overwrite", "choose another output"),
        ("take a mask, or give --dark [room]", "take a mask, or give Dark Frame [room]"),
        ("a lens (mm) -- or none", "a lens (mm) -- or none"),
        *((f"cannot read {name}",) * 2 for name in ("a/--mask.png", "a/--white", '"--white"', "x--white-light.png")),
    ],
)
def test_messages_of_the_core_speak_of_fields_and_buttons(said, shown):
    assert in_blender(said) == shown == in_blender(shown)


@pytest.mark.parametrize(
    ("place", "items"),
    [
        ("bake.preset", "CUSTOM BLENDER UNREAL UNITY GODOT GLTF"),
        ("bake.space", "TANGENT OBJECT"),
        ("bake.convention", "OPENGL DIRECTX"),
        ("bake.samples", "1 2 4"),
        ("bake.padding", "NEAREST PUSH_PULL NONE"),
        ("bake.bits", "AUTO 8 16 32"),
        ("bake.onto_convention", "OPENGL DIRECTX"),
        ("bake.onto_shown", "AUTO YES NO"),
        ("estimate.encoding", "AUTO LINEAR SRGB"),
        ("heights.method", "FAST BILATERAL"),
        ("views.lights_in", "CAMERA WORLD"),
    ],
)
def test_choices_keep_their_places_which_saved_files_hold(scene, place, items):
    group, name = place.split(".")
    known = getattr(scene.mps, group).bl_rna.properties[name].enum_items
    assert [item.identifier for item in known] == items.split()
    assert [item.value for item in known] == list(range(len(known)))
