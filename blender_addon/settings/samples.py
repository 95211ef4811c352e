"""Settings of the rendering of training data."""

import bpy
from bpy.props import EnumProperty

from mpsnet_core.synthesis.operations import Synthesize

from .declared import GIVEN, BoolSetting, EnumSetting, IntSetting, from_option, image_pointer


class SamplesSettings:
    """Content, rendering and folder of training data."""

    source: EnumSetting(
        "Shapes",
        "What the samples show",
        items=[
            ("GENERATED", "Generated", "Shapes made up from the seed: nothing else is needed"),
            (
                "MESHES",
                "Mesh Files",
                "The meshes in a folder, alone and several together: OBJ, PLY, STL, OFF or glTF files",
            ),
            ("SCENE", "Selected Objects", "The mesh objects that are selected in this scene"),
        ],
    )
    kinds: EnumProperty(
        name="Kinds",
        description="Kinds of generated shapes, of which each sample shows one",
        items=[
            ("BLOBS", "Blobs", "Closed lumps: smooth, folded, ridged, wrinkled or faceted"),
            ("DRAPERY", "Drapery", "Hanging and falling cloth"),
            ("RELIEFS", "Reliefs", "Slabs with a relief"),
            # 8 was another kind, which old .blend files may still contain.
            ("GROUPS", "Groups", "Several objects beside each other on a ground", "NONE", 16),
            ("HOLLOWS", "Hollows", "Bowls, niches, limbs and held cloth that few lights reach", "NONE", 32),
        ],
        default={"BLOBS", "DRAPERY", "RELIEFS", "GROUPS"},
        options={"ENUM_FLAG", *GIVEN},
    )
    meshes: from_option(Synthesize, "meshes", name="Mesh Folder")
    count: from_option(Synthesize, "count", default=100)
    seed: from_option(Synthesize, "seed")
    size: from_option(Synthesize, "size")
    samples: IntSetting(
        "Cycles Samples",
        "Cycles samples a pixel, shared by the three lights: more take longer and give less noise",
        default=48,
        within=(1, 65536),
    )
    denoise: BoolSetting(
        "Denoise",
        "Take the noise from each light's picture with OpenImageDenoise, where light goes between surfaces",
        default=True,
    )
    # More than the core's default: each bounce costs the core's synthesis as much again, but Cycles little.
    bounces: from_option(Synthesize, "bounces", default=3)
    views: from_option(Synthesize, "views")
    output: from_option(Synthesize, "output", name="Folder", unset="a folder of its own in the output folder")
    processes: from_option(Synthesize, "processes")


class MPS_PG_samples(SamplesSettings, bpy.types.PropertyGroup):
    """Training data: its settings, and the contact sheet of what has been rendered."""

    image: image_pointer("Contact Sheet", "Some of the samples")
