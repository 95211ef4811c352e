"""The installed zip: what registering it imports, and where its packages come from."""

import json
import zipfile
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pytest

# The heavy ones: only the child process may import them.
HEAVY = {"onnxruntime", "OpenImageIO", "trimesh", "embreex"}

# Wraps the one function by which Blender enables add-ons at its start, in the folder of scripts that run before that.
PROBE = """
import json, os, sys
import addon_utils

enable = addon_utils.enable

def watched(module_name, *arguments, **options):
    module = enable(module_name, *arguments, **options)
    if module_name.endswith(".mpsnet"):
        with open(os.environ["MPSNET_REPORT"], "w") as file:
            json.dump({"modules": sorted(sys.modules)}, file)
    return module

def register():
    addon_utils.enable = watched

def unregister():
    addon_utils.enable = enable
"""


@pytest.fixture
def probe(blender):
    script = blender.user / "scripts" / "startup" / "mpsnet_probe.py"
    script.parent.mkdir(parents=True, exist_ok=True)
    script.write_text(PROBE, encoding="utf-8")
    yield
    script.unlink()


def test_registering_imports_nothing_heavy(blender, probe, tmp_path):
    report = tmp_path / "report.json"
    done = blender.run("-b", "--python-expr", "pass", MPSNET_REPORT=str(report))
    assert report.is_file(), done.stdout + done.stderr
    start = json.loads(report.read_text(encoding="utf-8"))
    assert HEAVY.isdisjoint(start["modules"])
    assert "bl_ext.user_default.mpsnet" in start["modules"]


def test_words_that_blender_has_in_another_sense_are_the_extension_s(blender, tmp_path):
    found = blender.script("words.py", tmp_path / "report.json")
    assert found.pop("blender") == "Ball spiegeln", "Blender's own word, to mirror a ball, must not be taken"
    assert found == {
        "calibrate.ball": ["Spiegelkugel"],
        "bake.space": ["Raum", "Tangente", "Objekt"],
        "views.write_report": ["Bericht"],
        "notes": [
            "32% der Oberfläche gesehen",
            "der Kanal Rot ist schwarz: war sein Licht an? [black-channel]",
            "as 3 it stands",
        ],
    }


def test_the_packages_are_the_extension_s_and_numpy_is_blender_s(blender, tmp_path):
    found = blender.script("packages.py", tmp_path / "report.json")
    assert found["operators"]
    for package in ("mpsnet_core", *HEAVY):
        assert Path(found[package]).is_relative_to(blender.user), (package, found[package])
    assert not Path(found["numpy"]).is_relative_to(blender.user)


def test_the_zip_holds_the_addon_with_the_panels_networks_and_no_tools_or_numpy(extension_zip):
    with zipfile.ZipFile(extension_zip) as archive:
        names = archive.namelist()
        with zipfile.ZipFile(archive.open(next(name for name in names if name.startswith("wheels/mpsnet-")))) as wheel:
            networks = {Path(name).stem for name in wheel.namelist() if name.endswith(".onnx")}
    assert networks == {"lights", "multiscale", "mpsnet"}
    assert {"__init__.py", "blender_manifest.toml", "LICENSE"} <= set(names)
    assert not [name for name in names if "build_extension" in name or "__pycache__" in name or "numpy-" in name]


LOOK_UP = "print('manual', bpy.types.WM_OT_doc_view_manual._lookup_rna_url('bpy.ops.mps.estimate', verbose=False))"


def test_the_online_manual_is_the_one_in_the_zip_where_it_has_one(blender, extension_zip):
    done = blender.run("-b", "--python-expr", f"import bpy; {LOOK_UP}")
    (found,) = (line.partition(" ")[2] for line in done.stdout.splitlines() if line.startswith("manual "))
    if "manual/reference/blender.html" not in zipfile.ZipFile(extension_zip).namelist():
        assert found == "None"
        return
    address = urlsplit(found)
    leads = Path(url2pathname(address.path))
    assert address.scheme == "file" and leads.is_relative_to(blender.user)
    assert "url=../blender.html#bpy.ops.mps.estimate" in leads.read_text(encoding="utf-8")
    assert 'id="bpy.ops.mps.estimate"' in (leads.parents[1] / "blender.html").read_text(encoding="utf-8")


IN_GERMAN = """
import bpy
view = bpy.context.preferences.view
view.language, view.use_translate_tooltips = "de_DE", True
print("tip", bpy.app.translations.pgettext_tip(bpy.ops.mps.pick_points.get_rna_type().description))
"""


def test_tooltips_are_translated_whatever_breaks_their_lines(blender):
    done = blender.run("-b", "--python-expr", IN_GERMAN)
    (tip,) = (line for line in done.stdout.splitlines() if line.startswith("tip "))
    assert tip.startswith("tip 4 bis 12 Stellen im Foto")
