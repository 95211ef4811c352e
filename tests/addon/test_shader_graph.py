"""What of a material reaches its render, against Cycles, which bakes the normals that it shades with.

Each material has one shader that the render shows, or some, and beside it one that it does not.
"""

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest
from synthetic import degrees_between

from blender_addon.bake.assign_textures import assign_textures
from blender_addon.bake.bake_operator import check_shows_normals
from blender_addon.bake.base_maps import maps_before_bake, usable_maps
from blender_addon.bake.texture_sets import AssignedTexture, BakeTarget
from mpsnet_core.errors import InputError

from .rendering import nodes_of, save_png, shader_of

TILT = np.array([0.3, -0.2, 0.93]) / np.linalg.norm([0.3, -0.2, 0.93])
OTHER = np.array([-0.4, 0, 0.92]) / np.linalg.norm([-0.4, 0, 0.92])

Tree = bpy.types.NodeTree
Node = bpy.types.Node
# The shader's end in the material's own tree that takes a normal, and another one that the render does not show.
Ends = tuple[list["bpy.types.NodeSocket"], list["bpy.types.NodeSocket"]]


def new(tree: Tree, kind: str) -> Node:
    return tree.nodes.new(f"ShaderNode{kind}")


def output(tree: Tree) -> Node:
    return next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")


def mixed(tree: Tree, one: Node, other: Node, factor: float) -> Node:
    mix = new(tree, "MixShader")
    mix.inputs[0].default_value = factor
    for number, shader in ((1, one), (2, other)):
        tree.links.new(shader.outputs[0], mix.inputs[number])
    tree.links.new(mix.outputs[0], output(tree).inputs["Surface"])
    return mix


def in_group(tree: Tree, name: str | None, *, kind: str = "BsdfDiffuse", through: tuple[str, ...] = ()) -> Node:
    """A group node in the tree with a shader in it, whose normal is the group's input of that name."""
    group = bpy.data.node_groups.new("Coating", "ShaderNodeTree")
    group.interface.new_socket("BSDF", in_out="OUTPUT", socket_type="NodeSocketShader")
    start, end, shader = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput"), new(group, kind)
    group.links.new(shader.outputs[0], end.inputs["BSDF"])
    if name:
        group.interface.new_socket("Tint", in_out="INPUT", socket_type="NodeSocketColor")
        group.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketVector").hide_value = True
        socket = start.outputs[name]
        for between in through:
            node = group.nodes.new(between)
            group.links.new(socket, node.inputs["Normal" if "Normal" in node.inputs else 0])
            socket = node.outputs[0]
        group.links.new(socket, shader.inputs["Normal"])
    node = new(tree, "Group")
    node.node_tree = group
    return node


def leftover(tree: Tree) -> Ends:
    return [shader_of(tree).inputs["Normal"]], [new(tree, "BsdfPrincipled").inputs["Normal"]]


def inactive_output(tree: Tree) -> Ends:
    first, second, other = output(tree), new(tree, "OutputMaterial"), new(tree, "BsdfGlossy")
    tree.links.new(other.outputs[0], second.inputs["Surface"])
    first.is_active_output = False
    second.is_active_output = True
    return [other.inputs["Normal"]], [shader_of(tree).inputs["Normal"]]


def both_of_a_mix(tree: Tree) -> Ends:
    one, other = shader_of(tree), new(tree, "BsdfDiffuse")
    mixed(tree, one, other, 0.5)
    return [one.inputs["Normal"], other.inputs["Normal"]], [new(tree, "BsdfGlass").inputs["Normal"]]


def one_of_a_mix(tree: Tree) -> Ends:
    one, other = shader_of(tree), new(tree, "BsdfDiffuse")
    mixed(tree, one, other, 1.0)
    return [other.inputs["Normal"]], [one.inputs["Normal"]]


def one_of_a_mix_by_a_value(tree: Tree) -> Ends:
    one, other, value = shader_of(tree), new(tree, "BsdfDiffuse"), new(tree, "Value")
    tree.links.new(value.outputs[0], mixed(tree, one, other, 1.0).inputs[0])
    value.outputs[0].default_value = 0
    return [one.inputs["Normal"]], [other.inputs["Normal"]]


def one_of_a_muted_mix(tree: Tree) -> Ends:
    one, other = shader_of(tree), new(tree, "BsdfDiffuse")
    mixed(tree, one, other, 0.5).mute = True
    return [one.inputs["Normal"]], [other.inputs["Normal"]]


def one_by_a_muted_link(tree: Tree) -> Ends:
    one, other = shader_of(tree), new(tree, "BsdfDiffuse")
    both = new(tree, "AddShader")
    tree.links.new(one.outputs[0], both.inputs[0])
    tree.links.new(other.outputs[0], both.inputs[1]).is_muted = True
    tree.links.new(both.outputs[0], output(tree).inputs["Surface"])
    return [one.inputs["Normal"]], [other.inputs["Normal"]]


def after_a_reroute(tree: Tree) -> Ends:
    reroute = tree.nodes.new("NodeReroute")
    tree.links.new(shader_of(tree).outputs[0], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], output(tree).inputs["Surface"])
    return leftover(tree)


def of_a_group(tree: Tree, name: str = "Relief", **how: object) -> Ends:
    group = in_group(tree, name, **how)
    tree.links.new(group.outputs[0], output(tree).inputs["Surface"])
    return [group.inputs[name]], [shader_of(tree).inputs["Normal"]]


def through_nodes_of_a_group(tree: Tree) -> Ends:
    return of_a_group(tree, through=("NodeReroute", "ShaderNodeBump"))


def of_a_group_in_a_group(tree: Tree) -> Ends:
    outer = in_group(tree, "Normal")
    group = outer.node_tree
    inner = in_group(group, "Bumps")
    end = next(node for node in group.nodes if node.type == "GROUP_OUTPUT")
    start = next(node for node in group.nodes if node.type == "GROUP_INPUT")
    group.links.new(inner.outputs[0], end.inputs["BSDF"])
    group.interface.new_socket("Inwards", in_out="INPUT", socket_type="NodeSocketVector").hide_value = True
    group.links.new(start.outputs["Inwards"], inner.inputs["Bumps"])
    tree.links.new(outer.outputs[0], output(tree).inputs["Surface"])
    return [outer.inputs["Inwards"]], [outer.inputs["Normal"]]


GRAPHS: list[Callable[[Tree], Ends]] = [
    leftover,
    inactive_output,
    both_of_a_mix,
    one_of_a_mix,
    one_of_a_mix_by_a_value,
    one_of_a_muted_mix,
    one_by_a_muted_link,
    after_a_reroute,
    of_a_group,
    through_nodes_of_a_group,
    of_a_group_in_a_group,
]


@pytest.fixture
def plane(scene):
    bpy.ops.mesh.primitive_plane_add()
    nodes_of(bpy.data.materials.new("Paint"))
    bpy.context.object.data.materials.append(bpy.data.materials["Paint"])
    scene.render.engine, scene.cycles.samples = "CYCLES", 4
    return bpy.context.object


def even(path: Path, vector: np.ndarray) -> "bpy.types.Image":
    """A normal map of one vector."""
    image = bpy.data.images.load(str(save_png(path, 0.5 + 0.5 * np.tile(vector, (8, 8, 1)))))
    image.colorspace_settings.name = "Non-Color"
    return image


def shaded(plane: "bpy.types.Object") -> np.ndarray:
    """The mean normal that Cycles shades the plane with."""
    tree = plane.data.materials[0].node_tree
    target = new(tree, "TexImage")
    target.image = bpy.data.images.new("shaded", 8, 8, float_buffer=True, is_data=True)
    tree.nodes.active = target
    bpy.ops.object.bake(type="NORMAL", normal_space="OBJECT", normal_r="POS_X", normal_g="POS_Y", normal_b="POS_Z")
    pixels = np.array(target.image.pixels).reshape(-1, 4)[:, :3] * 2 - 1
    tree.nodes.remove(target)
    return pixels.mean(axis=0)


def assigned(plane: "bpy.types.Object", image: "bpy.types.Image") -> list[AssignedTexture]:
    return [AssignedTexture(plane, (image,), "UVMap")]


def mapped(tree: Tree, image: "bpy.types.Image", sockets: list["bpy.types.NodeSocket"]) -> None:
    texture, normal = new(tree, "TexImage"), new(tree, "NormalMap")
    texture.image = image
    tree.links.new(texture.outputs["Color"], normal.inputs["Color"])
    for socket in sockets:
        tree.links.new(normal.outputs["Normal"], socket)


@pytest.mark.parametrize("graph", GRAPHS)
def test_the_map_reaches_the_render(graph, plane, tmp_path):
    material = plane.data.materials[0]
    shown, hidden = graph(material.node_tree)
    assert degrees_between(shaded(plane), [0, 0, 1.0]) < 0.1
    check_shows_normals(plane)
    assign_textures(assigned(plane, even(tmp_path / "n.png", TILT)), "TANGENT", "OPENGL")
    assert all(socket.is_linked for socket in shown) and not any(socket.is_linked for socket in hidden)
    assert degrees_between(shaded(plane), TILT) < 0.1


@pytest.mark.parametrize("graph", GRAPHS)
def test_the_map_that_the_render_shows_is_the_existing_one(graph, plane, tmp_path):
    tree = plane.data.materials[0].node_tree
    shown, hidden = graph(tree)
    images = [even(tmp_path / f"{name}.png", vector) for name, vector in (("shown", TILT), ("hidden", OTHER))]
    mapped(tree, images[1], hidden)
    onto = [BakeTarget(0, plane.name, "UVMap", ("Paint",), frozenset({"Paint"}))]
    with pytest.raises(InputError, match="has a Normal Map node"):
        usable_maps([plane], onto, tmp_path / "n.png")
    mapped(tree, images[0], shown)
    assert degrees_between(shaded(plane), TILT) < 0.1
    assert usable_maps([plane], onto, tmp_path / "n.png") == [images[0]]
    assert maps_before_bake([plane], onto, tmp_path / "n.png")[None, None].uid == images[0].session_uid


def test_a_map_whose_image_is_outside_of_its_group_is_found(plane, tmp_path):
    """As asset libraries have it: the group takes the image's colour, and its Normal Map node is inside."""
    tree = plane.data.materials[0].node_tree
    group = in_group(tree, None)
    inside = group.node_tree
    inside.interface.new_socket("Normal Map", in_out="INPUT", socket_type="NodeSocketColor")
    inside.interface.new_socket("Depth", in_out="INPUT", socket_type="NodeSocketFloat").default_value = 1
    normal, start = new(inside, "NormalMap"), next(node for node in inside.nodes if node.type == "GROUP_INPUT")
    shader = next(node for node in inside.nodes if node.type == "BSDF_DIFFUSE")
    inside.links.new(start.outputs["Normal Map"], normal.inputs["Color"])
    inside.links.new(start.outputs["Depth"], normal.inputs["Strength"])
    inside.links.new(normal.outputs["Normal"], shader.inputs["Normal"])
    texture = new(tree, "TexImage")
    texture.image = even(tmp_path / "n.png", TILT)
    tree.links.new(texture.outputs["Color"], group.inputs["Normal Map"])
    group.inputs["Depth"].default_value = 1
    tree.links.new(group.outputs[0], output(tree).inputs["Surface"])
    onto = [BakeTarget(0, plane.name, "UVMap", ("Paint",), frozenset({"Paint"}))]
    assert degrees_between(shaded(plane), TILT) < 0.1
    assert usable_maps([plane], onto, tmp_path / "n.png") == [texture.image]
    group.inputs["Depth"].default_value = 0.5
    with pytest.raises(InputError, match="strength 1"):
        usable_maps([plane], onto, tmp_path / "n.png")
    with pytest.raises(InputError, match=f'"{inside.name}" in material "Paint" takes no normal'):
        check_shows_normals(plane)


@pytest.mark.parametrize("space", ["sRGB", "Linear Rec.709", "Non-Color"])
def test_a_map_whose_colours_are_bent_is_named(space, plane, tmp_path):
    tree = plane.data.materials[0].node_tree
    image = even(tmp_path / "n.png", TILT)
    image.colorspace_settings.name = space
    mapped(tree, image, [shader_of(tree).inputs["Normal"]])
    onto = [BakeTarget(0, plane.name, "UVMap", ("Paint",), frozenset({"Paint"}))]
    bent = degrees_between(shaded(plane), TILT) > 1
    assert bent == (space == "sRGB")
    if bent:
        with pytest.raises(InputError, match="sRGB"):
            usable_maps([plane], onto, tmp_path / "n.png")
    else:
        assert usable_maps([plane], onto, tmp_path / "n.png") == [image]


def test_a_map_of_the_coat_alone_is_named(plane, tmp_path):
    """It is no map of the surface; but a coat that shares the surface's map goes with it."""
    tree = plane.data.materials[0].node_tree
    shader, image = shader_of(tree), even(tmp_path / "n.png", TILT)
    mapped(tree, image, [shader.inputs["Coat Normal"]])
    onto = [BakeTarget(0, plane.name, "UVMap", ("Paint",), frozenset({"Paint"}))]
    with pytest.raises(InputError, match="Coat Normal"):
        usable_maps([plane], onto, tmp_path / "n.png")
    baked = assigned(plane, even(tmp_path / "o.png", OTHER))
    assign_textures(baked, "TANGENT", "OPENGL")
    assert shader.inputs["Coat Normal"].links[0].from_node != shader.inputs["Normal"].links[0].from_node
    mapped(tree, image, [shader.inputs["Coat Normal"], shader.inputs["Normal"]])
    assign_textures(baked, "TANGENT", "OPENGL")
    assert shader.inputs["Coat Normal"].links[0].from_node == shader.inputs["Normal"].links[0].from_node


@pytest.mark.parametrize("engine", ["CYCLES", "BLENDER_EEVEE_NEXT", "BLENDER_EEVEE"])
def test_each_engine_shows_its_own_output(engine, plane, scene, tmp_path):
    """The texture goes to all of them, and on top of the map that the scene's engine shows."""
    tree = plane.data.materials[0].node_tree
    try:
        scene.render.engine = engine
    except TypeError:
        pytest.skip("of another Blender")
    other, second = new(tree, "BsdfDiffuse"), new(tree, "OutputMaterial")
    second.target = "CYCLES"
    tree.links.new(other.outputs[0], second.inputs["Surface"])
    images = [even(tmp_path / f"{name}.png", TILT) for name in ("all", "cycles")]
    ends = shader_of(tree).inputs["Normal"], other.inputs["Normal"]
    for image, end in zip(images, ends, strict=True):
        mapped(tree, image, [end])
    onto = [BakeTarget(0, plane.name, "UVMap", ("Paint",), frozenset({"Paint"}))]
    assert usable_maps([plane], onto, tmp_path / "n.png") == [images[engine == "CYCLES"]]
    assign_textures(assigned(plane, even(tmp_path / "n.png", OTHER)), "TANGENT", "OPENGL")
    assert {end.links[0].from_node.name for end in ends} == {"MPS Normal"}


@pytest.mark.skipif(bpy.app.version >= (5, 0), reason="every material has nodes")
def test_a_map_in_nodes_that_are_off_is_none(plane, tmp_path):
    material = plane.data.materials[0]
    mapped(material.node_tree, even(tmp_path / "n.png", TILT), [shader_of(material.node_tree).inputs["Normal"]])
    material.use_nodes = False
    onto = [BakeTarget(0, plane.name, "UVMap", ("Paint",), frozenset({"Paint"}))]
    check_shows_normals(plane)  # the bake switches them on
    assert maps_before_bake([plane], onto, tmp_path / "n.png") == {(None, None): None}


def test_an_output_in_a_group_is_named(plane):
    """Cycles shows that one, whatever is linked to the material's own."""
    group = in_group(plane.data.materials[0].node_tree, None).node_tree
    shader = next(node for node in group.nodes if node.type == "BSDF_DIFFUSE")
    group.links.new(shader.outputs[0], new(group, "OutputMaterial").inputs["Surface"])
    with pytest.raises(InputError, match="holds a Material Output"):
        check_shows_normals(plane)
