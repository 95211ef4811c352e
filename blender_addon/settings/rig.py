"""The rig's settings."""

import bpy
from bpy.props import CollectionProperty, PointerProperty

from .declared import EnumSetting, FloatSetting, object_pointer


class RigSettings:
    """Positions of the three lights and the camera around the object."""

    light_type: EnumSetting(
        "Lights",
        "What kind of lights the rig has",
        items=[
            ("SUN", "Sun", "Parallel light: as bright and from the same direction everywhere on the object"),
            ("AREA", "Area", "Discs at a distance: brighter and from a steeper direction where the object is nearer"),
        ],
    )
    slant: FloatSetting(
        "Slant (°)",
        "Angle in degrees between each light and the line from the object to the camera",
        default=30.0,
        within=(1.0, 89.0),
    )
    tilt: FloatSetting(
        "Tilt (°)",
        "Direction in degrees of the red light as the camera sees it: 0 is right, 90 is up. "
        "Green and blue follow at 120 and 240 degrees more",
        default=90.0,
        within=(-360.0, 360.0),
    )
    distance: FloatSetting(
        "Distance",
        "How far the lights and an orthographic camera stand from the object, in radii of the object",
        default=5.0,
        within=(1.5, 1000.0),
    )
    light_size: FloatSetting(
        "Light Size (°)",
        "How large each light looks from the object, in degrees. Larger lights give softer shadows",
        default=0.5,
        within=(0.0, 90.0),
    )
    strength: FloatSetting(
        "Strength",
        "Brightness of a white matte surface that faces the light, where 1 is full white",
        default=1.0,
        within=(0.001, 1000.0),
    )
    projection: EnumSetting(
        "Projection",
        "How the camera that comes with the rig projects",
        items=[
            ("ORTHOGRAPHIC", "Orthographic", "No perspective: every pixel looks in the same direction"),
            ("PERSPECTIVE", "Perspective", "As a lens sees it"),
        ],
    )
    focal_length: FloatSetting(
        "Lens (mm)",
        "Focal length in millimetres of the perspective camera, on a sensor 36 mm wide",
        default=85.0,
        within=(10.0, 1000.0),
    )
    view: EnumSetting(
        "View",
        "The side of the object that the camera sees",
        items=[
            ("FRONT", "Front", "Along +Y, as Blender's front view"),
            ("BACK", "Back", "Along -Y"),
            ("LEFT", "Left", "Along +X, as Blender's left view"),
            ("RIGHT", "Right", "Along -X"),
            ("TOP", "Top", "From above"),
            ("BOTTOM", "Bottom", "From below"),
            ("VIEWPORT", "Viewport", "As the 3D viewport looks at it now"),
        ],
    )
    margin: FloatSetting(
        "Margin",
        "Free space around the object in the picture, as a fraction of the object's size",
        default=0.1,
        within=(0.0, 5.0),
    )


class MPS_PG_light(bpy.types.PropertyGroup):
    """One of the rig's lights; a pointer, so that it survives renaming."""

    object: object_pointer("Light", "One of the rig's three lights")


class MPS_PG_rig(RigSettings, bpy.types.PropertyGroup):
    """The rig: its settings and the objects it is made of."""

    lights: CollectionProperty(
        name="Lights", description="The rig's red, green and blue light, in this order", type=MPS_PG_light
    )
    camera: object_pointer(
        "Camera", "Camera that takes the photo: the rig's own, or any other of this scene", kind="CAMERA"
    )
    target: object_pointer(
        "Target", "Empty that the lights turn to and that carries the rig: move it to move all of it"
    )
    collection: PointerProperty(
        name="Collection", description="Collection of the rig's objects", type=bpy.types.Collection
    )
