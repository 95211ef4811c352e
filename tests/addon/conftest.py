"""Blender as pip's bpy module, with the add-on registered; every test gets a scene of its own."""

import json
import logging
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

# Before NumPy is imported, and for the processes that tests start: matrices here are small, and threads that wait for
# each other cost more than they save.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

import blender_addon
from blender_addon.child_process import core_process
from blender_addon.child_process.core_process import Work
from blender_addon.operators import core_run
from blender_addon.photo import photo
from mpsnet_core.cli.command import OPERATIONS
from mpsnet_core.cli.reporter import NoteCollector
from mpsnet_core.operation import Operation, from_json, to_json
from mpsnet_core.progress import silent

from .rendering import STATUE, matte, statue


@pytest.fixture(scope="session", autouse=True)
def registered() -> Iterator[None]:
    blender_addon.register()
    yield
    blender_addon.unregister()


@pytest.fixture(scope="session", autouse=True)
def core_in_this_process(registered: None) -> Iterator[None]:
    """What operators start from a script runs here: most of a test would be the start of another Python.

    tests/addon/test_core_process.py and tests/blender have the real one.
    """

    def run(
        work: Work, outputs: Sequence[Path] = (), on_progress: Callable[[float, str], None] = silent
    ) -> dict[str, Any]:
        if not isinstance(work, Operation):
            return core_process.run(work, outputs, on_progress)
        notes, log = NoteCollector(), logging.getLogger("mpsnet_core")
        log.addHandler(notes)
        try:
            result = from_json(json.loads(json.dumps(to_json(work))), OPERATIONS).run(on_progress)
        finally:
            log.removeHandler(notes)
        return json.loads(json.dumps(notes.added_to(result.facts())))

    logging.getLogger("mpsnet_core").setLevel(logging.INFO)
    with pytest.MonkeyPatch.context() as patched:
        for module in (core_run, photo):
            patched.setattr(module, "run", run)
        yield


# What a test may begin with beside an empty scene, the furthest first; see the fixtures of these names.
BEGINNINGS = ("estimated", "photographed", "sphere")


@pytest.fixture(scope="session")
def beginnings(registered: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with NAME.blend of each beginning and a folder NAME of its results, made once; tests open copies."""
    folder = tmp_path_factory.mktemp("beginnings")
    results = folder / "estimated"
    results.mkdir()

    def keep(name: str) -> None:
        if name != results.name:
            shutil.copytree(results, folder / name)
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{name}.blend"), copy=True, relative_remap=False)

    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.ops.mesh.primitive_uv_sphere_add(segments=128, ring_count=64)
    bpy.ops.object.shade_smooth()
    bpy.context.object.data.materials.append(matte())
    keep("sphere")
    bpy.ops.mps.add_rig()
    bpy.ops.mps.render_photo(width=96, height=96, samples=16, output=str(results / "photo.exr"))
    keep("photographed")
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(results / "normals.png"))
    keep("estimated")
    return folder


@pytest.fixture(autouse=True)
def scene(request: pytest.FixtureRequest) -> "bpy.types.Scene":
    """A scene that is saved nowhere: empty as it comes from the factory, or with what the test's fixtures name."""
    name = next((one for one in BEGINNINGS if one in request.fixturenames), "")
    if name:
        begin(name, request.getfixturevalue("beginnings"), request.getfixturevalue("tmp_path"))
    else:
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.context.scene.render.threads_mode = "AUTO"
    return bpy.context.scene


def begin(name: str, beginnings: Path, here: Path) -> None:
    """Open a beginning as Blender opens its startup file, its results as if they had been made `here`."""
    bpy.ops.wm.read_homefile(filepath=str(beginnings / f"{name}.blend"))
    shutil.copytree(beginnings / name, here, dirs_exist_ok=True)
    steps = (bpy.context.scene.mps.photo, bpy.context.scene.mps.estimate)
    for step in steps:
        step.output = str(here / Path(step.output).name) if step.output else ""
    for image in filter(None, (step.image for step in steps)):
        image.filepath = str(here / Path(image.filepath).name)


@pytest.fixture
def sphere(scene: "bpy.types.Scene") -> "bpy.types.Object":
    """A matte white unit sphere with UVs, selected and active."""
    return bpy.data.objects["Sphere"]


@pytest.fixture
def photographed(sphere: "bpy.types.Object") -> "bpy.types.Object":
    """The sphere with a rig and its photo, 96 x 96, photo.exr in the test's folder."""
    return sphere


@pytest.fixture
def estimated(photographed: "bpy.types.Object") -> "bpy.types.Object":
    """The sphere with rig, photo and estimated normals, normals.png in the test's folder."""
    return photographed


@pytest.fixture(scope="session")
def shot(registered: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the statue's scene, its photo, the rig's file and the true camera's."""
    folder = tmp_path_factory.mktemp("shot")
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    obj = statue()
    bpy.ops.mps.add_rig(projection="PERSPECTIVE", focal_length=60)
    bpy.context.scene.mps.rig.target.rotation_euler.rotate_axis("Y", 0.1)
    given = {"width": STATUE[0], "height": STATUE[1], "samples": 16}
    bpy.ops.mps.render_photo(**given, output=str(folder / "photo.exr"))
    bpy.ops.mps.remove_rig()
    (folder / "photo.camera.json").rename(folder / "true.json")
    (folder / "photo.rig.json").rename(folder / "rig.json")
    bpy.context.scene.mps.photo.image = None
    bpy.data.images.remove(bpy.data.images["MPS Photo"])
    bpy.context.scene.mps.bake.target = obj
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"), copy=True)
    return folder


@pytest.fixture
def opened(shot: Path, scene: "bpy.types.Scene", tmp_path: Path) -> "bpy.types.Scene":
    """The scene with the mesh alone, and the photo opened as one from a real camera; results go to `tmp_path`."""
    bpy.ops.wm.open_mainfile(filepath=str(shot / "scene.blend"))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert not [obj for obj in bpy.data.objects if obj.type != "MESH"]
    bpy.ops.mps.open_photo(filepath=str(shot / "photo.exr"))
    scene = bpy.context.scene
    scene.mps.estimate.rig_file = str(shot / "rig.json")
    scene.mps.estimate.model = "LAMBERTIAN"
    return scene
