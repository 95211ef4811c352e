"""Settings live in the scene: they outlast the session, and do not depend on what anything is called."""

import json
import subprocess
import sys

import bpy
import pytest

from mpsnet_core.errors import InputError

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
    monkeypatch.setattr("blender_addon.estimate.estimate.preference", chosen.get)
    given = []

    def run(arguments, *_):
        given.extend(arguments)
        raise InputError("far enough")

    monkeypatch.setattr("blender_addon.operators.run", run)
    scene.mps.rig.camera.data.background_images.new().image = scene.mps.photo.image
    with pytest.raises(RuntimeError, match="far enough"):
        getattr(bpy.ops.mps, verb)()
    assert given[given.index("--threads") + 1] == "3"
    assert given[given.index("--provider") + 1] == "cuda"
