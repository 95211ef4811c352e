"""The documentation's commands for Blender run as they stand, with pip's bpy for a Blender."""

import shutil
from pathlib import Path

import bpy
import pytest
from documentation import PROJECT, WRITTEN, commands, needs_blender, run_page
from mathutils import Matrix
from page_inputs import RIG, camera, make_inputs

from blender_addon.commands import argument_parser
from mpsnet_core.scene.rig import write_rig

# `blender -b [FILE] --command mpsnet VERB` and `blender -b --python FILE`.
BLENDER = """shift
case "$1" in --*) file= ;; *) file=$1; shift ;; esac
case "$1" in
--command) shift 2; exec python -m blender_addon $file "$@" ;;
--python) exec python "$2" ;;
esac
exit 2"""


def name_of(page: Path) -> str:
    return str(page.relative_to(PROJECT))


@pytest.mark.parametrize("page", WRITTEN, ids=name_of)
def test_commands_of_blender_are_ones_that_there_are(page):
    calls = [call[call.index("--command") + 2 :] for call in commands(page, "blender") if "--command" in call]
    own = [call[2:] for call in commands(page, "python") if call[:2] == ["-m", "blender_addon"]]
    calls += [call[1:] if call[0].endswith(".blend") else call for call in own]
    for arguments in calls:
        if arguments[0] not in {"install-file", "server-generate"} and "--help" not in arguments:
            argument_parser().parse_args(arguments)


@pytest.fixture(scope="module")
def inputs(registered, tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    make_inputs(folder)
    shutil.copy(folder / "photo.dng", folder / "statue.dng")
    for name in ("statue", "cloth"):
        write_rig(folder / f"{name}.rig.json", RIG)
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    for name in ("Statue", "StatueLow"):
        bpy.ops.wm.obj_import(filepath=str(folder / "statue.obj"), forward_axis="Y", up_axis="Z")
        bpy.context.object.name = name
    taken_by = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))  # with Blender's lens of 50 mm
    taken_by.matrix_world = Matrix(camera(40).world_from_camera.tolist())
    bpy.context.collection.objects.link(taken_by)
    bpy.context.scene.camera = taken_by
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    return folder


@pytest.mark.long
@pytest.mark.parametrize("page", [page for page in WRITTEN if needs_blender(page)], ids=name_of)
def test_the_page_runs_from_top_to_bottom(page, inputs, tmp_path):
    shutil.copytree(inputs, tmp_path, dirs_exist_ok=True)
    run_page(page, tmp_path, {"blender": BLENDER})
