"""What other examples begin with: the extension's operators, also in pip's bpy, where it is not installed."""

import bpy

if not hasattr(bpy.types.Scene, "mps"):
    try:
        import blender_addon
    except ModuleNotFoundError:
        raise SystemExit("this Blender has no MPS-Net extension; install it first, see README") from None
    blender_addon.register()
