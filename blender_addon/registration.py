"""What a module of the add-on adds to Blender, and its removal.

That is its classes (``MPS_...``) in their order, its ``HANDLERS`` (functions by the names of Blender's lists, of which
a Blender may lack some), its ``TIMERS``, which it starts itself, and what its own ``register`` adds. The class of an
operator says its name: ``MPS_OT_bake`` is ``bpy.ops.mps.bake``.
"""

from types import ModuleType
from typing import Any

import bpy


def classes_in(module: ModuleType) -> list[Any]:
    """The classes for Blender that a module defines, in their order."""
    own = (one for one in vars(module).values() if isinstance(one, type) and one.__module__ == module.__name__)
    return [one for one in own if one.__name__.startswith("MPS_")]


def register_module(module: ModuleType) -> None:
    """Add the module's classes and handlers to Blender, and call its ``register``."""
    for cls in classes_in(module):
        if issubclass(cls, bpy.types.Operator):
            cls.bl_idname = f"mps.{cls.__name__.removeprefix('MPS_OT_')}"
        bpy.utils.register_class(cls)
    for handlers, handler in _handlers(module):
        handlers.append(handler)
    getattr(module, "register", _nothing)()


def unregister_module(module: ModuleType) -> None:
    """Call the module's ``unregister``, and remove its handlers, timers and classes from Blender."""
    getattr(module, "unregister", _nothing)()
    for timer in getattr(module, "TIMERS", ()):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
    for handlers, handler in _handlers(module):
        handlers.remove(handler)
    for cls in reversed(classes_in(module)):
        bpy.utils.unregister_class(cls)


def _handlers(module: ModuleType) -> list[tuple[Any, Any]]:
    named = getattr(module, "HANDLERS", {}).items()
    return [(getattr(bpy.app.handlers, name), one) for name, one in named if hasattr(bpy.app.handlers, name)]


def _nothing() -> None:
    pass
