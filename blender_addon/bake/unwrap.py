"""Unwrap: UVs for a mesh that has none, such as a scan as it comes."""

import math
from typing import Any

import bpy

from mpsnet_core.errors import InputError

from ..operators.chain import run_operator
from ..operators.reporting import ReportingOperator
from ..scene.objects import refuse_unselectable, select, target_of

# Faces that differ by more than this angle go to different islands; Blender's own default for Smart UV Project.
_ANGLE = math.radians(66)
# Gap between islands as a fraction of the texture: 4 texels of 2048.
_GAP = 0.002


class MPS_OT_unwrap(ReportingOperator, bpy.types.Operator):
    """Give the target UVs by Blender's Smart UV Project, where it has none. UVs made by hand have fewer seams"""

    bl_label = "Unwrap"
    bl_options = {"REGISTER", "UNDO"}

    def act(self, context: Any) -> None:
        target = target_of(context)
        if not lacks_uvs(target):
            raise InputError("the target is no mesh without UVs; choose one, or delete its UV map first")
        unwrap(context, target)
        self.tell(f'"{target.name}" has a UV map now')


def lacks_uvs(obj: Any) -> bool:
    """Whether an object is a mesh without UVs, and no modifier could give it some."""
    if obj is None or obj.type != "MESH" or obj.mode == "EDIT":
        return False
    return bool(obj.data.polygons) and not obj.data.uv_layers and not any(one.type == "NODES" for one in obj.modifiers)


def unwrap(context: Any, obj: Any) -> None:
    """Give a mesh object UVs. Raises InputError if it is hidden or linked."""
    refuse_unselectable(obj)
    if obj.library is not None or obj.data.library is not None:
        raise InputError(f'"{obj.name}" is linked from another file; make it local, or unwrap it there')
    layer = context.view_layer
    selected, active = list(layer.objects.selected), layer.objects.active
    select(layer, [obj], obj)
    try:
        run_operator(bpy.ops.object.mode_set, mode="EDIT")
        run_operator(bpy.ops.mesh.select_all, action="SELECT")
        run_operator(bpy.ops.uv.smart_project, angle_limit=_ANGLE, island_margin=_GAP)
    finally:
        if obj.mode == "EDIT":
            bpy.ops.object.mode_set(mode="OBJECT")
        select(layer, selected, active)
