"""Height files: what is written comes back, the scale is stated where people and programs look, and nothing spikes."""

import json
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from height_shapes import Surface, ball, orthographic, plane
from synthetic import listing, write_file

from mpsnet_core import Camera, FileError, HeightMap, InputError, read_height, write_height

POSE = np.array([[0, 0, 1, 2.0], [1, 0, 0, 3], [0, 1, 0, 4], [0, 0, 0, 1]])
BALL = ball(orthographic(40, 50, 11.0, POSE), (0.2, -0.3, 0), 1.7)
NEAR = ball(Camera("perspective", 50, 40, (60.0, 61.0), (20.0, 22.0), POSE), (0.1, 0, -5), 1.5)
SURFACES = pytest.mark.parametrize("surface", [BALL, NEAR], ids=["from afar", "from near"])


def stored(path: Path) -> np.ndarray:
    """(H, W, C) values as they are in the file."""
    return oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)


@SURFACES
@pytest.mark.parametrize(("name", "bits"), [("h.exr", None), ("h.tif", 32), ("h.png", None), ("h.tif", 16)])
def test_heights_come_back(tmp_path: Path, surface: Surface, name: str, bits: int | None) -> None:
    scale = write_height(tmp_path / name, surface.heights, bits=bits, unit="mm")
    found = read_height(tmp_path / name)
    step = 0 if bits == 32 or name == "h.exr" else (scale.white - scale.black) / 65535
    off = np.abs(found.values - surface.heights.values)[surface.mask]
    assert off.max() <= step / 2 * 1.001 + np.abs(surface.heights.values).max() * (1e-7 if step else 0)
    assert (found.mask == surface.mask).all()
    assert found.camera.projection == surface.camera.projection
    for what in ("focal", "centre", "world_from_camera"):
        assert getattr(found.camera, what) == pytest.approx(getattr(surface.camera, what))
    assert listing(tmp_path) == [name, f"{name}.json", f"{name}.mask.png"]


def test_sixteen_bits_span_the_range_and_say_so(tmp_path: Path) -> None:
    scale = write_height(tmp_path / "h.png", BALL.heights, unit="mm")
    values, inside = stored(tmp_path / "h.png"), BALL.mask
    assert values.shape == (40, 50, 1)  # no alpha: Blender would multiply by it
    assert values[inside].min() == 0 and values[inside].max() == 1
    data = json.loads((tmp_path / "h.png.json").read_text())
    told = json.loads(oiio.ImageBuf(str(tmp_path / "h.png")).spec().getattribute("ImageDescription"))
    assert told == data
    assert (data["unit"], data["black"], data["white"]) == ("mm", data["lowest"], data["highest"])
    heights = data["black"] + values[..., 0] * (data["white"] - data["black"])
    assert heights[inside] == pytest.approx(BALL.heights.values[inside], abs=scale.strength / 65535)
    assert data["pixels_per_unit"] == 11
    # What Blender's modifier does: the texture less the midlevel, times the strength.
    moved = (values[..., 0] - data["displace"]["midlevel"]) * data["displace"]["strength"]
    assert moved[inside] == pytest.approx(BALL.heights.values[inside], abs=scale.strength / 65535)
    assert "black is 0.0" in str(scale) and str(scale).endswith(" mm")


def test_float_files_hold_the_heights_themselves(tmp_path: Path) -> None:
    scale = write_height(tmp_path / "h.exr", NEAR.heights, unit="m")
    assert (stored(tmp_path / "h.exr")[..., 0] == NEAR.heights.values)[NEAR.mask].all()
    assert scale.strength == 1 and str(scale).endswith("heights, in m")
    data = json.loads((tmp_path / "h.exr.json").read_text())
    assert (data["black"], data["white"]) == (0, 1)
    # The mean height, far below 0 under a perspective camera, is what stays where it is.
    assert data["displace"]["midlevel"] == pytest.approx(NEAR.heights.values[NEAR.mask].mean(), rel=1e-5)
    assert data["pixels_per_unit"] == pytest.approx(np.sqrt(60 * 61) / NEAR.depth[NEAR.mask].mean(), rel=1e-5)


def test_heights_go_on_beyond_the_outline(tmp_path: Path) -> None:
    """No step at the outline that is larger than the steps inside, and nothing beyond what is inside."""
    gradient = plane(orthographic(300, 290), (-0.02, -0.01, 1), 20).heights
    row, column = np.mgrid[:300, :290]
    mask = (row - 140) ** 2 + (column - 120) ** 2 < 100**2
    mask[100:130, 100:110] = False
    write_height(tmp_path / "h.exr", HeightMap(gradient.values, mask, gradient.camera))
    values = stored(tmp_path / "h.exr")[..., 0]
    assert values[~mask].min() >= gradient.values[mask].min() and values[~mask].max() <= gradient.values[mask].max()
    for axis in (0, 1):
        crossing = np.diff(mask.astype(int), axis=axis) != 0
        assert np.abs(np.diff(values, axis=axis))[crossing].max() < 0.15  # the plane: 0.03 from corner to corner
        assert np.abs(np.diff(values, axis=axis)).max() < 0.5


def test_a_whole_picture_needs_no_mask_and_a_flat_one_no_range(tmp_path: Path) -> None:
    flat = HeightMap(np.full((4, 6), 2.5), np.ones((4, 6), bool), orthographic(4, 6))
    write_height(tmp_path / "h.png", flat)
    assert listing(tmp_path) == ["h.png", "h.png.json"]
    assert read_height(tmp_path / "h.png").values == pytest.approx(2.5)


def test_a_picture_that_another_program_wrote_again_is_read(tmp_path: Path) -> None:
    write_height(tmp_path / "h.png", BALL.heights)
    write_file(tmp_path / "h.png", 1 - stored(tmp_path / "h.png"), "uint16")
    turned = BALL.heights.values[BALL.mask].min() + BALL.heights.values[BALL.mask].max() - BALL.heights.values
    assert read_height(tmp_path / "h.png").values[BALL.mask] == pytest.approx(turned[BALL.mask], abs=1e-4)


@pytest.mark.parametrize(
    ("name", "bits", "words"),
    [("h.png", 8, "heights in 8 bits show steps"), ("h.exr", 16, "heights in 16 bits show steps")],
)
def test_what_cannot_be_written(tmp_path: Path, name: str, bits: int | None, words: str) -> None:
    with pytest.raises(InputError, match=words):
        write_height(tmp_path / name, BALL.heights, bits=bits)
    assert listing(tmp_path) == []


@pytest.mark.parametrize("ends", [(5.0, -5.0), (float("nan"), 4.0)])
def test_ends_that_are_no_range_are_refused(tmp_path: Path, ends: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="give the lower one first"):
        write_height(tmp_path / "h.png", BALL.heights, ends=ends)


def changed(folder: Path, **changes: object) -> None:
    path = folder / "h.png.json"
    data = json.loads(path.read_text()) | changes
    path.write_text(json.dumps({key: value for key, value in data.items() if value is not None}))


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f: (f / "h.png.json").unlink(), r"height file .*h\.png\.json does not exist"),
        (lambda f: (f / "h.png.mask.png").unlink(), r"h\.png\.mask\.png does not exist"),
        (lambda f: (f / "h.png.json").write_text("[]"), "is not a mpsnet-height file"),
        (lambda f: changed(f, version=9), "is version 9"),
        (lambda f: changed(f, scale=1), '"scale", which no mpsnet-height file has'),
        (lambda f: changed(f, black=float("nan")), '"black" must be a finite number'),
        (lambda f: changed(f, white=10**400), '"white" must be a finite number'),
        (lambda f: changed(f, white=2.5), "not those that the picture itself keeps; write both again"),
        (lambda f: changed(f, camera={"projection": "flat"}), 'lacks "width"'),
        (lambda f: changed(f, mask="../h.png.mask.png"), '"mask" must be the name of a file beside it'),
        (lambda f: write_file(f / "h.png.mask.png", np.ones((3, 3)), "uint8"), "do not fit a mask of shape"),
        (lambda f: write_file(f / "h.png", np.ones((3, 3)), "uint16"), "do not fit a mask of shape"),
    ],
)
def test_what_cannot_be_read(tmp_path: Path, spoil: object, words: str) -> None:
    write_height(tmp_path / "h.png", BALL.heights)
    spoil(tmp_path)  # type: ignore[operator]
    with pytest.raises(InputError, match=words) as caught:
        read_height(tmp_path / "h.png")
    assert "\n" not in str(caught.value)


def test_a_foreign_mask_is_kept_and_ones_own_is_written_again(tmp_path: Path) -> None:
    write_height(tmp_path / "own.png", BALL.heights)
    write_height(tmp_path / "own.png", BALL.heights)
    assert (tmp_path / "own.png.mask.png").exists()
    (tmp_path / "oak.png.mask.png").write_bytes(b"somebody's")
    with pytest.raises(FileError, match=r"overwrite .*oak\.png\.mask\.png, which"):
        write_height(tmp_path / "oak.png", BALL.heights)
    assert (tmp_path / "oak.png.mask.png").read_bytes() == b"somebody's"
    assert not (tmp_path / "oak.png").exists()


def test_heights_of_two_endings_in_one_folder_keep_each_their_own(tmp_path: Path) -> None:
    other = ball(orthographic(40, 50, 11.0), (0, 0, 0), 1.2)
    write_height(tmp_path / "h.png", BALL.heights, unit="mm")
    write_height(tmp_path / "h.exr", other.heights, unit="m")
    for name, surface in (("h.png", BALL), ("h.exr", other)):
        found = read_height(tmp_path / name)
        assert (found.mask == surface.mask).all()
        assert found.values[surface.mask] == pytest.approx(surface.heights.values[surface.mask], abs=1e-4)


def test_no_mask_is_left_of_heights_that_were_there_before(tmp_path: Path) -> None:
    write_height(tmp_path / "h.exr", BALL.heights)
    whole = np.ones_like(BALL.mask)
    write_height(tmp_path / "h.exr", HeightMap(BALL.heights.values, whole, BALL.camera))
    assert listing(tmp_path) == ["h.exr", "h.exr.json"]
