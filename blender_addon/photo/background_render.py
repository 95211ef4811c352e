"""Rendering in the background: a second Blender without a window renders a copy of the file.

This is the only way that is safe in all versions. Blender's own render job reads the scene while the user keeps working
in it: an edit, an undo or another file then ends or crashes it. Frame changes, lights that are switched off in turn and
the temporary scene would also be visible, saved and undone in the user's file. A copy does not change after the button
was pressed, nothing has to be restored, and ending the process cancels it. The price is a start of two or three seconds
and a second copy of the scene in memory.

`written_job` and `rendering_blender` are for the Blender that requests it, `render_job` for the one that renders. Both
speak the protocol of :mod:`mpsnet_core.io.child_process`; the request is a :class:`RenderJob`.
"""

import re
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import render_stats

from mpsnet_core.cli import EXIT_BAD_INPUT, EXIT_CANCELLED, EXIT_UNFORESEEN
from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.io.child_process import Parent, ParentGone, only_request
from mpsnet_core.io.crash_log import describe_unexpected_error

from ..child_process.core_process import Program, blender_command
from ..child_process.linked_data import (
    BakeFolder,
    bake_folders,
    is_gone,
    missing_links,
    name_bake_folders,
    refuse_lost_links,
    save_copy,
)
from ..child_process.simulation_caches import simulations_write_into
from ..child_process.trust import blocked_scripts_note, take_run_permission
from ..errors import operator_errors
from ..images import pixels_of
from .studio import RenderKind, RenderProgress, render

REPORT_SECONDS = 0.5

_REMAINING = re.compile(r"Remaining: ?(?:(\d+):)?(\d+):(\d+\.\d+)")  # hours, minutes and seconds, as Cycles prints them
# Limit of a render's estimated progress: one that takes longer than expected must not look done.
_MAX_SHARE = 0.98


@dataclass(frozen=True)
class RenderJob:
    """What the other Blender renders."""

    file: str
    """The copy of the open file."""
    what: RenderKind
    """A photo, frames or true normals."""
    scene: str
    """Its name."""
    rig: int
    """Its index in the scene's list."""
    view_layer: str
    """Its name."""
    output: str
    """The file, or the folder of frames."""
    use_scripts: bool
    """Whether the file's scripts may run, see trust.py."""
    painted: dict[str, str] = field(default_factory=dict)
    """Files with the pixels of images that are in memory only, by the images' names."""
    missing: list[str] = field(default_factory=list)
    """Linked data that is missing in the open file, too."""
    bakes: list[BakeFolder] = field(default_factory=list)
    """Bake folders that the copy may not find."""


# --- in the Blender that requests it ----------------------------------------------------------------------------------


def written_job(context: Any, what: RenderKind, output: Path, folder: Path) -> dict[str, Any]:
    """Write a copy of the open file into `folder`. Returns the request for :func:`rendering_blender`.

    Simulation caches on disk are copied, too, not linked: the other Blender may clear unbaked ones.

    Raises InputError if the copy of the file cannot be written, OSError if something else cannot.
    """
    painted = {image.name: str(_painted(image, folder)) for image in bpy.data.images if _only_in_memory(image)}
    original = Path(bpy.data.filepath or "scene.blend")
    copy = folder / original.name
    save_copy(copy, compress=False, mend="make room for a copy of this file")
    caches = original.with_name(f"blendcache_{original.stem}")  # next to a file and named after it, as for the copy
    if bpy.data.filepath and caches.is_dir():
        shutil.copytree(caches, folder / caches.name, ignore=_no_files)
    return asdict(
        RenderJob(
            str(copy),
            what,
            context.scene.name,
            context.scene.mps.chosen_rig,
            context.view_layer.name,
            str(output),
            take_run_permission(),
            painted,
            missing_links(),
            bake_folders(besides=caches) if bpy.data.filepath else [],
        )
    )


def _no_files(folder: str, names: list[str]) -> list[str]:
    """Files that cannot be copied completely: pipes, devices, and links to folders, which may be cyclic."""
    paths = {name: Path(folder, name) for name in names}
    return [name for name, path in paths.items() if not path.is_file() and (path.is_symlink() or not path.is_dir())]


def _only_in_memory(image: bpy.types.Image) -> bool:
    """Whether neither a file nor the copy contains the pixels: they were painted, or the file was deleted since.

    Unused images are not in the copy.
    """
    painted = image.is_dirty and image.source in {"FILE", "GENERATED", "TILED"}
    outlived = image.source == "FILE" and image.has_data and is_gone(image)
    return (painted or outlived) and image.library is None and image.users > 0


def _painted(image: bpy.types.Image, folder: Path) -> Path:
    """Write the image's unmodified pixels to a file. Blender's own saving converts colours above 1."""
    if image.source == "TILED":
        raise InputError(f'the tiles of the image "{image.name}" were changed and not saved; save or pack them first')
    found = pixels_of(image)
    pixels = np.ones((*found.shape[:2], 4), np.float32)
    pixels[..., : 4 if image.channels == 4 else 3] = found
    path = folder / f"painted_{image.session_uid}.npy"
    # The copy cannot determine the type of a deleted file's pixels.
    np.save(path, pixels if image.is_float else np.rint(pixels * 255).astype(np.uint8))
    return path


def _paint(image: bpy.types.Image, file: str) -> None:
    pixels = np.load(file)
    is_float = pixels.dtype == np.float32
    if image.packed_file:
        image.unpack(method="REMOVE")
    image.source = "GENERATED"
    image.generated_height, image.generated_width = pixels.shape[:2]
    image.use_generated_float = is_float
    image.pixels.foreach_set((pixels if is_float else pixels / np.float32(255)).ravel())


def rendering_blender(folder: Path) -> Program:
    """A Blender without a window that renders requests. Its temporary files go to `folder`."""
    places = {name: str(folder) for name in ("TMPDIR", "TEMP", "TMP")}
    return Program(tuple(blender_command("render", str(folder))), "the rendering Blender", places)


# --- in the one that renders ------------------------------------------------------------------------------------------


def render_job(folder: Path) -> int:
    """Render the job that stdin requests, report progress and the result, and return the exit code."""
    for name in ("SIGTERM", "SIGBREAK"):  # SIGBREAK is how Windows asks a process group to end
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), _cancel)
    parent = Parent()
    tempfile.tempdir = str(folder)  # not that of the preferences: this folder is removed, however this process ends
    try:
        job = RenderJob(**only_request())
        parent.send(progress=0.0, message="opening a copy of the file")
        with simulations_write_into(folder, animated=job.what == "frames"):
            scene = _opened(job)
        window = bpy.context.window_manager.windows[0]
        with bpy.context.temp_override(window=window), _reporting(parent) as progress:
            rendered = render(job.what, scene, Path(job.output), progress)
    except InputError as error:
        parent.send(error=str(error))
        return EXIT_BAD_INPUT
    except OSError as error:
        parent.send(error=f"{error.filename or job.output}: {error.strerror or error}; check the path")
        return EXIT_BAD_INPUT
    except (Cancelled, ParentGone):
        return EXIT_CANCELLED
    except Exception as error:  # noqa: BLE001
        parent.send(error=describe_unexpected_error(error, folder.parent))  # the folder itself is removed
        return EXIT_UNFORESEEN
    told, files = [note.facts() for note in (*blocked_scripts_note(), *rendered.notes)], [*map(str, rendered.files)]
    parent.send(result={"output": str(rendered.file), "written": files, "told": told})
    return 0


def _cancel(*_: Any) -> None:
    raise Cancelled


def _opened(job: RenderJob) -> Any:
    """Open the copy, and return its scene in the window. Raises InputError if linked data is lost."""

    def open_copy() -> None:
        with operator_errors("the copy of this file cannot be opened", "save it and try again"):
            bpy.ops.wm.open_mainfile(filepath=job.file, load_ui=False, use_scripts=job.use_scripts)

    open_copy()
    if name_bake_folders(job.bakes):  # Blender reads them only when the file is opened
        bpy.ops.wm.save_mainfile()
        open_copy()
    scene = bpy.data.scenes[job.scene]
    window = bpy.context.window_manager.windows[0]
    window.scene, window.view_layer = scene, scene.view_layers[job.view_layer]
    scene.mps.chosen_rig = job.rig
    refuse_lost_links(scene, job.missing)
    for name, file in job.painted.items():
        _paint(bpy.data.images[name], file)
    return scene


@contextmanager
def _reporting(parent: Parent) -> Iterator[RenderProgress]:
    """Report the progress of the renders twice a second; Cycles reports little of it without a window."""
    progress, ended = _Progress(parent), threading.Event()
    on_stats = progress.on_stats

    def report() -> None:
        while not ended.wait(REPORT_SECONDS):
            progress.report()

    clock = threading.Thread(target=report, daemon=True)
    clock.start()
    render_stats.append(on_stats)  # after the file is opened, which removes all handlers
    try:
        yield progress.begin
    finally:
        ended.set()
        clock.join()
        render_stats.remove(on_stats)


class _Progress:
    """The progress of renders: by their number, and within one by its expected time.

    That is Cycles' estimate after the first sample of the first render, and then the time of the previous one.
    """

    def __init__(self, parent: Parent) -> None:
        self._parent = parent
        self._done, self._renders, self._words = 0, 1, "preparing the scene"
        self._begun, self._takes = time.monotonic(), 0.0

    def begin(self, done: int, renders: int, words: str) -> None:
        now = time.monotonic()
        if done:
            self._takes = now - self._begun
        self._done, self._renders, self._words, self._begun = done, renders, words, now
        self.report()

    def on_stats(self, stats: str, *_: Any) -> None:
        """Called by Blender, from a thread of Cycles."""
        found = _REMAINING.search(stats)
        if found and (self._done == 0 or self._seconds() > self._takes):
            hours, minutes, seconds = (float(number or 0) for number in found.groups())
            self._takes = self._seconds() + 3600 * hours + 60 * minutes + seconds

    def report(self) -> None:
        within = min(self._seconds() / self._takes, _MAX_SHARE) if self._takes else 0.0
        self._parent.send(progress=(self._done + within) / self._renders, message=self._words)

    def _seconds(self) -> float:
        return time.monotonic() - self._begun
