"""Every word that the panel shows is there in each language."""

import ast
from pathlib import Path

import bpy
import pytest

import blender_addon
from blender_addon.panels.models import NAMES as NAMES_OF_MODELS
from blender_addon.panels.step import Kind
from blender_addon.preferences import MPS_AddonPreferences
from blender_addon.rig.calibrate import CHANNEL, EQUATION_2, UNEXPLAINED
from blender_addon.translations import TABLES, TIPS, in_table, tooltips

HERE = Path(blender_addon.__file__).parent
# What has the same name everywhere.
NAMES = {
    *("Alpha", "Blender", "Catmull-Clark", "Core ML", "CPU", "CUDA", "DirectML", "DirectX", "glTF", "Godot", "MPS-Net"),
    *("MPS-Net (2019)", "OpenEXR", "OpenGL", "PNG", "PS-FCN", "sRGB", "TIFF", "Unity", "Unreal Engine", "X", "Y"),
    *("2 x 2", "4 x 4"),
}


def named(rna, seen):
    """The names of properties and of what they can be, in a group of settings and those in it."""
    for one in rna.properties:
        if one.identifier in {"rna_type", "name", "bl_idname"} or one.is_hidden:
            continue
        if one.name != one.identifier:
            yield one.name
        if one.type == "ENUM":
            yield from (item.name for item in one.enum_items)
        inner = one.fixed_type if one.type in {"POINTER", "COLLECTION"} else None
        if inner and inner.identifier.startswith("MPS_PG_") and inner.identifier not in seen:
            yield from named(inner, seen | {inner.identifier})


def written(file):
    """The texts that a file gives to what it draws, as they stand there."""
    for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        for given in getattr(call, "keywords", ()):
            if isinstance(call, ast.Call) and given.arg in {"text", "placeholder", "heading"}:
                either = [given.value.body, given.value.orelse] if isinstance(given.value, ast.IfExp) else [given.value]
                yield from (one.value for one in either if isinstance(one, ast.Constant) and one.value)


def shown():
    """Every word that the add-on shows as it stands."""
    yield from (kind.word for kind in Kind)
    for kind in (bpy.types.Scene, bpy.types.Image, bpy.types.WindowManager):
        yield from named(kind.bl_rna.properties["mps"].fixed_type, frozenset())
    yield from named(MPS_AddonPreferences.bl_rna, frozenset())
    for name in dir(bpy.ops.mps):
        rna = getattr(bpy.ops.mps, name).get_rna_type()
        yield rna.name
        yield from named(rna, frozenset())
    for name in dir(bpy.types):
        if name.startswith(("MPS_PT_", "MPS_MT_", "MPS_FH_")):
            yield getattr(bpy.types, name).bl_label
    for file in [*HERE.glob("panels/*.py"), HERE / "preferences.py"]:
        yield from written(file)
    yield from (*NAMES_OF_MODELS.values(), CHANNEL, UNEXPLAINED, EQUATION_2)


@pytest.mark.parametrize("language", TABLES)
def test_every_word_is_translated(language):
    words = {word for word in shown() if any(map(str.isalpha, word))}
    assert len(words) > 250
    missing = sorted(words - NAMES - set(TABLES[language]))
    assert not missing, f"translations/{language}.py lacks: {', '.join(missing)}"


@pytest.mark.parametrize("language", TIPS)
def test_tooltips_are_translated(language):
    """All but a few, which may have been reworded since; the message lists them."""
    english = {in_table(tip) for tip in tooltips() if tip}
    assert len(english) > 300
    missing = sorted(english - set(TIPS[language]))
    assert len(missing) < 0.03 * len(english), f"translations/tips_{language}.py lacks: " + "\n".join(missing)
    gone = sorted(set(TIPS[language]) - english)
    assert len(gone) < 0.03 * len(english), f"translations/tips_{language}.py has what is shown no more: {gone}"
