"""The core's options for a photo: its rig and camera, how it is read, and the model for its normals."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from mpsnet_core.defaults import BY_PHOTO, MASK
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.estimate.operations import Estimate
from mpsnet_core.scene.rig import read_rig, write_rig

from ..image_records import made_by, remembered
from ..images import paint_grey, pixels_of
from ..preferences import preference
from ..rig.rig import light_rig, rig_camera
from ..scene.objects import check_in_scene
from ..settings.declared import identifier, options_of, round_as_typed
from ..settings.estimate import MODELS
from .camera import is_real, write_photo_camera


def rig_file_for(photo: Any, settings: Any) -> str:
    """The rig file in the settings if it applies to this photo; otherwise "".

    It does not apply to a photo that was rendered here, which has its own rig.
    """
    rendered = photo is not None and made_by(photo) == "render_photo" and remembered(photo, "rig") is not None
    return "" if rendered else settings.rig_file


def rig_and_camera_options(
    context: Any, image: Any, folder: Path, write_mesh: Callable[..., Any], rig_file: str | None = None
) -> dict[str, Any]:
    """The core's options for the photo's rig and camera and, for near lights, its distance to the object.

    write_mesh: that of the operator, see :class:`.RunsCore`. rig_file: the rig's file, "" for none, None for that of
    the settings if it applies to this photo.
    """
    scene, settings = context.scene, context.scene.mps.estimate
    if rig_file is None:
        rig_file = rig_file_for(image, settings)
    rig = rig_path(scene, image, folder, rig_file)
    options = {"rig": rig, **seen_through(scene, image, settings.lens, folder)}
    if rig is None or read_rig(rig).near is None:
        return options
    if len(options) == 1:
        raise GeometryError(
            "the rig's lights stand near the object, so the photo's camera counts; enter its lens, or add a rig, "
            "whose camera is used"
        )
    if settings.distance:
        options["distance"] = round_as_typed(settings.distance)
    elif settings.surface is not None and not settings.lens:
        check_in_scene(scene, settings.surface, "surface")
        write_mesh(context, folder / "surface.npz", settings.surface)
        options["mesh"] = str(folder / "surface.npz")
    return options


def rig_path(scene: Any, image: Any, folder: Path, rig_file: str) -> str | None:
    """The file of a photo's rig: `rig_file`, else the one stored with the photo, else the scene's rig.

    None for a real photo whose rig is unknown: the core finds its lights in the photo.
    """
    if rig_file:
        return bpy.path.abspath(rig_file)
    if finds_lights(scene, image, rig_file):
        return None
    rig, taken_with = folder / "rig.json", remembered(image, "rig")
    if taken_with is None:
        write_rig(rig, light_rig(scene))
    else:
        rig.write_text(taken_with, encoding="utf-8")
    return str(rig)


def finds_lights(scene: Any, image: Any, rig_file: str) -> bool:
    """Whether a photo's lights are unknown, and so are found in it. rig_file: see :func:`rig_path`."""
    return not rig_file and remembered(image, "rig") is None and is_real(image) and not scene.mps.rig.lights


def seen_through(scene: Any, image: Any, lens: float, folder: Path) -> dict[str, Any]:
    """The core's option for a photo's camera: its lens if known, else the photo's camera, else the rig's, else nothing.

    lens: focal length in mm on a sensor 36 mm wide, 0 for none.
    """
    if lens:
        return {"focal": round_as_typed(lens)}
    camera = folder / "camera.json"
    if not write_photo_camera(camera, scene, image):
        if not scene.mps.rig.lights:
            return {}
        write_photo_camera(camera, scene, image, rig_camera(scene))
    return {"camera": str(camera)}


def network(settings: Any) -> dict[str, Any]:
    """The core's options for the model from the settings, and for the device of networks from the preferences.

    Raises SettingsError if the model is from a file but no file is set.
    """
    if settings.model == "FILE":
        if not settings.model_file:
            raise SettingsError("the model is a file but none is named; choose an .onnx file")
        model = bpy.path.abspath(settings.model_file)
    else:
        model = BY_PHOTO if settings.model == identifier(BY_PHOTO) else MODELS[settings.model].name
    return {"model": model, "provider": preference("provider").lower(), "threads": preference("threads")}


def reading(settings: Any, unmasked: str = MASK, painted: str = "") -> dict[str, Any]:
    """The core's options for how a photo is read: encoding, dark frame, flat field and mask.

    unmasked: the default for the mask. painted: the file from :func:`painted_mask`, "" if there is none.

    Raises SettingsError if a mask from a file is chosen but no file is set, or a painted one but none is painted.
    """
    if settings.mask == "PAINTED" and not painted:
        raise SettingsError("no mask is painted for this; press Paint Mask in the step Photo, or choose another mask")
    return {**reading_without_mask(settings), "mask": painted or _mask(settings) or unmasked}


def painted_mask(estimate: Any, folder: Path) -> str:
    """Write the painted mask into `folder`. Returns its file, "" if none is chosen or painted.

    The painted image is packed, and so saved with the .blend file.
    """
    image = estimate.painted_mask
    if estimate.mask != "PAINTED" or image is None or not all(image.size):
        return ""
    if image.is_dirty:
        image.pack()
    pixels = pixels_of(image)
    bright = pixels[..., : 1 if image.channels < 3 else 3].max(axis=-1) > 0.5
    if image.channels in (2, 4):
        bright &= pixels[..., -1] > 0.5
    mask = bpy.data.images.new("MPS Mask", *image.size, alpha=False, is_data=True)
    try:
        paint_grey(mask, bright)
        mask.filepath_raw, mask.file_format = str(folder / "painted_mask.png"), "PNG"
        mask.save()
    finally:
        bpy.data.images.remove(mask)
    return str(folder / "painted_mask.png")


def reading_without_mask(settings: Any) -> dict[str, Any]:
    """The options of :func:`reading` without the mask."""
    return options_of(Estimate, settings, only=("encoding", "dark", "flat"))


def _mask(settings: Any) -> str:
    if settings.mask == "FILE":
        if not settings.mask_file:
            raise SettingsError("the mask is a file but none is named; choose a picture")
        return bpy.path.abspath(settings.mask_file)
    if settings.mask == "BACKGROUND":
        if not settings.background:
            raise SettingsError("the mask comes from a background photo but none is named; choose one")
        return f"background:{bpy.path.abspath(settings.background)}"
    if settings.mask == "THRESHOLD":
        return f"threshold:{settings.threshold:g}"
    return {"AUTO": "", "FIND": "auto"}.get(settings.mask, settings.mask.lower())
