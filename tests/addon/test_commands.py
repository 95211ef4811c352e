"""Commands of Blender: what they say and where, what they write, and that a run changes nothing it did not name."""

import json
import shutil

import bpy
import pytest

from blender_addon.commands import _refuse_unopened, main
from blender_addon.preferences import preference
from mpsnet_core.errors import FileError, SettingsError


def objects_of(*lines: str) -> list[dict]:
    """What is said as JSON; Blender prints lines of its own between."""
    return [json.loads(line) for line in lines if line.startswith("{")]


def test_a_copied_file_leaves_the_results_of_the_first_alone(estimated, tmp_path):
    first, second = tmp_path / "v1", tmp_path / "v2"
    first.mkdir()
    for step, argv in {
        "normals": ["estimate", "--output", first / "normals.png"],
        "done": ["bake", "--target", "Sphere", "--size", "16", "--output", first / "texture.png"],
        "height": ["integrate", "--output", first / "height.png"],
    }.items():
        assert main([*map(str, argv), "--save", str(first / f"{step}.blend")]) == 0
    shutil.copytree(first, second)
    before = {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in first.iterdir()}
    bpy.ops.wm.open_mainfile(filepath=str(second / "height.blend"))
    for verb in ("estimate", "bake", "integrate"):
        assert main([verb]) == 0
    assert {file: (file.read_bytes(), file.stat().st_mtime_ns) for file in first.iterdir()} == before
    assert len(list(second.iterdir())) > len(before)


def test_a_file_that_blender_could_not_open_is_refused(scene, tmp_path):
    cut = tmp_path / "cut.blend"
    cut.write_bytes(b"BLENDER")
    for before in (["-b", "nosuch.blend"], ["-b", str(cut)], ["--background", "nosuffix"], ["-b", "-Y", "x.blend1"]):
        with pytest.raises(FileError, match="cannot open"):
            _refuse_unopened(["blender", *before, "--command", "mpsnet", "add-rig"])
    for before in (["-b"], ["-b", "--python", "made.py"], ["-b", "--addons", "a", "-E", "CYCLES"]):
        _refuse_unopened(["blender", *before, "--command", "mpsnet", "add-rig", "--save", "new.blend"])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "there.blend"))
    _refuse_unopened(["blender", "-b", str(tmp_path / "there.blend"), "--command", "mpsnet", "add-rig"])


def test_settings_that_stay_in_the_scene_are_named_and_numbers_are_not_clamped(estimated, scene, tmp_path, capsys):
    assert main(["bake", "--tiles", "--size", "16", "--preset", "UNREAL", "--output", f"{tmp_path}/"]) == 0
    (line,) = [line for line in capsys.readouterr().err.splitlines() if "later runs" in line]
    assert all(name in line for name in ("UDIM Tiles", "Size", "Preset", "Convention"))
    bpy.ops.mps.bake(size=16, output=f"{tmp_path}/")
    assert "later runs" not in capsys.readouterr().out
    for operator, wrong in (
        (bpy.ops.mps.bake, {"size": 100000}),
        (bpy.ops.mps.bake, {"strength": 2.5}),
        (bpy.ops.mps.render_photo, {"width": 0}),
        (bpy.ops.mps.add_rig, {"slant": 100.0}),
        (bpy.ops.mps.add_rig_ring, {"count": 100}),
        (bpy.ops.mps.try_it, {"pixels": 100000}),
    ):
        with pytest.raises(RuntimeError, match="is out of range; choose"):
            operator(**wrong)
    assert scene.mps.bake.size == 16 and main(["bake", "--size", "100000"]) == 2


def test_notes_progress_and_results_are_told_as_json(estimated, scene, tmp_path, capsys):
    half = scene.objects["Sphere"].data.uv_layers[0].uv
    for number in range(0, len(half), 2):
        half[number].vector.x += 5
    argv = ["bake", "--target", "Sphere", "--size", "16", "--output", str(tmp_path / "texture.png")]
    assert main(argv) == 0
    plain = capsys.readouterr()
    assert "note: " in plain.err and "outside" in plain.err and "seen" in plain.err
    assert f"bake done: {tmp_path / 'texture.png'}" in plain.out
    assert main([*argv, "--progress", "json", "--save", str(tmp_path / "done.blend")]) == 0
    told = objects_of(*capsys.readouterr().out.splitlines())
    assert all("time" in one for one in told) and told[0]["progress"] == 0 and told[-2]["progress"] == 1
    result = told[-1]["result"]
    assert result["written"] == [str(tmp_path / "texture.png")] and 0 < result["seen"] < 1
    assert any("outside" in note for note in result["notes"]) and result["saved"] == str(tmp_path / "done.blend")
    assert json.loads(scene.mps.records["bake"].result)["seen"] == result["seen"]
    assert main(["bake", "--target", "nobody", "--progress", "json"]) == 2
    assert "nobody" in objects_of(*capsys.readouterr().out.splitlines())[-1]["error"]


def test_frames_of_an_interrupted_render_are_kept_and_all_files_named(sphere, scene, tmp_path, capsys):
    bpy.ops.mps.add_rig()
    sphere.keyframe_insert("rotation_euler", frame=1)
    sphere.rotation_euler.x = 1
    sphere.keyframe_insert("rotation_euler", frame=3)
    scene.frame_start, scene.frame_end = 1, 3
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    argv = ["render-photo", "--animation", "--width", "16", "--height", "16", "--output", str(tmp_path / "frames")]

    def run(*more: str) -> tuple[list[str], list[int]]:
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
        assert main([*argv, "--samples", "1", "--progress", "json", *more]) == 0
        written = objects_of(*capsys.readouterr().out.splitlines())[-1]["result"]["written"]
        return written, [(tmp_path / f"frames/frames_{frame:04}.exr").stat().st_mtime_ns for frame in (1, 2, 3)]

    named, first = run()
    assert sorted(named) == sorted(map(str, (tmp_path / "frames").iterdir())) and len(named) == 9
    (tmp_path / "frames/frames_0002.exr").write_bytes(b"cut short")
    again, second = run()
    assert again == named and [a == b for a, b in zip(first, second, strict=True)] == [True, False, True]
    third = run("--width", "20")[1]
    assert not set(third) & set(second), "another size"
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.data.objects["Sphere"].scale.x = 0.5
    bpy.ops.wm.save_mainfile()
    assert not set(run("--width", "20")[1]) & set(third), "another scene"
    assert main(["render-truth", "--output", str(tmp_path / "true.exr")]) == 0
    assert str(tmp_path / "true.exr") in capsys.readouterr().out


def test_texture_files_alone_leave_linked_and_local_data_as_it_is(estimated, scene, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "asset.blend"), copy=True)
    with bpy.data.libraries.load(str(tmp_path / "asset.blend"), link=True) as (_, given):
        given.objects = ["Sphere"]
    linked = given.objects[0]
    bpy.data.objects.remove(estimated)
    scene.collection.objects.link(linked)
    with pytest.raises(RuntimeError, match="linked"):
        bpy.ops.mps.bake(target="Sphere", size=32, output=str(tmp_path / "assigned.png"))

    def there() -> list[tuple[str, int]]:
        trees = [tree for material in bpy.data.materials if (tree := material.node_tree)]
        kinds = (bpy.data.images, bpy.data.materials, bpy.data.objects, bpy.data.meshes, bpy.data.node_groups)
        return [(one.name_full, one.users) for kind in kinds for one in kind] + [
            (node.name, len(node.inputs)) for tree in trees for node in tree.nodes
        ]

    before = there()
    bpy.ops.mps.bake(target="Sphere", size=32, assign=False, output=str(tmp_path / "texture.png"))
    after = there()
    assert (tmp_path / "texture.png").exists()
    # The panel's target is a setting of the scene.
    assert [one for one in after if one not in before] in ([], [("Sphere [asset.blend]", linked.users)])


def test_the_environment_names_the_output_folder_and_the_threads(estimated, tmp_path, monkeypatch):
    monkeypatch.setenv("MPSNET_OUTPUT_FOLDER", str(tmp_path / "farm"))
    (tmp_path / "farm").mkdir()
    bpy.ops.mps.bake(size=16)
    assert [file.name for file in (tmp_path / "farm").iterdir()] == ["Sphere_normal.png"]
    monkeypatch.setenv("MPSNET_THREADS", "3")
    assert preference("threads") == 3
    monkeypatch.setenv("MPSNET_THREADS", "many")
    with pytest.raises(SettingsError, match="MPSNET_THREADS"):
        preference("threads")
