"""A perfect rig and camera: every channel sees its own light alone, whose direction is known."""

import numpy as np

from mpsnet_core.synthesis.capture_model import CaptureModel

IDEAL = CaptureModel(
    crosstalk=(0.0, 0.0),
    colour_overlap=(0.0, 0.0),
    light_strengths=(1.0, 1.0),
    channel_gains=(1.0, 1.0),
    exact=1.0,
    rendered=0.0,
    exposure=(1.0, 1.0),
    highlights=(0.01, 0.01),
    full_well=(np.inf, np.inf),
    read_noise=(0.0, 0.0),
    bits=(0,),
    srgb=0.0,
    jpeg=0.0,
    blur=(0.0, 0.0),
    mosaic=0.0,
    white=0.0,
    mask_error=(0, 0),
)
