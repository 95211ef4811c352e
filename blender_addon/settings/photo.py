"""The photo's settings, and what goes with a photo when another one is chosen."""

import json
from contextlib import suppress
from typing import Any

import bpy
from bpy.props import StringProperty

from ..image_records import from_json, origin, remember, remembered
from .declared import BoolSetting, FileSetting, IntSetting, image_pointer


class PhotoSettings:
    """How the one photo is rendered."""

    width: IntSetting("Width", "Width of the photo in pixels", default=1024, within=(8, 16384))
    height: IntSetting("Height", "Height of the photo in pixels", default=1024, within=(8, 16384))
    samples: IntSetting(
        "Samples",
        "Cycles samples a pixel for each of the three lights: more take longer and give less noise",
        default=32,
        within=(1, 65536),
    )
    white: BoolSetting(
        "White Photo",
        "Render a second photo, with the three lights turned white. The estimate uses it, and makes the surface's "
        "colour of it as well",
    )
    animation: BoolSetting(
        "Animation",
        "Take a photo of each frame of the scene, from its first to its last, into a folder. "
        "Lights and camera should move together if they move: those of the first frame count for all",
    )
    output: FileSetting(
        "Photo File", "OpenEXR file to write, or an animation's folder. Empty: a name of its own in the output folder"
    )


# Settings of the estimate that are of one photo.
OF_ONE_PHOTO = ("white", "white_light", "mask", "mask_file", "background", "distance", "albedo")
# Those that photos of one session, in one folder, share.
OF_ONE_SESSION = ("dark", "flat", "lens", "encoding")
_MASKS_OF_ONE_PHOTO = ("FILE", "BACKGROUND", "PAINTED")
_BELONGINGS = "belongings"


def _photo_chosen(photo: Any, context: Any) -> None:
    """Keep with the photo before what belongs to it, and take what belongs to the one that is chosen now."""
    before, now = photo.settings_of, photo.image
    if now is None or now == before:
        return
    photo.settings_of = now
    owner = photo.id_data.path_resolve(photo.path_from_id().rpartition(".")[0])
    estimate = owner.estimate
    if before is None:  # the first photo: what was entered before is for it
        return
    names = (*OF_ONE_PHOTO, *OF_ONE_SESSION)
    if before.library is None:
        kept = {name: getattr(estimate, name) for name in names if estimate.is_property_set(name)}
        remember(before, _BELONGINGS, json.dumps({**kept, "truth": photo.truth}))
        before.mps.painted_mask = estimate.painted_mask
    stored = remembered(now, _BELONGINGS)
    known = from_json(stored, dict)
    together = stored is None and origin(before).parent == origin(now).parent
    for name in OF_ONE_PHOTO if together else names:
        if name != "mask" or name in known or estimate.mask in _MASKS_OF_ONE_PHOTO:
            estimate.property_unset(name)
        with suppress(TypeError, ValueError):  # a hostile file may hold anything
            if name in known:
                setattr(estimate, name, known[name])
    truth = known.get("truth")
    photo.truth = truth if isinstance(truth, str) else ""
    estimate.painted_mask = now.mps.painted_mask
    if (checked := owner.records.find("check_photo")) >= 0:
        owner.records.remove(checked)
    for record in owner.records:  # what they say is of the photo before
        record.notes = ""


class MPS_PG_photo(PhotoSettings, bpy.types.PropertyGroup):
    """The one photo: how it is rendered, and the image once it is there."""

    image: image_pointer("Photo", "The photo under red, green and blue light", update=_photo_chosen)
    truth: StringProperty(name="True Normals", description="File of the true normals of the photo's view. Empty: none")
    settings_of: image_pointer("Settings Of", "The photo that the white photo, mask and lens in the panel belong to")
