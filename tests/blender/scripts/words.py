"""German words of settings whose English ones Blender's own tables have in another sense, by step and name."""

import json
import sys
from importlib import import_module
from pathlib import Path

import bpy

report = sys.argv[sys.argv.index("--") + 1]
bpy.context.preferences.view.language = "de_DE"
translated = bpy.app.translations.pgettext_iface
mps = bpy.context.scene.mps
found = {}
for step, name in (("calibrate", "ball"), ("bake", "space"), ("views", "write_report")):
    setting = getattr(mps, step).bl_rna.properties[name]
    items = [item.name for item in getattr(setting, "enum_items", ())]
    found[f"{step}.{name}"] = [translated(word, setting.translation_context) for word in (setting.name, *items)]
package = bpy.types.MPS_PT_rig.__module__.rpartition(".panels")[0]
notes = import_module(f"{package}.settings.messages")
BLACK = "the %s channel is black: was its light on? [black-channel]"
told = [notes.Note("%.0f%% of the surface seen", 31.6), notes.Note(BLACK, "red"), notes.Note("as %d it stands", 3)]
found["notes"] = [notes.in_blender(note) for note in told]
found["blender"] = translated("Mirror Ball")
Path(report).write_text(json.dumps(found), encoding="utf-8")
