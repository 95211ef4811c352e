"""The camera of a photo from its mesh: a shape given by a formula, photographed by marching along rays."""

import json
import re
from dataclasses import replace
from functools import cache

import bumpy_ball
import numpy as np
import pytest
from bumpy_ball import Photo
from exif import write_jpeg
from mesh_file import write_mesh
from surface_shapes import upright
from synthetic import write_file

from mpsnet_core import Camera, GeometryError, Mesh, NormalMap, read_camera, read_image, write_camera
from mpsnet_core.estimate.alignment import search
from mpsnet_core.estimate.alignment.points import camera_from_points
from mpsnet_core.estimate.alignment.pose import MeshFaces
from mpsnet_core.estimate.alignment.refine import PhotoPyramid, measure_fit, refine_camera
from mpsnet_core.estimate.alignment.search import find_better_mirrored, search_cameras
from mpsnet_core.scene.rig import near_rig, published_rig, write_rig

pytestmark = pytest.mark.accuracy

WIDTH, HEIGHT = 360, 300


def looking(longitude: float, latitude: float, roll: float, distance: float = 6.0, lens: float = 600.0) -> Camera:
    """A camera that looks near the origin; degrees."""
    longitude, latitude, roll = np.radians([longitude, latitude, roll])
    flat = np.cos(latitude)
    right, up, back = upright((flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude))).T
    pose = np.eye(4)
    pose[:3, 0] = np.cos(roll) * right + np.sin(roll) * up
    pose[:3, 1] = np.cos(roll) * up - np.sin(roll) * right
    pose[:3, 2] = back
    pose[:3, 3] = back * distance + 0.15 * right - 0.1 * up
    return Camera("perspective", WIDTH, HEIGHT, np.full(2, lens), None, pose)


@cache
def photographed(longitude: float = 40, latitude: float = 15, roll: float = 8, lens: float = 600.0) -> Photo:
    return bumpy_ball.photo(looking(longitude, latitude, roll, lens=lens))


@cache
def mesh() -> Mesh:
    return bumpy_ball.mesh()


@cache
def faces() -> MeshFaces:
    return MeshFaces.of(mesh())


def evidence(photo: Photo) -> PhotoPyramid:
    return PhotoPyramid(NormalMap(photo.normals, photo.mask))


def pixels_of(camera: Camera, points: np.ndarray) -> np.ndarray:
    seen = np.c_[points, np.ones(len(points))] @ camera.projection_rows().T
    return seen[:, :2] / seen[:, 2:]


def surface_points(count: int, seed: int = 0) -> np.ndarray:
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return directions * bumpy_ball.radius(directions)[:, None]


def degrees_apart(one: Camera, other: Camera) -> float:
    return float(np.degrees(np.arccos(np.clip((np.trace(one.rotation.T @ other.rotation) - 1) / 2, -1, 1))))


def assert_the_same(found: Camera, true: Camera) -> None:
    """Within 0.3 degrees, 1.5 pixels of a picture of 1,024 and 0.3% of the object's size across the picture."""
    points = surface_points(200)
    off = np.linalg.norm(pixels_of(found, points) - pixels_of(true, points), axis=1)
    assert degrees_apart(found, true) < 0.3
    assert off.mean() < 1.5 * WIDTH / 1024
    middle = np.linalg.inv(true.world_from_camera)[:3, 3] - np.linalg.inv(found.world_from_camera)[:3, 3]
    assert np.abs(middle[:2]).max() < 0.003 * bumpy_ball.SIZE


class TestPoints:
    @pytest.mark.parametrize("known", [True, False], ids=["focal known", "focal unknown"])
    @pytest.mark.parametrize("count", [6, 12])
    def test_exact_pairs_give_the_camera(self, count: int, known: bool):
        true, points = looking(70, -20, 25), surface_points(count)
        fit = camera_from_points(pixels_of(true, points), points, WIDTH, HEIGHT, true if known else None)
        assert degrees_apart(fit.camera, true) < (0.001 if known else 0.3)
        assert fit.residuals.max() < (0.001 if known else 0.3)
        assert fit.left_out == ()

    def test_a_known_principal_point_stays(self):
        true, points = replace(looking(70, -20, 25), centre=np.array([112.0, 225.0])), surface_points(8)
        fit = camera_from_points(
            pixels_of(true, points), points, WIDTH, HEIGHT, replace(true, world_from_camera=np.eye(4))
        )
        assert fit.camera.centre.tolist() == [112, 225]
        assert degrees_apart(fit.camera, true) < 0.001
        fit = camera_from_points(pixels_of(true, points), points, WIDTH, HEIGHT, replace(true, centre=None))
        assert degrees_apart(fit.camera, true) > 3

    @pytest.mark.parametrize("wrong", [0, 5])
    def test_a_wrong_pair_is_left_out(self, wrong: int):
        true, points = looking(-30, 40, 0), surface_points(8)
        pixels = pixels_of(true, points) + np.random.default_rng(1).normal(size=(8, 2))
        pixels[wrong] += (40, -30)
        fit = camera_from_points(pixels, points, WIDTH, HEIGHT)
        assert fit.left_out == (wrong,)
        assert degrees_apart(fit.camera, true) < 2

    def test_a_likely_focal_length_decides_only_where_the_pairs_leave_it_open(self):
        """Of a plane that the camera faces, every focal length shows the same from another distance."""
        true = looking(90, 0, 0)
        flat = np.array([[-1, 0, -0.8], [1, 0, -0.6], [0.9, 0, 0.8], [-0.7, 0, 1], [0.1, 0, 0.2]])
        right, up = true.rotation[:, 0], true.rotation[:, 1]
        facing = flat[:, :1] * right + flat[:, 2:] * up
        solid = surface_points(8)
        for focal in (0.7, 2.5):
            found = [
                camera_from_points(pixels_of(true, points), points, WIDTH, HEIGHT, usual_focal=focal).camera.focal[0]
                for points in (facing, solid)
            ]
            assert found[0] == pytest.approx(focal * WIDTH, rel=0.05)
            assert found[1] == pytest.approx(600, rel=0.03)

    def test_three_pairs_and_a_line_are_refused(self):
        true = looking(0, 0, 0)
        with pytest.raises(GeometryError, match="3 pairs do not determine"):
            camera_from_points(pixels_of(true, surface_points(3)), surface_points(3), WIDTH, HEIGHT)
        line = np.linspace(-1, 1, 6)[:, None] * (0.2, 0.5, 0.3)
        with pytest.raises(GeometryError, match="lie on one line"):
            camera_from_points(pixels_of(true, line), line, WIDTH, HEIGHT)


class TestFromAStart:
    # From the last one the first steps are long: a turn and a shift that undo each other have to be cut alike.
    @pytest.mark.parametrize(("view", "lens", "seed"), [((40, 15, 8), 600.0, 0), ((200, 50, -60), 700.0, 7)])
    def test_eight_degrees_and_eight_percent_off_it_finds_the_camera(self, view: tuple, lens: float, seed: int):
        rng, photo = np.random.default_rng(seed), photographed(*view, lens)
        off_by = [rng.choice([-5, 5]), rng.choice([-5, 5]), rng.choice([-4, 4])]
        turn = looking(*(np.array(view) + off_by))
        pose = turn.world_from_camera.copy()
        off = rng.normal(size=3)
        pose[:3, 3] += 0.08 * bumpy_ball.SIZE * off / np.linalg.norm(off)
        start = Camera("perspective", WIDTH, HEIGHT, np.full(2, 1.08 * lens), None, pose)
        fit = refine_camera(evidence(photo), faces(), start)
        assert_the_same(fit.camera, photo.camera)
        assert fit.overlap > 0.98
        assert fit.degrees < 3

    def test_normals_that_err_smoothly_do_not_turn_it(self):
        """As estimates err: towards the viewer, by up to some 10 degrees."""
        photo = photographed()
        flat = photo.normals + photo.mask[..., None] * np.array([0.05, -0.05, 0.3], np.float32)
        flat /= np.maximum(np.linalg.norm(flat, axis=-1, keepdims=True), 1e-9)
        fit = refine_camera(PhotoPyramid(NormalMap(flat, photo.mask)), faces(), looking(45, 10, 4))
        assert_the_same(fit.camera, photo.camera)


def test_a_camera_that_is_wrong_does_not_make_a_mesh_mirrored():
    """Seen from behind, where in a mirror it would look as from the front, from where it fits as it is."""
    photo = bumpy_ball.photo(looking(5, 20, 3), bumpy_ball.NEARLY_SYMMETRIC)
    mesh = MeshFaces.of(bumpy_ball.mesh(bumps=bumpy_ball.NEARLY_SYMMETRIC))
    assert (
        find_better_mirrored(evidence(photo), mesh, measure_fit(evidence(photo), mesh, looking(185, -20, -3))) is None
    )


@pytest.mark.long
def test_without_a_start_the_best_view_is_the_right_one():
    photo = photographed(-120, -35, 170)
    best, *others = search_cameras(evidence(photo), faces(), looking(0, 0, 0, lens=525.0))
    assert_the_same(best.camera, photo.camera)
    assert all(other.cost > best.cost for other in others)


def test_without_a_start_a_known_principal_point_stays(monkeypatch: pytest.MonkeyPatch):
    """Of one of the views that the search begins with."""
    monkeypatch.setattr(search, "TRIED", 1)
    shifted = replace(looking(-120, -35, 170), centre=np.array([248.0, 90.0]))
    photo = bumpy_ball.photo(shifted)
    best, *_ = search_cameras(evidence(photo), faces(), replace(shifted, world_from_camera=np.eye(4)), fix_focal=True)
    assert best.camera.centre.tolist() == [248, 90] and best.camera.focal.tolist() == [600, 600]
    assert_the_same(best.camera, shifted)


class TestCommand:
    @pytest.fixture
    def files(self, tmp_path):
        photo = photographed()
        write_file(tmp_path / "photo.exr", np.dstack([photo.image, photo.mask]), "float")
        write_mesh(tmp_path / "mesh.npz", mesh())
        write_rig(tmp_path / "rig.json", published_rig(30, 90))
        return tmp_path

    def align(self, mpsnet, files, *options, code: int = 0):
        given = ("--mesh", files / "mesh.npz", "--rig", files / "rig.json", "--model", "lambertian")
        done = mpsnet("align", files / "photo.exr", *given, "-o", files / "camera.json", *options)
        assert done.returncode == code, done.stderr
        return done

    def pairs(self, files, pixels, points):
        pairs = [{"pixel": a, "point": b} for a, b in zip(pixels.tolist(), points.tolist(), strict=True)]
        (files / "pairs.json").write_text(json.dumps({"pairs": pairs}))
        return "--points", files / "pairs.json"

    def test_points_two_pixels_off_are_refined_by_the_photo(self, mpsnet, files):
        true, points = photographed().camera, surface_points(8)
        pixels = pixels_of(true, points) + np.random.default_rng(2).normal(size=(8, 2))
        pixels[3] += 60
        done = self.align(mpsnet, files, *self.pairs(files, pixels, points), "--overlay", files / "overlay.png")
        assert "pair 4 contradicts the others" in done.stderr
        assert_the_same(read_camera(files / "camera.json"), true)
        assert (files / "overlay.png").is_file()

    @pytest.mark.parametrize(("stated", "given"), [(200, ()), (1, ()), (200, ("--focal", "60")), (0, ())])
    def test_the_lens_that_the_photo_states_is_where_it_starts(self, mpsnet, files, stated: int, given):
        """A wrong one does no harm, and one that is given goes before it."""
        photo, points = photographed(), surface_points(8)
        write_file(files / "mask.png", photo.mask, "uint8")
        exif = {"FocalLengthIn35mmFilm": stated, "PixelXDimension": WIDTH, "PixelYDimension": HEIGHT}
        write_jpeg(files / "photo.jpg", (WIDTH, HEIGHT), exif, np.clip(photo.image, 0, 1))
        pairs = self.pairs(files, pixels_of(photo.camera, points), points)
        options = ("--encoding", "linear", "--mask", files / "mask.png", "--model", "lambertian", *pairs, *given)
        mesh_and_rig = ("--mesh", files / "mesh.npz", "--rig", files / "rig.json")
        done = mpsnet("align", files / "photo.jpg", *mesh_and_rig, *options, "-o", files / "camera.json")
        assert done.returncode == 0, done.stderr
        assert_the_same(read_camera(files / "camera.json"), photo.camera)
        # By the diagonal, EXIF's own way, on a photo of 6:5.
        focal = stated * np.hypot(6, 5) / 6 * 36 / np.hypot(36, 24)
        used, refused = (f"photo.jpg states a lens of {focal:.0f} mm, where the search starts", "which no camera")
        assert (used in done.stderr) == (stated >= 60 and not given)
        assert (refused in done.stderr) == (stated == 1)

    @pytest.fixture
    def cropped(self, files):
        """Of a camera of the whole photo that of the photo in the file, which lost its left and top."""
        photo, (left, top) = photographed(), (68, 22)
        image = np.dstack([photo.image, photo.mask])[top:, left:]
        write_file(files / "photo.exr", image, "float")
        height, width, _ = image.shape
        return lambda camera: replace(camera, width=width, height=height, centre=camera.centre - (left, top))

    def test_the_start_of_a_cropped_photo_keeps_its_principal_point(self, mpsnet, files, cropped):
        write_camera(files / "start.json", cropped(looking(46, 10, 4)))
        self.align(mpsnet, files, "--start", files / "start.json")
        assert_the_same(read_camera(files / "camera.json"), cropped(photographed().camera))

    @pytest.mark.parametrize("given", ["points", "start"])
    def test_a_lens_keeps_its_focal_length_and_principal_point(self, mpsnet, files, cropped, given: str):
        true, points = cropped(photographed().camera), surface_points(8)
        write_camera(files / "start.json", replace(cropped(looking(46, 10, 4, lens=675)), centre=None))
        place = (
            ("--start", files / "start.json")
            if given == "start"
            else self.pairs(files, pixels_of(true, points), points)
        )
        # Of the photo in twice the size, taken elsewhere.
        lens = replace(true.resized(2 * true.width, 2 * true.height), world_from_camera=np.eye(4))
        write_camera(files / "lens.json", lens)
        self.align(mpsnet, files, *place, "--lens", files / "lens.json")
        found = read_camera(files / "camera.json")
        assert found.focal.tolist() == [600, 600] and found.centre.tolist() == true.centre.tolist()
        assert_the_same(found, true)
        # By the middle, it is another camera.
        self.align(mpsnet, files, *place, "--focal", 600 / true.width * 36)
        assert degrees_apart(read_camera(files / "camera.json"), true) > 1

    def test_a_lens_of_another_shape_and_a_second_one_are_refused(self, mpsnet, files):
        write_camera(files / "lens.json", replace(photographed().camera, width=HEIGHT, height=WIDTH))
        done = self.align(mpsnet, files, "--lens", files / "lens.json", code=2)
        assert "the lens is that of a photo of 300 x 360 pixels, but this one has 360 x 300" in done.stderr
        done = self.align(mpsnet, files, "--lens", files / "lens.json", "--focal", 50, code=2)
        assert "--lens and --focal both define the lens" in done.stderr

    @pytest.mark.parametrize("given", ["start", "lens"])
    def test_a_camera_of_pixels_that_are_not_square_is_refused(self, mpsnet, files, given: str):
        write_camera(files / "given.json", replace(looking(46, 10, 4), focal=np.array([600.0, 450.0])))
        done = self.align(mpsnet, files, f"--{given}", files / "given.json", code=2)
        assert f"the {given}'s focal lengths are 600 along x and 450 along y" in done.stderr
        assert not (files / "camera.json").exists()

    def test_a_large_photo_under_near_lights_is_made_smaller(self, mpsnet, files, monkeypatch: pytest.MonkeyPatch):
        monkeypatch.setattr("mpsnet_core.estimate.alignment.align.LONGEST", 180)
        rig, true = published_rig(30, 90), photographed().camera
        middle = np.array([0, 0, -6.0])
        write_rig(files / "rig.json", near_rig(middle + 30 * rig.directions, middle))
        write_camera(files / "start.json", looking(46, 10, 4))
        self.align(mpsnet, files, "--start", files / "start.json", "--focal", 60)
        assert degrees_apart(read_camera(files / "camera.json"), true) < 1

    def test_a_small_object_in_a_large_photo_is_placed_by_all_its_pixels(self, mpsnet, files):
        """As well as in a photo of it alone, by the same pixels."""
        photo, (left, top), (height, width) = photographed(), (900, 160), (800, 1300)

        def shifted(camera: Camera) -> Camera:
            return replace(camera, width=width, height=height, centre=camera.centre + np.array([left, top]))

        write_camera(files / "start.json", looking(46, 10, 4))
        self.align(mpsnet, files, "--start", files / "start.json")
        alone = shifted(read_camera(files / "camera.json"))
        image = np.zeros((height, width, 4), np.float32)
        image[top : top + HEIGHT, left : left + WIDTH] = np.dstack([photo.image, photo.mask])
        write_file(files / "photo.exr", image, "float")
        write_camera(files / "start.json", shifted(looking(46, 10, 4)))
        self.align(mpsnet, files, "--start", files / "start.json", "--overlay", files / "overlay.exr")
        shown = read_image(files / "overlay.exr").pixels
        rows, columns = np.nonzero((shown[..., 1] > 0.9) & (shown[..., 0] < 0.1))  # the mesh's, green
        outline = np.ptp(np.argwhere(photo.mask), axis=0)
        assert np.abs((np.ptp(rows), np.ptp(columns)) - outline).max() < 5
        assert max(shown.shape) < 1.6 * max(outline)  # the picture shows the object and a margin
        found, points = read_camera(files / "camera.json"), surface_points(50)
        assert (found.width, found.height) == (width, height)
        assert degrees_apart(found, alone) < 0.01
        assert np.abs(pixels_of(found, points) - pixels_of(alone, points)).max() < 0.02

    def test_a_start_that_only_looks_from_the_right_side_is_moved_to_where_the_object_is(self, mpsnet, files):
        """As a viewport looks: the object elsewhere in the picture, and of another size."""
        start = looking(48, 8, 3, distance=3)
        pose = start.world_from_camera.copy()
        pose[:3, 3] += pose[:3, 0]
        write_camera(files / "start.json", Camera("perspective", WIDTH, HEIGHT, np.full(2, 600.0), None, pose))
        done = self.align(mpsnet, files, "--start", files / "start.json")
        assert "poor fit" not in done.stderr
        assert_the_same(read_camera(files / "camera.json"), photographed().camera)

    @pytest.mark.parametrize("size", [(WIDTH, HEIGHT), (1100, 800)], ids=["large in the photo", "small in it"])
    def test_outlines_that_are_apart_by_a_share_of_the_object_are_a_poor_fit(self, mpsnet, files, size):
        """However large the photo is; mesh and mask share most, and the normals are alike."""
        (width, height), photo = size, photographed()
        centre = np.array([WIDTH / 2, HEIGHT / 2])  # it is in the top left corner
        image = np.zeros((height, width, 4), np.float32)
        image[:HEIGHT, :WIDTH] = np.dstack([photo.image, photo.mask])
        write_file(files / "photo.exr", image, "float")
        write_camera(files / "start.json", replace(photo.camera, width=width, height=height, centre=centre))
        poor = {}
        for stretch in (1, 1.2):
            stretched = bumpy_ball.mesh()
            stretched.vertices[:, 2] *= stretch
            write_mesh(files / "mesh.npz", stretched)
            done = self.align(mpsnet, files, "--start", files / "start.json", "--progress", "json")
            result = json.loads(done.stdout.splitlines()[-1])["result"]
            assert result["overlap"] > 0.93 and result["normals_degrees"] < 25, result
            poor[stretch] = result["poor"]
        assert poor == {1: False, 1.2: True}

    @pytest.mark.long
    def test_a_mirrored_mesh_of_a_nearly_symmetric_object_is_reported(self, mpsnet, files):
        photo = bumpy_ball.photo(looking(15, 20, 10), bumpy_ball.NEARLY_SYMMETRIC)
        write_file(files / "photo.exr", np.dstack([photo.image, photo.mask]), "float")
        write_camera(files / "start.json", looking(18, 18, 8))
        noted, right = {}, bumpy_ball.mesh(bumps=bumpy_ball.NEARLY_SYMMETRIC)
        mirrored = replace(right, vertices=right.vertices * (1, -1, 1), triangles=right.triangles[:, ::-1])
        for name, mesh in (("right", right), ("mirrored", mirrored)):
            write_mesh(files / "mesh.npz", mesh)
            done = self.align(mpsnet, files, "--start", files / "start.json", "--progress", "json")
            result = json.loads(done.stdout.splitlines()[-1])["result"]
            assert result["overlap"] > 0.97 and result["normals_degrees"] < 10, result  # which fits
            noted[name] = "[mirrored-mesh]" in done.stderr + done.stdout, result["poor"]
        assert noted == {"right": (False, False), "mirrored": (True, True)}

    @pytest.mark.long
    def test_a_mirrored_mesh_is_reported_where_pairs_place_it(self, mpsnet, files):
        """Of any shape. From afar, points look alike mirrored and seen from behind: no pair contradicts the others."""
        mesh = bumpy_ball.mesh()
        write_mesh(
            files / "mesh.npz", replace(mesh, vertices=mesh.vertices * (1, 1, -1), triangles=mesh.triangles[:, ::-1])
        )
        points = surface_points(8)
        pairs = self.pairs(files, pixels_of(photographed().camera, points), points * (1, 1, -1))
        done = self.align(mpsnet, files, *pairs, "--focal", 600 / WIDTH * 36)
        assert "[mirrored-mesh]" in done.stderr and "contradicts the others" not in done.stderr

    @pytest.mark.parametrize("shape", [(1, 1), (48, 1), (4, 300)])
    def test_an_object_too_small_or_thin_gets_one_sentence(self, mpsnet, files, shape: tuple[int, int]):
        write_file(files / "photo.exr", np.full((*shape, 3), 0.5), "float")
        done = self.align(mpsnet, files, "--mask", "none", code=2)
        assert f"the object is {shape[1]} x {shape[0]} pixels, too few to align a mesh" in done.stderr

    @pytest.mark.parametrize(
        ("text", "sentence"),
        [
            ("{", "is not valid JSON"),
            ('{"pairs": []}', "holds no list"),
            ('{"pairs": [{"pixel": [1, 2], "point": [1, 2]}]}', 'the "point" of pair 1 is not 3 numbers'),
            ('{"pairs": [{"pixel": [1, NaN], "point": [1, 2, 3]}]}', 'the "pixel" of pair 1 is not 2 numbers'),
        ],
    )
    def test_bad_pairs_get_one_sentence(self, mpsnet, files, text: str, sentence: str):
        (files / "pairs.json").write_text(text)
        done = self.align(mpsnet, files, "--points", files / "pairs.json", code=2)
        assert re.fullmatch(rf"mpsnet: .*{re.escape(sentence)}.*\n", done.stderr), done.stderr
        assert not (files / "camera.json").exists()
