"""Bad input: one sentence, to scripts as a RuntimeError."""

import tempfile

import bpy
import pytest

from blender_addon.commands import main

mps = bpy.ops.mps


def delete(obj):
    bpy.data.objects.remove(obj)


def captured(scene):
    """As if photo and normals came from outside, taken by the rig's camera, so that the rig in the scene counts."""
    for image in (scene.mps.photo.image, scene.mps.estimate.image):
        for key in {"mpsnet_rig", "mpsnet_camera"} & set(image.keys()):
            del image[key]
    scene.mps.photo.image["mpsnet_made_by"] = "open_photo"
    scene.mps.photo.image.mps.camera = scene.mps.rig.camera


def a_single_point(scene, tmp_path):
    mesh = bpy.data.meshes.new("Point")
    mesh.from_pydata([(0, 0, 0)], [], [])
    obj = bpy.data.objects.new("Point", mesh)
    scene.collection.objects.link(obj)
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.ops.mps.add_rig()


def no_rig(scene, tmp_path):
    bpy.ops.mps.remove_rig()
    bpy.ops.mps.render_photo()


def target_deleted(scene, tmp_path):
    captured(scene)
    delete(scene.mps.rig.target)
    bpy.ops.mps.estimate()


def light_in_the_target(scene, tmp_path):
    captured(scene)
    bpy.ops.mps.add_rig(light_type="AREA")
    scene.mps.rig.lights[0].object.location = (0, 0, 0)
    bpy.ops.mps.estimate()


def lights_off(scene, tmp_path):
    captured(scene)
    for light in scene.mps.rig.lights:
        light.object.data.energy = 0
    bpy.ops.mps.estimate()


def photo_not_an_image(scene, tmp_path):
    (tmp_path / "text.png").write_text("not an image")
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "text.png"))


def no_target(scene, tmp_path):
    bpy.context.view_layer.objects.active = None
    bpy.ops.mps.bake()


def target_scaled_to_nothing(scene, tmp_path):
    bpy.context.object.scale.z = 0
    bpy.ops.mps.bake()


def folder_a_file(scene, tmp_path):
    (tmp_path / "photo").touch()
    bpy.ops.mps.render_samples(output=str(tmp_path / "photo"))


def no_mesh_selected(scene, tmp_path):
    bpy.ops.object.select_all(action="DESELECT")
    bpy.ops.object.empty_add()
    bpy.ops.mps.render_samples(source="SCENE", output=str(tmp_path / "samples"))


def painted_image_not_saved(scene, tmp_path):
    image = bpy.data.images.new("Painted", 8, 8)
    image.pixels[0] = 0.5
    bpy.ops.mps.render_samples(source="SCENE", output=str(tmp_path / "samples"))


CASES = [
    (a_single_point, "a single point"),
    (lambda _, here: mps.add_rig(view="VIEWPORT"), 'view "VIEWPORT" needs a 3D viewport'),
    (no_rig, "Add a rig first"),
    (target_deleted, "the rig's target was deleted; add the rig again"),
    (light_in_the_target, 'light "MPS Red" stands in the rig\'s target'),
    (lights_off, "the rig's lights are all black"),
    (lambda _, here: mps.open_photo(), "no photo was named"),
    (lambda _, here: mps.open_photo(filepath=str(here / "nowhere.png")), "nowhere.png does not exist; check the path"),
    (photo_not_an_image, "cannot be read as an image"),
    (lambda _, here: mps.render_photo(output=str(here / "photo.png")), "renders are written as OpenEXR"),
    (lambda _, here: mps.render_photo(output=str(here / "nowhere" / "photo.exr")), "does not exist; create it first"),
    (lambda _, here: mps.estimate(mask="FILE", mask_file=str(here / "nowhere.png")), "nowhere.png does not exist"),
    (lambda _, here: mps.estimate(model="FILE", model_file=str(here / "nowhere.onnx")), "nowhere.onnx does not exist"),
    (lambda _, here: mps.estimate(output=str(here / "normals.jpg")), "the ending .jpg is not known"),
    (no_target, "there is no target to bake onto"),
    (lambda _, here: mps.bake(target="Nobody"), 'there is no object "Nobody" in the scene'),
    (lambda scene, here: mps.bake(target=scene.mps.rig.lights[0].object.name), "is not a mesh but light"),
    (target_scaled_to_nothing, '"Sphere" is scaled to nothing in one direction; give it a scale above 0'),
]


@pytest.mark.parametrize(("wrong", "sentence"), CASES, ids=[sentence for _, sentence in CASES])
def test_bad_input_is_one_sentence(wrong, sentence, estimated, scene, tmp_path):
    scene.mps.estimate.output = ""
    refused(wrong, sentence, scene, tmp_path)


TRAINING_DATA_CASES = [
    (lambda _, here: mps.render_samples(output=""), "no folder is named for the samples; name one"),
    (lambda _, here: mps.render_samples(output=str(here / "no" / "samples")), "does not exist; create it first"),
    (folder_a_file, "photo is a file; name a folder for the samples"),
    (
        lambda _, here: mps.render_samples(source="MESHES", meshes=str(here / "none"), output=str(here / "samples")),
        "none does not exist; check the path",
    ),
    (no_mesh_selected, "no mesh object is selected; select what the samples are to show"),
    (painted_image_not_saved, 'the image "Painted" was changed and not saved; save or pack it first'),
]


@pytest.mark.parametrize(
    ("wrong", "sentence"), TRAINING_DATA_CASES, ids=[sentence for _, sentence in TRAINING_DATA_CASES]
)
def test_bad_input_for_training_data_is_one_sentence(wrong, sentence, scene, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    refused(wrong, sentence, scene, tmp_path)
    assert not (tmp_path / "samples" / "job.json").exists() or wrong is painted_image_not_saved


def refused(wrong, sentence, scene, tmp_path):
    with pytest.raises(RuntimeError) as caught:
        wrong(scene, tmp_path)
    message = str(caught.value).removeprefix("Error: ").strip()
    assert sentence in message
    assert "\n" not in message and "Traceback" not in message
    assert not [path for path in tmp_path.rglob("*") if "unfinished" in path.name]


def test_a_disk_that_fails_is_one_sentence(scene, tmp_path, monkeypatch):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8)
    bpy.ops.mps.add_rig()
    bpy.ops.mps.render_photo(width=16, height=16, samples=1, output=str(tmp_path / "photo.exr"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "gone"))
    for verb in (bpy.ops.mps.render_photo, bpy.ops.mps.estimate):
        with pytest.raises(RuntimeError) as caught:
            verb()
        message = str(caught.value).removeprefix("Error: ").strip()
        assert str(tmp_path / "gone") in message and "make room" in message
        assert "\n" not in message and "Traceback" not in message


def test_the_command_line_gives_exit_code_2_and_the_sentence(scene, capfd, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.name = "Hidden"
    bpy.context.object.hide_set(True)
    excluded = bpy.data.collections.new("Excluded")
    scene.collection.children.link(excluded)
    excluded.objects.link(bpy.data.objects.new("Excluded", bpy.data.meshes.new("Excluded")))
    bpy.context.view_layer.layer_collection.children["Excluded"].exclude = True
    bpy.ops.mesh.primitive_cube_add()
    bad = [
        (["bake"], "Estimate the normals first"),
        (["bake", "--size", "huge"], "invalid integer value: 'huge'"),
        (["bake", "--size", "99999999999"], "invalid integer value"),
        (["add-rig", "--object", "Nobody"], 'there is no object "Nobody"'),
        (["add-rig", "--object", "Excluded"], '"Excluded" is in no collection of this view layer; include one of'),
        (["add-rig", "--object", "Hidden"], '"Hidden" is hidden or not selectable; show it first'),
        (["add-rig", "--object", "Cube", "--object", "Hidden"], '"Hidden" is hidden or not selectable; show it first'),
        (["add-rig", "--view", "sideways"], "invalid choice"),
        (["add-rig", "--save", str(tmp_path / "no" / "x.blend")], "its folder does not exist"),
        (["dance"], "invalid choice: 'dance'"),
        (["render-samples", "--kinds", "blobs,cubes"], "'CUBES' is none of BLOBS"),
        (["render-samples", "--output", str(tmp_path / "no" / "samples")], "does not exist; create it first"),
    ]
    for arguments, sentence in bad:
        assert main(arguments) == 2
        captured = capfd.readouterr().err.strip()
        assert captured.startswith("mpsnet: ") and sentence in captured and "\n" not in captured


def test_what_nobody_foresaw_is_one_sentence_that_names_a_log(sphere, tmp_path, monkeypatch, capfd):
    """To a script, and on the command line."""

    def fails(self, context):
        return {}["\x1b[2J"]

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr("blender_addon.rig.rig.MPS_OT_add_rig.act", fails)
    with pytest.raises(RuntimeError, match=r"this is a fault of the program, not yours \(KeyError: '.x1b\[2J'\)"):
        bpy.ops.mps.add_rig()
    (log,) = tmp_path.glob("mpsnet-*.log")
    assert "in fails" in log.read_text()
    capfd.readouterr()
    assert main(["add-rig"]) == 2
    assert "Traceback" not in capfd.readouterr().err
