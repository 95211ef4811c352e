"""Detail on top of the normal map that an object's material wears: found, kept beneath, and never added twice."""

import re
from pathlib import Path

import bpy
import numpy as np
import pytest
from synthetic import degrees_between

from blender_addon.panels.bake import MPS_PT_bake
from blender_addon.settings.record import notes_of
from mpsnet_core import read_image

from .rendering import array_of, save_png, shader_of


def waves(size: int = 64) -> np.ndarray:
    """(S, S, 3) unit normals of a relief of broad waves."""
    v, u = np.mgrid[:size, :size] / size * 2 * np.pi * 3
    vectors = np.stack([0.4 * np.sin(u), 0.4 * np.cos(v), np.ones_like(u)], -1)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def saved_map(path: Path, vectors: np.ndarray) -> "bpy.types.Image":
    return bpy.data.images.load(str(save_png(path, 0.5 + 0.5 * vectors)))


def dress(obj: "bpy.types.Object", image: "bpy.types.Image") -> "bpy.types.Node":
    """As an artist puts a normal map into a material; gives its Normal Map node."""
    tree = obj.material_slots[0].material.node_tree
    texture, normal = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeNormalMap")
    texture.image = image
    image.colorspace_settings.name = "Non-Color"
    shader = shader_of(tree)
    tree.links.new(texture.outputs["Color"], normal.inputs["Color"])
    tree.links.new(normal.outputs["Normal"], shader.inputs["Normal"])
    return normal


def vectors_in(path: Path) -> np.ndarray:
    return read_image(path, encoding="linear").pixels * 2 - 1


@pytest.fixture
def worn(estimated, tmp_path):
    """The estimated sphere with waves on it; its Normal Map node."""
    return dress(estimated, saved_map(tmp_path / "waves.png", waves()))


def test_the_map_stays_beneath_and_runs_do_not_add_up(worn, scene, tmp_path):
    """The estimate is wrong where a light does not reach, which is as good as detail here."""
    bpy.ops.mps.bake(size=64, onto=True, output=str(tmp_path / "levelled.png"))
    assert scene.mps.bake.level  # comes with going on top
    bpy.ops.mps.bake(level=False, onto_shown="NO", output=str(tmp_path / "once.png"))
    assert not scene.mps.bake.level
    once = vectors_in(tmp_path / "once.png")
    apart = degrees_between(once, waves())
    assert (apart < 0.1).mean() > 0.3  # the half that the photo does not see
    assert apart.mean() > 1 and degrees_between(np.array([0, 0, 1.0]), once).mean() > 10
    first = worn.id_data.nodes["MPS Texture"].image
    assert first == scene.mps.bake.image and Path(first.filepath_raw).name == "once.png"
    for name in ("once.png", "again.png"):  # the same file, and another
        bpy.ops.mps.bake(output=str(tmp_path / name))
        assert degrees_between(vectors_in(tmp_path / name), once).max() < 0.01


@pytest.mark.parametrize("where", ["normal", "colour", "vector"])
def test_a_reroute_between_is_passed(worn, tmp_path, where):
    tree = worn.id_data
    texture = worn.inputs["Color"].links[0].from_node
    reroute, uv = tree.nodes.new("NodeReroute"), tree.nodes.new("ShaderNodeUVMap")
    uv.uv_map = "UVMap"
    begin, end = {
        "normal": (worn.outputs["Normal"], tree.nodes["Principled BSDF"].inputs["Normal"]),
        "colour": (texture.outputs["Color"], worn.inputs["Color"]),
        "vector": (uv.outputs["UV"], texture.inputs["Vector"]),
    }[where]
    tree.links.new(begin, reroute.inputs[0])
    tree.links.new(reroute.outputs[0], end)
    bpy.ops.mps.bake(size=64, onto=True, output=str(tmp_path / "onto.png"))
    apart = degrees_between(vectors_in(tmp_path / "onto.png"), waves())
    assert (apart < 0.1).mean() > 0.3  # the half that the photo does not see


def test_what_a_plain_bake_took_the_place_of_is_still_the_map(worn, tmp_path):
    bpy.ops.mps.bake(size=64, onto=True, output=str(tmp_path / "straight.png"))
    worn.id_data.links.new(worn.outputs["Normal"], worn.id_data.nodes["Principled BSDF"].inputs["Normal"])
    bpy.ops.mps.bake(onto=False, level=False, output=str(tmp_path / "plain.png"))
    bpy.ops.mps.bake(onto=True, output=str(tmp_path / "after.png"))
    straight, after = vectors_in(tmp_path / "straight.png"), vectors_in(tmp_path / "after.png")
    assert degrees_between(straight, vectors_in(tmp_path / "plain.png")).mean() > 5
    assert degrees_between(straight, after).max() < 0.01


@pytest.mark.parametrize("bump", [False, True])
def test_a_directx_map_is_taken_as_what_it_is(worn, estimated, tmp_path, bump):
    """Turned round by our node, of 5.2's Normal Map node, or told with a file; a bump may be behind it."""
    bpy.ops.mps.bake(size=64, onto=True, output=str(tmp_path / "up.png"))
    expected = vectors_in(tmp_path / "up.png")
    down = saved_map(tmp_path / "down.png", waves() * [1, -1, 1])
    told = {"onto_file": str(tmp_path / "down.png"), "onto_convention": "DIRECTX"}
    bpy.ops.mps.bake(**told, output=str(tmp_path / "told.png"))
    assert degrees_between(vectors_in(tmp_path / "told.png"), expected).max() < 0.1
    normal = dress(estimated, down)
    tree = normal.id_data
    if hasattr(normal, "convention"):
        normal.convention = "DIRECTX"
    else:
        turn = tree.nodes.new("ShaderNodeVectorMath")
        turn.name = "MPS Green"
        tree.links.new(normal.inputs["Color"].links[0].from_socket, turn.inputs[0])
        tree.links.new(turn.outputs["Vector"], normal.inputs["Color"])
    if bump:
        node = tree.nodes.new("ShaderNodeBump")
        tree.links.new(normal.outputs["Normal"], node.inputs["Normal"])
        tree.links.new(node.outputs["Normal"], tree.nodes["Principled BSDF"].inputs["Normal"])
    bpy.ops.mps.bake(onto_file="", output=str(tmp_path / "found.png"))
    assert degrees_between(vectors_in(tmp_path / "found.png"), expected).max() < 0.1


def without_texture(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    normal.id_data.links.remove(normal.outputs["Normal"].links[0])


def through_another_node(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    tree = normal.id_data
    curves = tree.nodes.new("ShaderNodeRGBCurve")
    tree.links.new(normal.inputs["Color"].links[0].from_socket, curves.inputs["Color"])
    tree.links.new(curves.outputs["Color"], normal.inputs["Color"])


def in_object_space(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    normal.space = "OBJECT"


def on_other_uvs(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    obj.data.uv_layers.new(name="Other")
    normal.uv_map = "Other"


def through_a_mapping(normal: "bpy.types.Node", scale: float, uv_map: str, kind: str = "ShaderNodeUVMap") -> None:
    tree = normal.id_data
    mapping, uv = tree.nodes.new("ShaderNodeMapping"), tree.nodes.new(kind)
    if kind == "ShaderNodeUVMap":
        uv.uv_map = uv_map
    mapping.inputs["Scale"].default_value = (scale, scale, 1)
    tree.links.new(uv.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], normal.inputs["Color"].links[0].from_node.inputs["Vector"])


def on_the_rendered_uvs(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    obj.data.uv_layers.new(name="Other").active_render = True
    bpy.context.scene.mps.bake.uv_map = "UVMap"


def boxed(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    normal.inputs["Color"].links[0].from_node.projection = "BOX"


def weak(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    normal.inputs["Strength"].default_value = 0.3


def baked_here(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    without_texture(normal, obj, folder)
    bpy.ops.mps.bake(size=32, output=str(folder / "plain.png"))


def painted(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    image = normal.inputs["Color"].links[0].from_node.image
    image.pixels[0] = 0.3


def two_maps(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    other = obj.material_slots[0].material.copy()
    obj.data.materials.append(other)
    texture = next(node for node in other.node_tree.nodes if node.type == "TEX_IMAGE")
    texture.image = saved_map(folder / "other.png", waves())
    texture.image.colorspace_settings.name = "Non-Color"


def of_tiles(normal: "bpy.types.Node", obj: "bpy.types.Object", folder: Path) -> None:
    normal.inputs["Color"].links[0].from_node.image.source = "TILED"


@pytest.mark.parametrize(
    ("broken", "sentence"),
    [
        (without_texture, 'no material of "Sphere" has a Normal Map node with a texture; choose the file'),
        (through_another_node, "does not come straight from an image texture; choose the file"),
        (in_object_space, 'normal map "waves.png" is not in tangent space; choose the file'),
        (on_other_uvs, 'the existing normal map is on UV map "Other"; bake onto that one'),
        (
            lambda normal, obj, folder: through_a_mapping(normal, 1, obj.data.uv_layers.new(name="Other").name),
            'the existing normal map is on UV map "Other"; bake onto that one',
        ),
        (on_the_rendered_uvs, 'the existing normal map is on UV map "Other"; bake onto that one'),
        (lambda normal, obj, folder: through_a_mapping(normal, 10, "UVMap"), '"waves.png" does not lie straight on a'),
        (boxed, '"waves.png" does not lie straight on a UV map'),
        (weak, '"waves.png" is not used at strength 1; set it to 1'),
        (baked_here, 'the only normal map is "MPS Sphere", which was baked here; choose the file'),
        (painted, 'the normal map "waves.png" has changes that are not in its file; save it first'),
        (two_maps, r'have different normal maps \("other.png", "waves.png"\); set Textures to By Material or By'),
        (of_tiles, r'"waves.png" has UDIM tiles; switch UDIM Tiles on'),
        (lambda normal, obj, folder: (folder / "waves.png").unlink(), r'the normal map "waves.png" has no file on'),
    ],
)
def test_a_map_that_cannot_be_gone_on_top_of_gets_one_sentence(worn, estimated, tmp_path, broken, sentence):
    broken(worn, estimated, tmp_path)
    with pytest.raises(RuntimeError, match=sentence):
        bpy.ops.mps.bake(size=32, onto=True, output=str(tmp_path / "texture.png"))
    assert not (tmp_path / "texture.png").exists()
    # The panel says it before the button is pressed.
    assert re.search(sentence.split(r" \(")[0], MPS_PT_bake.lacks(bpy.context), re.IGNORECASE)


@pytest.mark.parametrize("kind", ["ShaderNodeUVMap", "ShaderNodeTexCoord"])
def test_a_mapping_that_moves_nothing_is_no_obstacle(worn, scene, tmp_path, kind):
    through_a_mapping(worn, 1, "UVMap", kind)
    scene.mps.bake.onto = True
    assert MPS_PT_bake.lacks(bpy.context) == ""
    bpy.ops.mps.bake(size=32, onto=True, output=str(tmp_path / "texture.png"))
    assert (tmp_path / "texture.png").exists()


def test_a_map_with_unsaved_paint_is_remembered_and_one_that_was_taken_off_is_not(worn, estimated, scene, tmp_path):
    present = worn.inputs["Color"].links[0].from_node.image
    present.pixels[0] = 0.3
    texture = str(tmp_path / "texture.png")
    bpy.ops.mps.bake(size=16, output=texture)
    assert scene.mps.bake.image["mpsnet_base"] == present
    with pytest.raises(RuntimeError, match=f'"{present.name}" has changes that are not in its file; save it first'):
        bpy.ops.mps.bake(onto=True)
    tree = estimated.material_slots[0].material.node_tree
    tree.links.remove(shader_of(tree).inputs["Normal"].links[0])
    tree.links.remove(tree.nodes["MPS Normal"].inputs["Color"].links[0])
    bpy.ops.mps.bake(onto=False)
    assert scene.mps.bake.image.get("mpsnet_base") is None


def leaning(path: Path, x: float, y: float) -> "bpy.types.Image":
    """A normal map that leans the same way everywhere."""
    vector = np.array([x, y, np.sqrt(1 - x * x - y * y)])
    return saved_map(path, np.broadcast_to(vector, (16, 16, 3)))


def leans(path: Path) -> tuple[float, float]:
    """Which way a texture leans that was baked with a strength of 0: as the map beneath it."""
    vectors = vectors_in(path).reshape(-1, 3).astype(float)
    assert np.ptp(vectors, axis=0).max() < 1e-3
    return tuple(np.round(vectors[0, :2], 2) + 0)


NOTHING_OF_THE_PHOTO = {"onto": True, "onto_shown": "NO", "level": False, "strength": 0.0, "padding": "PUSH_PULL"}


@pytest.fixture
def second(estimated):
    """A smaller sphere within sight, with a mesh and material of its own; both are selected."""
    other = estimated.copy()
    other.data, other.name = estimated.data.copy(), "Second"
    other.data.materials[0] = estimated.data.materials[0].copy()
    other.data.materials[0].name = "Other"
    other.scale, other.location = [0.2] * 3, bpy.context.scene.mps.rig.camera.location / 2
    bpy.context.scene.collection.objects.link(other)
    other.select_set(True)
    return other


def test_each_object_keeps_its_own_map_beneath_and_runs_do_not_add_up(estimated, second, scene, tmp_path):
    dress(estimated, leaning(tmp_path / "a.png", 0.3, 0.1))
    dress(second, leaning(tmp_path / "b.png", -0.2, 0.4))
    for split, names in (("OBJECT", ("Sphere", "Second")), ("MATERIAL", ("Matte", "Other"))):
        for _ in range(2):
            bpy.ops.mps.bake(size=16, objects="SELECTED", split=split, output=f"{tmp_path}/", **NOTHING_OF_THE_PHOTO)
            found = [leans(tmp_path / f"{name}_normal.png") for name in names]
            assert found == [(0.3, 0.1), (-0.2, 0.4)]
            (note,) = notes_of(scene, "bake")
            assert note.endswith("of the surface seen")  # nothing else is to be said
    with pytest.raises(RuntimeError, match="what shares one texture has different normal maps"):
        bpy.ops.mps.bake(split="ONE", objects="SELECTED")
    file = str(tmp_path / "a.png")
    bpy.ops.mps.bake(split="ONE", objects="SELECTED", onto_file=file, output=str(tmp_path / "one.png"))
    assert leans(tmp_path / "one.png") == (0.3, 0.1)


@pytest.mark.parametrize("method", ["MATERIAL", "MODIFIER"])
def test_a_displacement_does_not_hide_the_map_from_before_the_first_bake(estimated, tmp_path, method):
    dress(estimated, leaning(tmp_path / "a.png", 0.3, 0.1))
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "t.png"), **NOTHING_OF_THE_PHOTO)
    bpy.ops.mps.displace(method=method, levels=1, output=str(tmp_path / "h.exr"))
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "again.png"), **NOTHING_OF_THE_PHOTO)
    assert leans(tmp_path / "again.png") == (0.3, 0.1)
    bpy.ops.mps.displace(output=str(tmp_path / "h.exr"))
    bpy.ops.mps.bake(onto=False, output=str(tmp_path / "plain.png"))
    bpy.ops.mps.bake(size=16, output=str(tmp_path / "on_top.png"), **NOTHING_OF_THE_PHOTO)
    assert leans(tmp_path / "on_top.png") == (0.3, 0.1)


def test_what_wears_no_map_is_baked_as_it_is_and_reported(estimated, second, scene, tmp_path):
    dress(second, leaning(tmp_path / "b.png", -0.2, 0.4))
    bpy.ops.mps.bake(size=16, objects="SELECTED", split="OBJECT", output=f"{tmp_path}/", **NOTHING_OF_THE_PHOTO)
    assert leans(tmp_path / "Sphere_normal.png") == (0, 0) and leans(tmp_path / "Second_normal.png") == (-0.2, 0.4)
    told = "".join(notes_of(scene, "bake"))
    assert told.count("nothing lies beneath its texture") == told.count("object Sphere: there is no existing map") == 1


def test_tiles_go_on_top_of_tiles(estimated, scene, tmp_path):
    layer = estimated.data.uv_layers.active.uv
    layer.foreach_set("vector", (array_of(layer, "vector", 2) * np.float32([2, 1])).ravel())
    leaning(tmp_path / "t.1002.png", 0.3, 0.1)
    image = leaning(tmp_path / "t.1001.png", -0.2, 0.4)
    image.source = "TILED"
    image.filepath = str(tmp_path / "t.<UDIM>.png")
    dress(estimated, image)
    for time in ("first", "again", "packed"):
        if time == "packed":
            image.pack()
            for tile in (1001, 1002):
                (tmp_path / f"t.{tile}.png").unlink()
        bpy.ops.mps.bake(size=16, tiles=True, output=f"{tmp_path}/", **NOTHING_OF_THE_PHOTO)
        found = [leans(tmp_path / f"Sphere_normal.{tile}.png") for tile in (1001, 1002)]
        assert found == [(-0.2, 0.4), (0.3, 0.1)]
    assert scene.mps.bake.image["mpsnet_base"] == image
    image.unpack(method="REMOVE")
    with pytest.raises(RuntimeError, match=r'"t\.1001\.png" has no file on disk \(.*t\.1001\.png is missing\)'):
        bpy.ops.mps.bake()
