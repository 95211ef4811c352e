"""Everything a person can set or press explains itself."""

import bpy

from blender_addon.menu import verbs

# What makes no sense without the panel around it.
PANEL_ONLY = {
    "mps.cancel",
    "mps.dismiss",
    "mps.choose_rig",
    "mps.read_notes",
    "mps.choose_file",
    "mps.show_image",
    "mps.remove_align_point",
    "mps.add_rig_preset",
    "mps.add_bake_preset",
}


def operators():
    return [getattr(bpy.ops.mps, name) for name in dir(bpy.ops.mps)]


def groups():
    names = [name for name in dir(bpy.types) if name.startswith(("MPS_PG_", "MPS_AddonPreferences"))]
    return [(name, getattr(bpy.types, name).bl_rna) for name in names] + [
        (operator.idname_py(), operator.get_rna_type()) for operator in operators()
    ]


def test_every_property_has_a_name_and_a_tooltip():
    faults = []
    for group, rna in groups():
        for one in rna.properties:
            if one.identifier in {"rna_type", "name", "bl_idname"} or one.is_hidden:
                continue
            place = f"{group}.{one.identifier}"
            if not one.name or not one.description:
                faults.append(f"{place} has no name or no tooltip")
            elif one.description.endswith("."):
                faults.append(f"{place}: Blender adds the full stop itself")
            if one.type == "ENUM":
                faults += [
                    f"{place}.{item.identifier} has no tooltip" for item in one.enum_items if not item.description
                ]
    assert not faults, "\n".join(faults)


def test_every_operator_has_a_label_and_a_tooltip_and_is_found_by_search():
    for operator in operators():
        name, rna = operator.idname_py(), operator.get_rna_type()
        assert rna.name and rna.description, name
        assert not rna.description.endswith("."), name
        cls = getattr(bpy.types, operator.idname())
        assert ("INTERNAL" in cls.bl_options) == (name in PANEL_ONLY), name
        assert (name.removeprefix("mps.") in verbs()) == (name not in PANEL_ONLY), name


def test_every_panel_has_a_label_and_names_operators_that_are_there():
    names = [name for name in dir(bpy.types) if name.startswith("MPS_PT_")]
    assert len(names) > 8
    for name in names:
        panel = getattr(bpy.types, name)
        assert panel.bl_label
        assert all(hasattr(bpy.types, f"MPS_OT_{verb}") for verb in getattr(panel, "verbs", ())), name
