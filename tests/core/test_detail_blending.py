"""Detail laid onto a normal map that is there, and the strength of detail, where the answer is known."""

from pathlib import Path

import numpy as np
import pytest
from eight_views import turn, unit
from mesh_file import write_mesh
from surface_shapes import camera_looking, sphere_mesh, sphere_view
from synthetic import degrees_between, write_file

from mpsnet_core import Mesh, NormalMap, Texture, View, bake_normals, write_camera, write_normals
from mpsnet_core.bake.base_maps import blend_detail, read_base_map, reoriented
from mpsnet_core.cli import main
from mpsnet_core.scene.normal_encoding import encode

FLAT = np.array([0, 0, 1.0])


def outwards(count: int, seed: int, steepest: float = 70) -> np.ndarray:
    """(N, 3) float32 unit vectors up to so many degrees from +z."""
    rng = np.random.default_rng(seed)
    slant, tilt = np.radians(rng.uniform(0, steepest, count)), rng.uniform(0, 2 * np.pi, count)
    return np.stack([np.sin(slant) * np.cos(tilt), np.sin(slant) * np.sin(tilt), np.cos(slant)], 1).astype(np.float32)


def texture_of(vectors: np.ndarray, space: str = "tangent") -> Texture:
    there = np.ones(vectors.shape[:2], bool)
    return Texture(vectors.astype(np.float32), there, there, space)


def waves(size: int, count: int = 3, height: float = 0.3) -> np.ndarray:
    """(S, S, 3) smooth unit normals, the same relief at every size."""
    v, u = np.mgrid[:size, :size] + 0.5
    u, v = 2 * np.pi * count * u / size, 2 * np.pi * count * v / size
    return unit(np.stack([height * np.sin(u), height * np.cos(v), np.ones_like(u)], -1)).astype(np.float32)


def test_the_detail_is_turned_by_the_rotation_from_flat_to_the_base() -> None:
    """Against rotation matrices by the axis and angle between +z and each base."""
    detail, base = outwards(60, 0), outwards(60, 1)
    angles = degrees_between(base, FLAT)
    expected = [turn(np.cross(FLAT, b), a) @ d for b, a, d in zip(base, angles, detail, strict=True)]
    assert degrees_between(reoriented(detail, base), np.array(expected)).max() < 0.05


@pytest.mark.parametrize("size", [96, 256, 100])
def test_a_present_map_of_any_size_goes_under_the_texture(size: int) -> None:
    flat = np.broadcast_to(FLAT, (128, 128, 3))
    laid = blend_detail(texture_of(flat), waves(size))
    assert degrees_between(laid.vectors, waves(128)).max() < 1.0


@pytest.mark.parametrize("background", [(0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5), None], ids=str)
def test_what_surrounds_the_islands_is_no_normal(background: tuple[float, ...] | None, tmp_path: Path) -> None:
    """It stays out of the islands when the map is resampled: their own border goes on beyond them."""
    colours = encode(np.broadcast_to(unit(np.array([0.5, 0, 1])), (64, 64, 3)))
    island = np.zeros((64, 64), bool)
    island[16:40, 8:44] = True
    if background is None:
        colours = np.where(island[..., None], colours, (0.9, 0.2, 0.2))  # clear, and no colour of a normal
        path = write_file(tmp_path / "map.png", np.dstack([colours, island]), "uint8", oiio__UnassociatedAlpha=1)
    else:
        path = write_file(tmp_path / "map.png", np.where(island[..., None], colours, background), "uint8")
    laid = blend_detail(texture_of(np.broadcast_to(FLAT, (160, 160, 3))), read_base_map(path))
    inside = island.repeat(5, 0).repeat(5, 1)[::2, ::2]
    assert degrees_between(laid.vectors, [0.5, 0, 1])[inside].max() < 0.6
    assert degrees_between(laid.vectors[-1, -1], FLAT) < 0.6


def square(size: int = 64) -> tuple[Mesh, View]:
    """A square that faces +z and a camera right above it; the view says it leans by a known slope."""
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = Mesh(vertices, triangles, np.tile(FLAT, (2, 3, 1)), (vertices[triangles][..., :2] + 1) / 2)
    leaning = np.broadcast_to(unit(np.array([0.3, -0.2, 1])), (size, size, 3))
    return mesh, View(camera_looking((0, 0, 1), size=size), NormalMap(leaning, np.ones((size, size), bool)))


@pytest.mark.parametrize("space", ["tangent", "object"])
@pytest.mark.parametrize("strength", [0.0, 0.5, 1.0, 1.7])
def test_slopes_scale_with_the_strength(strength: float, space: str) -> None:
    mesh, view = square()
    texture = bake_normals(mesh, [view], size=32, space=space, strength=strength)
    slopes = texture.vectors[..., :2] / texture.vectors[..., 2:]
    # On this square, object space and tangent space are one.
    in_camera = view.camera.rotation @ view.normals.vectors[0, 0]
    assert slopes == pytest.approx(np.broadcast_to(strength * in_camera[:2] / in_camera[2], slopes.shape), abs=1e-4)


class Bench:
    """`mpsnet bake` of a sphere whose view shows bumps, onto maps that lie in the same folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        view = sphere_view(camera_looking((1, 0, 0), size=128))
        y, x = np.mgrid[:128, :128]
        bumps = 0.3 * np.stack([np.sin(x / 3), np.sin(y / 3), np.zeros_like(x)], -1) * view.normals.mask[..., None]
        write_camera(folder / "camera.json", view.camera)
        write_normals(folder / "normals.exr", NormalMap(view.normals.vectors + bumps, view.normals.mask))
        write_mesh(folder / "mesh.npz", sphere_mesh(48, 24))

    def bake(self, *arguments: str | Path, output: str = "out.exr") -> int:
        view = f"{self.folder / 'camera.json'}={self.folder / 'normals.exr'}"
        good = ["bake", "--mesh", self.folder / "mesh.npz", "--view", view, "--size", "128", "--margin", "2"]
        return main([str(word) for word in [*good, "-o", self.folder / output, *arguments]])

    def baked(self, *arguments: str | Path) -> np.ndarray:
        assert self.bake(*arguments) == 0
        return read_base_map(self.folder / "out.exr")

    def map(self, vectors: np.ndarray, name: str = "present.png") -> Path:
        return write_file(self.folder / name, 0.5 + 0.5 * vectors, "uint16")


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_on_the_command_line_the_map_stays_and_the_detail_is_added(bench: Bench) -> None:
    present = waves(96, 2)
    alone, detail = waves(128, 2), bench.baked("--level", "on")
    laid = bench.baked("--onto", bench.map(present))
    seen = degrees_between(detail, FLAT) > 0.01
    assert 0.2 < seen.mean() < 0.6
    assert degrees_between(laid, alone)[~seen].max() < 1.0  # where the photo does not see
    assert degrees_between(laid, alone)[seen].mean() > 5  # the detail is there
    # As much detail as without a map, and about it: rotations keep angles.
    assert degrees_between(laid, alone)[seen].mean() == pytest.approx(
        degrees_between(detail, FLAT)[seen].mean(), rel=0.1
    )
    assert degrees_between(laid, reoriented(detail, alone)).mean() < 0.3


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--onto", "good", "--space", "object"], "bake in tangent space"),
        (["--onto-shown", "yes"], "--onto-convention and --onto-shown describe the map of --onto"),
        (["--onto-convention", "directx"], "--onto-convention and --onto-shown describe the map of --onto"),
        (["--onto", "photo"], "photo.png is not a normal map: its colours are not unit vectors"),
        (["--onto", "object"], "object.png is not in tangent space"),
        (["--onto", "out"], "the result would overwrite"),
    ],
    ids=lambda given: " ".join(given) if isinstance(given, list) else "",
)
def test_bad_input_gets_one_sentence(arguments: list[str], sentence: str, bench: Bench, capsys) -> None:
    rng = np.random.default_rng(0)
    bench.map(waves(64), "good.png")
    bench.map(waves(64), "out.png")
    photo = np.clip(rng.normal([0.5, 0.4, 0.3], 0.08, (64, 64, 3)), 0, 1)
    write_file(bench.folder / "photo.png", photo, "uint8")
    bench.map(unit(rng.normal(size=(64, 64, 3))), "object.png")
    before = (bench.folder / "out.png").read_bytes()
    given = [
        str(bench.folder / f"{word}.png") if flag == "--onto" else word
        for flag, word in zip(["", *arguments], arguments, strict=False)
    ]
    assert bench.bake(*given, output="out.png") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert sentence in line
    assert (bench.folder / "out.png").read_bytes() == before
