"""What no view sees and is filled, where the truth is known: a dome's normals on a plate change evenly."""

import json
from pathlib import Path

import numpy as np
import pytest
from mesh_file import write_mesh
from surface_shapes import camera_looking, texels_of
from synthetic import degrees_between

from mpsnet_core import BakeSettings, Mesh, NormalMap, write_camera, write_normals
from mpsnet_core.bake import fill
from mpsnet_core.bake.bake import View, bake_normals, bake_texture_sets
from mpsnet_core.cli import main
from mpsnet_core.io.image_reading import read_channel
from mpsnet_core.scene.texture_sets import texture_sets

SIZE = 96
RADIUS = 2.5


def dome(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(..., 3) the unit normals of a sphere's cap above (x, y)."""
    return np.stack([x, y, np.sqrt(RADIUS**2 - x**2 - y**2)], axis=-1) / RADIUS


def plates(*left: float) -> Mesh:
    """Squares of side 1 in z = 0 whose left edges are at these x, y from 0 to 1, their fronts at +z.

    Each is an island that fills its share of the texture's width, side by side without a gap.
    """
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    triangles = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * number for number in range(len(left))])
    places = np.concatenate([corners + np.array([x, 0]) for x in left])
    uvs = np.concatenate([(corners + np.array([number, 0])) / (len(left), 1) for number in range(len(left))])
    vertices = np.concatenate([places, np.zeros((len(places), 1))], axis=1)
    return Mesh(vertices, triangles, np.broadcast_to([0.0, 0.0, 1.0], (len(triangles), 3, 3)), uvs[triangles])


def view_of_dome(hole: float) -> View:
    """From above, (0.5, 0.5) in the middle; of a disc of radius `hole` around it the mask knows nothing."""
    camera = camera_looking((0, 0, 1), size=400, target=(0.5, 0.5, 0), reach=0.6)
    place = (np.arange(400) + 0.5) / 400 * 1.2 - 0.6
    x, y = np.meshgrid(place, place)
    # The camera's axes: its x may point anywhere in the plane, so the field is asked for in the world's.
    world = np.stack([x, -y], axis=-1) @ camera.rotation[:2, :2].T
    mask = np.hypot(x, y) > hole
    return View(camera, NormalMap(dome(world[..., 0], world[..., 1]) @ camera.rotation, mask))


def on_texels() -> np.ndarray:
    """(S, S, 3) the truth on one plate's texture."""
    place = (np.arange(SIZE) + 0.5) / SIZE - 0.5
    return dome(*np.meshgrid(place, -place))


@pytest.fixture(params=[(256, 0.1), (40, 0.3)], ids=["at once", "coarse to fine"])
def most(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> float:
    """Degrees that the filling may err by: solved at once, and as large textures are, in blocks first."""
    blocks, degrees = request.param
    monkeypatch.setattr(fill, "BLOCKS", blocks)
    return float(degrees)


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("hole", [0.1, 0.4])
def test_a_hole_continues_the_relief_around_it(samples: int, hole: float, most: float) -> None:
    view = view_of_dome(hole)
    settings = {"size": SIZE, "samples": samples, "margin": 0}
    bare, filled = (bake_normals(plates(0.0), [view], **settings, fill=filling) for filling in (False, True))
    assert filled.filled is not None and bare.filled is None
    assert (filled.seen == bare.seen).all() and (filled.filled == ~filled.seen).all()
    assert filled.filled.mean() == pytest.approx(np.pi * hole**2, rel=0.15)
    if samples == 1:
        assert (filled.vectors[filled.seen] == bare.vectors[filled.seen]).all()
    assert np.linalg.norm(filled.vectors, axis=-1) == pytest.approx(1, abs=1e-5)
    # Before, what was not seen was flat: off by up to asin(hole / RADIUS).
    assert degrees_between(filled.vectors, on_texels()).max() < most
    assert degrees_between(bare.vectors, on_texels())[filled.filled].max() > 0.9 * np.degrees(np.arcsin(hole / RADIUS))


def test_what_reaches_the_plates_edge_goes_on_to_it() -> None:
    """Half of the plate unseen: no steeper than what borders on it, and all of it filled."""
    view = view_of_dome(0.0)
    mask = view.normals.mask.copy()
    mask[:, 200:] = False
    half = bake_normals(plates(0.0), [View(view.camera, NormalMap(view.normals.vectors, mask))], size=SIZE, fill=True)
    assert half.filled is not None and half.filled.mean() == pytest.approx(0.5, abs=0.02)
    beyond, before = half.vectors[half.filled][:, :2], half.vectors[half.seen][:, :2]
    assert (beyond.max(axis=0) <= before.max(axis=0) + 1e-3).all()
    assert (beyond.min(axis=0) >= before.min(axis=0) - 1e-3).all()
    assert np.ptp(beyond[:, 1]) > 0.1  # along the rim it changes as the rim does


@pytest.mark.usefixtures("most")
def test_nothing_reaches_another_island() -> None:
    """The second plate borders on the first in the texture alone: no view sees it, and it stays flat."""
    texture = bake_normals(plates(0.0, 3.0), [view_of_dome(0.2)], size=SIZE, margin=0, fill=True)
    first, second = np.s_[:, : SIZE // 2], np.s_[:, SIZE // 2 :]
    assert texture.filled is not None
    assert (texture.seen | texture.filled)[first].all()
    assert not texture.filled[second].any() and (texture.vectors[second] == [0, 0, 1]).all()
    assert texture.seen_fraction == pytest.approx(0.5 * (1 - np.pi * 0.04), abs=0.01)
    assert texture.filled_fraction == pytest.approx(0.5 * np.pi * 0.04, abs=0.01)


@pytest.mark.parametrize("corner", [0, 1], ids=["the first tile", "the next tile"])
def test_relief_and_colours_go_on_across_a_seam_into_an_island_that_lies_another_way(corner: int, most: float) -> None:
    """A plate cut in two: its right half lies turned by a quarter, and mirrored, in the texture, and nobody sees it.

    It is filled as on the plate in one piece, where its two halves lie beside each other."""
    corners = np.array([[0, 0], [0.5, 0], [0.5, 1], [0, 1], [1, 0], [1, 1.0]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
    vertices = np.concatenate([corners, np.zeros((6, 1))], axis=1)
    whole = corners[triangles]
    cut = whole * 0.45 + (0.02, 0.05)
    cut[2:] = (whole[2:, :, ::-1] - (0, 0.5)) * 0.45 + (0.48, 0.3)  # mirrored: (x, y) lies at (y, x)
    view = view_of_dome(0.0)
    across = (np.arange(400) - 199.5) * 0.003
    shown = np.add.outer(-view.camera.rotation[0, 1] * across, view.camera.rotation[0, 0] * across) < 0
    colours = np.where(shown[..., None], 0.5 + 0.3 * (view.normals.vectors @ view.camera.rotation.T), np.nan)
    half = View(view.camera, NormalMap(view.normals.vectors, shown), colours.astype(np.float32))
    found = []
    for uvs in (whole, cut + np.array([corner, 0])):
        mesh = Mesh(vertices, triangles, np.broadcast_to([0.0, 0.0, 1.0], (4, 3, 3)), uvs)
        at = (corner, 0) if uvs is not whole else (0, 0)
        (chosen,) = (one for one in texture_sets([mesh], tiles=True) if one.corner == at)
        ((_, texture),) = bake_texture_sets([mesh], [half], [chosen], BakeSettings(2 * SIZE, margin=0, fill=True))
        texels = texels_of(mesh.uvs - np.array(at), 2 * SIZE)
        place, points = tuple(texels.place.T), texels.of(mesh.vertices[mesh.triangles])
        assert texture.colours is not None and (texture.seen | texture.filled)[place].all()
        x, y, z = texture.vectors[place].T
        mirrored = (points[:, 0] > 0.5) & (uvs is not whole)
        normals = np.stack([np.where(mirrored, y, x), np.where(mirrored, x, y), z], axis=-1)
        away = points[:, 0] > 0.55
        found.append((points[away], np.concatenate([normals, texture.colours[place][:, :3]], axis=-1)[away]))
    (points, one), (others, other) = found
    nearest = [int(np.argmin(((points - point) ** 2).sum(axis=1))) for point in others[::50]]
    assert degrees_between(one[nearest, :3], other[::50, :3]).max() < most + 1.0
    assert np.abs(one[nearest, 3:] - other[::50, 3:]).max() < 0.02
    assert degrees_between(other[:, :3], np.array([0, 0, 1.0])).mean() > 2  # flat before


def test_the_command_reports_what_it_filled(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    view = view_of_dome(0.3)
    write_camera(tmp_path / "camera.json", view.camera)
    write_normals(tmp_path / "n_1.png", view.normals)
    write_normals(tmp_path / "n_2.png", view.normals)
    write_mesh(tmp_path / "mesh.npz", plates(0.0))

    def bake(*more: str, normals: str = "n_1.png", output: str = "t.png") -> tuple[int, dict, str]:
        view = f"{tmp_path / 'camera.json'}={tmp_path / normals}"
        made = [*more, "--mesh", str(tmp_path / "mesh.npz"), "--size", str(SIZE), "-o", str(tmp_path / output)]
        code = main(["bake", "--view", view, "--progress", "json", *made])
        out, err = capsys.readouterr()
        return code, json.loads(out.splitlines()[-1]).get("result", {}), err

    share = np.pi * 0.09
    _, bare, _ = bake()
    assert "filled" not in bare and "filled" not in bare["outputs"][0]
    _, filled, _ = bake("--fill", "--coverage", str(tmp_path / "seen"))
    assert filled["seen"] == bare["seen"] == pytest.approx(1 - share, abs=0.02)
    assert filled["filled"] == filled["outputs"][0]["filled"] == pytest.approx(share, abs=0.02)
    assert filled["outputs"][0]["coverage"] == str(tmp_path / "seen" / "t.png")
    levels, counts = np.unique(read_channel(tmp_path / "seen" / "t.png"), return_counts=True)
    assert levels == pytest.approx([0.5, 1], abs=0.005)  # 8 bits
    assert counts / SIZE**2 == pytest.approx([filled["filled"], filled["seen"]], abs=1e-3)
    _, frames, _ = bake("--fill", normals="n_#.png", output="frames")
    assert frames["filled"] == filled["filled"] and frames["seen"] == filled["seen"]
    code, _, said = bake("--fill", "--space", "object")
    assert code == 2 and "only a texture in tangent space can be filled" in said
    code, _, said = bake("--coverage", str(tmp_path))
    assert code == 2 and "would overwrite" in said
    code, _, said = bake("--coverage", "seen", normals="n_#.png", output="frames")
    assert code == 2 and "--coverage is for a single pose" in said
