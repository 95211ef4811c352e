"""Tangents and normals that the core computes from mesh files, against Blender's own, corner by corner."""

import math
from pathlib import Path

import bmesh
import bpy
import numpy as np
import pytest

from blender_addon.scene.mesh_file import begin_mesh
from mpsnet_core.scene.mesh import Mesh, read_mesh

from .rendering import array_of


def triangulated(obj: "bpy.types.Object") -> None:
    """Triangles in place of polygons, kept apart where they were: what both sides then compute tangents of."""
    mesh = bmesh.new()
    mesh.from_mesh(obj.data)
    bmesh.ops.triangulate(mesh, faces=mesh.faces)
    mesh.to_mesh(obj.data)
    mesh.free()


def uv_sphere() -> None:
    bpy.ops.mesh.primitive_uv_sphere_add(segments=24, ring_count=12)
    bpy.ops.object.shade_smooth()


def flat_cube() -> None:
    bpy.ops.mesh.primitive_cube_add()


def ico_sphere_with_projected_uvs() -> None:
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=4)
    bpy.ops.object.shade_smooth()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(island_margin=0.01)
    bpy.ops.object.mode_set(mode="OBJECT")


def monkey() -> None:
    """Quads and triangles, split UVs, thin triangles."""
    bpy.ops.mesh.primitive_monkey_add(calc_uvs=True)
    bpy.ops.object.shade_smooth()


def mirrored_monkey() -> None:
    """Both halves share their UVs, so that one half's run the other way round."""
    monkey()
    layer = bpy.context.object.data.uv_layers.active.data
    uvs = array_of(layer, "uv", 2)
    uvs[:, 0] = np.abs(uvs[:, 0] - 0.5)
    layer.foreach_set("uv", uvs.ravel())


def torus_with_mirrored_faces() -> None:
    """The UVs of a third of its faces are turned over in place: their tangents part from the neighbours'."""
    bpy.ops.mesh.primitive_torus_add(major_segments=20, minor_segments=10)
    bpy.ops.object.shade_smooth()
    mesh = bpy.context.object.data
    layer = mesh.uv_layers.active.data
    for polygon in mesh.polygons:
        if polygon.index % 3 == 0:
            for loop in polygon.loop_indices:
                u, v = layer[loop].uv
                layer[loop].uv = (0.5 - u, v)


def sphere_with_sharp_edges() -> None:
    uv_sphere()
    mesh = bpy.context.object.data
    sharp = mesh.attributes.new("sharp_edge", "BOOLEAN", "EDGE")
    sharp.data.foreach_set("value", np.arange(len(mesh.edges)) % 7 == 0)


def cylinder_with_ngon_caps() -> None:
    bpy.ops.mesh.primitive_cylinder_add(vertices=20, end_fill_type="NGON")
    bpy.context.object.data.polygons.foreach_set("use_smooth", [True] * len(bpy.context.object.data.polygons))


def uneven_grid() -> None:
    """Faces of many sizes and angles, bent, with UVs that neither keep angles nor areas."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=20, y_subdivisions=20)
    bpy.ops.object.shade_smooth()
    mesh = bpy.context.object.data
    rng = np.random.default_rng(3)
    for vertex in mesh.vertices:
        x, y, _ = vertex.co
        shift = rng.normal(0, 0.015, 3)
        vertex.co = (x + shift[0], y + shift[1], 0.3 * math.sin(3 * x) * math.cos(4 * y) + shift[2])
    for loop, uv in zip(mesh.loops, mesh.uv_layers.active.data, strict=True):
        u, v = loop.vertex_index % 21 / 20, loop.vertex_index // 21 / 20
        uv.uv = (0.1 + 0.8 * u**2, 0.9 * v + 0.1 * u * v)


def grid_with_collapsed_uvs() -> None:
    """Many vertices have a neighbour's UV: tangents are shared across the triangles without UV area between them."""
    uneven_grid()
    mesh = bpy.context.object.data
    at_vertex = {}
    for loop, uv in zip(mesh.loops, mesh.uv_layers.active.data, strict=True):
        at_vertex[loop.vertex_index] = tuple(uv.uv)
    collapsed = np.random.default_rng(1).random(len(mesh.vertices)) < 0.15
    for loop, uv in zip(mesh.loops, mesh.uv_layers.active.data, strict=True):
        number = loop.vertex_index
        if collapsed[number] and number % 21 < 20:
            uv.uv = at_vertex[number + 1]


SHAPES = [
    uv_sphere,
    flat_cube,
    ico_sphere_with_projected_uvs,
    monkey,
    mirrored_monkey,
    torus_with_mirrored_faces,
    sphere_with_sharp_edges,
    cylinder_with_ngon_caps,
    uneven_grid,
    grid_with_collapsed_uvs,
]


class BlendersCorners:
    """(T, 3, ...) corners of a triangulated mesh as Blender has them, triangles in Blender's order."""

    def __init__(self, mesh: "bpy.types.Mesh") -> None:
        assert all(len(polygon.vertices) == 3 for polygon in mesh.polygons)
        mesh.calc_tangents()
        sign = array_of(mesh.loops, "bitangent_sign", 1)
        self.tangents = np.concatenate([array_of(mesh.loops, "tangent", 3), sign], axis=1).reshape(-1, 3, 4)
        self.normals = array_of(mesh.corner_normals, "vector", 3).reshape(-1, 3, 3)
        self.uvs = array_of(mesh.uv_layers.active.data, "uv", 2).reshape(-1, 3, 2)
        vertices = array_of(mesh.vertices, "co", 3)
        numbers = np.array([loop.vertex_index for loop in mesh.loops])
        self.positions = vertices[numbers].reshape(-1, 3, 3)


def written_obj(path: Path, **options: bool) -> Mesh:
    bpy.ops.wm.obj_export(filepath=str(path), forward_axis="Y", up_axis="Z", export_uv=True, **options)
    return read_mesh(path)


def written_ply(path: Path) -> Mesh:
    bpy.ops.wm.ply_export(filepath=str(path), forward_axis="Y", up_axis="Z", export_normals=True, export_uv=True)
    return read_mesh(path)


def written_glb(path: Path) -> Mesh:
    bpy.context.object.data.materials.append(bpy.data.materials.new("Plain"))
    bpy.ops.export_scene.gltf(filepath=str(path), export_yup=False, export_normals=True, export_texcoords=True)
    return read_mesh(path)


def written_npz(path: Path) -> Mesh:
    """As the bake hands it over: with polygons, and the core computes the tangents."""
    begin_mesh(path, bpy.context.object, bpy.context.evaluated_depsgraph_get(), "").whole()
    return read_mesh(path)


def same_triangles(mesh: Mesh, blender: BlendersCorners) -> tuple[np.ndarray, np.ndarray]:
    """The order and the first corners that lay the file's triangles onto Blender's."""
    ours = np.concatenate([mesh.vertices[mesh.triangles], mesh.uvs], axis=2)
    theirs = np.concatenate([blender.positions, blender.uvs], axis=2)
    assert ours.shape == theirs.shape
    keys = {}
    for number, corners in enumerate(theirs.round(3)):
        for first in range(3):
            keys.setdefault(tuple(np.roll(corners, -first, axis=0).ravel() + 0.0), (number, first))
    order = np.empty((len(ours), 2), int)
    for number, corners in enumerate(ours):
        distance = None
        place = keys.get(tuple(corners.round(3).ravel() + 0.0))
        if place is None:  # rounded to the other side: search
            distance = [np.abs(np.roll(theirs, -first, axis=1) - corners).max(axis=(1, 2)) for first in range(3)]
            first = int(np.argmin([d.min() for d in distance]))
            place = (int(np.argmin(distance[first])), first)
        order[number] = place
    assert len(set(order[:, 0])) == len(ours)
    return order[:, 0], order[:, 1]


def assert_tangents_agree(mesh: Mesh, blender: BlendersCorners) -> None:
    triangle, first = same_triangles(mesh, blender)
    corner = (first[:, None] + np.arange(3)) % 3
    # Triangles without UV area hold no texel: nothing is ever looked up with their tangents.
    e1, e2 = np.diff(blender.uvs[triangle], axis=1).swapaxes(0, 1)
    holds_texels = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]) > 1e-12
    expected = blender.tangents[triangle[:, None], corner][holds_texels]
    tangents = mesh.tangents[holds_texels]
    assert holds_texels.mean() > 0.5
    assert (tangents[..., 3] == expected[..., 3]).all()
    difference = np.abs(tangents - expected).max(axis=-1)
    assert difference.max() < 1e-3, f"{(difference >= 1e-3).sum()} of {difference.size} corners differ"


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.__name__)
@pytest.mark.parametrize("written", [written_obj, written_ply, written_glb], ids=["obj", "ply", "glb"])
def test_tangents_of_a_mesh_file_are_blenders(scene, tmp_path, shape, written):
    shape()
    obj = bpy.context.object
    triangulated(obj)
    if written is written_ply:
        # PLY has one normal a vertex; what Blender writes there is the smooth one.
        obj.data.polygons.foreach_set("use_smooth", [True] * len(obj.data.polygons))
        if "sharp_edge" in obj.data.attributes:
            obj.data.attributes.remove(obj.data.attributes["sharp_edge"])
    mesh = written(tmp_path / f"mesh.{written.__name__[-3:]}")
    assert_tangents_agree(mesh, BlendersCorners(obj.data))


@pytest.mark.parametrize(
    "shape", [one for one in SHAPES if one is not cylinder_with_ngon_caps], ids=lambda shape: shape.__name__
)
def test_quads_have_blenders_tangents(scene, tmp_path, shape):
    shape()
    mesh, found = bpy.context.object.data, written_npz(tmp_path / "mesh.npz")
    mesh.calc_tangents()
    tangents = np.concatenate([array_of(mesh.loops, "tangent", 3), array_of(mesh.loops, "bitangent_sign", 1)], axis=1)
    e1, e2 = np.diff(found.uvs, axis=1).swapaxes(0, 1)
    holds_texels = np.abs(e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0]) > 1e-12
    expected = tangents[array_of(mesh.loop_triangles, "loops", 3).astype(int)]
    assert np.abs(found.tangents - expected)[holds_texels].max() < 1e-3


def test_polygons_beside_quads_have_the_tangents_of_their_triangles(scene, tmp_path):
    """Blender has none for a mesh with such polygons. Sides and caps are flat with even UVs: however they are
    triangulated, a corner's tangent is the same."""
    cylinder_with_ngon_caps()
    obj = bpy.context.object
    obj.data.polygons.foreach_set("use_smooth", [False] * len(obj.data.polygons))
    found = written_npz(tmp_path / "mesh.npz")
    triangulated(obj)
    blender = BlendersCorners(obj.data)

    ours = np.concatenate([found.vertices[found.triangles], found.corner_normals], axis=2).reshape(-1, 6)
    theirs = np.concatenate([blender.positions, blender.normals], axis=2).reshape(-1, 6)
    apart = np.abs(ours[:, None] - theirs).max(axis=2)
    assert len(ours) == len(theirs) and apart.min(axis=1).max() < 1e-3
    expected = blender.tangents.reshape(-1, 4)[apart.argmin(axis=1)]
    assert np.abs(found.tangents.reshape(-1, 4) - expected).max() < 1e-3
