"""The estimate and the bake in Blender, and whether a render with the texture looks as it should."""

from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from blender_addon.operators import core_run
from blender_addon.rig.light_rig import light_rig
from blender_addon.scene.mesh_file import begin_mesh
from blender_addon.slices import close_slices
from mpsnet_core import angular_error, read_normals
from mpsnet_core.errors import InputError
from mpsnet_core.scene.mesh import read_mesh

from .rendering import array_of, matte, pixels, shader_of
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


def test_estimate_options_reach_the_core(photographed, scene, tmp_path):
    bpy.ops.mps.estimate(
        output=str(tmp_path / "n.exr"), mask="THRESHOLD", threshold=0.8, model="LAMBERTIAN_GREY_WORLD", confidence=True
    )
    assert read_normals(tmp_path / "n.exr").mask.mean() < pixels(tmp_path / "photo.exr")[..., 3].mean()
    assert (tmp_path / "n_confidence.exr").is_file()


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


@pytest.fixture(scope="module")
def tilted_light():
    """A direction from above on the right: up and down, left and right are told apart."""
    return Vector((0.5, -1.0, 0.8)).normalized()


def low_poly_shot(scene, direction, path):
    """Render what the rig's camera sees under one white sun."""
    lights = [light.object for light in scene.mps.rig.lights]
    colours = [tuple(light.data.color) for light in lights]
    matrix, constraint = lights[0].matrix_world.copy(), lights[0].constraints[0]
    for light, colour in zip(lights, ((1, 1, 1), (0, 0, 0), (0, 0, 0)), strict=True):
        light.data.color = colour
    constraint.enabled = False
    lights[0].matrix_world = direction.to_track_quat("Z", "Y").to_matrix().to_4x4()
    from blender_addon.photo.studio import _render, _studio

    with _studio(scene) as studio:
        studio.cycles.samples = 16
        _render(studio, path, "OPEN_EXR")
    constraint.enabled = True
    lights[0].matrix_world = matrix
    for light, colour in zip(lights, colours, strict=True):
        light.data.color = colour
    return pixels(path)[..., :3]


def bumpy_sphere():
    """A sphere with large and small bumps, unlike in every direction."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=192, ring_count=96)
    bpy.ops.object.shade_smooth()
    obj = bpy.context.object
    points = array_of(obj.data.vertices, "co", 3)
    x, z = points[:, 0], points[:, 2]
    bumps = np.sin(9 * x + 1) * np.sin(11 * z) + 0.5 * np.sin(17 * z + 5 * x)
    points *= (1 + 0.02 * bumps)[:, None]
    obj.data.vertices.foreach_set("co", points.ravel())
    obj.data.update()
    obj.data.materials.append(matte())
    return obj


@pytest.mark.accuracy
@pytest.mark.parametrize("mirrored", [False, True])
def test_the_texture_brings_the_low_poly_closer_to_the_original(scene, tmp_path, tilted_light, mirrored):
    high = bumpy_sphere()
    bpy.ops.mps.add_rig(slant=25)
    bpy.ops.mps.render_photo(width=128, height=128, samples=16, output=str(tmp_path / "photo.exr"))
    bpy.ops.mps.estimate(output=str(tmp_path / "normals.png"))
    target = low_poly_shot(scene, tilted_light, tmp_path / "high.exr")

    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=12)
    bpy.ops.object.shade_smooth()
    low = bpy.context.object
    if mirrored:
        uv = array_of(low.data.uv_layers[0].uv, "vector", 2)
        uv[:, 0] = 1 - uv[:, 0]
        low.data.uv_layers[0].uv.foreach_set("vector", uv.ravel())
    low.data.materials.append(matte())
    low.matrix_world = Matrix.LocRotScale(None, Matrix.Rotation(0.6, 3, "Z"), Vector((1, 1, 1)))
    high.hide_render = True
    bare = low_poly_shot(scene, tilted_light, tmp_path / "bare.exr")

    errors = {"bare": np.abs(bare - target).mean()}
    for space in ("TANGENT", "OBJECT"):
        for convention in ("OPENGL", "DIRECTX"):
            name = f"{space}_{convention}"
            bpy.ops.mps.bake(size=256, space=space, convention=convention, output=str(tmp_path / f"{name}.png"))
            shot = low_poly_shot(scene, tilted_light, tmp_path / f"{name}_shot.exr")
            errors[name] = np.abs(shot - target).mean()
    # The same texture read with green the wrong way: what this test has to be able to see.
    normal = low.material_slots[0].material.node_tree.nodes["MPS Normal"]
    texture = low.material_slots[0].material.node_tree.nodes["MPS Texture"]
    low.material_slots[0].material.node_tree.links.new(texture.outputs["Color"], normal.inputs["Color"])
    errors["wrong"] = np.abs(low_poly_shot(scene, tilted_light, tmp_path / "wrong.exr") - target).mean()
    print(errors)
    right = [error for name, error in errors.items() if name not in {"bare", "wrong"}]
    assert max(right) < 0.6 * errors["bare"]
    assert max(right) < 0.6 * errors["wrong"]


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
    normals, tangents = data["corner_normals"], read_mesh(tmp_path / "mesh.npz").tangents
    assert np.allclose(np.linalg.norm(normals, axis=-1), 1, atol=1e-5)
    assert np.allclose((normals * tangents[..., :3]).sum(-1), 0, atol=1e-3)
    assert set(np.unique(tangents[..., 3])) <= {-1, 1}
    # On the flat faces of a cylinder the tangent is the direction in which u grows.
    corners = data["vertices"][data["triangles"]]
    (e1, e2), (d1, d2) = (np.moveaxis(a[:, 1:] - a[:, :1], 1, 0) for a in (corners, data["uvs"]))
    direction = e1 * d2[:, 1:] - e2 * d1[:, 1:]
    direction *= np.sign(d1[:, :1] * d2[:, 1:] - d2[:, :1] * d1[:, 1:])
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    assert np.allclose(tangents[..., :3].mean(1), direction, atol=2e-2)


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


def test_between_two_slices_the_window_goes_on_and_cancel_leaves_nothing(heavy, tmp_path, monkeypatch):
    monkeypatch.setattr(core_run, "SLICE_SECONDS", 0)
    manager, started = bpy.context.window_manager, []

    def job():
        held = ExitStack()
        folder = Path(held.enter_context(TemporaryDirectory(dir=tmp_path)))
        graph = bpy.context.evaluated_depsgraph_get()
        slices = [begin_mesh(folder / f"{number}.npz", heavy, graph, "").slices for number in range(2)]
        held.callback(close_slices, slices)
        one = core_run._Job(
            held, [core_run._Run(slices, lambda: started.append({file.name for file in folder.iterdir()}))]
        )
        core_run._jobs.append(one)
        return one

    whole, count = job(), 0
    while not started:
        whole.advance()
        count += 1
    assert count > 16 and started == [{"0.npz", "1.npz"}]
    cancelled = job()
    cancelled.advance()
    assert len(started) == 1 and len(list(tmp_path.iterdir())) == 2
    for one in (cancelled, whole):
        one.leave(manager)
    assert len(started) == 1 and not list(tmp_path.iterdir())


def test_a_texture_is_read_when_it_is_shown(estimated, scene, tmp_path):
    """To read 4096² pixels takes half a second."""
    for _ in range(2):  # the second time the image is there already
        bpy.ops.mps.bake(size=32, output=str(tmp_path / "texture.png"))
        image = scene.mps.bake.image
        assert not image.has_data
        assert tuple(image.size) == (32, 32) and image.has_data


def test_the_window_is_drawn_before_a_long_slice(scene, monkeypatch):
    monkeypatch.setattr(core_run, "SLICE_SECONDS", 60)
    done = []

    def slices():
        for name, is_next_long in (("short", False), ("short", True), ("long", True), ("long", False)):
            done.append(name)
            yield is_next_long

    job = core_run._Job(ExitStack(), [core_run._Run([slices()], lambda: done.append("started"))])
    for until in (["short", "short"], ["long"], ["long", "started"]):
        done.clear()
        job.advance()
        assert done == until


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


def test_a_material_is_shared_by_what_it_is_not_by_its_name(estimated, scene, tmp_path):
    linked_sphere(tmp_path)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        wanted.materials = ["Elsewhere"]
    mine = estimated.material_slots[0].material
    mine.name = "Elsewhere"
    assert mine.name == wanted.materials[0].name
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.data.materials.append(wanted.materials[0])
    bpy.ops.mps.bake(target=estimated.name, size=32, output=str(tmp_path / "texture.png"))
    assert estimated.material_slots[0].material == mine


def test_a_bump_that_gives_way_to_the_texture_is_named(estimated, tmp_path, capfd):
    tree = estimated.material_slots[0].material.node_tree
    bump = tree.nodes.new("ShaderNodeBump")
    bump.name = "Scratches"
    shader = shader_of(tree)
    tree.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    sentence = 'The texture took the place of "Scratches" in material "Matte"'
    for said in (True, False):
        bpy.ops.mps.bake(size=32, output=str(tmp_path / "texture.png"))
        assert (sentence in capfd.readouterr().out) == said


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
