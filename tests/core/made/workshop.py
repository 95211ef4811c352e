"""A folder with a good file of every kind, and command lines of every verb that work in it."""

import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import trimesh
from alicevision_files import scene as alicevision_scene
from alicevision_files import write as write_alicevision
from colmap_files import binary_cameras, binary_images, write_binary, write_text
from dng import mosaic, write_dng
from mesh_file import write_mesh
from metashape_files import SENSOR, cameras_file
from mirror_ball import CROSSTALK, Scene, around, grey_photograph, lamps_around, photograph
from networks import pass_through
from sphere_sample import sphere_sample
from surface_shapes import sphere_mesh
from synthetic import diligent_object, shaded_sphere, write_file

from mpsnet_core import Camera, NormalMap, integrate, write_camera, write_height, write_normals
from mpsnet_core.io.files import write_json
from mpsnet_core.scene.rig import WorldLights, near_rig, write_lp, write_rig, write_world_lights
from mpsnet_core.scene.view_files import write_views
from mpsnet_core.synthesis.job import SampleJob, write_job
from mpsnet_core.synthesis.sample import write_sample

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
}
if find_spec("scipy"):
    for file in ("light_directions.txt", "filenames.txt", "Normal_gt.mat", "mask.png"):
        READS[f"pmsData/ballPNG/{file}"] = "evaluate diligent pmsData --lights 1,2,3 --model lambertian"
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
    "example -o oexample",
    "synthesize --count 1 --size 24 --seed 3 --shapes blobs --processes 1 -o job",
    "evaluate samples empty --model lambertian",
    "estimate shots --rig rig.json --model lambertian -o o",
]


def fill(here: Path) -> None:
    """Put a good file of every kind into a folder."""
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
