"""Redirection of simulation caches in another Blender process to a temporary folder, never to the file's own.

Blender simulates when it opens a file and when the frame changes. It writes the results to the folders that the file
names, and deletes outdated data there: whole folders of fluids.
"""

import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
from bpy.app.handlers import load_post, persistent

# The content of a fluid's cache folder: a folder for each kind of data, with a file for each frame.
_FLUID_FOLDERS = ("config", "data", "guiding", "mesh", "noise", "particles")
_FLUID_FRAME = re.compile(r"\w+_(\d{4,})\.(uni|vdb|raw|obj|bobj\.gz)")


@contextmanager
def simulations_write_into(folder: Path, *, animated: bool = False) -> Iterator[None]:
    """Simulations of files that are opened in the with block write to `folder` alone, also after the block.

    Cached fluid data of the current frame, or of all frames if `animated`, is copied there first.
    """

    @persistent
    def redirect(*_: Any) -> None:  # before Blender evaluates the opened file
        frames = _frames(animated)
        for number, (obj, domain) in enumerate(_fluid_domains()):
            place = folder / f"fluid_{number}"
            if not place.exists():
                _copy_frames(Path(bpy.path.abspath(domain.cache_directory, library=obj.library)), place, frames)
            domain.cache_directory = str(place)
        for number, (owner, cache) in enumerate(_point_caches()):
            if cache.is_baked and not (cache.is_outdated or cache.is_frame_skip):
                continue  # it is only read
            if cache.use_external:
                cache.filepath, cache.name = str(folder / f"points_{number}"), "points"
            elif owner.library:
                cache.use_library_path = False

    load_post.append(redirect)
    try:
        yield
    finally:
        load_post.remove(redirect)


def _frames(animated: bool) -> set[int]:
    """The frames that are rendered, and those before them, from which a simulation continues."""
    frames = {scene.frame_current for scene in bpy.data.scenes}
    if animated:
        frames.update(*(range(scene.frame_start, scene.frame_end + 1) for scene in bpy.data.scenes))
    return frames | {frame - 1 for frame in frames}


def _copy_frames(source: Path, place: Path, frames: set[int]) -> None:
    for name in _FLUID_FOLDERS:
        (place / name).mkdir(parents=True)
        for file in source.joinpath(name).iterdir() if source.joinpath(name).is_dir() else ():
            found = _FLUID_FRAME.fullmatch(file.name)
            if found and int(found[1]) in frames and file.is_file():
                shutil.copyfile(file, place / name / file.name)


def _fluid_domains() -> Iterator[tuple[Any, Any]]:
    for obj in bpy.data.objects:
        for modifier in obj.modifiers:
            if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN" and modifier.domain_settings:
                yield obj, modifier.domain_settings


def _point_caches() -> Iterator[tuple[Any, Any]]:
    """Caches of cloth, soft bodies, particles, dynamic paint and rigid bodies, each with its object or scene."""
    for scene in bpy.data.scenes:
        if scene.rigidbody_world and scene.rigidbody_world.point_cache:
            yield scene, scene.rigidbody_world.point_cache
    for obj in bpy.data.objects:
        yield from ((obj, system.point_cache) for system in obj.particle_systems)
        for modifier in obj.modifiers:
            if modifier.type in {"CLOTH", "SOFT_BODY"}:
                yield obj, modifier.point_cache
            elif modifier.type == "DYNAMIC_PAINT" and modifier.canvas_settings:
                yield from ((obj, surface.point_cache) for surface in modifier.canvas_settings.canvas_surfaces)
