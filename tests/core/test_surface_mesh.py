"""Surfaces as meshes: on the surface, without cracks, fine where it bends; and their files as they come back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from height_shapes import Surface, ball, bumps, orthographic, plane
from synthetic import listing

from mpsnet_core import Camera, HeightMap, InputError, NormalMap, read_mesh
from mpsnet_core.relief.surface_mesh import SurfaceMesh, surface_mesh, write_surface_mesh

pytestmark = pytest.mark.accuracy

# The camera looks along the world's +y, its right is +x, its up +z.
POSE = np.array([[1, 0, 0, 10.0], [0, 0, -1, -20], [0, 1, 0, 30], [0, 0, 0, 1]])
NEAR = Camera("perspective", 150, 130, (170.0, 160.0), (70.0, 66.0), POSE)
FAR = orthographic(130, 150, 25, POSE)
CAMERAS = pytest.mark.parametrize("camera", [FAR, NEAR], ids=["from afar", "from near"])


def of(relief: Surface, faces: int = 200_000, open_from: float | None = None) -> SurfaceMesh:
    return surface_mesh(relief.heights, relief.normals, faces=faces, open_from=open_from)


def rim(mesh: SurfaceMesh) -> np.ndarray:
    """Vertices of edges that belong to one face alone; all others must belong to two, once in each direction."""
    edges = np.concatenate([mesh.triangles[:, ways] for ways in ([0, 1], [1, 2], [2, 0])]).astype(np.int64)
    there, back = (edges @ (len(mesh.vertices), 1), edges[:, ::-1] @ (len(mesh.vertices), 1))
    assert len(np.unique(there)) == len(edges)
    return np.unique(edges[~np.isin(there, back)])


@CAMERAS
def test_vertices_lie_on_the_surface_where_the_camera_saw_them(camera: Camera) -> None:
    surface = ball(camera, (0.2, 0.1, -5), 1.6)
    mesh = of(surface, 3000)
    middle = POSE[:3, :3] @ (0.2, 0.1, -5) + POSE[:3, 3]
    assert np.linalg.norm(mesh.vertices - middle, axis=1) == pytest.approx(1.6, abs=1e-5)
    assert mesh.normals == pytest.approx((mesh.vertices - middle) / 1.6, abs=1e-5)
    # Where the camera sees a vertex, the photo has its UV.
    x, y, w = camera.projection_rows() @ np.c_[mesh.vertices, np.ones(len(mesh.vertices))].T
    assert mesh.uvs[:, 0] == pytest.approx(x / w / camera.width, abs=1e-6)
    assert mesh.uvs[:, 1] == pytest.approx(1 - y / w / camera.height, abs=1e-6)
    # All faces turn to the camera.
    a, b, c = mesh.vertices[mesh.triangles].swapaxes(0, 1)
    assert (np.einsum("ti,ti->t", np.cross(b - a, c - a), mesh.normals[mesh.triangles[:, 0]]) > 0).all()


@pytest.mark.parametrize("shape", [(130, 150), (257, 257), (258, 300), (5, 700), (2, 2), (3, 1000), (700, 2)])
@pytest.mark.parametrize("faces", [300, 3000, 1_000_000])
def test_there_are_no_cracks(shape: tuple[int, int], faces: int) -> None:
    """Of a whole picture all edges but those along its border have a face on either side, and nothing is left out."""
    height, width = shape
    mesh = of(bumps(orthographic(height, width)), faces)
    column, row = (mesh.uvs * (width, height) - 0.5).round().astype(int).T
    border = (row == 0) | (row == height - 1) | (column == 0) | (column == width - 1)
    assert border[rim(mesh)].all()
    a, b, c = mesh.vertices[mesh.triangles, :2].swapaxes(0, 1)
    (x, y), (other_x, other_y) = (b - a).T, (c - a).T
    areas = (x * other_y - y * other_x) / 2
    assert areas.min() > 0 and areas.sum() == pytest.approx((height - 1) * (width - 1))


def test_as_many_faces_as_are_allowed_go_where_it_bends() -> None:
    surface = bumps(orthographic(200, 220))
    values = surface.heights.values.copy()
    values[:, :110] = values[:, 110:111]  # the left half bends one way only
    half = HeightMap(values, surface.mask, surface.camera)
    for faces in (500, 2000, 8000):
        mesh = surface_mesh(half, surface.normals, faces=faces)
        assert 0.7 * faces < len(mesh.triangles) <= faces
        left = mesh.vertices[mesh.triangles].mean(axis=1)[:, 0] < 0
        assert left.mean() < 0.3
    everything = surface_mesh(half, surface.normals, faces=1_000_000)
    assert len(everything.triangles) <= 2 * 199 * 219


def test_more_faces_come_closer() -> None:
    """To the surface's formula, at places all over each face."""
    surface = bumps(orthographic(200, 200))
    shares, wave = np.random.default_rng(0).dirichlet(np.ones(3), 64), 3 * np.pi / 99.5
    off = []
    for faces in (250, 1000, 4000, 16_000):
        mesh = of(surface, faces)
        x, y, z = np.einsum("pc,tci->itp", shares, mesh.vertices[mesh.triangles])
        off.append(np.abs(z - 9.95 * np.sin(wave * x) * np.cos(0.8 * wave * y)).max())
    assert off == sorted(off, reverse=True) and off[-1] < off[0] / 10


def test_a_mask_is_kept_to() -> None:
    surface = ball(orthographic(120, 120, 30), (0, 0, 0), 1.8)
    mask = surface.mask.copy()
    mask[50:60, 40:70] = False
    mesh = surface_mesh(HeightMap(surface.heights.values, mask, surface.camera), surface.normals)
    column, row = (mesh.uvs * 120 - 0.5).round().astype(int).T
    assert mask[119 - row, column].all()
    assert len(mesh.vertices) == mask.sum()  # more faces are allowed than there are
    assert len(np.unique(mesh.triangles)) == len(mesh.vertices)
    holes = mesh.vertices[mesh.triangles].mean(axis=1)[:, :2]
    assert not ((np.abs(holes - (-0.17, 0.17)) < 0.1).all(axis=1)).any()


@CAMERAS
def test_steps_are_left_open_where_asked(camera: Camera) -> None:
    front, back = plane(camera, (0, 0, 1), -4), plane(camera, (0, 0, 1), -6)
    near = np.broadcast_to(np.arange(camera.width) < 60, front.mask.shape)
    step = HeightMap(np.where(near, front.heights.values, back.heights.values), front.mask, camera)
    closed = surface_mesh(step, front.normals)
    opened = surface_mesh(step, front.normals, open_from=80)
    depth = (opened.vertices - POSE[:3, 3]) @ -POSE[:3, 2]
    assert np.ptp(depth[opened.triangles], axis=1).max() < 1e-4
    assert np.ptp(((closed.vertices - POSE[:3, 3]) @ -POSE[:3, 2])[closed.triangles], axis=1).max() > 1.9
    assert len(opened.triangles) < len(closed.triangles)


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".obj"])
@pytest.mark.parametrize("up", ["y", "z"])
def test_files_come_back(tmp_path: Path, suffix: str, up: str) -> None:
    mesh = of(ball(NEAR, (0.2, 0.1, -5), 1.6), 800)
    write_surface_mesh(tmp_path / f"m{suffix}", mesh, up=up)  # type: ignore[arg-type]
    found = read_mesh(tmp_path / f"m{suffix}")
    assert found.objects is None or found.objects.names == ("m",)
    assert listing(tmp_path) == [f"m{suffix}"]
    turned = up == "z" and suffix != ".ply"
    # With y up in the file, the world's z is the file's y, and the world's y points away: the file's -z.
    turn = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]) if turned else np.eye(3)
    assert found.vertices[found.triangles] == pytest.approx(mesh.vertices[mesh.triangles] @ turn.T, abs=1e-5)
    assert found.corner_normals == pytest.approx(mesh.normals[mesh.triangles] @ turn.T, abs=1e-4)
    assert found.uvs == pytest.approx(mesh.uvs[mesh.triangles], abs=1e-6)


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".obj"])
def test_the_coordinates_of_a_survey_are_kept(tmp_path: Path, suffix: str) -> None:
    mesh = of(ball(NEAR, (0.2, 0.1, -5), 1.6), 800)
    far = replace(mesh, vertices=mesh.vertices + np.array([500000.25, 4100000.75, 321.5]))
    write_surface_mesh(tmp_path / f"m{suffix}", far, up="y")
    found = read_mesh(tmp_path / f"m{suffix}")
    assert found.world_vertices[found.triangles] == pytest.approx(far.vertices[far.triangles], abs=1e-5, rel=0)


def test_what_cannot_be_made(tmp_path: Path) -> None:
    surface = plane(orthographic(40, 40), (0, 0, 1))
    mesh = of(surface)
    for bad, words in (
        (lambda: of(surface, 0), "a mesh of 0 faces cannot be made"),
        (lambda: of(surface, open_from=float("nan")), "between 0 and 90 degrees on, not nan"),
        (lambda: of(surface, 1), "no face is left of the surface"),
        *(
            (lambda s=s: of(plane(orthographic(*s), (0, 0, 1))), "nowhere two pixels wide and high, so it has no face")
            for s in ((1, 1), (1, 300), (300, 1))
        ),
        (
            lambda: surface_mesh(surface.heights, NormalMap(np.ones((3, 4, 3)), np.ones((3, 4), bool))),
            "the height map is 40 x 40 but the normal map is 4 x 3",
        ),
        (lambda: write_surface_mesh(tmp_path / "m.ply", mesh, up="x"), 'is "y" or "z", not'),  # type: ignore[arg-type]
    ):
        with pytest.raises(InputError, match=words):
            bad()
    assert listing(tmp_path) == []
