"""Settings live in the scene: they outlast the session, and do not depend on what anything is called."""

import importlib
import json
import pkgutil
import subprocess
import sys

import bpy
import pytest

import blender_addon.settings
from mpsnet_core.bake.operations import Bake, BakeViews
from mpsnet_core.calibrate.operations import CalibrateLights
from mpsnet_core.capture.operations import Superpose
from mpsnet_core.errors import InputError
from mpsnet_core.estimate.operations import Estimate
from mpsnet_core.operation import settings as options
from mpsnet_core.relief.operations import Integrate, MakeMaterial
from mpsnet_core.synthesis.operations import Synthesize

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
        [sys.executable, "-c", READS, tmp_path / "scene.blend", __file__],
        capture_output=True,
        text=True,
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


# Of each class of settings the operation that they are for, and its options that are called otherwise in Blender.
OPERATIONS = {
    "BakeSettings": (Bake, {"onto_file": "onto"}),
    "CalibrateSettings": (CalibrateLights, {"ball_radius": "radius", "lens": "focal"}),
    "DisplaceSettings": (Integrate, {}),
    "EstimateSettings": (Estimate, {"lens": "focal"}),
    "HeightsSettings": (Integrate, {}),
    "MaterialSettings": (MakeMaterial, {}),
    "SamplesSettings": (Synthesize, {}),
    "SuperposeSettings": (Superpose, {}),
    "ViewsSettings": (BakeViews, {"write_report": "report"}),
}
# How the surface is moved, where the option says how normals are integrated; and what the core has as free text.
OTHER_THINGS = {("DisplaceSettings", "method"), ("EstimateSettings", "mask")}
# Items beside an option's choices; of a model every name is one.
MORE_ITEMS = {"preset": {"CUSTOM"}, "bits": {"AUTO"}, "model": None}
# Defaults that differ from the core's.
OWN_DEFAULTS = {
    ("BakeSettings", "margin"): 16,
    ("CalibrateSettings", "ball_radius"): 1.0,
    ("DisplaceSettings", "scale"): 0.01,
    ("SamplesSettings", "count"): 100,
    ("SamplesSettings", "bounces"): 3,
}
LEAST = {("CalibrateSettings", "ball_radius"): 1e-6}


def described():
    """(class and property, the property as Blender has it, the core's option) of all that the core describes."""
    modules = [
        importlib.import_module(f"{blender_addon.settings.__name__}.{module.name}")
        for module in pkgutil.iter_modules(blender_addon.settings.__path__)
    ]
    groups = [group for module in modules for group in vars(module).values() if hasattr(group, "bl_rna")]
    found = {}
    for group in groups:
        for base in group.__mro__:
            operation, names = OPERATIONS.get(base.__name__, (None, {}))
            for option in options(operation) if operation else ():
                for name in base.__annotations__:
                    if names.get(name, name) == option.name and (base.__name__, name) not in OTHER_THINGS:
                        found[base.__name__, name] = (group.bl_rna.properties[name], option)
    return found


def test_every_class_of_settings_names_its_operation():
    assert {name for name, _ in described()} == set(OPERATIONS)
    assert set(OWN_DEFAULTS) | set(LEAST) <= set(described())


def test_a_setting_is_what_the_core_s_option_is():
    """Range, default and choices: none is written down a second time."""
    faults = []
    for place, (one, option) in described().items():
        default = OWN_DEFAULTS.get(place, None if option.required or option.several else option.default)
        if one.type == "ENUM":
            more, items = MORE_ITEMS.get(one.identifier, set()), [item.identifier for item in one.enum_items]
            same = more is None or [item for item in items if item not in more] == identifiers(option.option.choices)
            same &= one.default == (items[0] if default is None else identifiers([default])[0])
        elif one.type in {"INT", "FLOAT"} and option.kind is not str:
            # Blender's own bounds, where the option has none.
            widest = 2**31 - 1 if one.type == "INT" else 3e38
            low = LEAST.get(place, 0 if default is None else option.option.low)
            high = option.option.high or widest
            same = one.hard_max >= widest if high >= widest else one.hard_max == pytest.approx(high)
            same &= one.hard_min < -1e9 if low is None else one.hard_min == pytest.approx(low)
            same &= one.default == pytest.approx(default or 0)
        else:
            same = option.kind is not bool or one.default == default
        if not same:
            faults.append(place)
    assert not faults


def identifiers(values):
    return [str(value).upper().replace("-", "_") for value in values]


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
