"""Whatever the command line is given: it works, or it says in one sentence why not, and leaves nothing behind.

A few hundred cases drawn by Hypothesis, the same ones each time; MPSNET_FUZZ_MINUTES=10 draws others for so long.
"""

import argparse
import itertools
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from alicevision_files import scene as alicevision_scene
from alicevision_files import write as write_alicevision
from colmap_files import binary_cameras, binary_images, write_binary, write_text
from dng import mosaic, write_dng
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from mesh_file import write_mesh
from metashape_files import SENSOR, cameras_file
from mirror_ball import CROSSTALK, Scene, around, grey_photograph, lamps_around, photograph
from networks import pass_through
from odd_input import WORDS, odd_picture, odd_pixels, spoilt
from sphere_sample import sphere_sample
from surface_shapes import sphere_mesh
from synthetic import diligent_object, shaded_sphere, write_file

from mpsnet_core.calibrate.lights import write_lp
from mpsnet_core.cli import main
from mpsnet_core.cli.command import argument_parser
from mpsnet_core.errors import InputError
from mpsnet_core.io.files import write_json
from mpsnet_core.relief.height_files import read_height, write_height
from mpsnet_core.relief.integration.integrate import integrate
from mpsnet_core.scene.camera import Camera, write_camera
from mpsnet_core.scene.normal_map import NormalMap, write_normals
from mpsnet_core.scene.photogrammetry import read_cameras
from mpsnet_core.scene.rig import near_rig, write_rig
from mpsnet_core.scene.view_files import write_views
from mpsnet_core.scene.world_lights import WorldLights, write_world_lights
from mpsnet_core.synthesis.job import SampleJob, write_job
from mpsnet_core.synthesis.reflectance.fits import read_fits
from mpsnet_core.synthesis.sample import read_sample, write_sample

pytestmark = pytest.mark.long

MINUTES = float(os.environ.get("MPSNET_FUZZ_MINUTES", "0"))
QUICK = 150
LONGEST_LINE = 600
SIDE = 24
SPHERE = shaded_sphere(SIDE)

ESTIMATE = "estimate photo.exr --model lambertian -o o.png"
VIEWS = "views --mesh mesh.npz --cameras views.json --model lambertian --size 16 -o o.png"
BAKE = "bake --size 16 --margin 2 --view camera.json=normals.png -o o.png"
OTHERS = ("webp", "bmp", "tga", "hdr")
# Command lines that work, by the file that each reads first and foremost; what it writes is called o*.
READS = {
    "photo.exr": f"{ESTIMATE} --rig rig.json",
    "photo.png": "estimate photo.png --rig rig.json --model lambertian-grey-world --mask threshold:0.1 -o o.exr",
    "photo.tif": "estimate photo.tif --rig rig.json --model lambertian --confidence o.tif -o o.png",
    "photo.jpg": "estimate photo.jpg --rig rig.json --model lambertian -o o.png",
    **{f"photo.{kind}": f"estimate photo.{kind} --rig rig.json --model lambertian -o o.png" for kind in OTHERS},
    "rig.json": f"{ESTIMATE} --rig rig.json",
    "rig.lp": f"{ESTIMATE} --rig rig.lp",
    "lights.lp": "calibrate lights lights.lp --lights 1,2,3 -o o.json",
    "near.json": f"{ESTIMATE} --rig near.json --camera camera.json",
    "camera.json": f"{ESTIMATE} --rig near.json --camera camera.json --mesh mesh.npz",
    "mask.png": f"{ESTIMATE} --rig rig.json --mask mask.png",
    "dark.png": f"{ESTIMATE} --rig rig.json --dark dark.png --flat flat.png",
    "flat.png": f"{ESTIMATE} --rig rig.json --flat flat.png --flat-smooth 2",
    "white.exr": f"{ESTIMATE} --rig rig.json --white white.exr --albedo oa.png",
    "net.onnx": "estimate photo.exr --rig rig.json --model net.onnx -o o.png",
    "ball.exr": "calibrate lights ball.exr --overlay ov.png --json oj.json -o o.json",
    "grey.exr": "calibrate mixing grey.exr --rig rig.json --circle 100,80,70 --overlay ov.png -o o.json",
    "mesh.npz": f"{BAKE} --mesh mesh.npz",
    "mesh.obj": f"{BAKE} --mesh mesh.obj",
    "mesh.ply": f"{BAKE} --mesh mesh.ply",
    "mesh.glb": f"{BAKE} --mesh mesh.glb",
    "rich.glb": f"{BAKE} --mesh rich.glb --size 16x8 --unit 1",
    "smooth.obj": f"{BAKE} --mesh smooth.obj --up z",
    "pages.ply": "bake --size 16 --view camera.json=normals.png --mesh pages.ply -o o_<MATERIAL>.png",
    "strips.ply": f"{BAKE} --mesh strips.ply",
    "shape.stl": "preview --mesh shape.stl --rig rig.json --camera camera.json --size 16 -o o.png",
    "normals.png": "bake --size 16 --mesh mesh.npz --view camera.json=normals.png --level on -o o.exr",
    "normals.exr": "integrate normals.exr --camera camera.json --height o.exr --mesh om.ply --curvature oc.png",
    "confidence.png": f"{BAKE} --mesh mesh.npz --confidence confidence.png",
    "albedo.png": f"{BAKE} --mesh mesh.npz --albedo albedo.png",
    "present.png": f"{BAKE} --mesh mesh.npz --onto present.png",
    "maps.json": f"{BAKE} --mesh mesh.npz --onto maps.json",
    "height.exr.json": "integrate normals.png --height height.exr",
    "wide.json": "integrate normals.png --camera wide.json --occlusion oo.png --relit or.png --method bilateral",
    "present.exr": "integrate present.exr --uvs mesh.obj --height o.png",
    "cloth.exr": "material cloth.exr --rig rig.json --pixel-size 0.1mm --overlap 0.3 -o o",
    "colmap/cameras.txt": "cameras colmap --photos photos -o o",
    "colmap/images.txt": "cameras colmap --photos photos -o o",
    "binary/cameras.bin": "cameras binary --photos photos -o o",
    "binary/images.bin": "cameras binary --photos photos -o o",
    "cameras.xml": "cameras cameras.xml --photos photos -o o",
    "cameras.sfm": "cameras cameras.sfm --photos photos -o o",
    "views.json": f"{VIEWS} --rig rig.json",
    "world.json": f"{VIEWS} --rig world.json --lights-in world",
    "sample.exr": "show sample.exr -o o.png",
    "job/job.json": "make job --processes 1",
    "pmsData/ballPNG/light_directions.txt": "evaluate diligent pmsData --lights 1,2,3 --model lambertian",
    "pmsData/ballPNG/filenames.txt": "evaluate diligent pmsData --lights 1,2,3 --model lambertian",
    "pmsData/ballPNG/Normal_gt.mat": "evaluate diligent pmsData --lights 1,2,3 --model lambertian",
    "pmsData/ballPNG/mask.png": "evaluate diligent pmsData --lights 1,2,3 --model lambertian",
}
if find_spec("torch"):
    READS["tiny.toml"] = "train --recipe tiny.toml --samples job --stop-after 1 -o o.onnx"
    READS["checkpoint"] = "train --recipe tiny.toml --samples job --resume checkpoint --stop-after 2 -o o.onnx"
if find_spec("rawpy"):
    READS["photo.dng"] = "estimate photo.dng --rig rig.json --model lambertian --mask threshold:0.1 -o o.png"
if find_spec("pillow_heif"):
    READS["photo.heic"] = "estimate photo.heic --rig rig.json --model lambertian -o o.png"
if find_spec("av"):
    READS["clip.mkv"] = "estimate clip.mkv --rig rig.json --model lambertian -o o"
# Verbs whose options are tried, beside those above.
VERBS = [
    *(
        "superpose photo.exr white.exr -o o.exr",
        "mask photo.exr --mask threshold:0.1 --overlay ov.png -o o.png",
        "check photo.exr --rig rig.json --mask threshold:0.1 --json found.json",
        "models net.onnx",
    ),
    "calibrate lights red.exr green.exr blue.exr --per-light --circle 100,80,70 -o o.json",
    "integrate normals.png --height o.exr --mesh om.glb --occlusion oo.png --relit or.png --albedo albedo.png",
    "synthesize --count 1 --size 24 --seed 3 --shapes blobs --processes 1 -o job",
    "quantize net.onnx --samples empty -o o.onnx",
    "evaluate samples empty --model lambertian",
    "estimate shots --rig rig.json --model lambertian -o o",
]
# What the library reads and no verb does, or no quick one.
READERS: dict[str, Callable[[Path], Any]] = {
    "height.exr": read_height,
    "height.exr.json": lambda path: read_height(path.with_suffix("")),
    "sample.exr": read_sample,
    "fits.npz": read_fits,
    "cameras.xml": read_cameras,
    "cameras.sfm": read_cameras,
}
# A scheduler that is not there is waited for; --blender starts what it names.
NOT_TRIED = {"--cluster", "--blender", "--help", "--version"}


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a good file of every kind."""
    here = tmp_path_factory.mktemp("workshop")
    pose = np.eye(4)
    pose[2, 3] = 5
    for name, kind in (("exr", "float"), ("png", "uint8"), ("tif", "uint16"), ("jpg", "uint8")):
        write_file(here / f"photo.{name}", SPHERE.image, kind)
    for name in OTHERS:
        write_file(here / f"photo.{name}", SPHERE.image, "float" if name == "hdr" else "uint8")
    if "photo.heic" in READS:
        import pillow_heif

        stored = np.rint(255 * SPHERE.image.clip(0, 1)).astype(np.uint8)
        pillow_heif.from_bytes("RGB", (SIDE, SIDE), stored.tobytes()).save(here / "photo.heic")
    for name, value in (("white.exr", 0.5), ("dark.png", 0.0), ("flat.png", 0.8)):
        pixels = value * (1 + 0.1 * np.random.default_rng(1).random((SIDE, SIDE, 3)))
        write_file(here / name, pixels, "float" if name.endswith("exr") else "uint8")
    cloth = 0.4 + 0.1 * np.random.default_rng(2).random((64, 64, 3))
    write_file(here / "cloth.exr", cloth, "float")
    for name in ("mask.png", "confidence.png"):
        write_file(here / name, SPHERE.mask, "uint8")
    for name in ("albedo.png", "present.png"):
        write_file(here / name, np.full((SIDE, SIDE, 3), (0.5, 0.5, 1.0)), "uint8")
    write_file(here / "present.exr", np.full((16, 16, 3), (0.5, 0.5, 1.0)), "float")
    write_rig(here / "rig.json", SPHERE.rig)
    write_rig(here / "near.json", near_rig([[0, 2, 1], [-2, -1, 1], [2, -1, 1]], [0, 0, -5.0]))
    write_world_lights(here / "world.json", WorldLights(SPHERE.rig.directions))
    write_lp(here / "rig.lp", SPHERE.rig.directions, list("abc"))
    write_lp(here / "lights.lp", np.vstack([SPHERE.rig.directions, [0, 0, 1]]), list("abcd"))
    camera = Camera("orthographic", SIDE, SIDE, (SIDE / 2.2,) * 2, None, pose)
    write_camera(here / "camera.json", camera)
    write_camera(here / "wide.json", Camera("perspective", SIDE, SIDE, (SIDE, SIDE), None, pose))
    normals = NormalMap(SPHERE.normals, SPHERE.mask)
    for name in ("normals.png", "normals.exr"):
        write_normals(here / name, normals)
    write_height(here / "height.exr", integrate(normals, camera), unit="mm")
    mesh = sphere_mesh(8, 4)
    write_mesh(here / "mesh.npz", mesh)
    corners = mesh.vertices[mesh.triangles].reshape(-1, 3)
    lines = [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in corners]
    lines += [f"vt {u:.4f} {v:.4f}" for u, v in mesh.uvs.reshape(-1, 2)]
    lines += [f"f {k}/{k} {k + 1}/{k + 1} {k + 2}/{k + 2}" for k in range(1, len(corners), 3)]
    (here / "mesh.obj").write_text("\n".join(["o ball", "usemtl skin", *lines, ""]))
    worn = trimesh.visual.TextureVisuals(mesh.uvs.reshape(-1, 2), trimesh.visual.material.PBRMaterial(name="skin"))
    ball = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=worn, process=False)
    ball.export(here / "mesh.glb")
    rows = np.column_stack([corners, mesh.uvs.reshape(-1, 2)]).round(4).tolist()
    head = ["ply", "format ascii 1.0", f"element vertex {len(rows)}", *(f"property float {name}" for name in "xyzst")]
    head += [f"element face {len(rows) // 3}", "property list uchar int vertex_indices", "end_header"]
    faces = [f"3 {k} {k + 1} {k + 2}" for k in range(0, len(rows), 3)]
    (here / "mesh.ply").write_text("\n".join([*head, *(" ".join(map(str, row)) for row in rows), *faces, ""]))
    _odd_meshes(here)
    maps = [{"file": "present.png", "object": "ball"}, {"file": "present.png", "convention": "directx"}]
    write_json(here / "maps.json", {"format": "mpsnet-present-maps", "version": 1, "maps": maps})
    pass_through(here / "net.onnx")
    middle, size = (0.0, 0.0, 0.0), (200, 160)
    balls = Scene([(middle, 70.0)], lamps_around(middle, 1e6), size)
    facing = np.array([around(*angle) for angle in [(30, 90), (35, 205), (25, 335)]])
    write_file(here / "ball.exr", photograph(balls), "float")
    for number, name in enumerate(("red", "green", "blue")):
        write_file(here / f"{name}.exr", photograph(balls, np.ones((3, 3)), on=[number]), "float")
    write_file(here / "grey.exr", grey_photograph(Scene([(middle, 70.0)], [], size), CROSSTALK, facing), "float")
    for name in ("photos", "colmap", "binary", "empty", "job", "shots"):
        (here / name).mkdir()
    for name in ("a.jpg", "b.jpg", "c.jpg", "DSC_0001.JPG", "DSC_0002.JPG"):
        write_file(here / "photos" / name, SPHERE.image, "uint8")
    for number in range(3):
        shutil.copy(here / "photo.png", here / "shots" / f"frame_{number}.png")
    poses = "1 1 0 0 0 0 0 5 1 a.jpg\n1.0 2.0 -1\n2 0 1 0 0 0 0 5 1 b.jpg\n\n"
    if "photo.dng" in READS:
        write_dng(here / "photo.dng", np.rint(65535 * mosaic(SPHERE.image)))
    if "clip.mkv" in READS:
        from test_video import clip

        clip(here / "clip.mkv", [np.rint(255 * SPHERE.image).astype(np.uint8)] * 2)
    write_text(here / "colmap", f"1 SIMPLE_RADIAL {SIDE} {SIDE} 30 12 12 -0.05\n", poses)
    intrinsics = (1, 4, SIDE, SIDE, (30.0, 31.0, 12.0, 12.0, -0.05, 0.01, 0.001, 0.002))
    write_binary(here / "binary", binary_cameras(intrinsics), binary_images("a.jpg", "b.jpg", camera=1))
    sensor = SENSOR.replace("640", str(SIDE)).replace("480", str(SIDE))
    cameras_file(here, sensor=sensor, calibration={"f": 30.0, "cx": 0.5, "cy": -0.5, "k1": -0.05, "p1": 0.001})
    lens = {"focalLength": "36", "principalPoint": ["0.5", "0.5"], "width": str(SIDE), "height": str(SIDE)}
    bent = alicevision_scene("1.2.8", "brown", **lens, pixelRatio="1", distortionParams=["-0.05", "0", "0", "0", "0"])
    write_alicevision(here, bent)
    write_views(here / "views.json", [("front", "photo.exr", camera), ("again", "photo.png", camera)])
    sample = sphere_sample(SIDE)
    write_sample(here / "sample.exr", sample)
    write_job(here / "job", SampleJob("synthesis", 1, seed=3, size=SIDE, shapes=("blobs",)))
    write_sample(here / "job" / "sample_000000.exr", sample)
    shapes = {"fc1": (6, 21), "b1": (21,), "fc2": (21, 21), "b2": (21,), "fc3": (21, 3), "b3": (3,)}
    layers = {name: np.full((2, *shape), 0.01, np.float32) for name, shape in shapes.items()}
    np.savez(here / "fits.npz", names=np.array(["a", "b"]), **layers)
    diligent_object(here / "pmsData", "ball")
    recipe = (
        'name = "tiny"\ntitle = "a test"\nnetwork = "demultiplexer"\nsteps = 1\nbatch = 1\ncrop = 16\nwarm_up = 0\n'
    )
    (here / "tiny.toml").write_text(recipe + "learning_rate = 0.001\n[options]\nwidth = 4\n")
    if find_spec("torch"):
        from mpsnet_core.learning.training.loop import TrainingPaths, train
        from mpsnet_core.learning.training.recipe import read_recipe

        train(read_recipe(here / "tiny.toml"), [here / "job"], [], paths=TrainingPaths(here / "checkpoint"))
    return here


def _odd_meshes(here: Path) -> None:
    """Meshes with what few files hold."""
    import test_mesh as meshes

    rich = meshes.glb(here / "rich.glb", normals=True)
    tangents = meshes.tangents_of([[1, 0, 0, 1]] * 4)
    for edit in (meshes.instanced, meshes.morphed(True), meshes.sparse, tangents, meshes.as_strips):
        meshes.edited(rich, edit)
    meshes.obj(here / "smooth.obj", "s 1\nf 1/1 2/2 3/3 4/4\no b\ns off\nf 2/5/2 5/6/2 6/7/2 3/8/2")
    faces = "3 0 1 2 6 0 0 1 0 1 1 0\n3 1 4 5 6 0 0 1 0 1 1 1"
    meshes.ply_of(here / "pages.ply", comments=meshes.PAGES, properties=meshes.WEDGES, faces=faces)
    meshes.ply_of(here / "strips.ply", of_vertices="s t", faces="9 1 2 0 3 -1 1 4 2 5")
    trimesh.creation.box().export(here / "shape.stl")


@dataclass(frozen=True)
class Spoilt:
    """What a file is to hold; where a case fails, the file stays in its folder."""

    name: str
    data: Any = field(repr=False)


@st.composite
def spoilt_files(draw: st.DrawFn, workshop: Path, names: Mapping[str, Any]) -> Spoilt:
    """One of the workshop's files, not quite as it is."""
    name = draw(st.sampled_from(sorted(names)))
    return Spoilt(name, draw(spoilt(workshop / name)))


class Bench:
    """Copies of the workshop, in which one case after the other is tried."""

    def __init__(self, workshop: Path, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
        self.workshop, self._folder, self._capfd = workshop, folder, capfd
        self._number = itertools.count()

    def copy(self) -> Path:
        here = self._folder / f"case{next(self._number)}"
        shutil.copytree(self.workshop, here, copy_function=os.link)  # nothing is written in place
        (here / "loop").symlink_to("loop")
        os.chdir(here)
        return here

    def leave(self, here: Path) -> None:
        os.chdir(self._folder)
        shutil.rmtree(here)

    def run(self, here: Path, arguments: list[str]) -> str:
        """Run the command line, whose result is what it may be; gives its sentence, "" where it works."""
        before = _listing(here)
        self._capfd.readouterr()
        try:
            code = main(arguments)
        except SystemExit as left:  # --help
            code = left.code
        out, err = self._capfd.readouterr()
        assert code in (0, 2), (code, err, _logs(self._folder))
        lines = err.splitlines()
        assert all(len(line) <= LONGEST_LINE and line.isprintable() for line in lines), err
        assert all(line.isprintable() for line in out.split("\n")), out
        if code:
            # A run that made some of several photos names each of the others, after its notes.
            sentences = [line for line in lines if "failed" not in out or not line.startswith("note: ")]
            assert all(line.startswith("mpsnet: ") for line in sentences) and "Traceback" not in err, err
            assert len(sentences) == 1 or (sentences and "failed" in out), err
            left = {name: size for name, size in _listing(here).items() if before.get(name) != size}
            # The picture that shows what was found, and what a run over several photos made of those before.
            told = {name for name in left if f"{name} shows the ball that" in err}
            assert all(name.startswith("o/") for name in left.keys() - told), (left, err)
            assert before.keys() <= _listing(here).keys()
        else:
            assert all(line.startswith("note: ") for line in lines), err
        return err if code else ""


def _put(path: Path, data: bytes) -> None:
    path.unlink()
    path.write_bytes(data)


def _listing(folder: Path) -> dict[str, int]:
    return {str(path.relative_to(folder)): path.lstat().st_size for path in folder.rglob("*") if not path.is_dir()}


def _logs(folder: Path) -> str:
    return "\n".join(file.read_text() for file in folder.glob("mpsnet-*.log"))


@pytest.fixture
def bench(
    workshop: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Bench]:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(sys, "warnoptions", ["error"])  # else the command line hides NumPy's warnings
    kept = Path.cwd()
    yield Bench(workshop, tmp_path, capfd)
    os.chdir(kept)


def hold(check: Callable[..., None], **drawn: st.SearchStrategy[Any]) -> None:
    """Try what is drawn: the same cases each time, or others for as long as is asked for."""
    checks = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
    phases = [Phase.explicit, Phase.generate, Phase.shrink]
    asked = settings(
        max_examples=QUICK, derandomize=not MINUTES, deadline=None, suppress_health_check=checks, database=None,
        phases=phases, print_blob=False,
    )  # fmt: skip
    end = time.monotonic() + 60 * MINUTES / 4
    for _ in itertools.count():
        tried = asked(given(**drawn)(check))
        (seed(time.time_ns())(tried) if MINUTES else tried)()
        if time.monotonic() >= end:
            return


def test_the_workshop_is_in_order(bench: Bench) -> None:
    refused = {}
    for line in (*READS.values(), *VERBS):
        here = bench.copy()
        began = time.monotonic()
        if (sentence := bench.run(here, line.split())) and "empty" not in line:
            refused[line] = sentence
        print(f"{time.monotonic() - began:.2f} {line}")
        bench.leave(here)
    assert not refused, "\n".join(f"{line}: {why}" for line, why in refused.items())


@pytest.mark.filterwarnings("error", "ignore::hypothesis.errors.HypothesisWarning")
def test_spoilt_files(bench: Bench) -> None:
    def check(case: Spoilt) -> None:
        here = bench.copy()
        _put(here / case.name, case.data)
        bench.run(here, READS[case.name].split())
        bench.leave(here)

    hold(check, case=spoilt_files(bench.workshop, READS))


@pytest.mark.filterwarnings("error", "ignore::hypothesis.errors.HypothesisWarning")
def test_odd_pixels(bench: Bench) -> None:
    pictures = sorted(name for name in READS if name.endswith(".exr") and name not in ("sample.exr", "height.exr"))

    @st.composite
    def cases(draw: st.DrawFn) -> Spoilt:
        name = draw(st.sampled_from(pictures))
        good = SPHERE.image if name == "photo.exr" else np.full((SIDE, SIDE, 3), 0.4, np.float32)
        return Spoilt(name, draw(odd_pixels(good)))

    def check(case: Spoilt) -> None:
        here = bench.copy()
        (here / case.name).unlink()
        odd_picture(here / case.name, *case.data)
        bench.run(here, READS[case.name].split())
        bench.leave(here)

    hold(check, case=cases())


@pytest.mark.filterwarnings("error", "ignore::hypothesis.errors.HypothesisWarning")
def test_odd_options(bench: Bench) -> None:
    lines = [line.split() for line in (*dict.fromkeys(READS.values()), *VERBS)]

    @st.composite
    def cases(draw: st.DrawFn) -> list[str]:
        line = list(draw(st.sampled_from(lines)))
        for _ in range(draw(st.integers(1, 2))):
            word = draw(st.sampled_from(WORDS))
            if draw(st.integers(0, 3)):
                line.append(f"{draw(st.sampled_from(_options(line)))}={word}")
            else:  # a positional argument, or a value that is there
                line[draw(st.sampled_from(_values(line)))] = word
        return line

    def check(line: list[str]) -> None:
        here = bench.copy()
        bench.run(here, line)
        bench.leave(here)

    hold(check, line=cases())


@pytest.mark.filterwarnings("error", "ignore::hypothesis.errors.HypothesisWarning")
def test_spoilt_files_of_the_library(bench: Bench) -> None:
    def check(case: Spoilt) -> None:
        here = bench.copy()
        _put(here / case.name, case.data)
        try:
            READERS[case.name](here / case.name)
        except InputError as error:
            assert str(error).isprintable() and len(str(error)) < LONGEST_LINE
        assert bench._capfd.readouterr() == ("", "")
        bench.leave(here)

    hold(check, case=spoilt_files(bench.workshop, READERS))


def _options(line: list[str]) -> list[str]:
    """The options of a command line's verb that take a value."""
    parser: argparse.ArgumentParser = argument_parser()
    for word in line:
        choices = next((a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction)), None)
        if not choices:
            break
        parser = choices[word]
    return [a.option_strings[-1] for a in parser._actions if a.option_strings and a.option_strings[-1] not in NOT_TRIED]


def _values(line: list[str]) -> list[int]:
    """Where the values and positional arguments of a command line stand."""
    words = 2 if line[0] in ("calibrate", "evaluate") else 1
    return [place for place in range(words, len(line)) if not line[place].startswith("-")] or [0]
