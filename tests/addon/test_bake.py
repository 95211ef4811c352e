"""The estimate and the bake in Blender, and whether a render with the texture looks as it should."""

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from blender_addon.rig.rig import light_rig
from blender_addon.scene.mesh_file import begin_mesh
from mpsnet_core import InputError, angular_error, read_mesh, read_normals

from .rendering import matte, pixels, shader_of
from .test_photo import sphere_normals


def test_the_estimate_is_the_spheres_normals(estimated, scene, tmp_path):
    image = scene.mps.estimate.image
    assert tuple(image.size) == (96, 96) and image.colorspace_settings.is_data
    found = read_normals(tmp_path / "normals.png")
    truth, mask = sphere_normals(scene, 96, 96)
    lit = mask & (truth @ light_rig(scene).directions.T > 0.1).all(-1)
    assert angular_error(found.vectors, truth)[lit].mean() < 1.5


def test_unasked_the_network_estimates(photographed, scene, tmp_path):
    assert scene.mps.estimate.model == "MULTISCALE"
    bpy.ops.mps.estimate(output=str(tmp_path / "normals.exr"), confidence=True)
    found = read_normals(tmp_path / "normals.exr")
    truth, mask = sphere_normals(scene, 96, 96)
    inner = mask & (truth[..., 2] > 0.3)
    assert angular_error(found.vectors, truth)[inner].mean() < 10
    confidence = pixels(tmp_path / "normals_confidence.exr")[..., 0]
    assert 0.5 < confidence[inner].mean() < 1


@pytest.mark.parametrize("space", ["TANGENT", "OBJECT"])
@pytest.mark.parametrize("convention", ["OPENGL", "DIRECTX"])
def test_the_material_wears_the_texture_once(estimated, scene, tmp_path, space, convention):
    for _ in range(2):
        bpy.ops.mps.bake(size=64, space=space, convention=convention, output=str(tmp_path / "texture.png"))
    (material,) = (slot.material for slot in estimated.material_slots)
    tree = material.node_tree
    shader = shader_of(tree)
    normal = shader.inputs["Normal"].links[0].from_node
    assert (normal.type, normal.space, normal.uv_map) == ("NORMAL_MAP", space, "UVMap")
    textures = [node for node in tree.nodes if node.type == "TEX_IMAGE"]
    assert len(textures) == 1 and textures[0].image == scene.mps.bake.image
    assert textures[0].image.colorspace_settings.is_data
    assert len(tree.nodes) == (6 if convention == "DIRECTX" else 5)


def test_a_material_of_other_objects_is_left_alone(estimated, scene, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    shared = estimated.material_slots[0].material
    bpy.context.object.data.materials.append(shared)
    nodes = len(shared.node_tree.nodes)
    bpy.ops.mps.bake(target=estimated.name, size=32, output=str(tmp_path / "texture.png"))
    assert len(shared.node_tree.nodes) == nodes
    assert estimated.material_slots[0].material != shared
    assert bpy.context.object.material_slots[0].material == shared


def test_the_mesh_file_is_the_evaluated_mesh(scene, tmp_path):
    bpy.ops.mesh.primitive_cylinder_add(vertices=12)  # with n-gons as its caps
    obj = bpy.context.object
    obj.location = (1, 2, 3)
    obj.modifiers.new("Array", "ARRAY").count = 2
    bpy.context.view_layer.update()
    meshes = len(bpy.data.meshes)
    begun = begin_mesh(tmp_path / "mesh.npz", obj, bpy.context.evaluated_depsgraph_get(), "").whole()
    assert begun.uv_map == "UVMap" and len(bpy.data.meshes) == meshes
    data = np.load(tmp_path / "mesh.npz", allow_pickle=False)
    triangles = 2 * (12 * 2 + 2 * 10)
    assert (str(data["format"]), int(data["version"])) == ("mpsnet-mesh", 1)
    assert data["triangles"].shape == (triangles, 3)
    assert data["vertices"].shape == (48, 3)
    assert data["uvs"].shape == (triangles, 3, 2)
    assert np.allclose(data["world_from_object"][:3, 3], (1, 2, 3))


def uneven_faces():
    """Triangles, quads that Blender splits along either diagonal, and n-gons, of which some are not convex."""
    bpy.ops.mesh.primitive_monkey_add()
    mesh, rng = bmesh.new(), np.random.default_rng(5)
    mesh.from_mesh(bpy.context.object.data)
    for vertex in mesh.verts:
        vertex.co += Vector(rng.normal(0, 0.05, 3))
    bmesh.ops.dissolve_edges(mesh, edges=mesh.edges[:][::5])
    mesh.to_mesh(bpy.context.object.data)
    mesh.free()
    return bpy.context.object


def test_triangles_are_blenders_own(scene, tmp_path):
    obj, graph = uneven_faces(), bpy.context.evaluated_depsgraph_get()
    begin_mesh(tmp_path / "mesh.npz", obj, graph, None).whole()
    mesh = obj.evaluated_get(graph).data
    assert {3, 4} < {len(polygon.vertices) for polygon in mesh.polygons}
    expected = [triangle.vertices[:] for triangle in mesh.loop_triangles]
    np.testing.assert_array_equal(read_mesh(tmp_path / "mesh.npz").triangles, expected)


@pytest.fixture
def heavy(scene):
    """A grid of more triangles than a slice holds."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=300, y_subdivisions=400)
    bpy.context.object.data.polygons.foreach_set("use_smooth", [True] * len(bpy.context.object.data.polygons))
    return bpy.context.object


def test_a_mesh_is_written_as_it_was_when_its_file_was_begun(heavy, tmp_path):
    graph = bpy.context.evaluated_depsgraph_get()
    files = [tmp_path / name for name in ("at_once.npz", "later.npz")]
    begin_mesh(files[0], heavy, graph, "").whole()
    begun = begin_mesh(files[1], heavy, graph, "")
    next(begun.slices)
    meshes = list(bpy.data.meshes)
    heavy.data.transform(Matrix.Scale(3, 4))
    bpy.data.objects.remove(heavy)
    assert sum(1 for _ in begun.slices) > 8 and list(bpy.data.meshes) == meshes
    with np.load(files[0]) as one, np.load(files[1]) as other:
        assert one.files == other.files and len(one["triangles"]) == 2 * 300 * 400
        for name in one.files:
            np.testing.assert_array_equal(one[name], other[name])


def linked_sphere(folder):
    """A sphere, its mesh and its material in a file of their own, and the names they have there."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=8)
    obj = bpy.context.object
    obj.name = obj.data.name = "Elsewhere"
    material = matte()
    material.name = "Elsewhere"
    obj.data.materials.append(material)
    bpy.data.libraries.write(str(folder / "library.blend"), {obj})
    mesh = obj.data
    bpy.data.objects.remove(obj)
    bpy.data.meshes.remove(mesh)
    bpy.data.materials.remove(material)


@pytest.mark.parametrize("what", ["object", "mesh"])
def test_a_linked_target_is_refused_before_the_work(estimated, scene, tmp_path, what):
    linked_sphere(tmp_path)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        setattr(wanted, "objects" if what == "object" else "meshes", ["Elsewhere"])
    data = wanted.objects[0] if what == "object" else bpy.data.objects.new("Here", wanted.meshes[0])
    scene.collection.objects.link(data)
    sentence = rf'the {what} "Elsewhere" is linked from .*library\.blend; make it local first'
    with pytest.raises(RuntimeError, match=sentence):
        bpy.ops.mps.bake(target=data.name, size=32, output=str(tmp_path / "texture.png"))
    assert not (tmp_path / "texture.png").exists()


def test_a_linked_material_is_left_to_its_file_and_a_copy_worn(estimated, scene, tmp_path):
    linked_sphere(tmp_path)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        wanted.materials = ["Elsewhere"]
    (linked,) = wanted.materials
    estimated.material_slots[0].material = linked
    bpy.ops.mps.bake(target=estimated.name, size=32, output=str(tmp_path / "texture.png"))
    worn = estimated.material_slots[0].material
    assert worn != linked and worn.library is None
    assert "MPS Normal" in worn.node_tree.nodes and "MPS Normal" not in linked.node_tree.nodes


def test_the_mesh_file_is_the_mesh_of_the_render_and_the_viewport_keeps_its_own(scene, tmp_path):
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    subsurf = obj.modifiers.new("Subdivision", "SUBSURF")
    subsurf.levels, subsurf.render_levels = 0, 2
    array = obj.modifiers.new("Array", "ARRAY")
    array.count, array.show_viewport, array.show_render = 2, False, True
    preview = obj.modifiers.new("Preview", "ARRAY")
    preview.count, preview.show_viewport, preview.show_render = 3, True, False

    def shown():
        return subsurf.levels, array.show_viewport, preview.show_viewport

    before = shown()
    begin_mesh(tmp_path / "mesh.npz", obj, bpy.context.evaluated_depsgraph_get(), "").whole()
    assert len(np.load(tmp_path / "mesh.npz")["triangles"]) == 2 * 6 * 4**2 * 2
    assert shown() == before
    obj.hide_viewport = True
    bpy.context.view_layer.update()
    with pytest.raises(InputError, match='"Cube" is disabled in viewports'):
        begin_mesh(tmp_path / "mesh.npz", obj, bpy.context.evaluated_depsgraph_get(), "")
    assert shown() == before
