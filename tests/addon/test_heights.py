"""Make Height: which camera the heights are of, and where their mesh goes."""

import json

import bpy
import numpy as np
import pytest

from mpsnet_core.io.image_writing import write_image


@pytest.fixture
def own_photo(photographed, scene, tmp_path):
    """A photo of one's own, nothing beside it, in a scene whose rig has an orthographic camera."""
    write_image(tmp_path / "own.png", np.full((48, 64, 3), 0.5, np.float32), bits=8)
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "own.png"))


def height(tmp_path):
    """What the heights' file tells of their camera."""
    bpy.ops.mps.integrate(output=str(tmp_path / "h.exr"), mesh=False)
    return json.loads((tmp_path / "h.exr.json").read_text())["camera"]


def test_heights_are_seen_through_the_lens_that_the_normals_were_estimated_with(own_photo, scene, tmp_path):
    bpy.ops.mps.estimate(lens=50, output=str(tmp_path / "n.png"))
    for told_later in (50, 0, 85):
        scene.mps.estimate.lens = told_later
        camera = height(tmp_path)
        assert camera["projection"] == "perspective"
        assert camera["focal"][0] == pytest.approx(64 * 50 / 36)


def surface(tmp_path):
    bpy.ops.mps.integrate(output=str(tmp_path / "h.exr"), faces=200)
    return bpy.context.scene.mps.estimate.mesh


def test_the_mesh_takes_the_place_of_the_one_before_whatever_that_is_called(estimated, scene, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    mine = bpy.context.object
    mine.name = "MPS Surface"
    first = surface(tmp_path)
    assert first != mine and len(mine.data.vertices) == 8
    first.name = "Statue"
    material = bpy.data.materials.new("Marble")
    first.data.materials.append(material)
    meshes = len(bpy.data.meshes)
    assert surface(tmp_path) == first and first.data.materials[:] == [material]
    assert len(bpy.data.meshes) == meshes
    bpy.data.objects.remove(first)
    assert surface(tmp_path).name in scene.objects


def test_each_rig_has_a_mesh_of_its_own(estimated, scene, tmp_path):
    first = surface(tmp_path)
    bpy.ops.mps.new_rig()
    assert scene.mps.estimate.mesh is None
    bpy.ops.mps.open_photo(filepath=str(tmp_path / "photo.exr"))
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "second.png"))
    assert surface(tmp_path) != first and first.name in scene.objects


@pytest.mark.parametrize("ending", [".ply", "_curvature.png"])
def test_a_scan_of_that_name_is_not_written_over(estimated, tmp_path, ending):
    scan = tmp_path / f"h{ending}"
    scan.write_text("mine")
    with pytest.raises(RuntimeError, match="is there already and was not made with"):
        bpy.ops.mps.integrate(output=str(tmp_path / "h.exr"), curvature=True)
    assert scan.read_text() == "mine" and not (tmp_path / "h.exr").exists()
    scan.unlink()
    for _ in range(2):  # over its own it writes
        bpy.ops.mps.integrate(output=str(tmp_path / "h.exr"), curvature=True, faces=200)
