"""The lights and the camera that apply to the photo, in a line each, and what is missing for an estimate."""

import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from mpsnet_core.errors import InputError, Note
from mpsnet_core.io.frames import is_folder_or_pattern
from mpsnet_core.scene.rig import LightRig, read_rig

from ..image_records import is_there, origin, remembered
from ..photo.camera import chosen_camera, is_real
from ..photo.options import rig_file_for
from ..rig.rig import last_evaluated_rig
from ..settings.record import result_of

_VIRTUAL = "The virtual rig in the scene counts as your photo's lights. Choose the rig file of the real ones"
# The setting that holds the file of a mask, where its kind has one.
NEEDED_FILE = {"FILE": "mask_file", "BACKGROUND": "background"}
NO_LIGHTS = "Where are the lights? Choose their rig file, or press Find Lights in the step Lights"


@dataclass(frozen=True)
class Lights:
    """The lights of a photo."""

    words: str
    """What they are."""
    rig: LightRig | None = None
    """Their current state, if it is valid."""
    lacks: str = ""
    """Why they cannot be used."""
    doubt: str = ""
    """Why they may not be the photo's."""
    error: float | None = None
    """Their expected error in degrees if they were found in the photo itself; infinite before the first estimate."""


def lights_of(scene: Any) -> Lights:
    """The lights that apply to the scene's photo, as :func:`.rig_path` chooses them."""
    photo, settings = scene.mps.photo.image, scene.mps.estimate
    if file := rig_file_for(photo, settings):
        path = Path(bpy.path.abspath(file))
        return _lights(f"{path.name}, calibrated", lambda: _rig_in(path, int(time.monotonic())))
    if photo is not None and remembered(photo, "rig") is not None:
        return Lights("the rig file beside the photo" if is_real(photo) else "as the photo was rendered")
    if scene.mps.rig.lights:
        return replace(virtual_rig(scene), doubt=_VIRTUAL if photo is None or is_real(photo) else "")
    return _found_in_photo(scene.mps)


def _found_in_photo(mps: Any) -> Lights:
    """The lights that the estimate found in the photo, or will find."""
    normals, photo = mps.estimate.image, mps.photo.image
    if photo is not None and normals is not None and normals.mps.photo == photo:
        with suppress(KeyError, TypeError, ValueError, InputError):  # a file may hold any facts
            found = result_of(mps, "estimate")["lights"]
            error = max(float(light["uncertainty"]) for light in found)
            rig = LightRig(np.array([light["direction"] for light in found]))
            return Lights(f"found in the photo, ± {error:.0f}°", rig, error=error)
    return Lights("found in the photo", error=math.inf)


def virtual_rig(scene: Any) -> Lights:
    """The lights of the scene's chosen rig."""
    return _lights("the virtual rig", lambda: last_evaluated_rig(scene))


def _lights(words: str, read: Callable[[], LightRig]) -> Lights:
    try:
        return Lights(words, read())
    except InputError as error:
        return Lights(words, lacks=str(error))


@lru_cache(maxsize=1)
def _rig_in(path: Path, second: int) -> LightRig:
    """The rig in a file, read at most once a second: panels are drawn often, and its folder may be on a network."""
    return read_rig(path)


def camera_of(scene: Any) -> str:
    """The camera that applies to the scene's photo, in words; "" if it is unknown, and a distant one is assumed."""
    photo, lens = scene.mps.photo.image, scene.mps.estimate.lens
    entered = Note("lens %g mm", lens) if lens else ""
    camera = chosen_camera(scene, photo) if photo is not None else None
    if camera is not None:
        known = photo.mps
        fit = Note("aligned, %.1f px", known.outline_pixels) if known.outline_pixels >= 0 else Note("aligned")
        where = fit if known.fit else camera.name
        return Note("%s, %s", where, entered) if entered else where
    if entered:
        return entered
    if photo is not None and remembered(photo, "camera") is not None:
        return Note("the camera file beside the photo") if is_real(photo) else Note("as the photo was rendered")
    return Note("the virtual rig's") if scene.mps.rig.lights else ""


def lacks_of_estimate(scene: Any) -> str:
    """What is missing to estimate the photo with the current settings; "" if nothing is."""
    photo, settings = scene.mps.photo.image, scene.mps.estimate
    lights = lights_of(scene)
    if lacking := lacks_file(photo, "photo") or lights.lacks:
        return lacking
    if lights.rig is not None and lights.rig.near is not None and not camera_of(scene):
        return "These lights stand near the object, so the camera counts: enter the photo's lens, or align the photo"
    return lacks_mask(settings) or _lacks_other_files(settings, moves=photo.source in {"SEQUENCE", "MOVIE"})


def lacks_file(image: Any, what: str) -> str:
    """A sentence if an image has no file to read it from; otherwise ""."""
    if image.packed_file or (image.filepath and is_there(origin(image))):
        return ""
    return f'The {what} "{image.name}" has no file on disk; save it, or choose another'


def lacks_mask(settings: Any) -> str:
    """The image that the mask setting needs and lacks, in words; "" if nothing is missing."""
    needed = NEEDED_FILE.get(settings.mask)
    return lacks_named(settings, needed, optional=False) if needed else ""


def _lacks_other_files(settings: Any, *, moves: bool) -> str:
    if settings.model == "FILE" and (lacking := lacks_named(settings, "model_file", optional=False)):
        return lacking
    if settings.albedo and not settings.white and not moves:
        return "The albedo is made from a white photo; choose one in Photo > Colour, or switch Albedo off"
    return next(filter(None, (lacks_named(settings, name, optional=True) for name in ("dark", "flat", "white"))), "")


def lacks_named(settings: Any, name: str, *, optional: bool) -> str:
    path, label = getattr(settings, name), settings.bl_rna.properties[name].name
    if not path:
        return "" if optional else f"Choose the {label.lower()}"
    found = bpy.path.abspath(path)
    if (optional and is_folder_or_pattern(found)) or is_there(Path(found)):
        return ""
    return f"{label} {path} does not exist; choose another"
