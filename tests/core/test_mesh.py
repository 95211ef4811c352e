"""Meshes: files written by hand and read back, smooth normals one corner at a time, and what is refused."""

import json
import os
import pickle
import re
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from bad_input import NAN, SQUARE, Bench, cut, gets_one_clear_sentence
from mesh_file import write_mesh
from surface_shapes import sphere_mesh
from synthetic import degrees_between

from mpsnet_core import View, bake_normals, read_camera, read_normals
from mpsnet_core.arrays.polygon_triangulation import triangulated
from mpsnet_core.errors import InputError
from mpsnet_core.scene.mesh import Mesh, read_mesh, smooth_corner_normals

# Two squares side by side, the right one bent up; each has UVs of its own.
POINTS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 1], [2, 1, 1]]
UVS = [[0, 0], [0.4, 0], [0.4, 1], [0, 1], [0.5, 0], [0.9, 0], [0.9, 1], [0.5, 1]]
LEFT, RIGHT = [(0, 0), (1, 1), (2, 2), (3, 3)], [(1, 4), (4, 5), (5, 6), (2, 7)]
UP, SLANTED = [0.0, 0.0, 1.0], [-np.sqrt(0.5), 0.0, np.sqrt(0.5)]


def obj(path: Path, faces: str, *, normals: bool = True) -> Path:
    lines = ["# a comment", "mtllib none.mtl", *(f"v {x} {y} {z}" for x, y, z in POINTS)]
    lines += [f"vt {u} {v}" for u, v in UVS]
    lines += [f"vn {x} {y} {z}" for x, y, z in (UP, SLANTED)] if normals else []
    path.write_text("\n".join([*lines, faces]) + "\n", encoding="utf-8")
    return path


def corners_of(mesh: Mesh) -> list[list[list[float]]]:
    """For each triangle, its corners as position and UV, rounded."""
    return np.concatenate([mesh.vertices[mesh.triangles], mesh.uvs], axis=2).round(5).tolist()


def fan(*faces: list[tuple[int, int]]) -> list[list[list[float]]]:
    triangles = [(face[0], face[i], face[i + 1]) for face in faces for i in range(1, len(face) - 1)]
    return [[[*map(float, POINTS[v]), *UVS[t]] for v, t in triangle] for triangle in triangles]


def test_npz_gives_back_what_was_written(tmp_path: Path) -> None:
    pose = np.array([[0, -2, 0, 1], [1, 0, 0, 2], [0, 0, 3, 3], [0, 0, 0, 1.0]])
    mesh = sphere_mesh(layout="mirrored", world_from_object=pose)
    write_mesh(tmp_path / "mesh.npz", mesh)
    back = read_mesh(tmp_path / "mesh.npz")
    for name in ("vertices", "triangles", "corner_normals", "uvs", "tangents", "world_from_object"):
        assert (getattr(back, name) == getattr(mesh, name)).all(), name
    assert back.given_tangents is not None
    assert [path.name for path in tmp_path.iterdir()] == ["mesh.npz"]


@pytest.mark.parametrize(
    "faces",
    [
        "f 1/1/1 2/2/1 3/3/1 4/4/1\nf 2/5/2 5/6/2 6/7/2 3/8/2",
        "o left\nusemtl a\nf 1/1/1 2/2/1 3/3/1 4/4/1\no right\nusemtl b\ns 1\nf 2/5/2 5/6/2 6/7/2 3/8/2",
        "f -6/-8/-2 -5/-7/-2 -4/-6/-2 -3/-5/-2\nf -5/-4/-1 -2/-3/-1 -1/-2/-1 -4/-1/-1",
        "f 1/1/1 2/2/1 \\\n 3/3/1 4/4/1 # a comment\n\nf  2/5/2\t5/6/2 6/7/2 3/8/2 ",
    ],
    ids=["quads", "objects and materials", "counted from the end", "lines that go on"],
)
def test_obj_corner_by_corner(tmp_path: Path, faces: str) -> None:
    mesh = read_mesh(obj(tmp_path / "mesh.obj", faces))
    assert corners_of(mesh) == fan(LEFT, RIGHT)
    assert mesh.corner_normals[:2] == pytest.approx(np.broadcast_to(UP, (2, 3, 3)))
    assert mesh.corner_normals[2:] == pytest.approx(np.broadcast_to(SLANTED, (2, 3, 3)), abs=1e-6)


def test_obj_of_triangles_and_polygons_mixed(tmp_path: Path) -> None:
    faces = "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\nf 1/1 2/2 5/6 6/7 3/3 4/4"
    mesh = read_mesh(obj(tmp_path / "mesh.obj", faces, normals=False))
    hexagon = [(0, 0), (1, 1), (4, 5), (5, 6), (2, 2), (3, 3)]
    assert corners_of(mesh) == fan(LEFT, hexagon)


@pytest.mark.parametrize("first", range(8))
@pytest.mark.parametrize("behind", [False, True], ids=["from the front", "from behind"])
def test_a_notch_in_a_polygon_stays_open(tmp_path: Path, first: int, behind: bool) -> None:
    """A U in a slanted plane, whichever corner is its first: as much area as it has, and nothing over the notch."""
    u_shape = np.array([[0, 0], [5, 0], [5, 4], [3, 4], [3, 1], [2, 1], [2, 4], [0, 4]])
    around = np.roll(u_shape[::-1] if behind else u_shape, first, axis=0)
    lines = [f"v {x} {y} {x + 2 * y}\nvt {x / 5} {y / 5}" for x, y in around]
    (tmp_path / "u.obj").write_text("\n".join([*lines, "f " + " ".join(f"{n}/{n}" for n in range(1, 9))]))
    mesh = read_mesh(tmp_path / "u.obj")
    corners = mesh.vertices[mesh.triangles][..., :2] * ([-1, 1] if behind else 1)

    def doubled_areas(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
        return np.linalg.det(np.stack([b - a, c - a], axis=-1))

    areas = doubled_areas(*corners.swapaxes(0, 1)) / 2
    assert len(areas) == 6 and (areas > 0).all() and areas.sum() == pytest.approx(17)
    in_notch = np.broadcast_to([-2.5 if behind else 2.5, 2.5], (6, 2))
    sides = [doubled_areas(corners[:, n], corners[:, n - 2], in_notch) for n in range(3)]
    assert not (np.array(sides) >= 0).all(axis=0).any()


@pytest.mark.parametrize("shape", ["star", "comb", "spiral", "ring"])
def test_a_polygon_of_many_notches_is_covered_once(shape: str) -> None:
    """All triangles face one way and have together the area by the shoelace formula: none overlap, none is missing."""
    turn = np.linspace(0, 2 * np.pi, 1024, endpoint=False)
    circle = np.c_[np.cos(turn), np.sin(turn)]
    if shape == "star":
        around = circle * np.random.default_rng(0).uniform(1, 1.5, (1024, 1))
    elif shape == "comb":
        x = np.arange(512.0)
        around = np.r_[np.c_[x, np.zeros(512)], np.c_[x, np.where(x % 2, 5, 1)][::-1]]
    elif shape == "spiral":
        turned = np.c_[np.cos(3 * turn), np.sin(3 * turn)]
        around = np.r_[turned * (1 + 3 * turn)[:, None], (turned * (0.6 + 3 * turn)[:, None])[::-1]]
    else:  # a seam leads to its hole, whose corner and whose seam's are there twice
        hole = circle[::2]
        around = np.r_[2 * hole, 2 * hole[:1], hole[:1], hole[::-1]]
    places = np.c_[around, np.zeros(len(around))]
    corners = places[triangulated(places, np.array([len(around)]))]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    x, y = around.T
    assert len(areas) == len(around) - 2 and (areas > -1e-9).all()
    assert areas.sum() == pytest.approx((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def test_obj_names_are_read_as_they_stand(tmp_path: Path) -> None:
    """3ds Max numbers its materials with #, and older programs write no UTF-8."""
    faces = "o Säule\nusemtl Material #25\nf 1/1 2/2 3/3 4/4\no Öl\nusemtl  Material  #26 \nf 2/5 5/6 6/7 3/8"
    path = obj(tmp_path / "mesh.obj", faces, normals=False)
    for encoding in ("utf-8", "latin-1"):
        path.write_text(path.read_text(encoding="utf-8"), encoding=encoding)
        mesh = read_mesh(path)
        assert mesh.materials is not None and mesh.materials.names == ("Material #25", "Material  #26")
        assert mesh.objects is not None and mesh.objects.names == ("Säule", "Öl")
        assert mesh.objects.number.tolist() == mesh.materials.number.tolist() == [0, 0, 1, 1]


@pytest.mark.parametrize("before", ["\ufeff", "# out of C:\\scans\\\n"], ids=["byte order mark", "folder in a comment"])
def test_obj_of_windows_programs_keeps_its_first_vertex(tmp_path: Path, before: str) -> None:
    lines = [f"v {x} {y} {z}" for x, y, z in POINTS] + [f"vt {u} {v}" for u, v in UVS]
    text = before + "\n".join([*lines, "f 1/1 2/2 3/3 4/4", ""])
    (tmp_path / "mesh.obj").write_text(text, encoding="utf-8")
    assert corners_of(read_mesh(tmp_path / "mesh.obj")) == fan(LEFT)


def test_obj_without_normals_is_smooth_also_where_the_uvs_part(tmp_path: Path) -> None:
    quads = "f 1/1 2/2 3/3 4/4\nf 2/5 5/6 6/7 3/8"
    mesh = read_mesh(obj(tmp_path / "mesh.obj", quads, normals=False))
    at_fold = mesh.vertices[mesh.triangles][..., 0] == 1
    between = np.add(UP, SLANTED)
    assert degrees_between(mesh.corner_normals[at_fold], between).max() < 0.01
    assert degrees_between(mesh.corner_normals[:2][~at_fold[:2]], UP).max() < 0.01


def test_obj_corners_without_a_normal_get_the_smooth_one(tmp_path: Path) -> None:
    faces = "f 1/1/1 2/2/1 3/3/1 4/4/1\nf 2/5 5/6 6/7 3/8"
    mesh = read_mesh(obj(tmp_path / "mesh.obj", faces))
    assert mesh.corner_normals[:2] == pytest.approx(np.broadcast_to(UP, (2, 3, 3)))
    folded = mesh.vertices[mesh.triangles[2:]][..., 0] == 1
    assert degrees_between(mesh.corner_normals[2:][folded], np.add(UP, SLANTED)).max() < 0.01
    assert degrees_between(mesh.corner_normals[2:][~folded], SLANTED).max() < 0.01


@pytest.mark.parametrize(
    ("faces", "said"),
    [
        ("f 1/1 2/2 3/3\nf 2//1 5//1 6//1", "some of its faces have no UVs; unwrap it"),
        ("f 1 2 3", "its faces have no UVs; unwrap it"),
        ("f 1/1 2/2 7/3", "line 19 cannot be read .*f 1/1 2/2 7/3.*export it again"),
        ("f 1/1 2/2 0/3", "line 19 cannot be read"),
        ("f 1/1 2/2 -9/3", "line 19 cannot be read"),
        ("f 1/1 2/2 3/x", "line 19 cannot be read"),
        ("v 1 2\nf 1/1 2/2 3/3", "line 19 cannot be read"),
        ("f 1/1 2/2", "it has no faces"),
        ("v nan 0 0\nf 1/1 2/2 3/3", "not finite; repair the mesh"),
        ("v 1e200 0 0\nf 1/1 2/2 3/3", r"vertices hold a value beyond 1e\+12; repair the mesh"),
    ],
)
def test_obj_that_cannot_be_meant(tmp_path: Path, faces: str, said: str) -> None:
    with pytest.raises(InputError, match=rf"mesh\.obj: .*{said}"):
        read_mesh(obj(tmp_path / "mesh.obj", faces))


def test_ply_with_uvs_and_normals(tmp_path: Path) -> None:
    """As Blender writes it: a vertex for every place and UV, s and t for UVs."""
    corners = [(*POINTS[v], *normal, *UVS[t]) for face, normal in ((LEFT, UP), (RIGHT, SLANTED)) for v, t in face]
    names = ["x", "y", "z", "nx", "ny", "nz", "s", "t"]
    header = ["ply", "format ascii 1.0", "element vertex 8", *(f"property float {name}" for name in names)]
    header += ["element face 4", "property list uchar uint vertex_indices", "end_header"]
    faces = ["3 0 1 2", "3 0 2 3", "3 4 5 6", "3 4 6 7"]
    path = tmp_path / "mesh.ply"
    path.write_text("\n".join([*header, *(" ".join(map(str, row)) for row in corners), *faces]) + "\n")
    mesh = read_mesh(path)
    assert corners_of(mesh) == fan(LEFT, RIGHT)
    assert mesh.corner_normals[2:] == pytest.approx(np.broadcast_to(SLANTED, (2, 3, 3)), abs=1e-5)


# A quad, a triangle beside it and a pentagon with a notch, a UV for each vertex: its own x and y.
PLY_POINTS = [[0, 0], [1, 0], [1, 1], [0, 1], [1.5, 0.5], [2, 0], [4, 0], [4, 2], [3, 0.2], [2, 2]]
PLY_FACES = [[0, 1, 2, 3], [1, 4, 2], [7, 8, 9, 5, 6]]


def ply(path: Path, order: str, *, uvs: str = "vertices") -> Path:
    """These in text (order "") or in bytes of an order, their UVs with the "vertices" or with the "faces"."""
    of_faces = uvs == "faces"
    head = ["ply", f"format {PLY_ORDERS[order]} 1.0", "comment by hand", "element vertex 10"]
    head += [f"property {kind} {name}" for kind, name in zip(("float", "double", "float"), "xyz", strict=True)]
    head += [] if of_faces else ["property float s", "property float t"]
    head += ["element face 3", "property uchar flags", "property list uchar int vertex_indices"]
    head += ["property list uchar float texcoord"] if of_faces else []
    rows: list[tuple[str, list[float]]] = [
        ("fdf" + "ff" * (not of_faces), [x, y, 0, *([] if of_faces else [x, y])]) for x, y in PLY_POINTS
    ]
    for face in PLY_FACES:
        of_corners = [number for corner in face for number in PLY_POINTS[corner]] if of_faces else []
        numbers = [7, len(face), *face, *([len(of_corners)] if of_faces else []), *of_corners]
        rows.append(("BB" + "i" * len(face) + ("B" + "f" * len(of_corners)) * of_faces, numbers))
    if order:
        body = b"".join(struct.pack(order + kinds, *numbers) for kinds, numbers in rows)
    else:
        body = "".join(" ".join(map(str, numbers)) + "\n" for _, numbers in rows).encode()
    path.write_bytes("\n".join([*head, "end_header", ""]).encode() + body)
    return path


PLY_ORDERS = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}


@pytest.mark.parametrize("uvs", ["vertices", "faces"])
@pytest.mark.parametrize("order", PLY_ORDERS)
def test_ply_with_polygons_of_several_sizes(tmp_path: Path, order: str, uvs: str) -> None:
    mesh = read_mesh(ply(tmp_path / "mesh.ply", order, uvs=uvs))
    corners = mesh.vertices[mesh.triangles]
    assert mesh.polygons is not None and mesh.polygons.tolist() == [0, 0, 1, 2, 2, 2]
    assert mesh.uvs == pytest.approx(corners[..., :2])
    e1, e2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = np.cross(e1, e2)[:, 2] / 2
    assert areas.min() > 0 and np.bincount(mesh.polygons, areas) == pytest.approx([1, 0.25, 2.2])


def glb(path: Path, *, normals: bool, mirrored: bool = False, materials: bool = True) -> Path:
    """Both squares as meshes of their own, with two materials; the right one is moved by its node."""
    buffer, views, accessors, meshes = b"", [], [], []

    def accessor(values: np.ndarray, kind: str, component: int) -> int:
        nonlocal buffer
        views.append({"buffer": 0, "byteOffset": len(buffer), "byteLength": values.nbytes})
        bounds = {"min": values.min(0).tolist(), "max": values.max(0).tolist()} if kind == "VEC3" else {}
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": kind, **bounds}
        )
        buffer += values.tobytes()
        return len(accessors) - 1

    for material, (face, normal) in enumerate(((LEFT, UP), (RIGHT, SLANTED))):
        points = np.array([POINTS[v] for v, _ in face], np.float32)
        if material == 1:  # its node moves it back
            points = (points - [5, 0, 0]).astype(np.float32) * np.array([-1 if mirrored else 1, 1, 1], np.float32)
            normal = np.array(normal) * (-1 if mirrored else 1, 1, 1)
        order = [0, 2, 1, 0, 3, 2] if mirrored and material == 1 else [0, 1, 2, 0, 2, 3]
        uvs = np.array([[UVS[t][0], 1 - UVS[t][1]] for _, t in face], np.float32)  # glTF's v points down
        attributes: dict[str, Any] = {
            "POSITION": accessor(points, "VEC3", 5126),
            "TEXCOORD_0": accessor(uvs, "VEC2", 5126),
        }
        if normals:
            attributes["NORMAL"] = accessor(np.tile(np.array(normal, np.float32), (4, 1)), "VEC3", 5126)
        indices = accessor(np.array(order, np.uint32), "SCALAR", 5125)
        worn = {"material": material} if materials else {}
        meshes.append({"primitives": [{"attributes": attributes, "indices": indices, **worn}]})
    data = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"mesh": 1, "translation": [5, 0, 0], "scale": [-1 if mirrored else 1, 1, 1]}],
        "materials": [{"name": "a"}, {"name": "b", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}],
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(buffer)}],
    }
    text = json.dumps(data).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


@pytest.mark.parametrize("normals", [True, False])
def test_glb_with_several_meshes_and_materials(tmp_path: Path, normals: bool) -> None:
    mesh = read_mesh(glb(tmp_path / "mesh.glb", normals=normals))
    assert sorted(corners_of(mesh)) == sorted(fan(LEFT, RIGHT))
    is_left = mesh.uvs[..., 0].max(axis=1) < 0.45
    fold = mesh.vertices[mesh.triangles][..., 0] == 1
    expected = np.where(is_left[:, None, None], UP, SLANTED)
    if not normals:
        expected = np.where(fold[..., None], np.add(UP, SLANTED), expected)
    assert degrees_between(mesh.corner_normals, expected).max() < 0.01


def test_glb_without_a_material_has_its_uvs_all_the_same(tmp_path: Path) -> None:
    with_materials = read_mesh(glb(tmp_path / "with.glb", normals=True))
    mesh = read_mesh(glb(tmp_path / "without.glb", normals=True, materials=False))
    assert mesh.uvs.tolist() == with_materials.uvs.tolist()
    assert mesh.materials is None


def test_glb_with_a_mirroring_node_keeps_its_outside(tmp_path: Path) -> None:
    mesh = read_mesh(glb(tmp_path / "mesh.glb", normals=True, mirrored=True))
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    assert degrees_between(np.cross(b - a, c - a)[:, None], mesh.corner_normals).max() < 0.01
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_glb_with_a_stretching_node_has_the_tangents_of_its_mesh(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    turn, _ = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3] = np.column_stack([turn * np.sign(np.linalg.det(turn)) @ np.diag([1, 1.5, -2]), [3, 0, 1]])
    ball = sphere_mesh(world_from_object=pose)
    corners, material = np.arange(ball.triangles.size), trimesh.visual.material.PBRMaterial(name="m")
    part = trimesh.Trimesh(
        ball.vertices[ball.triangles].reshape(-1, 3),
        corners.reshape(-1, 3),
        vertex_normals=ball.corner_normals.reshape(-1, 3),
        visual=trimesh.visual.TextureVisuals(uv=ball.uvs.reshape(-1, 2), material=material),
        process=False,
    )
    scene = trimesh.Scene()
    scene.add_geometry(part, node_name="a", transform=pose)
    scene.export(tmp_path / "one.glb", include_normals=True)
    mesh = read_mesh(tmp_path / "one.glb")
    assert mesh.world_vertices[mesh.triangles] == pytest.approx(ball.world_vertices[ball.triangles], abs=1e-5)
    assert mesh.tangents == pytest.approx(ball.tangents, abs=1e-4)
    assert mesh.normals_to_world == pytest.approx(ball.normals_to_world, abs=1e-5)
    assert not caplog.records
    scene.add_geometry(part.copy(), node_name="b")
    scene.export(tmp_path / "two.glb", include_normals=True)
    read_mesh(tmp_path / "two.glb")
    assert re.search(r"two\.glb: .*stretched in several ways, .*apply their scale", caplog.text)


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_normals_of_no_length_count_as_none(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"mesh{suffix}"  # a wall that faces -y, and has no normals at its lower corners
    rows = ["0 0 0 0 0 0", "1 0 0 0 0 0", "1 0 1 0 -1 0", "0 0 1 0 -1 0"]
    if suffix == ".obj":
        lines = [f"v {row[:5]}\nvt {row[0]} {row[4]}\nvn {row[6:]}" for row in rows] + ["f 1/1/1 2/2/2 3/3/3 4/4/4"]
    else:
        lines = [
            "ply",
            "format ascii 1.0",
            "element vertex 4",
            *(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz", "s", "t")),
        ]
        lines += ["element face 1", "property list uchar int vertex_indices", "end_header"]
        lines += [f"{row} {row[0]} {row[4]}" for row in rows] + ["4 0 1 2 3"]
    path.write_text("\n".join(lines) + "\n")
    assert read_mesh(path).corner_normals == pytest.approx(np.broadcast_to([0, -1, 0], (2, 3, 3)))


def edited(path: Path, edit: Callable[[dict[str, Any], bytes], bytes]) -> Path:
    """A GLB file whose JSON part was edited, and its buffer replaced by what `edit` returns."""
    data = path.read_bytes()
    (length,) = struct.unpack("<I", data[12:16])
    header = json.loads(data[20 : 20 + length])
    buffer = edit(header, data[28 + length :])
    header["buffers"] = [{"byteLength": len(buffer)}]
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def skinned(posed: bool) -> Callable[[dict[str, Any], bytes], bytes]:
    """The right square as a skinned mesh. Its node stands anywhere; two joints, turned and moved, put it in its place.

    posed: turn the second joint afterwards.
    """
    turned = np.array([[0, -1, 0, 3], [1, 0, 0, 4], [0, 0, 1, -2], [0, 0, 0, 1]], float)  # 90 degrees about z
    root, at = np.diag([2.0, 2, 2, 1]), np.eye(4)
    at[0, 3] = 5
    joints = root @ turned, root @ turned @ turned

    def edit(header: dict[str, Any], buffer: bytes) -> bytes:
        half = np.sqrt(0.5)
        joint = {"translation": [3, 4, -2], "rotation": [0, 0, half, half]}
        second = {"matrix": turned.T.ravel().tolist()}
        if posed:
            second = {"translation": [3, 4, -2]}
        header["nodes"] = [
            {"mesh": 0},
            {"name": "arm", "mesh": 1, "skin": 0, "translation": [70, 8, 9], "scale": [3, 1, 1]},
            {"scale": [2, 2, 2], "children": [3, 1]},
            {**joint, "children": [4]},
            second,
        ]
        header["scenes"] = [{"nodes": [0, 2]}]
        header["skins"] = [{"joints": [3, 4], "inverseBindMatrices": len(header["accessors"])}]
        inverse = np.array([(np.linalg.inv(one) @ at).T for one in joints], "<f4").tobytes()
        header["accessors"].append(
            {"bufferView": len(header["bufferViews"]), "componentType": 5126, "count": 2, "type": "MAT4"}
        )
        header["bufferViews"].append({"buffer": 0, "byteOffset": len(buffer), "byteLength": len(inverse)})
        return buffer + inverse

    return edit


def test_glb_with_a_skinned_mesh_stands_where_its_joints_put_it(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    plain = read_mesh(glb(tmp_path / "plain.glb", normals=True))
    mesh = read_mesh(edited(glb(tmp_path / "skinned.glb", normals=True), skinned(posed=False)))
    assert mesh.world_vertices[mesh.triangles] == pytest.approx(plain.world_vertices[plain.triangles], abs=1e-5)
    assert mesh.corner_normals == pytest.approx(plain.corner_normals, abs=1e-5)
    assert mesh.objects is not None and "arm" in mesh.objects.names
    assert not caplog.records
    read_mesh(edited(glb(tmp_path / "posed.glb", normals=True), skinned(posed=True)))
    [sentence] = caplog.messages
    assert "posed.glb: the skeleton of object 'arm' is posed, which is not applied" in sentence


def test_glb_that_names_a_skeleton_many_times_follows_it_once(tmp_path: Path) -> None:
    """Each time, it would take hours."""

    def edit(header: dict[str, Any], buffer: bytes) -> bytes:
        buffer = skinned(posed=False)(header, buffer)
        header["nodes"][2]["children"] += range(5, 10_000)
        header["nodes"] += [{} for _ in range(5, 10_000)]
        header["scenes"][0]["nodes"] += [2] * 100_000
        return buffer

    assert len(read_mesh(edited(glb(tmp_path / "mesh.glb", normals=True), edit)).triangles) == 4


def test_glb_with_lines_beside_its_mesh(tmp_path: Path) -> None:
    path = glb(tmp_path / "mesh.glb", normals=True)
    assert path.read_bytes().count(b'"material": 1}') == 1
    path.write_bytes(path.read_bytes().replace(b'"material": 1}', b'"mode":3     }'))
    assert sorted(corners_of(read_mesh(path))) == sorted(fan(LEFT))


def change_header(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """Change the JSON part of a GLB file."""
    data = path.read_bytes()
    end = 20 + struct.unpack("<I", data[12:16])[0]
    header = json.loads(data[20:end])
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + data[end:]
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


@pytest.mark.parametrize(("texture", "warned"), [({"index": 0}, False), ({"index": 0, "texCoord": 1}, True)])
def test_glb_whose_normal_map_is_on_other_uvs_gets_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, texture: dict[str, int], warned: bool
) -> None:
    path = glb(tmp_path / "mesh.glb", normals=True)
    change_header(path, lambda header: header["materials"][0].update(normalTexture=texture))
    read_mesh(path)
    assert ("the normal map of material" in caplog.text) == warned


def test_glb_with_a_fan_of_triangles_is_refused(tmp_path: Path) -> None:
    path = glb(tmp_path / "mesh.glb", normals=True)
    path.write_bytes(path.read_bytes().replace(b'"material": 1}', b'"mode":6     }'))
    with pytest.raises(InputError, match=r"triangle fans, .*export it with plain triangles"):
        read_mesh(path)


def test_pictures_in_a_glb_are_not_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Pillow, by which trimesh decodes them, starts Ghostscript for some."""
    pictures = pytest.importorskip("PIL.Image")
    opened = []
    monkeypatch.setattr(pictures, "open", opened.append)
    path = glb(tmp_path / "mesh.glb", normals=True)

    def dress(header: dict[str, Any]) -> None:
        header["images"] = [{"mimeType": "image/png", "bufferView": 0}]
        header["textures"] = [{"source": 0}]
        header["materials"][0]["pbrMetallicRoughness"] = {"baseColorTexture": {"index": 0}}

    before = read_mesh(path)
    change_header(path, dress)
    found = read_mesh(path)
    assert corners_of(found) == corners_of(before) and not opened
    assert found.materials.names == before.materials.names


def test_glb_with_a_number_that_is_none_is_refused(tmp_path: Path) -> None:
    path = glb(tmp_path / "mesh.glb", normals=True)
    change_header(path, lambda header: header["bufferViews"].append({"buffer": 0, "byteLength": float("nan")}))
    with pytest.raises(InputError, match="holds NaN in place of a number"):
        read_mesh(path)


def test_glb_with_gpu_instances_is_refused(tmp_path: Path) -> None:
    path = glb(tmp_path / "mesh.glb", normals=True)
    instances = {"EXT_mesh_gpu_instancing": {"attributes": {}}}
    change_header(path, lambda header: header["nodes"][1].update(extensions=instances))
    with pytest.raises(InputError, match=r"GPU instances, .*export it without them"):
        read_mesh(path)


def test_faces_that_turn_their_back_to_the_normals_are_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    read_mesh(obj(tmp_path / "a.obj", "f 1/1/1 2/2/1 3/3/1 4/4/1"))
    assert not caplog.records
    path = obj(tmp_path / "b.obj", "f 1/1/1 4/4/1 3/3/1 2/2/1")
    read_mesh(path, shape_only=True)
    assert not caplog.records
    read_mesh(path)
    assert re.search(
        r"b\.obj: most of its faces point the opposite way .*flip the faces, and export it again", caplog.text
    )


def test_smooth_normals_are_the_same_in_any_unit() -> None:
    sphere = sphere_mesh(12, 6)
    points = sphere.vertices * np.random.default_rng(1).uniform(0.6, 1.4, (len(sphere.vertices), 1))
    metres, tiny = (smooth_corner_normals(unit * points, sphere.triangles) for unit in (1, 1e-9))
    assert tiny == pytest.approx(metres)


def test_smooth_normals_one_corner_at_a_time() -> None:
    sphere = sphere_mesh(12, 6)
    points = sphere.vertices * np.random.default_rng(1).uniform(0.6, 1.4, (len(sphere.vertices), 1))
    triangles = sphere.triangles
    expected = np.zeros_like(points)
    for triangle in triangles:
        for corner in range(3):
            here, ahead, behind = (points[triangle[(corner + step) % 3]] for step in range(3))
            face = np.cross(ahead - here, behind - here)
            angle = np.radians(degrees_between(ahead - here, behind - here))
            expected[triangle[corner]] += angle * face / np.linalg.norm(face)
    found = smooth_corner_normals(points, triangles)
    assert degrees_between(found, expected[triangles]).max() < 1e-4
    assert np.linalg.norm(found, axis=-1) == pytest.approx(1)


def test_vertices_of_no_face_count_for_nothing(tmp_path: Path) -> None:
    path = obj(tmp_path / "mesh.obj", "f 1/1 2/2 3/3 4/4\nf 2/5 5/6 6/7 3/8", normals=False)
    path.write_text("v 9e6 0 0\n" + re.sub(r"(?<= )(\d)(?=/)", lambda one: str(int(one[1]) + 1), path.read_text()))
    mesh = read_mesh(path)
    assert corners_of(mesh) == fan(LEFT, RIGHT)
    assert mesh.vertices.tolist() == POINTS


def test_world_vertices_stand_where_the_pose_says() -> None:
    pose = np.array([[0, -2, 0, 1], [1, 0, 0, 2], [0, 0, 3, 3], [0, 0, 0, 1.0]])
    mesh = sphere_mesh(world_from_object=pose)
    x, y, z = mesh.vertices.T
    assert mesh.world_vertices == pytest.approx(np.stack([1 - 2 * y, 2 + x, 3 + 3 * z], axis=1))


def pickled(b: Bench) -> Path:
    """An npz that would run code if it were unpickled."""

    class Danger:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(b / "unpickled"),)

    np.savez(b / "mesh.npz", format=np.array("mpsnet-mesh"), vertices=np.array([Danger()], dtype=object))
    return b / "mesh.npz"


POINT: dict[str, Any] = {"bufferView": 0, "componentType": 5126, "count": 1, "type": "VEC3"}


def glb_of(b: Bench, **said: Any) -> Path:
    """A GLB of one point that lies in a buffer, as far as not said otherwise."""
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    good = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "meshes": [mesh]}
    good |= {"accessors": [POINT], "bufferViews": [{"buffer": 0, "byteLength": 12}], "buffers": [{"byteLength": 12}]}
    text = json.dumps(good | said).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", 12, b"BIN\0") + bytes(12)
    return b.bytes("mesh.glb", struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def glb_beside_a_pipe(b: Bench) -> Path:
    if hasattr(os, "mkfifo"):
        os.mkfifo(b / "pipe")
    return glb_of(b, buffers=[{"uri": "pipe", "byteLength": 12}])


def bomb(b: Bench) -> Path:
    """An .npz of a few kilobytes for each megabyte of zeros."""
    np.savez_compressed(b / "mesh.npz", vertices=np.zeros((3 << 22, 3)))
    return b / "mesh.npz"


def texts_without_letters(b: Bench) -> Path:
    """An .npz of half a billion texts that take no room."""
    with zipfile.ZipFile(b.mesh(uvs=None), "a") as archive, archive.open("materials.npy", "w") as file:
        head = {"descr": "<U0", "fortran_order": False, "shape": (500_000_000,)}
        np.lib.format.write_array_header_1_0(file, head)
    return b / "mesh.npz"


def short_glb(b: Bench) -> Path:
    """A GLB whose first buffer view is said to be longer than the file."""
    box = trimesh.Scene([trimesh.creation.box()]).export(file_type="glb")
    return b.bytes("mesh.glb", box.replace(b'"byteLength":144', b'"byteLength":999'))


def locked(b: Bench) -> Path:
    """A zip whose directory says that all of it is encrypted."""
    data = bytearray(b.mesh().read_bytes())
    for sign, flag in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        for found in re.finditer(re.escape(sign), bytes(data)):
            data[found.start() + flag] |= 1
    return b.bytes("mesh.npz", bytes(data))


def half_a_head(b: Bench) -> Path:
    """A zip with an array whose head, in Python's own words, ends too early."""
    with zipfile.ZipFile(b.mesh(uvs=None), "a") as archive:
        archive.writestr("uvs.npy", b"\x93NUMPY\x01\x00\x10\x00{'descr': '<f4'\n")
    return b / "mesh.npz"


def broken_array(b: Bench) -> Path:
    """A zip whose UVs are not an array at all."""
    with zipfile.ZipFile(b.mesh(uvs=None), "a") as archive:
        archive.writestr("uvs.npy", b"\x93NUMPY\x01\x00garbage")
    return b / "mesh.npz"


PLY_HEAD = """ply
format ascii 1.0
element vertex 1
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
3 0 0 0
"""


test_a_bad_mesh_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        (
            "a corner before the first",
            lambda b: read_mesh(b.text("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf -4/-1 1/1 2/1")),
            "m.obj: line 5 cannot be read ('f -4/-1 1/1 2/1')",
        ),
        (
            "a face of a hundred thousand corners",
            lambda b: read_mesh(b.text("m.obj", "v 0 0 0\nvt 0 0\nf" + " 1/1" * 100_000)),
            "m.obj: line 3 is a face of 100000 corners, more than 4096; triangulate it",
        ),
        (
            "a GLB whose faces name vertices that it lacks",
            lambda b: read_mesh(b.replaced(glb(b / "m.glb", normals=True), b"\2\0\0\0\3\0\0\0", b"\2\0\0\0\3\0\0\1")),
            "m.glb: the mesh's triangles name vertices that it does not have; export it again",
        ),
        ("an archive", lambda b: read_mesh(b.mesh().rename(b / "m.zip")), "m.zip: .zip is not a supported mesh format"),
        (
            "a packed mesh",
            lambda b: read_mesh(b.bytes("m.obj.bz2", b"BZh")),
            ".bz2 is not a supported mesh format; use OBJ",
        ),
        (
            "npz with a password",
            lambda b: read_mesh(locked(b)),
            "mesh.npz: it cannot be read (…encrypted…); export it again",
        ),
        ("npz of complex numbers", lambda b: read_mesh(b.mesh(uvs=1j * SQUARE["uvs"])), 'mesh.npz: its "uvs" holds'),
        (
            "npz whose array has half a head",
            lambda b: read_mesh(half_a_head(b)),
            "mesh.npz: it cannot be read…export it",
        ),
        ("a PLY cut short", lambda b: read_mesh(cut(ply(b / "m.ply", "<"))), "m.ply: it cannot be read as PLY"),
        (
            "a PLY whose faces name vertices that it lacks",
            lambda b: read_mesh(b.replaced(ply(b / "m.ply", ""), b"7 3 1 4 2", b"7 3 1 4 10")),
            "m.ply: the mesh's triangles name vertices that it does not have; export it again",
        ),
        *(
            (
                f"a PLY with {word} for a number",
                lambda b, old=old, new=new: read_mesh(b.replaced(ply(b / "m.ply", ""), old, new)),
                f"m.ply: {said}",
            )
            for word, old, new, said in (
                ("inf", b"7 3 1 4 2", b"7 inf 1 4 2", "it cannot be read as PLY (cannot convert float infinity"),
                ("nan", b"7 3 1 4 2", b"7 3 1 nan 2", "the mesh's triangles name vertices that it does not have"),
                ("1e30", b"7 3 1 4 2", b"7 3 1 1e30 2", "the mesh's triangles name vertices that it does not have"),
                ("a word", b"7 3 1 4 2", b"7 3 1 x 2", "it cannot be read as PLY (could not convert string to float"),
            )
        ),
        (
            "a PLY whose face has fewer than no corners",
            lambda b: read_mesh(b.replaced(ply(b / "m.ply", ""), b"7 3 1 4 2", b"7 -3 1 4 2")),
            "m.ply: it cannot be read as PLY (a list of -3); export it again",
        ),
        (
            "PLY with a misspelled property",
            lambda b: read_mesh(b.text("m.ply", PLY_HEAD.replace("property list", "qroperty list"))),
            "m.ply: it cannot be read…export it again",
        ),
        ("missing", lambda b: read_mesh(b / "mesh.obj"), "mesh.obj does not exist"),
        (
            "not a mesh",
            lambda b: read_mesh(b.photo("mesh.png", kind="uint8")),
            "mesh.png…not a supported mesh format…use OBJ, PLY, GLB or npz",
        ),
        ("an OBJ of words", lambda b: read_mesh(b.text("mesh.obj", "hello\n")), "mesh.obj: it has no faces"),
        (
            "texts without letters",
            lambda b: read_mesh(texts_without_letters(b)),
            '"materials" holds neither numbers nor',
        ),
        ("a GLB with less than it says", lambda b: read_mesh(short_glb(b)), "mesh.glb…cannot be read…export it again"),
        *(
            (
                f"a GLB of {words} ({number})",
                lambda b, said=said: read_mesh(glb_of(b, **said)),
                f"mesh.glb: it is compressed ({words}); export it without compression",
            )
            for number, (words, said) in enumerate(
                (
                    ("KHR_draco_mesh_compression", {"extensionsRequired": ["KHR_draco_mesh_compression"]}),
                    ("sparse accessors", {"accessors": [POINT | {"sparse": {"count": 1}}]}),
                    (
                        "whole numbers for UVs or vertices",
                        {"accessors": [POINT | {"componentType": 5122, "normalized": True}]},
                    ),
                    (
                        "whole numbers for UVs or vertices",
                        {
                            "accessors": [POINT | {"componentType": 5123, "type": "VEC2", "normalized": True}],
                            "meshes": [{"primitives": [{"attributes": {"TEXCOORD_0": 0}}]}],
                        },
                    ),
                )
            )
        ),
        (
            "a GLB of more numbers than it holds",
            lambda b: read_mesh(glb_of(b, accessors=[{"componentType": 5126, "count": 10**9, "type": "VEC3"}])),
            "mesh.glb: it unpacks to…MiB, more than the limit of 64; reduce it first",
        ),
        *(
            (
                f"a GLB of {words}",
                lambda b, nodes=nodes: read_mesh(glb_of(b, nodes=nodes)),
                "mesh.glb: it has too many objects, or nests them too deeply; join them first",
            )
            for words, nodes in (
                ("100,000 nodes", [{"mesh": 0}] * 100_000),
                (
                    "nodes in one another",
                    [{"mesh": 0, "children": [inner]} for inner in range(1, 1000)] + [{"mesh": 0}],
                ),
                ("a node in itself", [{"mesh": 0, "children": [0]}]),
            )
        ),
        (
            "a GLB whose numbers are in another file",
            lambda b: read_mesh(glb_beside_a_pipe(b)),
            "mesh.glb: it refers to the file 'pipe', which is not read",
        ),
        (
            "an .npz that unpacks to far more",
            lambda b: read_mesh(bomb(b)),
            "mesh.npz: it unpacks to 288 MiB, more than the limit of 8",
        ),
        ("a broken GLB", lambda b: read_mesh(b.bytes("mesh.glb", b"glTF\x02\x00\x00\x00")), "mesh.glb…export it again"),
        ("npz cut short", lambda b: read_mesh(cut(b.mesh())), "mesh.npz…cannot be read…export it again"),
        ("npz with a broken array", lambda b: read_mesh(broken_array(b)), "mesh.npz…cannot be read…export it again"),
        ("npz with pickles", lambda b: read_mesh(pickled(b)), "mesh.npz…cannot be read…pickle…export it again"),
        (
            "npz that is a pickle",
            lambda b: read_mesh(b.bytes("mesh.npz", pickle.dumps({"a": 1}))),
            "mesh.npz…cannot be read",
        ),
        ("npz of something else", lambda b: read_mesh(b.mesh(format=None)), "mesh.npz…not a mpsnet-mesh file"),
        (
            "npz of a newer version",
            lambda b: read_mesh(b.mesh(version=np.array(2))),
            "mesh.npz…version 2, this program reads version 1; update it",
        ),
        ("npz with two versions", lambda b: read_mesh(b.mesh(version=np.array([1, 2]))), "mesh.npz…version [1 2]"),
        ("npz without UVs", lambda b: read_mesh(b.mesh(uvs=None)), 'mesh.npz…lacks "uvs"; export it again'),
        ("npz of words", lambda b: read_mesh(b.mesh(uvs=np.full((2, 3, 2), "u"))), "mesh.npz…uvs…export it again"),
        (
            "npz with a single number",
            lambda b: read_mesh(b.mesh(vertices=np.array(1.0))),
            "mesh.npz…vertices…export it again",
        ),
        (
            "UVs of another shape",
            lambda b: read_mesh(b.mesh(uvs=np.zeros((4, 2)))),
            "mesh.npz…uvs have shape (4, 2), expected (2, 3, 2)",
        ),
        (
            "bad indices",
            lambda b: read_mesh(b.mesh(triangles=np.array([[0, 1, 2], [0, 2, 9]]))),
            "mesh.npz…triangles name vertices that it does not have",
        ),
        (
            "negative indices",
            lambda b: read_mesh(b.mesh(triangles=np.array([[0, 1, 2], [0, 2, -1]]))),
            "mesh.npz…triangles name vertices",
        ),
        (
            "vertices not finite",
            lambda b: Mesh(**{**SQUARE, "vertices": SQUARE["vertices"] * NAN}),
            "vertices hold a value that is not finite",
        ),
        (
            "UVs outside",
            lambda b: bake_normals(
                Mesh(**{**SQUARE, "uvs": SQUARE["uvs"] + 1}), [View(read_camera(b.camera()), read_normals(b.normals()))]
            ),
            "UVs lie outside the texture (0 to 1); move",
        ),
        (
            "no triangles",
            lambda b: Mesh(**{key: SQUARE[key][:0] if key != "vertices" else SQUARE[key] for key in SQUARE}),
            "no faces",
        ),
        (
            "scale 0",
            lambda b: Mesh(**SQUARE, world_from_object=np.diag([1, 1, 0, 1])),
            "scaled to nothing…give it a scale above 0",
        ),
    ]
)
