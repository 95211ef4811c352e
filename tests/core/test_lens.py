"""Lenses: taken out of photos and masks, turned with them, and the photos found again."""

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from photogrammetry_scene import TURN, Array, refusal

from mpsnet_core import Camera, Lens, PosedPhoto, undistorted
from mpsnet_core.io.frames import PhotoFolder
from mpsnet_core.io.image_reading import read_image, read_orientation
from mpsnet_core.scene.photogrammetry.posed_photo import (
    as_displayed,
    find_photo,
    photo_points,
    turned,
    undistorted_mask,
)

WIDTH, HEIGHT = 72, 48
POSE = np.vstack([np.c_[TURN, [0.3, -2.0, 5.0]], [0, 0, 0, 1]])
CAMERA = Camera("perspective", WIDTH, HEIGHT, (70.0, 65.0), (37.5, 22.75), POSE)
BENT = Lens(
    radial=(-0.25, 0.08, -0.01, 0.002),
    divisor=(0.03, -0.01, 0.005),
    tangential=(0.006, -0.004),
    affinity=((1.0, 0.004), (-0.003, 0.998)),
)


def middles(width: int = WIDTH, height: int = HEIGHT) -> Array:
    return np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1)


def written_out(x: float, y: float) -> tuple[float, float]:
    """BENT's equation with every term in its place."""
    r2 = x * x + y * y
    above = 1 - 0.25 * r2 + 0.08 * r2**2 - 0.01 * r2**3 + 0.002 * r2**4
    below = 1 + 0.03 * r2 - 0.01 * r2**2 + 0.005 * r2**3
    dx = x * above / below + 0.006 * (r2 + 2 * x * x) + 2 * -0.004 * x * y
    dy = y * above / below + -0.004 * (r2 + 2 * y * y) + 2 * 0.006 * x * y
    return dx + 0.004 * dy, -0.003 * dx + 0.998 * dy


def scene(pixels: Array) -> Array:
    """What a pinhole camera sees at pixels (..., 2): smooth, and different in each channel."""
    x, y = np.moveaxis(pixels, -1, 0)
    return np.stack([np.sin(x / 9), np.cos(y / 7 + x / 30), np.sin((x - 2 * y) / 20)], axis=-1).astype(np.float32)


def undistorted_photo(points: Array) -> Array:
    """The pinhole camera's pixels of what the photo shows at `points`, by iteration."""
    found = points.copy()
    for _ in range(60):
        found -= photo_points(found, CAMERA, BENT) - points
    return found


def test_points_are_bent_by_the_equation() -> None:
    points = np.random.default_rng(1).uniform(-0.7, 0.7, (50, 2))
    expected = [written_out(x, y) for x, y in points]
    np.testing.assert_allclose(BENT.distorted(points), expected, atol=1e-14)
    pixels = points * CAMERA.focal + CAMERA.centre
    expected = np.array(expected) * CAMERA.focal + CAMERA.centre
    np.testing.assert_allclose(photo_points(pixels, CAMERA, BENT), expected, atol=1e-12)


def test_a_photo_taken_through_the_lens_becomes_the_pinhole_cameras() -> None:
    photo = scene(undistorted_photo(middles()))
    assert np.abs(photo - scene(middles())).max() > 0.2
    seen = undistorted_mask(np.ones((HEIGHT, WIDTH), bool), CAMERA, BENT)
    straight = undistorted(photo, CAMERA, BENT)
    assert straight.dtype == np.float32
    assert seen.mean() > 0.9
    # Bilinear interpolation of sin(x / 7) is off by no more than 1/7² / 8 each way, and by a few pixels' bend at edges.
    assert np.abs(straight - scene(middles()))[seen].max() < 0.009


def brute_force(photo: Array) -> Array:
    """One pixel at a time: four neighbours, the edge's own pixels half a pixel outside them, nothing beyond."""
    straight = np.zeros_like(photo)
    points = photo_points(middles(), CAMERA, BENT)
    for row, column in np.ndindex(HEIGHT, WIDTH):
        x, y = points[row, column]
        if not (0 <= x <= WIDTH and 0 <= y <= HEIGHT):
            continue
        x, y = min(max(x - 0.5, 0), WIDTH - 1), min(max(y - 0.5, 0), HEIGHT - 1)
        for i, share_x in ((int(x), 1 - x % 1), (int(x) + 1, x % 1)):
            for j, share_y in ((int(y), 1 - y % 1), (int(y) + 1, y % 1)):
                if share_x * share_y:
                    straight[row, column] += share_x * share_y * photo[j, i]
    return straight


@pytest.mark.parametrize("channels", [(), (1,), (3,)])
def test_photos_are_interpolated_between_four_pixels(channels: tuple[int, ...]) -> None:
    photo = np.random.default_rng(2).random((HEIGHT, WIDTH, *channels), np.float32)
    straight = undistorted(photo, CAMERA, BENT)
    assert straight.shape == photo.shape
    np.testing.assert_allclose(straight, brute_force(photo), atol=1e-5)


def test_masks_hold_what_is_blended_from_the_mask_alone() -> None:
    mask = np.random.default_rng(3).random((HEIGHT, WIDTH)) < 0.9
    straight = undistorted_mask(mask, CAMERA, BENT)
    shares = brute_force(mask.astype(np.float64))
    np.testing.assert_array_equal(straight, shares > 1 - 1e-9)
    # What a saturated pixel had a share in is not in the mask of the others.
    photo = np.where(mask, np.float32(0), np.float32(1))
    assert not undistorted(photo, CAMERA, BENT)[straight].any()


def test_a_lens_that_bends_nothing_changes_nothing() -> None:
    photo, mask = np.random.default_rng(4).random((HEIGHT, WIDTH, 3), np.float32), np.ones((HEIGHT, WIDTH), bool)
    for lens in (Lens(), Lens(radial=(0.0, 0.0), divisor=(0.0,), tangential=(0.0, -0.0))):
        assert lens.is_identity
        assert undistorted(photo, CAMERA, lens) is photo
        assert undistorted_mask(mask, CAMERA, lens) is mask
    assert not any(lens.is_identity for lens in (BENT, Lens((0.1,)), Lens(affinity=((1.0, 0.1), (0.0, 1.0)))))


@pytest.mark.parametrize(
    ("lens", "turns_back"),
    [
        (Lens(radial=(-0.5,)), np.sqrt(1 / 1.5)),  # r - r³/2 turns back where 1 = 3 r²/2
        (Lens(divisor=(2.0,)), np.sqrt(0.5)),  # r / (1 + 2 r²)
        (Lens(radial=(0.2,)), 2.0),
    ],
)
def test_what_a_distortion_that_turns_back_shows_again_is_left_out(lens: Lens, turns_back: float) -> None:
    assert lens.reach(2.0) == pytest.approx(turns_back, abs=2e-3)
    camera = Camera("perspective", 100, 80, (40.0, 40.0), (50.0, 40.0))
    seen = undistorted_mask(np.ones((80, 100), bool), camera, lens)
    distance = np.linalg.norm((middles(100, 80) - camera.centre) / 40, axis=-1)
    assert not seen[distance > turns_back + 0.01].any()
    assert (undistorted(np.ones((80, 100)), camera, lens) == seen).all()


POSED = PosedPhoto("a.jpg", CAMERA, BENT)


def stored(folder: Path, orientation: int | None, marked: tuple[int, int]) -> Path:
    """A photo whose one bright pixel (column, row) is there as stored."""
    pixels = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    pixels[marked[1], marked[0]] = 1
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 3, "float")
    if orientation is not None:
        spec.attribute("Orientation", orientation)
    output = oiio.ImageOutput.create(str(folder / "a.tif"))
    assert output.open(str(folder / "a.tif"), spec)
    assert output.write_image(pixels)
    assert output.close()
    return folder / "a.tif"


@pytest.mark.parametrize("orientation", [None, 1, 3, 6, 8])
def test_a_camera_is_turned_as_its_photo_is_shown(tmp_path: Path, orientation: int | None) -> None:
    # A point of the world, where the photo shows it as stored, and the pixel there.
    world = POSE @ [0.9, 0.5, -4.0, 1.0]

    def shown_at(posed: PosedPhoto) -> Array:
        x, y, w = posed.camera.projection_rows() @ world
        return photo_points([x / w, y / w], posed.camera, posed.lens)

    column, row = shown_at(POSED).astype(int)
    file = stored(tmp_path, orientation, (column, row))
    assert read_orientation(file) == (orientation or 1)
    image, posed = read_image(file).pixels, as_displayed(POSED, file)
    assert (posed.camera.height, posed.camera.width) == image.shape[:2]
    column, row = shown_at(posed).astype(int)
    assert image[row, column].min() == 1


@pytest.mark.parametrize(("orientation", "turn"), [(3, 2), (6, -1), (8, 1)])
def test_a_turned_photo_is_straightened_into_the_turned_picture(orientation: int, turn: int) -> None:
    photo = np.random.default_rng(6).random((HEIGHT, WIDTH, 3), np.float32)
    posed = turned(POSED, orientation)
    straight = undistorted(np.rot90(photo, turn), posed.camera, posed.lens)
    np.testing.assert_allclose(straight, np.rot90(undistorted(photo, CAMERA, BENT), turn), atol=1e-4)


def test_mirrored_photos_are_refused(tmp_path: Path) -> None:
    file = stored(tmp_path, 5, (3, 4))
    assert "stored mirrored (EXIF orientation 5)" in refusal(lambda: as_displayed(POSED, file))


def named(name: str) -> PosedPhoto:
    return PosedPhoto(name, CAMERA, Lens())


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("a.jpg", "a.jpg"),
        ("lit/a.jpg", "lit/a.jpg"),
        ("/home/someone/a.jpg", "a.jpg"),
        ("D:\\photos\\lit\\a.jpg", "lit/a.jpg"),
        ("elsewhere/b.jpg", "b.TIF"),
        ("lit/c.png", "lit/c.exr"),
        ("DSC.0001.jpg", "DSC.0001.JPG"),
        ("IMG_1", "IMG_1.CR3"),
        ("IMG_1.JPG", "IMG_1.CR3"),
        ("img_2.nef", "IMG_2.tif"),
    ],
)
def test_photos_are_found(tmp_path: Path, name: str, file: str) -> None:
    (tmp_path / "lit").mkdir()
    names = ("a.jpg", "lit/a.jpg", "b.TIF", "b.txt", "lit/c.exr", "DSC.0001.JPG", "b_normals.png")
    for made in (*names, "IMG_1.CR3", "IMG_2.tif"):
        (tmp_path / made).touch()
    assert find_photo(named(name), PhotoFolder(tmp_path)) == tmp_path / file


def test_photos_that_are_missing_or_not_one_are_refused(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    for made in ("outside.jpg", "photos/a.png", "photos/a.tif"):
        (tmp_path / made).touch()
    folder = PhotoFolder(tmp_path / "photos")
    for name in ("b.jpg", "../outside.jpg", str(tmp_path / "outside.jpg"), "", "..", "/", "a\0.jpg", "b" * 5000):
        assert find_photo(named(name), folder) is None
    assert "may be any of a.png, a.tif" in refusal(lambda: find_photo(named("a.jpg"), folder))
    assert find_photo(named("a.png"), folder) == folder.path / "a.png"
    assert "is not a folder" in refusal(lambda: PhotoFolder(tmp_path / "nowhere"))


def test_case_counts_where_it_separates_photos(tmp_path: Path) -> None:
    for made in ("A.png", "a.tif"):
        (tmp_path / made).touch()
    folder = PhotoFolder(tmp_path)
    assert [find_photo(named(name), folder).name for name in ("A.jpg", "a.jpg")] == ["A.png", "a.tif"]
