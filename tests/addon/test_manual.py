"""Blender's Online Manual leads from every button and field of ours to its place in the reference."""

import re
import runpy
from pathlib import Path
from urllib.request import url2pathname

import bpy
import pytest

from blender_addon import manual

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture
def page(tmp_path, monkeypatch):
    """The page of the reference where an extension has it; its text, as it is before Sphinx."""
    manual.unregister()
    generated = runpy.run_path(str(DOCS / "generated_pages.py"))
    file = tmp_path / manual.PLACES.parent / "blender.html"
    file.parent.mkdir()
    file.write_text("\n".join(generated["blender"]()), encoding="utf-8")
    generated["write_redirects"](file.parent)
    monkeypatch.setattr(manual, "FOLDERS", [tmp_path / "none", tmp_path])
    manual.register()
    yield file
    manual.unregister()
    monkeypatch.undo()
    manual.register()


def asked_for():
    """What Blender asks its manual for: every operator, and every property of a group or of the preferences."""
    yield from (f"bpy.ops.mps.{name}" for name in dir(bpy.ops.mps))
    for group in {*bpy.types.PropertyGroup.__subclasses__(), *bpy.types.AddonPreferences.__subclasses__()}:
        if group.__module__.startswith("blender_addon."):
            for one in group.bl_rna.properties:
                if one.identifier not in {"rna_type", "name", "bl_idname"} and not one.is_hidden:
                    yield f"bpy.types.{group.__name__}.{one.identifier}"


def test_every_button_and_field_leads_to_a_place_that_is_there(page):
    look_up = bpy.types.WM_OT_doc_view_manual._lookup_rna_url  # Blender's own, behind F1
    anchors = re.findall('id="([^"]+)"', page.read_text(encoding="utf-8"))
    assert len(anchors) == len(set(anchors)) > 200
    names = list(asked_for())
    assert len(names) > 200
    for name in names:
        address = look_up(name, verbose=False) or ""
        assert address.startswith("file://"), name
        leads = Path(url2pathname(address.removeprefix("file://")))
        target, _, anchor = leads.read_text(encoding="utf-8").partition("url=")[2].partition('"')[0].partition("#")
        assert (leads.parent / target).resolve() == page, name
        assert anchor in anchors, name
