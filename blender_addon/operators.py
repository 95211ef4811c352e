"""What all the add-on's operators share: bad input becomes one sentence to the person or the script."""

import bpy

from mpsnet_core.errors import InputError


class SaysWhy:
    """An operator whose :meth:`act` raises InputError on bad input.

    The sentence appears in Blender's status bar; a script that called the operator gets it as a RuntimeError.
    """

    report: object

    def act(self, context: bpy.types.Context) -> None:
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.act(context)
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}
