"""Settings of a photo's alignment, and the data stored with the photo: its camera and the pairs of points."""

from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, FloatVectorProperty, StringProperty

from .declared import EnumSetting, image_pointer, object_pointer


class AlignSettings:
    """Where the search for a real photo's camera starts."""

    start: EnumSetting(
        "Start",
        "From where the photo's camera is looked for. Pairs of points go before it",
        items=[
            ("SEARCH", "All Views", "Views all around the mesh are tried; the best one counts"),
            ("VIEWPORT", "Viewport", "The 3D viewport shows the mesh about as the photo does"),
            ("CAMERA", "Camera", "The photo's camera, else the scene's, stands about where the photo was taken"),
        ],
    )


class MPS_PG_align(AlignSettings, bpy.types.PropertyGroup):
    """The alignment: its settings, and the picture that shows how well mesh and photo fit."""

    image: image_pointer("Overlay", "The photo with the outlines of mask and mesh")
    lens_of: object_pointer(
        "Lens Of",
        "Camera whose focal length and shift the photo's camera gets, as of a calibrated lens or a cropped "
        "photo. Where it stands does not count. Empty: Lens (mm), and the photo's middle",
        kind="CAMERA",
    )


class MPS_PG_pair(bpy.types.PropertyGroup):
    """A place in the photo and the same place on the mesh."""

    pixel: FloatVectorProperty(
        name="Pixel", description="Place in the photo in pixels from its top left corner", size=2
    )
    point: FloatVectorProperty(
        name="Point", description="The same place on the mesh, in units of the world", size=3, subtype="XYZ"
    )
    residual: FloatProperty(
        name="Residual",
        description="How far the aligned mesh's point is from the place in the photo, in pixels. -1: not aligned yet",
        default=-1.0,
    )


def _camera_chosen(photo: Any, context: Any) -> None:
    photo.poor, photo.fit, photo.outline_pixels = False, "", -1.0


class MPS_PG_image(bpy.types.PropertyGroup):
    """What belongs to an image that is a photo, normals of one, or a baked texture: ``image.mps``."""

    camera: object_pointer(
        "Taken By",
        "Camera of this scene that took the photo: the one that Align Photo made, or one that you choose",
        kind="CAMERA",
        update=_camera_chosen,
    )
    pairs: CollectionProperty(
        name="Pairs", description="Places in the photo and on the mesh that are the same", type=MPS_PG_pair
    )
    shown: BoolProperty(
        name="Shown", description="Whether the panel shows the picture, not its name alone", default=True
    )
    fit: StringProperty(name="Fit", description="How well the mesh fits the photo, in words. Empty: not aligned")
    outline_pixels: FloatProperty(
        name="Outline",
        description="How far the outlines of mesh and photo are apart, in pixels. -1: not known",
        default=-1.0,
    )
    poor: BoolProperty(name="Poor", description="Whether the mesh fits the photo too poorly to bake with")
    photo: image_pointer("Photo", "The photo that these normals were estimated from")
    painted_mask: image_pointer("Painted Mask", "The mask that was painted for this photo, while another is chosen")
    coverage: image_pointer("Coverage", "Which of this texture's texels some view saw")
