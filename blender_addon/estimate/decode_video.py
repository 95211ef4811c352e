"""Frames of a video for the core, decoded by a Blender without a window: the extension ships no FFmpeg.

Blender's sequencer returns any frame of a movie with its stored values. `decoder_command` is for the Blender with the
panel, `decode_video` for the one that decodes, see :mod:`mpsnet_core.estimate.sequence.video`.
"""

import contextlib
from pathlib import Path

import bpy

from mpsnet_core.errors import FormatError, InputError
from mpsnet_core.io.child_process import Parent, ParentGone, requests
from mpsnet_core.io.files import temporary_folder

from ..errors import operator_errors


def decode_video(path: Path) -> None:
    """Send the video's header, then each frame that is requested on stdin, until stdin ends."""
    parent = Parent()
    with contextlib.suppress(ParentGone), temporary_folder() as folder:
        try:
            scene = _opened(path)
            render = scene.render
            header = {"width": render.resolution_x, "height": render.resolution_y, "count": scene.frame_end}
            parent.send(result={**header, "frame_rate": render.fps / render.fps_base})
            for request in requests():
                parent.send(result={"file": str(_frame(scene, request["frame"], folder / "frame.tif"))})
        except InputError as error:
            parent.send(error=str(error))


def _opened(path: Path) -> bpy.types.Scene:
    """A scene with the video at its own size and frame rate, and with its stored values."""
    with operator_errors(f"{path} cannot be read as a video", "is it whole?", FormatError):
        clip, image = bpy.data.movieclips.load(str(path)), bpy.data.images.load(str(path))
    if clip.source != "MOVIE" or not all(clip.size) or clip.fps <= 0 or clip.frame_duration < 1:
        raise FormatError(f"{path} cannot be read as a video; check that it is a complete video file")
    scene = bpy.data.scenes.new("Decoded")
    bpy.context.window_manager.windows[0].scene = scene  # of another scene, the renderer would keep the first frame
    scene.frame_end = clip.frame_duration
    render = scene.render
    render.resolution_x, render.resolution_y = clip.size
    render.resolution_percentage = 100
    render.fps = max(round(clip.fps), 1)
    render.fps_base = render.fps / clip.fps
    render.use_compositing, render.dither_intensity, render.film_transparent = False, 0.0, True
    # From sRGB to sRGB, nothing is converted, whatever the encoding of the values.
    scene.display_settings.display_device = "sRGB"
    scene.view_settings.view_transform = "Standard"
    scene.sequencer_colorspace_settings.name = "sRGB"
    strip = scene.sequence_editor_create().strips.new_movie("Video", str(path), 1, 1, fit_method="ORIGINAL")
    strip.colorspace_settings.name = "sRGB"
    strip.blend_type = "REPLACE"
    stored = render.image_settings
    stored.file_format, stored.color_depth, stored.tiff_codec = "TIFF", "16", "NONE"
    image.size[:]  # loads the image, so that its type (bytes or floats) and channel count are known
    stored.color_mode = "RGBA" if image.depth in (32, 128) else "RGB"
    return scene


def _frame(scene: bpy.types.Scene, number: int, file: Path) -> Path:
    scene.frame_set(number)
    scene.render.filepath = str(file)
    with operator_errors(f"frame {number} cannot be decoded", "convert the video", FormatError):
        bpy.ops.render.render(write_still=True)
    return file
