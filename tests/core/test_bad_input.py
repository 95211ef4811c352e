"""Every kind of bad input we know of, and the one sentence it gets.

A case is a name, what brings the bad input about on a `Bench`, and the words that its sentence must hold, in order,
parted by "…". Command lines run in this process, with what they print on stderr as their sentence.
"""

import contextlib
import io
import json
import logging
import os
import pickle
import re
import struct
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import trimesh
from mesh_file import write_mesh
from networks import DENSE, card, conv, pass_through, random_weights, write_model
from onnx import TensorProto, helper
from sphere_sample import sphere_sample
from synthetic import diligent_object, mat_file, named, shaded_sphere, write_file, write_parts
from test_mesh import glb

from mpsnet_core import (
    Camera,
    Capture,
    InputError,
    LightRig,
    Mesh,
    NormalMap,
    View,
    albedo_from_white,
    bake_normals,
    estimate_normals,
    published_rig,
    read_camera,
    read_capture,
    read_image,
    read_mask,
    read_mesh,
    read_normals,
    read_rig,
    write_camera,
    write_image,
    write_normals,
    write_rig,
    write_texture,
)
from mpsnet_core.cli import main
from mpsnet_core.errors import LONGEST
from mpsnet_core.estimate.card import CARD_VERSION
from mpsnet_core.estimate.lambertian import lambertian_normals
from mpsnet_core.io import images
from mpsnet_core.io.frames import output_files
from mpsnet_core.learning.evaluation.diligent import read_diligent, read_truth
from mpsnet_core.learning.evaluation.magnify import estimate_magnified
from mpsnet_core.synthesis.job import SampleJob, write_job
from mpsnet_core.synthesis.sample import write_sample

SPHERE = shaded_sphere(16)
NAN = float("nan")
# A square that faces +z, its UVs the whole texture.
SQUARE: dict[str, Any] = {
    "vertices": np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]]),
    "triangles": np.array([[0, 1, 2], [0, 2, 3]]),
    "corner_normals": np.tile([0, 0, 1.0], (2, 3, 1)),
    "uvs": np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1.0]]]),
}
JOB = SampleJob("synthesis", 2, seed=3, size=16)
AWAY = np.diag([1.0, -1, -1, 1])  # turned about x: looks along +z
AWAY[2, 3] = 5


class Bench:
    """A folder with what each verb needs, in good order, and ways to make the same in bad order."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __truediv__(self, name: str) -> Path:
        return self.folder / name

    def text(self, name: str, text: str) -> Path:
        (self / name).write_text(text)
        return self / name

    def bytes(self, name: str, data: bytes) -> Path:
        (self / name).write_bytes(data)
        return self / name

    def rig(self, name: str = "rig.json", **changes: Any) -> Path:
        write_rig(self / name, SPHERE.rig)
        return self.changed(self / name, changes)

    def lights(self, **changes: Any) -> Path:
        """A rig file with its second light changed; None takes a key out."""
        light = {"slant": 30, "tilt": 210, **changes}
        good = [{"slant": 30, "tilt": tilt} for tilt in (90, 330)]
        light = {key: value for key, value in light.items() if value is not None}
        return self.rig(lights=[good[0], light, good[1]])

    def camera(self, name: str = "camera.json", *, pose: np.ndarray | None = None, **changes: Any) -> Path:
        write_camera(self / name, Camera("orthographic", 16, 16, (8, 8), None, np.eye(4) if pose is None else pose))
        return self.changed(self / name, changes)

    def changed(self, path: Path, changes: dict[str, Any]) -> Path:
        data = json.loads(path.read_text()) | changes
        path.write_text(json.dumps({key: value for key, value in data.items() if value is not None}))
        return path

    def photo(self, name: str = "photo.exr", pixels: np.ndarray = SPHERE.image, kind: str = "float") -> Path:
        return write_file(self / name, pixels, kind)

    def latin_named(self) -> Path:
        """A photo whose name was written by a system that does not know UTF-8."""
        return self.photo("photo.png", kind="uint8").rename(self / os.fsdecode(b"gr\xf6sse.png"))

    def gif(self, name: str) -> Path:
        """One black pixel."""
        head = b"GIF89a" + bytes((1, 0, 1, 0, 0x80, 0, 0)) + bytes(6)
        return self.bytes(name, head + b"," + bytes((0, 0, 0, 0, 1, 0, 1, 0, 0, 2, 2, 0x44, 1, 0)) + b";")

    def turned_bit(self, byte: int) -> Path:
        """A PNG whose head says something else than its checksum."""
        data = bytearray(self.photo("photo.png", kind="uint8").read_bytes())
        data[byte] ^= 4
        return self.bytes("photo.png", bytes(data))

    def replaced(self, path: Path, old: bytes, new: bytes) -> Path:
        """The same file with some of its bytes changed."""
        data = path.read_bytes()
        assert old in data
        return self.bytes(path.name, data.replace(old, new))

    def mask(self, name: str = "mask.png", values: np.ndarray = SPHERE.mask) -> Path:
        return write_file(self / name, values, "uint8")

    def normals(self, name: str = "normals.png", size: int = 16) -> Path:
        sphere = shaded_sphere(size)
        write_normals(self / name, NormalMap(sphere.normals, sphere.mask))
        return self / name

    def mesh(self, name: str = "mesh.npz", **changes: Any) -> Path:
        """The square as the add-on writes it; None takes an array out."""
        write_mesh(self / name, Mesh(**SQUARE))
        with np.load(self / name) as data:
            arrays = {**data, **changes}
        np.savez(self / name, **{key: value for key, value in arrays.items() if value is not None})
        return self / name

    def diligent(self, **files: str) -> Path:
        """DiLiGenT's layout with one object; `files` overwrites a file's text, "" removes it."""
        diligent_object(self / "pmsData", "ball")
        for name, text in files.items():
            path = next((self / "pmsData" / "ballPNG").glob(f"{name}*"))
            path.write_text(text) if text else path.unlink()
        return self / "pmsData"

    def run(self, *arguments: str | Path) -> None:
        """Run the command line; its one line on stderr is raised as an InputError."""
        words = io.StringIO()
        with contextlib.redirect_stderr(words), contextlib.redirect_stdout(io.StringIO()):
            code = main([str(argument) for argument in arguments])
        assert code == 2, words.getvalue()
        (line,) = words.getvalue().splitlines()
        assert line.startswith("mpsnet: ")
        raise InputError(line.removeprefix("mpsnet: "))

    def estimate(self, *photos: str | Path, output: str = "out.png", **options: str | Path) -> None:
        """`mpsnet estimate` with good values for what is not given."""
        given = {"rig": self.rig(), "mask": self.mask(), **options}
        flags = [part for key, value in given.items() for part in (f"--{key}", value)]
        self.run("estimate", *(photos or [self.photo()]), *flags, "-o", self / output)

    def bake(self, *arguments: str | Path, view: str | None = None, output: str = "texture.png") -> None:
        """`mpsnet bake` with good values for what is not given; later arguments win."""
        view = view or f"{self.camera()}={self.normals()}"
        good = ["--size", "32", "--margin", "2", "--view", view]
        if "--mesh" not in arguments:
            good += ["--mesh", self.mesh()]
        self.run("bake", *good, "-o", self / output, *arguments)

    def evaluate(self, *arguments: str | Path) -> None:
        self.run("evaluate", "diligent", self.diligent(), "--lights", "1,2,3", *arguments)

    def synthesize(self, *arguments: str | Path, job: SampleJob | None = None) -> None:
        """`mpsnet synthesize` with good values for what is not given; in a folder that holds a job, where one is."""
        if job is not None:
            (self / "s").mkdir()
            write_job(self / "s", job)
        self.run("synthesize", "--count", "2", "--size", "16", "--seed", "3", "-o", self / "s", *arguments)

    def recipe(self, **changes: Any) -> Path:
        """A training recipe of one short step; None takes a key out."""
        good = {"name": "tiny", "title": "a test", "network": "demultiplexer", "steps": 1, "batch": 1, "crop": 16}
        good["warm_up"] = 0
        lines = [f"{key} = {json.dumps(value)}" for key, value in (good | changes).items() if value is not None]
        return self.text("tiny.toml", "\n".join([*lines, ""]))

    def samples(self, name: str = "samples", light: float = 1.0) -> Path:
        sample = sphere_sample(16)
        (self / name).mkdir()
        write_sample(self / name / "sample_000000.exr", replace(sample, lights=light * sample.lights))
        return self / name

    def train(self, *arguments: str | Path, samples: Path | None = None, **changes: Any) -> None:
        """`mpsnet train` with good values for what is not given; later arguments win. changes: of the recipe."""
        good = ["--recipe", self.recipe(**changes), "--samples", samples or self.samples(), "-o", self / "out.onnx"]
        self.run("train", *good, *arguments)

    def checkpoint(self, name: str = "c", **changes: Any) -> Path:
        """What a run leaves that had the good samples and, with these changes, the good recipe."""
        from mpsnet_core.learning.training.loop import Places, train
        from mpsnet_core.learning.training.recipe import read_recipe

        samples = self / "samples"
        folder = samples if samples.exists() else self.samples()
        train(read_recipe(self.recipe(**changes)), [folder], [], places=Places(self / name))
        return self / name

    def resume(self, checkpoint: Path, **changes: Any) -> None:
        self.train("--resume", checkpoint, samples=self / "samples", **changes)

    def make(self, *arguments: str | Path, **changes: Any) -> None:
        """`mpsnet make` with something changed in the job; None takes a key out."""
        write_job(self.folder, JOB)
        self.changed(self / "job.json", changes)
        self.run("make", self.folder, *arguments)


def dense(output: str = "normals", **changes: Any) -> Callable[[Path], Path]:
    """A one-convolution network with something wrong in it."""
    count, shape = changes.pop("channels", 3), changes.pop("shape", DENSE)
    weights = random_weights(0, w=(changes.pop("answers", 3), count, 1, 1))
    nodes = changes.pop("nodes", [conv("x", output, "w")])
    model_card = changes.pop("card", card())

    def write(path: Path) -> Path:
        inputs, outputs = {"x": shape}, {output: (None,) * 4}
        return write_model(path, nodes, weights, model_card, inputs=inputs, outputs=outputs, **changes)

    return write


BODY = helper.make_graph(
    [helper.make_node("Identity", ["in"], ["more"]), helper.make_node("Identity", ["of_loop"], ["out"])],
    "endless",
    [
        helper.make_tensor_value_info("turn", TensorProto.INT64, []),
        helper.make_tensor_value_info("in", TensorProto.BOOL, []),
        helper.make_tensor_value_info("of_loop", TensorProto.FLOAT, None),
    ],
    [
        helper.make_tensor_value_info("more", TensorProto.BOOL, []),
        helper.make_tensor_value_info("out", TensorProto.FLOAT, None),
    ],
)
ENDLESS = [
    helper.make_node("Constant", [], ["yes"], value=helper.make_tensor("v", TensorProto.BOOL, [], [True])),
    helper.make_node("Loop", ["", "yes", "x"], ["normals"], body=BODY),
]
# One number of 2^40.
MOSTLY_ZERO = helper.make_sparse_tensor(
    helper.make_tensor("few", TensorProto.FLOAT, [1], [1.0]),
    helper.make_tensor("at", TensorProto.INT64, [1], [0]),
    [1 << 40],
)


def own_operator(path: Path) -> Path:
    """A network whose "Relu" is of its own making."""
    model = onnx.load(pass_through(path))
    inner = [helper.make_node("Identity", ["a"], ["b"])]
    model.functions.append(helper.make_function("", "Relu", ["a"], ["b"], inner, model.opset_import))
    onnx.save(model, path)
    return path


def use(model: Callable[[Path], Path]) -> Callable[[Bench], Any]:
    return lambda b: estimate_normals(SPHERE.capture(), model(b / "m.onnx"))


def card_with(**changes: Any) -> Callable[[Bench], Any]:
    """The good card's text with some values changed; None takes a key out."""
    data = json.loads(card().to_json()) | changes
    return use(dense(card={key: value for key, value in data.items() if value is not None}))


def huge_png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def huge_exr(b: Bench) -> Path:
    """An EXR whose header says it is 100000 x 100000."""
    data = b.photo("huge.exr").read_bytes()
    small, huge = struct.pack("<4i", 0, 0, 15, 15), struct.pack("<4i", 0, 0, 99999, 99999)
    assert small in data
    return b.bytes("huge.exr", data.replace(small, huge))


def cut(path: Path, share: float = 0.6) -> Path:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    return path


def pickled(b: Bench) -> Path:
    """An npz that would run code if it were unpickled."""

    class Danger:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(b / "unpickled"),)

    np.savez(b / "mesh.npz", format=np.array("mpsnet-mesh"), vertices=np.array([Danger()], dtype=object))
    return b / "mesh.npz"


def with_code(b: Bench, archived: bool) -> Path:
    """A checkpoint that would run code if it were unpickled."""

    class Danger:
        def __reduce__(self) -> tuple[Any, ...]:
            return os.mkdir, (str(b / "unpickled"),)

    data = pickle.dumps({"format": "mpsnet-checkpoint", "step": Danger()}, protocol=2)
    if not archived:
        return b.bytes("c", data)
    with zipfile.ZipFile(b / "c", "w") as archive:
        for name, content in (("data.pkl", data), ("version", b"3\n"), ("byteorder", b"little")):
            archive.writestr(f"c/{name}", content)
    return b / "c"


def without(library: str, b: Bench, run: Callable[[], Any] | None = None) -> None:
    """Train, or what else is to be done, where a library is not installed."""
    with pytest.MonkeyPatch.context() as patch:
        places = ("mpsnet_core.learning.training", "mpsnet_core.learning.evaluation.samples")
        for name in [name for name in sys.modules if name.startswith(places)]:
            patch.delitem(sys.modules, name)
        patch.setitem(sys.modules, library, None)
        (run or b.train)()


def two(b: Bench) -> list[Path]:
    for name in ("a", "b"):
        (b / name).mkdir()
    return [b.photo("a/same.exr"), b.photo("b/same.exr")]


def with_pixel(value: float) -> np.ndarray:
    image = SPHERE.image.copy()
    image[8, 8, 1] = value
    return image


def glb_of(b: Bench, **said: Any) -> Path:
    """A GLB of one point that lies in a buffer, as far as not said otherwise."""
    point = {"bufferView": 0, "componentType": 5126, "count": 1, "type": "VEC3"}
    mesh = {"primitives": [{"attributes": {"POSITION": 0}}]}
    good = {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}], "meshes": [mesh]}
    good |= {"accessors": [point], "bufferViews": [{"buffer": 0, "byteLength": 12}], "buffers": [{"byteLength": 12}]}
    text = json.dumps(good | said).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", 12, b"BIN\0") + bytes(12)
    return b.bytes("mesh.glb", struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def glb_beside_a_pipe(b: Bench) -> Path:
    if hasattr(os, "mkfifo"):
        os.mkfifo(b / "pipe")
    return glb_of(b, buffers=[{"uri": "pipe", "byteLength": 12}])


def bomb(b: Bench) -> Path:
    """An .npz of a few kilobytes for each megabyte of zeros."""
    np.savez_compressed(b / "mesh.npz", vertices=np.zeros((3 << 22, 3)))
    return b / "mesh.npz"


def short_glb(b: Bench) -> Path:
    """A GLB whose first buffer view is said to be longer than the file."""
    box = trimesh.Scene([trimesh.creation.box()]).export(file_type="glb")
    return b.bytes("mesh.glb", box.replace(b'"byteLength":144', b'"byteLength":999'))


def within(module: Any, limit: str, value: int, work: Callable[[], Any]) -> None:
    """Do the work under a smaller limit, as reaching the real one would take gigabytes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, limit, value)
        work()


Case = tuple[str, Callable[[Bench], Any], str]

RIGS: list[Case] = [
    (
        "a mixing too small to be undone",
        lambda b: read_rig(b.rig(mixing=(1e-300 * np.eye(3)).tolist())),
        "rig.json…mixing matrix is of the size 1e-300; scale its entries to about 1",
    ),
    ("direction too long to be measured", lambda b: LightRig(1e200 * np.eye(3) + 1), "not finite or beyond 1e+12"),
    ("a link to itself", lambda b: read_rig(loop(b / "rig.json")), "rig.json does not exist; check the path"),
    (
        "a text that would clear the terminal",
        lambda b: read_rig(b.rig(**{"\x1b[2Jmixing": 1})),
        r'has "\x1b[2Jmixing", which no mpsnet-rig file has',
    ),
    (
        "a text of a hundred thousand letters",
        lambda b: read_rig(b.rig(format="m" * 100_000)),
        "rig.json is not a mpsnet-rig file…mmm…mmm…expected 'mpsnet-rig'",
    ),
    (
        "zero vector",
        lambda b: read_rig(b.lights(direction=[0, 0, 0], slant=None, tilt=None)),
        "rig.json…second light…zero vector; give where",
    ),
    (
        "behind",
        lambda b: read_rig(b.lights(slant=120)),
        "rig.json…second light is behind the object…z towards the camera",
    ),
    (
        "coplanar",
        lambda b: LightRig([[0, 0.5, 1], [0, -0.5, 1], [0, 0, 1]]),
        "three light directions lie (nearly) in one plane…move one light",
    ),
    ("nearly coplanar", lambda b: published_rig(slant=0.5), "(nearly) in one plane"),
    ("twice the same light", lambda b: read_rig(b.lights(tilt=90)), "rig.json…(nearly) in one plane"),
    ("direction not finite", lambda b: LightRig([[0, NAN, 1], [1, 0, 1], [0, 0, 1]]), "light directions…not finite"),
    ("angle not finite", lambda b: read_rig(b.lights(slant=NAN)), "rig.json…not finite"),
    ("angle beyond all numbers", lambda b: read_rig(b.lights(slant=10**400)), "rig.json…second light…not a number"),
    ("two lights", lambda b: read_rig(b.rig(lights=[{"slant": 30, "tilt": 0}] * 2)), "rig.json…list of three lights"),
    (
        "directions of the wrong shape",
        lambda b: LightRig(np.ones((2, 3))),
        "light directions must be three rows of three numbers…(2, 3)",
    ),
    (
        "a direction of two numbers",
        lambda b: read_rig(b.lights(direction=[0, 1], slant=None, tilt=None)),
        "rig.json…second light's direction needs three numbers",
    ),
    (
        "direction and angles",
        lambda b: read_rig(b.lights(direction=[0, 0, 1])),
        "rig.json…second light needs either…or",
    ),
    ("neither direction nor angles", lambda b: read_rig(b.lights(tilt=None)), "rig.json…second light needs either"),
    ("an angle in words", lambda b: read_rig(b.lights(slant="steep")), "rig.json…second light…not a number"),
    ("a light that is no object", lambda b: read_rig(b.rig(lights=[1, 2, 3])), "rig.json…first light needs either"),
    (
        "singular mixing",
        lambda b: read_rig(b.rig(mixing=[[1, 1, 0], [1, 1, 0], [0, 0, 1]])),
        "rig.json…mixing matrix cannot be inverted…measure it again or leave it out",
    ),
    (
        "mixing of the wrong shape",
        lambda b: read_rig(b.rig(mixing=[[1, 0], [0, 1]])),
        "rig.json…mixing matrix must be three rows of three",
    ),
    ("mixing in words", lambda b: read_rig(b.rig(mixing="none")), "rig.json…mixing matrix must be three rows of three"),
    (
        "mixing beyond all numbers",
        lambda b: read_rig(b.rig(mixing=[[10**400, 0, 0], [0, 1, 0], [0, 0, 1]])),
        "rig.json…mixing matrix",
    ),
    ("missing", lambda b: read_rig(b / "rig.json"), "rig.json does not exist; check the path"),
    ("a folder", lambda b: read_rig(b.folder), "is a folder, not a file"),
    ("a name too long for the system", lambda b: read_rig(b / ("x" * 300)), "xxx cannot be opened…check the path"),
    (
        "not JSON",
        lambda b: read_rig(b.text("rig.json", '{"format": "mpsnet-rig",')),
        "rig.json is not valid JSON…write it again",
    ),
    (
        "not text",
        lambda b: read_rig(b.bytes("rig.json", b"\xff\xfe\x00")),
        "rig.json is not a text file; give a mpsnet-rig file",
    ),
    ("JSON too deep", lambda b: read_rig(b.text("rig.json", "[" * 100_000)), "rig.json is not valid JSON"),
    (
        "another format",
        lambda b: read_rig(b.camera()),
        "camera.json is not a mpsnet-rig file…'mpsnet-camera', expected 'mpsnet-rig'",
    ),
    ("no object", lambda b: read_rig(b.text("rig.json", "[1, 2]")), "rig.json is not a mpsnet-rig file"),
    ("a misspelled key", lambda b: read_rig(b.rig(mixng=[])), 'rig.json has "mixng", which no…may have lights, mixing'),
    ("a newer version", lambda b: read_rig(b.rig(version=2)), "rig.json is version 2…reads up to 1; update it"),
    ("a version in words", lambda b: read_rig(b.rig(version="new")), "rig.json is version 'new'"),
    ("not a small file", lambda b: read_rig(b.text("rig.json", " " * (1 << 21))), "rig.json is larger than 1 MiB"),
    (
        ".lp with four lights",
        lambda b: read_rig(b.text("r.lp", "4\n" + "a 0 0 1\n" * 4)),
        "r.lp…holds 4 lights, a rig has three; keep",
    ),
    (
        ".lp with a wrong count",
        lambda b: read_rig(b.text("r.lp", "3\n" + "a 0 0 1\n" * 2)),
        "r.lp…states 3 lights but 2 lines follow; mend the count",
    ),
    (".lp with no light", lambda b: read_rig(b.text("r.lp", "0\n")), "r.lp…holds 0 lights, a rig has three"),
    (".lp with two numbers a line", lambda b: read_rig(b.text("r.lp", "3\n" + "0 1\n" * 3)), "r.lp…name x y z"),
    (".lp that is empty", lambda b: read_rig(b.text("r.lp", "")), "r.lp…not an .lp file…first line is the count"),
    (".lp that is something else", lambda b: read_rig(b.text("r.lp", "hello\nworld")), "r.lp…not an .lp file"),
]

CAMERAS: list[Case] = [
    ("focal beyond reason", lambda b: b.estimate(focal="1e300"), "focal must be above 0 in x and in y, 1e-06 to 1e+09"),
    (
        "unknown projection",
        lambda b: read_camera(b.camera(projection="fisheye")),
        'camera.json…"orthographic" or "perspective", not \'fisheye\'',
    ),
    ("width 0", lambda b: read_camera(b.camera(width=0)), "camera.json…width must be a whole number of pixels from 1"),
    ("half a pixel", lambda b: read_camera(b.camera(height=1.5)), "camera.json…height must be a whole number"),
    ("width beyond all numbers", lambda b: read_camera(b.camera(width=10**400, centre=None)), "camera.json…width"),
    ("focal 0", lambda b: read_camera(b.camera(focal=[8, 0])), "camera.json…focal must be above 0"),
    ("one focal", lambda b: read_camera(b.camera(focal=8)), "camera.json…focal must be 2 finite numbers"),
    (
        "centre not finite",
        lambda b: read_camera(b.camera(centre=[NAN, 0])),
        "camera.json…centre must be 2 finite numbers",
    ),
    (
        "pose with scale",
        lambda b: read_camera(b.camera(world_from_camera=np.diag([2, 2, 2, 1]).tolist())),
        "camera.json…not a rotation and a translation; remove scale",
    ),
    ("pose mirrored", lambda b: Camera("orthographic", 4, 4, (1, 1), None, np.diag([-1, 1, 1, 1])), "mirroring"),
    (
        "pose of three rows",
        lambda b: read_camera(b.camera(world_from_camera=np.eye(3).tolist())),
        "camera.json…world_from_camera must be 4 by 4",
    ),
    (
        "pose beyond all numbers",
        lambda b: read_camera(b.camera(world_from_camera=[[10**400] * 4] * 4)),
        "camera.json…world_from_camera must be 4 by 4 finite",
    ),
    (
        "without a pose",
        lambda b: read_camera(b.camera(world_from_camera=None)),
        'camera.json: it lacks "world_from_camera"; add it',
    ),
    ("a rig in its place", lambda b: read_camera(b.rig()), "rig.json is not a mpsnet-camera file"),
]

IMAGES: list[Case] = [
    (
        "another kind of picture",
        lambda b: read_image(b.gif("p.png")),
        "p.png cannot be read…file of another kind…is it PNG",
    ),
    (
        "a PNG with a bit of its head turned",
        lambda b: read_image(b.turned_bit(24)),
        "photo.png cannot be read as an image",
    ),
    (
        "an EXR that OpenImageIO complains of in letters that are no UTF-8",
        lambda b: read_image(b.replaced(b.photo(), b"chlist", b"chlis\x80")),
        "photo.exr cannot be read as an image",
    ),
    (
        "a link to itself",
        lambda b: b.estimate(mask=loop(b / "m.png")),
        "mask …m.png does not exist",
    ),
    (
        "values whose squares no float holds",
        lambda b: b.estimate(b.photo(pixels=with_pixel(3e38))),
        "photo.exr: the photo holds values that are not finite",
    ),
    ("missing", lambda b: read_image(b / "photo.png"), "photo.png does not exist; check the path"),
    ("a folder", lambda b: read_image(b.folder), "is a folder, not a file; name a file in it"),
    (
        "empty",
        lambda b: read_image(b.bytes("photo.png", b"")),
        "photo.png cannot be read as an image…PNG, JPEG, TIFF or EXR",
    ),
    ("not an image", lambda b: read_image(b.text("photo.png", "hello")), "photo.png cannot be read as an image"),
    ("of no known kind", lambda b: read_image(b.text("photo.txt", "hello")), "photo.txt cannot be read as an image"),
    (
        "PNG cut short",
        lambda b: read_image(cut(b.photo("p.png", kind="uint16"))),
        "p.png is damaged or cut short…copy or export it again",
    ),
    (
        "JPEG cut short",
        lambda b: read_image(cut(b.photo("p.jpg", kind="uint8"), 0.95)),
        "p.jpg is damaged or cut short",
    ),
    ("TIFF cut short", lambda b: read_image(cut(b.photo("p.tif", kind="uint16"))), "p.tif"),
    ("EXR cut short", lambda b: read_image(cut(b.photo("p.exr"))), "p.exr is damaged or cut short"),
    (
        "grey",
        lambda b: read_image(b.photo("p.png", SPHERE.mask, "uint8")),
        "p.png has 1 channel(s) (Y)…give a colour image",
    ),
    (
        "two channels",
        lambda b: read_image(b.photo("p.tif", SPHERE.image[..., :2], "uint8")),
        "p.tif has 2 channel(s)…red, green and blue are needed",
    ),
    (
        "a name that is not UTF-8",
        lambda b: read_image(b.latin_named()),
        "its name is not valid UTF-8; rename it",
    ),
    (
        "NaN",
        lambda b: read_capture(b.photo(pixels=with_pixel(NAN)), published_rig(), mask="none"),
        "photo.exr: the photo holds values that are not finite inside the mask; export it again",
    ),
    (
        "infinity",
        lambda b: read_capture(b.photo(pixels=with_pixel(np.inf), kind="half"), published_rig(), mask="none"),
        "photo.exr: the photo holds values that are not finite inside the mask",
    ),
    (
        "unknown layer",
        lambda b: read_image(write_parts(b / "l.exr", [(None, named("A.", "RGB", SPHERE.image))]), layer="B"),
        "l.exr has no layer 'B'; it has A",
    ),
    (
        "several layers",
        lambda b: read_image(
            write_parts(b / "l.exr", [(None, named("A.", "RGB", SPHERE.image) | named("B.", "RGB", SPHERE.image))])
        ),
        "l.exr has several layers; name one of A, B",
    ),
    (
        "a layer of two view layers",
        lambda b: read_image(
            write_parts(
                b / "l.exr",
                [(None, named("A.Combined.", "RGB", SPHERE.image) | named("B.Combined.", "RGB", SPHERE.image))],
            ),
            layer="Combined",
        ),
        "l.exr has several layers; name one of A.Combined, B.Combined",
    ),
    (
        "unknown encoding",
        lambda b: read_image(b.photo(), encoding="log"),
        "encoding 'log' is not known; choose auto, linear or srgb",
    ),
    (
        "a PNG header of 10^10 pixels",
        lambda b: read_image(b.bytes("p.png", huge_png(100_000, 100_000))),
        "p.png…100000",
    ),
    (
        "more pixels than the limit",
        lambda b: within(images, "MAX_PIXELS", 255, lambda: read_image(b.photo())),
        "photo.exr claims to be 16 x 16…more than this program reads",
    ),
    ("an EXR header of 10^10 pixels", lambda b: read_image(huge_exr(b)), "huge.exr"),
    (
        "1100 channels",
        lambda b: read_image(write_file(b / "c.exr", np.zeros((2, 2, 1100)), "half")),
        "c.exr…1100 channels",
    ),
]

CAPTURES: list[Case] = [
    (
        "empty mask",
        lambda b: read_capture(b.photo(), SPHERE.rig, mask=b.mask(values=0 * SPHERE.mask)),
        "photo.exr…mask is empty…choose another mask or threshold",
    ),
    (
        "empty alpha",
        lambda b: read_capture(b.photo(pixels=np.dstack([SPHERE.image, 0 * SPHERE.mask])), SPHERE.rig),
        "photo.exr…mask is empty",
    ),
    (
        "mask of another size",
        lambda b: read_capture(b.photo(), SPHERE.rig, mask=b.mask(values=np.ones((8, 4)))),
        "photo.exr…mask is 4 x 8 but the photo is 16 x 16; they must be the same size",
    ),
    ("missing mask", lambda b: read_capture(b.photo(), SPHERE.rig, mask=b / "mask.png"), "mask.png does not exist"),
    ("a mask that is no image", lambda b: read_mask(b.rig()), "rig.json cannot be read as an image"),
    (
        "alpha where there is none",
        lambda b: read_capture(b.photo(), SPHERE.rig, mask="alpha"),
        "photo.exr…no alpha channel…give a mask file or a threshold",
    ),
    (
        "threshold in words",
        lambda b: read_capture(b.photo(), SPHERE.rig, mask="threshold:low"),
        "photo.exr…from 0 up to 1, not 'low'; 0.05",
    ),
    (
        "threshold without number",
        lambda b: read_capture(b.photo(), SPHERE.rig, mask="threshold:"),
        "photo.exr…from 0 up to 1, not ''",
    ),
    (
        "threshold above 1",
        lambda b: read_capture(b.photo(), SPHERE.rig, mask="threshold:1.5"),
        "from 0 up to 1, not '1.5'",
    ),
    (
        "threshold not finite",
        lambda b: read_capture(b.photo(), SPHERE.rig, mask="threshold:nan"),
        "from 0 up to 1, not 'nan'",
    ),
    (
        "black",
        lambda b: read_capture(b.photo(pixels=0 * SPHERE.image), SPHERE.rig),
        "photo.exr…black inside the mask; were the lights on",
    ),
    ("not finite inside the mask", lambda b: SPHERE.capture(image=with_pixel(NAN)), "not finite inside the mask"),
    ("grey image", lambda b: SPHERE.capture(image=SPHERE.image[..., 0]), "three channels a pixel…(16, 16)"),
    (
        "a camera of another size",
        lambda b: SPHERE.capture(camera=Camera("orthographic", 20, 10, (8, 8))),
        "camera is 20 x 10 but the photo is 16 x 16",
    ),
]

WHITE: list[Case] = [
    (
        "missing",
        lambda b: b.estimate(white=b / "white.png"),
        "image…white.png does not exist; check the path",
    ),
    (
        "of another size",
        lambda b: b.estimate(white=b.photo("white.exr", SPHERE.image[:8])),
        "white.exr: the white photo is 16 x 8 but the photo is 16 x 16; take both with the same camera",
    ),
    (
        "black",
        lambda b: b.estimate(white=b.photo("white.exr", 0 * SPHERE.image)),
        "white.exr: the white photo is black inside the mask; was the light on",
    ),
    (
        "not finite",
        lambda b: b.estimate(white=b.photo("white.exr", with_pixel(NAN))),
        "white.exr: the white photo holds values that are not finite inside the mask; export it again",
    ),
    (
        "of one channel",
        lambda b: SPHERE.capture(white=SPHERE.image[..., 0]),
        "a white photo has three channels a pixel; this one has shape (16, 16)",
    ),
    (
        "clipped elsewhere",
        lambda b: SPHERE.capture(white=SPHERE.image, white_clipped=np.zeros((4, 4, 3), bool)),
        "what is clipped in the white photo is 4 x 4 but the white photo is 16 x 16",
    ),
    ("that is the photo", lambda b: b.estimate(white=b.photo()), "photo.exr: the white photo is the photo itself"),
    (
        "of several photos",
        lambda b: b.estimate(b.photo("a.exr"), b.photo("b.exr"), output="out", white=b.photo("white.exr")),
        "--white is a second photo of one still pose; leave it out, or give one photo",
    ),
    ("albedo without one", lambda b: b.estimate(albedo=b / "a.png"), "--albedo is made from a photo under white light"),
    (
        "albedo without one, in Python",
        lambda b: albedo_from_white(SPHERE.capture(), NormalMap(SPHERE.normals, SPHERE.mask)),
        "the albedo is made from a white photo, and there is none; give one",
    ),
    (
        "albedo over it",
        lambda b: b.estimate(white=b.photo("white.exr"), albedo=b / "white.exr"),
        "would overwrite…white.exr",
    ),
    (
        "light without an albedo",
        lambda b: b.estimate(**{"white": b.photo("white.exr"), "white-light": "rig"}),
        "--white-light tells what lit the photo that --albedo is made from; give both, or neither",
    ),
    (
        "light from nowhere",
        lambda b: b.estimate(**{"white": b.photo("w.exr"), "albedo": b / "a.png", "white-light": "left"}),
        "--white-light left is not known; give slant (0 to 90) and tilt in degrees, as 45,135",
    ),
    (
        "light from behind",
        lambda b: albedo_from_white(
            SPHERE.capture(white=SPHERE.image), NormalMap(SPHERE.normals, SPHERE.mask), (0, 1, -1)
        ),
        "the white light is not in front of the object",
    ),
]

NORMALS: list[Case] = [
    (
        "not a normal map",
        lambda b: read_normals(b.photo("photo.png", 0.5 + 0 * SPHERE.image, "uint8")),
        "photo.png is not a normal map…choose another",
    ),
    (
        "a photo with alpha",
        lambda b: read_normals(b.photo("photo.png", np.dstack([SPHERE.image, SPHERE.mask]), "uint8")),
        "photo.png is not a normal map…choose another",
    ),
    (
        "empty alpha",
        lambda b: read_normals(b.photo("n.png", np.dstack([SPHERE.image, 0 * SPHERE.mask]), "uint8")),
        "n.png holds no normals: its mask is empty; estimate them again",
    ),
    (
        "unknown convention",
        lambda b: read_normals(b.normals(), convention="maya"),
        "convention 'maya' is not known; choose opengl or directx",
    ),
    (
        "shapes that differ",
        lambda b: NormalMap(SPHERE.normals, SPHERE.mask[:8]),
        "normals of shape (16, 16, 3) do not fit a mask of shape (8, 16)",
    ),
    (
        "confidence that differs",
        lambda b: NormalMap(SPHERE.normals, SPHERE.mask, np.ones((4, 4))),
        "confidence of shape (4, 4) does not fit",
    ),
    ("no mask", lambda b: NormalMap(SPHERE.normals, 0 * SPHERE.mask), "mask is empty"),
]

MODELS: list[Case] = [
    (
        "a card that is no UTF-8",
        lambda b: b.run("models", b.replaced(pass_through(b / "m.onnx"), b'"licence"', b'"lic\xff\xfece"')),
        "m.onnx cannot be used: its metadata are not UTF-8 text; export it again",
    ),
    (
        "unknown name",
        lambda b: estimate_normals(SPHERE.capture(), "mpsnet9"),
        "no model 'mpsnet9'; choose multiscale…or give an .onnx file",
    ),
    (
        "missing file",
        lambda b: estimate_normals(SPHERE.capture(), b / "m.onnx"),
        "m.onnx does not exist; check the path",
    ),
    (
        "garbage",
        lambda b: estimate_normals(SPHERE.capture(), b.bytes("m.onnx", bytes(range(256)))),
        "m.onnx is not an ONNX model that can be run…export it again",
    ),
    (
        "empty file",
        lambda b: estimate_normals(SPHERE.capture(), b.bytes("m.onnx", b"")),
        "m.onnx is not an ONNX model that can be run",
    ),
    ("no card", use(dense(card=None)), "m.onnx…no card (metadata 'mpsnet.card')"),
    ("card not JSON", use(dense(card="{")), "m.onnx…card…not valid JSON"),
    ("card of another format", use(dense(card={"format": "recipe"})), "m.onnx…not a mpsnet-model card"),
    (
        "card of a newer version",
        card_with(version=CARD_VERSION + 1),
        "m.onnx…version 2, this program reads version 1; update it",
    ),
    ("card without a licence", card_with(licence=None), 'm.onnx…card lacks "licence"'),
    ("card with an empty name", card_with(name=""), 'm.onnx…needs a text for "name"'),
    ("card with an unknown kind", card_with(kind="sparse"), 'm.onnx…"kind" is \'sparse\'; expected "dense", "patch"'),
    (
        "card with an unknown feature",
        card_with(inputs={"x": ["depth"]}),
        "m.onnx…requests 'depth'; this program makes photo, grey_world",
    ),
    (
        "card with a feature that is a list",
        card_with(inputs={"x": [["photo"]]}),
        "m.onnx…requests ['photo']; this program makes",
    ),
    (
        "card that stacks the lights with maps",
        card_with(inputs={"x": ["photo", "lights"]}),
        "m.onnx…card stacks lights, which is one pixel, with maps in input 'x'; give it an input of its own",
    ),
    ("card without features", card_with(inputs={"x": []}), "m.onnx…no list of features for input 'x'"),
    ("card with features in words", card_with(inputs={"x": "photo"}), "m.onnx…no list of features for input 'x'"),
    ("card with inputs as a list", card_with(inputs=["photo"]), 'm.onnx…"inputs" must name each input\'s features'),
    ("card with a negative halo", card_with(halo=-1), 'm.onnx…"halo" is -1; expected a whole number from 0'),
    ("card with an even patch", card_with(kind="patch", patch=4), 'm.onnx…"patch" is 4; expected an odd number'),
    (
        "card with an unknown frame",
        card_with(frame="world"),
        'm.onnx…"frame" is \'world\'; expected "camera" or "canonical"',
    ),
    (
        "canonical card of patches",
        card_with(kind="patch", frame="canonical"),
        'm.onnx…"frame" is "canonical", which a network that sees patches cannot have',
    ),
    (
        "card with seven passes",
        card_with(frame="canonical", passes=7),
        'm.onnx…"passes" is 7; expected a whole number from 1 to 6',
    ),
    (
        "three passes in the camera's frame",
        card_with(passes=3),
        'm.onnx…"passes" is 3, which needs the "frame" "canonical"',
    ),
    ("card with other inputs", card_with(inputs={"y": ["photo"]}), "m.onnx…inputs ['x'], its card describes ['y']"),
    (
        "wrong channel count",
        use(dense(channels=4, shape=("n", 4, "h", "w"))),
        "m.onnx…input 'x'…'any', 4, 'any'…expected tensor(float) ['any', 3, 'any', 'any'] for initial_normals",
    ),
    (
        "wrong type",
        use(
            dense(
                nodes=[helper.make_node("Cast", ["x"], ["c"], to=TensorProto.FLOAT), conv("c", "normals", "w")],
                input_type=TensorProto.DOUBLE,
            )
        ),
        "m.onnx…tensor(double)…expected tensor(float)",
    ),
    ("fixed size", use(dense(shape=("n", 3, 64, 64))), "m.onnx…fixed size…64, 64]…export with dynamic sizes"),
    (
        "a patch of another size",
        use(dense(shape=("n", 3, 7, 7), card=card(kind="patch", patch=5))),
        "m.onnx…7, 7]; expected tensor(float) ['any', 3, 5, 5]",
    ),
    (
        "flat input",
        use(dense(shape=("n", 3), nodes=[helper.make_node("Identity", ["x"], ["normals"])])),
        "m.onnx…input 'x'…expected tensor(float) ['any', 3, 'any', 'any']",
    ),
    ("no output called normals", use(dense("depth")), 'm.onnx…no output called "normals"'),
    ("four channels out", use(dense(answers=4)), 'm.onnx…output "normals" is (1, 4,…expected (1, 3,'),
    (
        "output of half the size",
        use(dense(nodes=[conv("x", "normals", "w", strides=[2, 2])])),
        'm.onnx…output "normals" is (1, 3, 8, 8), expected (1, 3, 16, 16)',
    ),
    (
        "patches that give too much",
        use(lambda path: pass_through(path, card(kind="patch", patch=3), inputs={"x": ("n", 3, 3, 3)})),
        'm.onnx…output "normals" is (208, 3, 3, 3), expected (208, 3)',
    ),
    (
        "NaN out",
        use(
            dense(
                nodes=[
                    conv("x", "h", "w"),
                    helper.make_node("Sub", ["h", "h"], ["z"]),
                    helper.make_node("Div", ["z", "z"], ["normals"]),
                ]
            )
        ),
        "m.onnx returned values that are not finite",
    ),
    (
        "NaN confidence",
        use(
            lambda path: write_model(
                path,
                [
                    helper.make_node("Identity", ["x"], ["normals"]),
                    helper.make_node("Sub", ["x", "x"], ["z"]),
                    helper.make_node("Div", ["z", "z"], ["q"]),
                    helper.make_node("ReduceMean", ["q"], ["confidence"], axes=[1]),
                ],
                {},
                card(),
                outputs={"normals": DENSE, "confidence": ("n", 1, "h", "w")},
            )
        ),
        "m.onnx returned values that are not finite",
    ),
    (
        "confidence of another shape",
        use(
            lambda path: write_model(
                path,
                [helper.make_node("Identity", ["x"], ["normals"]), helper.make_node("Identity", ["x"], ["confidence"])],
                {},
                card(),
                outputs={"normals": DENSE, "confidence": DENSE},
            )
        ),
        'm.onnx…output "confidence" is (1, 3, 16, 16), expected (1, 1, 16, 16)',
    ),
    (
        "failing as it runs",
        use(
            dense(
                channels=3,
                nodes=[
                    helper.make_node("Reshape", ["x", "s"], ["normals"]),
                    helper.make_node(
                        "ConstantOfShape", ["k"], ["s"], value=helper.make_tensor("v", TensorProto.INT64, [1], [7])
                    ),
                    helper.make_node("Constant", [], ["k"], value_ints=[4]),
                ][::-1],
            )
        ),
        "m.onnx failed on x (1, 3, 16, 16)",
    ),
    (
        "an endless loop",
        use(dense(nodes=ENDLESS)),
        'm.onnx has the operator "Loop", which feed-forward convolutional networks do not need; export it without',
    ),
    (
        "operators of another domain",
        use(dense(nodes=[helper.make_node("Identity", ["x"], ["normals"], domain="com.microsoft")])),
        'm.onnx has operators of "com.microsoft"',
    ),
    ("operators of its own", use(own_operator), "m.onnx has functions of its own"),
    (
        "a constant of any size",
        use(dense(nodes=[helper.make_node("Constant", [], ["normals"], sparse_value=MOSTLY_ZERO)])),
        "m.onnx has sparse weights",
    ),
    (
        "32 GiB of ones",
        use(
            dense(
                nodes=[
                    helper.make_node("Constant", [], ["k"], value_ints=[1 << 33]),
                    helper.make_node("ConstantOfShape", ["k"], ["ones"]),
                    helper.make_node("ReduceSum", ["ones"], ["sum"]),
                    helper.make_node("Add", ["x", "sum"], ["normals"]),
                ]
            )
        ),
        "m.onnx failed on x (1, 3, 16, 16): it needs more memory than there is, or than 16 GiB; use smaller tiles",
    ),
    (
        "a tile too small",
        lambda b: estimate_normals(SPHERE.capture(), pass_through(b / "m.onnx"), tile=8),
        "tile of 8 pixels is too small; use 64 or more",
    ),
    (
        "fewer than no threads",
        lambda b: estimate_normals(SPHERE.capture(), pass_through(b / "m.onnx"), threads=-1),
        "-1 threads cannot be; use 0",
    ),
    (
        "unknown provider",
        lambda b: estimate_normals(SPHERE.capture(), pass_through(b / "m.onnx"), provider="gpu"),
        "provider 'gpu' is not known; choose cpu, cuda, directml or coreml",
    ),
]

MESHES: list[Case] = [
    (
        "a corner before the first",
        lambda b: read_mesh(b.text("m.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf -4/-1 1/1 2/1")),
        "m.obj: line 5 cannot be read ('f -4/-1 1/1 2/1')",
    ),
    (
        "a face of a hundred thousand corners",
        lambda b: read_mesh(b.text("m.obj", "v 0 0 0\nvt 0 0\nf" + " 1/1" * 100_000)),
        "m.obj: line 3 is a face of 100000 corners, more than 4096; triangulate it",
    ),
    (
        "a GLB whose faces name vertices that it lacks",
        lambda b: read_mesh(b.replaced(glb(b / "m.glb", normals=True), b"\2\0\0\0\3\0\0\0", b"\2\0\0\0\3\0\0\1")),
        "m.glb: the mesh's triangles name vertices that it does not have; export it again",
    ),
    ("an archive", lambda b: read_mesh(b.mesh().rename(b / "m.zip")), "m.zip: .zip is not a mesh format we read"),
    ("a packed mesh", lambda b: read_mesh(b.bytes("m.obj.bz2", b"BZh")), ".bz2 is not a mesh format we read; use OBJ"),
    (
        "npz with a password",
        lambda b: read_mesh(locked(b)),
        "mesh.npz: it cannot be read (…encrypted…); export it again",
    ),
    ("npz of complex numbers", lambda b: read_mesh(b.mesh(uvs=1j * SQUARE["uvs"])), 'mesh.npz: its "uvs" holds'),
    ("npz whose array has half a head", lambda b: read_mesh(half_a_head(b)), "mesh.npz: it cannot be read…export it"),
    (
        "PLY with a misspelled property",
        lambda b: read_mesh(b.text("m.ply", PLY_HEAD.replace("property list", "qroperty list"))),
        "m.ply: it cannot be read…export it again",
    ),
    ("missing", lambda b: read_mesh(b / "mesh.obj"), "mesh.obj does not exist"),
    (
        "not a mesh",
        lambda b: read_mesh(b.photo("mesh.png", kind="uint8")),
        "mesh.png…not a mesh format…use OBJ, PLY, GLB or npz",
    ),
    ("an OBJ of words", lambda b: read_mesh(b.text("mesh.obj", "hello\n")), "mesh.obj"),
    ("a broken PLY", lambda b: read_mesh(b.text("mesh.ply", "ply\nformat ascii 1.0\nelement vertex 3\n")), "mesh.ply"),
    ("a GLB with less than it says", lambda b: read_mesh(short_glb(b)), "mesh.glb…cannot be read…export it again"),
    (
        "a GLB of more numbers than it holds",
        lambda b: read_mesh(glb_of(b, accessors=[{"componentType": 5126, "count": 10**9, "type": "VEC3"}])),
        "mesh.glb: it unpacks to…MiB, and may to 64; reduce it first",
    ),
    *(
        (
            f"a GLB of {words}",
            lambda b, nodes=nodes: read_mesh(glb_of(b, nodes=nodes)),
            "mesh.glb: it has too many objects, or too many in one another; join them first",
        )
        for words, nodes in (
            ("100,000 nodes", [{"mesh": 0}] * 100_000),
            ("nodes in one another", [{"mesh": 0, "children": [inner]} for inner in range(1, 1000)] + [{"mesh": 0}]),
            ("a node in itself", [{"mesh": 0, "children": [0]}]),
        )
    ),
    (
        "a GLB whose numbers are in another file",
        lambda b: read_mesh(glb_beside_a_pipe(b)),
        "mesh.glb: it names the file 'pipe', and is read alone",
    ),
    ("an .npz that unpacks to far more", lambda b: read_mesh(bomb(b)), "mesh.npz: it unpacks to 288 MiB, and may to 8"),
    ("a broken GLB", lambda b: read_mesh(b.bytes("mesh.glb", b"glTF\x02\x00\x00\x00")), "mesh.glb"),
    (
        "no UVs",
        lambda b: read_mesh(b.text("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")),
        "mesh.obj…no UVs; unwrap it in Blender",
    ),
    ("no faces", lambda b: read_mesh(b.text("mesh.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n")), "mesh.obj"),
    ("npz cut short", lambda b: read_mesh(cut(b.mesh())), "mesh.npz…cannot be read…export it again"),
    ("npz with a broken array", lambda b: read_mesh(broken_array(b)), "mesh.npz…cannot be read…export it again"),
    ("npz with pickles", lambda b: read_mesh(pickled(b)), "mesh.npz…cannot be read…pickle…export it again"),
    (
        "npz that is a pickle",
        lambda b: read_mesh(b.bytes("mesh.npz", pickle.dumps({"a": 1}))),
        "mesh.npz…cannot be read",
    ),
    ("npz of something else", lambda b: read_mesh(b.mesh(format=None)), "mesh.npz…not a mpsnet-mesh file"),
    (
        "npz of a newer version",
        lambda b: read_mesh(b.mesh(version=np.array(2))),
        "mesh.npz…version 2, this program reads version 1; update it",
    ),
    ("npz with two versions", lambda b: read_mesh(b.mesh(version=np.array([1, 2]))), "mesh.npz…version [1 2]"),
    ("npz without UVs", lambda b: read_mesh(b.mesh(uvs=None)), 'mesh.npz…lacks "uvs"; export it again'),
    ("npz of words", lambda b: read_mesh(b.mesh(uvs=np.full((2, 3, 2), "u"))), "mesh.npz…uvs…export it again"),
    (
        "npz with a single number",
        lambda b: read_mesh(b.mesh(vertices=np.array(1.0))),
        "mesh.npz…vertices…export it again",
    ),
    (
        "UVs of another shape",
        lambda b: read_mesh(b.mesh(uvs=np.zeros((4, 2)))),
        "mesh.npz…uvs have shape (4, 2), expected (2, 3, 2)",
    ),
    (
        "bad indices",
        lambda b: read_mesh(b.mesh(triangles=np.array([[0, 1, 2], [0, 2, 9]]))),
        "mesh.npz…triangles name vertices that it does not have",
    ),
    (
        "negative indices",
        lambda b: read_mesh(b.mesh(triangles=np.array([[0, 1, 2], [0, 2, -1]]))),
        "mesh.npz…triangles name vertices",
    ),
    (
        "vertices not finite",
        lambda b: Mesh(**{**SQUARE, "vertices": SQUARE["vertices"] * NAN}),
        "vertices hold a value that is not finite",
    ),
    (
        "UVs outside",
        lambda b: bake_normals(
            Mesh(**{**SQUARE, "uvs": SQUARE["uvs"] + 1}), [View(read_camera(b.camera()), read_normals(b.normals()))]
        ),
        "UVs lie outside the texture (0 to 1); move",
    ),
    (
        "no triangles",
        lambda b: Mesh(**{key: SQUARE[key][:0] if key != "vertices" else SQUARE[key] for key in SQUARE}),
        "no faces",
    ),
    (
        "scale 0",
        lambda b: Mesh(**SQUARE, world_from_object=np.diag([1, 1, 0, 1])),
        "scaled to nothing…give it a scale above 0",
    ),
]

BAKES: list[Case] = [
    (
        "more albedos than views",
        lambda b: b.bake("--albedo", b / "a.png", "--albedo", b / "b.png"),
        "there are 1 views but 2 albedos; give one for each view, or none",
    ),
    (
        "albedo of another size",
        lambda b: b.bake("--albedo", b.photo("a.exr", SPHERE.image[:8])),
        "the colours are 16 x 8 but the normal map is 16 x 16; they must be the same size",
    ),
    (
        "albedo where the baked one goes",
        lambda b: b.bake("--albedo", b.photo("texture_albedo.png", kind="uint8")),
        "overwrite…texture_albedo.png",
    ),
    (
        "colours of some views only",
        lambda b: bake_normals(
            Mesh(**SQUARE),
            [
                View(read_camera(b.camera()), read_normals(b.normals()), colours)
                for colours in (None, np.ones((16, 16, 3), np.float32))
            ],
        ),
        "some views have colours and others none; give colours for all of them, or for none",
    ),
    ("no views", lambda b: bake_normals(Mesh(**SQUARE), []), "no view to bake; give at least one camera"),
    (
        "sizes differ",
        lambda b: b.bake(view=f"{b.camera()}={b.normals(size=32)}"),
        "camera.json…normals.png…camera is 16 x 16 but its normal map is 32 x 32",
    ),
    (
        "sizes differ in Python",
        lambda b: View(Camera("orthographic", 4, 8, (1, 1)), read_normals(b.normals())),
        "camera is 4 x 8 but its normal map is 16 x 16",
    ),
    ("a view without a camera", lambda b: b.bake(view=str(b.normals())), "normals.png is not CAMERA=NORMALS"),
    ("a view whose camera is missing", lambda b: b.bake(view=f"{b / 'c.json'}={b.normals()}"), "c.json does not exist"),
    ("size 0", lambda b: b.bake("--size", "0"), "size 0 cannot be; choose 1 to 16384"),
    ("size beyond reason", lambda b: b.bake("--size", "1000000"), "size 1000000 cannot be"),
    ("size in words", lambda b: b.bake("--size", "large"), "--size…'large'…see mpsnet bake --help"),
    ("negative margin", lambda b: b.bake("--margin", "-1"), "margin -1 cannot be; choose 0 to 16384"),
    ("unknown space", lambda b: b.bake("--space", "world"), "space 'world' is not known; choose tangent or object"),
    (
        "unknown convention",
        lambda b: b.bake("--convention", "vulkan"),
        "convention 'vulkan' is not known; choose opengl or directx",
    ),
    ("8-bit EXR", lambda b: b.bake("--bits", "8", output="t.exr"), "t.exr…hold 16 or 32 bits a channel, not 8"),
    ("32-bit PNG", lambda b: b.bake("--bits", "32"), "texture.png…hold 8 or 16 bits a channel, not 32"),
    (
        "a camera that looks elsewhere",
        lambda b: b.bake(view=f"{b.camera(pose=AWAY)}={b.normals()}"),
        "no view sees any of the mesh; check that the cameras and the mesh share one world",
    ),
    ("over the normals", lambda b: b.bake(output="normals.png"), "overwrite…normals.png…choose another output"),
    (
        "a photo for normals",
        lambda b: b.bake(view=f"{b.camera()}={b.photo('p.png', np.dstack([SPHERE.image, SPHERE.mask]), 'uint8')}"),
        "p.png is not a normal map",
    ),
    ("no view at all", lambda b: b.run("bake", "--mesh", b.mesh(), "-o", b / "t.png"), "--view"),
]

OUTPUTS: list[Case] = [
    (
        "a name that is no UTF-8",
        lambda b: b.estimate(output=os.fsdecode(b"\xf6.png")),
        r"cannot write …\udcf6.png: its name is not valid UTF-8; choose another name",
    ),
    (
        "a folder's name that is no UTF-8",
        lambda b: b.synthesize("-o", b / os.fsdecode(b"\xf6")),
        r"cannot make folder …\udcf6: its name is not valid UTF-8; choose another name",
    ),
    (
        "folder missing",
        lambda b: b.estimate(output="nowhere/out.png"),
        "nowhere/out.png…nowhere does not exist; create it first",
    ),
    (
        "texture's folder missing",
        lambda b: b.bake(output="nowhere/t.png"),
        "nowhere/t.png…nowhere does not exist; create it first",
    ),
    (
        "folder of frames in no folder",
        lambda b: b.estimate(b.photo("a.exr"), b.photo("b.exr"), output="no/where"),
        "no/where…does not exist; create it first",
    ),
    ("unknown suffix", lambda b: b.estimate(output="out.gif"), "out.gif…not an image format of ours; use .png"),
    ("no suffix", lambda b: write_image(b / "out", SPHERE.image), "out…no suffix…use .png"),
    ("a folder", lambda b: write_image(b.folder, SPHERE.image), "no suffix"),
    (
        "a folder with a suffix",
        lambda b: ((b / "t.png").mkdir(), b.bake(output="t.png")),
        "t.png…it is a folder; give a file name",
    ),
    (
        "over the photo",
        lambda b: b.estimate(b.photo("out.png", kind="uint16")),
        "overwrite…out.png…choose another output",
    ),
    (
        "over a photo in the folder",
        lambda b: output_files([b / "a.png", b / "a_normals.png"], b.folder, ".png"),
        "overwrite…a_normals.png…choose another output",
    ),
    ("over the mask", lambda b: b.estimate(output="mask.png"), "overwrite…mask.png…choose another output"),
    (
        "confidence over the photo",
        lambda b: b.estimate(confidence=b.photo()),
        "overwrite…photo.exr…choose another output",
    ),
    (
        "confidence over the normals",
        lambda b: b.estimate(confidence=b / "out.png"),
        "overwrite…out.png…choose another output",
    ),
    (
        "confidence in no folder",
        lambda b: b.estimate(confidence=b / "nowhere/c.png"),
        "nowhere/c.png…does not exist; create it first",
    ),
    (
        "confidence of several",
        lambda b: b.estimate(b.photo("a.exr"), b.photo("b.exr"), output="out", confidence=b / "c.png"),
        "--confidence takes one photo",
    ),
    (
        "one file for several photos",
        lambda b: b.estimate(b.photo("a.exr"), b.photo("b.exr")),
        "out.png is one file, but there are 2 photos; give a folder",
    ),
    (
        "unknown format for several",
        lambda b: b.estimate(b.photo("a.exr"), b.photo("b.exr"), output="out", format="gif"),
        ".gif is not an image format of ours",
    ),
    (
        "unknown convention",
        lambda b: write_normals(b / "n.png", NormalMap(SPHERE.normals, SPHERE.mask), convention="y-up"),
        "convention 'y-up' is not known",
    ),
    (
        "texture bits",
        lambda b: write_texture(
            b / "t.tif",
            bake_normals(
                Mesh(**SQUARE),
                [View(Camera("orthographic", 16, 16, (8, 8)), read_normals(b.normals()))],
                size=8,
                margin=0,
            ),
            bits=12,
        ),
        "t.tif…hold 8 or 16 or 32 bits a channel, not 12",
    ),
    (
        "rig in no folder",
        lambda b: write_rig(b / "no" / "rig.json", SPHERE.rig),
        "no/rig.json…does not exist; create it first",
    ),
]

FRAMES: list[Case] = [
    (
        "a pattern that matches nothing",
        lambda b: b.estimate(b / "frame_####.png"),
        "no image matches…frame_####.png; check the pattern",
    ),
    ("a pattern in a missing folder", lambda b: b.estimate(b / "shots" / "*.png"), "no image matches…shots/*.png"),
    (
        "a folder without images",
        lambda b: ((b / "shots").mkdir(), b.estimate(b / "shots")),
        "shots holds no images (.png",
    ),
    ("missing", lambda b: b.estimate(b / "photo.png"), "photo.png does not exist; check the path"),
    ("a name too long for the system", lambda b: b.estimate(b / ("x" * 300 + ".png")), "xxx.png…too long"),
    (
        "two of the same name",
        lambda b: b.estimate(*two(b), output="out"),
        "two photos would both be written to…same_normals.png; rename one",
    ),
    (
        "one bad frame among good ones",
        lambda b: b.estimate(b.photo("a.exr"), b.photo("b.exr", 0 * SPHERE.image), output="out"),
        "b.exr…black inside the mask",
    ),
]

COMMANDS: list[Case] = [
    ("two hyphens for a value", lambda b: b.run("integrate", "n.png", "--open=--"), "--open: expected a value, not --"),
    ("no verb", lambda b: b.run("--progress", "none"), "see mpsnet --help"),
    ("unknown verb", lambda b: b.run("paint"), "'paint'…see mpsnet --help"),
    ("no rig", lambda b: b.run("estimate", b.photo(), "-o", b / "n.png"), "--rig; see mpsnet estimate --help"),
    ("unknown option", lambda b: b.estimate(colour="red"), "--colour…see mpsnet"),
    ("unknown provider", lambda b: b.estimate(provider="gpu"), "provider 'gpu' is not known; choose cpu"),
    (
        "unknown encoding",
        lambda b: b.estimate(encoding="log"),
        "encoding 'log' is not known; choose auto, linear or srgb",
    ),
    (
        "a number of passes that no network takes",
        lambda b: b.run("estimate", "p.png", "--rig", "r.json", "--passes", "2", "-o", "n.png"),
        "passes 2 is not known; choose 1 or 3",
    ),
    (
        "passes in turn of a network that knows no turns",
        lambda b: estimate_normals(SPHERE.capture(), "psfcn", passes=3),
        'psfcn.onnx…needs the "frame" "canonical"',
    ),
    ("unknown progress", lambda b: b.run("models", "--progress", "loud"), "--progress…'loud'…auto"),
]

DILIGENT: list[Case] = [
    (
        "no such folder",
        lambda b: b.run("evaluate", "diligent", b / "nowhere"),
        "nowhere has none of DiLiGenT's folders (ballPNG…give its pmsData folder",
    ),
    ("a folder without objects", lambda b: b.run("evaluate", "diligent", b.folder), "has none of DiLiGenT's folders"),
    (
        "a light out of range",
        lambda b: b.evaluate("--lights", "1,2,97"),
        "ballPNG has lights 1 to 4, not 97; mend --lights",
    ),
    (
        "light 0",
        lambda b: read_diligent(b.diligent() / "ballPNG", (0, 1, 2), "white"),
        "ballPNG has lights 1 to 4, not 0",
    ),
    (
        "lights in words",
        lambda b: b.evaluate("--lights", "red,green,blue"),
        "--lights red,green,blue is not three numbers; write them like 48,1,96",
    ),
    ("two lights", lambda b: b.evaluate("--lights", "1,2"), "--lights 1,2 is not three numbers"),
    ("twice the same light", lambda b: b.evaluate("--lights", "1,2,1"), "ballPNG…(1, 2, 1)…one plane"),
    (
        "unknown protocol",
        lambda b: b.evaluate("--protocol", "mixed"),
        "protocol 'mixed' is not known; choose separated, published or white",
    ),
    ("unknown model", lambda b: b.evaluate("--model", "mpsnet9"), "no model 'mpsnet9'"),
    (
        "report of another kind",
        lambda b: b.evaluate("-o", b / "report.pdf"),
        "report.pdf…written as .html; change the suffix",
    ),
    (
        "rows in no folder",
        lambda b: b.evaluate("--json", b / "no" / "rows.json"),
        "no/rows.json…does not exist; create it first",
    ),
    (
        "light table missing",
        lambda b: read_diligent(b.diligent(light_directions="") / "ballPNG", (1, 2, 3), "white"),
        "light_directions.txt does not exist",
    ),
    (
        "light table in words",
        lambda b: read_diligent(b.diligent(light_directions="a b c\n") / "ballPNG", (1, 2, 3), "white"),
        "light_directions.txt is not a table of numbers",
    ),
    (
        "light table empty",
        lambda b: read_diligent(b.diligent(light_intensities="\n") / "ballPNG", (1, 2, 3), "white"),
        "light_intensities.txt must hold three numbers a line",
    ),
    (
        "intensity 0",
        lambda b: read_diligent(b.diligent(light_intensities="0 1 1\n" * 4) / "ballPNG", (1, 2, 3), "white"),
        "light_intensities.txt…above 0",
    ),
    (
        "a photograph missing",
        lambda b: read_diligent(b.diligent(filenames="x.png " * 4) / "ballPNG", (1, 2, 3), "white"),
        "x.png does not exist",
    ),
    (
        "a photograph's name in no encoding",
        lambda b: (
            (b.diligent() / "ballPNG" / "filenames.txt").write_bytes(b"\xff.png " * 4),
            read_diligent(b / "pmsData" / "ballPNG", (1, 2, 3), "white"),
        ),
        "xff.png does not exist",
    ),
    ("truth missing", lambda b: read_truth(b.diligent(Normal_gt="") / "ballPNG"), "Normal_gt.mat does not exist"),
    (
        "truth broken",
        lambda b: read_truth(cut(b.diligent() / "ballPNG" / "Normal_gt.mat").parent),
        "Normal_gt.mat is damaged…copy it again",
    ),
    (
        "truth of an older MATLAB",
        lambda b: read_truth(b.diligent(Normal_gt="MATLAB 4" * 40) / "ballPNG"),
        "Normal_gt.mat is not a little-endian MATLAB 5 file; save it with -v7",
    ),
    (
        "truth under another name",
        lambda b: read_truth(mat_file(b / "Normal_gt.mat", normals=np.zeros((2, 2, 3))).parent),
        "Normal_gt.mat holds no numeric array called 'Normal_gt'",
    ),
    (
        "truth that is flat",
        lambda b: read_truth(mat_file(b / "Normal_gt.mat", Normal_gt=np.zeros((2, 2))).parent),
        "Normal_gt has shape (2, 2), expected height x width x 3",
    ),
    (
        "truth of another size",
        lambda b: (
            mat_file(b.diligent() / "ballPNG" / "Normal_gt.mat", Normal_gt=np.zeros((2, 2, 3))),
            b.run("evaluate", "diligent", b / "pmsData", "--lights", "1,2,3"),
        ),
        "ballPNG…truth is (2, 2, 3), the photos (64, 64, 3)",
    ),
    (
        "truth with an empty header",
        lambda b: read_truth(
            b.bytes("Normal_gt.mat", bytes(124) + b"\x00\x01IM" + struct.pack("<IIII", 14, 8, 6, 0)).parent
        ),
        "Normal_gt.mat is damaged",
    ),
]

EVALUATIONS: list[Case] = [
    (
        "unknown object",
        lambda b: b.evaluate("--object", "teapot"),
        "DiLiGenT has no object 'teapot'; choose ball, bear…reading",
    ),
    (
        "none of the objects asked for",
        lambda b: b.evaluate("--object", "cat"),
        "pmsData has none of DiLiGenT's folders (catPNG, ...)",
    ),
    ("materials without a source", lambda b: b.run("evaluate", "materials"), "--merl; see mpsnet evaluate materials"),
    ("no such materials", lambda b: b.run("evaluate", "materials", "--merl", b / "no.npz"), "no.npz does not exist"),
    (
        "a folder without materials",
        lambda b: b.run("evaluate", "materials", "--merl", b.folder),
        "holds no .binary files; choose the one with MERL's materials",
    ),
    (
        "no such mesh to render",
        lambda b: b.run("evaluate", "rendered", b / "no.obj"),
        "mesh file or folder…no.obj does not exist; check the path",
    ),
    (
        "a folder without meshes",
        lambda b: b.run("evaluate", "rendered", b.folder),
        "holds no meshes; put .glb",
    ),
    (
        "no views",
        lambda b: b.run("evaluate", "rendered", b.text("a.obj", ""), "--views", "0"),
        "0 views of a mesh cannot be shown; choose 1 to 360",
    ),
    (
        "no such statue",
        lambda b: b.run("evaluate", "statues", b / "no.ply"),
        "mesh file or folder…no.ply does not exist; check the path",
    ),
    (
        "statues magnified 100 times",
        lambda b: b.run("evaluate", "statues", b.text("a.obj", ""), "--magnify", "100"),
        "photographs cannot be magnified 100 times; choose 1, which is not at all, to 8",
    ),
    (
        "light on statues after many bounces",
        lambda b: b.run("evaluate", "statues", b.text("a.obj", ""), "--bounces", "9"),
        "light cannot be followed over 9 bounces; choose 0 to 3",
    ),
    (
        "lights behind statues",
        lambda b: b.run("evaluate", "statues", b.text("a.obj", ""), "--slant", "95"),
        "the first light is behind the object",
    ),
    (
        "photographs magnified 0 times",
        lambda b: b.evaluate("--magnify", "0"),
        "photographs cannot be magnified 0 times; choose 1, which is not at all, to 8",
    ),
    (
        "a photograph magnified beyond all bounds",
        lambda b: estimate_magnified(
            lambertian_normals, Capture(np.ones((20, 1200, 3), np.float32), np.ones((20, 1200)), published_rig()), 8
        ),
        "the object's 1200 x 20 pixels cannot be magnified 8 times…more than 8192 a side; magnify less",
    ),
    (
        "a mesh without faces",
        lambda b: b.run("evaluate", "rendered", b.text("a.obj", "v 0 0 0\n"), "--model", "lambertian"),
        "mesh file…a.obj has no faces",
    ),
    (
        "a picture too small",
        lambda b: b.run("evaluate", "colour", "--size", "8", "--model", "lambertian"),
        "pictures of 8 pixels a side cannot be made; choose a size from 16",
    ),
    (
        "colours by an unknown protocol",
        lambda b: b.run("evaluate", "colour", "--protocol", "ideal"),
        "protocol 'ideal' is not known; choose separated, published or white",
    ),
    (
        "a page of colours of another kind",
        lambda b: b.run("evaluate", "colour", "-o", b / "report.pdf"),
        "report.pdf…written as .html; change the suffix",
    ),
]

SAMPLES: list[Case] = [
    ("no count", lambda b: b.run("synthesize", "-o", b / "s"), "--count; see mpsnet synthesize --help"),
    ("no samples", lambda b: b.synthesize("--count", "0"), "count 0 cannot be; choose 1 to 10000000"),
    ("a count in words", lambda b: b.synthesize("--count", "many"), "--count…'many'…see mpsnet synthesize"),
    ("more than files have numbers for", lambda b: b.synthesize("--count", "99999999"), "count 99999999 cannot be"),
    ("a seed below 0", lambda b: b.synthesize("--seed", "-1"), "seed -1 cannot be; choose 0 to"),
    ("a size of 1", lambda b: b.synthesize("--size", "1"), "size 1 cannot be; choose 8 to 8192"),
    ("a size beyond reason", lambda b: b.synthesize("--size", "100000"), "size 100000 cannot be; choose 8 to 8192"),
    ("no views", lambda b: b.synthesize("--views", "0"), "views 0 cannot be; choose 1 to 10000"),
    ("bounces below 0", lambda b: b.synthesize("--bounces", "-1"), "bounces -1 cannot be; choose 0 to 3"),
    ("more bounces than three", lambda b: b.synthesize("--bounces", "4"), "bounces 4 cannot be; choose 0 to 3"),
    ("no rays", lambda b: b.synthesize("--supersampling", "0"), "supersampling 0 cannot be; choose 1 to 16"),
    (
        "unknown shape",
        lambda b: b.synthesize("--shapes", "blobs,teapots"),
        "shape 'teapots' is not known; choose blobs",
    ),
    ("no shape", lambda b: b.synthesize("--shapes", ","), "job has no shapes; choose some of blobs"),
    ("a shape twice", lambda b: b.synthesize("--shapes", "blobs,blobs"), "shapes name one twice…name each once"),
    ("meshes of no folder", lambda b: b.synthesize("--shapes", "meshes"), "meshes but has no folder of them; name one"),
    (
        "a folder of meshes for nothing",
        lambda b: b.synthesize("--shapes", "blobs", "--meshes", b.folder),
        "has a folder of meshes…but no shapes from it; add meshes to its shapes",
    ),
    ("a scene without Blender", lambda b: b.synthesize("--shapes", "scene"), "takes shapes from a scene but names no"),
    ("meshes missing", lambda b: b.synthesize("--meshes", b / "nowhere"), "nowhere"),
    (
        "meshes missing beside other shapes",
        lambda b: b.synthesize("--shapes", "blobs,meshes", "--meshes", b / "nowhere"),
        "folder of meshes…nowhere does not exist; check the path",
    ),
    ("materials missing", lambda b: b.synthesize("--merl", b / "nowhere"), "nowhere"),
    ("processes below 0", lambda b: b.synthesize("--processes", "-2"), "processes -2 cannot be; choose 0 to 1024"),
    (
        "samples in no folder",
        lambda b: b.run("synthesize", "--count", "1", "-o", b / "no" / "where"),
        "cannot make folder…where: …no does not exist; create it first",
    ),
    (
        "samples into a file",
        lambda b: b.run("synthesize", "--count", "1", "-o", b.photo()),
        "photo.exr is a file; name a folder for the samples",
    ),
    (
        "another seed's samples",
        lambda b: b.synthesize("--seed", "4", job=JOB),
        "s holds another job: its seed is 3, not 4",
    ),
    (
        "another count and size",
        lambda b: b.synthesize("--size", "32", job=JOB),
        "its size is 16, not 32; choose another",
    ),
    (
        "samples without their job",
        lambda b: ((b / "s").mkdir(), b.bytes("s/sample_000000.exr", b"x"), b.synthesize()),
        "holds samples but no job.json; choose another folder",
    ),
    ("job missing", lambda b: b.run("make", b.folder), "job.json does not exist; check the path"),
    ("job of another format", lambda b: b.make(format="mpsnet-rig"), "job.json is not a mpsnet-samples file"),
    ("job of a newer version", lambda b: b.make(version=9), "job.json is version 9…update it"),
    ("job with a misspelled key", lambda b: b.make(cuont=3), 'job.json has "cuont", which no…may have renderer, count'),
    ("job without a count", lambda b: b.make(count=None), 'job.json lacks "count"; add it'),
    ("job of another renderer", lambda b: b.make(renderer="eevee"), "renderer 'eevee' is not known; choose synthesis"),
    ("count as text", lambda b: b.make(count="3"), "job.json: the job's count must be a whole number…not '3'"),
    ("seed that is true", lambda b: b.make(seed=True), "job's seed must be a whole number"),
    ("denoise in words", lambda b: b.make(denoise="yes"), "job's denoise must be true or false, not 'yes'"),
    ("shapes as text", lambda b: b.make(shapes="blobs"), "job's shapes must be a list of names, not 'blobs'"),
    ("merl that is a number", lambda b: b.make(merl=3), "job's merl must be a path, not 3"),
    ("objects without a scene", lambda b: b.make(objects=["Bear"]), "names objects of a scene but takes no shapes"),
    (
        "objects without Blender",
        lambda b: b.make(objects=["Bear"], shapes=["scene"]),
        "scene's objects are rendered by Blender alone",
    ),
    (
        "measured materials in Blender",
        lambda b: b.make(renderer="cycles", merl="m.npz"),
        "merl) are for synthesis alone; leave them out",
    ),
    ("Blender for a synthesis", lambda b: b.make("--blender", "blender"), "made without Blender; leave --blender out"),
    (
        "a Blender that is none",
        lambda b: b.make("--blender", b / "blender", renderer="cycles"),
        "cannot run…blender (No such file…); check the path",
    ),
    ("nothing to show", lambda b: b.run("show", b / "nowhere.exr"), "nowhere.exr does not exist; check the path"),
    ("a folder without samples", lambda b: b.run("show", b.folder), "holds no samples (.exr); make some"),
    ("show none", lambda b: b.run("show", b.photo(), "--count", "0"), "--count 0 shows nothing; choose 1 or more"),
    ("show over the photo", lambda b: b.run("show", b.photo("a.png"), "-o", b / "a.png"), "overwrite…a.png"),
    ("show in no folder", lambda b: b.run("show", b.photo(), "-o", b / "no" / "s.png"), "does not exist; create it"),
    ("show as a film", lambda b: b.run("show", b.photo(), "-o", b / "s.mp4"), "s.mp4…not an image format of ours"),
    ("show a rig", lambda b: b.run("show", b.rig()), "rig.json cannot be read as an image"),
    ("show a cut photo", lambda b: b.run("show", cut(b.photo("a.png", kind="uint8"))), "a.png is damaged or cut short"),
    (
        "show a cut sample",
        lambda b: (write_sample(b / "s.exr", sphere_sample(16)), b.run("show", cut(b / "s.exr"))),
        "s.exr is damaged or cut short…delete it and make it again",
    ),
]


TRAINING: list[Case] = [
    (
        "without PyTorch",
        lambda b: without("torch", b),
        "needs PyTorch, which is not installed; pip install 'mpsnet[train]'",
    ),
    (
        "samples to measure on without PyTorch",
        lambda b: without("torch", b, lambda: b.run("evaluate", "samples", b.folder)),
        "needs PyTorch, which is not installed; pip install 'mpsnet[train]'",
    ),
]
if find_spec("torch"):
    TRAINING += [
        ("without ONNX", lambda b: without("onnx", b), "needs ONNX, which is not installed; pip install"),
        ("without TensorBoard", lambda b: without("tensorboard", b), "needs TensorBoard, which is not installed"),
        (
            "no recipe",
            lambda b: b.run("train", "--samples", b.folder, "-o", b / "m.onnx"),
            "--recipe; see mpsnet train",
        ),
        (
            "no samples",
            lambda b: b.run("train", "--recipe", "psfcn", "-o", b / "m.onnx"),
            "--samples; see mpsnet train",
        ),
        (
            "unknown recipe",
            lambda b: b.train("--recipe", "resnet"),
            "no recipe 'resnet'; choose demultiplexer, mpsnet…psfcn or give a .toml file",
        ),
        (
            "recipe missing",
            lambda b: b.train("--recipe", b / "no.toml"),
            "recipe…no.toml does not exist; check the path",
        ),
        (
            "recipe that is a folder",
            lambda b: b.train("--recipe", b.samples("a.toml")),
            "a.toml is a folder, not a file",
        ),
        (
            "recipe that is no TOML",
            lambda b: b.train("--recipe", b.text("a.toml", "steps: 3")),
            "a.toml is not valid TOML",
        ),
        (
            "recipe that is no text",
            lambda b: b.train("--recipe", b.bytes("a.toml", b"\xff\x00")),
            "a.toml is not valid TOML",
        ),
        (
            "a number of more digits than Python reads",
            lambda b: b.train("--recipe", b.text("a.toml", "steps = " + "1" * 5000)),
            "a.toml is not valid TOML",
        ),
        (
            "recipe beyond reason",
            lambda b: b.train("--recipe", b.text("a.toml", f"a{'.a' * 5000} = 1")),
            "a.toml is larger than 8 KiB",
        ),
        (
            "misspelled key",
            lambda b: b.train(stesp=3),
            "tiny.toml: the recipe's 'stesp' is not known; choose batch, crop, decay",
        ),
        ("no steps", lambda b: b.train(steps=None), 'the recipe lacks "steps"; add it'),
        ("no step", lambda b: b.train(steps=0), "recipe's steps must be from 1 to…not 0"),
        ("steps in words", lambda b: b.train(steps="many"), "recipe's steps must be from 1 to…not 'many'"),
        ("half a picture", lambda b: b.train(batch=1.5), "recipe's batch must be from 1 to 65536, not 1.5"),
        ("rate beyond reason", lambda b: b.train(learning_rate=3.0), "learning_rate must be from 1e-08 to 1, not 3.0"),
        ("name that is no text", lambda b: b.train(name=3), "recipe's name must be a text, not 3"),
        ("options that are no table", lambda b: b.train(options=[3]), "recipe's options must be a table, not [3]"),
        (
            "commands that are no list",
            lambda b: b.train("--recipe", b.recipe(samples="x").rename(b / "a.toml")),
            "samples must be a list, not 'x'",
        ),
        ("unknown network", lambda b: b.train(network="resnet"), "there is no network 'resnet'; choose demultiplexer"),
        ("unknown option", lambda b: b.train(**{"options.widht": 1}), "'widht'; mend the recipe"),
        (
            "width of nothing",
            lambda b: b.train(**{"options.width": 0}),
            "width 0 is not a number above 0…mend the recipe",
        ),
        ("crop that is too small", lambda b: b.train(crop=1), "on a crop of 1; choose a multiple of 1 from 2"),
        ("samples missing", lambda b: b.train(samples=b / "no"), "folder of samples…no does not exist; check the path"),
        (
            "folder without samples",
            lambda b: b.train(samples=b.folder),
            "there is no whole sample in…make some with mpsnet",
        ),
        (
            "no sample that is whole",
            lambda b: (cut(b.samples() / "sample_000000.exr"), b.train(samples=b / "samples")),
            "there is no whole sample in…make some with mpsnet",
        ),
        (
            "no sample that shows something",
            lambda b: b.train(samples=b.samples(light=0)),
            "there is no whole sample in…make some with mpsnet",
        ),
        ("validation missing", lambda b: b.train("--validation", b / "no"), "folder of samples…no does not exist"),
        (
            "another format",
            lambda b: b.train("-o", b / "m.pth"),
            "m.pth: models are written as .onnx; change the suffix",
        ),
        ("model in no folder", lambda b: b.train("-o", b / "no" / "m.onnx"), "no does not exist; create it first"),
        ("checkpoint in no folder", lambda b: b.train("--checkpoint", b / "no" / "c"), "no does not exist; create it"),
        (
            "logs in a file",
            lambda b: b.train("--logs", b.text("logs", "")),
            "logs is a file; name a folder for the logs",
        ),
        (
            "unknown precision",
            lambda b: b.train("--precision", "int8"),
            "precision 'int8' is not known; choose auto, float32",
        ),
        ("steps below 0", lambda b: b.train("--stop-after", "-5"), "--stop-after cannot be -5; choose 0 or more"),
        ("threads in words", lambda b: b.train("--threads", "all"), "--threads…'all'…see mpsnet train --help"),
        ("no such checkpoint", lambda b: b.train("--resume", b / "no"), "checkpoint…no does not exist; check the path"),
        (
            "checkpoint of another recipe",
            lambda b: b.resume(b.checkpoint(seed=5)),
            "c is of another recipe; resume with",
        ),
        (
            "model over the checkpoint",
            lambda b: b.train("--checkpoint", b / "out.onnx"),
            "the result would overwrite …out.onnx, a file that it needs",
        ),
        (
            "twin over its model",
            lambda b: b.run("quantize", dense()(b / "m.onnx"), "--samples", b.samples(), "-o", b / "m.onnx"),
            "the result would overwrite …m.onnx, a file that it needs",
        ),
        (
            "8-bit network to train further",
            lambda b: b.train("--resume", "multiscale-int8"),
            "multiscale-int8.onnx is in 8-bit numbers; resume from the one that it was made from",
        ),
        (
            "text as a network to train further",
            lambda b: b.train("--resume", b.text("c.onnx", "hello")),
            "c.onnx is damaged or was not trained here; resume from another",
        ),
        (
            "no such samples to measure on",
            lambda b: b.run("evaluate", "samples", b / "no"),
            "folder of samples…no does not exist; check the path",
        ),
        (
            "a folder without samples to measure on",
            lambda b: b.run("evaluate", "samples", b.folder),
            "there is no whole sample in…mpsnet synthesize",
        ),
        (
            "less than no samples to measure on",
            lambda b: b.run("evaluate", "samples", b.folder, "--count", "-1"),
            "-1 samples cannot be measured; choose 0, which is all, or more",
        ),
        ("cut checkpoint", lambda b: b.resume(cut(b.checkpoint())), "checkpoint…c is damaged or not one of ours"),
        ("spoilt checkpoint", lambda b: b.resume(spoilt(b.checkpoint())), "checkpoint…c is damaged or not one of ours"),
        ("text as checkpoint", lambda b: b.train("--resume", b.text("c", "hello")), "c is damaged or not one of ours"),
        ("checkpoint with code", lambda b: b.train("--resume", with_code(b, True)), "c is damaged or not one of ours"),
        ("bare checkpoint with code", lambda b: b.train("--resume", with_code(b, False)), "c is damaged or not one"),
        (
            "checkpoint of the optimiser alone",
            lambda b: (torch_file(b / "c", {"format": "mpsnet-checkpoint"}), b.train("--resume", b / "c")),
            "c is damaged or not one of ours",
        ),
        (
            "int8 twin of no model",
            lambda b: b.run("quantize", b.bytes("m.onnx", b"x"), "--samples", b.samples(), "-o", b / "out.onnx"),
            "m.onnx is not an ONNX model that can be run",
        ),
        (
            "int8 twin of a single layer",
            lambda b: b.run("quantize", pass_through(b / "m.onnx"), "--samples", b.samples(), "-o", b / "out.onnx"),
            "m.onnx has no layer between its first and its last; leave it as it is",
        ),
        (
            "int8 twin without samples",
            lambda b: b.run("quantize", pass_through(b / "m.onnx"), "-o", b / "out.onnx"),
            "--samples; see mpsnet quantize --help",
        ),
        (
            "int8 twin in another format",
            lambda b: b.run("quantize", pass_through(b / "m.onnx"), "--samples", b.folder, "-o", b / "out.pth"),
            "out.pth: models are written as .onnx; change the suffix",
        ),
        (
            "checkpoint of another network",
            lambda b: b.resume(renamed(b.checkpoint())),
            "c does not fit the network: Error…resume from another",
        ),
    ]


def spoilt(path: Path) -> Path:
    """The same file with some of its weights changed."""
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 200] = bytes(255 - byte for byte in data[middle : middle + 200])  # more than is padding
    path.write_bytes(data)
    return path


def torch_file(path: Path, data: Any) -> Path:
    import torch

    torch.save(data, path)
    return path


def renamed(path: Path) -> Path:
    """A checkpoint whose network has a layer of another name."""
    from mpsnet_core.learning.training.checkpoint import read_checkpoint, write_checkpoint

    found = read_checkpoint(path)
    write_checkpoint(path, found._replace(weights={f"{name}s": value for name, value in found.weights.items()}))
    return path


def loop(path: Path) -> Path:
    """A link that leads to itself."""
    path.symlink_to(path.name)
    return path


PLY_HEAD = """ply
format ascii 1.0
element vertex 1
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
3 0 0 0
"""


def locked(b: Bench) -> Path:
    """A zip whose directory says that all of it is encrypted."""
    data = bytearray(b.mesh().read_bytes())
    for sign, flag in ((b"PK\3\4", 6), (b"PK\1\2", 8)):
        for found in re.finditer(re.escape(sign), bytes(data)):
            data[found.start() + flag] |= 1
    return b.bytes("mesh.npz", bytes(data))


def half_a_head(b: Bench) -> Path:
    """A zip with an array whose head, in Python's own words, ends too early."""
    with zipfile.ZipFile(b.mesh(uvs=None), "a") as archive:
        archive.writestr("uvs.npy", b"\x93NUMPY\x01\x00\x10\x00{'descr': '<f4'\n")
    return b / "mesh.npz"


def broken_array(b: Bench) -> Path:
    """A zip whose UVs are not an array at all."""
    with zipfile.ZipFile(b.mesh(uvs=None), "a") as archive:
        archive.writestr("uvs.npy", b"\x93NUMPY\x01\x00garbage")
    return b / "mesh.npz"


TOPICS = {
    "rig": RIGS,
    "camera": CAMERAS,
    "image": IMAGES,
    "capture": CAPTURES,
    "white photo": WHITE,
    "normals": NORMALS,
    "model": MODELS,
    "mesh": MESHES,
    "bake": BAKES,
    "output": OUTPUTS,
    "frames": FRAMES,
    "command": COMMANDS,
    "diligent": DILIGENT,
    "evaluation": EVALUATIONS,
    "samples": SAMPLES,
    "training": TRAINING,
}
CASES = [pytest.param(*case[1:], id=f"{topic}: {case[0]}") for topic, cases in TOPICS.items() for case in cases]


@pytest.fixture(autouse=True)
def settings_kept(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """`main` sets the process up for itself alone; put back what it set. Warnings are errors here, not hidden by it."""
    monkeypatch.setattr(sys, "warnoptions", ["error"])
    log = logging.getLogger("mpsnet_core")
    propagate, level = log.propagate, log.level
    yield
    log.propagate = propagate
    log.setLevel(level)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("bad_input", "words"), CASES)
def test_bad_input_gets_one_clear_sentence(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], bad_input: Callable[[Bench], Any], words: str
) -> None:
    with pytest.raises(InputError) as caught:
        bad_input(Bench(tmp_path))
    sentence = str(caught.value)
    assert re.search(".*".join(map(re.escape, words.split("…"))), sentence), sentence
    assert "\n" not in sentence and "Traceback" not in sentence
    assert len(sentence.replace(str(tmp_path), "").replace("x" * 300, "")) <= LONGEST, sentence
    assert capfd.readouterr().err == ""
    assert not list(tmp_path.rglob("*unfinished*")) and not (tmp_path / "unpickled").exists()


def test_there_are_many_kinds_of_bad_input() -> None:
    assert len({case.id for case in CASES}) == len(CASES) >= 40


def test_the_bench_itself_is_in_order(tmp_path: Path) -> None:
    """What the cases spoil works when it is not spoilt, so that each fails for its own reason."""
    b = Bench(tmp_path)
    assert read_rig(b.lights()).tilts == pytest.approx([90, 210, 330])
    assert isinstance(read_capture(b.photo(), read_rig(b.rig()), mask=b.mask()), Capture)
    assert read_mesh(b.mesh()).triangles.shape == (2, 3)
    estimate_normals(SPHERE.capture(), pass_through(b / "m.onnx"))
    estimate_normals(SPHERE.capture(), dense(card=json.loads(card().to_json()))(b / "m.onnx"))
    for good in (b.estimate, b.bake, b.evaluate, *([b.train] if find_spec("torch") else [])):
        with pytest.raises(AssertionError, match=r"^(note: .*)?\s*assert 0 == 2"):
            good()
