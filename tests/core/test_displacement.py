"""Heights on UVs, where they are known: spheres and tori displaced by waves in space, in several islands."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bumpy_sphere import AMPLITUDE, bumpy_sphere, unit
from mesh_file import write_mesh
from relief_shapes import cube_sphere, tangent_normals, waves
from surface_shapes import grid_triangles, sphere_mesh, texels_of

from mpsnet_core import InputError, Mesh, join_meshes, read_height, write_height, write_image
from mpsnet_core.cli import main
from mpsnet_core.relief.displacement.displacement import Displacement, displacement
from mpsnet_core.relief.displacement.height_constraints import object_normals
from mpsnet_core.relief.displacement.uv_layout import layout_of
from mpsnet_core.scene.normal_encoding import encode

SIZE = 128


def square() -> Mesh:
    """The unit square, which fills its texture."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Mesh(vertices, faces, np.broadcast_to([0.0, 0, 1], (2, 3, 3)), vertices[faces][..., :2])


def heights_on(found: Displacement, mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """(N,) heights of the covered texels and (N, 3) where these are on the mesh, in object space."""
    texels = texels_of(mesh.uvs, len(found.values))
    return found.values[tuple(texels.place.T)], texels.of(mesh.vertices[mesh.triangles])


def error(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """What is wrong, up to a constant, as a share of the truth's amplitude."""
    wrong = found - truth
    return (wrong - wrong.mean()) / (np.ptp(truth) / 2)


def bilinear(values: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    """What a renderer reads at UVs (N, 2)."""
    size = len(values)
    x, y = uvs[:, 0] * size - 0.5, (1 - uvs[:, 1]) * size - 0.5
    c, r = np.floor(x).astype(int), np.floor(y).astype(int)
    s, t = x - c, y - r
    return (values[r, c] * (1 - s) + values[r, c + 1] * s) * (1 - t) + (
        values[r + 1, c] * (1 - s) + values[r + 1, c + 1] * s
    ) * t


def both_sides_of_seams(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """UVs of edges' middles at the two places of the texture that they have, found edge by edge."""
    known, one, other = {}, [], []
    for triangle, uvs in zip(mesh.triangles.tolist(), mesh.uvs.astype(float), strict=True):
        for a, b in ((0, 1), (1, 2), (2, 0)):
            ends = sorted([(tuple(mesh.vertices[triangle[end]]), tuple(uvs[end])) for end in (a, b)])
            key, middle = (ends[0][0], ends[1][0]), (uvs[a] + uvs[b]) / 2
            if key in known and np.abs(known[key] - middle).max() > 1e-3:
                one.append(known[key])
                other.append(middle)
            known[key] = middle
    return np.array(one), np.array(other)


@pytest.mark.parametrize("stretch", [1.0, 1.5], ids=["even", "stretched"])
@pytest.mark.parametrize("touching", [False, True], ids=["apart", "touching"])
def test_a_sphere_of_six_islands(stretch: float, touching: bool) -> None:
    """Off by less than 3 % of the bumps (rms; flat triangles are part of that), and the same on both sides of seams."""
    mesh = cube_sphere(12, stretch=stretch, touching=touching)
    vectors = tangent_normals(mesh, SIZE, lambda points, _: bumpy_sphere(points))
    found = displacement(vectors, mesh)
    heights, points = heights_on(found, mesh)
    # Of the mesh's flat triangles the sphere itself stands out.
    truth = 1 + AMPLITUDE * waves(unit(points)) - np.linalg.norm(points, axis=1)
    wrong = error(heights, truth)
    print(f"rms {wrong.std():.4f}, most {np.abs(wrong).max():.4f}, seam step {found.seam_step:.2e}")
    assert wrong.std() < 0.03 and np.abs(wrong).max() < 0.2
    if touching:  # what is read beyond the border is the next island
        return
    one, other = both_sides_of_seams(mesh)
    assert len(one) == 12 * 12
    apart = bilinear(found.values, one) - bilinear(found.values, other)
    print(f"read at the seams: {np.abs(apart).max() / AMPLITUDE:.4f}")
    assert np.abs(apart).max() < 0.04 * AMPLITUDE * np.ptp(waves(unit(points)))


@pytest.mark.parametrize("sign", [1, -1], ids=["turned and scaled", "mirrored"])
def test_heights_are_in_world_units(sign: int) -> None:
    a = 0.7
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = 2.5 * turn @ np.diag([sign, 1, 1]), (4, -3, 100)
    mesh = cube_sphere(10, pose=pose)
    back = np.linalg.inv(pose[:3, :3])

    def normals(points: np.ndarray, _: np.ndarray) -> np.ndarray:
        return unit(bumpy_sphere((points - pose[:3, 3]) @ back.T) @ back)

    heights, points = heights_on(displacement(tangent_normals(mesh, SIZE, normals), mesh), mesh)
    truth = 2.5 * (1 + AMPLITUDE * waves(unit(points)) - np.linalg.norm(points, axis=1))
    assert error(heights, truth).std() < 0.03


def test_a_base_that_lies_further_in_is_brought_out_to_where_the_mesh_lies() -> None:
    """Subdivision shrinks a mesh; heights are of the subdivided one, and their mean is what was lost."""
    mesh = cube_sphere(10)
    base = replace(mesh, vertices=mesh.vertices * 0.9)
    vectors = tangent_normals(mesh, SIZE, lambda points, _: bumpy_sphere(points))
    found = displacement(vectors, mesh, base=base)
    heights, points = heights_on(found, base)
    reached = np.linalg.norm(points, axis=1) + heights
    truth = 1 + AMPLITUDE * waves(unit(points))
    assert error(reached, truth).std() < 0.05
    assert reached.mean() == pytest.approx(np.linalg.norm(points, axis=1).mean() / 0.9, abs=0.1 * AMPLITUDE)
    assert displacement(vectors, mesh, mean=0.25).values[found.covered].mean() == pytest.approx(0.25, abs=0.01)


def test_a_base_that_is_another_mesh_is_refused() -> None:
    mesh, flat = cube_sphere(4), np.broadcast_to(np.array([0, 0, 1], np.float32), (64, 64, 3))
    away = replace(mesh, vertices=mesh.vertices + np.array([0, 9, 0]))
    elsewhere = replace(mesh, uvs=mesh.uvs * 0.3)
    for base in (away, elsewhere):
        with pytest.raises(InputError, match="the base is another mesh, not the same one subdivided"):
            displacement(flat, mesh, base=base)


def test_sixteen_bits_are_of_the_surface_wherever_it_lies(tmp_path: Path) -> None:
    """What is beyond the islands is no lower than they are, so that all steps are for them."""
    mesh = cube_sphere(8)
    found = displacement(tangent_normals(mesh, SIZE, lambda points, _: bumpy_sphere(points)), mesh, mean=5, margin=4)
    assert not found.covered.all()
    scale = write_height(tmp_path / "h.png", found.as_height_map())
    inside = found.values[found.covered]
    assert scale.white - scale.black < 1.2 * np.ptp(inside)
    read = read_height(tmp_path / "h.png").values[found.covered]
    assert np.abs(read - inside).max() < 1e-4 * np.ptp(inside)


def test_broad_bumps_are_left_to_the_mesh_where_that_is_asked_for() -> None:
    """A tilt of all normals about one axis, as estimates err, and fine waves: the waves stay."""
    size, mesh = 128, square()
    x = np.broadcast_to((np.arange(size) + 0.5) / size, (size, size))
    gradient = 0.05 + 0.2 * np.cos(2 * np.pi * 16 * x)
    vectors = unit(np.stack([-gradient, np.zeros_like(x), np.ones_like(x)], axis=-1)).astype(np.float32)
    fine = 0.2 / (2 * np.pi * 16) * np.sin(2 * np.pi * 16 * x)
    whole = displacement(vectors, mesh, margin=0).values
    assert whole == pytest.approx(0.05 * (x - 0.5) + fine, abs=2e-4)
    held = displacement(vectors, mesh, scale=0.2, margin=0).values
    inner = np.s_[:, 16:-16]
    assert held[inner] == pytest.approx(fine[inner], abs=1.5e-3)
    assert np.abs(whole - fine)[inner].max() > 0.015


def plate(cells: int) -> Mesh:
    """The unit square in `cells` x `cells` squares, which fills its texture."""
    x, y = np.meshgrid(*[np.linspace(0, 1, cells + 1)] * 2, indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    faces = grid_triangles(*x.shape)
    return Mesh(vertices, faces, np.broadcast_to([0.0, 0, 1], (len(faces), 3, 3)), vertices[faces][..., :2])


def test_the_relief_fades_where_no_view_saw_the_surface() -> None:
    """A ramp on the left, seen; on the right the normals are the mesh's own. Edges are a 24th long."""
    size, x = 96, (np.arange(96) + 0.5) / 96
    vectors = np.broadcast_to(np.array([0, 0, 1], np.float32), (size, size, 3)).copy()
    vectors[:, : size // 2] = unit(np.array([-0.2, 0, 1]))
    kept = displacement(vectors, plate(24), margin=0).values
    assert (kept[:, -1] - kept[:, 0]).min() > 0.08
    faded = displacement(vectors, plate(24), scale=2, margin=0).values
    relief = np.ptp(faded[:, x < 0.5])
    assert relief > 0.03
    assert np.abs(faded[:, x > 0.5 + 5 / 24]).max() < 0.01 * relief


def test_smooth_facets_stay_unless_they_are_to_become_round() -> None:
    """Of a sphere whose normals are the mesh's own: shading makes it round, or the heights over a base do."""
    mesh = cube_sphere(6)
    flat = np.broadcast_to(np.array([0, 0, 1], np.float32), (SIZE, SIZE, 3))
    heights, points = heights_on(displacement(flat, mesh, base=mesh, scale=0.5), mesh)
    below = 1 - np.linalg.norm(points, axis=1)
    left = below - heights
    print(f"{left.std() / below.std():.3f} of the facets' {below.std():.4f} left")
    assert left.std() < 0.3 * below.std()
    assert np.abs(displacement(flat, mesh, scale=0.5).values).max() < 0.001 * below.max()


def test_islands_smaller_than_a_texel_have_the_heights_of_those_around_them() -> None:
    mesh = cube_sphere(12)
    uvs = 0.75 * mesh.uvs.astype(float)
    where = uvs[100].copy()
    uvs[100] = (0.93, 0.06) + (where - where.mean(axis=0)) * 0.02
    apart = replace(mesh, uvs=uvs)
    vectors = tangent_normals(apart, SIZE, lambda points, _: bumpy_sphere(points))
    found = displacement(vectors, apart).values
    assert bilinear(found, uvs[100]).mean() == pytest.approx(bilinear(found, where).mean(), abs=0.1 * AMPLITUDE)


def test_a_triangle_without_area_does_not_spoil_the_others() -> None:
    """As at the poles of a grid of quads, where a triangle has two corners in one place and an area in UVs alone."""
    whole = square()
    uvs = np.concatenate([whole.uvs / 2, [[[0.6, 0.6], [0.9, 0.6], [0.9, 0.9]]]])
    triangles = np.concatenate([whole.triangles, [[2, 3, 3]]])
    mesh = Mesh(whole.vertices, triangles, np.broadcast_to([0.0, 0, 1], (3, 3, 3)), uvs)
    vectors = np.zeros((32, 32, 3), np.float32) + np.float32(unit(np.array([0.1, 0, 1])))
    found = displacement(vectors, mesh)
    assert np.isfinite(found.values).all()
    np.testing.assert_allclose(np.diff(found.values[16:, :16]), -0.1 / 16, atol=1e-4)


def test_normals_in_object_space_are_those_of_the_surface() -> None:
    mesh = cube_sphere(12)
    found = object_normals(tangent_normals(mesh, SIZE, lambda points, _: bumpy_sphere(points)), mesh, margin=4)
    texels = texels_of(mesh.uvs, SIZE)
    points = texels.of(mesh.vertices[mesh.triangles])
    assert found[tuple(texels.place.T)] == pytest.approx(bumpy_sphere(points), abs=1e-4)
    assert np.linalg.norm(found, axis=-1) == pytest.approx(1, abs=1e-5)


def test_each_part_of_the_surface_has_the_mean(tmp_path: Path) -> None:
    """Two spheres that share nothing, one in either half of the texture; one has twice the heights of the other."""
    small, texels = cube_sphere(6), 128
    left, right = small.uvs * (0.5, 1), small.uvs * (0.5, 1) + (0.5, 0)
    both = join_meshes([replace(small, uvs=left), replace(small, vertices=2 * small.vertices + 5, uvs=right)])
    vectors = np.zeros((texels, texels, 3), np.float32)
    vectors[..., 2] = 1
    found = displacement(vectors, both)
    for half in (np.s_[:, :64], np.s_[:, 64:]):
        assert abs(found.values[half][found.covered[half]].mean()) < 2e-3


def test_a_texture_of_another_space_is_refused() -> None:
    mesh = cube_sphere(6)
    tangent = tangent_normals(mesh, 64, lambda points, _: bumpy_sphere(points))
    texels = texels_of(mesh.uvs, 64)
    of_object = np.zeros((64, 64, 3), np.float32)
    of_object[..., 2] = 1
    of_object[tuple(texels.place.T)] = bumpy_sphere(texels.of(mesh.vertices[mesh.triangles]))
    assert np.ptp(displacement(of_object, mesh, space="object").values) < 0.4
    for vectors, space in ((tangent, "object"), (of_object, "tangent")):
        with pytest.raises(InputError, match=f"does not fit the mesh in {space} space: many of its normals point in"):
            displacement(vectors, mesh, space=space)


@pytest.mark.parametrize(
    ("gradient", "told"),
    [
        (0.02, ""),
        (0.8, "its normals contradict each other on 9"),  # a bowl on each of the six sides, of which none fits the next
    ],
)
def test_a_texture_that_does_not_fit_is_reported(gradient: float, told: str, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    write_mesh("mesh.npz", cube_sphere(4))
    row, column = np.indices((64, 64)) / 64 - 0.5
    write_image("t.png", encode(unit(np.stack([-gradient * column, gradient * row, np.full((64, 64), 0.2)], axis=-1))))
    assert main(["integrate", "t.png", "--uvs", "mesh.npz", "--height", "h.exr"]) == 0
    said = capsys.readouterr().err
    assert told in said if told else "was the texture" not in said


def test_heights_larger_than_the_mesh_are_reported(tmp_path, monkeypatch, capsys) -> None:
    """A ramp: nothing in it contradicts."""
    monkeypatch.chdir(tmp_path)
    write_mesh("mesh.npz", square())
    for gradient, told in ((0.5, False), (4.0, True)):
        write_image("t.png", encode(np.broadcast_to(unit(np.array([-gradient, 0, 1.0])), (32, 32, 3))))
        assert main(["integrate", "t.png", "--uvs", "mesh.npz", "--height", "h.exr"]) == 0
        said = capsys.readouterr().err
        assert ("and the whole mesh 1.41; was" in said) == told and "contradict" not in said


def test_normals_of_no_surface_do_not_tear_what_is_around_them() -> None:
    """Waves as steep as 45 degrees keep their height; half the wall of a round plate on them, which nothing closes on
    the other side, is left out."""
    size = 128
    x, y = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size)
    waves = 1 / (2 * np.pi * 8) * np.sin(2 * np.pi * 8 * x)
    vectors = unit(np.stack([-np.cos(2 * np.pi * 8 * x), np.zeros_like(x), np.ones_like(x)], axis=-1))
    plain = displacement(vectors.astype(np.float32), square(), margin=0).values
    assert plain == pytest.approx(waves, abs=0.06 * np.ptp(waves))
    from_wall = np.abs(np.hypot(x - 0.5, y - 0.5) - 0.2)
    wall = (from_wall < 0.02) & (x < 0.5)
    vectors[wall] = unit(np.stack([x - 0.5, 0.5 - y, np.full_like(x, 0.05)], axis=-1))[wall]
    found = displacement(vectors.astype(np.float32), square(), margin=0)
    wrong = (found.values - waves)[from_wall > 0.06] / np.ptp(waves)
    print(f"rms {wrong.std():.3f}, most {np.abs(wrong).max():.3f}, contradicted {found.contradicted:.3f}")
    assert wrong.std() < 0.25  # 0.88 where all normals are believed
    assert found.contradicted > wall.mean() / 2


def test_what_does_not_fit_is_refused() -> None:
    flat = np.broadcast_to(np.array([0, 0, 1], np.float32), (32, 32, 3))
    with pytest.raises(InputError, match="square"):
        displacement(flat[:16], cube_sphere(2))
    with pytest.raises(InputError, match=r"8192 texels a side at most, not 8193; bake a smaller texture"):
        displacement(np.broadcast_to(flat[:1, :1], (8193, 8193, 3)), cube_sphere(2))
    with pytest.raises(InputError, match="not finite"):
        displacement(np.full((32, 32, 3), np.nan, np.float32), cube_sphere(2))
    with pytest.raises(InputError, match="choose a larger texture"):
        displacement(flat, replace(cube_sphere(2), uvs=cube_sphere(2).uvs * 1e-4 + 0.5))


@pytest.mark.parametrize("far", [1e5, 1e30])
def test_uvs_far_outside_the_texture_take_no_memory(far: float) -> None:
    """The seams of one triangle leave the texture; they are sampled only within it."""
    mesh = sphere_mesh(16, 8)
    uvs = mesh.uvs.copy()
    uvs[5, 0] *= far
    size = 64
    near, moved = (len(layout_of(replace(mesh, uvs=of), size).seams().places) for of in (mesh.uvs, uvs))
    assert moved <= near + 6 * 2 * size
