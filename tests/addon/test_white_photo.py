"""A second photo, under white light, in the panel: it reaches the estimate, and the albedo comes back."""

import bpy
import numpy as np
import pytest

from blender_addon.panels.estimate import MPS_PT_estimate
from blender_addon.panels.step import Kind
from mpsnet_core import read_albedo, read_image, write_image

from .rendering import shader_of

COLOUR = np.array([0.6, 0.3, 0.15])


@pytest.fixture
def white(photographed, tmp_path):
    """The grey sphere's photo as if it were painted and the lights had been white."""
    pixels = read_image(tmp_path / "photo.exr").pixels
    write_image(tmp_path / "white.exr", pixels.sum(axis=-1, keepdims=True) * COLOUR)
    return str(tmp_path / "white.exr")


def test_the_albedo_is_made_from_the_white_photo_and_shown(white, scene, tmp_path):
    bpy.ops.mps.estimate(model="LAMBERTIAN", white=white, albedo=True, output=str(tmp_path / "n.png"))
    assert scene.mps.estimate.albedo_image.filepath == str(tmp_path / "n_albedo.png")
    assert scene.mps.estimate.albedo_image.colorspace_settings.name == "sRGB"
    found = np.nanmedian(read_albedo(tmp_path / "n_albedo.png"), axis=(0, 1))
    np.testing.assert_allclose(found / found.sum(), COLOUR / COLOUR.sum(), rtol=0.02)
    bpy.ops.mps.estimate(albedo=False)
    assert scene.mps.estimate.albedo_image is None, "it is not of the normals beside it"


@pytest.mark.parametrize("tiles", [False, True])
def test_the_albedo_is_baked_beside_the_normals(white, photographed, tmp_path, tiles):
    bpy.ops.mps.estimate(model="LAMBERTIAN", white=white, albedo=True, output=str(tmp_path / "n.png"))
    bpy.ops.mps.bake(target=photographed.name, size=64, tiles=tiles, output=str(tmp_path / "t.png"))
    image = bpy.data.images[f"MPS {photographed.name} Albedo"]
    assert image.colorspace_settings.name == "sRGB" and image.source == ("TILED" if tiles else "FILE")
    seen = read_albedo(image.filepath.replace("<UDIM>", "1001"))
    found = np.median(seen[seen.any(axis=-1)], axis=0)
    np.testing.assert_allclose(found / found.sum(), COLOUR / COLOUR.sum(), rtol=0.03)


def test_the_material_shows_albedo_and_normals_once_each(white, photographed, tmp_path, capfd):
    """An artist's texture makes room, and is named; another bake takes the nodes of the first."""
    tree = photographed.data.materials[0].node_tree
    shader = shader_of(tree)
    painted = tree.nodes.new("ShaderNodeTexImage")
    tree.links.new(painted.outputs["Color"], shader.inputs["Base Color"])
    bpy.ops.mps.estimate(model="LAMBERTIAN", white=white, albedo=True, output=str(tmp_path / "n.png"))
    for suffix, space in ((".png", "sRGB"), (".exr", "Linear Rec.709")):
        bpy.ops.mps.bake(target=photographed.name, size=64, output=str(tmp_path / f"t{suffix}"))
        colour, normal = (shader.inputs[name].links[0].from_node for name in ("Base Color", "Normal"))
        image = colour.image
        assert (colour.name, normal.name) == ("MPS Albedo", "MPS Normal")
        assert image.filepath == str(tmp_path / f"t_albedo{suffix}")
        assert image.colorspace_settings.name == space and not image.colorspace_settings.is_data
        assert colour.inputs["Vector"].links[0].from_node == tree.nodes["MPS UV"]
    assert sum(node.type == "TEX_IMAGE" for node in tree.nodes) == 3 and painted.name in tree.nodes
    assert capfd.readouterr().out.count('The albedo took the place of "Image Texture" in material "Matte"') == 1
    pixels = np.array(image.pixels).reshape(64, 64, 4)
    np.testing.assert_allclose(pixels[..., :3], read_albedo(tmp_path / "t_albedo.exr")[::-1], atol=1e-3)


def test_another_white_photo_makes_the_estimate_out_of_date(white, scene, tmp_path):
    bpy.ops.mps.estimate(model="LAMBERTIAN", white=white, output=str(tmp_path / "n.png"))
    assert MPS_PT_estimate.state(bpy.context).kind is Kind.DONE
    write_image(white, np.ones((96, 96, 3)))
    state = MPS_PT_estimate.state(bpy.context)
    assert (state.kind, state.why) == (Kind.OUT_OF_DATE, "Changed since: White Photo")


def test_a_white_photo_does_not_stay_for_another_photo(white, scene, tmp_path):
    for verb, given in (("open_photo", {"filepath": white}), ("render_photo", {"output": str(tmp_path / "anew.exr")})):
        scene.mps.estimate.white = white
        getattr(bpy.ops.mps, verb)(**given)
        assert scene.mps.estimate.white == ""
