"""Lights from a photo of a known mesh: a bumpy ball in a perspective view, shaded by hand, with shadows and paints."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mpsnet_core import CalibrateMesh, Camera, GeometryError, Scan, read_camera, read_rig, write_camera, write_image

SIDE = 160
POSE = np.array([[0.0, 0, 1, 6], [1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, 0, 1]])  # looks along -x; z is up
CAMERA = Camera("perspective", SIDE, SIDE, np.array([2.2 * SIDE] * 2), None, POSE)
LIGHTS = np.array([[0.5, 0.3, 0.81], [-0.6, 0.35, 0.72], [0.1, -0.62, 0.78]])
LIGHTS /= np.linalg.norm(LIGHTS, axis=1, keepdims=True)
CROSSTALK = np.array([[1, 0.15, 0.02], [0.1, 1, 0.12], [0.03, 0.2, 1]])


@pytest.fixture(scope="module")
def bumpy(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, trimesh.Trimesh]:
    """A ball with bumps that cast shadows, and the file of a smoothed copy."""
    mesh = trimesh.creation.icosphere(subdivisions=5)
    x, y, z = mesh.vertices.T
    mesh.vertices *= (1 + 0.16 * np.sin(4 * x + 1) * np.sin(5 * y) * np.sin(4 * z + 2))[:, None]
    smooth = mesh.copy()
    for _ in range(4):  # by hand, as trimesh's own needs SciPy
        total = np.zeros_like(smooth.vertices)
        for one, other in (smooth.edges_unique.T, smooth.edges_unique.T[::-1]):
            np.add.at(total, one, smooth.vertices[other])
        smooth.vertices = total / np.bincount(smooth.edges_unique.ravel())[:, None]
    file = tmp_path_factory.mktemp("mesh") / "bumpy.ply"
    smooth.export(file)
    return file, mesh


def shaded(mesh: trimesh.Trimesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(H, W, 3) light that arrives from each lamp, (H, W) where the mesh is, and (H, W, 3) its points."""
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    origins, directions = CAMERA.rays(np.stack([x, y], axis=-1).reshape(-1, 2))
    points, rays, faces = mesh.ray.intersects_location(origins, directions, multiple_hits=False)
    corners = trimesh.triangles.points_to_barycentric(mesh.triangles[faces], points)
    normals = np.einsum("pc,pci->pi", corners, mesh.vertex_normals[mesh.faces[faces]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    towards = LIGHTS @ POSE[:3, :3].T
    light = np.maximum(normals @ towards.T, 0)
    for lamp, direction in enumerate(towards):
        rays_of_lamp = np.broadcast_to(direction, points.shape)
        light[mesh.ray.intersects_any(points + 2e-3 * normals, rays_of_lamp), lamp] = 0
    arrived, mask, places = np.zeros((SIDE * SIDE, 3)), np.zeros(SIDE * SIDE, bool), np.zeros((SIDE * SIDE, 3))
    arrived[rays], mask[rays], places[rays] = light, True, points
    return tuple(one.reshape(SIDE, SIDE, -1).squeeze() for one in (arrived, mask, places))


@pytest.mark.parametrize("paint", ["grey", "two paints", "textured"])
def test_lights_and_crosstalk_are_found(bumpy: tuple[Path, trimesh.Trimesh], tmp_path: Path, paint: str) -> None:
    file, mesh = bumpy
    arrived, mask, points = shaded(mesh)
    photo = arrived @ (np.array([0.9, 0.7, 0.6])[:, None] * CROSSTALK).T
    if paint == "two paints":
        photo *= np.where(points[..., 1:2] > 0.2, (0.3, 0.6, 1.0), 1.0)
    elif paint == "textured":
        photo *= np.exp(0.3 * np.sin(9 * points[..., :1] + 7 * points[..., 2:]))
    write_image(tmp_path / "photo.exr", np.concatenate([photo, mask[..., None]], axis=-1).astype(np.float32))
    write_camera(tmp_path / "camera.json", CAMERA)
    rig, facts = tmp_path / "rig.json", tmp_path / "facts.json"
    CalibrateMesh(
        image=str(tmp_path / "photo.exr"),
        mesh=str(file),
        camera=str(tmp_path / "camera.json"),
        output=str(rig),
        json=str(facts),
    ).run()
    found = read_rig(rig)
    off = np.degrees(np.arccos(np.clip((found.directions * LIGHTS).sum(axis=1), -1, 1)))
    stated = [light["uncertainty"] for light in json.loads(facts.read_text())["lights"]]
    print(paint, off, stated)
    assert off.max() < 1.5
    assert np.abs(found.mixing - CROSSTALK).max() < 0.08
    assert (off < 4 * np.array(stated) + 0.3).all()


def test_three_photos_of_one_white_light_each(bumpy: tuple[Path, trimesh.Trimesh], tmp_path: Path) -> None:
    file, mesh = bumpy
    arrived, mask, points = shaded(mesh)
    paint = np.where(points[..., :1] > 0.1, (0.3, 0.6, 0.9), (0.8, 0.5, 0.2))
    photos = [tmp_path / f"{name}.exr" for name in "abc"]
    for lamp, photo in enumerate(photos):
        seen = [arrived[..., lamp, None] * paint * (1, 0.7, 0.8)[lamp], mask[..., None]]
        write_image(photo, np.concatenate(seen, axis=-1).astype(np.float32))
    write_camera(tmp_path / "camera.json", CAMERA)
    CalibrateMesh(
        image=tuple(map(str, photos)),
        per_light=True,
        mesh=str(file),
        camera=str(tmp_path / "camera.json"),
        output=str(tmp_path / "rig.json"),
    ).run()
    found = read_rig(tmp_path / "rig.json")
    off = np.degrees(np.arccos(np.clip((found.directions * LIGHTS).sum(axis=1), -1, 1)))
    print(off)
    assert off.max() < 1.5
    assert np.array_equal(found.mixing, np.eye(3))


def test_a_camera_that_looks_elsewhere_is_refused(bumpy: tuple[Path, trimesh.Trimesh], tmp_path: Path) -> None:
    write_image(tmp_path / "photo.exr", np.full((SIDE, SIDE, 3), 0.5, np.float32))
    aside = POSE.copy()
    aside[1, 3] = 5
    write_camera(tmp_path / "camera.json", Camera("perspective", SIDE, SIDE, CAMERA.focal, None, aside))
    with pytest.raises(GeometryError, match="mesh"):
        CalibrateMesh(
            image=str(tmp_path / "photo.exr"),
            mask="none",
            mesh=str(bumpy[0]),
            camera=str(tmp_path / "camera.json"),
            output=str(tmp_path / "rig.json"),
        ).run()


@pytest.mark.long
def test_a_photo_and_a_scan_suffice(bumpy: tuple[Path, trimesh.Trimesh], tmp_path: Path) -> None:
    """`scan`: neither camera nor lights are given."""
    arrived, mask, _ = shaded(bumpy[1])
    photo = np.concatenate([arrived @ CROSSTALK.T, mask[..., None]], axis=-1)
    write_image(tmp_path / "photo.exr", photo.astype(np.float32))
    smooth = trimesh.load(bumpy[0])
    x, y, z = smooth.vertices.T / np.linalg.norm(smooth.vertices, axis=1)
    uvs = np.stack([np.arctan2(y, x) / (2 * np.pi) + 0.5, np.arccos(z) / np.pi], axis=1)
    lines = [f"v {a} {b} {c}" for a, b, c in smooth.vertices] + [f"vt {u} {v}" for u, v in uvs]
    lines += ["f " + " ".join(f"{corner}/{corner}" for corner in face) for face in smooth.faces + 1]
    (tmp_path / "scan.obj").write_text("\n".join(lines))
    made = Scan(
        image=str(tmp_path / "photo.exr"), mesh=str(tmp_path / "scan.obj"), size="256", output=str(tmp_path / "out")
    ).run()
    turn = read_camera(made.camera).rotation.T @ POSE[:3, :3]
    assert np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))) < 2
    assert np.degrees(np.arccos((read_rig(made.rig).directions * LIGHTS).sum(axis=1).clip(-1, 1))).max() < 4
    assert all(Path(file).is_file() for file in made.outputs)
