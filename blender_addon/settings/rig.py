"""The rig's settings."""

import bpy
from bpy.props import CollectionProperty, PointerProperty

from .declared import EnumSetting, FloatSetting


class RigSettings:
    """Positions of the three lights and the camera around the object."""

    light_type: EnumSetting(
        name="Lights",
        description="What kind of lights the rig has",
        items=[
            ("SUN", "Sun", "Parallel light: as bright and from the same direction everywhere on the object"),
            ("AREA", "Area", "Discs at a distance: brighter and from a steeper direction where the object is nearer"),
        ],
        default="SUN",
    )
    slant: FloatSetting(
        name="Slant (°)",
        description="Angle in degrees between each light and the line from the object to the camera",
        default=30.0,
        min=1.0,
        max=89.0,
    )
    tilt: FloatSetting(
        name="Tilt (°)",
        description="Direction in degrees of the red light as the camera sees it: 0 is right, 90 is up. "
        "Green and blue follow at 120 and 240 degrees more",
        default=90.0,
        min=-360.0,
        max=360.0,
    )
    distance: FloatSetting(
        name="Distance",
        description="How far the lights and an orthographic camera stand from the object, in radii of the object",
        default=5.0,
        min=1.5,
        max=1000.0,
    )
    light_size: FloatSetting(
        name="Light Size (°)",
        description="How large each light looks from the object, in degrees. Larger lights give softer shadows",
        default=0.5,
        min=0.0,
        max=90.0,
    )
    strength: FloatSetting(
        name="Strength",
        description="Brightness of a white matte surface that faces the light, where 1 is full white",
        default=1.0,
        min=0.001,
        max=1000.0,
    )
    projection: EnumSetting(
        name="Projection",
        description="How the camera that comes with the rig projects",
        items=[
            ("ORTHOGRAPHIC", "Orthographic", "No perspective: every pixel looks in the same direction"),
            ("PERSPECTIVE", "Perspective", "As a lens sees it"),
        ],
        default="ORTHOGRAPHIC",
    )
    focal_length: FloatSetting(
        name="Lens (mm)",
        description="Focal length in millimetres of the perspective camera, on a sensor 36 mm wide",
        default=85.0,
        min=10.0,
        max=1000.0,
    )
    view: EnumSetting(
        name="View",
        description="The side of the object that the camera sees",
        items=[
            ("FRONT", "Front", "Along +Y, as Blender's front view"),
            ("BACK", "Back", "Along -Y"),
            ("LEFT", "Left", "Along +X, as Blender's left view"),
            ("RIGHT", "Right", "Along -X"),
            ("TOP", "Top", "From above"),
            ("BOTTOM", "Bottom", "From below"),
            ("VIEWPORT", "Viewport", "As the 3D viewport looks at it now"),
        ],
        default="FRONT",
    )
    margin: FloatSetting(
        name="Margin",
        description="Free space around the object in the picture, as a fraction of the object's size",
        default=0.1,
        min=0.0,
        max=5.0,
    )


class MPS_PG_light(bpy.types.PropertyGroup):
    """One of the rig's lights; a pointer, so that it survives renaming."""

    object: PointerProperty(name="Light", description="One of the rig's three lights", type=bpy.types.Object)


class MPS_PG_rig(RigSettings, bpy.types.PropertyGroup):
    """The rig: its settings and the objects it is made of."""

    lights: CollectionProperty(
        name="Lights", description="The rig's red, green and blue light, in this order", type=MPS_PG_light
    )
    camera: PointerProperty(
        name="Camera",
        description="Camera that takes the photo: the rig's own, or any other of this scene",
        type=bpy.types.Object,
        poll=lambda _, candidate: candidate.type == "CAMERA",
    )
    target: PointerProperty(
        name="Target",
        description="Empty that the lights turn to and that carries the rig: move it to move all of it",
        type=bpy.types.Object,
    )
    collection: PointerProperty(
        name="Collection", description="Collection of the rig's objects", type=bpy.types.Collection
    )
