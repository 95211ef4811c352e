"""Heights on UDIM tiles: those of the same surface in one texture, tile by tile."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bumpy_sphere import AMPLITUDE, bumpy_sphere
from mesh_file import write_mesh
from relief_shapes import cube_sphere, tangent_normals
from uv_squares import squares

from mpsnet_core import InputError, Mesh, read_height, write_image
from mpsnet_core.cli import main
from mpsnet_core.io.image_reading import read_channel
from mpsnet_core.relief.displacement.uv_layout import Tiles
from mpsnet_core.scene.normal_encoding import encode

SIZE = 64
# Where the unit square's quarters go, from the lower left on: row by row, and not in their order.
NEXT_TO_EACH_OTHER = {(0, 0): 1001, (1, 0): 1002, (0, 1): 1011, (1, 1): 1012}
ANYWHERE = {(0, 0): 1024, (1, 0): 1001, (0, 1): 1002, (1, 1): 1015}


def in_quarters(mesh: Mesh, tiles: dict[tuple[int, int], int]) -> Mesh:
    """The mesh with each quarter of its texture as a tile; a triangle is in the one that holds its middle."""
    of_triangle = np.floor(mesh.uvs.mean(axis=1) * 2).astype(int)
    corner = np.array([divmod(tiles[u, v] - 1001, 10)[::-1] for u, v in of_triangle.tolist()])
    return replace(mesh, uvs=mesh.uvs * 2 - of_triangle[:, None] + corner[:, None], given_tangents=mesh.tangents)


def quarter(values: np.ndarray, u: int, v: int) -> np.ndarray:
    return values[(1 - v) * SIZE : (2 - v) * SIZE, u * SIZE : (u + 1) * SIZE]


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with a mesh and its normals in one texture, and in tiles laid out in both ways."""
    monkeypatch.chdir(tmp_path)
    mesh = cube_sphere(8)
    vectors = tangent_normals(mesh, 2 * SIZE, lambda points, _: bumpy_sphere(points))
    write_mesh("one.npz", mesh)
    write_image("one.exr", encode(vectors))
    for name, tiles in (("a", NEXT_TO_EACH_OTHER), ("b", ANYWHERE)):
        write_mesh(f"{name}.npz", in_quarters(mesh, tiles))
        for (u, v), tile in tiles.items():
            write_image(f"{name}_{tile}.exr", encode(quarter(vectors, u, v)))


@pytest.fixture
def one(files: None) -> np.ndarray:
    """The heights in one texture."""
    assert main(["integrate", "one.exr", "--uvs", "one.npz", "--height", "whole.exr"]) == 0
    return read_channel("whole.exr")


@pytest.mark.parametrize(("name", "tiles"), [("a", NEXT_TO_EACH_OTHER), ("b", ANYWHERE)])
def test_tiles_have_the_heights_of_one_texture(one: np.ndarray, name: str, tiles: dict[tuple[int, int], int]) -> None:
    """Wherever the tiles lie: seams between them hold as those within do."""
    command = ["integrate", f"{name}_<UDIM>.exr", "--uvs", f"{name}.npz", "--base", f"{name}.npz"]
    assert main([*command, "--height", "h_<UDIM>.exr"]) == 0
    assert sorted(file.name for file in Path().glob("h_*.exr")) == sorted(f"h_{tile}.exr" for tile in tiles.values())
    for (u, v), tile in tiles.items():
        apart = np.abs(read_channel(f"h_{tile}.exr") - quarter(one, u, v))
        assert np.quantile(apart, 0.98) < 0.02 * AMPLITUDE and apart.max() < AMPLITUDE  # the margin is another


def test_in_16_bits_all_tiles_have_one_scale(one: np.ndarray, capsys: pytest.CaptureFixture[str]) -> None:
    """A displacement has one strength and one midlevel, whatever the tile."""
    assert main(["integrate", "b_<UDIM>.exr", "--uvs", "b.npz", "--height", "h_<UDIM>.png"]) == 0
    assert capsys.readouterr().out.count("strength") == 1
    scales = {Path(f"h_{tile}.png.json").read_text("utf-8").split('"displace"')[1] for tile in ANYWHERE.values()}
    assert len(scales) == 1
    for (u, v), tile in ANYWHERE.items():
        read = read_height(f"h_{tile}.png").values
        assert np.quantile(np.abs(read - quarter(one, u, v)), 0.98) < 0.02 * AMPLITUDE


@pytest.mark.parametrize(
    ("texture", "height", "words"),
    [
        ("b_<UDIM>.exr", "h.exr", "b_<UDIM>.exr means a file for each UDIM tile, and h.exr one for all"),
        ("b_1001.exr", "h_<UDIM>.exr", "put <UDIM> into both"),
        ("c_<UDIM>.exr", "h_<UDIM>.exr", "c_1001.exr does not exist"),
        ("b_<UDIM>.exr", "b_<UDIM>.exr", "would overwrite b_1001.exr"),
        ("b_<UDIM>.exr", "no/h_<UDIM>.exr", "the folder no does not exist"),
        ("b_<UDIM>.exr", "h_<UDIM>_<OBJECT>.exr", "has <OBJECT>, but the textures are not split that way"),
    ],
)
def test_bad_input_is_one_sentence(files: None, texture: str, height: str, words: str, capsys) -> None:
    before = sorted(Path().iterdir())
    assert main(["integrate", texture, "--uvs", "b.npz", "--height", height]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and words in said
    assert sorted(Path().iterdir()) == before


def test_a_tile_that_the_bake_leaves_out_is_not_needed(files: None, capsys: pytest.CaptureFixture[str]) -> None:
    """Islands that reach into the next tiles by a tenth of a texel, and by six."""
    write_image("c_1001.exr", encode(np.broadcast_to([0.0, 0, 1], (SIZE, SIZE, 3))))
    command = ["integrate", "c_<UDIM>.exr", "--uvs", "c.npz", "--height", "h_<UDIM>.exr"]
    write_mesh("c.npz", squares((0, 0), side=1 + 0.1 / SIZE))
    assert main(command) == 0 and [file.name for file in Path().glob("h_*.exr")] == ["h_1001.exr"]
    write_mesh("c.npz", squares((0, 0), side=1.1))
    assert main(command) == 2 and "c_1002.exr does not exist" in capsys.readouterr().err


def test_tiles_of_several_sizes_are_refused(files: None, capsys: pytest.CaptureFixture[str]) -> None:
    write_image("b_1015.exr", encode(np.broadcast_to([0.0, 0, 1], (16, 16, 3))))
    assert main(["integrate", "b_<UDIM>.exr", "--uvs", "b.npz", "--height", "h_<UDIM>.exr"]) == 2
    assert "the tiles' textures have several sizes, 16 x 16 and 64 x 64; bake them all" in capsys.readouterr().err


def test_tiles_that_are_too_many_are_refused_when_one_is_read() -> None:
    """Before the others, and the texture of them all, take up memory."""

    def textures() -> Iterator[np.ndarray]:
        yield np.zeros((1025, 1025, 3), np.float32)
        pytest.fail("another one was read")

    with pytest.raises(InputError, match=r"50 tiles of 1025 texels a side are too many .* 1024 at most"):
        Tiles(np.zeros((50, 2), np.int64)).joined(textures())
