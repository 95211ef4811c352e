"""Results as assets: marked where that is chosen, and as a node group for other materials."""

import bpy
import pytest

from blender_addon.appearance.displacement import assign_displacement
from blender_addon.bake.assign_textures import assign_textures
from blender_addon.bake.texture_sets import AssignedTexture

from .rendering import pixels, shader_of


@pytest.fixture
def textured(sphere):
    """The sphere with a texture as a bake leaves it."""
    image = bpy.data.images.new("MPS Sphere", 8, 8)
    assign_textures([AssignedTexture(sphere, (image,), "UVMap")], "TANGENT", "DIRECTX")
    bpy.context.scene.mps.bake.image = image
    return sphere


@pytest.mark.parametrize(("what", "marked"), [("NONE", []), ("MATERIAL", ["Matte"]), ("OBJECT", ["Sphere"])])
def test_the_bake_marks_what_is_chosen(estimated, tmp_path, what, marked):
    bpy.ops.mps.bake(size=32, output=str(tmp_path / "texture.png"), mark_asset=what)
    everything = [*bpy.data.materials, *bpy.data.objects, *bpy.data.images]
    assert [one.name for one in everything if one.asset_data] == marked


def ends(group):
    """What comes out of a node group, by the names of its outputs."""
    return {one.name: one.links[0].from_node.bl_idname for one in group.nodes["Group Output"].inputs if one.is_linked}


def test_the_node_group_shows_the_texture_in_another_material(textured):
    material = textured.active_material
    before = {node.name for node in material.node_tree.nodes}
    bpy.ops.mps.make_node_group()
    (group,) = bpy.data.node_groups
    assert group.name == "MPS Surface Sphere" and group.asset_data
    assert {node.name for node in material.node_tree.nodes} == before
    assert ends(group) == {"Normal": "ShaderNodeNormalMap"}
    other = bpy.data.materials.new("Other")
    if bpy.app.version < (5, 0):
        other.use_nodes = True
    node = other.node_tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    assert node.inputs["Strength"].default_value == 1
    shader = shader_of(other.node_tree)
    other.node_tree.links.new(node.outputs["Normal"], shader.inputs["Normal"])

    heights = bpy.data.images.new("Heights", 8, 8)
    assign_displacement(material, heights, "UVMap", 0.25, 0.4)
    group.nodes.new("ShaderNodeValue").name = "Artist's"
    bpy.ops.mps.make_node_group()
    assert list(bpy.data.node_groups) == [group] and "Artist's" in group.nodes
    assert ends(group) == {"Normal": "ShaderNodeNormalMap", "Displacement": "ShaderNodeDisplacement"}
    assert node.inputs["Strength"].default_value == 1
    assert shader.inputs["Normal"].links[0].from_node == node


def test_a_material_with_the_node_group_looks_as_the_baked_one(textured, tmp_path):
    def photo(name):
        bpy.ops.mps.render_photo(width=32, height=32, samples=1, output=str(tmp_path / name))
        return pixels(tmp_path / name)

    bpy.ops.mps.add_rig()
    image = textured.active_material.node_tree.nodes["MPS Texture"].image
    image.colorspace_settings.is_data = True
    image.pixels = [0.7, 0.3, 0.85, 1] * 64
    material = textured.active_material
    with_nodes = photo("nodes.exr")
    bpy.ops.mps.make_node_group()
    nodes, links = material.node_tree.nodes, material.node_tree.links
    for name in [node.name for node in nodes if node.name.startswith("MPS ")]:
        nodes.remove(nodes[name])
    plain = photo("plain.exr")
    node = nodes.new("ShaderNodeGroup")
    (node.node_tree,) = bpy.data.node_groups
    links.new(node.outputs["Normal"], nodes["Principled BSDF"].inputs["Normal"])
    with_group = photo("group.exr")
    assert abs(with_group - with_nodes).max() < 1e-4 < 0.1 < abs(plain - with_nodes).max()


def test_without_a_texture_it_says_so(textured, scene):
    bpy.ops.mesh.primitive_cube_add()
    with pytest.raises(RuntimeError, match='"Cube" uses no baked texture'):
        bpy.ops.mps.make_node_group()
    scene.mps.bake.target = textured
    bpy.ops.mps.make_node_group()
