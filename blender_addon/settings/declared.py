"""How settings are declared: once, kept in the scene, taken by the operators."""

import bpy

# Without it Blender fills an operator's unset properties with those of its last run instead of the scene's settings.
GIVEN = {"SKIP_SAVE"}
# Blender paints a path beside the .blend file ("//photo.png") red, as if it were not understood, without the second.
PATH = {*GIVEN, "PATH_SUPPORTS_BLEND_RELATIVE"}

FILE_FORMATS = (
    ("PNG", "PNG", "16-bit PNG"),
    ("TIFF", "TIFF", "16-bit TIFF"),
    ("EXR", "OpenEXR", "32-bit float OpenEXR"),
)

ENCODINGS = (
    ("AUTO", "Automatic", "Linear for float files and camera raw, sRGB for all others, unless the file says otherwise"),
    ("LINEAR", "Linear", "Twice the value is twice the light"),
    ("SRGB", "sRGB", "As for a screen"),
)


def take_given(operator: bpy.types.Operator, settings: type, group: bpy.types.PropertyGroup) -> None:
    """Write what the caller gave the operator to the scene's settings, and fill in the rest from there.

    Afterwards operator and scene say the same, and the "Adjust Last Operation" panel shows what was used.
    """
    for name in settings.__annotations__:
        if operator.properties.is_property_set(name):
            setattr(group, name, getattr(operator, name))
        else:
            setattr(operator, name, getattr(group, name))
