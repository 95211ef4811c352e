"""Settings of the four steps and of training data: defined once, kept in the scene, taken by the operators."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from mpsnet_core.estimate.shelf import DEFAULT_MODEL, shelf
from mpsnet_core.synthesis.job import MAX_COUNT

# Without it Blender fills an operator's unset properties with those of its last run instead of the scene's settings.
GIVEN = {"SKIP_SAVE"}
# Blender paints a path beside the .blend file ("//photo.png") red, as if it were not understood, without the second.
PATH = {*GIVEN, "PATH_SUPPORTS_BLEND_RELATIVE"}

FILE_FORMATS = (
    ("PNG", "PNG", "16-bit PNG"),
    ("TIFF", "TIFF", "16-bit TIFF"),
    ("EXR", "OpenEXR", "32-bit float OpenEXR"),
)

ENCODINGS = (
    ("AUTO", "Automatic", "Linear for float files and camera raw, sRGB for all others, unless the file says otherwise"),
    ("LINEAR", "Linear", "Twice the value is twice the light"),
    ("SRGB", "sRGB", "As for a screen"),
)


def _identifier(model: str) -> str:
    """A model's name as Blender writes enums: upper case, words joined by underscores."""
    return model.upper().replace("-", "_")


MODELS = {_identifier(entry.name): entry for entry in shelf()}


class RigSettings:
    """Where the three lights and the camera stand around the object."""

    light_type: EnumProperty(
        name="Lights",
        description="What kind of lights the rig has",
        items=[
            ("SUN", "Sun", "Parallel light: as bright and from the same direction everywhere on the object"),
            ("AREA", "Area", "Discs at a distance: brighter and from a steeper direction where the object is nearer"),
        ],
        default="SUN",
        options=GIVEN,
    )
    slant: FloatProperty(
        name="Slant (°)",
        description="Angle in degrees between each light and the line from the object to the camera",
        default=30.0,
        min=1.0,
        max=89.0,
        options=GIVEN,
    )
    tilt: FloatProperty(
        name="Tilt (°)",
        description="Direction in degrees of the red light as the camera sees it: 0 is right, 90 is up. "
        "Green and blue follow at 120 and 240 degrees more",
        default=90.0,
        min=-360.0,
        max=360.0,
        options=GIVEN,
    )
    distance: FloatProperty(
        name="Distance",
        description="How far the lights and an orthographic camera stand from the object, in radii of the object",
        default=5.0,
        min=1.5,
        max=1000.0,
        options=GIVEN,
    )
    light_size: FloatProperty(
        name="Light Size (°)",
        description="How large each light looks from the object, in degrees. Larger lights give softer shadows",
        default=0.5,
        min=0.0,
        max=90.0,
        options=GIVEN,
    )
    strength: FloatProperty(
        name="Strength",
        description="Brightness of a white matte surface that faces the light, where 1 is full white",
        default=1.0,
        min=0.001,
        max=1000.0,
        options=GIVEN,
    )
    projection: EnumProperty(
        name="Camera",
        description="How the camera projects",
        items=[
            ("ORTHOGRAPHIC", "Orthographic", "No perspective: every pixel looks in the same direction"),
            ("PERSPECTIVE", "Perspective", "As a lens sees it"),
        ],
        default="ORTHOGRAPHIC",
        options=GIVEN,
    )
    focal_length: FloatProperty(
        name="Lens (mm)",
        description="Focal length in millimetres of the perspective camera, on a sensor 36 mm wide",
        default=85.0,
        min=10.0,
        max=1000.0,
        options=GIVEN,
    )
    view: EnumProperty(
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
        options=GIVEN,
    )
    margin: FloatProperty(
        name="Margin",
        description="Free space around the object in the picture, as a fraction of the object's size",
        default=0.1,
        min=0.0,
        max=5.0,
        options=GIVEN,
    )


class CalibrateSettings:
    """Photos of balls that tell where real lights are and how their colours mix."""

    ball: StringProperty(
        name="Mirror Ball",
        description="Photo of a mirror ball where the object stands, under the red, green and blue light at once",
        subtype="FILE_PATH",
        options=PATH,
    )
    second_ball: StringProperty(
        name="Second Place",
        description="Photo of the same ball at another place. With two places the lights' positions are found, "
        "not only their directions. Needs the lens",
        subtype="FILE_PATH",
        options=PATH,
    )
    ball_radius: FloatProperty(
        name="Ball Radius",
        description="Radius of the ball, in the unit that positions are wanted in: that of the mesh. "
        "It counts where lights have positions, for the grey ball too",
        default=1.0,
        min=1e-6,
        max=1e6,
        options=GIVEN,
    )
    grey: StringProperty(
        name="Grey Ball",
        description="Photo of a matt grey ball under the red, green and blue light at once",
        subtype="FILE_PATH",
        options=PATH,
    )
    lens: FloatProperty(
        name="Lens (mm)",
        description="Focal length in millimetres on a sensor 36 mm wide. 0: the camera is taken as far away",
        default=0.0,
        min=0.0,
        max=10000.0,
        options=GIVEN,
    )
    circle_x: FloatProperty(
        name="Ball X (px)",
        description="Middle of the ball, in pixels from the photo's left edge. Only counts with a radius below",
        default=0.0,
        options=GIVEN,
    )
    circle_y: FloatProperty(
        name="Y (px)", description="Middle of the ball, in pixels from the photo's top edge", default=0.0, options=GIVEN
    )
    circle_radius: FloatProperty(
        name="Radius (px)",
        description="Radius of the ball's outline in pixels. 0: the ball is looked for",
        default=0.0,
        min=0.0,
        options=GIVEN,
    )
    second_x: FloatProperty(
        name="Second X (px)",
        description="Middle of the ball at its second place, in pixels from the photo's left edge",
        default=0.0,
        options=GIVEN,
    )
    second_y: FloatProperty(
        name="Y (px)",
        description="Middle of the ball at its second place, in pixels from the photo's top edge",
        default=0.0,
        options=GIVEN,
    )
    second_radius: FloatProperty(
        name="Radius (px)",
        description="Radius of the ball's outline at its second place, in pixels. Needed where the first one is given",
        default=0.0,
        min=0.0,
        options=GIVEN,
    )
    encoding: EnumProperty(
        name="Encoding",
        description="How the photos' values stand for light",
        items=ENCODINGS,
        default="AUTO",
        options=GIVEN,
    )
    output: StringProperty(
        name="Rig File",
        description="Rig file to write (.json). Empty: mpsnet_rig.json in the output folder",
        subtype="FILE_PATH",
        options=PATH,
    )


class PhotoSettings:
    """How the one photo is rendered."""

    width: IntProperty(
        name="Width", description="Width of the photo in pixels", default=1024, min=8, max=16384, options=GIVEN
    )
    height: IntProperty(
        name="Height", description="Height of the photo in pixels", default=1024, min=8, max=16384, options=GIVEN
    )
    samples: IntProperty(
        name="Samples",
        description="Cycles samples a pixel for each of the three lights: more take longer and give less noise",
        default=32,
        min=1,
        max=65536,
        options=GIVEN,
    )
    output: StringProperty(
        name="Photo File",
        description="OpenEXR file to write. Empty: a name of its own in the output folder",
        subtype="FILE_PATH",
        options=PATH,
    )


class EstimateSettings:
    """How the photo is read and which model turns it into normals."""

    mask: EnumProperty(
        name="Mask",
        description="Which pixels of the photo are the object",
        items=[
            ("AUTO", "Alpha or All", "The photo's alpha if it has one, else the whole photo"),
            ("FIND", "Find", "An object before a dark or plain background is found"),
            ("BACKGROUND", "Background Photo", "Where the photo differs from one of the scene without the object"),
            ("ALPHA", "Alpha", "Where the photo is opaque"),
            ("FILE", "File", "Where a mask picture is white"),
            ("THRESHOLD", "Threshold", "Where the photo is brighter than a threshold"),
            ("NONE", "None", "The whole photo"),
        ],
        default="AUTO",
        options=GIVEN,
    )
    mask_file: StringProperty(
        name="Mask File",
        description="Picture that is white where the object is and black elsewhere",
        subtype="FILE_PATH",
        options=PATH,
    )
    background: StringProperty(
        name="Background",
        description="Photo of the scene without the object, under the same lights",
        subtype="FILE_PATH",
        options=PATH,
    )
    threshold: FloatProperty(
        name="Threshold",
        description="Pixels brighter than this fraction of the photo's brightest are the object",
        default=0.05,
        min=0.0,
        max=0.99,
        options=GIVEN,
    )
    encoding: EnumProperty(
        name="Encoding",
        description="How the photo's values stand for light",
        items=ENCODINGS,
        default="AUTO",
        options=GIVEN,
    )
    dark: StringProperty(
        name="Dark Frame",
        description="Photo with the three lights off, taken off the photo. A folder or pattern of several is averaged",
        subtype="FILE_PATH",
        options=PATH,
    )
    flat: StringProperty(
        name="Flat Field",
        description="Photo of an even white card in the object's place, which evens out lens and lights. "
        "A folder or pattern of several is averaged. Not together with near lights",
        subtype="FILE_PATH",
        options=PATH,
    )
    rig_file: StringProperty(
        name="Rig File",
        description="Measured rig (.json or .lp) of a photo taken with a real camera. "
        "Empty: the one beside the photo when it was rendered or opened, else the rig in this scene",
        subtype="FILE_PATH",
        options=PATH,
    )
    lens: FloatProperty(
        name="Lens (mm)",
        description="Focal length of the real camera in millimetres on a sensor 36 mm wide. "
        "0: the camera that the photo was rendered with, else the rig's",
        default=0.0,
        min=0.0,
        max=10000.0,
        options=GIVEN,
    )
    distance: FloatProperty(
        name="Distance",
        description="How far the object is from the camera, in the unit of a rig file with near lights. "
        "0: as far as the rig's target, or as the surface tells",
        default=0.0,
        min=0.0,
        max=1e6,
        options=GIVEN,
    )
    model: EnumProperty(
        name="Model",
        description="What turns the photo into normals",
        items=[
            *((identifier, entry.label, entry.title) for identifier, entry in MODELS.items()),
            ("FILE", "File", "A network in an .onnx file"),
        ],
        default=_identifier(DEFAULT_MODEL),
        options=GIVEN,
    )
    model_file: StringProperty(
        name="Model File", description="Network in an .onnx file", subtype="FILE_PATH", options=PATH
    )
    confidence: BoolProperty(
        name="Confidence Map",
        description="Also write how far each normal can be trusted, beside the normal map",
        default=False,
        options=GIVEN,
    )
    smooth: IntProperty(
        name="Smooth Frames",
        description="Frames of a sequence or video before and behind, with which each is averaged where they show "
        "the same",
        default=0,
        min=0,
        max=12,
        options=GIVEN,
    )
    file_format: EnumProperty(
        name="Format", description="File format of the normal map", items=FILE_FORMATS, default="PNG", options=GIVEN
    )
    output: StringProperty(
        name="Normal Map File",
        description="File to write; its ending decides the format. Empty: a name of its own in the output folder",
        subtype="FILE_PATH",
        options=PATH,
    )


class BakeSettings:
    """The texture and how it is baked."""

    uv_map: StringProperty(
        name="UV Map",
        description="UV map of the target to bake onto. Empty: the one that is active for rendering",
        options=GIVEN,
    )
    size: IntProperty(
        name="Size",
        description="Width and height of the texture in pixels",
        default=2048,
        min=16,
        max=16384,
        options=GIVEN,
    )
    space: EnumProperty(
        name="Space",
        description="What the texture's normals are relative to",
        items=[
            ("TANGENT", "Tangent", "To the surface: the object may move, bend and be reused. The usual choice"),
            ("OBJECT", "Object", "To the object: for objects that do not bend"),
        ],
        default="TANGENT",
        options=GIVEN,
    )
    convention: EnumProperty(
        name="Convention",
        description="Which way the texture's green channel points",
        items=[
            ("OPENGL", "OpenGL", "Green is up: Blender, glTF, Unity"),
            ("DIRECTX", "DirectX", "Green is down: Unreal Engine. In Blender the material turns it round"),
        ],
        default="OPENGL",
        options=GIVEN,
    )
    animated: BoolProperty(
        name="Follow the Animation",
        description="For a sequence of normals: take the target and the camera anew in each frame of the timeline, "
        "whose number is that of the normals. Off: as they stand now",
        default=False,
        options=GIVEN,
    )
    margin: IntProperty(
        name="Margin",
        description="Pixels by which the texture is continued beyond the borders of the UV islands",
        default=16,
        min=0,
        max=1024,
        options=GIVEN,
    )
    file_format: EnumProperty(
        name="Format", description="File format of the texture", items=FILE_FORMATS, default="PNG", options=GIVEN
    )
    output: StringProperty(
        name="Texture File",
        description="File to write; its ending decides the format. Empty: a name of its own in the output folder",
        subtype="FILE_PATH",
        options=PATH,
    )


class ViewsSettings:
    """Photos from all around with their cameras, and how they become one texture."""

    cameras: StringProperty(
        name="Cameras",
        description="What a photogrammetry program wrote: a COLMAP folder, Metashape's .xml, Meshroom's .sfm. "
        "Empty: this scene's cameras, each with its photo as background image",
        subtype="FILE_PATH",
        options=PATH,
    )
    photos: StringProperty(
        name="Photos", description="Folder of the photos of these cameras", subtype="DIR_PATH", options=PATH
    )
    axes: EnumProperty(
        name="Mesh Import",
        description="How the photogrammetry program's mesh came into Blender, so that mesh and cameras meet",
        items=[
            ("Y_UP", "Y Up", "Turned from Y up to Z up, as Blender's importers of OBJ and glTF do unless told"),
            ("AS_IS", "As It Is", "With forward Y and up Z, as Blender's importer of PLY does"),
        ],
        default="Y_UP",
        options=GIVEN,
    )
    lights_in: EnumProperty(
        name="Lights",
        description="What the lights went with while the photos were taken",
        items=[
            ("CAMERA", "Go With the Camera", "The lights are fixed to the camera, or the object stood on a turntable"),
            ("WORLD", "Stand Still", "The camera went round; a rig file has directions along the mesh's axes"),
        ],
        default="CAMERA",
        options=GIVEN,
    )
    level: BoolProperty(
        name="Level",
        description="Take large shapes from the mesh and detail from the photos: seams between views vanish",
        default=True,
        options=GIVEN,
    )
    level_scale: FloatProperty(
        name="Detail Size",
        description="What is smaller than this fraction of the object's size is detail, and taken from the photos",
        default=0.03,
        min=0.01,
        max=0.5,
        precision=3,
        options=GIVEN,
    )
    keep: StringProperty(
        name="Keep Normals",
        description="Folder for each view's normals; the next run goes on from them. Empty: they are not kept",
        subtype="DIR_PATH",
        options=PATH,
    )
    write_report: BoolProperty(
        name="Report",
        description="Write a page beside the texture that shows which views cover what and how far they disagree",
        default=True,
        options=GIVEN,
    )


class SamplesSettings:
    """What training data is rendered, how, and where to."""

    source: EnumProperty(
        name="Shapes",
        description="What the samples show",
        items=[
            ("GENERATED", "Generated", "Shapes made up from the seed: nothing else is needed"),
            (
                "MESHES",
                "Mesh Files",
                "The meshes in a folder, alone and several together: OBJ, PLY, STL, OFF or glTF files",
            ),
            ("SCENE", "Selected Objects", "The mesh objects that are selected in this scene"),
        ],
        default="GENERATED",
        options=GIVEN,
    )
    kinds: EnumProperty(
        name="Kinds",
        description="Kinds of generated shapes, of which each sample shows one",
        items=[
            ("BLOBS", "Blobs", "Closed lumps: smooth, folded, ridged, wrinkled or faceted"),
            ("DRAPERY", "Drapery", "Hanging and falling cloth"),
            ("RELIEFS", "Reliefs", "Slabs with a relief"),
            ("COMPOSITES", "Composites", "Objects of many parts that throw shadows on each other"),
            ("GROUPS", "Groups", "Several objects beside each other on a ground"),
        ],
        default={"BLOBS", "DRAPERY", "RELIEFS", "COMPOSITES", "GROUPS"},
        options={"ENUM_FLAG", *GIVEN},
    )
    meshes: StringProperty(
        name="Mesh Folder", description="Folder with the mesh files to render", subtype="DIR_PATH", options=PATH
    )
    count: IntProperty(
        name="Count",
        description="How many samples the folder shall hold in the end. A larger count goes on where a smaller stopped",
        default=100,
        min=1,
        max=MAX_COUNT,
        options=GIVEN,
    )
    seed: IntProperty(
        name="Seed",
        description="What the samples are drawn from: the same seed gives the same samples",
        default=0,
        min=0,
        options=GIVEN,
    )
    size: IntProperty(
        name="Size",
        description="Width and height of a sample in pixels",
        default=256,
        min=16,
        max=4096,
        options=GIVEN,
    )
    samples: IntProperty(
        name="Cycles Samples",
        description="Cycles samples a pixel, shared by the three lights: more take longer and give less noise",
        default=48,
        min=1,
        max=65536,
        options=GIVEN,
    )
    denoise: BoolProperty(
        name="Denoise",
        description="Take the noise from each light's picture with OpenImageDenoise, where light goes between surfaces",
        default=True,
        options=GIVEN,
    )
    bounces: IntProperty(
        name="Bounces",
        description="How often light goes from surface to surface. 0: direct light only",
        default=3,
        min=0,
        max=32,
        options=GIVEN,
    )
    views: IntProperty(
        name="Views",
        description="How many samples in a row show the same shape, each in another pose, light and material",
        default=1,
        min=1,
        max=1000,
        options=GIVEN,
    )
    output: StringProperty(
        name="Folder",
        description="Folder of the samples. One that holds some already is gone on with. "
        "Empty: a folder of its own in the output folder",
        subtype="DIR_PATH",
        options=PATH,
    )
    processes: IntProperty(
        name="Processes",
        description="How many Blenders render at the same time on this machine. 0: one for each processor core",
        default=0,
        min=0,
        max=1024,
        options=GIVEN,
    )
    cluster: StringProperty(
        name="Cluster",
        description="Address of a Dask scheduler whose machines render, such as tcp://host:8786. Empty: this machine",
        options=GIVEN,
    )


class MPS_PG_light(bpy.types.PropertyGroup):
    """One of the rig's lights; a pointer, so that it survives renaming."""

    object: PointerProperty(type=bpy.types.Object)


class MPS_PG_rig(RigSettings, bpy.types.PropertyGroup):
    """The rig: its settings and the objects it is made of."""

    lights: CollectionProperty(type=MPS_PG_light)
    camera: PointerProperty(type=bpy.types.Object)
    target: PointerProperty(type=bpy.types.Object)
    collection: PointerProperty(type=bpy.types.Collection)


class MPS_PG_calibrate(CalibrateSettings, bpy.types.PropertyGroup):
    """Calibration: its photos, and what was found."""

    image: PointerProperty(name="Found", description="What was found, drawn over the photo", type=bpy.types.Image)
    told: StringProperty()  # a table: lines of cells with | between them
    notes: StringProperty()  # one a line


class MPS_PG_photo(PhotoSettings, bpy.types.PropertyGroup):
    """The one photo: how it is rendered, and the image once it is there."""

    image: PointerProperty(name="Photo", description="The photo under red, green and blue light", type=bpy.types.Image)


class MPS_PG_estimate(EstimateSettings, bpy.types.PropertyGroup):
    """The estimate: its settings, and the normal map once it is there."""

    first_frame: IntProperty(description="Number of the first frame of normals, where they are a sequence")
    last_frame: IntProperty(description="Number of the last frame of normals, where they are a sequence")
    mask_image: PointerProperty(name="Mask", description="The mask, drawn over the photo", type=bpy.types.Image)
    surface: PointerProperty(
        name="Surface",
        description="Mesh that tells how far each pixel is from near lights (area and point lights). "
        "Empty: all is taken as far as the rig's target",
        type=bpy.types.Object,
        poll=lambda _, candidate: candidate.type == "MESH",
    )
    image: PointerProperty(name="Normals", description="Normal map in camera space", type=bpy.types.Image)


class MPS_PG_bake(BakeSettings, bpy.types.PropertyGroup):
    """The bake: its settings and target, and the texture once it is there."""

    target: PointerProperty(
        name="Target",
        description="Mesh object that gets the texture. Empty: the active object",
        type=bpy.types.Object,
        poll=lambda _, candidate: candidate.type == "MESH",
    )
    image: PointerProperty(name="Texture", description="The baked normal texture", type=bpy.types.Image)


class MPS_PG_views(ViewsSettings, bpy.types.PropertyGroup):
    """Many views: their settings, and the report of the last bake."""

    report_file: StringProperty()


class MPS_PG_samples(SamplesSettings, bpy.types.PropertyGroup):
    """Training data: its settings, and the contact sheet of what has been rendered."""

    image: PointerProperty(name="Contact Sheet", description="Some of the samples", type=bpy.types.Image)


class MPS_PG_scene(bpy.types.PropertyGroup):
    """Everything the add-on keeps in a scene: ``scene.mps``."""

    rig: PointerProperty(type=MPS_PG_rig)
    calibrate: PointerProperty(type=MPS_PG_calibrate)
    photo: PointerProperty(type=MPS_PG_photo)
    estimate: PointerProperty(type=MPS_PG_estimate)
    bake: PointerProperty(type=MPS_PG_bake)
    views: PointerProperty(type=MPS_PG_views)
    samples: PointerProperty(type=MPS_PG_samples)


class MPS_PG_job(bpy.types.PropertyGroup):
    """The child process that runs at the moment: ``window_manager.mps``. Neither saved nor undone."""

    running: StringProperty()
    progress: FloatProperty(min=0.0, max=1.0)
    message: StringProperty()
    cancel: BoolProperty()


def take_given(operator: bpy.types.Operator, settings: type, group: bpy.types.PropertyGroup) -> None:
    """Write what the caller gave the operator to the scene's settings, and fill in the rest from there.

    Afterwards operator and scene say the same, and the "Adjust Last Operation" panel shows what was used.
    """
    for name in settings.__annotations__:
        if operator.properties.is_property_set(name):
            setattr(group, name, getattr(operator, name))
        else:
            setattr(operator, name, getattr(group, name))


CLASSES = (
    MPS_PG_light,
    MPS_PG_rig,
    MPS_PG_calibrate,
    MPS_PG_photo,
    MPS_PG_estimate,
    MPS_PG_bake,
    MPS_PG_views,
    MPS_PG_samples,
    MPS_PG_scene,
    MPS_PG_job,
)


def register() -> None:
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.mps = PointerProperty(type=MPS_PG_scene)
    bpy.types.WindowManager.mps = PointerProperty(type=MPS_PG_job)


def unregister() -> None:
    del bpy.types.WindowManager.mps
    del bpy.types.Scene.mps
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
