"""The displacement in Blender: a low poly, displaced by its baked normals, against the mesh they were baked from."""

from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from mathutils.bvhtree import BVHTree

from blender_addon.appearance.modifiers import move_by_modifier
from blender_addon.appearance.nodes import DISPLACEMENT_NODE, find_node
from blender_addon.settings.record import notes_of
from mpsnet_core.io.image_writing import write_image
from mpsnet_core.scene.normal_encoding import encode

from .rendering import array_of, detailed_object, set_up_cycles, shader_of, simplified, with_materials
from .test_bake_against_blender import TURN, add_sun, blenders_bake, camera_at, dressed, render

SIZE = 512


def baked(low: "bpy.types.Object", high: "bpy.types.Object", path: Path, space: str = "TANGENT") -> None:
    """Blender's own selected-to-active bake of the normals, taken as the step before has left it."""
    set_up_cycles(64)
    vectors = blenders_bake(high, low, SIZE, space)
    flat = np.array([0, 0, 1.0]) if space == "TANGENT" else np.array([1.0, 0, 0])
    write_image(path, encode(np.where(vectors.any(axis=-1, keepdims=True), vectors, flat)))
    for node in [node for node in low.data.materials[0].node_tree.nodes if node.type == "TEX_IMAGE"]:
        low.data.materials[0].node_tree.nodes.remove(node)
    bpy.context.scene.mps.bake.image = bpy.data.images.load(str(path))
    bpy.context.scene.mps.bake.space = space
    high.hide_set(True)


def world_points(obj: "bpy.types.Object") -> np.ndarray:
    """(V, 3) the object's points as modifiers leave them."""
    bpy.context.view_layer.update()
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    points = array_of(mesh.vertices, "co", 3).astype(np.float64)
    evaluated.to_mesh_clear()
    matrix = np.array(obj.matrix_world)
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def distances(points: np.ndarray, high: "bpy.types.Object") -> np.ndarray:
    """(N,) from points to the high poly's surface."""
    matrix = np.array(high.matrix_world)
    vertices = array_of(high.data.vertices, "co", 3) @ matrix[:3, :3].T + matrix[:3, 3]
    faces = array_of(high.data.loops, "vertex_index", 1, np.int32).reshape(-1, 3)
    tree = BVHTree.FromPolygons(vertices.tolist(), faces.tolist())
    return np.array([tree.find_nearest(point)[3] for point in points.tolist()])


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    """A file with the high poly and the low poly, its normals baked; each test opens it anew."""
    folder = tmp_path_factory.mktemp("pair")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    high = detailed_object(subdivisions=7)
    low = simplified(high, 1500)
    with_materials(high, low)
    baked(low, high, folder / "normal.png")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "pair.blend"), copy=True, relative_remap=False)
    return folder / "pair.blend"


@pytest.mark.accuracy
@pytest.mark.parametrize(
    ("kind", "scale"),
    [("CATMULL_CLARK", (1, 1, 1)), ("SIMPLE", (2.5, 2.5, 2.5)), ("CATMULL_CLARK", (1, 0.7, 1.4))],
    ids=["as it is", "scaled", "stretched"],
)
def test_the_modifier_brings_the_low_poly_to_the_high_poly(pair, tmp_path, kind, scale):
    bpy.ops.wm.read_homefile(filepath=str(pair))
    high, low = bpy.data.objects["Detailed"], bpy.data.objects["Simplified"]
    for obj in (high, low):
        obj.matrix_world = Matrix.LocRotScale((3, -2, 1), TURN, scale)
    bpy.context.view_layer.update()
    bpy.ops.mps.displace(
        target=low.name, method="MODIFIER", levels=3, subdivision=kind, scale=0, output=str(tmp_path / "height.exr")
    )
    after = distances(world_points(low), high)
    low.modifiers["MPS Displace"].show_viewport = False
    subdivided = distances(world_points(low), high)
    low.modifiers["MPS Subdivision"].show_viewport = False
    print(
        f"{kind} {scale}: {np.sqrt((after**2).mean()):.5f}, subdivided only {np.sqrt((subdivided**2).mean()):.5f}, "
        f"most {after.max():.5f} of {subdivided.max():.5f}"
    )
    assert np.sqrt((after**2).mean()) < 0.4 * np.sqrt((subdivided**2).mean())


def rendered_difference(one: np.ndarray, other: np.ndarray) -> float:
    inside = (one[..., 3] > 0.99) & (other[..., 3] > 0.99)
    return float(np.abs(one - other)[inside][:, :3].mean())


@pytest.mark.accuracy
def test_the_material_displaces_as_the_modifier_does(scene, tmp_path):
    """A render of the low poly with either is far closer to that of the high poly, outline and all."""
    high = detailed_object()
    low = simplified(high, 700)
    with_materials(high, low)
    baked(low, high, tmp_path / "normal.png")
    for obj in (high, low):
        dressed(obj, None, "TANGENT", False)
        obj.matrix_world = Matrix.LocRotScale((0, 0, 0), TURN, (0.9, 0.7, 1.05))
    add_sun()
    scene.render.resolution_x = scene.render.resolution_y = 192
    camera = camera_at((0.5, -1, 0.3))
    high.hide_set(False)
    original = render(tmp_path / "look.exr", camera, high)
    plain = rendered_difference(render(tmp_path / "look.exr", camera, low), original)
    for method, file in (("MODIFIER", "height.exr"), ("MATERIAL", "height.png")):
        bpy.ops.mps.displace(target=low.name, method=method, levels=4, scale=0, output=str(tmp_path / file))
        found = render(tmp_path / "look.exr", camera, low)
        shown = rendered_difference(found, original)
        outline = np.mean((found[..., 3] > 0.5) != (original[..., 3] > 0.5))
        print(f"{method} {file}: {shown:.4f} of {plain:.4f}, outline {outline:.5f}")
        assert shown < 0.3 * plain


def nodes_and_modifiers(low):
    (material,) = (slot.material for slot in low.material_slots)
    displacement = [node for node in material.node_tree.nodes if node.type == "DISPLACEMENT"]
    heights = [node for node in material.node_tree.nodes if node.name == "MPS Height"]
    return material, displacement, heights, [modifier.type for modifier in low.modifiers]


@pytest.fixture
def worn(estimated, scene, tmp_path):
    """The sphere with its photo's normals baked onto it and worn."""
    bpy.ops.mps.bake(size=128, output=str(tmp_path / "texture.png"))
    return estimated


def worn_normal(material):
    """The name of the node that is the shader's normal, None where there is none."""
    shader = shader_of(material.node_tree)
    return next((link.from_node.name for link in shader.inputs["Normal"].links), None)


def test_again_and_again_it_takes_what_it_made(worn, scene, tmp_path):
    for _ in range(2):
        bpy.ops.mps.displace(levels=1, keep_normals=False, output=str(tmp_path / "h.exr"))
    material, displacement, heights, modifiers = nodes_and_modifiers(worn)
    assert len(displacement) == len(heights) == 1 and modifiers == ["WEIGHTED_NORMAL", "SUBSURF"]
    assert material.displacement_method == "BOTH" and worn_normal(material) is None
    assert heights[0].image == scene.mps.displace.image and heights[0].image.colorspace_settings.is_data
    assert displacement[0].outputs[0].links[0].to_socket.name == "Displacement"
    for _ in range(2):
        bpy.ops.mps.displace(method="MODIFIER", levels=2, keep_normals=True, output=str(tmp_path / "h.exr"))
    material, displacement, heights, modifiers = nodes_and_modifiers(worn)
    normal = material.node_tree.nodes[worn_normal(material)]
    assert normal.name == "MPS Object Normal" and normal.space == "OBJECT"
    assert Path(normal.inputs["Color"].links[0].from_node.image.filepath).name == "h_normal.exr"
    assert not displacement and not heights and modifiers == ["WEIGHTED_NORMAL", "SUBSURF", "DISPLACE"]
    assert worn.modifiers["MPS Subdivision"].levels == worn.modifiers["MPS Subdivision"].render_levels == 2
    bpy.ops.mps.displace(method="MATERIAL", levels=0, keep_normals=False, output=str(tmp_path / "h.exr"))
    material, displacement, heights, modifiers = nodes_and_modifiers(worn)
    assert len(displacement) == len(heights) == 1 and not modifiers and worn_normal(material) is None


@pytest.mark.parametrize("own", [False, True], ids=["Blender's", "of its own"])
def test_the_subdivided_faces_are_shaded_as_the_mesh_is(worn, scene, tmp_path, own):
    """Else Cycles cuts the normal map's light off at every facet that looks away from the lamp. Sharp edges and flat
    faces stay."""
    mesh, rng = worn.data, np.random.default_rng(3)
    mesh.edges[3].use_edge_sharp = True
    mesh.polygons[7].use_smooth = False
    if own:
        tilted = array_of(mesh.corner_normals, "vector", 3) + rng.normal(0, 0.1, (len(mesh.loops), 3))
        mesh.normals_split_custom_set((tilted / np.linalg.norm(tilted, axis=1, keepdims=True)).tolist())
    corners = array_of(mesh.corner_normals, "vector", 3)
    for _ in range(2):
        bpy.ops.mps.displace(levels=1, output=str(tmp_path / "h.exr"))
    assert [one.type for one in worn.modifiers] == ["WEIGHTED_NORMAL", "SUBSURF"][own:]
    shown = worn.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    normals = array_of(shown.corner_normals, "vector", 3).reshape(-1, 4, 3)  # of a quad for each corner
    middles = [corners[list(face.loop_indices)].mean(axis=0) for face in mesh.polygons for _ in face.loop_indices]
    assert len(normals) == len(middles)
    expected = np.array(middles) / np.linalg.norm(middles, axis=1, keepdims=True)
    assert np.abs(normals - expected[:, None]).max(axis=-1).min(axis=1).max() < 0.02  # one of its corners is there


def test_the_subdivision_comes_before_the_displacement(worn, scene, tmp_path):
    """Also where it was displaced without one at first."""
    bpy.ops.mps.displace(method="MODIFIER", levels=1, output=str(tmp_path / "h.exr"))
    straight = world_points(worn)
    worn.modifiers.clear()
    for levels in (0, 1):
        bpy.ops.mps.displace(method="MODIFIER", levels=levels, output=str(tmp_path / "h.exr"))
    assert [modifier.type for modifier in worn.modifiers] == ["WEIGHTED_NORMAL", "SUBSURF", "DISPLACE"]
    assert np.allclose(world_points(worn), straight, atol=1e-6)


def test_the_modifier_reads_between_the_texels_as_they_are(scene):
    """Linear from one to the next, as the heights were solved: else a fine mesh shows each texel as a step."""
    rng = np.random.default_rng(5)
    heights = rng.random((8, 8), np.float32)
    image = bpy.data.images.new("Heights", 8, 8, float_buffer=True, is_data=True)
    image.pixels.foreach_set(
        np.pad(np.repeat(heights[..., None], 3, 2), ((0, 0), (0, 0), (0, 1)), constant_values=1).ravel()
    )
    uvs = rng.uniform(0.2, 0.8, (60, 2))
    mesh = bpy.data.meshes.new("Points")
    mesh.from_pydata([(u, v, 0) for u, v in uvs], [], np.arange(60).reshape(-1, 3).tolist())
    mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", uvs.astype(np.float32).ravel())
    obj = bpy.data.objects.new("Points", mesh)
    scene.collection.objects.link(obj)
    move_by_modifier(obj, image, "UVMap", strength=1.0, midlevel=0.0)
    (column, row), inside = np.divmod(uvs.T * 8 - 0.5, 1)
    column, row, (s, t) = column.astype(int), row.astype(int), inside
    below, above = (heights[row + k, column] * (1 - s) + heights[row + k, column + 1] * s for k in (0, 1))
    moved = np.linalg.norm(world_points(obj) - np.pad(uvs, ((0, 0), (0, 1))), axis=1)
    assert moved == pytest.approx(below * (1 - t) + above * t, abs=1e-5)


def test_udim_tiles_displace_as_one_texture_does(estimated, scene, tmp_path):
    """Four tiles of 64 texels for one of 128: their files by the modifier, packed and without files by the material."""
    set_up_cycles(16)
    layer, camera = estimated.data.uv_layers.active, scene.camera
    uvs = array_of(layer.uv, "vector", 2)
    scene.render.resolution_x = scene.render.resolution_y = 48
    add_sun()
    results = []
    for name, tiles, scale in (("one", False, 1), ("four", True, 2)):
        layer.uv.foreach_set("vector", (scale * uvs).ravel())
        bpy.ops.mps.bake(tiles=tiles, size=128 // scale, output=str(tmp_path / f"{name}.exr"))
        heights = str(tmp_path / f"{name}_height.exr")
        bpy.ops.mps.displace(method="MODIFIER", levels=1, scale=0.5, output=heights)
        points = world_points(estimated)
        if tiles:
            scene.mps.bake.image.pack()
            for file in tmp_path.glob("four.*"):
                file.unlink()
        bpy.ops.mps.displace(method="MATERIAL", levels=1, scale=0.5, keep_normals=False, output=heights)
        results.append((points, render(tmp_path / "look.exr", camera, estimated)))
    assert scene.mps.displace.image.source == "TILED"
    assert len(list(tmp_path.glob("four_height.1*.exr"))) == 4
    (points, look), (tiled_points, tiled_look) = results
    apart = np.linalg.norm(tiled_points - points, axis=1)
    # On a tile's border, Blender reads the tile's last texel in place of the mean of both.
    assert np.quantile(apart, 0.95) < 1e-4 and apart.max() < 0.015
    assert rendered_difference(tiled_look, look) < 1e-3  # 0.03 without the displacement


def test_a_linked_duplicate_without_a_material_gets_one_of_its_own(worn, scene, tmp_path):
    for material in list(bpy.data.materials):
        bpy.data.materials.remove(material)
    worn.data.materials.clear()
    bpy.ops.object.duplicate(linked=True)
    copy = bpy.context.object
    assert copy.data == worn.data
    bpy.ops.mps.displace(target=copy.name, method="MATERIAL", levels=0, output=str(tmp_path / "height.exr"))
    (mine,), (others,) = copy.material_slots, worn.material_slots
    assert mine.link == "OBJECT" and find_node(mine.material.node_tree, DISPLACEMENT_NODE)
    assert others.material is None and list(copy.data.materials) == [None]


@pytest.mark.parametrize("given_back_by", ["MODIFIER", "BAKE"])
def test_the_artists_own_displacement_comes_back(worn, scene, tmp_path, capfd, given_back_by):
    (slot,) = worn.material_slots
    material, tree = slot.material, slot.material.node_tree
    mine, output = tree.nodes.new("ShaderNodeDisplacement"), tree.get_output_node("ALL")
    mine.name, material.displacement_method = "Mine", "DISPLACEMENT"
    tree.links.new(mine.outputs[0], output.inputs["Displacement"])
    for _ in range(2):
        bpy.ops.mps.displace(levels=0, output=str(tmp_path / "h.exr"))
        assert output.inputs["Displacement"].links[0].from_node.name == "MPS Displacement"
    assert capfd.readouterr().out.count('The heights took the place of "Mine" in material') == 1
    mine.name = "Renamed"
    if given_back_by == "BAKE":
        bpy.ops.mps.bake(output=str(tmp_path / "again.png"))
    else:
        bpy.ops.mps.displace(method="MODIFIER", output=str(tmp_path / "h.exr"))
        assert 'is displaced by "Renamed" again' in capfd.readouterr().out
    assert output.inputs["Displacement"].links[0].from_node == mine
    assert material.displacement_method == "DISPLACEMENT" and "MPS Before" not in tree.nodes


def test_what_the_artist_links_after_it_stays(worn, scene, tmp_path):
    bpy.ops.mps.displace(levels=0, output=str(tmp_path / "h.exr"))
    material = worn.material_slots[0].material
    tree, output = material.node_tree, material.node_tree.get_output_node("ALL")
    mine = tree.nodes.new("ShaderNodeDisplacement")
    tree.links.new(mine.outputs[0], output.inputs["Displacement"])
    bpy.ops.mps.displace(method="MODIFIER", levels=0, output=str(tmp_path / "h.exr"))
    assert output.inputs["Displacement"].links[0].from_node == mine and material.displacement_method == "BOTH"


@pytest.mark.parametrize("method", ["MATERIAL", "MODIFIER"])
def test_after_another_bake_the_relief_shows_once(worn, scene, tmp_path, capfd, method):
    bpy.ops.mps.displace(method=method, levels=1, output=str(tmp_path / "h.exr"))
    bpy.ops.mps.bake(output=str(tmp_path / "again.png"))
    material, displacement, heights, modifiers = nodes_and_modifiers(worn)
    assert worn_normal(material) == "MPS Normal" and "MPS Object Normal" not in material.node_tree.nodes
    assert not displacement and not heights and not modifiers
    assert material.displacement_method == "BUMP"
    assert 'The displacement of "Sphere" is off, it would show the relief twice' in capfd.readouterr().out


def test_a_displacement_stays_under_a_bake_in_object_space(worn, scene, tmp_path):
    """It does not show the relief twice."""
    bpy.ops.mps.displace(levels=1, output=str(tmp_path / "h.exr"))
    bpy.ops.mps.bake(space="OBJECT", output=str(tmp_path / "again.png"))
    material, displacement, _, modifiers = nodes_and_modifiers(worn)
    assert worn_normal(material) == "MPS Normal" and len(displacement) == 1
    assert modifiers == ["WEIGHTED_NORMAL", "SUBSURF"]


def test_the_next_bake_is_onto_the_object_without_the_displacement(worn, scene, tmp_path):
    bpy.ops.mps.displace(method="MODIFIER", levels=1, output=str(tmp_path / "h.exr"))
    bpy.ops.mps.bake(output=str(tmp_path / "again.png"))
    assert (tmp_path / "again.png").read_bytes() == (tmp_path / "texture.png").read_bytes()
    assert all(modifier.show_viewport for modifier in worn.modifiers)


def test_the_photos_heights_stand_where_the_object_stands(estimated, scene, tmp_path):
    """An orthographic camera's: the mesh lies on the unit sphere, but for its height, which the normals do not tell."""
    estimated.matrix_world = Matrix.Identity(4)
    for _ in range(2):
        bpy.ops.mps.integrate(output=str(tmp_path / "h.exr"), curvature=True, occlusion=True, relit=True, faces=2000)
    made = scene.objects["MPS Surface"]
    assert sum(obj.name.startswith("MPS Surface") for obj in bpy.data.objects) == 1
    points = world_points(made)
    towards = np.array(scene.camera.matrix_world)[:3, 2]
    depth = points @ towards
    across = np.linalg.norm(points - depth[:, None] * towards, axis=1)
    assert across.max() == pytest.approx(1, abs=0.06)
    inner = across < 0.7
    truth = np.sqrt(1 - across[inner] ** 2)
    wrong = depth[inner] - truth
    assert np.std(wrong) < 0.03 and abs(wrong.mean()) < 1
    faces = array_of(made.data.polygons, "normal", 3)
    assert (faces @ towards > 0).all()
    assert scene.mps.heights.image.size[0] == 96
    # The object that the next step works on stays chosen, and the heights can be told apart in the panel.
    assert bpy.context.view_layer.objects.active == estimated
    assert list(bpy.context.view_layer.objects.selected) == [estimated]
    assert np.ptp(scene.mps.heights.image.preview.image_pixels_float[:]) == pytest.approx(1, abs=0.01)
    for name in ("h_curvature.png", "h_occlusion.png", "h_relit.png", "h.exr.json"):
        assert (tmp_path / name).is_file()


@pytest.fixture
def waves(scene, tmp_path):
    """A plate of 8 x 8 faces and side 2, with a texture of waves of an eighth of it, 0.02 high from crest to trough."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, size=2)
    place = (np.arange(256) + 0.5) / 256 * 2
    slope = np.broadcast_to(0.01 * 8 * np.pi * np.cos(8 * np.pi * place), (256, 256))
    normals = np.stack([-slope, np.zeros_like(slope), np.ones_like(slope)], axis=-1)
    write_image(tmp_path / "waves.png", encode(normals / np.linalg.norm(normals, axis=-1, keepdims=True)))
    scene.mps.bake.image = bpy.data.images.load(str(tmp_path / "waves.png"))
    return bpy.context.object


def test_by_its_defaults_the_relief_that_the_texture_shows_is_there(waves, tmp_path):
    bpy.ops.mps.displace(method="MODIFIER", output=str(tmp_path / "h.exr"))
    assert np.ptp(world_points(waves)[:, 2]) == pytest.approx(0.02, rel=0.25)
    assert not any("hardly" in note for note in notes_of(bpy.context.scene, "displace"))


def test_what_would_not_show_is_said(waves, tmp_path):
    bpy.ops.mps.displace(method="MODIFIER", scale=0.01, levels=2, output=str(tmp_path / "h.exr"))
    assert any("hardly shows" in note for note in notes_of(bpy.context.scene, "displace"))
