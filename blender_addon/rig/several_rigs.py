"""Several rigs in one scene: one of them is chosen, and the panel and the operators work with it.

All are stored in ``scene.mps.rigs``. ``scene.mps.rig``, ``.photo`` and ``.estimate`` are those of the chosen one.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import bpy
from mathutils import Euler, Matrix

from mpsnet_core.errors import InputError, SettingsError

from ..operators.core_run import RunContext, RunsCore, idle
from ..operators.reporting import ReportingOperator
from ..outputs import requested_folder, unique_name
from ..scene.objects import by_session_uid, temporarily
from ..scene.surfaces import bounding_sphere
from ..settings.declared import OF_ONE_RUN, BoolSetting, FloatSetting, IntSetting, setting_names
from ..settings.scene import STEPS
from .rig import MPS_OT_add_rig, add_rig, remove_rig

# Settings that another rig does not take over.
_OF_ONE_RIG = {"output", "rig_file", "white", "white_light"}


class _OnRigs(ReportingOperator):
    """Adds or removes rigs, or chooses one."""

    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        return idle(cls, context) and super().poll(context)


class MPS_OT_new_rig(_OnRigs, bpy.types.Operator):
    """Begin another rig in this scene, with a photo and an estimate of its own; the rigs that are there stay"""

    bl_label = "New Rig"

    def act(self, context: Any) -> None:
        new_rig(context.scene)


class MPS_OT_add_rig_ring(_OnRigs, bpy.types.Operator):
    """Add rigs in a ring around the selected objects, with the settings of the rig; those that are there stay.

    The first one looks along +Y, as Blender's front view"""

    bl_label = "Add Ring of Rigs"

    count: IntSetting("Count", "How many rigs stand around the object", default=8, within=(2, 64))
    elevation: FloatSetting(
        "Elevation (°)",
        "How far the cameras look down on the object, in degrees. 0: from the side, 90: from above",
        default=20.0,
        within=(-90.0, 90.0),
    )

    @classmethod
    def lacks(cls, context: Any) -> str:
        return MPS_OT_add_rig.lacks(context)

    def act(self, context: Any) -> None:
        scene, objects = context.scene, context.view_layer.objects.selected
        bounding_sphere(context.evaluated_depsgraph_get(), objects)  # raises before any is built
        for number in range(self.count):
            if scene.mps.rig.lights:  # else the chosen one was never built, and is the first of them
                new_rig(scene)
            add_rig(context)
            turned = Euler((math.radians(90 - self.elevation), 0, math.tau * number / self.count))
            target = scene.mps.rig.target
            target.matrix_world = Matrix.LocRotScale(target.matrix_world.translation, turned, None)
        context.view_layer.update()


class MPS_OT_choose_rig(_OnRigs, bpy.types.Operator):
    """Work with this rig, its photo and its estimate"""

    bl_label = "Choose Rig"
    bl_options = {"REGISTER", "UNDO", "INTERNAL"}

    index: IntSetting("Number", "Number of the rig in the scene's list, from 0", min=0)

    def act(self, context: Any) -> None:
        count = max(len(context.scene.mps.rigs), 1)
        if self.index >= count:
            raise InputError(f"there is no rig {self.index}; this scene has {count}, numbered from 0")
        context.scene.mps.chosen_rig = self.index


class MPS_OT_drop_rig(_OnRigs, bpy.types.Operator):
    """Remove the chosen rig with its lights and its camera; its photo and normals stay as files and images"""

    bl_label = "Remove from List"

    @classmethod
    def lacks(cls, context: Any) -> str:
        number = "only one" if context.scene.mps.rig.target else "no"
        return f"There is {number} rig in this scene" if len(context.scene.mps.rigs) < 2 else ""

    def act(self, context: Any) -> None:
        mps, index = context.scene.mps, context.scene.mps.chosen_rig
        remove_rig(context.scene)
        mps.rigs.remove(index)
        mps.chosen_rig = max(index - 1, 0)


class OnEachRig(RunsCore):
    """An operator that works with the chosen rig or, one after the other, with all rigs of the scene.

    This is like choosing each rig and pressing the button: settings, results and notes are those of each rig.
    """

    all_rigs: BoolSetting(
        "All Rigs",
        "Do this for all rigs of this scene, one after the other, each with its own settings. "
        "Off: for the chosen rig alone",
    )

    @classmethod
    def description(cls, context: Any, properties: Any) -> str:
        all_rigs = properties.bl_rna.properties["all_rigs"]
        return bpy.app.translations.pgettext_tip(all_rigs.description) if properties.all_rigs else ""

    def run_contexts(self) -> Sequence[RunContext]:
        scene = by_session_uid(bpy.data.scenes, self._scene_uid)
        if not (self.all_rigs and len(scene.mps.rigs) > 1):
            return super().run_contexts()
        if "output" in self._given and requested_folder(self.output) is None:
            raise SettingsError(f"all rigs would write {self.output}; give a folder, with a slash at its end")
        for one in scene.mps.rigs:  # check all before the first starts, because renders share one copy of the file
            group = getattr(one, self.step)
            for name in self._given.intersection(setting_names(group)) - OF_ONE_RUN:
                setattr(group, name, getattr(self, name))
        return [partial(self._with_rig, place) for place in range(len(scene.mps.rigs))]

    @contextmanager
    def _with_rig(self, place: int) -> Iterator[None]:
        """Within the with block, the rig at a position in the list is the chosen one, while it exists."""
        scene = by_session_uid(bpy.data.scenes, self._scene_uid)
        if scene is None or place >= len(scene.mps.rigs):
            yield
            return
        self._rig_place, self._whose = place, f"{scene.mps.rigs[place].name}: "
        for one in self.properties.bl_rna.properties:
            if one.identifier not in {"rna_type", *self._given}:  # a value of the previous rig
                self.properties.property_unset(one.identifier)
        with temporarily((scene.mps, "chosen_rig", place)):
            yield


def new_rig(scene: Any) -> None:
    """Add a rig and choose it. It has the settings of the previous one, but none of its files or results."""
    mps = scene.mps
    place = mps.chosen_rig if mps.chosen else 0
    taken: set[str] = set()
    for one in mps.rigs:
        one.name = one.name or _free_name(taken)
        taken.add(one.name)
    mps.rigs.add().name = _free_name({one.name for one in mps.rigs})
    mps.chosen_rig = len(mps.rigs) - 1
    for before, now in ((getattr(mps.rigs[place], step), getattr(mps, step)) for step in STEPS):
        for name in setting_names(now):
            if name not in _OF_ONE_RIG and before.is_property_set(name):
                setattr(now, name, getattr(before, name))


def _free_name(taken: set[str]) -> str:
    return next(name for number in count(1) if (name := f"Rig {number}") not in taken)


def result_name(scene: Any, what: str) -> str:
    """File name for a result of the chosen rig, distinct between .blend files, scenes and rigs."""
    parts = [Path(bpy.data.filepath).stem] if bpy.data.filepath else []
    parts.append(unique_name([one.name for one in bpy.data.scenes], list(bpy.data.scenes).index(scene)))
    if len(scene.mps.rigs) > 1:
        parts.append(unique_name([one.name for one in scene.mps.rigs], scene.mps.chosen_rig))
    return "_".join([*parts, what])
