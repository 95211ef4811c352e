"""Many views into one texture: eight photos with noise and slightly wrong cameras, and the command from end to end."""

import contextlib
import io
import json
import os
import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from eight_views import CORNERS, all_levelled, outcome, shot, sphere_texels, wrong_views
from mesh_file import write_mesh
from surface_shapes import camera_looking, sphere_mesh, sphere_view
from synthetic import degrees_between, listing, write_file

from mpsnet_core import LightRig, View, WriteCameras, bake_normals, estimate_normals, near_rig, published_rig, write_rig
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.bake.multi_view import ViewCaptureSettings, sources_of
from mpsnet_core.capture.open import read_capture
from mpsnet_core.cli import main
from mpsnet_core.errors import FileError, InputError
from mpsnet_core.io.image_reading import read_image
from mpsnet_core.scene.camera import read_camera, write_camera
from mpsnet_core.scene.normal_encoding import read_vectors
from mpsnet_core.scene.normal_map import read_normals
from mpsnet_core.scene.rig import WorldLights, in_world, read_world_lights, write_world_lights
from mpsnet_core.scene.view_files import write_views
from mpsnet_core.scene.view_photos import ViewPhoto, posed_photos


def test_eight_wrong_views_become_one_texture_without_seams() -> None:
    """A step at a border is a jump that the surroundings do not foresee; see :func:`eight_views.jumps`.

    Without feather there are steps, and without levelling the views disagree.
    """
    views, texels = wrong_views(300), sphere_texels(512)
    level = all_levelled(views)
    bare, sharp, soft = outcome(views, texels, 0.0), outcome(level, texels, 0.0), outcome(level, texels)
    for found in (bare, sharp, soft):
        assert found.seen > 0.99 and len(found.at_borders) > 200 and not len(found.at_ends)
    # Of the steps here, from so few pixels, one in a hundred is the photos' noise.
    steps = [np.quantile(found.at_borders, 0.99) for found in (bare, sharp, soft)]
    assert steps[0] > 4.5 and steps[1] > 2.5 and steps[2] < 2
    assert bare.at_borders.max() > 8 and soft.at_borders.max() < 3
    assert bare.error > 4 and soft.error < 3
    assert soft.spread < 0.7 * bare.spread


def changed(photo: Path) -> None:
    """Make a photo another file of the same size and time, which looks the same."""
    before, data = photo.stat(), photo.read_bytes()
    at = data.index(b"capDate\0string\0") + len(b"capDate\0string\0") + 4
    photo.write_bytes(data[:at] + b"1" + data[at + 1 :])
    assert photo.stat().st_size == before.st_size
    os.utime(photo, ns=(before.st_atime_ns, before.st_mtime_ns))


class Asked(Sequence[View]):
    """Views that note how often each is asked for."""

    def __init__(self, views: list[View]) -> None:
        self.views, self.times = views, [0] * len(views)

    def __len__(self) -> int:
        return len(self.views)

    def __getitem__(self, number: Any) -> Any:
        self.times[number] += 1
        return self.views[number]


@pytest.mark.parametrize("held", [300_000, 1_000_000])  # not one view, and not three with their depth images
def test_views_that_memory_does_not_hold_give_the_same_texture(monkeypatch: pytest.MonkeyPatch, held: int) -> None:
    mesh = sphere_mesh(layout="overlapping")
    views = [sphere_view(camera_looking(corner, size=100)) for corner in CORNERS[:5]]
    at_once, in_parts = Asked(views), Asked(views)
    one = bake_normals(mesh, at_once, size=96)
    monkeypatch.setattr("mpsnet_core.bake.projection.HELD_BYTES", held)
    other = bake_normals(mesh, in_parts, size=96)
    assert np.array_equal(one.vectors, other.vectors) and np.array_equal(one.views, other.views)
    assert np.array_equal(one.spread, other.spread)
    assert at_once.times == [1] * 5 and in_parts.times == [2] * 5


class Table:
    """A folder with what the command needs: a bumpy sphere's photos from four sides, cameras, rig, mesh."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __truediv__(self, name: str) -> Path:
        return self.folder / name

    def run(self, *arguments: str | Path) -> str:
        """`mpsnet views` with good values for what is not given; what it prints. InputError where it refuses."""
        good: list[str | Path] = ["--cameras", self / "cameras", "--rig", self / "rig.json"]
        good += ["--photos", self / "photos"]
        if "--mesh" not in arguments:
            good += ["--mesh", self / "mesh.npz"]
        return self._run(*good, *arguments)

    def named(self, cameras: Path) -> str:
        """`mpsnet views` with cameras that are to name their photos."""
        return self._run("--mesh", self / "mesh.npz", "--cameras", cameras, "--rig", self / "rig.json")

    def notes(self, *arguments: str | Path) -> str:
        """What :meth:`run` tells beside its result."""
        with contextlib.redirect_stderr(io.StringIO()) as told:
            self.run(*arguments)
        return told.getvalue()

    def _run(self, *arguments: str | Path) -> str:
        # Levelling takes a quarter of the time, and counts where it is asked for.
        good: list[str | Path] = ["--model", "lambertian", "--size", "64", "--space", "object", "--level", "off"]
        words, errors = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(words), contextlib.redirect_stderr(errors):
            code = main(["views", *map(str, [*good, "-o", self / "texture.png", *arguments])])
        if code:
            (line,) = errors.getvalue().splitlines()
            raise InputError(line)
        sys.stderr.write(errors.getvalue())
        return words.getvalue()

    def texture(self) -> np.ndarray:
        return normalised(read_vectors(self / "texture.png")[0])


@pytest.fixture(scope="module")
def photographed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What is on each test's table."""
    folder = tmp_path_factory.mktemp("table")
    for name in ("photos", "cameras"):
        (folder / name).mkdir()
    rng = np.random.default_rng(1)
    for number, corner in enumerate(CORNERS[::2]):
        seen = shot(corner, 96, rng, noise=0.0, off=0.0)
        write_file(folder / "photos" / f"side{number}.exr", seen.image, "float")
        write_file(folder / f"mask{number}.png", seen.mask, "uint8")
        write_camera(folder / "cameras" / f"side{number}.camera.json", seen.camera)
    write_rig(folder / "rig.json", published_rig())
    write_mesh(folder / "mesh.npz", sphere_mesh(48, 24))
    return folder


@pytest.fixture
def table(photographed: Path, tmp_path: Path) -> Table:
    shutil.copytree(photographed, tmp_path, dirs_exist_ok=True)
    return Table(tmp_path)


@pytest.fixture(scope="module")
def baked(photographed: Path, tmp_path_factory: pytest.TempPathFactory) -> np.ndarray:
    """The texture that the command makes of it."""
    table = Table(shutil.copytree(photographed, tmp_path_factory.mktemp("baked"), dirs_exist_ok=True))
    table.run()
    return table.texture()


def error_of(table: Table) -> float:
    texels = sphere_texels(64)
    baked = table.texture()[texels.row, texels.column]
    low = texels.points[:, 2] < 0.3  # the four sides look from below
    return float(degrees_between(baked, texels.truth)[low].mean())


def test_the_command_bakes_what_the_photos_show(table: Table) -> None:
    words = table.run("--report", table / "report.html", "--json", table / "figures.json", "--level", "0.05")
    assert "side3" in words and "of its surface seen" in words
    assert error_of(table) < 4  # of relief of 17 degrees
    figures = json.loads((table / "figures.json").read_text())
    assert [row["view"] for row in figures["views"]] == [f"side{number}" for number in range(4)]
    assert all(0.2 < row["seen_area"] < 0.5 and row["level_deg"] > 0 for row in figures["views"])
    assert 0.5 < figures["seen"] < 1 and figures["level"] == 0.05
    assert f"{figures['seen']:.1%} of its surface seen" in words
    assert "side0" in (table / "report.html").read_text()


def test_kept_normals_are_not_estimated_again(table: Table, baked: np.ndarray) -> None:
    """Only those whose photo, camera, rig, mask, mesh or model changed; the texture is the same as without."""
    keep = ("--keep", table / "kept")
    table.run(*keep)
    assert np.array_equal(table.texture(), baked)
    made = {file: file.stat().st_mtime_ns for file in (table / "kept").iterdir()}
    assert len(made) == 8 and listing(table / "kept")[0] == "side0_confidence.png"
    assert "4 kept from before" in table.run(*keep, "--level", "auto")

    def again() -> set[str]:
        return {file.name.split("_")[0] for file, when in made.items() if file.stat().st_mtime_ns != when}

    assert not again()
    os.utime(table / "photos" / "side0.exr", (1, 1))  # which makes it no other photo
    changed(table / "photos" / "side1.exr")
    write_camera(table / "cameras" / "side2.camera.json", camera_looking(CORNERS[4], "perspective", size=96))
    (table / "kept" / "side3_confidence.png").unlink()
    assert "1 kept from before" in table.run(*keep)
    assert again() == {"side1", "side2", "side3"}
    for half in (table / "kept" / "side0_normals.png", table / "kept" / "side2_confidence.png"):
        half.write_bytes(half.read_bytes()[: half.stat().st_size // 2])
    assert "2 kept from before" in table.run(*keep)
    assert "kept from before" not in table.run(*keep, "--model", "lambertian-grey-world")


def test_what_a_run_wrote_beside_its_cameras_does_not_stop_the_next(table: Table) -> None:
    """COLMAP's own layout has all of a project in one folder."""
    beside = [table / "cameras" / name for name in ("texture.png", "report.html", "figures.json")]
    given = [word for option, file in zip(("-o", "--report", "--json"), beside, strict=True) for word in (option, file)]
    table.run(*given, "--keep", table / "cameras" / "kept")
    assert "4 kept from before" in table.run(*given, "--keep", table / "cameras" / "kept")
    with pytest.raises(InputError, match=r"would overwrite .*side0\.camera\.json"):
        table.run("--json", table / "cameras" / "side0.camera.json")


def test_a_kept_file_that_is_not_ours_is_not_overwritten(table: Table) -> None:
    """Nor one by the texture."""
    keep = ("--keep", table / "kept")
    table.run(*keep)
    for output in ("side1_normals.png", "side1_confidence.png"):
        with pytest.raises(InputError, match=f"would overwrite .*{output}, a file that it needs"):
            table.run(*keep, "-o", table / "kept" / output)
    retouched = table / "kept" / "side1_normals.png"
    write_file(retouched, np.full((96, 96, 3), 0.5), "uint8")  # by another program
    before = retouched.read_bytes()
    with pytest.raises(InputError, match=r"would overwrite .*side1_normals.png, which this program did not make"):
        table.run(*keep)
    assert retouched.read_bytes() == before


def test_white_photos_become_one_albedo(table: Table) -> None:
    """The sphere painted, with another exposure and tint in each view: one colour at each texel but for one factor."""

    def paint(points: np.ndarray) -> np.ndarray:
        return 0.5 + 0.3 * np.sin(2 * points)

    (table / "white").mkdir()
    tints = np.array([[1, 1, 1], [0.5, 0.4, 0.3], [1.5, 1.2, 2], [0.8, 1, 0.7]])
    rng = np.random.default_rng(1)
    for number, (corner, tint) in enumerate(zip(CORNERS[::2], tints, strict=True)):
        seen = shot(corner, 96, rng, noise=0.0, off=0.0)
        white = seen.image.sum(axis=-1, keepdims=True) * paint(seen.points) * tint
        write_file(table / "white" / f"side{number}_white.exr", white, "float")
        write_file(table / "photos" / f"side{number}.exr", seen.image * paint(seen.points), "float")
    keep = ("--keep", table / "kept", "--white", table / "white")
    table.run(*keep, "--json", table / "figures.json", "--report", table / "report.html")
    texels = sphere_texels(64)
    low = texels.points[:, 2] < -0.2  # the four sides look from below
    place = texels.row[low], texels.column[low]
    baked = read_image(table / "texture_albedo.png").pixels[place]
    ratio = baked / paint(texels.points[low])
    ratio /= np.median(ratio, axis=0)
    assert np.quantile(np.abs(ratio - 1), 0.8) < 0.05
    assert "the albedo" in (table / "report.html").read_text()
    gains = np.array([row["gain"] for row in json.loads((table / "figures.json").read_text())["views"]])
    # What is left of each view's tint once its own scale is out of it.
    left = gains * tints / (gains * tints)[:, :1]
    np.testing.assert_allclose(left / left[0], 1, atol=0.03)
    assert "4 kept from before" in table.run(*keep)
    changed(table / "white" / "side1_white.exr")
    assert "3 kept from before" in table.run(*keep)
    with pytest.raises(InputError, match=r"would overwrite .*side1_white.exr, a file that it needs"):
        table.run(*keep, "-o", table / "white" / "side1_white.exr")
    with pytest.raises(InputError, match="has no white photo side2 in"):
        (table / "white" / "side2_white.exr").unlink()
        table.run(*keep)


def test_normals_kept_of_another_mesh_are_estimated_again(table: Table) -> None:
    """Where the mesh tells what is object or how far it is; else only the texture depends on it."""
    write_rig(table / "near.json", near_rig(4 * published_rig().directions - [0, 0, 5], [0, 0, -5]))
    smaller = table / "smaller.npz"
    mesh = sphere_mesh(48, 24)
    write_mesh(smaller, replace(mesh, vertices=mesh.vertices / 2))
    for arguments, depends in (
        ((), True),
        (("--mask", "none"), False),
        (("--mask", "none", "--rig", table / "near.json"), True),
    ):
        keep = ("--keep", table / "kept", *arguments)
        table.run(*keep, "--mesh", smaller)
        assert "4 kept from before" in table.run(*keep, "--mesh", smaller)
        assert ("4 kept from before" in table.run(*keep)) != depends


def test_doubts_about_a_photo_name_its_view(table: Table) -> None:
    """A photo whose brightest third is at its end, among good ones."""
    photo = table / "photos" / "side2.exr"
    pixels = read_image(photo).pixels
    photo.unlink()
    write_file(photo.with_suffix(".png"), pixels / np.quantile(pixels[pixels > 0.05], 0.6), "uint8")
    notes = json.loads(table.run("--progress", "json").splitlines()[-1])["result"]["notes"]
    (saturated,) = [note for note in notes if "are saturated" in note]
    assert saturated.startswith("view side2: ") and saturated.endswith("[clipped-photo]")


@pytest.mark.parametrize("naming", ["{stem}.png", "{stem}_mask.png", "{stem}.exr.png"])
def test_masks_may_come_from_a_folder(table: Table, naming: str) -> None:
    (table / "masks").mkdir()
    for number in range(4):
        (table / f"mask{number}.png").rename(table / "masks" / naming.format(stem=f"side{number}"))
    table.run("--mask", table / "masks")
    assert error_of(table) < 4.5
    (table / "masks" / naming.format(stem="side2")).unlink()
    with pytest.raises(InputError, match=r"view side2: photo side2.exr has no mask side2 in .*masks; put it there"):
        table.run("--mask", table / "masks")


@pytest.mark.parametrize(
    "naming", ["{}/IMG_1.png", "{}/IMG_1_mask.png", "{}_IMG_1.png", "{}_IMG_1_mask.png", "{}_IMG_1.cr3.png"]
)
def test_photos_of_the_same_name_have_masks_of_their_own(tmp_path: Path, naming: str) -> None:
    camera = camera_looking((1, 0, 0), size=4)
    views = []
    for side in ("left", "right"):
        mask = tmp_path / "masks" / naming.format(side)
        mask.parent.mkdir(parents=True, exist_ok=True)
        mask.touch()
        for folder in ("photos", "masks"):
            (tmp_path / folder / side).mkdir(parents=True, exist_ok=True)
        (tmp_path / "photos" / side / "IMG_1.cr3").touch()
        views.append(ViewPhoto(f"{side}_IMG_1", tmp_path / "photos" / side / "IMG_1.cr3", camera, folder=Path(side)))
    (tmp_path / "masks" / "IMG_1.png").touch()  # of which nobody knows whose it is
    photography = ViewCaptureSettings(lambda camera: published_rig(), str(tmp_path / "masks"))
    for view, side in zip(views, ("left", "right"), strict=True):
        assert photography.mask_of(view) == str(tmp_path / "masks" / naming.format(side))
        (tmp_path / "masks" / naming.format(side)).unlink()
    photography = ViewCaptureSettings(lambda camera: published_rig(), str(tmp_path / "masks"))
    with pytest.raises(FileError, match=r"view right_IMG_1: its mask would be that of view left_IMG_1, .*IMG_1.png"):
        sources_of(views, photography, sphere_mesh(), "")


def colmap(table: Table, lens: str) -> None:
    """The table's cameras by COLMAP's own definition: y down, z forward, world to camera."""
    lines = []
    (table / "colmap").mkdir()
    for number, corner in enumerate(CORNERS[::2]):
        camera = camera_looking(corner, "perspective", size=96, distance=5.0)
        turned = (camera.rotation @ np.diag([1, -1, -1])).T
        w = np.sqrt(max(1 + np.trace(turned), 1e-12)) / 2
        x, y, z = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / (
            4 * w
        )
        moved = -turned @ camera.world_from_camera[:3, 3]
        pose = " ".join(map(str, [w, x, y, z, *moved]))
        lines += [f"{number + 1} {pose} 1 side{number}.exr", ""]
    focal = camera.focal[0]
    (table / "colmap" / "images.txt").write_text("\n".join(lines) + "\n")
    (table / "colmap" / "cameras.txt").write_text(f"1 {lens.format(f=focal)}\n")
    (table / "colmap" / "points3D.txt").write_text("")


@pytest.mark.parametrize("lens", ["PINHOLE 96 96 {f} {f} 48 48", "SIMPLE_RADIAL 96 96 {f} 48 48 0.01"])
def test_cameras_may_come_from_colmap(table: Table, baked: np.ndarray, lens: str) -> None:
    """The same cameras as COLMAP has them give the same texture.

    The second lens moves what is at the sphere's edge by 0.02 pixels, which is nothing, but asks for all that it takes.
    """
    colmap(table, lens)
    table.run("--cameras", table / "colmap")
    assert degrees_between(table.texture(), baked).mean() < (0.05 if lens.startswith("PINHOLE") else 0.5)


def no_photo(table: Table) -> None:
    (table / "photos" / "side1.exr").unlink()


def two_photos(table: Table) -> None:
    write_file(table / "photos" / "side1.png", np.ones((96, 96, 3)), "uint8")


def small_photo(table: Table) -> None:
    write_file(table / "photos" / "side1.exr", np.ones((40, 50, 3)), "float")


def elsewhere(table: Table) -> None:
    camera = camera_looking((1, 0, 0), "perspective", size=96, target=(0, 90, 0))
    write_camera(table / "cameras" / "side1.camera.json", camera)


def broken_photo(table: Table) -> None:
    (table / "photos" / "side1.exr").write_bytes(b"v/1\x01" + bytes(90))


BAD: dict[str, tuple[Callable[[Table], list[Any] | None], str]] = {
    "a camera without a photo": (no_photo, r"camera side1.camera.json has no photo side1 .*put it there"),
    "two photos for a camera": (
        two_photos,
        r"the photo of camera side1.camera.json may be any of side1.exr, side1.png in",
    ),
    "a photo of another size": (small_photo, r"view side1: .*the camera is 96 x 96 but the photo is 50 x 40"),
    "a camera that looks elsewhere": (elsewhere, r"view side1: .*do cameras and mesh share one world"),
    "a damaged photo": (broken_photo, r"view side1: .*side1.exr cannot be read|view side1: .*side1.exr is damaged"),
    "a folder without cameras": (
        lambda t: ["--cameras", t / "photos"],
        r"photos holds no file NAME\.camera\.json for a photo called NAME, and no COLMAP model .*; choose the folder",
    ),
    "a level that is none": (
        lambda t: ["--level", "much"],
        r"--level much is not known; give auto, on, off, or a scale",
    ),
    "an output over the rig": (lambda t: ["--json", t / "rig.json"], r"would overwrite .*rig.json"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gets_one_sentence_and_leaves_nothing(table: Table, case: str) -> None:
    break_it, said = BAD[case]
    arguments = break_it(table) or []
    before = listing(table.folder)
    with pytest.raises(InputError, match=said):
        table.run(*arguments)
    assert listing(table.folder) == before


def test_near_lights_in_the_world_are_where_each_camera_sees_them(tmp_path: Path) -> None:
    camera = camera_looking((1, 2, 0.5), "perspective", size=96, distance=5.0)
    places = np.array([[2.0, 3, 1], [3, 1, -1], [1, 3, -2]])
    rig = {"format": "mpsnet-rig", "version": 1, "target": [0.1, 0, 0], "lobe": 1}
    rig["lights"] = [{"position": place} for place in places.tolist()]
    (tmp_path / "rig.json").write_text(json.dumps(rig))
    lights = read_world_lights(tmp_path / "rig.json")
    seen = lights.seen_by(camera)
    assert seen.near is not None and seen.near.lobe == 1
    from_camera = np.linalg.inv(camera.world_from_camera)
    for place, found in zip([*places, [0.1, 0, 0]], [*seen.near.positions, seen.near.target], strict=True):
        assert found == pytest.approx((from_camera @ [*place, 1])[:3])
    afar = WorldLights(published_rig().directions @ camera.rotation.T).seen_by(camera)
    assert afar.directions == pytest.approx(published_rig().directions)
    write_world_lights(tmp_path / "again.json", in_world(seen, camera))
    again = read_world_lights(tmp_path / "again.json").near
    assert again is not None and again.positions == pytest.approx(places)


DIRECTIONS = [{"direction": direction} for direction in published_rig().directions.tolist()]
PLACES = [{"position": place} for place in (5 * published_rig().directions).tolist()]


def test_lights_near_the_object_are_lit_by_the_mesh_s_distance(table: Table, baked: np.ndarray) -> None:
    """The photos' lights were far away: lights ten thousand sizes away are as good, those nearby are another rig."""
    textures = [baked]
    for away in (1e4, 4.0):
        write_rig(table / "near.json", near_rig(away * published_rig().directions - [0, 0, 5], [0, 0, -5]))
        table.run("--rig", table / "near.json")
        textures.append(table.texture())
    assert degrees_between(textures[0], textures[1]).max() < 0.2
    assert degrees_between(textures[0], textures[2]).max() > 2


def test_a_file_of_ours_names_photos_and_cameras(table: Table, baked: np.ndarray) -> None:
    file = table / "views.json"
    cameras = [read_camera(table / "cameras" / f"side{number}.camera.json") for number in range(4)]
    write_views(file, [(f"side{n}", f"photos/side{n}.exr", camera) for n, camera in enumerate(cameras)])
    table.named(file)
    assert np.array_equal(table.texture(), baked)
    views = json.loads(file.read_text())["views"]

    def write(**change: Any) -> None:
        broken = [{**views[0], **change}, *views[1:]]
        file.write_text(json.dumps({"format": "mpsnet-views", "version": 1, "views": broken}))

    for change, said in (
        ({"photo": "photos/none.exr"}, "view side0: photo .*none.exr does not exist"),
        ({"name": "../side0"}, 'view 1 needs a "name" of printable letters, without slashes or colons'),
        ({"camera": {"width": 96}}, 'view side0: it lacks "projection"'),
        ({"name": "side1"}, "two cameras for photos called side1"),
        ({"photo": "photos/side1.exr"}, "two cameras for photos in .*side1.exr"),
    ):
        write(**change)
        with pytest.raises(InputError, match=said):
            table.named(file)
    with pytest.raises(InputError, match="does not name its photos; give the folder of the photos"):
        table.named(table / "cameras")


def test_dark_and_flat_frames_are_taken_off_every_view(table: Table) -> None:
    table.run("--keep", table / "kept")
    expected = table.texture()
    fall = np.linspace(0.4, 1, 96, dtype=np.float32)[:, None, None]
    for number in range(4):
        photo = table / "photos" / f"side{number}.exr"
        write_file(photo, read_image(photo).pixels * fall + 0.1, "float")
    frames = ["--dark", write_file(table / "dark.exr", np.full((96, 96, 3), 0.1), "float")]
    frames += ["--flat", write_file(table / "flat.exr", np.broadcast_to(fall + 0.1, (96, 96, 3)), "float")]
    assert "kept from before" not in table.run(*frames, "--keep", table / "kept")
    assert degrees_between(table.texture(), expected).max() < 0.5


def test_cameras_of_photogrammetry_become_files_of_ours(table: Table) -> None:
    """Estimated one by one from what the verb wrote, the views give what `mpsnet views` gives."""
    colmap(table, "SIMPLE_RADIAL 96 96 {f} 48 48 0.01")
    table.run("--cameras", table / "colmap", "--mask", "none", "--keep", table / "kept")
    with contextlib.redirect_stdout(io.StringIO()):
        command = ["cameras", str(table / "colmap"), "--photos", str(table / "photos"), "-o", str(table / "ours")]
        assert main(command) == 0
    names = [f"side{number}{suffix}" for number in range(4) for suffix in (".camera.json", ".exr")]
    assert listing(table / "ours") == names
    for view in posed_photos(table / "ours", table / "ours"):
        capture = read_capture(view.photo, published_rig(), camera=view.camera)
        ours = estimate_normals(capture, "lambertian")
        theirs = read_normals(table / "kept" / f"{view.name}_normals.png")
        assert (ours.mask == theirs.mask).mean() > 0.999
        lit = ours.mask & theirs.mask & (capture.image > 0.01).all(axis=-1)
        assert degrees_between(ours.vectors, theirs.vectors)[lit].mean() < 0.1


def test_the_camera_of_a_photo_that_was_scaled_since_is_scaled(table: Table) -> None:
    """And that is said; of one that was cropped it is refused, before any is written."""
    colmap(table, "PINHOLE 96 96 {f} {f} 48 48")
    photos = {name: read_image(table / "photos" / name) for name in ("side1.exr", "side2.exr")}
    for name, image in photos.items():
        small = image.pixels.reshape(48, 2, 48, 2, 3).mean(axis=(1, 3))
        write_file(table / "photos" / name, small, "float")
    told = table.notes("--cameras", table / "colmap")
    assert "the camera is for 96 x 96 pixels and the photo has 48 x 48" in told and error_of(table) < 4.5
    write = WriteCameras(cameras=str(table / "colmap"), photos=str(table / "photos"), output=str(table / "ours"))
    write_file(table / "photos" / "side2.exr", photos["side2.exr"].pixels[:, 3:], "float")
    with pytest.raises(InputError, match=r"view side2: the camera is 96 x 96 but the photo is 93 x 96; .*cropped"):
        write.run()
    assert not (table / "ours").exists()
    write_file(table / "photos" / "side2.exr", photos["side2.exr"].pixels, "float")
    write.run()
    sizes = [read_camera(table / "ours" / f"side{number}.camera.json").width for number in range(4)]
    assert sizes == [96, 48, 96, 96]


def test_cameras_whose_photo_is_missing_are_left_out(table: Table) -> None:
    colmap(table, "PINHOLE 96 96 {f} {f} 48 48")
    (table / "photos" / "side2.exr").unlink()
    table.run("--cameras", table / "colmap", "--json", table / "figures.json")
    views = json.loads((table / "figures.json").read_text())["views"]
    assert [row["view"] for row in views] == ["side0", "side1", "side3"]
    for number in (0, 1, 3):
        (table / "photos" / f"side{number}.exr").unlink()
    with pytest.raises(InputError, match=r"none of the 4 photos of .*colmap, such as side0.exr, is in .*photos"):
        table.run("--cameras", table / "colmap")


def test_what_cannot_be_baked_is_reported_before_anything_is_estimated(table: Table) -> None:
    for arguments, said in (
        (("--size", "0"), "a texture has no side of 0 texels"),
        (("--json", table / "cameras" / "side1.camera.json"), "would overwrite .*side1.camera.json"),
    ):
        with pytest.raises(InputError, match=said):
            table.run(*arguments, "--keep", table / "kept")
    assert not (table / "kept").exists()


@pytest.mark.parametrize("break_it", [small_photo, broken_photo], ids=lambda function: function.__name__)
def test_a_photo_that_cannot_be_had_is_reported_before_any_estimate(table: Table, break_it: Callable[[Table], None]):
    break_it(table)
    with pytest.raises(InputError, match="view side1: "):
        table.run("--keep", table / "kept")
    (table / "white").mkdir()
    for number in range(4):
        write_file(table / "white" / f"side{number}.png", np.ones((96, 95 + (number != 2), 3)), "uint8")
    write_file(table / "photos" / "side1.exr", np.ones((96, 96, 3)), "float")
    with pytest.raises(InputError, match=r"view side2: the camera is 96 x 96 but white photo .*side2.png is 95 x 96"):
        table.run("--keep", table / "kept", "--white", table / "white")
    assert not (table / "kept").exists()


def test_views_that_do_not_belong_together_are_reported(table: Table) -> None:
    """The lights that went with the camera, each in the place of another."""
    lights = published_rig().directions
    write_rig(table / "wrong.json", LightRig(lights[[1, 2, 0]]))
    assert "belong together" in table.notes("--rig", table / "wrong.json")
    assert "belong together" not in table.notes()
