"""Settings of the rendering of training data."""

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, PointerProperty, StringProperty

from mpsnet_core.synthesis.job import MAX_COUNT

from .declared import GIVEN, PATH


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
            # 8 was a kind that .blend files may still hold.
            ("GROUPS", "Groups", "Several objects beside each other on a ground", "NONE", 16),
        ],
        default={"BLOBS", "DRAPERY", "RELIEFS", "GROUPS"},
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
        description="How often light goes from surface to surface at most, drawn anew for each sample. 0: none",
        default=3,
        min=0,
        max=3,
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


class MPS_PG_samples(SamplesSettings, bpy.types.PropertyGroup):
    """Training data: its settings, and the contact sheet of what has been rendered."""

    image: PointerProperty(name="Contact Sheet", description="Some of the samples", type=bpy.types.Image)
