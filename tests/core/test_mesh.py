"""Meshes: files written by hand and read back, smooth normals one corner at a time, and what is refused."""

import json
import os
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

from mpsnet_core import InputError, View, bake_normals, read_camera, read_normals
from mpsnet_core.arrays.polygon_triangulation import triangulated
from mpsnet_core.errors import Note
from mpsnet_core.scene.mesh import Mesh, Up, read_mesh, shared_normals

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


@pytest.mark.parametrize("behind", [False, True], ids=["from the front", "from behind"])
@pytest.mark.parametrize("shape", ["star", "comb", "spiral", "ring"])
def test_a_slanted_polygon_of_many_notches_is_covered_once(shape: str, behind: bool) -> None:
    """All triangles face one way and have together the area by the shoelace formula: none overlap, none is missing."""
    turn = np.linspace(0, 2 * np.pi, 512, endpoint=False)
    circle = np.c_[np.cos(turn), np.sin(turn)]
    if shape == "star":
        around = circle * np.random.default_rng(0).uniform(1, 1.5, (512, 1))
    elif shape == "comb":
        x = np.arange(256.0)
        around = np.r_[np.c_[x, np.zeros(256)], np.c_[x, np.where(x % 2, 5, 1)][::-1]]
    elif shape == "spiral":
        turned = np.c_[np.cos(3 * turn), np.sin(3 * turn)]
        around = np.r_[turned * (1 + 3 * turn)[:, None], (turned * (0.6 + 3 * turn)[:, None])[::-1]]
    else:  # a seam leads to its hole, whose corner and whose seam's are there twice
        hole = circle[::2]
        around = np.r_[2 * hole, 2 * hole[:1], hole[:1], hole[::-1]]
    around = around[::-1] if behind else around
    places = np.c_[around, around @ [1, 2]]
    corners = places[triangulated(places, np.array([len(around)]))]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    x, y = around.T
    assert len(areas) == len(around) - 2 and (areas * (-1 if behind else 1) > -1e-9).all()
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


QUADS = "f 1/1 2/2 3/3 4/4", "f 2/5 5/6 6/7 3/8"


def assert_flat(mesh: Mesh) -> None:
    """Each of the two squares has the normals of its plane."""
    is_left = mesh.vertices[mesh.triangles][..., 0].max(axis=1) <= 1
    expected = np.where(is_left[:, None, None], UP, SLANTED)
    assert degrees_between(mesh.corner_normals, expected).max() < 0.01


@pytest.mark.parametrize(
    ("faces", "said"),
    [
        ("f 1/1 2/2 3/3\nf 2//1 5//1 6//1", "some of its faces have no UVs; unwrap it"),
        ("f 1 2 3", "it has no UVs; unwrap it"),
        ("f 1/1 2/2 7/3", "line 19 cannot be read .*f 1/1 2/2 7/3.*export it again"),
        ("f 1/1 2/2 0/3", "line 19 cannot be read"),
        ("f 1/1 2/2 -9/3", "line 19 cannot be read"),
        ("f 1/1 2/2 3/x", "line 19 cannot be read"),
        ("v 1 2\nf 1/1 2/2 3/3", "line 19 cannot be read"),
        ("v 1e200 0 0\nf 1/1 2/2 3/3", r"vertices hold a value beyond 1e\+12; repair the mesh"),
    ],
)
def test_obj_that_cannot_be_meant(tmp_path: Path, faces: str, said: str) -> None:
    with pytest.raises(InputError, match=rf"mesh\.obj: .*{said}"):
        read_mesh(obj(tmp_path / "mesh.obj", faces))


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


def write_glb(path: Path, header: dict[str, Any], buffer: bytes) -> Path:
    """A GLB file of its two chunks; the header is told the buffer's length where it does not say another."""
    text = json.dumps({"buffers": [{"byteLength": len(buffer)}], **header}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def glb(path: Path, *, normals: bool) -> Path:
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
            points = (points - [5, 0, 0]).astype(np.float32)
        uvs = np.array([[UVS[t][0], 1 - UVS[t][1]] for _, t in face], np.float32)  # glTF's v points down
        attributes: dict[str, Any] = {
            "POSITION": accessor(points, "VEC3", 5126),
            "TEXCOORD_0": accessor(uvs, "VEC2", 5126),
        }
        if normals:
            attributes["NORMAL"] = accessor(np.tile(np.array(normal, np.float32), (4, 1)), "VEC3", 5126)
        indices = accessor(np.array([0, 1, 2, 0, 2, 3], np.uint32), "SCALAR", 5125)
        meshes.append({"primitives": [{"attributes": attributes, "indices": indices, "material": material}]})
    data = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"mesh": 1, "translation": [5, 0, 0]}],
        "materials": [{"name": "a"}, {"name": "b", "pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}}],
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": views,
    }
    return write_glb(path, data, buffer)


@pytest.mark.parametrize("normals", [True, False])
def test_glb_with_several_meshes_and_materials(tmp_path: Path, normals: bool) -> None:
    mesh = read_mesh(glb(tmp_path / "mesh.glb", normals=normals))
    assert sorted(corners_of(mesh)) == sorted(fan(LEFT, RIGHT))
    assert mesh.materials is not None and mesh.materials.names == ("a", "b")
    assert_flat(mesh)


def test_glb_with_a_stretching_node_has_its_mesh_s_tangents(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
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


def test_normals_of_no_length_count_as_none(tmp_path: Path) -> None:
    path = tmp_path / "mesh.ply"  # a wall that faces -y, and has no normals at its lower corners
    rows = ["0 0 0 0 0 0", "1 0 0 0 0 0", "1 0 1 0 -1 0", "0 0 1 0 -1 0"]
    lines = ["ply", "format ascii 1.0", "element vertex 4"]
    lines += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz", "s", "t")]
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
    header.pop("buffers")
    return write_glb(path, header, buffer)


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


def test_glb_with_a_skinned_mesh_stands_where_joints_put_it(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
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

    def edit(header: dict[str, Any], buffer: bytes) -> bytes:
        change(header)
        return buffer

    edited(path, edit)


def placed(**how: object) -> dict[str, Any]:
    return {"index": 0, "extensions": {"KHR_texture_transform": how}}


@pytest.mark.parametrize(
    ("texture", "warned"),
    [
        ({"index": 0}, False),
        ({"index": 0, "texCoord": 1}, True),
        (placed(offset=[0, 0], rotation=0.0, scale=[1.0, 1.0]), False),
        (placed(scale=[2, 2]), True),
        (placed(texCoord=1), True),
    ],
)
def test_glb_whose_normal_map_is_on_other_uvs_gets_a_warning(tmp_path, caplog, texture: dict[str, Any], warned: bool):
    path = glb(tmp_path / "mesh.glb", normals=True)
    change_header(path, lambda header: header["materials"][0].update(normalTexture=texture))
    read_mesh(path)
    assert ("uses other UVs than the first" in caplog.text) == warned
    # Translators have its sentence without the mesh and the material in it.
    for record in caplog.records:
        assert str(path) not in str(record.msg) and [type(one) for one in record.args or ()][1:] == [Note]


def test_glb_with_a_number_that_is_none_is_refused(tmp_path: Path) -> None:
    path = glb(tmp_path / "mesh.glb", normals=True)
    change_header(path, lambda header: header["bufferViews"].append({"buffer": 0, "byteLength": float("nan")}))
    with pytest.raises(InputError, match="holds NaN in place of a number"):
        read_mesh(path)


def add(header: dict[str, Any], buffer: bytes, values: Any, kind: str, **said: Any) -> tuple[int, bytes]:
    """The number of a new accessor, and the buffer with its values."""
    array, types = np.asarray(values), {"int8": 5120, "uint16": 5123, "uint32": 5125, "float32": 5126}
    start = len(buffer) + -len(buffer) % 4
    header["bufferViews"].append({"buffer": 0, "byteOffset": start, "byteLength": array.nbytes})
    accessor = {"componentType": types[array.dtype.name], "count": len(array), "type": kind, **said}
    header["accessors"].append({"bufferView": len(header["bufferViews"]) - 1, **accessor})
    return len(header["accessors"]) - 1, buffer.ljust(start, b"\0") + array.tobytes()


def in_floats(header: dict[str, Any], buffer: bytes, number: int, width: int) -> np.ndarray:
    accessor = header["accessors"][number]
    start = header["bufferViews"][accessor["bufferView"]]["byteOffset"]
    return np.frombuffer(buffer, "<f4", width * accessor["count"], start).reshape(-1, width)


def primitives(header: dict[str, Any]) -> list[dict[str, Any]]:
    return [mesh["primitives"][0] for mesh in header["meshes"]]


def as_strips(header: dict[str, Any], buffer: bytes) -> bytes:
    number, buffer = add(header, buffer, np.array([1, 2, 0, 3], np.uint32), "SCALAR")
    for one in primitives(header):
        one.update(mode=5, indices=number)
    return buffer


def as_fans(header: dict[str, Any], buffer: bytes) -> bytes:
    for one in primitives(header):
        one["mode"] = 6
        del one["indices"]
    return buffer


def without_indices(header: dict[str, Any], buffer: bytes) -> bytes:
    for one in primitives(header):
        del one["indices"]
        for name, number in one["attributes"].items():
            kind = header["accessors"][number]["type"]
            values = in_floats(header, buffer, number, int(kind[3]))[[0, 1, 2, 0, 2, 3]]
            one["attributes"][name], buffer = add(header, buffer, values, kind)
    return buffer


def quantised(header: dict[str, Any], buffer: bytes) -> bytes:
    header["extensionsRequired"] = ["KHR_mesh_quantization"]
    for one in primitives(header):
        attributes = one["attributes"]
        points = in_floats(header, buffer, attributes["POSITION"], 3)
        attributes["POSITION"], buffer = add(header, buffer, points.astype(np.int8), "VEC3")
        uvs = np.rint(65535 * in_floats(header, buffer, attributes["TEXCOORD_0"], 2)).astype(np.uint16)
        attributes["TEXCOORD_0"], buffer = add(header, buffer, uvs, "VEC2", normalized=True)
    return buffer


def sparse(header: dict[str, Any], buffer: bytes) -> bytes:
    for one in primitives(header):
        points = in_floats(header, buffer, one["attributes"]["POSITION"], 3)
        which, buffer = add(header, buffer, np.array([0, 1, 3], np.uint16), "SCALAR")
        values, buffer = add(header, buffer, points[[0, 1, 3]], "VEC3")
        base = np.concatenate([np.full((2, 3), 9, np.float32), points[2:3], np.full((1, 3), 9, np.float32)])
        number, buffer = add(header, buffer, base, "VEC3")
        views = [header["accessors"][which], header["accessors"][values]]
        header["accessors"][number]["sparse"] = {"count": 3, "indices": views[0], "values": views[1]}
        one["attributes"]["POSITION"] = number
    return buffer


def morphed(of_nodes: bool) -> Callable[[dict[str, Any], bytes], bytes]:
    """Positions halved, and a morph target that moves them back. of_nodes: the weights of nodes replace the meshes'."""

    def edit(header: dict[str, Any], buffer: bytes) -> bytes:
        for mesh, node in zip(header["meshes"], header["nodes"], strict=True):
            (one,) = mesh["primitives"]
            half = in_floats(header, buffer, one["attributes"]["POSITION"], 3) / np.float32(2)
            one["attributes"]["POSITION"], buffer = add(header, buffer, half, "VEC3")
            target, buffer = add(header, buffer, half, "VEC3")
            one["targets"] = [{"NORMAL": one["attributes"]["NORMAL"]}, {"POSITION": target}]
            mesh["weights"] = [0, 3 if of_nodes else 1]
            if of_nodes:
                node["weights"] = [0, 1]
        return buffer

    return edit


def instanced(header: dict[str, Any], buffer: bytes) -> bytes:
    """The right square's node moves it up and is mirrored; its instance moves it back."""
    header["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    moves, buffer = add(header, buffer, np.array([[-5, 0, -1]], np.float32), "VEC3")
    sizes, buffer = add(header, buffer, np.array([[-1, 1, 1]], np.float32), "VEC3")
    instances = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": moves, "SCALE": sizes}}}
    header["nodes"][1].update(translation=[0, 0, 1], scale=[-1, 1, 1], extensions=instances)
    return buffer


def hidden_twins(header: dict[str, Any], buffer: bytes) -> bytes:
    """Both squares again, elsewhere, hidden themselves or below a hidden node."""
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    nodes = header["nodes"]
    count = len(nodes)
    nodes += [{"mesh": 0, "translation": [9, 0, 0], **hidden}, {**hidden, "children": [count + 2]}, {"mesh": 1}]
    header["scenes"][0]["nodes"] += [count, count + 1]
    return buffer


def turning(corners: list[list[list[float]]]) -> list[list[list[float]]]:
    """Triangles, each from its first corner on in order."""
    return sorted(min(triangle[n:] + triangle[:n] for n in range(3)) for triangle in corners)


@pytest.mark.parametrize(
    "edit",
    [as_strips, as_fans, without_indices, quantised, sparse, morphed(False), morphed(True), instanced, hidden_twins],
    ids=["strips", "fans", "no indices", "quantised", "sparse", "morphed", "morphed by nodes", "instanced", "hidden"],
)
def test_glb_is_the_same_in_other_words(tmp_path, edit: Callable[[dict[str, Any], bytes], bytes], caplog) -> None:
    mesh = read_mesh(edited(glb(tmp_path / "mesh.glb", normals=True), edit))
    expected = turning(fan(LEFT, RIGHT))
    assert np.array(turning(corners_of(mesh))) == pytest.approx(np.array(expected), abs=2e-5)
    assert_flat(mesh)
    assert not caplog.records


def tangents_of(values: list[list[float]]) -> Callable[[dict[str, Any], bytes], bytes]:
    """With tangents at the four corners of the left square, as they stand."""

    def edit(header: dict[str, Any], buffer: bytes) -> bytes:
        number, buffer = add(header, buffer, np.array(values, np.float32), "VEC4")
        primitives(header)[0]["attributes"]["TANGENT"] = number
        return buffer

    return edit


def test_tangents_of_a_glb_are_used(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Those of the other square, and wrong ones, are MikkTSpace's."""
    plain = read_mesh(glb(tmp_path / "plain.glb", normals=True))
    turned = right = [0.6, 0.8, 0, 1]
    mesh = read_mesh(edited(glb(tmp_path / "a.glb", normals=True), tangents_of([turned] * 4)))
    assert mesh.tangents[:2] == pytest.approx(np.broadcast_to(turned, (2, 3, 4)))
    assert mesh.tangents[2:] == pytest.approx(plain.tangents[2:])
    assert not caplog.records
    mirrored = read_mesh(edited(glb(tmp_path / "m.glb", normals=True), tangents_of([[0.6, 0.8, 0, -1]] * 4)))
    assert "handedness of most of its tangents" in caplog.text and (mirrored.tangents[:2, :, 3] == -1).all()
    for wrong in ([1.2, 1.6, 0, 1], [0.6, 0.8, 0, 0], [0, 0, 0, 1], [NAN, 0, 0, 1]):
        caplog.clear()
        mesh = read_mesh(edited(glb(tmp_path / "b.glb", normals=True), tangents_of([right, wrong, right, right])))
        assert "1 of its 4 tangents" in caplog.text
        assert mesh.tangents[0, 0] == pytest.approx(right)
        assert mesh.tangents[0, 1] == pytest.approx(plain.tangents[0, 1])
    unshaded = read_mesh(edited(glb(tmp_path / "c.glb", normals=False), tangents_of([turned] * 4)))
    assert unshaded.tangents == pytest.approx(plain.tangents)  # glTF 2.0, section 3.7.2.1


def test_tangents_of_a_mirrored_node_turn_with_it(tmp_path: Path) -> None:
    def edit(header: dict[str, Any], buffer: bytes) -> bytes:
        header["nodes"][0]["scale"] = [-2, 2, 2]
        return tangents_of([[0.6, 0.8, 0, 1]] * 4)(header, buffer)

    mesh = read_mesh(edited(glb(tmp_path / "mesh.glb", normals=True), edit))
    is_left = mesh.vertices[mesh.triangles][..., 0].max(axis=1) <= 0
    tangent, normal = mesh.tangents[is_left], mesh.corner_normals[is_left]
    assert tangent[..., :3] == pytest.approx(np.broadcast_to([-0.6, 0.8, 0], (2, 3, 3)))
    bitangent = tangent[..., 3:] * np.cross(normal, tangent[..., :3])
    assert bitangent == pytest.approx(np.broadcast_to([0.8, 0.6, 0], (2, 3, 3)))  # (-0.8, 0.6, 0) mirrored


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"animations": [{}]}, "animations are not applied"),
        ({"scenes": [{"nodes": [0, 1]}, {}]}, "of its scenes, only"),
        ({"extensionsRequired": ["X_bent"]}, "X_bent is needed to read it, which is not known"),
    ],
)
def test_what_of_a_glb_is_left_out_is_said(tmp_path, said: dict[str, Any], words: str, caplog) -> None:
    caplog.set_level("INFO")
    path = glb(tmp_path / "mesh.glb", normals=True)
    change_header(path, lambda header: header.update(said))
    read_mesh(path)
    [sentence] = caplog.messages
    assert words in sentence


def ply_of(path: Path, *, comments: str = "", of_vertices: str = "", faces: str = "", properties: str = "") -> Path:
    """The two squares without UVs. of_vertices: names and values of more properties, which are those of x and y."""
    names = of_vertices.split()
    head = ["ply", "format ascii 1.0", *filter(None, [comments]), "element vertex 6"]
    head += [f"property float {name}" for name in ["x", "y", "z", *names]]
    element = "tristrips 1" if "-1" in faces else f"face {faces.count(chr(10)) + 1}"
    head += [f"element {element}", "property list uchar int vertex_indices", *filter(None, [properties]), "end_header"]
    rows = [" ".join(map(str, [*place, *place[: len(names)]])) for place in POINTS]
    path.write_text("\n".join([*head, *rows, faces, ""]))
    return path


@pytest.mark.parametrize("names", ["s t", "u v", "texture_u texture_v"])
def test_ply_has_the_uvs_of_its_vertices_by_any_name_and_is_flat(tmp_path: Path, names: str) -> None:
    mesh = read_mesh(ply_of(tmp_path / "mesh.ply", of_vertices=names, faces="4 0 1 2 3\n4 1 4 5 2"))
    assert mesh.uvs == pytest.approx(mesh.vertices[mesh.triangles][..., :2])
    assert_flat(mesh)


def test_ply_of_triangle_strips(tmp_path: Path) -> None:
    path = ply_of(tmp_path / "mesh.ply", of_vertices="s t", faces="9 1 2 0 3 -1 1 4 2 5")
    found = turning(read_mesh(path).vertices[read_mesh(path).triangles].tolist())
    triangles = [(0, 1, 2), (0, 2, 3), (1, 4, 2), (4, 5, 2)]
    assert found == turning([[list(map(float, POINTS[v])) for v in triangle] for triangle in triangles])


PAGES = "comment TextureFile a b.png\ncomment TextureFile c.png"
WEDGES = "property list uchar float texcoord\nproperty int texnumber"


def test_ply_has_a_material_for_each_texture_page(tmp_path: Path) -> None:
    faces = "3 0 1 2 6 0 0 1 0 1 1 0\n3 1 4 5 6 0 0 1 0 1 1 1\n3 0 2 3 6 0 0 1 0 1 1 0\n3 1 5 2 6 0 0 1 0 1 1 4"
    mesh = read_mesh(ply_of(tmp_path / "mesh.ply", comments=PAGES, properties=WEDGES, faces=faces))
    assert mesh.materials is not None
    assert [mesh.materials.names[one] for one in mesh.materials.number] == ["a b", "c", "a b", "page_4"]
    one = faces.replace(" 4\n", " 0\n")[:-1].replace("1 1 1\n", "1 1 0\n") + "0"
    assert read_mesh(ply_of(tmp_path / "one.ply", comments=PAGES, properties=WEDGES, faces=one)).materials is None
    some = faces.replace("6 0 0 1 0 1 1 4", "0 4")
    with pytest.raises(InputError, match="some of its faces have no UVs"):
        read_mesh(ply_of(tmp_path / "some.ply", comments=PAGES, properties=WEDGES, faces=some))


@pytest.mark.parametrize(("up", "unit"), [("y", 1.0), ("z", 100.0), ("y", 0.01)])
def test_up_and_unit_place_a_mesh_and_leave_its_own_space(tmp_path: Path, up: Up, unit: float) -> None:
    path = obj(tmp_path / "mesh.obj", "\n".join(QUADS))
    plain, mesh = read_mesh(path), read_mesh(path, up=up, unit=unit)
    x, y, z = unit * plain.vertices.T
    assert mesh.world_vertices == pytest.approx(np.stack([x, -z, y] if up == "y" else [x, y, z], axis=1))
    assert mesh.vertices.tolist() == plain.vertices.tolist()


def test_faces_that_turn_their_back_to_normals_are_reported(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    read_mesh(obj(tmp_path / "a.obj", "f 1/1/1 2/2/1 3/3/1 4/4/1"))
    assert not caplog.records
    path = obj(tmp_path / "b.obj", "f 1/1/1 4/4/1 3/3/1 2/2/1")
    read_mesh(path, shape_only=True)
    assert not caplog.records
    read_mesh(path)
    assert re.search(
        r"b\.obj: most of its faces point the opposite way .*flip the faces, and export it again", caplog.text
    )


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
    found = shared_normals(points[triangles], triangles)
    assert degrees_between(found, expected[triangles]).max() < 1e-4
    assert np.linalg.norm(found, axis=-1) == pytest.approx(1)


def test_vertices_of_no_face_count_for_nothing(tmp_path: Path) -> None:
    path = obj(tmp_path / "mesh.obj", "f 1/1 2/2 3/3 4/4\nf 2/5 5/6 6/7 3/8", normals=False)
    path.write_text("v 9e6 0 0\n" + re.sub(r"(?<= )(\d)(?=/)", lambda one: str(int(one[1]) + 1), path.read_text()))
    mesh = read_mesh(path)
    assert corners_of(mesh) == fan(LEFT, RIGHT)
    assert mesh.vertices.tolist() == POINTS


def pickled(b: Bench) -> Path:
    """An npz that would run code if it were unpickled."""

    class Danger:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(b / "unpickled"),)

    np.savez(b / "mesh.npz", format=np.array("mpsnet-mesh"), vertices=np.array([Danger()], dtype=object))
    return b / "mesh.npz"


POINT: dict[str, Any] = {"bufferView": 0, "componentType": 5126, "count": 1, "type": "VEC3"}


HUGE = {"scale": [1e300] * 3}
INSTANCED = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0, "SCALE": 1}}}


def glb_of(b: Bench, **said: Any) -> Path:
    """A GLB of one point that lies in a buffer, as far as not said otherwise."""
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    good = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "meshes": [mesh]}
    good |= {"accessors": [POINT], "bufferViews": [{"buffer": 0, "byteLength": 12}]}
    return write_glb(b / "mesh.glb", good | said, bytes(12))


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


test_a_bad_mesh_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        (lambda b: read_mesh(b.text("m.obj", "v 0 0 0\nvt 0 0\nf" + " 1/1" * 100_000)), "m.obj: line 3: a face of"),
        (
            "a GLB whose faces name vertices that it lacks",
            lambda b: read_mesh(b.replaced(glb(b / "m.glb", normals=True), b"\2\0\0\0\3\0\0\0", b"\2\0\0\0\3\0\0\1")),
            "m.glb: the mesh's triangles name vertices that it does not have; export it again",
        ),
        ("a packed mesh", lambda b: read_mesh(b.bytes("m.obj.bz2", b"BZh")), ".bz2 is not a supported mesh format"),
        ("npz of complex numbers", lambda b: read_mesh(b.mesh(uvs=1j * SQUARE["uvs"])), 'mesh.npz: its "uvs" holds'),
        ("a PLY cut short", lambda b: read_mesh(cut(ply(b / "m.ply", "<"))), "m.ply: it cannot be read as PLY"),
        *(
            (
                f"a PLY with {word} for a number",
                lambda b, old=old, new=new: read_mesh(b.replaced(ply(b / "m.ply", ""), old, new)),
                f"m.ply: {said}",
            )
            for word, old, new, said in (
                ("inf", b"7 3 1 4 2", b"7 inf 1 4 2", "it cannot be read as PLY (cannot convert float infinity"),
                ("1e30", b"7 3 1 4 2", b"7 3 1 1e30 2", "the mesh's triangles name vertices that it does not have"),
            )
        ),
        (lambda b: read_mesh(b.replaced(ply(b / "m.ply", ""), b"7 3 1 4 2", b"7 -3 1 4 2")), "m.ply: it cannot be"),
        ("not a mesh", lambda b: read_mesh(b.photo("mesh.png", kind="uint8")), "not a supported mesh"),
        ("an OBJ of words", lambda b: read_mesh(b.text("mesh.obj", "hello\n")), "mesh.obj: it has no faces"),
        ("texts without letters", lambda b: read_mesh(texts_without_letters(b)), '"materials" holds neither numbers'),
        ("a GLB with less than it says", lambda b: read_mesh(short_glb(b)), "mesh.glb…cannot be read…export it again"),
        *(
            (
                f"a GLB of {name}",
                lambda b, name=name: read_mesh(glb_of(b, extensionsRequired=[name])),
                f"mesh.glb: it is compressed ({name}); export it without compression",
            )
            for name in ("KHR_draco_mesh_compression", "EXT_meshopt_compression")
        ),
        (
            "a GLB of more numbers than it holds",
            lambda b: read_mesh(glb_of(b, accessors=[{"componentType": 5126, "count": 10**9, "type": "VEC3"}])),
            "mesh.glb: it unpacks to more than 64 MiB; reduce it first",
        ),
        *(
            (f"a GLB of {words}", lambda b, nodes=nodes: read_mesh(glb_of(b, nodes=nodes)), f"mesh.glb: {said}")
            for words, nodes, said in (
                ("nodes in one another", [{"children": [1]}, {"mesh": 0, "children": [0]}], "it has no faces"),
                ("a node that it lacks", [{"children": [7]}], "it cannot be read"),
                ("a place that is none", [HUGE | {"children": [1]}, HUGE | {"mesh": 0}], "a transform of it is not"),
                ("instances of two numbers", [{"mesh": 0, "extensions": INSTANCED}], "it cannot be read"),
            )
        ),
        (
            "a GLB of too many parts",
            lambda b: read_mesh(glb_of(b, nodes=[{"mesh": 0}] * 70_000, scenes=[{"nodes": list(range(70_000))}])),
            "mesh.glb: it has more than…parts; reduce it first",
        ),
        ("a GLB whose numbers are in another file", lambda b: read_mesh(glb_beside_a_pipe(b)), "mesh.glb: it refers"),
        ("an .npz that unpacks to far more", lambda b: read_mesh(bomb(b)), "mesh.npz: it unpacks to 288 MiB, more"),
        ("npz with pickles", lambda b: read_mesh(pickled(b)), "mesh.npz…cannot be read…pickle…export it again"),
        ("npz of something else", lambda b: read_mesh(b.mesh(format=None)), "mesh.npz…not a mpsnet-mesh file"),
        ("npz of a newer version", lambda b: read_mesh(b.mesh(version=np.array(2))), "version 2, this program reads"),
        ("npz without UVs", lambda b: read_mesh(b.mesh(uvs=None)), 'mesh.npz…lacks "uvs"; export it again'),
        ("UVs of another shape", lambda b: read_mesh(b.mesh(uvs=np.zeros((4, 2)))), "uvs have shape (4, 2), expected"),
        (lambda b: read_mesh(b.mesh(triangles=np.array([[0, 1, 2], [0, 2, 9]]))), "triangles name vertices that it"),
        ("vertices not finite", lambda b: Mesh(**{**SQUARE, "vertices": SQUARE["vertices"] * NAN}), "vertices hold a"),
        (
            "UVs outside",
            lambda b: bake_normals(
                Mesh(**{**SQUARE, "uvs": SQUARE["uvs"] + 1}), [View(read_camera(b.camera()), read_normals(b.normals()))]
            ),
            "UVs lie outside the texture (0 to 1); move",
        ),
        ("scale 0", lambda b: Mesh(**SQUARE, world_from_object=np.diag([1, 1, 0, 1])), "scaled to nothing"),
    ]
)
