"""Normals of a sequence, under the names that they get, are an image sequence to Blender."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from mpsnet_core.estimate.sequence.video import video_outputs
from mpsnet_core.io.frames import output_files
from mpsnet_core.io.image_writing import write_image

NAMES = ["frame_{:04d}.png", "shot2_{:04d}_v3.png", "take{}.png", "1.{:03d}.exr"]


@pytest.mark.parametrize("name", [*NAMES, "clip2.mov"])
def test_blender_finds_the_frame_by_its_number(tmp_path, name):
    numbers = range(8, 13)
    if name.endswith(".mov"):
        outputs = [*map(video_outputs(Path(name), tmp_path, ".png"), numbers)]
    else:
        outputs = output_files([tmp_path / "shots" / name.format(number) for number in numbers], tmp_path, ".png")
    for number, output in zip(numbers, outputs, strict=True):
        write_image(output, np.full((4, 4, 3), number / 20))
    image = bpy.data.images.load(str(outputs[0]))
    image.source = "SEQUENCE"
    image.colorspace_settings.name = "Non-Color"
    texture = bpy.data.textures.new("Normals", "IMAGE")
    texture.image = image
    user = texture.image_user
    user.frame_start, user.frame_offset, user.frame_duration = numbers[0], numbers[0] - 1, len(numbers)
    for number, output in zip(numbers, outputs, strict=True):
        user.frame_current = number
        assert Path(image.filepath_from_user(image_user=user)) == output
