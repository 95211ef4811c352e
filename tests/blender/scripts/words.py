"""German words of settings whose English ones Blender's own tables have in another sense, by step and name."""

import json
import sys
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
found["blender"] = translated("Mirror Ball")
Path(report).write_text(json.dumps(found), encoding="utf-8")
