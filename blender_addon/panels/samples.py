"""Training data, in a separate tab that a preference enables."""

from typing import Any

from ..outputs import is_permanent
from ..preferences import preference
from ..training.training_data import samples_folder, samples_status
from .step import Step
from .text import wrapped


class MPS_PT_samples(Step):
    bl_label = "Training Data"
    bl_category = "MPS Training"
    verbs = ("render_samples",)
    shows = "samples"
    optional = True

    @classmethod
    def poll(cls, context: Any) -> bool:
        return bool(preference("training"))

    def draw(self, context: Any) -> None:
        samples = context.scene.mps.samples
        self.column(samples, "source", {"GENERATED": "kinds", "MESHES": "meshes"}.get(samples.source, ""))
        self.column(samples, "count", "seed", "size", samples.source != "SCENE" and "views")
        self.column(samples, "samples", "bounces", "denoise")
        target = samples_folder(context.scene)
        names = ("output", "processes")
        column = self.column(samples, *names, output="Automatic" if is_permanent(target) else "Name one")
        if address := preference("cluster"):
            wrapped(column, f"On {address}, see the preferences")
        self.progress_or(context, "render_samples", "RENDER_ANIMATION")
        found = samples_status(target)
        if found and not context.window_manager.mps.running:
            wrapped(self.layout, f"{found} in this folder")
        self.picture(samples.image)
