"""The bake against Blender's: its selected-to-active bake, and how the texture looks on the model in Cycles.

The views are Cycles renders of the detailed mesh's normals, so that nothing of the core makes what it is fed.
"""

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
import pytest
from external_data import external_data
from mathutils import Matrix, Vector
from mesh_file import write_mesh
from synthetic import degrees_between

from blender_addon.images import pixels_of
from mpsnet_core import Camera, Mesh, NormalMap, View, bake_normals, read_mesh, write_texture

from .rendering import activate, array_of, detailed_object, nodes_of, pixels, set_up_cycles, simplified, with_materials

SIDES = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (1, 1, 0.6), (-1, -1, 0.6)]


def mirror_half_of_the_uvs(obj: "bpy.types.Object") -> None:
    """The layout squeezed into the texture's left half, but for the faces of some islands: those into the right half,
    turned over."""
    mesh = obj.data
    uvs = array_of(mesh.uv_layers.active.data, "uv", 2)
    corners = uvs.reshape(-1, 3, 2)
    vertices = array_of(mesh.loops, "vertex_index", 1, np.int32).reshape(-1, 3)
    parent = {}

    def root(key: tuple) -> tuple:
        while parent.setdefault(key, key) != key:
            key = parent[key]
        return key

    keys = [
        [(int(vertex), *uv.round(6).tolist()) for vertex, uv in zip(*triangle, strict=True)]
        for triangle in zip(vertices, corners, strict=True)
    ]
    for a, b, c in keys:
        parent[root(a)] = parent[root(b)] = root(c)
        parent[root(b)] = root(c)
    islands = {}
    number = np.array([islands.setdefault(root(a), len(islands)) for a, _, _ in keys])
    turned = np.repeat(number % 2 == 1, 3)
    uvs[:, 0] = np.where(turned, 1 - uvs[:, 0] / 2, uvs[:, 0] / 2)
    mesh.uv_layers.active.data.foreach_set("uv", uvs.ravel())
    mesh.update()


def mesh_of(obj: "bpy.types.Object") -> Mesh:
    """The mesh as Blender knows it, with Blender's tangents."""
    mesh = obj.data
    assert all(len(polygon.vertices) == 3 for polygon in mesh.polygons)
    mesh.calc_tangents()
    tangents = np.concatenate([array_of(mesh.loops, "tangent", 3), array_of(mesh.loops, "bitangent_sign", 1)], axis=1)
    return Mesh(
        array_of(mesh.vertices, "co", 3).astype(np.float64),
        array_of(mesh.loops, "vertex_index", 1, np.int32).reshape(-1, 3),
        array_of(mesh.corner_normals, "vector", 3).reshape(-1, 3, 3),
        array_of(mesh.uv_layers.active.data, "uv", 2).reshape(-1, 3, 2),
        tangents.reshape(-1, 3, 4),
        np.array(obj.matrix_world),
    )


def core_mesh(obj: "bpy.types.Object", path: Path) -> Mesh:
    """The same through the exchange file."""
    write_mesh(path, mesh_of(obj))
    return read_mesh(path)


def render(path: Path, camera: "bpy.types.Object", visible: "bpy.types.Object", samples: int = 1) -> np.ndarray:
    """(H, W, 4) linear pixels of a Cycles render of one object, row 0 on top."""
    scene = bpy.context.scene
    for obj in scene.objects:
        if obj.type == "MESH":
            obj.hide_render = obj is not visible
    scene.camera = camera
    scene.cycles.samples = samples
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return pixels(path)


def camera_at(side: tuple[float, float, float], projection: str = "ORTHO") -> "bpy.types.Object":
    data = bpy.data.cameras.new("Camera")
    data.type, data.ortho_scale, data.angle = projection, 2.1, 0.35
    obj = bpy.data.objects.new("Camera", data)
    obj.rotation_euler = Vector(side).to_track_quat("Z", "Y").to_euler()
    obj.location = Vector(side).normalized() * (5 if projection == "ORTHO" else 6.5)
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.update()
    return obj


def normal_view(side: tuple[float, float, float], detailed: "bpy.types.Object", path: Path, projection: str) -> View:
    """The camera-space normals of the detailed mesh as Cycles sees them."""
    tree = nodes_of(detailed.data.materials[0])
    tree.nodes.clear()
    geometry, shift = tree.nodes.new("ShaderNodeNewGeometry"), tree.nodes.new("ShaderNodeVectorMath")
    shift.operation = "MULTIPLY_ADD"
    shift.inputs[1].default_value = shift.inputs[2].default_value = (0.5, 0.5, 0.5)
    emission, output = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(geometry.outputs["Normal"], shift.inputs[0])
    tree.links.new(shift.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    camera = camera_at(side, projection)
    picture = render(path, camera, detailed)
    size = len(picture)
    pose = np.array(camera.matrix_world)
    focal = size / 2.1 if projection == "ORTHO" else size / 2 / np.tan(camera.data.angle / 2)
    core = Camera("orthographic" if projection == "ORTHO" else "perspective", size, size, [focal, focal], None, pose)
    world = picture[..., :3] * 2 - 1
    return View(core, NormalMap(world @ pose[:3, :3], picture[..., 3] > 0.5))


def blenders_bake(
    detailed: "bpy.types.Object", simple: "bpy.types.Object", size: int, space: str, extrusion: float = 0.03
) -> np.ndarray:
    """(S, S, 3) Blender's own selected-to-active bake, row 0 on top; zero where it baked nothing."""
    image = bpy.data.images.new("Bake", size, size, float_buffer=True, is_data=True)
    tree = nodes_of(simple.data.materials[0])
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    tree.nodes.active = texture
    activate(simple, detailed)
    detailed.hide_render = simple.hide_render = False
    bpy.context.scene.cycles.samples = 1
    bpy.ops.object.bake(
        type="NORMAL",
        use_selected_to_active=True,
        cage_extrusion=extrusion,
        margin=0,
        normal_space=space,
        use_clear=True,
    )
    return normals_of(pixels_of(image)[::-1])


def normals_of(colours: np.ndarray) -> np.ndarray:
    """(S, S, 3) the vectors that colours stand for; zero where nothing was baked."""
    vectors = colours[..., :3] * 2 - 1
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(np.abs(length - 1) < 0.05, vectors / np.maximum(length, 1e-6), 0)


@pytest.fixture
def bunny(scene):
    return detailed_object(external_data("meshes/test/bunny.obj"))


def test_a_70k_mesh_baked_onto_7k_agrees_with_blenders_bake(bunny, tmp_path):
    set_up_cycles(512)
    simple = simplified(bunny, 7000)
    with_materials(bunny, simple)
    assert 69_000 < len(bunny.data.polygons) < 71_000 and 6_900 < len(simple.data.polygons) < 7_100
    views = [normal_view(side, bunny, tmp_path / "view.exr", "ORTHO") for side in SIDES]
    texture = bake_normals(core_mesh(simple, tmp_path / "mesh.npz"), views, size=1024)
    reference = blenders_bake(bunny, simple, 1024, "TANGENT")
    both = texture.seen & reference.any(axis=-1)
    assert both.sum() > 0.99 * texture.seen.sum() and texture.seen_fraction > 0.99
    error = degrees_between(texture.vectors, reference)[both]
    print(f"mean {error.mean():.3f}, median {np.median(error):.3f}, 99 % below {np.percentile(error, 99):.2f} degrees")
    assert error.mean() < 0.4  # 1.5 was asked for
    # What there was to bake: the detail, without which the texture would be flat.
    assert degrees_between(np.array([0, 0, 1.0]), reference)[both].mean() > 4


@dataclass(frozen=True)
class Placement:
    """Where the objects stand, and how their UVs lie."""

    matrix: Matrix
    mirrored_uvs: bool
    projection: str


AS_THEY_ARE = Placement(Matrix.Identity(4), False, "ORTHO")
TURN = Matrix.Rotation(0.7, 3, (1, 2, 3)).to_quaternion()
TURNED = Placement(Matrix.LocRotScale((0.1, -0.05, 0.05), TURN, (0.9, 0.9, 0.9)), True, "PERSP")
STRETCHED = Placement(Matrix.LocRotScale((0.1, -0.05, 0.05), TURN, (0.9, 0.6, 1.1)), True, "PERSP")
REFLECTED = Placement(Matrix.LocRotScale((0, 0, 0), TURN, (-0.9, 0.8, 1)), True, "ORTHO")


def posed_pair(placement: Placement) -> tuple["bpy.types.Object", "bpy.types.Object"]:
    detailed = detailed_object()
    simple = simplified(detailed, 2000)
    if placement.mirrored_uvs:
        mirror_half_of_the_uvs(simple)
    with_materials(detailed, simple)
    detailed.matrix_world = simple.matrix_world = placement.matrix
    bpy.context.view_layer.update()
    return detailed, simple


@pytest.mark.parametrize("placement", [AS_THEY_ARE, TURNED], ids=["as they are", "turned, mirrored UVs"])
def test_both_spaces_agree_with_blenders_bake(scene, tmp_path, placement):
    """Not for stretched objects: there Blender's bake departs from its own renders, in object space by some 20 degrees.

    Those are judged by how the texture looks, below, and against known normals in tests/core.
    """
    set_up_cycles(512)
    detailed, simple = posed_pair(placement)
    views = [normal_view(side, detailed, tmp_path / "view.exr", placement.projection) for side in SIDES]
    mesh = core_mesh(simple, tmp_path / "mesh.npz")
    for space in ("TANGENT", "OBJECT"):
        texture = bake_normals(mesh, views, size=512, space=space.lower(), margin=0)
        reference = blenders_bake(detailed, simple, 512, space)
        both = texture.seen & reference.any(axis=-1)
        assert both.sum() > 0.97 * texture.covered.sum()
        error = degrees_between(texture.vectors, reference)[both]
        print(f"{space}: mean {error.mean():.3f} degrees")
        assert error.mean() < 0.3
        if placement.mirrored_uvs:
            right = np.broadcast_to(np.arange(512) >= 256, both.shape)[both]
            assert 0.2 < right.mean() < 0.8
            assert error[right].mean() < 0.3 and error[~right].mean() < 0.3


def dressed(simple: "bpy.types.Object", path: Path | None, space: str, flip_green: bool) -> None:
    """A grey, matte material; with the texture as the artist would put it on where there is one."""
    tree = nodes_of(simple.data.materials[0])
    tree.nodes.clear()
    shader, output = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    if path is None:
        return
    texture, normal_map = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeNormalMap")
    texture.image = bpy.data.images.load(str(path))
    texture.image.colorspace_settings.name = "Non-Color"
    normal_map.space = space
    normal_map.uv_map = simple.data.uv_layers.active.name if simple.data.uv_layers else ""
    colour = texture.outputs["Color"]
    if flip_green:
        turn = tree.nodes.new("ShaderNodeVectorMath")
        turn.operation = "MULTIPLY_ADD"
        turn.inputs[1].default_value, turn.inputs[2].default_value = (1, -1, 1), (0, 1, 0)
        tree.links.new(colour, turn.inputs[0])
        colour = turn.outputs[0]
    tree.links.new(colour, normal_map.inputs["Color"])
    tree.links.new(normal_map.outputs["Normal"], shader.inputs["Normal"])


def add_sun() -> None:
    """One light, so that one sample has no noise; without shadows, which are the shape's and not the texture's."""
    data = bpy.data.lights.new("Sun", "SUN")
    data.energy, data.angle, data.use_shadow = 3, 0, False
    obj = bpy.data.objects.new("Sun", data)
    obj.rotation_euler = Vector((0.9, -1, 1)).to_track_quat("Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(obj)


@pytest.mark.parametrize(
    "placement", [AS_THEY_ARE, STRETCHED, REFLECTED], ids=["as they are", "stretched, mirrored UVs", "reflected"]
)
def test_with_the_texture_it_looks_more_like_the_original(scene, tmp_path, placement):
    """From a side not baked from, in both spaces and conventions; with green turned over about as bad as without."""
    set_up_cycles(512)
    detailed, simple = posed_pair(placement)
    views = [normal_view(side, detailed, tmp_path / "view.exr", placement.projection) for side in SIDES]
    mesh = core_mesh(simple, tmp_path / "mesh.npz")
    add_sun()
    scene.render.resolution_x = scene.render.resolution_y = 192
    scene.cycles.max_bounces = 0
    camera = camera_at((0.5, -1, 0.3))

    def looks(obj: "bpy.types.Object") -> np.ndarray:
        return render(tmp_path / "look.exr", camera, obj)

    dressed(detailed, None, "TANGENT", False)
    original = looks(detailed)
    dressed(simple, None, "TANGENT", False)
    plain = looks(simple)
    inside = (original[..., 3] > 0.99) & (plain[..., 3] > 0.99)

    def difference(picture: np.ndarray) -> float:
        return float(np.abs(picture - original)[inside][:, :3].mean())

    for space in ("TANGENT", "OBJECT"):
        texture = bake_normals(mesh, views, size=512, space=space.lower())
        for convention in ("opengl", "directx"):
            path = tmp_path / f"{space}-{convention}.png"
            write_texture(path, texture, convention=convention)
            dressed(simple, path, space, convention == "directx")
            right = difference(looks(simple))
            dressed(simple, path, space, convention != "directx")
            wrong = difference(looks(simple))
            print(f"{space} {convention}: {right:.4f}, green turned over {wrong:.4f}, plain {difference(plain):.4f}")
            assert right < 0.25 * difference(plain)
            assert wrong > 0.7 * difference(plain)
