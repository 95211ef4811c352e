"""MikkTSpace where the tangents follow from the definition; tests/addon compares them with Blender's own."""

import numpy as np
import pytest
from surface_shapes import sphere_mesh
from synthetic import degrees_between

from mpsnet_core.scene.mikktspace import mikktspace_tangents

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
UP = np.broadcast_to([0.0, 0.0, 1.0], (2, 3, 3))


@pytest.mark.parametrize("degrees", [0, 30, 90, 200])
@pytest.mark.parametrize("mirrored", [False, True])
def test_on_a_plane_the_tangent_is_where_u_grows(degrees: float, mirrored: bool) -> None:
    angle = np.radians(degrees)
    along_u = np.array([np.cos(angle), np.sin(angle), 0])
    along_v = np.array([-np.sin(angle), np.cos(angle), 0]) * (-1 if mirrored else 1)
    corners = SQUARE[HALVES]
    uvs = np.stack([corners @ along_u, corners @ along_v], axis=-1) * 0.3 + 0.5
    tangents = mikktspace_tangents(corners, UP, uvs)
    assert tangents[..., :3] == pytest.approx(np.broadcast_to(along_u, (2, 3, 3)), abs=1e-6)
    assert (tangents[..., 3] == (-1 if mirrored else 1)).all()
    bitangent = tangents[..., 3:] * np.cross(UP, tangents[..., :3])
    assert bitangent == pytest.approx(np.broadcast_to(along_v, (2, 3, 3)), abs=1e-6)


@pytest.mark.parametrize("layout", ["whole", "mirrored", "overlapping"])
def test_on_a_sphere_they_run_along_the_circles_of_latitude(layout: str) -> None:
    mesh = sphere_mesh(64, 32, layout=layout)
    corners = mesh.vertices[mesh.triangles]
    tangents = mikktspace_tangents(corners, mesh.corner_normals, mesh.uvs)
    assert np.linalg.norm(tangents[..., :3], axis=-1) == pytest.approx(1, abs=1e-6)
    assert np.abs(np.einsum("tci,tci->tc", tangents[..., :3], mesh.corner_normals)).max() < 1e-6

    flipped = (corners.mean(axis=1)[:, 0] < 0) & (layout != "whole")
    assert (tangents[..., 3] == np.where(flipped, -1, 1)[:, None]).all()
    east = np.cross([0, 0, 1], corners) * np.where(flipped, -1, 1)[:, None, None]
    off_pole = np.abs(corners[..., 2]) < 0.95
    # At the seam and where the flipped half begins only one side's triangles count: off by half a cell's turn.
    error = degrees_between(tangents[..., :3], east)[off_pole]
    assert np.median(error) < 0.3 and error.max() < 4


def test_corners_share_a_tangent_where_triangles_meet_the_same_way_round() -> None:
    """Two triangles at an edge: one tangent each at shared corners; two where UVs, normals or winding part them."""
    corners = SQUARE[HALVES]
    corners[1, 2, 2] = 0.8  # folded, so that the two have tangents of their own
    normals = np.broadcast_to(np.array([-0.3, 0.3, 0.9]) / np.linalg.norm([-0.3, 0.3, 0.9]), (2, 3, 3))
    uvs = np.array([[[0.1, 0.1], [0.4, 0.15], [0.4, 0.4]], [[0.1, 0.1], [0.4, 0.4], [0.15, 0.4]]])

    def same_at_shared_corners(normals: np.ndarray, uvs: np.ndarray) -> bool:
        tangents = mikktspace_tangents(corners, normals, uvs)
        return bool(np.allclose(tangents[0, 0], tangents[1, 0]) and np.allclose(tangents[0, 2], tangents[1, 1]))

    assert same_at_shared_corners(normals, uvs)
    assert not same_at_shared_corners(normals, uvs + np.array([[[0, 0]], [[0.5, 0]]]))
    sharp = normals.copy()
    sharp[1] = [0, 0, 1]
    assert not same_at_shared_corners(sharp, uvs)
    folded_over = uvs.copy()
    folded_over[1, 2] = [0.4, 0.1]  # the second triangle lies over the first, the other way round
    assert not same_at_shared_corners(normals, folded_over)


def test_in_the_coordinates_of_a_survey_they_are_the_same() -> None:
    mesh = sphere_mesh(48, 24, layout="mirrored")
    corners = mesh.vertices[mesh.triangles]
    far = corners + np.array([4e5, 5e6, 120])
    here, there = (mikktspace_tangents(places, mesh.corner_normals, mesh.uvs) for places in (corners, far))
    assert there == pytest.approx(here, abs=1e-5)


def test_corners_without_area_in_uv_take_a_neighbours_tangent_or_plus_x() -> None:
    corners = SQUARE[HALVES]
    uvs = np.stack([corners[..., 1], -corners[..., 0]], axis=-1) * 0.3 + 0.5  # u grows along y
    uvs[1, 2] = uvs[1, 0]
    tangents = mikktspace_tangents(corners, UP, uvs)
    assert tangents[1, :2, :3] == pytest.approx(np.broadcast_to([0, 1, 0], (2, 3)), abs=1e-6)
    alone = mikktspace_tangents(corners, UP, np.full_like(uvs, 0.5))
    assert (alone[..., :3] == [1, 0, 0]).all() and (np.abs(alone[..., 3]) == 1).all()
