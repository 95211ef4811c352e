"""Training data: samples of generated shapes, mesh files or this scene, rendered by separate Blender processes."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.errors import FileError, InputError, SettingsError
from mpsnet_core.io.files import atomic_write
from mpsnet_core.synthesis.farm.address import is_loopback
from mpsnet_core.synthesis.job import (
    CONTACT_SHEET,
    JOB_FILE,
    SHAPES,
    SampleJob,
    place_job,
    read_job,
    samples_there,
    withdraw_job,
)
from mpsnet_core.synthesis.operations import MakeSamples, Synthesize

from ..child_process.linked_data import save_copy
from ..child_process.trust import python_drivers
from ..images import fine_preview, load_image
from ..operators.core_run import RunsCore
from ..outputs import file_name, is_permanent, requested_path
from ..preferences import PACKAGE, output_folder, preference
from ..scene.objects import by_session_uid
from ..settings.declared import BoolSetting, StringSetting, apply_given_settings, options_of
from ..settings.samples import SamplesSettings

SCENE_FILE = "scene.blend"


class MPS_OT_render_samples(RunsCore, SamplesSettings, bpy.types.Operator):
    """Render training data into a folder, with several Blenders beside this one.

    What the folder holds already is not rendered again: after a stop, run it again and it goes on"""

    bl_label = "Render Samples"

    # Not stored in the scene: a .blend file must not name hosts that this machine connects to.
    cluster: StringSetting(
        "Cluster",
        "Address of a Dask scheduler whose machines render, such as tls://host:8786. "
        "Empty: that of the preferences, where they have one",
    )
    cluster_trusted: BoolSetting(
        "Trusted Network", "This address need not be tls://. Whoever is in its network may run code on this machine"
    )

    _withdraw: Callable[[], None] | None = None  # removes the job that this run began

    def prepare(self, context: Any, folder: Path) -> tuple[MakeSamples, Sequence[Path]]:
        scene = context.scene
        apply_given_settings(self, scene.mps.samples)
        target = samples_folder(scene, self.output)
        if not (self.output or is_permanent(target)):
            raise FileError("no folder is named for the samples; name one, or save this file and they go beside it")
        job, (cluster, trusted) = self._sample_job(context, target), self._cluster()
        is_made, stored = not target.exists(), [] if (target / SCENE_FILE).exists() else [SCENE_FILE]
        if place_job(target, job):
            self._withdraw = partial(_withdraw, target, stored, is_made)
        if job.objects:
            self._store_scene(target / SCENE_FILE)
            self._notes = python_drivers()
        if job.denoise and not can_denoise():
            self.tell("this Blender has no OpenImageDenoise: light keeps its noise; take more samples", "WARNING")
        self._sheet, self._seen = target / CONTACT_SHEET, -1
        if not self._sheet.exists():
            scene.mps.samples.image = None  # it shows another folder
        operation = MakeSamples(
            folder=str(target),
            processes=self.processes,
            cluster=cluster,
            cluster_trusted=trusted,
            blender="" if bpy.app.module else bpy.app.binary_path,
            # If the extension was just enabled, the preferences may not be saved yet.
            addon="" if bpy.app.module else PACKAGE,
        )
        return operation, [self._sheet]

    def _cluster(self) -> tuple[str, bool]:
        """The cluster's address, "" for none, and whether its network is trusted.

        Both come from the caller or the preferences, never from a file.
        """
        own = bool(self.cluster)
        address = self.cluster if own else preference("cluster")
        if not address:
            return "", False
        if not (is_loopback(address) or bpy.app.online_access):
            raise SettingsError(
                f"Blender may not go online, and so not to the cluster at {address}; tick Allow Online Access in the "
                "system preferences, or begin the command line with --online-mode"
            )
        return address, self.cluster_trusted if own else preference("cluster_trusted")

    def _sample_job(self, context: Any, target: Path) -> SampleJob:
        shapes: tuple[str, ...] = (self.source.lower(),)
        objects: tuple[str, ...] = ()
        meshes, views = "", self.views
        if self.source == "GENERATED":
            shapes = tuple(kind for kind in SHAPES if kind.upper() in self.kinds)
        elif self.source == "MESHES":
            meshes = str(Path(bpy.path.abspath(self.meshes)).resolve()) if self.meshes else ""
            if meshes and not Path(meshes).is_dir():
                raise FileError(f"mesh folder {meshes} does not exist; check the path")
        else:
            objects, views = _chosen_objects(context, target), 1
        return SampleJob(
            renderer="cycles",
            **options_of(Synthesize, self, without=("meshes", "views", "processes")),
            shapes=shapes,
            meshes=meshes,
            objects=objects,
            views=views,
            samples=self.samples,
            denoise=self.denoise,
        )

    def _store_scene(self, path: Path) -> None:
        """Save the scene for the rendering processes. An existing one is kept: the samples in the folder show it."""
        if path.exists():
            self.tell(f"The scene is as it was when it was first rendered, see {path}")
            return
        painted = [image.name for image in bpy.data.images if image.is_dirty]
        if painted:
            raise FileError(f'the image "{painted[0]}" was changed and not saved; save or pack it first')
        with atomic_write(path) as unfinished:
            try:
                save_copy(unfinished, compress=True, mend="choose another folder")
            finally:  # Blender keeps a backup of a file that it overwrites
                unfinished.with_suffix(".blend1").unlink(missing_ok=True)

    def _failed(self, sentence: str) -> None:
        super()._failed(sentence)
        if self._withdraw is not None:
            self._withdraw()

    def cancel(self, context: Any) -> None:
        super().cancel(context)
        if self._withdraw is not None:
            self._withdraw()

    def refresh_results(self) -> None:
        """Show the contact sheet if the core has updated it."""
        scene = by_session_uid(bpy.data.scenes, self._scene_uid)
        with suppress(InputError, OSError):  # a sheet that is missing or cannot be shown is no reason to stop
            changed = self._sheet.stat().st_mtime_ns
            if scene is not None and changed != self._seen:
                self._seen = changed
                scene.mps.samples.image = image = load_image(self._sheet, "MPS Samples", is_data=False)
                if not bpy.app.background:
                    fine_preview(image)

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        self.refresh_results()
        sheet = self.scene(f"its samples are in {self._sheet.parent}").mps.samples.image
        if sheet is not None:
            self.made(sheet)
        self.tell(f"{samples_status(self._sheet.parent)}: {self._sheet.parent}")


def _withdraw(folder: Path, stored: Sequence[str], is_made: bool) -> None:
    """Remove a job without samples. stored: files that were made for it. is_made: whether the folder was, too."""
    with suppress(OSError):  # what cannot be removed, or a folder with other files, stays
        withdraw_job(folder, *stored)
        if is_made:
            folder.rmdir()


def samples_folder(scene: Any, given: str = "") -> Path:
    """The folder of the scene's samples: `given`, else that of its settings, else one in the output folder.

    Raises FileError if `given` is relative to a .blend file that was never saved.
    """
    if given:
        return requested_path(given).resolve()
    if scene.mps.samples.output:
        return Path(bpy.path.abspath(scene.mps.samples.output)).resolve()
    return output_folder() / file_name(f"{scene.name}_samples")


def can_denoise() -> bool:
    """Whether this Blender was built with OpenImageDenoise. Those of some Linux distributions are not."""
    import _cycles  # type: ignore[import-not-found]

    return bool(_cycles.with_openimagedenoise)


def samples_status(folder: Path) -> str:
    """A folder's sample count and total as text; "" if it has no readable job."""
    try:
        # Counting thousands of files is too slow for every redraw; a folder's time changes with every new file.
        return _counted(folder, folder.stat().st_mtime_ns) if (folder / JOB_FILE).is_file() else ""
    except OSError:
        return ""


@lru_cache(maxsize=1)
def _counted(folder: Path, changed: int) -> str:
    try:
        count = read_job(folder).count
    except InputError:
        return ""
    return f"{sum(number < count for number in samples_there(folder))} of {count} samples"


def _chosen_objects(context: Any, target: Path) -> tuple[str, ...]:
    """The selected mesh objects or, if nothing is selected, those that the folder's samples show already."""
    chosen = sorted(obj.name for obj in context.view_layer.objects.selected if obj.type == "MESH")
    if chosen:
        return tuple(chosen)
    if (target / JOB_FILE).is_file():
        return read_job(target).objects
    raise InputError("no mesh object is selected; select what the samples are to show")
