"""Shapes: closed, wound outwards, of one size, with normals that fit; broken meshes; the same from the same seed."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mpsnet_core.errors import InputError
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.synthesis.shapes import KINDS, Shape, build_shape, draw_shape, mesh_files, meshes
from mpsnet_core.synthesis.shapes.blobs import CHARACTERS as BLOBS
from mpsnet_core.synthesis.shapes.drapery import CHARACTERS as DRAPERY
from mpsnet_core.synthesis.shapes.hollows import CHARACTERS as HOLLOWS
from mpsnet_core.synthesis.shapes.isosurface import box, cylinder, ellipsoid, isosurface, limb, surface_nets
from mpsnet_core.synthesis.shapes.reliefs import CHARACTERS as RELIEFS
from mpsnet_core.synthesis.shapes.shape import bent, displaced, smooth_shape, sphere

DRAWN = [
    *(("blobs", character) for character in BLOBS),
    *(("drapery", character) for character in DRAPERY),
    *(("reliefs", character) for character in RELIEFS),
    *(("hollows", character) for character in HOLLOWS),
    ("groups", ""),
]


@cache
def drawn(kind: str, character: str, seed: int = 4) -> Shape:
    return build_shape({"kind": kind, "seed": seed, "pose": "any", "character": character})


def edges(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keys of all edges in the direction of their triangles, and in the other."""
    pairs = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2).astype(np.int64)
    count = triangles.max() + 1
    return np.sort(pairs @ [count, 1]), np.sort(pairs @ [1, count])


def assert_closed(triangles: np.ndarray) -> None:
    """Every edge belongs to two triangles that run along it in opposite directions."""
    forth, back = edges(triangles)
    np.testing.assert_array_equal(forth, back)
    assert len(np.unique(forth)) == len(forth)


def face_normals(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals of the triangles, and their areas."""
    a, b, c = (shape.vertices[shape.triangles[:, k]] for k in range(3))
    crossed = np.cross(b - a, c - a)
    length = np.linalg.norm(crossed, axis=1)
    return crossed / np.maximum(length, 1e-30)[:, None], length / 2


def volume(shape: Shape) -> float:
    a, b, c = (shape.vertices[shape.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


def steep_share(shape: Shape, degrees: float) -> float:
    """The share of the surface whose corner normals are farther than this from their triangle's."""
    flat, area = face_normals(shape)
    cosines = np.einsum("tci,ti->tc", shape.corner_normals, flat)
    return float((area * (cosines < np.cos(np.radians(degrees))).mean(axis=1)).sum() / area.sum())


@pytest.mark.parametrize(("kind", "character"), DRAWN)
def test_drawn_shapes_are_sound(kind: str, character: str) -> None:
    shape = drawn(kind, character)
    assert shape.vertices.dtype == np.float64
    assert (shape.triangles.dtype, shape.parts.dtype, shape.corner_normals.dtype) == (np.int32, np.int32, np.float32)
    assert shape.corner_normals.shape == (*shape.triangles.shape, 3)
    assert shape.parts.shape == shape.triangles.shape[:1]
    assert np.isfinite(shape.vertices).all()
    assert np.linalg.norm(shape.vertices, axis=1).max() == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(np.linalg.norm(shape.corner_normals, axis=-1), 1, atol=1e-5)
    assert_closed(shape.triangles)
    assert volume(shape) > 0
    assert steep_share(shape, 60) < 0.02


@pytest.mark.parametrize(("kind", "character"), DRAWN)
def test_from_outside_only_outsides_are_seen(kind: str, character: str) -> None:
    shape = drawn(kind, character)
    scene = RayScene(shape.vertices, shape.triangles)
    rng = np.random.Generator(np.random.PCG64(1))
    ways = rng.normal(size=(1500, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    starts = rng.normal(size=(1500, 3)) * 0.3 - 3 * ways
    triangle = scene.hits(starts, ways).triangle
    hit = triangle >= 0
    assert hit.sum() > 100
    flat, _ = face_normals(shape)
    assert (np.einsum("ij,ij->i", flat[triangle[hit]], ways[hit]) < 0).mean() > 0.97


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "meshes"])
def test_a_description_is_all_there_is(kind: str) -> None:
    description = draw_shape(np.random.Generator(np.random.PCG64(7)), kind)
    assert description["kind"] == kind
    assert description["pose"] in ("any", "upright", "front")
    again = draw_shape(np.random.Generator(np.random.PCG64(7)), kind)
    first, second = build_shape(description), build_shape(json.loads(json.dumps(again)))
    for name in Shape.__dataclass_fields__:
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


def test_a_ball_is_a_sphere_with_exact_normals() -> None:
    shape = isosurface([limb((0.1, 0.2, 0.3), (0.1, 0.2, 0.3), 1, 1)], 2 / 40)
    away = shape.vertices - (0.1, 0.2, 0.3)
    radius = np.linalg.norm(away, axis=1)
    np.testing.assert_allclose(radius, 1, atol=1e-7)
    np.testing.assert_allclose(shape.corner_normals, (away / radius[:, None])[shape.triangles], atol=1e-6)
    assert_closed(shape.triangles)
    assert volume(shape) == pytest.approx(4 / 3 * np.pi, rel=3e-3)
    assert steep_share(shape, 4) == 0


def test_volumes_of_joined_and_carved_balls() -> None:
    # The lens of two unit balls a unit apart is 5/12 pi.
    balls = [limb((0, 0, 0), (0, 0, 0), 1, 1), limb((0, 0, 1), (0, 0, 1), 1, 1)]
    assert volume(isosurface(balls, 0.05)) == pytest.approx((8 / 3 - 5 / 12) * np.pi, rel=5e-3)
    carved = [balls[0], limb((0, 0, 1), (0, 0, 1), 1, 1, carve=True)]
    assert volume(isosurface(carved, 0.05)) == pytest.approx((4 / 3 - 5 / 12) * np.pi, rel=1e-2)


@pytest.mark.parametrize(
    ("solid", "expected"),
    [
        (ellipsoid((0, 0, 0), (1, 0.6, 0.4)), 4 / 3 * np.pi * 0.24),
        (box((0.3, 0, 0), (0.5, 0.4, 0.3), 0.01), 8 * 0.06),
        (cylinder((0, 0, 0), 0.5, 0.4, 0.01), np.pi * 0.25 * 0.8),
        (limb((0, 0, 0), (0, 0, 1), 0.3, 0.3), np.pi * 0.09 + 4 / 3 * np.pi * 0.027),
    ],
)
def test_volumes_of_solids(solid, expected: float) -> None:  # type: ignore[no-untyped-def]
    shape = isosurface([solid], 0.02)
    assert_closed(shape.triangles)
    assert volume(shape) == pytest.approx(expected, rel=1e-2)
    assert np.abs(solid.signed_distance(shape.vertices.T)).max() < 2e-3


def test_any_signs_give_a_closed_surface() -> None:
    values = np.random.Generator(np.random.PCG64(5)).normal(size=(14, 15, 16))
    for axis in range(3):
        for end in (0, -1):
            np.moveaxis(values, axis, 0)[end] = 1
    places, quads = surface_nets(values)
    assert_closed(np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    assert np.isfinite(places).all()


def test_displaced_and_bent_normals_follow() -> None:
    vertices, triangles = sphere(5)
    ball = smooth_shape(vertices, triangles, vertices)
    rough = displaced(ball, lambda p: 0.03 * np.sin(6 * p[:, 0]))
    assert steep_share(rough, 6) == 0
    stretched = bent(ball, lambda p: p * (1.0, 0.5, 2.0))
    # The normals of an ellipsoid are its gradients.
    gradient = stretched.vertices / np.square((1.0, 0.5, 2.0))
    gradient /= np.linalg.norm(gradient, axis=1)[:, None]
    np.testing.assert_allclose(stretched.corner_normals, gradient[triangles], atol=2e-3)


def obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    rows = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    path.write_text("\n".join(rows + [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]) + "\n")
    return path


def broken(kind: str, vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.Generator(np.random.PCG64(6))
    if kind == "flipped":
        flip = rng.random(len(faces)) < 0.4
        faces = np.where(flip[:, None], faces[:, ::-1], faces)
    elif kind == "inside out":
        faces = faces[:, ::-1]
    elif kind == "holes":
        faces = faces[rng.random(len(faces)) > 0.03]
    elif kind == "soup":
        vertices, faces = vertices[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)
    elif kind == "twice":
        faces = np.concatenate([faces, faces[:50, [1, 2, 0]], faces[50:80, ::-1], faces[:5, [0, 0, 1]]])
    elif kind == "strays":
        vertices = np.concatenate([vertices, [[50.0, 0, 0]]])
    return vertices, faces


@pytest.mark.parametrize("kind", ["sound", "flipped", "inside out", "holes", "soup", "twice", "strays"])
def test_broken_meshes_are_repaired(tmp_path: Path, kind: str) -> None:
    vertices, faces = sphere(3)
    obj(tmp_path / "ball.obj", *broken(kind, vertices * 3 + (1, 2, 3), faces))
    description = {"kind": "meshes", "seed": 1, "pose": "any", "files": ["ball.obj"], "deformed": False}
    shape = build_shape(description, tmp_path)
    assert_closed(shape.triangles)
    assert volume(shape) == pytest.approx(4 / 3 * np.pi, rel=0.03)
    assert np.linalg.norm(shape.vertices, axis=1).max() == pytest.approx(1, abs=1e-12)
    outward = np.einsum("tci,tci->tc", shape.corner_normals, shape.vertices[shape.triangles])
    assert outward.min() > 0.95


def test_creases_stay_sharp_and_y_is_up(tmp_path: Path) -> None:
    block = trimesh.creation.box((1, 2, 1))
    shape = meshes.load_mesh(str(obj(tmp_path / "box.obj", block.vertices, block.faces)))
    flat, _ = face_normals(shape)
    np.testing.assert_allclose(shape.corner_normals, np.repeat(flat[:, None], 3, axis=1), atol=1e-6)
    size = shape.vertices.max(axis=0) - shape.vertices.min(axis=0)
    np.testing.assert_allclose(size / size[0], (1, 1, 2), rtol=1e-6)


def test_a_hole_with_a_long_rim_is_filled(tmp_path: Path) -> None:
    turn = np.linspace(0, 2 * np.pi, 20_000, endpoint=False)
    ring = np.column_stack([np.cos(turn), 0 * turn, np.sin(turn)])
    cone = np.concatenate([ring, [(0, 1.0, 0)]])
    here = np.arange(len(turn))
    faces = np.column_stack([here, np.roll(here, -1), np.full(len(turn), len(turn))])
    vertices, filled = meshes.fill_mesh_holes(cone, faces)
    assert len(vertices) == len(cone) + 1 and len(filled) == 2 * len(faces)
    assert_closed(filled.astype(np.int32))


def test_meshes_together_on_a_ground_and_deformed(tmp_path: Path) -> None:
    vertices, faces = sphere(3)
    obj(tmp_path / "a.obj", vertices, faces)
    obj(tmp_path / "b.obj", vertices * (1, 3, 1), faces)
    description = {"kind": "meshes", "seed": 3, "pose": "upright", "files": ["a.obj", "b.obj"], "deformed": True}
    shape = build_shape(json.loads(json.dumps(description)), tmp_path)
    assert_closed(shape.triangles)
    assert len(np.unique(shape.parts)) == 3
    assert steep_share(shape, 45) < 0.02
    assert build_shape(description, tmp_path).vertices.tobytes() == shape.vertices.tobytes()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("garbage.glb", "this is no mesh", "cannot be read"),
        ("nan.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
        ("line.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "no faces with an area"),
        ("photo.png", "x", "not in a supported format"),
    ],
)
def test_hopeless_meshes_are_named(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text)
    description = {"kind": "meshes", "seed": 1, "pose": "any", "files": [name], "deformed": False}
    with pytest.raises(InputError, match=words) as caught:
        build_shape(description, tmp_path)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


def test_large_meshes_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = obj(tmp_path / "ball.obj", *sphere(2))
    monkeypatch.setattr(meshes, "MAX_FACES", 100)
    with pytest.raises(InputError, match="320 faces"):
        meshes.load_mesh(str(path))
    monkeypatch.setattr(meshes, "MAX_BYTES", 100)
    with pytest.raises(InputError, match="larger than"):
        meshes.load_mesh(str(path))


def test_what_is_no_shape_is_named(tmp_path: Path) -> None:
    rng = np.random.Generator(np.random.PCG64(1))
    with pytest.raises(InputError, match="'cats' is not known"):
        draw_shape(rng, "cats")
    with pytest.raises(InputError, match="no mesh files"):
        draw_shape(rng, "meshes")
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(InputError):
            mesh_files(folder)
    deleted = {"kind": "composites", "seed": 1, "pose": "upright", "character": "biped"}
    for description in ({}, {"kind": "blobs"}, {"kind": "blobs", "seed": 1}, {"kind": "cats", "seed": 1}, deleted):
        with pytest.raises(InputError, match=r"known|knows"):
            build_shape(description)
    for seed in (-1, "x", None):
        with pytest.raises(InputError):
            build_shape({"kind": "blobs", "seed": seed, "character": "smooth"})
    with pytest.raises(InputError, match="does not exist"):
        build_shape({"kind": "meshes", "seed": 1, "files": ["../../etc/passwd.obj"], "deformed": False}, tmp_path)
