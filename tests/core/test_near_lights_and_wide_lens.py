"""Lights and lens close to the object: a ball whose normals are known, for the baseline and for networks."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import trimesh
from near_scene import NEAR, SIZE, WIDE, Scene, ball
from networks import pass_through
from synthetic import CROSSTALK, degrees_between, write_file

from mpsnet_core import Camera, Capture, estimate_normals, read_normals, write_camera
from mpsnet_core.capture.open import PhotoSet, Source, read_capture
from mpsnet_core.cli import main
from mpsnet_core.errors import InputError, NoObject
from mpsnet_core.estimate.distant_lights import convert_to_distant_view
from mpsnet_core.io.image import Image
from mpsnet_core.scene.mesh import Mesh, shared_normals
from mpsnet_core.scene.rays import RayScene, depth_of_mesh
from mpsnet_core.scene.rig import LightRig, near_rig, published_rig, read_rig, write_rig

pytestmark = pytest.mark.accuracy


@pytest.fixture(scope="module")
def wide() -> Scene:
    return ball(WIDE)


@pytest.fixture(scope="module")
def close() -> Scene:
    return ball(50, NEAR)


def error(scene: Scene, model: str | Path = "lambertian", capture: Capture | None = None) -> float:
    """Mean angular error where all three lights reach: what is elsewhere no lamp tells."""
    normals = estimate_normals(capture or scene.capture(), model, passes=1)
    return float(degrees_between(normals.vectors, scene.normals)[scene.lit].mean())


# --- the baseline -----------------------------------------------------------------------------------------------------


def test_a_wide_lens_costs_the_baseline_nothing(wide: Scene) -> None:
    assert error(wide) <= error(ball(None)) + 0.01


def distant(scene: Scene) -> Capture:
    """The capture taken as if its lights were far away."""
    return Capture(scene.image, scene.mask, LightRig(scene.rig.directions, scene.rig.mixing))


@pytest.mark.parametrize(
    ("lens", "lobe", "mixing"),
    [(50, 0, None), (None, 0, None), (WIDE, 1, None), (50, 2.5, tuple(map(tuple, CROSSTALK)))],
    ids=["lens", "orthographic", "discs", "crosstalk"],
)
def test_under_near_lights_the_baseline_is_exact(lens: float | None, lobe: float, mixing: tuple | None) -> None:
    scene = ball(lens, NEAR, lobe, mixing)
    assert error(scene) < 0.02
    assert error(scene, capture=distant(scene)) > 15


# --- networks ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("near", [None, NEAR])
def test_what_a_network_sees_is_turned_and_relit_and_its_answer_turned_back(tmp_path: Path, near: float | None) -> None:
    """One that hands on the initial normals gives those that are true, whatever stands between."""
    scene = ball(WIDE, near)
    frontal = (convert_to_distant_view(scene.capture()).image > 0).all(axis=-1) & scene.lit
    normals = estimate_normals(scene.capture(), pass_through(tmp_path / "same.onnx"))
    assert frontal.sum() > 0.7 * scene.lit.sum()
    assert degrees_between(normals.vectors, scene.normals)[frontal].mean() < 0.02


def test_a_network_sees_a_ball_from_nearby_as_from_afar() -> None:
    """Seen frontally, how far from the ball's middle a line of sight passes is the sine of its normal's slant."""
    scene = ball(WIDE, NEAR)
    seen = convert_to_distant_view(scene.capture()).image
    focal, away = WIDE / 36 * SIZE, 1.04 / np.sin(np.arctan(18 / WIDE))
    x, y = np.meshgrid(np.arange(SIZE) + 0.5 - SIZE / 2, SIZE / 2 - 0.5 - np.arange(SIZE))
    from_axis = np.hypot(x, y)
    sine = away * np.sin(np.arctan(from_axis / focal))
    frontal = (seen > 0).all(axis=-1) & scene.lit & (sine < 1)
    sine = np.where(frontal, sine, 0)
    expected = np.stack([x / from_axis * sine, y / from_axis * sine, np.sqrt(1 - sine**2)], axis=-1)
    found = seen.astype(float) @ np.linalg.inv(scene.rig.directions).T
    assert frontal.sum() > 5000
    assert degrees_between(found, expected)[frontal].max() < 0.01


def test_near_lights_and_wide_lenses_are_worth_giving_to_the_default_network(close: Scene, wide: Scene) -> None:
    """Which near lights cost little."""
    near = error(close, "multiscale")
    assert near <= error(ball(50), "multiscale") + 0.4
    assert near < 0.8 * error(close, "multiscale", distant(close))
    assert error(wide, "multiscale") < error(wide, "multiscale", wide.capture(camera=None))


# --- what is known of them --------------------------------------------------------------------------------------------


def test_a_rig_file_keeps_near_lights(tmp_path: Path) -> None:
    rig = near_rig([[0, 30, -2], [-20, -10, 1], [25, -10, 0]], [1, 2, -50], CROSSTALK, lobe=1.5)
    write_rig(tmp_path / "rig.json", rig)
    back = read_rig(tmp_path / "rig.json")
    assert back.near is not None and back.near.lobe == 1.5
    np.testing.assert_allclose(back.near.positions, rig.near.positions)
    np.testing.assert_allclose(back.near.target, [1, 2, -50])
    np.testing.assert_allclose(back.directions[0], np.array([-1, 28, 48]) / np.linalg.norm([-1, 28, 48]))
    np.testing.assert_allclose(back.mixing, CROSSTALK)


def test_brightness_is_one_at_the_target_and_falls_with_the_square() -> None:
    near = near_rig([[0, 3, -1], [3, 0, -1], [-3, -3, -1]], [0, 0, -5]).near
    assert near is not None
    np.testing.assert_allclose(np.linalg.norm(near.lights_at(np.array([0, 0, -5.0])), axis=1), 1)
    half_way = np.array([0, 1.5, -3.0])  # from the target to the first light
    np.testing.assert_allclose(near.lights_at(half_way)[0], 4 * np.array([0, 3, 4]) / 5)


def ball_mesh(middle: np.ndarray, subdivisions: int = 4) -> Mesh:
    source = trimesh.creation.icosphere(subdivisions)
    vertices, triangles = np.array(source.vertices) + middle, np.array(source.faces, np.int32)
    uvs = np.broadcast_to(np.array([[0, 0], [1, 0], [0, 1.0]]), (len(triangles), 3, 2))
    return Mesh(vertices, triangles, shared_normals(vertices[triangles], triangles), uvs)


def test_the_depth_of_a_mesh_is_that_of_the_ball_it_stands_for(wide: Scene) -> None:
    pose = np.eye(4)
    pose[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    pose[:3, 3] = [7, -3, 2]
    camera = Camera("perspective", SIZE, SIZE, wide.camera.focal, world_from_camera=pose)
    mesh = ball_mesh(pose[:3, :3] @ [0, 0, -1.04 / np.sin(np.arctan(18 / WIDE))] + pose[:3, 3], 5)
    depth = depth_of_mesh(camera, RayScene.of(mesh))
    assert np.abs(depth - wide.depth)[wide.mask].max() < 0.01
    assert np.isinf(depth[0, 0])


# --- the command line -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, close: Scene) -> Path:
    folder = tmp_path_factory.mktemp("written")
    write_file(folder / "photo.exr", close.image, "float")
    write_file(folder / "mask.png", close.mask, "uint8")
    write_rig(folder / "rig.json", close.rig)
    write_camera(folder / "camera.json", close.camera)
    distance = 1.04 / np.sin(np.arctan(18 / 50))
    mesh = ball_mesh(np.array([0, 0, -distance]))
    # For the depth alone no UVs are needed.
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.triangles]
    (folder / "ball.obj").write_text("\n".join(lines))
    trimesh.Trimesh(mesh.vertices, mesh.triangles, process=False).export(folder / "ball.ply")
    return folder


@pytest.fixture
def bench(written: Path, tmp_path: Path) -> Path:
    return shutil.copytree(written, tmp_path, dirs_exist_ok=True)


def estimate(bench: Path, *arguments: str) -> int:
    words = ("photo.exr", "--rig", "rig.json", "--mask", "mask.png", *arguments)
    named = [str(bench / word) if (bench / word).is_file() else word for word in words]
    return main(["estimate", "--model", "lambertian", "--progress", "none", "-o", str(bench / "normals.exr"), *named])


@pytest.mark.parametrize(
    ("arguments", "degrees"),
    [
        (("--camera", "camera.json", "--mesh", "ball.obj"), 0.3),
        (("--camera", "camera.json", "--mesh", "ball.ply"), 0.3),
        (("--camera", "camera.json"), 12),
        (("--focal", "50", "--distance", "2.4"), 6),
    ],
    ids=["mesh", "mesh by trimesh", "target", "distance"],
)
def test_the_command_takes_camera_and_distance(bench: Path, close: Scene, arguments: tuple[str, ...], degrees: float):
    assert estimate(bench, *arguments) == 0
    found = read_normals(bench / "normals.exr").vectors
    assert degrees_between(found, close.normals)[close.lit].mean() < degrees


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((), "the rig's lights are near: give the camera"),
        (("--camera", "camera.json", "--focal", "50"), "--camera and --focal both define the lens"),
        (("--focal", "50", "--mesh", "ball.obj"), "--mesh needs --camera"),
        (("--camera", "camera.json", "--mesh", "ball.obj", "--distance", "3"), "both define how far"),
        (("--camera", "away.json", "--mesh", "ball.obj"), "away.json: the camera does not see the mesh"),
    ],
)
def test_what_does_not_fit_is_reported(bench: Path, close: Scene, capsys, arguments: tuple[str, ...], sentence: str):
    turned = np.diag([1.0, -1, -1, 1])
    write_camera(bench / "away.json", Camera("perspective", SIZE, SIZE, close.camera.focal, world_from_camera=turned))
    assert estimate(bench, *arguments) == 2
    assert sentence in capsys.readouterr().err
    assert not (bench / "normals.exr").exists()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"target": None}, 'lights with a position need a "target"'),
        ({"lobe": -1}, "the lights' lobe is a number from 0"),
        (
            {"lights": [{"position": [0, 1, 0]}, {"position": [1, 0, 0]}, {"slant": 3, "tilt": 4}]},
            "the third light needs",
        ),
        ({"lights": [{"slant": 30, "tilt": tilt} for tilt in (0, 120, 240)]}, '"target" is for lights with a'),
    ],
)
def test_near_rig_files_that_are_wrong_are_refused(tmp_path: Path, change: dict, sentence: str) -> None:
    lights = [{"position": place} for place in ([0, 3, -1], [3, 0, -1], [-3, -3, -1])]
    data = {"format": "mpsnet-rig", "version": 1, "lights": lights, "target": [0, 0, -5], **change}
    (tmp_path / "rig.json").write_text(json.dumps({key: value for key, value in data.items() if value is not None}))
    with pytest.raises(InputError, match=r"rig\.json") as refused:
        read_rig(tmp_path / "rig.json")
    assert sentence in str(refused.value)


def test_directions_that_contradict_the_positions_are_refused(close: Scene) -> None:
    with pytest.raises(InputError, match="not those from its target"):
        LightRig(published_rig(slant=40).directions, np.eye(3), close.rig.near)


@pytest.mark.parametrize("factor", [0.5, 2])
def test_the_camera_of_the_photo_at_another_size_is_scaled(bench: Path, close: Scene, capsys, factor: float) -> None:
    size = round(factor * SIZE)
    write_camera(bench / "other.json", close.camera.resized(size, size))
    found = []
    for camera in ("camera.json", "other.json"):
        assert estimate(bench, "--camera", camera, "--mesh", "ball.obj") == 0
        found.append(read_normals(bench / "normals.exr"))
    assert f"the camera is for {size} x {size} pixels and the photo has {SIZE} x {SIZE}" in capsys.readouterr().err
    both = found[0].mask & found[1].mask
    assert degrees_between(found[1].vectors, found[0].vectors)[both].mean() < 0.3


def test_a_frame_without_the_object_is_known_as_one_to_leave_out(close: Scene) -> None:
    image = Image(close.image.astype(np.float32), np.zeros(close.mask.shape, np.float32), np.inf)
    with pytest.raises(NoObject):
        PhotoSet().open(Source(lambda: image, close.rig, camera=close.camera, depth=close.depth.astype(np.float32)))


def test_a_mesh_elsewhere_in_the_picture_is_refused(bench: Path, close: Scene) -> None:
    depth = np.full_like(close.depth, np.inf)
    depth[0, 0] = 3
    with pytest.raises(InputError, match="sees nothing of the mesh inside the mask"):
        read_capture(bench / "photo.exr", close.rig, mask=str(bench / "mask.png"), camera=close.camera, depth=depth)


@pytest.mark.parametrize(("distance", "told"), [("3.1", False), ("3100", True), ("1.2", True)])
def test_another_unit_is_reported(bench: Path, capsys: pytest.CaptureFixture[str], distance: str, told: bool) -> None:
    assert estimate(bench, "--focal", "50", "--distance", distance) == 0
    assert ("in the same unit?" in capsys.readouterr().err) == told
